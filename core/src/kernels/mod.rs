//! Integer convolution kernels: one table of functions per [`Level`], all bit-equal to `scalar.rs`.
//!
//! A kernel multiplies a [`Block`]: rows of interleaved pixels (a band, gathered by `net::op_conv`) with packed
//! weights ([`pack`]). It reads each output's kernel rows straight from the band, so no patch matrix is built. The
//! design, with tiles and instructions per level, is in `README.md` beside this file.
//!
//! A level is chosen once, with [`Kernels::for_level`] or from [`Kernels::supported`]; there are no globals. Nothing
//! else hands kernels out, so that holding a `&Kernels` proves that this CPU has their instructions. Only this folder has `unsafe`, and only
//! for vector loads and stores, whose bounds [`Block::new`] has checked, for vector instructions that have no stable
//! intrinsic, and for code compiled for a level ([`Simd`]).
#[cfg(all(target_arch = "aarch64", target_feature = "neon", target_endian = "little"))]
mod aarch64;
mod byte_table;
mod columns;
pub mod pack;
pub mod peak;
pub mod quant;
mod scalar;
#[cfg(test)]
pub(crate) mod testing;
#[cfg(test)]
mod tests;
#[cfg(target_arch = "x86_64")]
mod tiles;
#[cfg(target_arch = "x86_64")]
mod x86_64;

use crate::Error;
use crate::base::simd::{Level, Simd};
pub(crate) use byte_table::{AHEAD, ByteTable, MARK_BIT};
use quant::Range;

/// Every level that has kernels on this architecture, slowest first, whether this CPU has it or not: private, because
/// a table's functions are sound only where its level is.
static TABLES: &[&Kernels] = &[
    &scalar::KERNELS,
    #[cfg(target_arch = "x86_64")]
    &x86_64::avx2::KERNELS,
    #[cfg(target_arch = "x86_64")]
    &x86_64::avx512vnni::KERNELS,
    #[cfg(all(target_arch = "aarch64", target_feature = "neon", target_endian = "little"))]
    &aarch64::neon::KERNELS,
    #[cfg(all(target_arch = "aarch64", target_feature = "neon", target_endian = "little"))]
    &aarch64::dotprod::KERNELS,
    #[cfg(all(target_arch = "aarch64", target_feature = "neon", target_endian = "little"))]
    &aarch64::i8mm::KERNELS,
];

/// The kernels of one level, which this CPU has: the references that this type gives out are the only ones.
#[derive(Debug)]
pub struct Kernels {
    name: &'static str,
    level: Level,
    flip: u8,
    code_bytes: usize,
    conv: fn(&Block<'_>, &Requant<'_>, &mut [i8]),
    accumulate: fn(&Block<'_>, &mut [i32]),
}

impl Kernels {
    /// The plain loops, which every CPU runs.
    #[must_use]
    pub fn scalar() -> &'static Self {
        &scalar::KERNELS
    }

