//! Planes: `size` x `size` values of f32, row-major, top row first; the planes of a map one after the other.
use crate::Error;

/// Largest side of a map or a prepared photo, in pixels.
pub const MAX_SIZE: usize = 8192;

/// Checks that `planes` planes of `size` x `size` make up a slice of `given` values.
///
/// # Errors
/// [`Error::PlaneLength`] when they do not, [`Error::Size`] when `size` is 0 or too large.
pub fn check_planes(size: usize, planes: usize, given: usize) -> Result<(), Error> {
    if size == 0 || size > MAX_SIZE {
        return Err(Error::Size { size });
    }
    let needed = planes.saturating_mul(size * size);
    if given == needed { Ok(()) } else { Err(Error::PlaneLength { needed, given }) }
}

/// Row `row` of a plane of rows of `size` values; empty when it is outside.
#[must_use]
pub fn plane_row(plane: &[f32], size: usize, row: usize) -> &[f32] {
    let start = row.saturating_mul(size);
    plane.get(start..start.saturating_add(size)).unwrap_or(&[])
}
