//! What the tests share: where things lie, C compilers, and running programs.
#![allow(dead_code, reason = "each test program uses a part of it")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// This package's folder.
pub(crate) fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// The toy model of the golden files: small and fast.
pub(crate) fn toy_model() -> PathBuf {
    root().join("../tests/golden/toy.fmat")
}

/// A folder for a test's files.
pub(crate) fn scratch(test: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(test);
    fs::create_dir_all(&folder).expect("a folder for files");
    folder
}

/// Where cargo put libflashmat.a and libflashmat.so: beside the test programs.
pub(crate) fn library_folder() -> PathBuf {
    let program = std::env::current_exe().expect("a test program");
    program.parent().expect("in a folder").to_owned()
}

/// Runs a compiler; its words are the test's if it fails.
pub(crate) fn compile(command: &mut Command) {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    assert!(output.status.success(), "{command:?}\n{}", words(&output));
}

/// What a program said.
pub(crate) fn words(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

/// How a C program is built.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Build {
    /// C99, against the static library.
    C99,
    /// C++17, against the shared library.
    Cpp17,
    /// C99 under AddressSanitizer (with leaks) and UndefinedBehaviorSanitizer.
    Sanitized,
}

/// Builds a C program; returns its path.
pub(crate) fn program(source: &Path, build: Build) -> PathBuf {
    let name = source.file_stem().and_then(|name| name.to_str()).expect("a file name");
    let out = scratch("programs").join(format!("{name}-{build:?}"));
    let mut command = match build {
        Build::C99 | Build::Sanitized => Command::new("cc"),
        Build::Cpp17 => Command::new("c++"),
    };
    match build {
        Build::C99 => command.arg("-std=c99"),
        Build::Cpp17 => command.args(["-std=c++17", "-x", "c++"]),
        Build::Sanitized => {
            command.args(["-std=c99", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"])
        }
    };
    if cfg!(feature = "embedded-model") {
        command.arg("-DEMBEDDED");
    }
    command.args(["-g", "-O1", "-Wall", "-Wextra", "-Werror", "-pedantic", "-pthread", "-I"]);
    command.arg(root().join("include")).arg(source).args(["-x", "none"]);
    if build == Build::Cpp17 {
        let folder = library_folder();
        command.arg("-L").arg(&folder).arg("-lflashmat").arg(format!("-Wl,-rpath,{}", folder.display()));
    } else {
        command.arg(library_folder().join("libflashmat.a")).args(["-ldl", "-lm"]);
    }
    compile(command.arg("-o").arg(&out));
    out
}

/// Whether valgrind is there; says so if not, and fails if it must be (`FLASHMAT_REQUIRE_VALGRIND`).
pub(crate) fn valgrind() -> bool {
    let there =
        Command::new("valgrind").arg("--version").output().is_ok_and(|output| output.status.success());
    if !there {
        assert!(std::env::var_os("FLASHMAT_REQUIRE_VALGRIND").is_none(), "valgrind is required");
        println!("NOT CHECKED: valgrind is not installed; AddressSanitizer alone looked for leaks");
    }
    there
}

/// Runs a program; panics with its words unless it ends with 0.
pub(crate) fn run(command: &mut Command) -> String {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    assert!(output.status.success(), "{command:?}: {}\n{}", output.status, words(&output));
    words(&output)
}

/// Runs a program under valgrind: every error and leak is a failure.
pub(crate) fn run_valgrind(program: &Path, arguments: &[&Path]) -> String {
    let mut command = Command::new("valgrind");
    command.args([
        "--quiet",
        "--error-exitcode=9",
        "--leak-check=full",
        "--show-leak-kinds=definite,indirect",
    ]);
    command.args(["--errors-for-leak-kinds=definite,indirect", "--fair-sched=yes"]);
    run(command.arg(program).args(arguments))
}