    /// The kernels of `level`.
    ///
    /// # Errors
    /// [`Error::LevelUnsupported`] when this CPU (without `std`: this build) does not have it, or no kernels exist.
    pub fn for_level(level: Level) -> Result<&'static Self, Error> {
        Self::on(Level::is_supported)
            .find(|kernels| kernels.level == level)
            .ok_or(Error::LevelUnsupported { level })
    }

    /// The kernels of every level that this CPU (without `std`: this build) has, slowest first.
    pub fn supported() -> impl DoubleEndedIterator<Item = &'static Self> {
        Self::on(Level::is_supported)
    }

    /// The tables for a CPU that has the levels that `has` says.
    fn on(has: fn(Level) -> bool) -> impl DoubleEndedIterator<Item = &'static Self> {
        TABLES.iter().copied().filter(move |kernels| has(kernels.level))
    }

    /// The kernels' name: level, operation, element type.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        self.name
    }

    /// The level that they need.
    #[must_use]
    pub const fn level(&self) -> Level {
        self.level
    }

    /// The registers of the plain loops around them.
    pub(crate) fn simd(&self) -> Simd {
        Simd::for_level(self.level).unwrap_or(Simd::BASELINE)
    }

    /// What band bytes are: codes xor this. 0x80 makes them unsigned (code + 128), for instructions that want that.
    pub(crate) const fn flip(&self) -> u8 {
        self.flip
    }

    /// What each weight adds to an accumulator because of [`Kernels::flip`]: offsets must take it away again.
    pub(crate) const fn flip_bias(&self) -> i32 {
        self.flip as i32
    }

    /// Bytes of a code in the band: 1, or 2 where instructions want codes widened to 16 bits.
    pub(crate) const fn code_bytes(&self) -> usize {
        self.code_bytes
    }

    /// Convolves and requantises; `out` holds `cout` codes for each output pixel.
    pub(crate) fn convolve(
        &self,
        block: &Block<'_>,
        requant: &Requant<'_>,
        out: &mut [i8],
    ) -> Result<(), Error> {
        if out.len() != block.pixels() * block.shape.cout || requant.multiplier.len() < block.offset.len() {
            return Err(Error::WorkspaceTooSmall {
                needed: block.pixels() * block.shape.cout,
                available: out.len(),
            });
        }
        (self.conv)(block, requant, out);
        Ok(())
    }

    /// Convolves without requantisation; `out` holds `cout` accumulators for each output pixel.
    pub(crate) fn accumulate(&self, block: &Block<'_>, out: &mut [i32]) -> Result<(), Error> {
        if out.len() != block.pixels() * block.shape.cout {
            return Err(Error::WorkspaceTooSmall {
                needed: block.pixels() * block.shape.cout,
                available: out.len(),
            });
        }
        (self.accumulate)(block, out);
        Ok(())
    }
}

/// How accumulators become codes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Requant<'a> {
    /// Per channel, padded to whole panels.
    pub(crate) multiplier: &'a [f32],
    /// Zero point and bounds.
    pub(crate) range: Range,
}

/// One call's work: `rows x cols` output pixels, all output channels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Block<'a> {
    band: &'a [u8],
    pitch: usize,
    step: usize,
    row_step: usize,
    rows: usize,
    cols: usize,
    shape: pack::Shape,
    weights: &'a [i8],
    offset: &'a [i32],
}

/// Where a block's output pixels lie in its band, in bytes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Geometry {
    /// Bytes of a code.
    pub(crate) code: usize,
    /// From one input row to the next.
    pub(crate) pitch: usize,
    /// From one output pixel's first input byte to the next one's.
    pub(crate) step: usize,
    /// From one output row's first input byte to the next one's.
    pub(crate) row_step: usize,
    /// Output rows.
    pub(crate) rows: usize,
    /// Output pixels in a row.
    pub(crate) cols: usize,
}

impl Geometry {
    /// Bytes that the band must have: up to the last group of the last pixel.
    pub(crate) const fn band_len(&self, shape: &pack::Shape) -> usize {
        if self.rows == 0 || self.cols == 0 || shape.height == 0 {
            return 0;
        }
        let last = (self.rows - 1)
            .saturating_mul(self.row_step)
            .saturating_add((self.cols - 1).saturating_mul(self.step))
            .saturating_add((shape.height - 1).saturating_mul(self.pitch));
        last.saturating_add(shape.groups().saturating_mul(pack::GROUP * self.code))
    }
}

impl<'a> Block<'a> {
    /// Checks that every byte that a kernel will touch is there: band, weights, and one offset per packed channel.
    pub(crate) fn new(
        band: &'a [u8],
        geometry: Geometry,
        shape: pack::Shape,
        weights: &'a [i8],
        offset: &'a [i32],
    ) -> Result<Self, Error> {
        let needed = geometry.band_len(&shape);
        let padded = shape.panels().saturating_mul(pack::PANEL);
        if band.len() < needed
            || weights.len() != shape.packed_len()
            || offset.len() != padded
            || shape.cout == 0
        {
            return Err(Error::WorkspaceTooSmall { needed, available: band.len() });
        }
        let Geometry { pitch, step, row_step, rows, cols, .. } = geometry;
        Ok(Self { band, pitch, step, row_step, rows, cols, shape, weights, offset })
    }

    /// Output pixels.
    pub(crate) const fn pixels(&self) -> usize {
        self.rows * self.cols
    }

    /// First input byte of output pixel `index` (row-major).
    const fn pixel_start(&self, index: usize) -> usize {
        (index / self.cols) * self.row_step + (index % self.cols) * self.step
    }
}
