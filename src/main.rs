fn main() -> std::process::ExitCode {
    dscene::cli::main()
}
