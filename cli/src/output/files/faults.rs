//! Every call that changes the disk fails in turn, or is the last before the process is killed: afterwards there is
//! the old result or the new one, whole, what no capture wrote is still there, and a further run completes.
use super::disk::Sink;
use super::tests::{Folder, names};
use super::{Disk, Staging, System, sweep, write_file_on};
use crate::failure::Failure;
use crate::output::owner::REPORT;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// What happens at the chosen call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fault {
    /// It fails with this error of the system.
    Errno(i32),
    /// A write takes a single byte; other calls do what they should.
    Short,
    /// The process is gone before it.
    KillBefore,
    /// The process is gone after it, or in the middle if it is a write.
    KillAfter,
}

const ENOSPC: i32 = 28;
const EIO: i32 = 5;
const EACCES: i32 = 13;
const EINTR: i32 = 4;

const FAULTS: [Fault; 7] = [
    Fault::Errno(ENOSPC),
    Fault::Errno(EIO),
    Fault::Errno(EACCES),
    Fault::Errno(EINTR),
    Fault::Short,
    Fault::KillBefore,
    Fault::KillAfter,
];

/// What a file system can do.
#[derive(Clone, Copy, Debug)]
struct Abilities {
    exchange: bool,
    links: bool,
}

/// The system's disk with one fault.
struct Faulty {
    at: usize,
    fault: Fault,
    can: Abilities,
    calls: AtomicUsize,
    dead: AtomicBool,
}

impl Faulty {
    fn new(at: usize, fault: Fault, can: Abilities) -> Self {
        Self { at, fault, can, calls: AtomicUsize::new(0), dead: AtomicBool::new(false) }
    }

    /// A disk without a fault.
    fn sound() -> Self {
        Self::new(usize::MAX, Fault::Short, EVERYTHING)
    }

    fn killed(&self) -> bool {
        self.dead.load(Ordering::Relaxed)
    }

    /// Whether the fault was met.
    fn met(&self) -> bool {
        self.calls.load(Ordering::Relaxed) > self.at
    }

    fn call<T>(&self, real: impl FnOnce() -> io::Result<T>) -> io::Result<T> {
        if self.killed() {
            return Err(io::Error::other("killed"));
        }
        if self.calls.fetch_add(1, Ordering::Relaxed) != self.at {
            return real();
        }
        match self.fault {
            Fault::Errno(number) => return Err(io::Error::from_raw_os_error(number)),
            Fault::Short => return real(),
            Fault::KillBefore => {}
            Fault::KillAfter => drop(real()),
        }
        self.dead.store(true, Ordering::Relaxed);
        Err(io::Error::other("killed"))
    }
}

struct FaultySink<'d>(&'d Faulty, Box<dyn Sink + 'd>);

impl Write for FaultySink<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let some = if self.0.fault == Fault::Short { 1 } else { bytes.len() / 2 };
        let here = self.0.calls.load(Ordering::Relaxed) == self.0.at;
        let part = if here { &bytes[..some.min(bytes.len())] } else { bytes };
        self.0.call(|| self.1.write(part))
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Sink for FaultySink<'_> {
    fn sync(&mut self) -> io::Result<()> {
        // Nothing here outlives the computer: the disk itself is spared.
        self.0.call(|| Ok(()))
    }
}

impl Disk for Faulty {
    fn create_dir(&self, path: &Path) -> io::Result<()> {
        self.call(|| System.create_dir(path))
    }

    fn create(&self, path: &Path) -> io::Result<Box<dyn Sink + '_>> {
        Ok(Box::new(FaultySink(self, self.call(|| System.create(path))?)))
    }

    fn lock(&self, path: &Path) -> io::Result<Option<File>> {
        self.call(|| System.lock(path))
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.call(|| System.rename(from, to))
    }

    fn exchange(&self, one: &Path, other: &Path) -> io::Result<()> {
        let unsupported = || Err(io::ErrorKind::Unsupported.into());
        self.call(|| if self.can.exchange { System.exchange(one, other) } else { unsupported() })
    }

    fn link(&self, from: &Path, to: &Path) -> io::Result<()> {
        let unsupported = || Err(io::ErrorKind::Unsupported.into());
        self.call(|| if self.can.links { System.link(from, to) } else { unsupported() })
    }

    fn remove_file(&self, path: &Path) -> io::Result<()> {
        self.call(|| System.remove_file(path))
    }

    fn remove_dir(&self, path: &Path) -> io::Result<()> {
        self.call(|| System.remove_dir(path))
    }

    fn sync_dir(&self, path: &Path) -> io::Result<()> {
        self.call(|| path.metadata().map(drop))
    }
}

/// What there is before the run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Before {
    Nothing,
    /// Files that no capture wrote.
    Notes,
    /// These, and an older result.
    Old,
    /// The same, and a run that was killed while it replaced the result.
    OldAndWreck,
}

/// The files of a result: as many as can tell a mix.
const FILES: [&str; 2] = ["albedo.png", REPORT];

const EVERYTHING: Abilities = Abilities { exchange: true, links: true };

/// Writes a whole result as a capture does.
fn put(disk: &dyn Disk, target: &Path, version: &str) -> Result<bool, Failure> {
    sweep(disk, target.parent().expect("parent"));
    let mut staging = Staging::new(disk, target)?;
    for name in FILES {
        staging.write(name, |f| f.write_all(version.as_bytes()))?;
    }
    staging.commit(&|_| true)
}

/// The version of which all files are there; `None` if none is.
fn version(target: &Path, context: &str) -> Option<String> {
    let files: Vec<_> = FILES.iter().map(|name| fs::read_to_string(target.join(name)).ok()).collect();
    assert!(files.iter().all(|f| *f == files[0]), "a mix: {files:?}: {context}");
    files[0].clone()
}

