//! The C programs that misuse the library, race on it, and use it long; and the example.
mod common;

use common::{Build, compile, program, root, run, run_valgrind, scratch, toy_model, valgrind};
use std::fs;
use std::process::Command;

fn clean(name: &str) {
    let source = root().join(format!("tests/c/{name}.c"));
    for build in [Build::C99, Build::Cpp17, Build::Sanitized] {
        println!("{build:?}: {}", run(Command::new(program(&source, build)).arg(toy_model())));
    }
    if valgrind() {
        println!("valgrind: {}", run_valgrind(&program(&source, Build::C99), &[&toy_model()]));
    }
}

#[test]
fn misuse_gives_a_status_and_a_text_and_no_harm() {
    clean("misuse");
}

#[test]
fn threads_that_share_an_engine_are_kept_apart() {
    clean("concurrency");
}

/// `FLASHMAT_SOAK` captures (300 if it does not say): docs/reliability.md has a long run's table.
#[test]
fn memory_stays_flat_and_maps_the_same_over_many_captures() {
    let captures = std::env::var("FLASHMAT_SOAK").unwrap_or_else(|_| "300".into());
    let soak = program(&root().join("tests/c/soak.c"), Build::C99);
    println!("{}", run(Command::new(soak).arg(toy_model()).arg(captures)));
}

#[test]
fn the_example_writes_the_maps_of_a_photo() {
    let folder = scratch("example");
    let mut photo = format!("P6\n# a comment\n{} {}\n255\n", 160, 150).into_bytes();
    photo.extend((0..3 * 160 * 150).map(|i| (200 - i % 480 / 4 + i / 480 % 7) as u8));
    fs::write(folder.join("photo.ppm"), photo).expect("writable");
    let source = root().join("../examples/c/capture.c");
    for build in [Build::C99, Build::Cpp17, Build::Sanitized] {
        let mut command = Command::new(program(&source, build));
        command.arg(folder.join("photo.ppm")).arg(&folder).arg(toy_model());
        let said = run(&mut command);
        assert!(said.contains("class"), "{said}");
        for (name, start) in
            [("albedo.ppm", "P6\n256 256\n255\n"), ("normal.ppm", "P6"), ("roughness.pgm", "P5")]
        {
            let file = folder.join(name);
            let map = fs::read(&file).expect("a map");
            assert!(map.starts_with(start.as_bytes()), "{name}");
            assert_eq!(map.len(), 15 + 65536 * if start == "P5" { 1 } else { 3 }, "{name}");
            fs::remove_file(file).expect("ours");
        }
        let material = fs::read(folder.join("material.glb")).expect("a GLB");
        assert!(material.starts_with(b"glTF") && material[8..12] == (material.len() as u32).to_le_bytes());
        fs::remove_file(folder.join("material.glb")).expect("ours");
    }
    let missing =
        Command::new(program(&source, Build::C99)).args(["none.ppm", ".", "none"]).output().expect("runs");
    assert_eq!(missing.status.code(), Some(1));
}

#[test]
fn the_lines_of_the_readme_run() {
    let source = root().join("../examples/c/readme.c");
    for build in [Build::C99, Build::Sanitized] {
        let said = run(Command::new(program(&source, build)).arg(toy_model()));
        assert!(said.contains("residual"), "{said}");
    }
}

/// The package files, as an installed library's users have them.
#[test]
fn pkg_config_and_cmake_find_an_installed_library() {
    let prefix = scratch("prefix");
    let install = root().join("install.sh");
    let mut command = Command::new("sh");
    command.arg(install).arg(common::library_folder()).arg(&prefix);
    compile(&mut command);
    let source = root().join("../examples/c/capture.c");
    let flags = Command::new("pkg-config")
        .env("PKG_CONFIG_PATH", prefix.join("lib/pkgconfig"))
        .args(["--cflags", "--libs", "--static", "flashmat"])
        .output();
    match flags {
        Ok(flags) if flags.status.success() => {
            let flags = String::from_utf8(flags.stdout).expect("flags");
            let mut command = Command::new("cc");
            command.arg("-std=c99").arg(&source).args(flags.split_whitespace());
            compile(command.arg("-o").arg(prefix.join("with-pkg-config")));
        }
        Ok(flags) => panic!("{}", common::words(&flags)),
        Err(error) => println!("NOT CHECKED: pkg-config: {error}"),
    }
    if let Err(error) = Command::new("cmake").arg("--version").output() {
        println!("NOT CHECKED: cmake: {error}");
        return;
    }
    // Anew: CMake's cache of another checkout's source, built in the same target folder, would be refused.
    let build = prefix.join("build");
    let _ = fs::remove_dir_all(&build);
    let mut command = Command::new("cmake");
    command.arg("-S").arg(root().join("tests/cmake")).arg("-B").arg(&build);
    compile(command.arg(format!("-DCMAKE_PREFIX_PATH={}", prefix.display())));
    compile(Command::new("cmake").arg("--build").arg(&build));
    for program in ["capture-static", "capture-shared"] {
        let status = Command::new(build.join(program)).output().expect("runs").status;
        assert_eq!(status.code(), Some(2), "{program} without arguments tells its usage");
    }
}
