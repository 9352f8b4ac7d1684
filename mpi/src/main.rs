//! `dsl`, in several processes that do one run together: `mpirun -n 8 dsl-mpi run scene.dscene`.

mod link;

use dscene::cli::{Program, main as command_line};

fn main() -> std::process::ExitCode {
    command_line(Program { processes: Some("MPI"), ranks: link::join() })
}
