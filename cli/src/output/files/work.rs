//! Work folders: `.flashmat-RANDOM.part`, with a lock, what is new (`new/NAME`) and, for a moment, what was there
//! before (`old/NAME`).
use super::disk::Disk;
use std::ffi::OsString;
use std::fs::{self, File};
use std::hash::{BuildHasher, RandomState};
use std::io;
use std::path::{Path, PathBuf};

pub(super) const PREFIX: &str = ".flashmat-";
pub(super) const SUFFIX: &str = ".part";
pub(super) const LOCK: &str = "lock";
pub(super) const NEW: &str = "new";
pub(super) const OLD: &str = "old";

/// How many names are tried; one that is taken is next to impossible.
const NAMES: usize = 8;

/// A work folder, removed with the value.
pub(super) struct Work<'d> {
    disk: &'d dyn Disk,
    folder: PathBuf,
    /// Of what is being made.
    name: OsString,
    /// Held while the process is at work; none on file systems without locks.
    lock: Option<File>,
    /// The folder holds something that must not be lost: it is left to the next sweep.
    pub(super) keep: bool,
}

impl<'d> Work<'d> {
    /// A folder beside `target`, on the same file system.
    pub(super) fn new(disk: &'d dyn Disk, target: &Path) -> io::Result<Self> {
        let name = target.file_name().ok_or(io::ErrorKind::InvalidInput)?.to_owned();
        for _ in 0..NAMES {
            let folder = parent(target).join(random_name());
            match disk.create_dir(&folder) {
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => continue,
                made => made?,
            }
            let mut work = Self { disk, folder, name: name.clone(), lock: None, keep: false };
            let lock = work.folder.join(LOCK);
            match disk.lock(&lock) {
                // A sweep that saw the folder before its lock has removed it, or is about to.
                Err(e) if e.kind() == io::ErrorKind::NotFound => continue,
                Ok(_) if !lock.exists() => continue,
                locked => work.lock = locked?,
            }
            disk.create_dir(&work.folder.join(NEW))?;
            return Ok(work);
        }
        Err(io::ErrorKind::AlreadyExists.into())
    }

    /// Where the new file or folder is made.
    pub(super) fn new_place(&self) -> PathBuf {
        self.folder.join(NEW).join(&self.name)
    }

    /// Where the old folder may be put for a moment.
    pub(super) fn make_old_place(&self) -> io::Result<PathBuf> {
        let old = self.folder.join(OLD);
        match self.disk.create_dir(&old) {
            Err(e) if e.kind() != io::ErrorKind::AlreadyExists => return Err(e),
            _ => {}
        }
        Ok(old.join(&self.name))
    }
}

impl Drop for Work<'_> {
    fn drop(&mut self) {
        if !self.keep {
            // What fails here is left to the next sweep.
            let _ = remove(self.disk, &self.folder, &mut self.lock);
        }
    }
}

/// Removes a work folder: the lock, given back by then, goes last, so that what is left of a broken-off removal can
/// be told from a folder that has just been made.
pub(super) fn remove(disk: &dyn Disk, folder: &Path, lock: &mut Option<File>) -> io::Result<()> {
    for part in [NEW, OLD] {
        remove_tree(disk, &folder.join(part))?;
    }
    *lock = None;
    remove_tree(disk, &folder.join(LOCK))?;
    disk.remove_dir(folder)
}

/// Removes a file, or a folder and all in it; links are removed, not followed. Nothing there is fine.
pub(super) fn remove_tree(disk: &dyn Disk, path: &Path) -> io::Result<()> {
    match fs::symlink_metadata(path) {
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(()),
        Err(e) => return Err(e),
        Ok(m) if !m.is_dir() => return disk.remove_file(path),
        Ok(_) => {}
    }
    for entry in fs::read_dir(path)? {
        remove_tree(disk, &entry?.path())?;
    }
    disk.remove_dir(path)
}

/// The folder that `path` is in.
pub(super) fn parent(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// 128 bits that the system drew.
fn random_name() -> String {
    let draw = || RandomState::new().hash_one(std::process::id());
    format!("{PREFIX}{:016x}{:016x}{SUFFIX}", draw(), draw())
}
