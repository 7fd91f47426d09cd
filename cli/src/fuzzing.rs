//! Doors for the fuzzers of `fuzz/`, which cannot reach private modules. No interface: they change with the program.
use crate::photo::{self, Pixels};
use std::path::Path;

/// Reads the photo file at `path` and checks what the rest of the program takes for granted.
///
/// `Err` holds what the user would be told.
///
/// # Errors
/// As the program: the file is no photo, or a broken one.
pub fn read_photo(path: &Path) -> Result<(), String> {
    let photo = photo::read(path).map_err(|failure| failure.to_string())?;
    let (width, height) = (photo.width as usize, photo.height as usize);
    assert!(photo.width.min(photo.height) >= photo::MIN_SIDE, "{width} x {height} is below the least size");
    let values = match &photo.pixels {
        Pixels::Rgb8(pixels) => pixels.len(),
        Pixels::Rgb16(pixels) => pixels.len(),
        Pixels::RgbF32(pixels) => pixels.len(),
    };
    assert_eq!(values, 3 * width * height, "{width} x {height} pixels");
    if let Some(mm) = photo.focal_35mm {
        assert!(flashmat_core::frame::FOCAL_35MM.contains(&mm), "focal length {mm}");
    }
    Ok(())
}
