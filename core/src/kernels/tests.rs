//! Kernels alone, on every level that this machine has, against sums in 64 bits.
use super::pack::{self, Shape};
use super::testing::requantise;
use super::{Block, Geometry, Kernels, Requant};
use crate::Error;
use crate::base::simd::Level;
use crate::base::testing::Random;
use crate::kernels::quant::Range;
use std::vec;
use std::vec::Vec;

/// A block's contents: band of codes, plain and packed weights, offsets, multipliers (padded to whole panels).
struct Case {
    shape: Shape,
    geometry: Geometry,
    codes: Vec<i8>,
    plain: Vec<i8>,
    packed: Vec<i8>,
    offset: Vec<i32>,
    multiplier: Vec<f32>,
}

impl Case {
    fn random(random: &mut Random) -> Self {
        let (cout, height, run) = (random.range(1, 70), random.range(1, 4), random.range(1, 90));
        let shape = Shape { cout, height, run, cin: run };
        let (rows, cols, step) = (random.range(1, 4), random.range(1, 27), random.range(1, 40));
        // Odd distances: nothing may depend on alignment.
        let pitch = (cols - 1) * step + shape.groups() * pack::GROUP + random.range(0, 9);
        let geometry = Geometry { code: 1, pitch, step, row_step: random.range(1, 2) * pitch, rows, cols };
        // Exactly as long as a block needs: a read past the end is a read past the allocation.
        let codes = random.codes(geometry.band_len(&shape));
        let plain = random.weights(shape.plain_len());
        let padded = shape.panels() * pack::PANEL;
        let offset = (0..padded).map(|_| (random.float() * 1e5) as i32).collect();
        // Every other channel a power of two: products that lie half way between codes.
        let one =
            |(i, r): (usize, f32)| if i % 2 == 0 { 1e-3 * (1.1 + r) } else { 0.5_f32.powi(3 + i as i32 % 7) };
        let multiplier = (0..padded).map(|_| random.float()).enumerate().map(one).collect();
        Self { shape, geometry, codes, packed: Self::pack(&plain, &shape), plain, offset, multiplier }
    }

    fn pack(plain: &[i8], shape: &Shape) -> Vec<i8> {
        let mut packed = vec![0; shape.packed_len()];
        pack::pack(plain, shape, &mut packed);
        packed
    }

    /// Finished sums, `[pixel][channel]`.
    fn sums(&self) -> Vec<i64> {
        let Geometry { pitch, step, row_step, rows, cols, .. } = self.geometry;
        let Shape { cout, height, run, .. } = self.shape;
        let mut out = Vec::new();
        for pixel in 0..rows * cols {
            let start = pixel / cols * row_step + pixel % cols * step;
            for channel in 0..cout {
                let dot = |row: usize| -> i64 {
                    let codes = &self.codes[start + row * pitch..][..run];
                    let weights = &self.plain[(channel * height + row) * run..][..run];
                    codes.iter().zip(weights).map(|(&q, &w)| i64::from(q) * i64::from(w)).sum()
                };
                out.push(i64::from(self.offset[channel]) + (0..height).map(dot).sum::<i64>());
            }
        }
        out
    }

    /// Sums and codes of one level.
    fn run(&self, kernels: &Kernels, range: Range) -> (Vec<i32>, Vec<i8>) {
        let size = kernels.code_bytes();
        let band: Vec<u8> = match size {
            1 => self.codes.iter().map(|q| q.cast_unsigned() ^ kernels.flip()).collect(),
            _ => self.codes.iter().flat_map(|&q| i16::from(q).to_ne_bytes()).collect(),
        };
        let Geometry { pitch, step, row_step, rows, cols, .. } = self.geometry;
        let (pitch, step, row_step) = (pitch * size, step * size, row_step * size);
        let geometry = Geometry { code: size, pitch, step, row_step, rows, cols };
        let mut offset = self.offset.clone();
        let per_channel = self.plain.chunks_exact(self.shape.height * self.shape.run);
        for (offset, weights) in offset.iter_mut().zip(per_channel) {
            *offset -= kernels.flip_bias() * weights.iter().map(|&w| i32::from(w)).sum::<i32>();
        }
        let block = Block::new(&band, geometry, self.shape, &self.packed, &offset).expect("all is there");
        let count = self.geometry.rows * self.geometry.cols * self.shape.cout;
        let (mut sums, mut codes) = (vec![0x55; count], vec![0x55; count]);
        kernels.accumulate(&block, &mut sums).expect("long enough");
        let requant = Requant { multiplier: &self.multiplier, range };
        kernels.convolve(&block, &requant, &mut codes).expect("long enough");
        (sums, codes)
    }
}

