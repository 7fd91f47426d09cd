//! Rules that the compiler does not know: where unsafe code lies, that every export is guarded, that every error of the
//! core has a status.
mod common;

use common::root;
use std::fs;

/// File name and text of every source file.
fn sources() -> Vec<(String, String)> {
    let mut files: Vec<_> = fs::read_dir(root().join("src"))
        .expect("src")
        .map(|entry| entry.expect("a file").path())
        .map(|path| {
            let name = path.file_name().and_then(|name| name.to_str()).expect("a name").to_owned();
            (name, fs::read_to_string(path).expect("text"))
        })
        .collect();
    files.sort();
    files
}

fn code(text: &str) -> impl Iterator<Item = &str> {
    // Tests read C strings.
    let text = text.split("#[cfg(test)]").next().unwrap_or("").split("#[cfg(all(test").next().unwrap_or("");
    text.lines().map(str::trim_start).filter(|line| !line.starts_with("//"))
}

#[test]
fn raw_pointers_are_touched_in_two_files() {
    for (name, text) in sources() {
        let unsafe_lines: Vec<_> =
            code(&text).filter(|line| line.contains("unsafe ") && !line.contains("reason =")).collect();
        let allowed = match name.as_str() {
            "ptr.rs" | "handle.rs" => continue,
            // The declaration of the program's own function.
            "bare.rs" => vec!["unsafe extern \"C\" {"],
            _ => vec![],
        };
        assert_eq!(unsafe_lines, allowed, "{name}");
    }
}

#[test]
fn every_export_that_can_fail_is_guarded() {
    // They return a constant or a pointer to one.
    let plain = [
        "flashmat_abi_version",
        "flashmat_class_name",
        "flashmat_last_error",
        "flashmat_level_name",
        "flashmat_stage_name",
        "flashmat_status_name",
        "flashmat_status_text",
        "flashmat_version",
    ];
    let mut exports = 0;
    for (file, text) in sources() {
        let text: Vec<_> = code(&text).collect();
        for (at, line) in text.iter().enumerate() {
            let Some(rest) = line.strip_prefix("pub extern \"C\" fn ") else { continue };
            exports += 1;
            let name = rest.split('(').next().unwrap_or("");
            assert_eq!(text[at - 1], "#[unsafe(no_mangle)]", "{file}: {name}");
            if plain.contains(&name) {
                continue;
            }
            let body = text[at..].iter().skip_while(|line| !line.ends_with('{')).nth(1).expect("a body");
            assert!(body.starts_with("guard(|| "), "{file}: {name} starts with: {body}");
        }
    }
    assert_eq!(exports, 16);
}

#[test]
fn every_error_of_the_core_has_a_status_of_its_own_choice() {
    let errors = fs::read_to_string(root().join("../core/src/base/error.rs")).expect("core");
    let body =
        errors.split("pub enum Error {").nth(1).and_then(|rest| rest.split("\n}").next()).expect("enum");
    let variants = body
        .lines()
        .filter_map(|line| line.strip_prefix("    "))
        .filter(|line| line.starts_with(|c: char| c.is_ascii_uppercase()));
    let status = fs::read_to_string(root().join("src/status.rs")).expect("status.rs");
    let mut count = 0;
    for variant in variants {
        let name: String = variant.chars().take_while(char::is_ascii_alphanumeric).collect();
        let named = status
            .match_indices(&format!("Error::{name}"))
            .any(|(at, found)| !status[at + found.len()..].starts_with(|c: char| c.is_ascii_alphanumeric()));
        assert!(named, "status.rs does not name Error::{name}");
        count += 1;
    }
    assert!(count >= 17, "{count} variants found");
}

#[test]
fn files_stay_readable() {
    for (name, text) in sources() {
        assert!(text.lines().count() <= 500, "{name} has {} lines", text.lines().count());
        assert!(text.starts_with("//! "), "{name} does not say what it is");
    }
}
