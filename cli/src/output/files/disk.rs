//! What the writing of results asks of the file system, as a trait: tests put one in its place that fails.
//!
//! Calls that the system broke off (`EINTR`) are made again, up to [`AGAIN`] times.
use std::fs::{self, File, TryLockError};
use std::io::{self, Write};
use std::path::Path;

/// How often a call that was interrupted is made again.
const AGAIN: usize = 16;

/// A new file that is being written.
pub(crate) trait Sink: Write {
    /// Returns when the contents are on the disk.
    fn sync(&mut self) -> io::Result<()>;
}

/// Everything that writing a result changes on disk; reading goes straight to the system.
pub(crate) trait Disk: Sync {
    /// Makes one folder.
    fn create_dir(&self, path: &Path) -> io::Result<()>;
    /// Makes a file that is not there yet.
    fn create(&self, path: &Path) -> io::Result<Box<dyn Sink + '_>>;
    /// Makes the file at `path` and locks it for as long as the value lives; `None` where the file system has no locks.
    fn lock(&self, path: &Path) -> io::Result<Option<File>>;
    /// Renames a file or folder; what is at `to` must be absent, a file for a file, or an empty folder.
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()>;
    /// Exchanges two folders in one step; `Unsupported` where the system or file system cannot.
    fn exchange(&self, one: &Path, other: &Path) -> io::Result<()>;
    /// Gives a file a second name.
    fn link(&self, from: &Path, to: &Path) -> io::Result<()>;
    /// Removes a file.
    fn remove_file(&self, path: &Path) -> io::Result<()>;
    /// Removes an empty folder.
    fn remove_dir(&self, path: &Path) -> io::Result<()>;
    /// Returns when the names in a folder are on the disk.
    fn sync_dir(&self, path: &Path) -> io::Result<()>;
}

/// The system's own file system.
pub(crate) struct System;

impl Disk for System {
    fn create_dir(&self, path: &Path) -> io::Result<()> {
        again(|| fs::create_dir(path))
    }

    fn create(&self, path: &Path) -> io::Result<Box<dyn Sink + '_>> {
        Ok(Box::new(again(|| File::create_new(path))?))
    }

    fn lock(&self, path: &Path) -> io::Result<Option<File>> {
        let file = again(|| File::create_new(path))?;
        match file.try_lock() {
            Ok(()) => Ok(Some(file)),
            // Whoever has it already is about to remove it.
            Err(TryLockError::WouldBlock) => Err(io::ErrorKind::NotFound.into()),
            Err(TryLockError::Error(_)) => Ok(None),
        }
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        again(|| fs::rename(from, to))
    }

    fn exchange(&self, one: &Path, other: &Path) -> io::Result<()> {
        again(|| exchange(one, other))
    }

    fn link(&self, from: &Path, to: &Path) -> io::Result<()> {
        again(|| fs::hard_link(from, to))
    }

    fn remove_file(&self, path: &Path) -> io::Result<()> {
        again(|| fs::remove_file(path))
    }

    fn remove_dir(&self, path: &Path) -> io::Result<()> {
        again(|| fs::remove_dir(path))
    }

    fn sync_dir(&self, path: &Path) -> io::Result<()> {
        // Elsewhere folders cannot be opened, and their names are written through.
        if cfg!(unix) { whole(again(|| File::open(path)?.sync_all())) } else { Ok(()) }
    }
}

impl Sink for File {
    fn sync(&mut self) -> io::Result<()> {
        whole(again(|| self.sync_all()))
    }
}

/// Makes a call again while it is broken off.
fn again<T>(mut call: impl FnMut() -> io::Result<T>) -> io::Result<T> {
    let mut left = AGAIN;
    loop {
        match call() {
            Err(e) if e.kind() == io::ErrorKind::Interrupted && left > 0 => left -= 1,
            result => return result,
        }
    }
}

/// File systems that know no sync are taken at their word.
fn whole(result: io::Result<()>) -> io::Result<()> {
    use io::ErrorKind::{InvalidInput, Unsupported};
    result.or_else(|e| if matches!(e.kind(), InvalidInput | Unsupported) { Ok(()) } else { Err(e) })
}

#[cfg(any(target_os = "linux", target_os = "android", target_vendor = "apple"))]
fn exchange(one: &Path, other: &Path) -> io::Result<()> {
    use rustix::fs::{CWD, RenameFlags, renameat_with};
    use rustix::io::Errno;
    renameat_with(CWD, one, CWD, other, RenameFlags::EXCHANGE).map_err(|e| match e {
        // A file system without it says any of these.
        Errno::INVAL | Errno::NOSYS | Errno::NOTSUP => io::ErrorKind::Unsupported.into(),
        e => e.into(),
    })
}

#[cfg(not(any(target_os = "linux", target_os = "android", target_vendor = "apple")))]
fn exchange(_one: &Path, _other: &Path) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}
