//! The maps of a material as 8-bit pictures, row by row.
use crate::Error;
use flashmat_core::base::planes::check_planes;
use flashmat_core::maps::Maps;

/// A material's maps, in either form in which captures give them.
#[derive(Clone, Copy, Debug)]
pub enum Pictures<'a> {
    /// Planes of floats; they are encoded here.
    Planes(Maps<'a>),
    /// Codes, interleaved, as [`Maps::albedo_row`], [`Maps::normal_row`] and [`Maps::roughness_row`] make them.
    Codes {
        /// Pixels per side.
        size: usize,
        /// R, G, B, sRGB-encoded.
        albedo: &'a [u8],
        /// x, y, z as (n + 1) / 2.
        normal: &'a [u8],
        /// Linear.
        roughness: &'a [u8],
    },
}

impl Pictures<'_> {
    /// Pixels per side.
    #[must_use]
    pub fn size(&self) -> usize {
        match *self {
            Self::Planes(maps) => maps.size,
            Self::Codes { size, .. } => size,
        }
    }

    /// Checks that all maps have the length that their size asks for.
    ///
    /// # Errors
    /// [`Error::Maps`].
    pub fn check(&self) -> Result<(), Error> {
        match *self {
            Self::Planes(maps) => maps.check()?,
            Self::Codes { size, albedo, normal, roughness } => {
                check_planes(size, 3, albedo.len())?;
                check_planes(size, 3, normal.len())?;
                check_planes(size, 1, roughness.len())?;
            }
        }
        Ok(())
    }

    pub(crate) fn albedo_row(&self, row: usize, out: &mut [u8]) -> Result<(), Error> {
        match *self {
            Self::Planes(maps) => Ok(maps.albedo_row(row, out)?),
            Self::Codes { albedo, .. } => copy(albedo, row, out),
        }
    }

    pub(crate) fn normal_row(&self, row: usize, out: &mut [u8]) -> Result<(), Error> {
        match *self {
            Self::Planes(maps) => Ok(maps.normal_row(row, out)?),
            Self::Codes { normal, .. } => copy(normal, row, out),
        }
    }

    pub(crate) fn roughness_row(&self, row: usize, out: &mut [u8]) -> Result<(), Error> {
        match *self {
            Self::Planes(maps) => Ok(maps.roughness_row(row, out)?),
            Self::Codes { roughness, .. } => copy(roughness, row, out),
        }
    }
}

/// Row `row` of `codes`, whose rows are as long as `out`.
fn copy(codes: &[u8], row: usize, out: &mut [u8]) -> Result<(), Error> {
    let start = row.saturating_mul(out.len());
    let from = codes.get(start..start.saturating_add(out.len())).ok_or(Error::Size)?;
    out.copy_from_slice(from);
    Ok(())
}
