//! Files that appear whole or not at all: written beside their place, then renamed.
use crate::failure::Failure;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

/// A hidden folder beside `target` that collects its files; [`Staging::commit`] makes them appear. Dropped before
/// that, it leaves nothing.
pub(crate) struct Staging {
    folder: PathBuf,
    target: PathBuf,
    names: Vec<String>,
}

impl Staging {
    /// Starts a folder that will become `target`, whose parent exists.
    pub(crate) fn new(target: &Path) -> Result<Self, Failure> {
        let folder = beside(target);
        fs::create_dir(&folder).map_err(|e| Failure::writing(target, &e))?;
        Ok(Self { folder, target: target.to_owned(), names: Vec::new() })
    }

    /// Writes one file of the folder.
    pub(crate) fn write(
        &mut self,
        name: &str,
        body: impl FnOnce(&mut dyn Write) -> io::Result<()>,
    ) -> Result<(), Failure> {
        write_new(&self.folder.join(name), body)
            .map_err(|e| Failure::writing(&self.target.join(name), &e))?;
        self.names.push(name.to_owned());
        Ok(())
    }

    /// Makes the files appear: the whole folder at once, or, where `target` exists already, file by file in the order
    /// in which they were written. Other files there are left alone.
    pub(crate) fn commit(self) -> Result<(), Failure> {
        if fs::rename(&self.folder, &self.target).is_ok() {
            return Ok(());
        }
        fs::create_dir_all(&self.target).map_err(|e| Failure::writing(&self.target, &e))?;
        for name in &self.names {
            let place = self.target.join(name);
            fs::rename(self.folder.join(name), &place).map_err(|e| Failure::writing(&place, &e))?;
        }
        Ok(())
    }
}

impl Drop for Staging {
    fn drop(&mut self) {
        // After a rename of the whole folder there is nothing here; what else can fail cannot be helped.
        let _ = fs::remove_dir_all(&self.folder);
    }
}

/// Writes one file; what was at `path` stays until the new file is whole. Devices and pipes are written in place.
pub(crate) fn write_file(
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
    let new = beside(&place);
    let written = write_new(&new, body).and_then(|()| fs::rename(&new, &place));
    written.map_err(|e| {
        let _ = fs::remove_file(&new);
        fail(e)
    })
}

fn write_new(path: &Path, body: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let mut file = BufWriter::new(File::create_new(path)?);
    body(&mut file)?;
    // Dropping the buffer would hide a full disk.
    file.flush()
}

/// A hidden name beside `path` that no other run and no other thread uses.
fn beside(path: &Path) -> PathBuf {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let count = COUNT.fetch_add(1, Ordering::Relaxed);
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!(".{name}.{}-{count}.part", std::process::id()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(name: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("flashmat-files-{}-{name}", std::process::id()));
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).expect("temporary folder");
        folder
    }

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).expect("folder");
        let mut names: Vec<_> =
            entries.map(|e| e.expect("entry").file_name().display().to_string()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_staging_folder_appears_whole_or_not_at_all() {
        let top = folder("staging");
        let target = top.join("wood");
        let mut staging = Staging::new(&target).expect("new");
        staging.write("a", |f| f.write_all(b"1")).expect("write");
        assert!(!target.exists());
        drop(staging);
        assert!(names(&top).is_empty());

        for round in [b"1", b"2"] {
            let mut staging = Staging::new(&target).expect("new");
            staging.write("a", |f| f.write_all(round)).expect("write");
            staging.commit().expect("commit");
            assert_eq!(names(&top), ["wood"]);
            assert_eq!(fs::read(target.join("a")).expect("a"), round);
            fs::write(target.join("mine"), b"x").expect("write");
        }
        assert_eq!(names(&target), ["a", "mine"]);
        fs::remove_dir_all(top).expect("clean");
    }

    #[test]
    fn a_failed_write_keeps_the_old_file_and_leaves_no_part() {
        let top = folder("file");
        let path = top.join("t.csv");
        write_file(&path, |f| f.write_all(b"old")).expect("write");
        let full = |_: &mut dyn Write| Err(io::ErrorKind::StorageFull.into());
        let line = write_file(&path, full).expect_err("full").to_string();
        assert!(line.contains("t.csv: cannot be written: no storage space; free some space"), "{line}");
        assert_eq!(fs::read(&path).expect("old"), b"old");
        assert_eq!(names(&top), ["t.csv"]);
        assert!(write_file(&top, |_| Ok(())).is_err());
        fs::remove_dir_all(top).expect("clean");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_device_is_named() {
        let line =
            write_file(Path::new("/dev/full"), |f| f.write_all(&[0; 4096])).expect_err("full").to_string();
        assert!(line.contains("/dev/full: cannot be written: no space left"), "{line}");
        assert!(Path::new("/dev/full").exists());
    }
}
