fn main() -> std::process::ExitCode {
    dscene::cli::main(dscene::cli::Program::default())
}
