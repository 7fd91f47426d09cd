//! What a capture gives, as `com.flashmat.MaterialMaps` holds it: 14 planes of f32 in one direct buffer, numbers in a
//! `float[]`; and pictures of them for bitmaps.
use crate::Failure;
use flashmat_core::capture::Capture;
use flashmat_core::maps::{Coding, Maps, encode_row};
use flashmat_core::net::Class;

/// Planes: albedo 3, normal 3, roughness 1, re-render 3, photo 3, observability 1.
pub(crate) const PLANES: usize = 14;
/// Numbers: 8 probabilities, class, F0, light scale, residual, field of view, 3 x iterations, 3 x solver residual, room
/// light, 3 x the flash's place, 3 x share of overexposed pixels, brightness of the others, 1 if overexposed, 1 if dark.
pub(crate) const NUMBERS: usize = 29;

/// Bytes of the maps' buffer, in 64 bits: `size` comes from Java.
fn needed(size: usize) -> u64 {
    (size as u64).saturating_mul(size as u64).saturating_mul(PLANES as u64 * 4)
}

/// The planes' values in a buffer that is large enough and aligned.
fn check(bytes: usize, size: usize) -> Result<usize, Failure> {
    let needed = needed(size);
    if (bytes as u64) < needed {
        return Err(Failure::Argument(format!(
            "maps of size {size} take {needed} bytes, the buffer has {bytes}"
        )));
    }
    // It fits the buffer, so it fits usize.
    usize::try_from(needed).map_err(|_| Failure::Argument(format!("size {size} is too large")))
}

fn unaligned() -> Failure {
    Failure::Argument("the maps' buffer must begin at a multiple of 4 in memory".to_owned())
}

/// A maps' buffer for writing.
pub(crate) fn planes_mut(bytes: &mut [u8], size: usize) -> Result<&mut [f32], Failure> {
    let needed = check(bytes.len(), size)?;
    bytemuck::try_cast_slice_mut(&mut bytes[..needed]).map_err(|_| unaligned())
}

/// A maps' buffer for reading.
fn planes(bytes: &[u8], size: usize) -> Result<&[f32], Failure> {
    let needed = check(bytes.len(), size)?;
    bytemuck::try_cast_slice(&bytes[..needed]).map_err(|_| unaligned())
}

/// Copies a capture's planes; `out` is what [`planes_mut`] gave for the capture's size.
pub(crate) fn write(capture: &Capture<'_>, out: &mut [f32]) {
    let maps = &capture.maps;
    let parts =
        [maps.albedo, maps.normal, maps.roughness, capture.render, capture.photo.rgb, capture.observability];
    let mut rest = out;
    for part in parts {
        let (head, tail) = rest.split_at_mut(part.len().min(rest.len()));
        head.iter_mut().zip(part).for_each(|(to, &from)| *to = from);
        rest = tail;
    }
}

/// A capture's numbers.
pub(crate) fn numbers(capture: &Capture<'_>) -> [f32; NUMBERS] {
    let class = Class::ALL.iter().position(|&class| class == capture.class).unwrap_or_default();
    let scalars = [class as f32, capture.f0, capture.light_scale, capture.residual, capture.photo.fov_deg];
    let iterations = capture.solver.map(|report| report.iterations as f32);
    let residuals = capture.solver.map(|report| report.residual);
    let exposure = &capture.photo.exposure;
    let flag = |set| if set { 1.0 } else { 0.0 };
    let mut numbers = [0.0; NUMBERS];
    let all = capture
        .probabilities
        .0
        .into_iter()
        .chain(scalars)
        .chain(iterations)
        .chain(residuals)
        .chain([capture.room_light])
        .chain(capture.photo.flash.to_array())
        .chain(exposure.clipped)
        .chain([exposure.brightness, flag(exposure.is_overexposed()), flag(exposure.is_dark())]);
    numbers.iter_mut().zip(all).for_each(|(number, value)| *number = value);
    numbers
}

/// `count` planes of a maps' buffer from the plane `first` on.
fn group(planes: &[f32], size: usize, first: usize, count: usize) -> &[f32] {
    let plane = size * size;
    planes.get(first * plane..(first + count) * plane).unwrap_or(&[])
}

/// Albedo, normal and roughness of a maps' buffer.
pub(crate) fn view(maps: &[u8], size: usize) -> Result<Maps<'_>, Failure> {
    let planes = planes(maps, size)?;
    let group = |first, count| group(planes, size, first, count);
    Ok(Maps { size, albedo: group(0, 3), normal: group(3, 3), roughness: group(6, 1) })
}

