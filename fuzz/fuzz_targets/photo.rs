//! The program's photo readers: JPEG, PNG, TIFF, WebP, EXIF and colour profiles, as files. A photo or a sentence for the
//! user; never a panic, never memory without measure.
#![no_main]

use libfuzzer_sys::fuzz_target;
use std::fs::File;
use std::io::{Cursor, Seek, Write};
use std::os::fd::AsRawFd;
use std::path::PathBuf;
use std::sync::{LazyLock, Mutex};

/// Pixels that are decoded here; larger photos are honest, but slow.
const PIXELS: u64 = 1 << 19;

/// A file without a name, gone with the process, and the path by which it can be opened all the same.
static FILE: LazyLock<(Mutex<File>, PathBuf)> = LazyLock::new(|| {
    let path = std::env::temp_dir().join(format!("flashmat-fuzz-{}", std::process::id()));
    let file = File::create_new(&path).expect("a temporary file");
    std::fs::remove_file(&path).expect("just made");
    let door = PathBuf::from(format!("/proc/self/fd/{}", file.as_raw_fd()));
    (Mutex::new(file), door)
});

fuzz_target!(|data: &[u8]| {
    let reader =
        image::ImageReader::new(Cursor::new(data)).with_guessed_format().expect("memory can be read");
    if reader.into_dimensions().is_ok_and(|(w, h)| u64::from(w) * u64::from(h) > PIXELS) {
        return;
    }
    let (file, path) = &*FILE;
    {
        let mut file = file.lock().expect("one thread");
        file.set_len(0).expect("cut");
        file.rewind().expect("to the start");
        file.write_all(data).expect("written");
    }
    if let Err(told) = flashmat_cli::fuzzing::read_photo(path) {
        assert!(!told.contains('\n') && told.contains("; "), "no line with advice: {told}");
    }
});
