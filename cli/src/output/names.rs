//! Names of results: safe on every file system, whatever the photos are called.
use std::ffi::OsStr;
use std::path::Path;

/// The longest name in bytes, if the file system does not say less.
const LONGEST: usize = 255;
/// Bytes kept free for a number at the end.
const NUMBER: usize = 15;
/// In place of a name of which nothing is left.
const NAMELESS: &str = "photo";

/// Bytes that a name in `folder` may have before it is numbered.
pub(crate) fn limit(folder: &Path) -> usize {
    let system = longest(folder).unwrap_or(LONGEST);
    system.clamp(4 * NUMBER, LONGEST) - NUMBER
}

#[cfg(unix)]
fn longest(folder: &Path) -> Option<usize> {
    // 0 means that the file system does not say.
    let longest = rustix::fs::statvfs(folder).ok()?.f_namemax;
    usize::try_from(longest).ok().filter(|&n| n > 0)
}

#[cfg(not(unix))]
fn longest(_folder: &Path) -> Option<usize> {
    None
}

/// A name for the result of a photo whose file name without extension is `stem`: never empty, never one that leads
/// elsewhere (dots only), none that Windows reserves or cannot hold, none that ends in a dot or blank, none that looks
/// like a work folder, at most `limit` bytes. Different stems may give the same name.
pub(crate) fn safe(stem: &OsStr, limit: usize) -> String {
    let plain = |c: char| match c {
        '<' | '>' | ':' | '"' | '/' | '\\' | '|' | '?' | '*' => '_',
        c if c.is_control() || c == char::REPLACEMENT_CHARACTER => '_',
        c => c,
    };
    let mut name: String = stem.to_string_lossy().chars().map(plain).collect();
    let ends = |c: char| c == '.' || c.is_whitespace();
    name.truncate(name.trim_end_matches(ends).len());
    if name.trim_start_matches(ends).is_empty() {
        return NAMELESS.to_owned();
    }
    if is_reserved(&name) || (name.starts_with('.') && name.ends_with(".part")) {
        name.insert(0, '_');
    }
    if name.len() > limit {
        let end = (0..=limit).rev().find(|&end| name.is_char_boundary(end)).unwrap_or(0);
        name.truncate(end);
        name.truncate(name.trim_end_matches(ends).len());
    }
    name
}

/// Whether Windows keeps the name, with any extension, for a device.
fn is_reserved(name: &str) -> bool {
    let device = name.split('.').next().unwrap_or(name).trim_end().to_uppercase();
    let numbered = |prefix: &str| {
        let number = device.strip_prefix(prefix).map(|n| n.chars().collect::<Vec<_>>());
        matches!(number.as_deref(), Some(['0'..='9' | '¹' | '²' | '³']))
    };
    matches!(device.as_str(), "CON" | "PRN" | "AUX" | "NUL" | "CONIN$" | "CONOUT$" | "CLOCK$")
        || numbered("COM")
        || numbered("LPT")
}

/// The name of the `count`th result of a name, from 1.
pub(crate) fn numbered(name: &str, count: u32) -> String {
    if count == 1 { name.to_owned() } else { format!("{name}-{count}") }
}

/// Equal for names that some file system takes for one: case does not count.
pub(crate) fn fold(name: &str) -> String {
    name.to_uppercase().to_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_stem_leads_elsewhere_or_is_kept_by_a_system() {
        let cases = [
            ("wood", "wood"),
            ("..", "photo"),
            (".", "photo"),
            ("...", "photo"),
            (". .", "photo"),
            (" ", "photo"),
            ("", "photo"),
            ("a.", "a"),
            ("a. .", "a"),
            ("a\u{a0}", "a"),
            (" a", " a"),
            (".hidden", ".hidden"),
            ("con", "_con"),
            ("Aux.b", "_Aux.b"),
            ("nul .b", "_nul .b"),
            ("COM7", "_COM7"),
            ("lpt²", "_lpt²"),
            ("COM77", "COM77"),
            ("CONE", "CONE"),
            ("a/b\\c:d", "a_b_c_d"),
            ("a\nb", "a_b"),
            (".flashmat-1.part", "_.flashmat-1.part"),
            (".x.1-0.part", "_.x.1-0.part"),
            ("Küche 木", "Küche 木"),
        ];
        for (stem, wanted) in cases {
            assert_eq!(safe(OsStr::new(stem), 240), wanted, "{stem:?}");
        }
    }

    #[test]
    fn long_names_are_cut_between_characters() {
        assert_eq!(safe(OsStr::new(&"l".repeat(250)), 240), "l".repeat(240));
        assert_eq!(safe(OsStr::new(&"木".repeat(100)), 240), "木".repeat(80));
        assert_eq!(safe(OsStr::new(&format!("{}. b", "a".repeat(99))), 100), "a".repeat(99));
        // What stands at the front goes with the rest.
        assert_eq!(safe(OsStr::new(&format!("con.{}", "l".repeat(300))), 100).len(), 100);
        let name = safe(OsStr::new(&"l".repeat(300)), limit(&std::env::temp_dir()));
        assert!(numbered(&name, u32::MAX).len() <= LONGEST);
    }

    #[test]
    fn case_does_not_tell_names_apart() {
        assert_eq!(fold("Straße"), fold("STRASSE"));
        assert_ne!(fold("a"), fold("a-2"));
    }
}
