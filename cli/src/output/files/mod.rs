//! Files and folders that appear whole or not at all, also over what was there before, and also if the process is
//! killed or the disk fails at any moment.
//!
//! Everything is written to a work folder beside its place, flushed to the disk, and then put there by one rename, or
//! by one exchange of two folders where there is an older result. A work folder has a random name, so that no run,
//! process or container meets another's, and holds a lock for as long as its process lives. [`sweep`] removes those
//! of dead processes. Where the system cannot exchange folders, the old one is first renamed into the work folder; a
//! kill in between leaves it there, and the next run's sweep puts it back.
mod disk;
#[cfg(test)]
mod faults;
mod sweep;
#[cfg(test)]
mod tests;
mod work;

pub(crate) use disk::{Disk, System};
pub(crate) use sweep::sweep;

use super::owner;
use crate::failure::Failure;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use work::Work;

/// How often a folder that others change meanwhile is tried.
const ROUNDS: usize = 16;

/// A work folder that collects the files of a result; [`Staging::commit`] makes them appear. Dropped before that, it
/// leaves nothing.
pub(crate) struct Staging<'d> {
    disk: &'d dyn Disk,
    work: Work<'d>,
    target: PathBuf,
}

impl<'d> Staging<'d> {
    /// Starts a folder that will become `target`, whose parent exists. A link to a folder stays a link.
    pub(crate) fn new(disk: &'d dyn Disk, target: &Path) -> Result<Self, Failure> {
        let start = || {
            let linked = fs::symlink_metadata(target).is_ok_and(|m| m.is_symlink());
            let target = if linked { fs::canonicalize(target)? } else { target.to_owned() };
            let work = Work::new(disk, &target)?;
            disk.create_dir(&work.new_place())?;
            Ok(Self { disk, work, target })
        };
        start().map_err(|e| Failure::writing(target, &e))
    }

    /// Writes one file of the folder.
    pub(crate) fn write(
        &mut self,
        name: &str,
        body: impl FnOnce(&mut dyn Write) -> io::Result<()>,
    ) -> Result<(), Failure> {
        write_new(self.disk, &self.work.new_place().join(name), body)
            .map_err(|e| Failure::writing(&self.target.join(name), &e))
    }

    /// Makes the files appear, all at once. What is at the place already is replaced if `may_replace` says so of it:
    /// `false` if it does not, and nothing has changed then. Files there that no capture wrote stay.
    pub(crate) fn commit(mut self, may_replace: &dyn Fn(&Path) -> bool) -> Result<bool, Failure> {
        self.swap_in(may_replace).map_err(|e| Failure::writing(&self.target, &e))
    }

    fn swap_in(&mut self, may_replace: &dyn Fn(&Path) -> bool) -> io::Result<bool> {
        let new = self.work.new_place();
        self.disk.sync_dir(&new)?;
        for _ in 0..ROUNDS {
            match fs::symlink_metadata(&self.target) {
                Err(e) if e.kind() == io::ErrorKind::NotFound => {
                    match self.disk.rename(&new, &self.target) {
                        Ok(()) => return self.settle().map(|()| true),
                        // Another process was first.
                        Err(_) if fs::symlink_metadata(&self.target).is_ok() => {}
                        Err(e) => return Err(e),
                    }
                }
                Err(e) => return Err(e),
                Ok(there) if !there.is_dir() => return Err(io::ErrorKind::NotADirectory.into()),
                Ok(_) if !may_replace(&self.target) => return Ok(false),
                Ok(_) => {
                    if let Some(displaced) = self.replace(&new, may_replace)? {
                        // From here on the new result is in place. What cannot be carried over stays where it is.
                        let carried = carry(self.disk, &displaced, &self.target, Carry::All);
                        self.work.keep |= carried.is_err();
                        return carried.and_then(|()| self.settle()).map(|()| true);
                    }
                }
            }
        }
        Err(io::ErrorKind::ResourceBusy.into())
    }

