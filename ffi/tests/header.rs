//! The header: regenerated and compared, its versions, its symbols, and that C and C++ compilers of any age take it.
mod common;

use common::{compile, root, scratch};
use std::collections::BTreeSet;
use std::fs;
use std::process::Command;

fn committed() -> String {
    fs::read_to_string(root().join("include/flashmat.h")).expect("include/flashmat.h")
}

/// With `FLASHMAT_BLESS=1` the header is written instead.
#[test]
fn the_header_is_what_cbindgen_makes_of_the_sources() {
    let config = cbindgen::Config::from_file(root().join("cbindgen.toml")).expect("cbindgen.toml");
    let mut made = Vec::new();
    cbindgen::generate_with_config(root(), config).expect("sources that cbindgen reads").write(&mut made);
    let made = String::from_utf8(made).expect("UTF-8");
    if std::env::var_os("FLASHMAT_BLESS").is_some() {
        fs::write(root().join("include/flashmat.h"), &made).expect("writable");
    }
    assert!(
        made == committed(),
        "include/flashmat.h is not what the sources say: FLASHMAT_BLESS=1 cargo test -p flashmat-ffi --test header"
    );
}

#[test]
fn every_line_of_the_header_fits_on_a_screen() {
    for (number, line) in committed().lines().enumerate() {
        assert!(line.chars().count() <= 120, "line {}: {line}", number + 1);
    }
}

fn constant(name: &str) -> String {
    let found =
        committed().lines().find_map(|line| line.strip_prefix(&format!("#define {name} ")).map(String::from));
    found.unwrap_or_else(|| panic!("{name} is not in the header"))
}

#[test]
fn versions_agree_with_the_package() {
    let [major, minor, patch] =
        ["MAJOR", "MINOR", "PATCH"].map(|part| constant(&format!("FLASHMAT_VERSION_{part}")));
    assert_eq!(format!("{major}.{minor}.{patch}"), env!("CARGO_PKG_VERSION"));
    assert_eq!(constant("FLASHMAT_ABI_VERSION"), flashmat::flashmat_abi_version().to_string());
    let cmake = fs::read_to_string(root().join("cmake/flashmat-config-version.cmake")).expect("cmake");
    assert!(cmake.contains(&format!("set(PACKAGE_VERSION \"{}\")", env!("CARGO_PKG_VERSION"))), "{cmake}");
}

/// What programs are compiled with: the header's structs, enumerations and functions, without comments and versions.
fn compiled() -> String {
    let mut out = String::new();
    let mut comment = false;
    for line in committed().lines().map(str::trim) {
        comment |= line.starts_with("/*");
        let counts = !comment && !line.is_empty() && !line.starts_with("#define FLASHMAT_VERSION");
        if counts && !line.starts_with("#define FLASHMAT_ABI_VERSION") {
            out.push_str(line);
            out.push('\n');
        }
        comment &= !line.ends_with("*/");
    }
    out
}

/// FNV-1a, 64 bits.
fn hash(text: &str) -> u64 {
    text.bytes()
        .fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3))
}

/// Layouts and numbers cannot change while the version stands still: each version has its hash.
#[test]
fn the_abi_version_grows_with_what_programs_are_compiled_with() {
    let this = (flashmat::flashmat_abi_version(), hash(&compiled()));
    assert!(
        compiled().contains("float light_scale;") && !compiled().contains("sizeof"),
        "comments are left out"
    );
    assert_eq!(
        this, ABI,
        "structs, enumerations or functions of the header changed: raise FLASHMAT_ABI_VERSION if the last version has \
         been released or landed, and write the new pair here ({:#018x})",
        this.1
    );
}

/// FLASHMAT_ABI_VERSION and the [`hash`] of what it stands for.
const ABI: (u32, u64) = (4, 0x6137_2cac_f3da_7ac6);

/// Names of functions that the header declares.
fn declared() -> BTreeSet<String> {
    let header = committed();
    let lines = header.lines().filter(|line| !line.trim_start().starts_with('*') && !line.starts_with("#"));
    let functions = lines.filter(|line| !line.contains("typedef")).filter_map(|line| {
        let name = line.split_once('(')?.0.rsplit([' ', '*']).next()?;
        name.starts_with("flashmat_").then(|| name.to_owned())
    });
    functions.collect()
}

#[test]
fn the_shared_library_exports_what_the_header_declares_and_nothing_else() {
    let library = common::library_folder().join("libflashmat.so");
    let symbols = Command::new("nm").args(["-D", "--defined-only"]).arg(&library).output().expect("nm");
    assert!(symbols.status.success(), "{}", String::from_utf8_lossy(&symbols.stderr));
    let symbols = String::from_utf8(symbols.stdout).expect("names");
    let exported = symbols.lines().filter_map(|line| line.split_whitespace().next_back()).map(str::to_owned);
    assert_eq!(exported.collect::<BTreeSet<_>>(), declared());
    assert_eq!(declared().len(), 16, "a new function? Say so in docs/abi.md and raise FLASHMAT_ABI_VERSION");
}

#[test]
fn compilers_of_c_and_cpp_take_the_header_without_a_warning() {
    let source =
        "#include \"flashmat.h\"\n#include \"flashmat.h\"\nint main(void) { return FLASHMAT_STATUS_OK; }\n";
    let strict = ["-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion", "-Wshadow", "-fsyntax-only"];
    for (compiler, standard, extension) in
        [("cc", "c99", "c"), ("cc", "c11", "c"), ("c++", "c++11", "cc"), ("c++", "c++17", "cc")]
    {
        let path = scratch("header").join(format!("{standard}.{extension}"));
        fs::write(&path, source).expect("writable");
        let mut command = Command::new(compiler);
        command.arg(format!("-std={standard}")).args(strict).arg("-I").arg(root().join("include")).arg(&path);
        if compiler == "cc" {
            command.arg("-Wstrict-prototypes");
        }
        compile(&mut command);
    }
}

#[test]
fn the_swift_package_has_this_header_and_its_numbers() {
    common::run(Command::new("sh").arg(root().join("../ios/verify-codes.sh")));
}
