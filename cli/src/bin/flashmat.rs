//! The program `flashmat`: all of it lies in the library beside it, where the fuzzers reach it too.
use std::process::ExitCode;

fn main() -> ExitCode {
    flashmat_cli::main()
}