    /// Puts the new folder in the place of the old one; where that is now, or `None` if it was gone or another's.
    fn replace(&mut self, new: &Path, may_replace: &dyn Fn(&Path) -> bool) -> io::Result<Option<PathBuf>> {
        sweep(self.disk, &self.target);
        // What links cannot carry, a rename does afterwards.
        carry(self.disk, &self.target, new, Carry::Link)?;
        match self.disk.exchange(new, &self.target) {
            Ok(()) if may_replace(new) => Ok(Some(new.to_owned())),
            // Another photo's result has come between: back with it.
            Ok(()) => self.disk.exchange(new, &self.target).map(|()| None),
            Err(e) if e.kind() == io::ErrorKind::Unsupported => self.replace_in_two_steps(new, may_replace),
            Err(_) if fs::symlink_metadata(&self.target).is_err() => Ok(None),
            Err(e) => Err(e),
        }
    }

    fn replace_in_two_steps(
        &mut self,
        new: &Path,
        may_replace: &dyn Fn(&Path) -> bool,
    ) -> io::Result<Option<PathBuf>> {
        let old = self.work.make_old_place()?;
        self.disk.rename(&self.target, &old)?;
        let put = if may_replace(&old) { self.disk.rename(new, &self.target).map(Some) } else { Ok(None) };
        if !matches!(put, Ok(Some(()))) {
            // The work folder is not removed while it holds the only copy.
            self.work.keep = self.disk.rename(&old, &self.target).is_err();
        }
        put.map(|done| done.map(|()| old))
    }

    fn settle(&self) -> io::Result<()> {
        self.disk.sync_dir(work::parent(&self.target))
    }
}

/// What of a folder goes over to another: what no capture wrote.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Carry {
    /// Files, which then are in both; failing that, nothing.
    Link,
    /// Everything; what has the same name there is replaced.
    All,
    /// What is not there yet.
    Missing,
}

fn carry(disk: &dyn Disk, from: &Path, to: &Path, how: Carry) -> io::Result<()> {
    let results = owner::result_files(from);
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        let name = entry.file_name();
        if results.contains(&name) {
            continue;
        }
        let (source, place) = (from.join(&name), to.join(&name));
        match how {
            Carry::Link if entry.file_type()?.is_dir() => {}
            Carry::Link => drop(disk.link(&source, &place)),
            Carry::Missing if fs::symlink_metadata(&place).is_ok() => {}
            Carry::Missing | Carry::All => disk.rename(&source, &place)?,
        }
    }
    Ok(())
}

/// Writes one file; what was at `path` stays until the new file is whole. Devices and pipes are written in place.
pub(crate) fn write_file(
    path: &Path,
    body: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), Failure> {
    write_file_on(&System, path, body)
}

fn write_file_on(
    disk: &dyn Disk,
    path: &Path,
    body: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), Failure> {
    // Through a link, its target is replaced, not the link.
    let place = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let fail = |e: io::Error| Failure::writing(path, &e);
    match fs::metadata(&place) {
        Ok(m) if m.is_dir() => return Err(fail(io::ErrorKind::IsADirectory.into())),
        Ok(m) if !m.is_file() => {
            let mut file = File::options().write(true).open(&place).map_err(fail)?;
            return body(&mut file).map_err(fail);
        }
        _ => {}
    }
    sweep(disk, work::parent(&place));
    let write = || {
        let work = Work::new(disk, &place)?;
        write_new(disk, &work.new_place(), body)?;
        disk.rename(&work.new_place(), &place)?;
        disk.sync_dir(work::parent(&place))
    };
    write().map_err(fail)
}

/// A new file, on the disk when this returns.
fn write_new(
    disk: &dyn Disk,
    path: &Path,
    body: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> io::Result<()> {
    let mut file = BufWriter::new(disk.create(path)?);
    body(&mut file)?;
    // Dropping the buffer would hide a full disk.
    file.flush()?;
    file.get_mut().sync()
}
