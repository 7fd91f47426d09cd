//! The material maps as views of planar f32, and their encoding for files.
//!
//! Albedo: 3 planes, linear RGB (sRGB primaries), [0,1]. Normal: 3 planes x, y, z of unit vectors, tangent space,
//! x right, y up, z to the camera (OpenGL). Roughness: 1 plane, perceptual (alpha = r²), [0,1]. Planes are
//! `size` x `size`, row-major, top row first.
use crate::Error;
use crate::base::exec::{Executor, Plane, ROWS_PER_BLOCK, for_each_row_block, within};
use crate::base::planes::{check_planes, plane_row};
use crate::frame::srgb8::srgb_code;
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
    /// The nearest sRGB code of a linear value, as [`Quantum::encode`] of [`linear_to_srgb`] gives it.
    fn srgb(linear: f32) -> Self;
}

impl Quantum for u8 {
    fn encode(value: f32) -> Self {
        // `as` saturates and turns NaN into 0.
        (value * 255.0 + 0.5) as Self
    }

    #[inline(always)]
    fn srgb(linear: f32) -> Self {
        srgb_code(linear)
    }
}

impl Quantum for u16 {
    fn encode(value: f32) -> Self {
        (value * 65535.0 + 0.5) as Self
    }

    fn srgb(linear: f32) -> Self {
        Self::encode(linear_to_srgb(linear))
    }
}

/// What a result's values are, and so how they become codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coding {
    /// Linear light, sRGB-encoded in files: albedo, photo, re-render.
    Srgb,
    /// Directions in [-1,1], (n + 1) / 2 in files: normals.
    Signed,
    /// Numbers in [0,1], as they are: roughness and how well it is known.
    Linear,
}

impl Coding {
    /// The code of a value.
    #[inline(always)]
    fn code<T: Quantum>(self, value: f32) -> T {
        match self {
            Self::Srgb => T::srgb(value),
            Self::Signed => T::encode(value * 0.5 + 0.5),
            Self::Linear => T::encode(value),
        }
    }
}

/// All of `planes` (1 or 3 of `size` x `size`) as interleaved codes, in row blocks on `exec`: `out` holds as many values.
///
/// # Errors
/// [`Error::PlaneLength`] when `out` or the planes are of another length, [`Error::Size`].
pub fn encode<T: Quantum>(
    planes: &[f32],
    size: usize,
    coding: Coding,
    exec: &dyn Executor,
    out: &mut [T],
) -> Result<(), Error> {
    let channels = if planes.len() == size.saturating_mul(size) { 1 } else { 3 };
    check_planes(size, channels, planes.len())?;
    check_planes(size, channels, out.len())?;
    within(exec, || {
        let out = Plane::new(out, channels * size);
        for_each_row_block(exec, size, ROWS_PER_BLOCK, out, &|rows, mut out| {
            for (row, out) in rows.zip(out.rows()) {
                encode_line(planes, size, row, out, coding);
            }
        });
        Ok(())
    })
}

/// Row `row` of one plane or three; lengths were checked.
fn encode_line<T: Quantum>(planes: &[f32], size: usize, row: usize, out: &mut [T], coding: Coding) {
    if out.len() == size {
        for (out, &value) in out.iter_mut().zip(plane_row(planes, size, row)) {
            *out = coding.code(value);
        }
        return;
    }
    let line = |plane: usize| plane_row(planes, size, plane * size + row).iter();
    let values = line(0).zip(line(1)).zip(line(2));
    for (pixel, ((&x, &y), &z)) in out.as_chunks_mut::<3>().0.iter_mut().zip(values) {
        *pixel = [coding.code(x), coding.code(y), coding.code(z)];
    }
}

