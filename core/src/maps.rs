//! The material maps as views of planar f32, and their encoding for files.
//!
//! Albedo: 3 planes, linear RGB (sRGB primaries), [0,1]. Normal: 3 planes x, y, z of unit vectors, tangent space,
//! x right, y up, z to the camera (OpenGL). Roughness: 1 plane, perceptual (alpha = r²), [0,1]. Planes are
//! `size` x `size`, row-major, top row first.
use crate::Error;
use crate::base::planes::{check_planes, plane_row};
use crate::frame::transfer::linear_to_srgb;

/// Shared view of a material's maps.
#[derive(Clone, Copy, Debug)]
pub struct Maps<'a> {
    /// Pixels per side.
    pub size: usize,
    /// 3 planes of linear RGB.
    pub albedo: &'a [f32],
    /// 3 planes x, y, z.
    pub normal: &'a [f32],
    /// 1 plane.
    pub roughness: &'a [f32],
}

/// Mutable view of a material's maps.
#[derive(Debug)]
pub struct MapsMut<'a> {
    /// Pixels per side.
    pub size: usize,
    /// 3 planes of linear RGB.
    pub albedo: &'a mut [f32],
    /// 3 planes x, y, z.
    pub normal: &'a mut [f32],
    /// 1 plane.
    pub roughness: &'a mut [f32],
}

impl MapsMut<'_> {
    /// The same maps, for reading.
    #[must_use]
    pub fn as_maps(&self) -> Maps<'_> {
        Maps { size: self.size, albedo: self.albedo, normal: self.normal, roughness: self.roughness }
    }
}

/// A file's channel type: u8 or u16, full range.
pub trait Quantum: Copy + Send + 'static {
    /// Rounds `value` in [0,1] to the nearest code; outside values are clamped, NaN gives 0.
    fn encode(value: f32) -> Self;
}

impl Quantum for u8 {
    fn encode(value: f32) -> Self {
        // `as` saturates and turns NaN into 0.
        (value * 255.0 + 0.5) as Self
    }
}

impl Quantum for u16 {
    fn encode(value: f32) -> Self {
        (value * 65535.0 + 0.5) as Self
    }
}

impl<'a> Maps<'a> {
    /// Checks that every map has the length that `size` asks for.
    ///
    /// # Errors
    /// As [`check_planes`].
    pub fn check(&self) -> Result<(), Error> {
        check_planes(self.size, 3, self.albedo.len())?;
        check_planes(self.size, 3, self.normal.len())?;
        check_planes(self.size, 1, self.roughness.len())
    }

    /// Row `row` of the albedo, sRGB-encoded, interleaved RGB: `out` holds 3 * size values.
    ///
    /// # Errors
    /// [`Error::PlaneLength`] when `out` or a map is of another length, [`Error::Size`] when `row` is outside.
    pub fn albedo_row<T: Quantum>(&self, row: usize, out: &mut [T]) -> Result<(), Error> {
        encode_rgb_row(self.albedo, self.size, row, out, linear_to_srgb)
    }

    /// Row `row` of the normals as (n + 1) / 2, interleaved x, y, z: `out` holds 3 * size values.
    ///
    /// # Errors
    /// As [`Maps::albedo_row`].
    pub fn normal_row<T: Quantum>(&self, row: usize, out: &mut [T]) -> Result<(), Error> {
        encode_rgb_row(self.normal, self.size, row, out, |n| n * 0.5 + 0.5)
    }

    /// Row `row` of the roughness, linear: `out` holds size values.
    ///
    /// # Errors
    /// As [`Maps::albedo_row`].
    pub fn roughness_row<T: Quantum>(&self, row: usize, out: &mut [T]) -> Result<(), Error> {
        check_row(self.size, row, 1, self.roughness.len(), out.len())?;
        for (out, &r) in out.iter_mut().zip(plane_row(self.roughness, self.size, row)) {
            *out = T::encode(r);
        }
        Ok(())
    }
}

/// Row `row` of three planes as interleaved codes, each value through `curve` first: for albedo and re-renderings
/// (`linear_to_srgb`) and normals.
///
/// # Errors
/// As [`Maps::albedo_row`].
pub fn encode_rgb_row<T: Quantum>(
    planes: &[f32],
    size: usize,
    row: usize,
    out: &mut [T],
    curve: impl Fn(f32) -> f32,
) -> Result<(), Error> {
    check_row(size, row, 3, planes.len(), out.len())?;
    for (channel, plane) in planes.chunks_exact(size * size).enumerate() {
        let codes = out.iter_mut().skip(channel).step_by(3);
        for (code, &value) in codes.zip(plane_row(plane, size, row)) {
            *code = T::encode(curve(value));
        }
    }
    Ok(())
}

fn check_row(size: usize, row: usize, planes: usize, given: usize, out: usize) -> Result<(), Error> {
    check_planes(size, planes, given)?;
    if row >= size {
        return Err(Error::Size { size: row });
    }
    if out == planes * size { Ok(()) } else { Err(Error::PlaneLength { needed: planes * size, given: out }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_encoded_by_hand_worked_codes() {
        // 2 x 2: second row holds black and white, mid albedo is 0.21404 linear = 0.5 encoded.
        let albedo = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.214_041_14, 2.0, 0.0, 0.0, -1.0, f32::NAN];
        let normal = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 1.0, 1.0, 0.0, 0.0];
        let maps = Maps { size: 2, albedo: &albedo, normal: &normal, roughness: &[0.0, 0.0, 0.5, 1.0] };
        maps.check().expect("lengths");
        let mut rgb = [0_u8; 6];
        maps.albedo_row(1, &mut rgb).expect("row");
        assert_eq!(rgb, [0, 128, 0, 255, 255, 0]);
        maps.normal_row(1, &mut rgb).expect("row");
        assert_eq!(rgb, [128, 0, 128, 255, 128, 128]);
        let mut wide = [0_u16; 6];
        maps.normal_row(1, &mut wide).expect("row");
        assert_eq!(wide, [32768, 0, 32768, 65535, 32768, 32768]);
        let mut grey = [0_u8; 2];
        maps.roughness_row(1, &mut grey).expect("row");
        assert_eq!(grey, [128, 255]);
    }

    #[test]
    fn wrong_lengths_are_errors() {
        let maps = Maps { size: 2, albedo: &[0.0; 12], normal: &[0.0; 11], roughness: &[0.0; 4] };
        assert_eq!(maps.check(), Err(Error::PlaneLength { needed: 12, given: 11 }));
        assert_eq!(maps.albedo_row(0, &mut [0_u8; 5]), Err(Error::PlaneLength { needed: 6, given: 5 }));
        assert_eq!(maps.roughness_row(2, &mut [0_u8; 2]), Err(Error::Size { size: 2 }));
    }
}
