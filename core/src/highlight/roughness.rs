//! Roughness below a highlight: what is large in it is brought to what lies around.
//!
//! The network sees the highlight and says another roughness there than beside it, a dark or bright spot in the map of a material
//! that has none; the search and the CRF leave it. Relit from elsewhere the spot shows. So the roughness is filled in as the
//! albedo is ([`super::restore`]: the same weights, the same system), by differences and not by ratios, once. A difference near
//! [`SPREAD`] or more is rather another material, and hardly believed.
//!
//! Not in the paper. docs/decisions/020-inpaint-roughness.md has what it changes.
use super::{Look, fill, sizes};
use crate::Error;
use crate::base::arena::{Arena, bytes_for};
use crate::base::exec::Executor;
use crate::base::math::banded;
use crate::base::math::expf;
use crate::base::resample::{Pair, shrink};
use crate::frame::LinearImage;
use crate::maps::MapsMut;

/// A difference of roughness that is hardly believed any more.
const SPREAD: f32 = 0.2;

/// Bytes of workspace that [`level_roughness`] needs for maps of `size` x `size`.
#[must_use]
pub fn level_roughness_bytes(size: usize) -> usize {
    if size > crate::base::planes::MAX_SIZE {
        return usize::MAX;
    }
    let (seen, grid) = sizes(size);
    let (plane, cells) = (bytes_for::<f32>(seen * seen), bytes_for::<f32>(grid * grid));
    // The look and the diffuse part; the grid's weights, roughness and filled roughness, and the matrix.
    plane
        .saturating_mul(Look::PLANES + 1)
        .saturating_add(cells.saturating_mul(3))
        .saturating_add(bytes_for::<f32>(grid * grid * banded::stride(grid)))
        .saturating_add(17 * crate::base::arena::ALIGN)
}

/// Fills in the roughness of `maps` below highlights, in place; `f0` is the material's specular reflectance.
///
/// Roughness stays within [0,1]. A photo without a highlight changes next to nothing.
///
/// # Errors
/// [`Error::PlaneLength`], [`Error::Size`], [`Error::FieldOfView`], [`Error::WorkspaceTooSmall`].
pub fn level_roughness(
    photo: &LinearImage<'_>,
    maps: &mut MapsMut<'_>,
    f0: f32,
    exec: &dyn Executor,
    arena: &mut Arena<'_>,
) -> Result<(), Error> {
    photo.check()?;
    maps.as_maps().check()?;
    let n = maps.size;
    let (m, g) = sizes(n);
    let mut arena = arena.scope();
    let mut look = Look::new(photo, &maps.as_maps(), f0, exec, &mut arena)?;
    let share = arena.take::<f32>(m * m)?;
    let weight = arena.take::<f32>(g * g)?;
    let (low, filled) = (arena.take::<f32>(g * g)?, arena.take::<f32>(g * g)?);
    let matrix = arena.zeroed::<f32>(g * g * banded::stride(g))?;
    look.weights(share, weight, exec)?;
    shrink(look.roughness, m, g, low, exec);
    exec.simd().run(
        #[inline(always)]
        || fill(low, weight, g, filled, matrix),
    );
    for ((filled, low), weight) in filled.iter_mut().zip(&*low).zip(&*weight) {
        let difference = *filled - low;
        let unlikely = difference / SPREAD;
        *filled = difference * (1.0 - weight.min(1.0)) * expf(-unlikely * unlikely);
    }
    Pair { n, m: g }
        .each([filled], maps.roughness, exec, |[difference], value| (value + difference).clamp(0.0, 1.0));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::tests::{FOV, N, Plastic};
    use super::*;
    use crate::base::exec::Inline;
    use crate::crf::feature::radius_squared;
    use std::vec;
    use std::vec::Vec;

    /// `roughness` after [`level_roughness`].
    fn levelled(plastic: &Plastic, mut roughness: Vec<f32>) -> Vec<f32> {
        let (mut albedo, mut normal) = (plastic.albedo.clone(), plastic.normal.clone());
        let mut maps =
            MapsMut { size: N, albedo: &mut albedo, normal: &mut normal, roughness: &mut roughness };
        let clipped = vec![0; N * N];
        let photo = LinearImage::new(N, &plastic.photo, &clipped, FOV);
        let mut memory = vec![0; level_roughness_bytes(N)];
        level_roughness(&photo, &mut maps, 0.05, &Inline, &mut Arena::new(&mut memory)).expect("fits");
        roughness
    }

    /// 0.4 with a fine check, and `spot` more in a soft spot in the middle.
    fn spotted(spot: f32) -> Vec<f32> {
        let value = |i: usize| {
            let (x, y) = (i % N, i / N);
            let radius = radius_squared(x, y, N) / 0.02;
            let check = if (x + y).is_multiple_of(2) { 0.02 } else { -0.02 };
            0.4 + check + spot * expf(-radius * radius)
        };
        (0..N * N).map(value).collect()
    }

    #[test]
    fn a_spot_below_the_highlight_goes_and_detail_stays() {
        let plastic = Plastic::new([0.3, 0.1, 0.1], 0.4);
        let clean = spotted(0.0);
        // The larger it is, the less it is believed to be the highlight's.
        for (spot, left) in [(-0.12, 0.6), (-0.05, 0.5), (0.05, 0.5), (0.12, 0.6)] {
            let before = spotted(spot);
            let after = levelled(&plastic, before.clone());
            let error = |map: &[f32]| map.iter().zip(&clean).map(|(a, b)| (a - b).abs()).sum::<f32>();
            assert!(error(&after) < left * error(&before), "{spot}: {} of {}", error(&after), error(&before));
        }
    }

    #[test]
    fn what_is_level_or_matt_or_another_material_stays() {
        let worst = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        let glossy = Plastic::new([0.3, 0.1, 0.1], 0.4);
        assert!(worst(&levelled(&glossy, spotted(0.0)), &spotted(0.0)) < 1e-3);
        // Matt and bright: what is specular of it is too little to be a highlight.
        let matt = Plastic::new([0.7; 3], 1.0);
        assert!(worst(&levelled(&matt, spotted(0.1)), &spotted(0.1)) < 0.02);
        assert!(worst(&levelled(&glossy, spotted(0.5)), &spotted(0.5)) < 0.06);
    }
}
