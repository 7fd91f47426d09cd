//! Rules that the compiler does not know: who may import whom, and where unsafe code lies.
use std::fs;
use std::path::{Path, PathBuf};

/// Modules, lowest floor first: a module imports itself and modules of lower floors.
const FLOORS: [&[&str]; 6] = [
    &["base"],
    &["kernels"],
    &["frame", "maps", "stage"],
    &["net", "crf", "brdf"],
    &["highlight", "search"],
    &["capture", "session"],
];
/// What `lib.rs` names at the root: everyone's.
const ROOT: [&str; 6] = ["Error", "ModelError", "Observer", "Stage", "Session", "SessionOptions"];

/// Every source file below `folder`, test files left out.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut files = vec![];
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("a file").path();
        let name = path.file_stem().and_then(|name| name.to_str()).expect("a name").to_owned();
        if path.is_dir() && name != "tests" {
            files.extend(sources(&path));
        } else if path.extension().is_some_and(|e| e == "rs")
            && !["tests", "testing", "scenes"].contains(&&*name)
        {
            files.push(path);
        }
    }
    files.sort();
    files
}

fn src() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

/// The lines of a file that are neither comments nor tests.
fn code(path: &Path) -> String {
    let text = fs::read_to_string(path).expect("text");
    let text = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or("");
    text.lines().filter(|line| !line.trim_start().starts_with("//")).collect::<Vec<_>>().join("\n")
}

/// The modules that `code` names after `crate::`, one by one or in braces.
fn imports(code: &str) -> Vec<String> {
    let word =
        |text: &str| text.split(|c: char| !c.is_alphanumeric() && c != '_').next().unwrap_or("").to_owned();
    let mut found = vec![];
    for rest in code.split("crate::").skip(1) {
        let Some(list) = rest.strip_prefix('{') else {
            found.push(word(rest));
            continue;
        };
        let (mut depth, mut item) = (0, String::new());
        for c in list.chars() {
            match c {
                '{' => depth += 1,
                '}' if depth == 0 => break,
                '}' => depth -= 1,
                ',' if depth == 0 => found.push(word(core::mem::take(&mut item).trim())),
                _ if depth == 0 => item.push(c),
                _ => {}
            }
        }
        found.push(word(item.trim()));
    }
    found.retain(|name| !name.is_empty());
    found
}

fn floor(module: &str) -> Option<usize> {
    FLOORS.iter().position(|modules| modules.contains(&module))
}

#[test]
fn imports_go_down() {
    let mut checked = 0;
    for path in sources(&src()) {
        let inside = path.strip_prefix(src()).expect("below src").with_extension("");
        let module = inside.iter().next().and_then(|name| name.to_str()).expect("a name");
        if module == "lib" {
            continue;
        }
        let own = floor(module).unwrap_or_else(|| panic!("{module} has no floor: add it to FLOORS"));
        for name in imports(&code(&path)) {
            let allowed = name == module
                || ROOT.contains(&&*name)
                || floor(&name).is_some_and(|floor| floor < own || (floor == own && own > 0));
            assert!(allowed, "{}: imports {name}, which is not below {module}", inside.display());
            checked += 1;
        }
    }
    assert!(checked > 200, "{checked}");
}

/// Modules of one floor may import each other, but not in a circle.
#[test]
fn no_two_modules_import_each_other() {
    let mut arrows = vec![];
    for path in sources(&src()) {
        let inside = path.strip_prefix(src()).expect("below src").with_extension("");
        let module = inside.iter().next().and_then(|name| name.to_str()).expect("a name").to_owned();
        arrows.extend(imports(&code(&path)).into_iter().map(|name| (module.clone(), name)));
    }
    for (from, to) in &arrows {
        assert!(from == to || !arrows.contains(&(to.clone(), from.clone())), "{from} and {to}");
    }
}

#[test]
fn unsafe_code_lies_in_two_folders() {
    for path in sources(&src()) {
        let inside = path.strip_prefix(src()).expect("below src");
        let has = code(&path).contains("unsafe ");
        let may = inside.starts_with("kernels") || inside.starts_with("base/simd");
        assert!(!has || may, "{}", inside.display());
    }
}

#[test]
fn the_reader_of_imports_reads_them() {
    let code = "use crate::{Error, maps::{Maps, check}, net};\nfn f() { crate::base::exec::run() }";
    assert_eq!(imports(code), ["Error", "maps", "net", "base"]);
}
