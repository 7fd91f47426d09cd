//! Staging folders and files in quiet times; see `faults` for others.
use super::*;
use crate::output::owner::{FILES, REPORT};
use std::sync::atomic::{AtomicU32, Ordering};

/// A folder that is removed with the value.
pub(super) struct Folder(PathBuf);

impl Folder {
    pub(super) fn new(name: &str) -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        let folder = format!("flashmat-files-{}-{count}-{name}", std::process::id());
        let folder = std::env::temp_dir().join(folder);
        fs::create_dir_all(&folder).expect("temporary folder");
        Self(folder)
    }

    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

pub(super) fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).expect("folder");
    let mut names: Vec<_> = entries.map(|e| e.expect("entry").file_name().display().to_string()).collect();
    names.sort();
    names
}

fn put(target: &Path, files: &[(&str, &str)]) -> bool {
    let mut staging = Staging::new(&System, target).expect("new");
    for (name, text) in files {
        staging.write(name, |f| f.write_all(text.as_bytes())).expect("write");
    }
    staging.commit(&|_| true).expect("commit")
}

#[test]
fn a_staging_folder_appears_whole_or_not_at_all() {
    let top = Folder::new("staging");
    let target = top.path("wood");
    let mut staging = Staging::new(&System, &target).expect("new");
    staging.write("a", |f| f.write_all(b"1")).expect("write");
    assert!(!target.exists());
    drop(staging);
    assert!(names(&top.path("")).is_empty());
    for round in ["1", "2"] {
        assert!(put(&target, &[(REPORT, round)]));
        assert_eq!(names(&top.path("")), ["wood"]);
        assert_eq!(fs::read_to_string(target.join(REPORT)).expect("report"), round);
        fs::write(target.join("mine"), "x").expect("write");
    }
    assert_eq!(names(&target), ["mine", REPORT]);
}

#[test]
fn files_of_an_earlier_result_do_not_stay_beside_a_new_one() {
    let top = Folder::new("stale");
    let target = top.path("wood");
    let report = |files: &str| format!(r#"{{"files":[{files}],"of another version":1}}"#);
    let old = report(r#""albedo.png","height.png","report.json""#);
    put(&target, &[("albedo.png", "old"), ("height.png", "old"), (REPORT, &old)]);
    for name in ["relit.png", "side.png"] {
        fs::write(target.join(name), "old").expect("write");
    }
    put(&target, &[("albedo.png", "new"), (REPORT, &report(r#""albedo.png","report.json""#))]);
    assert_eq!(names(&target), ["albedo.png", REPORT, "side.png"]);
}

#[test]
fn what_may_not_be_replaced_stays() {
    let top = Folder::new("refused");
    let target = top.path("wood");
    put(&target, &[(REPORT, "theirs")]);
    let mut staging = Staging::new(&System, &target).expect("new");
    staging.write(REPORT, |f| f.write_all(b"ours")).expect("write");
    assert!(!staging.commit(&|_| false).expect("no trouble"));
    // Another process comes between the question and the exchange.
    let mut staging = Staging::new(&System, &target).expect("new");
    staging.write(REPORT, |f| f.write_all(b"ours")).expect("write");
    let asked = AtomicU32::new(0);
    assert!(!staging.commit(&|_| asked.fetch_add(1, Ordering::Relaxed) == 0).expect("no trouble"));
    assert_eq!(fs::read_to_string(target.join(REPORT)).expect("report"), "theirs");
    assert_eq!(names(&top.path("")), ["wood"]);
}

#[test]
fn writers_at_once_leave_one_whole_result() {
    let top = Folder::new("race");
    let target = top.path("wood");
    std::thread::scope(|scope| {
        for writer in 0..4 {
            let (target, top) = (&target, top.path(""));
            scope.spawn(move || {
                for round in 0..25 {
                    sweep(&System, &top);
                    let text = format!("{writer}-{round}");
                    let files: Vec<_> = FILES.iter().map(|name| (*name, text.as_str())).collect();
                    assert!(put(target, &files));
                }
            });
        }
    });
    assert_eq!(names(&top.path("")), ["wood"]);
    let texts: Vec<_> = FILES.iter().map(|name| fs::read_to_string(target.join(name)).expect(name)).collect();
    assert!(texts.iter().all(|text| *text == texts[0]), "{texts:?}");
}

#[test]
fn leftovers_of_dead_processes_go_and_all_else_stays() {
    let top = Folder::new("sweep");
    let make = |path: &str, text: &str| {
        let path = top.path(path);
        fs::create_dir_all(path.parent().expect("parent")).expect("folder");
        fs::write(path, text).expect("write");
    };
    // Killed while writing, before and after its lock was made; named by its process, as earlier versions did.
    make(".flashmat-1.part/lock", "");
    make(".flashmat-1.part/new/wood/albedo.png", "half");
    fs::create_dir_all(top.path(".flashmat-2.part")).expect("folder");
    make(".wood.1-0.part/albedo.png", "half");
    fs::create_dir_all(top.path(".wood.999999-12.part")).expect("folder");
    make(".relit.png.17-0.part", "half");
    // Others' things, and a run that is alive.
    make(".flashmat-3.part/mine", "");
    make(".film.17-0.part", "half a film");
    make(".film.18-0.part/film", "half a film");
    make(".flashmat/lock", "");
    make("wood/report.json", "");
    let alive = Staging::new(&System, &top.path("alive")).expect("new");
    sweep(&System, &top.path(""));
    let left = names(&top.path(""));
    assert_eq!(left.iter().filter(|n| n.len() > 40).count(), 1, "the living one: {left:?}");
    let others: Vec<_> = left.iter().filter(|n| n.len() <= 40).collect();
    assert_eq!(others, [".film.17-0.part", ".film.18-0.part", ".flashmat", ".flashmat-3.part", "wood"]);
    assert!(alive.commit(&|_| true).expect("commit"));
}

#[cfg(unix)]
#[test]
fn a_link_to_a_folder_stays_a_link() {
    let top = Folder::new("link");
    fs::create_dir(top.path("far")).expect("folder");
    std::os::unix::fs::symlink("far", top.path("wood")).expect("link");
    assert!(put(&top.path("wood"), &[(REPORT, "1")]) && put(&top.path("wood"), &[(REPORT, "2")]));
    assert!(fs::symlink_metadata(top.path("wood")).expect("link").is_symlink());
    assert_eq!(fs::read_to_string(top.path("far/report.json")).expect("report"), "2");
    assert_eq!(names(&top.path("")), ["far", "wood"]);
}

#[test]
fn a_failed_write_keeps_the_old_file_and_leaves_no_part() {
    let top = Folder::new("file");
    let path = top.path("t.csv");
    write_file(&path, |f| f.write_all(b"old")).expect("write");
    let full = |_: &mut dyn Write| Err(io::ErrorKind::StorageFull.into());
    let line = write_file(&path, full).expect_err("full").to_string();
    assert!(line.contains("t.csv: cannot be written: no storage space; free some space"), "{line}");
    assert_eq!(fs::read(&path).expect("old"), b"old");
    assert_eq!(names(&top.path("")), ["t.csv"]);
    assert!(write_file(&top.path(""), |_| Ok(())).is_err());
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_device_is_named() {
    let line = write_file(Path::new("/dev/full"), |f| f.write_all(&[0; 4096])).expect_err("full").to_string();
    assert!(line.contains("/dev/full: cannot be written: no space left"), "{line}");
    assert!(Path::new("/dev/full").exists());
}
