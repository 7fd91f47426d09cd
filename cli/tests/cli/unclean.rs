//! Runs that end badly, by the program itself; `tests/faults` does the same at every system call.

use crate::common::{FILES, Folder, capture, flashmat, names, photo, report, stderr};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Side of every map in a folder, which is one for a whole result.
fn sides(folder: &Path) -> Vec<u32> {
    let maps = ["albedo.png", "normal.png", "roughness.png", "render.png"];
    let mut sides: Vec<_> = maps.iter().map(|m| image::open(folder.join(m)).expect(m).width()).collect();
    sides.push(report(folder).expect("report")["size"].as_u64().expect("size") as u32);
    sides.dedup();
    sides
}

#[test]
fn a_kill_at_any_time_leaves_the_old_result_or_the_new_one() {
    let folder = Folder::new();
    let out = folder.path("out");
    let photos = [folder.photo("a.png"), folder.photo("b.png"), folder.photo("c.png")];
    let paths: Vec<_> = photos.iter().map(|p| p.as_path()).collect();
    assert!(capture(&paths, &out, &["--no-refine"]).status.success());
    std::fs::write(out.join("a/notes"), "mine").expect("write");
    for round in 0..12 {
        let mut command =
            flashmat(["capture", "--no-refine", "-q", "--threads", "1", "--size", "256", "--out"]);
        let mut child = command.arg(&out).args(&photos).stderr(Stdio::null()).spawn().expect("start");
        std::thread::sleep(Duration::from_millis(40 + 37 * round));
        child.kill().expect("kill");
        child.wait().expect("end");
        for name in ["a", "b", "c"] {
            assert_eq!(sides(&out.join(name)).len(), 1, "{name} after round {round}");
        }
        assert_eq!(std::fs::read(out.join("a/notes")).expect("notes"), b"mine");
    }
    assert!(capture(&paths, &out, &["--no-refine"]).status.success());
    assert_eq!(names(&out), ["a", "b", "c"], "what the dead have left is gone");
    assert_eq!(sides(&out.join("b")), [128]);
}

/// In two containers each is process 1; what one of them left when it was killed stops neither.
#[test]
fn two_first_processes_share_a_folder() {
    let unshare = |args: &[&str]| {
        let mut command = Command::new("unshare");
        command.args(["-p", "-f"]).args(args);
        command
    };
    if !unshare(&["true"]).output().is_ok_and(|run| run.status.success()) {
        println!("NOT RUN: this user cannot make process namespaces");
        return;
    }
    let folder = Folder::new();
    let out = folder.path("out");
    let photos: Vec<_> = (0..4).map(|i| folder.photo(&format!("p{i}.png"))).collect();
    std::fs::create_dir_all(out.join(".p0.1-0.part")).expect("folder");
    let start = || {
        let mut command =
            unshare(&[env!("CARGO_BIN_EXE_flashmat"), "capture", "--no-refine", "-q", "--threads", "1"]);
        command.args(["--size", "128", "--out"]).arg(&out).args(&photos);
        command.stderr(Stdio::piped()).spawn().expect("start")
    };
    for child in [start(), start()] {
        let run = child.wait_with_output().expect("end");
        assert!(run.status.success(), "{}", stderr(&run));
    }
    assert_eq!(names(&out), ["p0", "p1", "p2", "p3"]);
    for name in names(&out) {
        assert_eq!(names(&out.join(name)), FILES);
    }
}

#[test]
fn a_photo_that_changes_while_it_is_read_is_named() {
    let folder = Folder::new();
    let path = folder.path("big.png");
    photo(3000, 2400).save(&path).expect("save");
    let out = folder.path("out");
    let mut command = flashmat(["capture", "--no-refine", "-q", "--threads", "1", "--out"]);
    let child = command.arg(&out).arg(&path).stderr(Stdio::piped()).spawn().expect("start");
    // As a slow copy would, something writes to it until the run is over.
    let over = Arc::new(AtomicBool::new(false));
    let writer = std::thread::spawn({
        let (over, path) = (Arc::clone(&over), path.clone());
        move || {
            while !over.load(Ordering::Relaxed) {
                let file = std::fs::File::options().append(true).open(&path).expect("open");
                file.set_modified(std::time::SystemTime::now()).expect("touch");
                std::thread::sleep(Duration::from_millis(2));
            }
        }
    });
    let run = child.wait_with_output().expect("end");
    over.store(true, Ordering::Relaxed);
    writer.join().expect("join");
    assert_eq!(run.status.code(), Some(1));
    assert!(
        stderr(&run).contains("big.png: has changed while it was read; run it again"),
        "{}",
        stderr(&run)
    );
}