fn prepare(target: &Path, before: Before) {
    if before == Before::Nothing {
        return;
    }
    fs::create_dir_all(target.join("sub")).expect("folder");
    fs::write(target.join("notes"), "mine").expect("notes");
    fs::write(target.join("sub/deep"), "mine too").expect("deep");
    if before == Before::Notes {
        return;
    }
    put(&Faulty::sound(), target, "old").expect("old");
    fs::write(target.join("relit.png"), "old").expect("relit");
    if before == Before::OldAndWreck {
        // Killed between the two renames of a system that cannot exchange: the old result is in the work folder.
        let work = target.with_file_name(".flashmat-0.part");
        fs::create_dir_all(work.join("old")).expect("work folder");
        fs::write(work.join("lock"), "").expect("lock");
        fs::rename(target, work.join("old/wood")).expect("aside");
    }
}

/// One fault at one call; `false` when the run has fewer calls.
fn one_fault(top: &Path, before: Before, fault: Fault, at: usize, can: Abilities) -> bool {
    let _ = fs::remove_dir_all(top);
    fs::create_dir_all(top).expect("folder");
    let target = top.join("wood");
    prepare(&target, before);
    let context = format!("{before:?}, {fault:?} at call {at}, {can:?}");
    let disk = Faulty::new(at, fault, can);
    let done = put(&disk, &target, "new");
    if !disk.met() {
        done.expect("no fault");
        return false;
    }
    if fault == Fault::Short {
        assert_eq!(done.as_ref().ok(), Some(&true), "{context}");
    }
    // At this moment, before anything is cleared up.
    let now = version(&target, &context);
    let hidden: Vec<_> = names(top).into_iter().filter(|n| n != "wood").collect();
    if can.exchange && before == Before::Old {
        assert!(matches!(now.as_deref(), Some("old" | "new")), "{now:?}: {context}");
        if can.links {
            assert!(target.join("notes").exists(), "{context}");
        }
    }
    if done.is_ok() {
        assert_eq!(now.as_deref(), Some("new"), "{context}");
        assert!(!target.join("relit.png").exists(), "{context}");
    }
    // The next run's sweep.
    sweep(&System, top);
    let swept = version(&target, &context);
    let had_old = matches!(before, Before::Old | Before::OldAndWreck);
    let whole = if had_old { ["old", "new"].map(Some) } else { [None, Some("new")] };
    assert!(whole.contains(&swept.as_deref()), "{swept:?}: {context}");
    if before != Before::Nothing {
        let read = |name: &str| fs::read_to_string(target.join(name)).ok();
        assert_eq!(read("notes").as_deref(), Some("mine"), "{context}");
        assert_eq!(read("sub/deep").as_deref(), Some("mine too"), "{context}");
    }
    assert!(names(top).iter().all(|n| n == "wood"), "{:?}, before: {hidden:?}: {context}", names(top));
    assert_eq!(put(&Faulty::sound(), &target, "newer").ok(), Some(true), "{context}");
    assert_eq!(version(&target, &context).as_deref(), Some("newer"), "{context}");
    true
}

#[test]
fn whatever_fails_or_whenever_it_is_killed_a_result_is_whole() {
    let folder = Folder::new("faults");
    let top = folder.path("out");
    let mut counts = [0; FAULTS.len()];
    // All errors end alike and all file systems work alike, but for this: the rest is for those who ask.
    let all = std::env::var_os("FLASHMAT_FAULTS").is_some();
    let some = |fault: &Fault| all || !matches!(fault, Fault::Errno(ENOSPC | EACCES));
    for before in [Before::Nothing, Before::Notes, Before::Old, Before::OldAndWreck] {
        for (exchange, links) in [(true, true), (true, false), (false, true), (false, false)] {
            let can = Abilities { exchange, links };
            if exchange != links && !all {
                continue;
            }
            for (count, fault) in counts.iter_mut().zip(FAULTS).filter(|(_, fault)| some(fault)) {
                *count += (0..).take_while(|&at| one_fault(&top, before, fault, at, can)).count();
            }
        }
    }
    println!("faults injected: {:?}", FAULTS.iter().zip(counts).collect::<Vec<_>>());
    assert!(counts.iter().zip(&FAULTS).all(|(&count, fault)| count > 100 || !some(fault)), "{counts:?}");
}

#[test]
fn a_file_is_the_old_one_or_the_new_one() {
    let folder = Folder::new("file-faults");
    let top = folder.path("out");
    let one = |fault: Fault, at: usize| {
        let _ = fs::remove_dir_all(&top);
        fs::create_dir_all(&top).expect("folder");
        let path: PathBuf = top.join("table.csv");
        fs::write(&path, "old").expect("old");
        let disk = Faulty::new(at, fault, EVERYTHING);
        let done = write_file_on(&disk, &path, |f| f.write_all(b"new"));
        let now = fs::read_to_string(&path).expect("a file");
        assert!(now == "new" || now == "old" && done.is_err(), "{now}: {fault:?} at {at}");
        let line = done.err().map(|e| e.to_string()).unwrap_or_default();
        assert!(line.is_empty() || line.contains("table.csv: cannot be written"), "{line}");
        write_file_on(&Faulty::sound(), &path, |f| f.write_all(b"newer")).expect("again");
        assert_eq!(
            (names(&top), fs::read_to_string(&path).expect("file")),
            (vec!["table.csv".to_owned()], "newer".to_owned())
        );
        disk.met()
    };
    for fault in FAULTS {
        assert!((0..).take_while(|&at| one(fault, at)).count() > 5);
    }
}