/// Ordinals of `Picture.java`.
const PICTURES: usize = 5;

/// A picture of the maps, RGBA8, opaque: albedo, re-render and photo sRGB-encoded, normals as (n + 1) / 2, roughness
/// as linear grey.
pub(crate) fn picture(maps: &[u8], size: usize, picture: usize, rgba: &mut [u8]) -> Result<(), Failure> {
    if size == 0 || picture >= PICTURES {
        return Err(Failure::Argument(format!("no picture has the number {picture} and the size {size}")));
    }
    let row_bytes = 4 * size;
    let (view, planes) = (view(maps, size)?, planes(maps, size)?);
    let wanted = 4 * size as u64 * size as u64;
    if (rgba.len() as u64) < wanted {
        return Err(Failure::Argument(format!(
            "a picture of size {size} takes {wanted} bytes, the buffer has {}",
            rgba.len()
        )));
    }
    let mut rgb = vec![0_u8; 3 * size];
    let mut grey = vec![0_u8; size];
    for (row, line) in rgba.chunks_exact_mut(row_bytes).take(size).enumerate() {
        match picture {
            0 => view.albedo_row(row, &mut rgb)?,
            1 => view.normal_row(row, &mut rgb)?,
            2 => {
                view.roughness_row(row, &mut grey)?;
                rgb.chunks_exact_mut(3).zip(&grey).for_each(|(pixel, &value)| pixel.fill(value));
            }
            3 => encode_row(group(planes, size, 7, 3), size, row, Coding::Srgb, &mut rgb)?,
            _ => encode_row(group(planes, size, 10, 3), size, row, Coding::Srgb, &mut rgb)?,
        }
        for (pixel, colour) in line.chunks_exact_mut(4).zip(rgb.chunks_exact(3)) {
            pixel.iter_mut().zip(colour.iter().chain(&[u8::MAX])).for_each(|(to, &from)| *to = from);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Java looks at previews without a capture, by the same limits.
    #[test]
    fn java_calls_overexposed_what_the_core_does() {
        use flashmat_core::frame::{CLIPPED_BYTE, OVEREXPOSED};
        let java = include_str!("../../flashmat/src/main/java/com/flashmat/Exposure.java");
        for line in [
            format!("private static final int CLIPPED = {CLIPPED_BYTE};"),
            format!("public static final float OVEREXPOSED = {OVEREXPOSED}f;"),
        ] {
            assert!(java.contains(&line), "{line}");
        }
        let bridge = include_str!("../../flashmat/src/main/java/com/flashmat/NativeBridge.java");
        assert!(bridge.contains(&format!("static final int NUMBERS = {NUMBERS};")));
        assert!(bridge.contains(&format!("static final int ABI = {};", crate::ABI)));
    }

    #[test]
    fn sizes_are_checked_in_64_bits() {
        assert_eq!(needed(128), 128 * 128 * 56);
        assert!(check(usize::MAX, usize::MAX).is_err() || usize::BITS == 64);
        assert!(check(917_503, 128).is_err());
        assert_eq!(check(917_504, 128).expect("fits"), 917_504);
        // 65536² * 56 wraps to 0 in 32 bits and must not pass there.
        assert!(check(4096, 65_536).is_err());
        assert!(check(4096, 1 << 31).is_err());
    }

    #[test]
    fn pictures_are_encoded_by_hand_worked_codes() {
        // 1 x 1: albedo 0, 0.21404 (0.5 encoded), 1; normal +z; roughness 0.25; the rest 1.
        let values = [0.0, 0.214_041_14, 1.0, 0.0, 0.0, 1.0, 0.25, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0_f32];
        let maps: &[u8] = bytemuck::cast_slice(&values);
        let expected =
            [[0, 128, 255, 255], [128, 128, 255, 255], [64, 64, 64, 255], [255; 4], [0, 0, 0, 255]];
        for (number, expected) in expected.into_iter().enumerate() {
            let mut rgba = [7_u8; 4];
            picture(maps, 1, number, &mut rgba).expect("picture");
            assert_eq!(rgba, expected, "picture {number}");
        }
        assert!(picture(maps, 1, 5, &mut [0; 4]).is_err());
        assert!(picture(maps, 1, 0, &mut [0; 3]).is_err());
        assert!(picture(maps, 2, 0, &mut [0; 16]).is_err());
        assert!(picture(maps, 0, 0, &mut [0; 16]).is_err());
    }
}
