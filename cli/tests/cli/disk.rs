//! Output folders that cannot be written, disks that fill up, and Ctrl-C: nothing half-written appears.

use crate::common::{FILES, Folder, assert_one_complaint, capture, flashmat, names, stderr};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A small tmpfs, unmounted with the value; `None`, said plainly, where this user may not mount one.
struct Tmpfs(PathBuf);

impl Tmpfs {
    fn mount(at: &Path, options: &str) -> Option<Self> {
        std::fs::create_dir_all(at).expect("mount point");
        let run = Command::new("mount").args(["-t", "tmpfs", "-o", options, "tmpfs"]).arg(at).output();
        if run.is_ok_and(|r| r.status.success()) {
            return Some(Self(at.to_owned()));
        }
        println!("NOT RUN: this user cannot mount a tmpfs ({options})");
        None
    }
}

impl Drop for Tmpfs {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(&self.0).status();
    }
}

#[test]
fn an_output_folder_under_a_file_is_named() {
    let folder = Folder::new();
    let photo = folder.photo("a.png");
    let file = folder.file("file", b"x");
    let run = capture(&[&photo], &file.join("out"), &[]);
    assert_one_complaint(&run, &photo, &["file/out", "cannot be written", "choose another place with --out"]);
    assert_eq!(std::fs::read(&file).expect("file"), b"x");
}

#[test]
fn a_result_does_not_replace_a_file_of_its_name() {
    let folder = Folder::new();
    let photo = folder.photo("a.png");
    std::fs::create_dir(folder.path("out")).expect("folder");
    let precious = folder.file("out/a", b"precious");
    let run = capture(&[&photo], &folder.path("out"), &[]);
    assert_one_complaint(&run, &photo, &["cannot be written"]);
    assert_eq!(std::fs::read(&precious).expect("file"), b"precious");
    assert_eq!(names(&folder.path("out")), ["a"]);
}

#[test]
fn a_read_only_disk_is_named() {
    let folder = Folder::new();
    let photo = folder.photo("a.png");
    let Some(disk) = Tmpfs::mount(&folder.path("disk"), "ro,size=1m") else { return };
    let run = capture(&[&photo], &disk.0.join("out"), &[]);
    assert_one_complaint(&run, &photo, &["read-only file system", "--out"]);
}

#[test]
fn a_full_disk_is_named_and_leaves_no_part() {
    let folder = Folder::new();
    let photo = folder.photo("a.png");
    // Room for the first maps, not for the sheet.
    let Some(disk) = Tmpfs::mount(&folder.path("disk"), "size=64k") else { return };
    let run = capture(&[&photo], &disk.0.join("out"), &[]);
    assert_one_complaint(&run, &photo, &["no space left", "free some space"]);
    assert_eq!(names(&disk.0.join("out")), [""; 0]);
}

#[test]
fn ctrl_c_leaves_whole_results_only() {
    let folder = Folder::new();
    let photos: Vec<_> = (0..40).map(|i| folder.photo(&format!("p{i}.png"))).collect();
    // At several moments: in a stage, while writing, between photos.
    for wait in [0, 30, 70] {
        let out = folder.path(&format!("out{wait}"));
        let mut command = flashmat(["capture", "--size", "256", "--threads", "2", "--quiet", "--out"]);
        command.arg(&out).args(&photos).stderr(Stdio::piped());
        let mut child = command.spawn().expect("start");
        let start = Instant::now();
        while names(&out).is_empty() && start.elapsed() < Duration::from_secs(60) {
            std::thread::sleep(Duration::from_millis(5));
        }
        std::thread::sleep(Duration::from_millis(wait));
        assert!(child.try_wait().expect("wait").is_none(), "still at work");
        let kill = Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill");
        assert!(kill.success());
        let run = child.wait_with_output().expect("end");
        assert_eq!(run.status.code(), Some(1), "{}", stderr(&run));
        let done = names(&out);
        assert!(done.len() < photos.len());
        for name in &done {
            assert!(!name.starts_with('.'), "a part is left: {name}");
            assert_eq!(names(&out.join(name)), FILES);
        }
        let lines = stderr(&run);
        assert_eq!(lines.lines().count(), photos.len() - done.len(), "one line for each photo not done");
        assert!(lines.lines().all(|l| l.contains("interrupted")), "{lines}");
    }
}