/// Row `row` of `planes` (1 or 3 of `size` x `size`) as interleaved codes: `out` holds as many values as a row has.
///
/// # Errors
/// As [`encode`], and [`Error::Size`] when `row` is outside.
pub fn encode_row<T: Quantum>(
    planes: &[f32],
    size: usize,
    row: usize,
    coding: Coding,
    out: &mut [T],
) -> Result<(), Error> {
    let channels = if planes.len() == size.saturating_mul(size) { 1 } else { 3 };
    check_row(size, row, channels, planes.len(), out.len())?;
    encode_line(planes, size, row, out, coding);
    Ok(())
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
        check_row(self.size, row, 3, self.albedo.len(), out.len())?;
        encode_row(self.albedo, self.size, row, Coding::Srgb, out)
    }

    /// Row `row` of the normals as (n + 1) / 2, interleaved x, y, z: `out` holds 3 * size values.
    ///
    /// # Errors
    /// As [`Maps::albedo_row`].
    pub fn normal_row<T: Quantum>(&self, row: usize, out: &mut [T]) -> Result<(), Error> {
        check_row(self.size, row, 3, self.normal.len(), out.len())?;
        encode_row(self.normal, self.size, row, Coding::Signed, out)
    }

    /// Row `row` of the roughness, linear: `out` holds size values.
    ///
    /// # Errors
    /// As [`Maps::albedo_row`].
    pub fn roughness_row<T: Quantum>(&self, row: usize, out: &mut [T]) -> Result<(), Error> {
        check_row(self.size, row, 1, self.roughness.len(), out.len())?;
        encode_row(self.roughness, self.size, row, Coding::Linear, out)
    }
}

/// Row `row` of three planes as interleaved codes, each value through `curve` first. [`encode_row`] is many times as fast.
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
    use crate::base::exec::Inline;
    use std::vec;
    use std::vec::Vec;

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

    /// Whole maps on threads are their rows, and those the definition by the power function.
    #[test]
    fn whole_maps_are_their_rows() {
        const N: usize = 37;
        let planes: Vec<f32> = (0..3 * N * N).map(|i| (i * 7919 % 4001) as f32 / 3600.0 - 0.05).collect();
        let curve = |coding, v: f32| match coding {
            Coding::Srgb => linear_to_srgb(v),
            Coding::Signed => v * 0.5 + 0.5,
            Coding::Linear => v,
        };
        for coding in [Coding::Srgb, Coding::Signed, Coding::Linear] {
            let (mut bytes, mut wide) = (vec![0_u8; 3 * N * N], vec![0_u16; 3 * N * N]);
            encode(&planes, N, coding, &Inline, &mut bytes).expect("lengths");
            encode(&planes, N, coding, &Inline, &mut wide).expect("lengths");
            for (i, (&byte, &wide)) in bytes.iter().zip(&wide).enumerate() {
                let value = curve(coding, planes[i % 3 * N * N + i / 3]);
                assert_eq!((byte, wide), (u8::encode(value), u16::encode(value)), "{coding:?} {i}");
            }
            let mut grey = vec![0_u8; N * N];
            encode(&planes[..N * N], N, coding, &Inline, &mut grey).expect("lengths");
            assert!(grey.iter().zip(bytes.iter().step_by(3)).all(|(a, b)| a == b));
            #[cfg(feature = "parallel")]
            {
                let pool = crate::base::exec::Pool::new(3).expect("threads");
                let mut again = vec![0_u8; 3 * N * N];
                encode(&planes, N, coding, &pool, &mut again).expect("lengths");
                assert!(again == bytes);
            }
        }
        let error = encode(&planes, N, Coding::Linear, &Inline, &mut [0_u8; N * N]);
        assert_eq!(error, Err(Error::PlaneLength { needed: 3 * N * N, given: N * N }));
        assert_eq!(encode::<u8>(&[], 0, Coding::Srgb, &Inline, &mut []), Err(Error::Size { size: 0 }));
    }

    #[test]
    fn wrong_lengths_are_errors() {
        let maps = Maps { size: 2, albedo: &[0.0; 12], normal: &[0.0; 11], roughness: &[0.0; 4] };
        assert_eq!(maps.check(), Err(Error::PlaneLength { needed: 12, given: 11 }));
        assert_eq!(maps.albedo_row(0, &mut [0_u8; 5]), Err(Error::PlaneLength { needed: 6, given: 5 }));
        assert_eq!(maps.roughness_row(2, &mut [0_u8; 2]), Err(Error::Size { size: 2 }));
    }
}
