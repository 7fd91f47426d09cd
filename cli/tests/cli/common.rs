//! What the tests of the program share: folders that go away, photos made on the spot, and the program itself.
use crate::schema::{complaints, report_schema};
use image::{Rgb, RgbImage};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::atomic::{AtomicU32, Ordering};

/// A folder that is removed with the value.
pub(crate) struct Folder(PathBuf);

impl Folder {
    pub(crate) fn new() -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        let folder = std::env::temp_dir().join(format!("flashmat-cli-{}-{count}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("temporary folder");
        Self(folder)
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// A file of these bytes.
    pub(crate) fn file(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.path(name);
        std::fs::write(&path, bytes).expect("write");
        path
    }

    /// A photo of tiles under a flash, in the format that the name says.
    pub(crate) fn photo(&self, name: &str) -> PathBuf {
        let path = self.path(name);
        photo(160, 144).save(&path).expect("save");
        path
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Tiles with a little grain under a flash: bright in the middle, darker to the corners.
pub(crate) fn photo(width: u32, height: u32) -> RgbImage {
    RgbImage::from_fn(width, height, |x, y| {
        let (dx, dy) = (x as f32 / width as f32 - 0.5, y as f32 / height as f32 - 0.5);
        let flash = 1.0 / (1.0 + 2.0 * (dx * dx + dy * dy));
        let tile = if (x / 20 + y / 20) % 2 == 0 { 190.0 } else { 120.0 };
        let grain = ((x * 7919 + y * 104_729) % 13) as f32;
        let value = (tile + grain) * flash;
        Rgb([value as u8, (0.9 * value) as u8, (0.7 * value) as u8])
    })
}

/// The program with these arguments, not yet run.
pub(crate) fn flashmat<S: AsRef<std::ffi::OsStr>>(args: impl IntoIterator<Item = S>) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_flashmat"));
    command.args(args);
    command
}

/// `flashmat capture` of `photos` into `out`, small and on one thread. Every report there is checked.
pub(crate) fn capture(photos: &[&Path], out: &Path, more: &[&str]) -> Output {
    let mut command = flashmat(["capture", "--size", "128", "--threads", "1", "--out"]);
    command.arg(out).args(more).args(photos);
    let output = command.output().expect("the program starts");
    for name in names(out) {
        if let Some(report) = report(&out.join(&name)) {
            let schema = report_schema();
            assert_eq!(complaints(&schema, &schema, &report, &name), [""; 0]);
        }
    }
    output
}

/// The report in a folder, if there is one.
pub(crate) fn report(folder: &Path) -> Option<serde_json::Value> {
    let text = std::fs::read(folder.join("report.json")).ok()?;
    Some(serde_json::from_slice(&text).expect("a report is JSON"))
}

pub(crate) fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

pub(crate) fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Names of what lies in a folder, sorted; none when there is no folder.
pub(crate) fn names(folder: &Path) -> Vec<String> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let mut names: Vec<_> =
        entries.map(|e| e.expect("entry").file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// The files of a capture.
pub(crate) const FILES: [&str; 7] =
    ["albedo.png", "material.glb", "normal.png", "render.png", "report.json", "roughness.png", "sheet.png"];

/// Asserts exit status 1 and exactly one line on stderr that names `path` and holds each of `parts`.
pub(crate) fn assert_one_complaint(output: &Output, path: &Path, parts: &[&str]) {
    let text = stderr(output);
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert_eq!(text.lines().count(), 1, "{text}");
    assert!(text.starts_with(&format!("flashmat: {}: ", path.display())), "{text}");
    for part in parts {
        assert!(text.contains(part), "no {part:?} in {text}");
    }
    assert!(text.trim_end().contains("; "), "says what would help: {text}");
}
