//! Whose result a folder holds: told by the photo's hash in its report.
use sha2::{Digest, Sha256};
use std::collections::HashSet;
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::Path;
use std::time::SystemTime;

/// The files of a capture, as they are written: the report last.
pub(crate) const FILES: [&str; 7] =
    ["albedo.png", "normal.png", "roughness.png", "render.png", "sheet.png", "material.glb", REPORT];
/// The report.
pub(crate) const REPORT: &str = "report.json";
/// What `render` makes of a capture, which a new capture makes stale.
pub(crate) const RELIT: &str = "relit.png";

/// A report has some kilobytes; what is longer is none.
const MAX_REPORT: u64 = 1 << 20;

/// A photo file, as reports name it.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Source {
    /// As given; what is not UTF-8 in it is replaced.
    pub(crate) path: String,
    /// Length of the file.
    pub(crate) bytes: u64,
    /// SHA-256 of the file, in hexadecimal.
    pub(crate) sha256: String,
    /// When that was.
    #[serde(skip)]
    pub(crate) stamp: Option<Stamp>,
}

/// A photo file at a moment: two that are equal have the same contents, as far as the system tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Stamp {
    bytes: u64,
    modified: Option<SystemTime>,
}

impl Stamp {
    pub(crate) fn of(path: &Path) -> io::Result<Self> {
        let metadata = fs::metadata(path)?;
        Ok(Self { bytes: metadata.len(), modified: metadata.modified().ok() })
    }
}

impl Source {
    /// Reads the file at `path` once, a piece at a time.
    pub(crate) fn of(path: &Path) -> io::Result<Self> {
        // A pipe would wait for ever.
        if !fs::metadata(path)?.is_file() {
            return Err(io::ErrorKind::InvalidInput.into());
        }
        let stamp = Some(Stamp::of(path)?);
        let mut file = File::open(path)?;
        let mut hash = Sha256::new();
        let mut piece = vec![0; 1 << 16];
        let mut bytes = 0;
        loop {
            match file.read(&mut piece) {
                Ok(0) => break,
                Ok(count) => {
                    bytes += count as u64;
                    hash.update(piece.get(..count).unwrap_or_default());
                }
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) => return Err(e),
            }
        }
        let sha256 = hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
        Ok(Self { path: path.display().to_string(), bytes, sha256, stamp })
    }
}

/// What a folder, or what is in its place, means to a photo's result.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Holds {
    /// No result: it is free.
    Nothing,
    /// This photo's result.
    This,
    /// Another photo's, by the path that its report gives, or one of which nothing is known.
    Other(Option<String>),
}

/// Whether the folder at `path` may take the result of the photo with the hash that `sha256` gives, which is asked
/// only if there is a report to compare it with.
pub(crate) fn holds(path: &Path, sha256: &mut dyn FnMut() -> Option<String>) -> Holds {
    let Ok(entries) = fs::read_dir(path) else { return Holds::Nothing };
    let mut names = entries.flatten().filter_map(|entry| entry.file_name().into_string().ok());
    if !names.any(|name| FILES.iter().any(|file| file.eq_ignore_ascii_case(&name))) {
        return Holds::Nothing;
    }
    match claim(path).and_then(|claim| claim.photo) {
        Some(photo) if sha256().is_some_and(|hash| hash == photo.sha256) => Holds::This,
        photo => Holds::Other(photo.map(|photo| photo.path)),
    }
}

/// What of a report, of whatever version, tells whose its folder is.
#[derive(serde::Deserialize)]
struct Claim {
    photo: Option<Source>,
    #[serde(default)]
    files: Vec<String>,
}

/// What the report in `folder` says, if it is one.
fn claim(folder: &Path) -> Option<Claim> {
    let path = folder.join(REPORT);
    // No pipe, which would wait for ever.
    let metadata = fs::metadata(&path).ok().filter(|m| m.is_file() && m.len() <= MAX_REPORT)?;
    let mut text = Vec::with_capacity(metadata.len() as usize);
    File::open(&path).ok()?.take(MAX_REPORT).read_to_end(&mut text).ok()?;
    serde_json::from_slice(&text).ok()
}

/// Names in `folder` that belong to a capture: those of this version, and those that its report lists.
pub(crate) fn result_files(folder: &Path) -> HashSet<OsString> {
    let listed = claim(folder).map(|claim| claim.files).unwrap_or_default();
    FILES.into_iter().chain([RELIT]).map(str::to_owned).chain(listed).map(OsString::from).collect()
}

/// Whether captures, or renders of them, write a file of this name.
pub(crate) fn is_result_file(name: &str) -> bool {
    FILES.contains(&name) || name == RELIT
}
