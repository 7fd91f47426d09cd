//! Removing what dead processes have left.
use super::disk::Disk;
use super::work::{self, LOCK, NEW, OLD, PREFIX, SUFFIX};
use super::{Carry, carry};
use crate::output::owner;
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::Path;
use std::time::Duration;

/// Where the file system has no locks, work folders older than this are dead.
const AGE: Duration = Duration::from_secs(24 * 3600);

/// Removes the work folders in `folder` whose processes are gone; an old result that one of them was replacing goes
/// back to its place first. What cannot be removed stays for the next time.
pub(crate) fn sweep(disk: &dyn Disk, folder: &Path) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let (Some(name), Ok(kind)) = (name.to_str(), entry.file_type()) else { continue };
        // Of others' folders in a shared place nothing is moved or removed.
        if !name.starts_with('.') || !name.ends_with(SUFFIX) || !is_own(&entry.path()) {
            continue;
        }
        if kind.is_dir() && name.starts_with(PREFIX) {
            let _ = clear(disk, folder, &entry.path());
        } else if let Some(named) = named_by_process(name) {
            let _ = clear_named_by_process(disk, &entry.path(), named, kind.is_dir());
        }
    }
}

#[cfg(unix)]
fn is_own(path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    fs::symlink_metadata(path).is_ok_and(|m| m.uid() == rustix::process::geteuid().as_raw())
}

#[cfg(not(unix))]
fn is_own(_path: &Path) -> bool {
    true
}

fn clear(disk: &dyn Disk, folder: &Path, work: &Path) -> io::Result<()> {
    let lock = match File::options().read(true).write(true).open(work.join(LOCK)) {
        // Being made or being removed: only an empty folder goes.
        Err(e) if e.kind() == io::ErrorKind::NotFound => return disk.remove_dir(work),
        lock => lock?,
    };
    match lock.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => return Ok(()),
        Err(TryLockError::Error(_)) => {
            if lock.metadata()?.modified()?.elapsed().unwrap_or_default() < AGE {
                return Ok(());
            }
        }
    }
    for part in [OLD, NEW] {
        let Ok(entries) = fs::read_dir(work.join(part)) else { continue };
        for entry in entries {
            let entry = entry?;
            let place = folder.join(entry.file_name());
            if !entry.file_type()?.is_dir() {
                continue;
            }
            // Files that no capture wrote and that were on their way from the old folder to the new one go on.
            if fs::symlink_metadata(&place).is_ok_and(|m| m.is_dir()) {
                carry(disk, &entry.path(), &place, Carry::Missing)?;
            } else if part == OLD {
                disk.rename(&entry.path(), &place)?;
            }
        }
    }
    work::remove(disk, work, &mut Some(lock))
}

/// The target's name in a name of the kind `.NAME.PROCESS-COUNT.part`, which this program gave before it locked its
/// work folders.
fn named_by_process(name: &str) -> Option<&str> {
    let (named, numbers) = name.strip_prefix('.')?.strip_suffix(SUFFIX)?.rsplit_once('.')?;
    let (process, count) = numbers.split_once('-')?;
    let number = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    (number(process) && number(count)).then_some(named)
}

/// Removes such a one if it holds nothing but what this program writes.
fn clear_named_by_process(disk: &dyn Disk, path: &Path, named: &str, is_dir: bool) -> io::Result<()> {
    if !is_dir {
        return if owner::is_result_file(named) { disk.remove_file(path) } else { Ok(()) };
    }
    for entry in fs::read_dir(path)? {
        let entry = entry?;
        let ours = entry.file_name().to_str().is_some_and(owner::is_result_file);
        if !ours || !entry.file_type()?.is_file() {
            return Ok(());
        }
    }
    work::remove_tree(disk, path)
}