/// Calling kernels that the CPU lacks is undefined behaviour: no door may give them out.
#[test]
fn no_kernels_without_their_level() {
    assert_eq!(Kernels::on(|_| false).count(), 0);
    let plainest: Vec<Level> = Kernels::on(|level| level == Level::Scalar).map(Kernels::level).collect();
    assert_eq!(plainest, [Level::Scalar]);
    for level in Level::ALL {
        let listed = Kernels::supported().any(|kernels| kernels.level() == level);
        match Kernels::for_level(level) {
            Ok(kernels) => assert!(listed && level.is_supported() && kernels.level() == level, "{level:?}"),
            Err(error) => {
                assert_eq!(error, Error::LevelUnsupported { level });
                assert!(!listed, "{level:?}");
            }
        }
    }
}

#[test]
fn sums_and_codes_of_any_block() {
    for seed in 0..60_u64 {
        let mut random = Random(seed);
        let case = Case::random(&mut random);
        let range = Range::new(random.next() as i8, random.range(0, 1) == 1);
        let expected = case.sums();
        let code = |(i, &sum): (usize, &i64)| requantise(sum, case.multiplier[i % case.shape.cout], range);
        let codes: Vec<i8> = expected.iter().enumerate().map(code).collect();
        for kernels in Kernels::supported() {
            let found = case.run(kernels, range);
            let sums: Vec<i64> = found.0.iter().map(|&sum| i64::from(sum)).collect();
            let what = (seed, kernels.name(), case.shape, case.geometry);
            assert_eq!(sums, expected, "{what:?}");
            assert_eq!(found.1, codes, "{what:?}");
        }
    }
}

/// The largest products of one sign, everywhere: what 16-bit sums of them would do shows here.
#[test]
fn extreme_products_neither_saturate_nor_wrap() {
    for (weight, code) in [(-127, -128), (127, -128), (-127, 127), (127, 127)] {
        for run in 1..=40 {
            let mut case = Case::random(&mut Random(run as u64));
            let shape = Shape { run, cin: run, ..case.shape };
            let geometry = Geometry {
                code: 1,
                pitch: 200,
                step: 3,
                row_step: 200,
                rows: case.geometry.rows.min(2),
                cols: 13,
            };
            case.plain = vec![weight; shape.plain_len()];
            case.packed = Case::pack(&case.plain, &shape);
            case.codes = vec![code; geometry.band_len(&shape)];
            (case.shape, case.geometry) = (shape, geometry);
            let products = (shape.height * run) as i32 * i32::from(weight) * i32::from(code);
            for kernels in Kernels::supported() {
                let (sums, _) = case.run(kernels, Range::new(0, false));
                for (i, sum) in sums.iter().enumerate() {
                    let expected = case.offset[i % shape.cout] + products;
                    assert_eq!(*sum, expected, "{} {weight} {code} {shape:?}", kernels.name());
                }
            }
        }
    }
}

/// Multipliers that overflow to infinity: zero times infinity is no number, and every level gives the same code.
#[test]
fn what_is_no_number_has_the_same_code_on_every_level() {
    let mut case = Case::random(&mut Random(7));
    case.multiplier.fill(f32::INFINITY);
    case.plain.fill(0);
    case.packed.fill(0);
    for range in [Range::new(-128, true), Range::new(5, false), Range::new(127, true)] {
        for (offset, value) in case.offset.iter_mut().zip([0, 1, -1].into_iter().cycle()) {
            *offset = value;
        }
        let scalar = case.run(Kernels::scalar(), range);
        for kernels in Kernels::supported() {
            assert_eq!(case.run(kernels, range), scalar, "{}", kernels.name());
        }
    }
}

/// What [`Level`] calls built is what has kernels.
#[test]
fn every_built_level_has_kernels() {
    let with_kernels = super::TABLES.iter().map(|kernels| kernels.level);
    assert!(with_kernels.eq(Level::ALL.into_iter().filter(|level| level.is_built())));
}
