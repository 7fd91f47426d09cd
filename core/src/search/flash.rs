//! Where the flash is.
//!
//! A phone's flash is beside its lens, and hardly anyone holds a phone quite parallel to the material: the highlight and the
//! falloff are then off the centre. The paper has light and camera at one point ("Acquisition Setup and SVBRDF Decomposition");
//! whoever assumes it takes what the flash does beside the centre for the material's own. So its position, parallel to the
//! plane and as far from it as the camera, is the one whose re-render comes nearest to the photo.
use super::exposure::{Lights, lights, nearer_lights, sums};
use crate::Error;
use crate::base::arena::{ALIGN, Arena, bytes_for};
use crate::base::exec::Executor;
use crate::base::math::approx::gamma;
use crate::base::resample::{shrink, shrunk};
use crate::brdf::{self, Scene};
use crate::frame::{CLIPPED_AREA, LinearImage};
use crate::maps::Maps;
use glam::{Vec2, Vec3};

/// Pixels per side at which photo and re-renders are compared, at most.
const SIDE: usize = 32;
/// First and last step of the search, in plane units.
const STEPS: (f32, f32) = (0.1, 0.025);
/// How far beside the camera it may be, in x and in y.
const REACH: f32 = 0.35;
/// How much nearer a re-render must come for a flash at distance 1 from the camera, as a share of the squared error; at other
/// distances by their square. Without it the material's own shades would be explained by the flash.
const PULL: f32 = 4.0;
/// Steps of the lights' fit at each place, from the best place's on.
const LIGHT_STEPS: usize = 2;
/// Rounds of eight tries: a step of the search is repeated where it leads on.
const ROUNDS: usize = 12;

/// Bytes of workspace that [`flash_position`] needs for maps of `size` x `size`.
#[must_use]
pub fn flash_position_bytes(size: usize) -> usize {
    if size > crate::base::planes::MAX_SIZE {
        return usize::MAX;
    }
    let (plane, small) = (size.saturating_mul(size), size.min(SIDE) * size.min(SIDE));
    // Photo, albedo, normals, roughness, a render; where it is clipped, at full size as numbers, and nowhere.
    bytes_for::<f32>(small)
        .saturating_mul(3 + 3 + 3 + 1 + 3 + 1)
        .saturating_add(bytes_for::<f32>(plane))
        .saturating_add(bytes_for::<u8>(small).saturating_mul(2))
        .saturating_add(10 * ALIGN)
}

/// The position of the flash in plane units (the plane is z = 0, the camera at (0,0,1)), z = 1, within 0.35 of the camera's in
/// x and in y, for which `maps` re-rendered come nearest to the photo.
///
/// Photo and maps are compared at no more than [`SIDE`] x [`SIDE`] pixels, in gamma 2.2; flash and room have the strengths that suit the
/// position ([`lights`]); where the photo is clipped, it and the re-render count as white. A compass search: the eight
/// neighbours at a step of 0.1, then of half and a quarter of that, from the camera on. The camera's own position where the
/// photo does not say: where it is clipped nearly everywhere, or black.
///
/// # Errors
/// [`Error::PlaneLength`], [`Error::Size`], [`Error::FieldOfView`], [`Error::WorkspaceTooSmall`].
pub fn flash_position(
    photo: &LinearImage<'_>,
    maps: &Maps<'_>,
    f0: f32,
    exec: &dyn Executor,
    arena: &mut Arena<'_>,
) -> Result<Vec3, Error> {
    photo.check()?;
    maps.check()?;
    let (n, m) = (photo.size, photo.size.min(SIDE));
    let mut arena = arena.scope();
    let rgb = &*shrunk(photo.rgb, n, m, exec, &mut arena)?;
    let (clipped, nowhere) = (arena.take::<u8>(m * m)?, arena.zeroed::<u8>(m * m)?);
    {
        let mut arena = arena.scope();
        let (full, small) = (arena.take::<f32>(n * n)?, arena.take::<f32>(m * m)?);
        clipped.fill(0);
        for bit in [1, 2, 4] {
            full.iter_mut()
                .zip(photo.clipped)
                .for_each(|(number, flag)| *number = f32::from((*flag & bit).min(1)));
            shrink(full, n, m, small, exec);
            for (flag, share) in clipped.iter_mut().zip(&*small) {
                *flag |= if *share >= CLIPPED_AREA { bit } else { 0 };
            }
        }
    }
    let small = LinearImage { size: m, rgb, clipped, ..*photo };
    let maps = Maps {
        size: m,
        albedo: shrunk(maps.albedo, n, m, exec, &mut arena)?,
        normal: shrunk(maps.normal, n, m, exec, &mut arena)?,
        roughness: shrunk(maps.roughness, n, m, exec, &mut arena)?,
    };
    let mut fit = Fit { photo: small, clipped: nowhere, maps, f0, render: arena.take(3 * m * m)?, exec };
    match fit.search() {
        Err(Error::NoUsablePixels | Error::PhotoBlack) => Ok(Vec3::Z),
        found => found,
    }
}

/// What a position is judged by.
struct Fit<'f> {
    photo: LinearImage<'f>,
    /// Nowhere.
    clipped: &'f [u8],
    maps: Maps<'f>,
    f0: f32,
    render: &'f mut [f32],
    exec: &'f dyn Executor,
}

impl Fit<'_> {
    fn search(&mut self) -> Result<Vec3, Error> {
        let (mut place, mut step) = (Vec2::ZERO, STEPS.0);
        self.light(place)?;
        let mut best = lights(&self.photo, self.render, self.maps.albedo, self.exec)?;
        let mut least = self.error(place, &best);
        for _ in 0..ROUNDS {
            let (centre, start) = (place, best);
            for (x, y) in [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)] {
                let reach = Vec2::splat(REACH);
                let other = (centre + step * Vec2::new(x as f32, y as f32)).clamp(-reach, reach);
                self.light(other)?;
                let planes = [&*self.render, self.maps.albedo];
                let lights = nearer_lights(&self.photo, planes, start, LIGHT_STEPS, self.exec);
                let error = self.error(other, &lights);
                if error < least {
                    (least, place, best) = (error, other, lights);
                }
            }
            if place == centre {
                step /= 2.0;
                if step < STEPS.1 {
                    break;
                }
            }
        }
        Ok(place.extend(1.0))
    }

    /// Renders the maps with the flash at `place`.
    fn light(&mut self, place: Vec2) -> Result<(), Error> {
        let scene = Scene::of(&LinearImage { flash: place.extend(1.0), ..self.photo });
        brdf::render(&self.maps, self.f0, &scene, self.exec, self.render)
    }

    /// The squared error of the render as it is, lit with these lights from `place`, [`PULL`] included.
    fn error(&self, place: Vec2, &Lights { flash, room }: &Lights) -> f64 {
        let everywhere = LinearImage { clipped: self.clipped, ..self.photo };
        let [squares] = sums(
            &everywhere,
            [&*self.render, self.maps.albedo],
            1,
            self.exec,
            #[inline(always)]
            |p, [r, a]| {
                let error = gamma(p.clamp(0.0, 1.0)) - gamma((flash * (r + room * a)).clamp(0.0, 1.0));
                [error * error]
            },
        );
        squares * f64::from(1.0 + PULL * place.length_squared())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{FOV, Scenery, marks, scenery};
    use super::*;
    use crate::base::exec::Inline;
    use std::vec;

    const F0: f32 = 0.05;

    /// A photo of [`scenery`] with the flash at (x, y) beside the camera, and some light from the room.
    fn shot(n: usize, x: f32, y: f32, room: f32) -> Scenery {
        let mut s = scenery(n, F0, 1.0);
        let mut render = vec![0.0; 3 * n * n];
        let scene = Scene::of(&LinearImage { flash: Vec3::new(x, y, 1.0), ..s.photo() });
        brdf::render(&s.maps(), F0, &scene, &Inline, &mut render).expect("scene");
        for (photo, (r, a)) in s.photo.iter_mut().zip(render.iter().zip(&s.albedo)) {
            *photo = (0.6 * (r + room * a)).min(1.0);
        }
        s.clipped = marks(&s.photo, n * n);
        s
    }

    fn found(s: &Scenery) -> Result<Vec3, Error> {
        let mut memory = vec![0; flash_position_bytes(s.photo().size)];
        flash_position(&s.photo(), &s.maps(), F0, &Inline, &mut Arena::new(&mut memory))
    }

    #[test]
    fn the_flash_of_an_exact_photo_is_found() {
        for (x, y, room) in [
            (0.0, 0.0, 0.0),
            (0.0, 0.0, 0.5),
            (0.1, 0.0, 0.0),
            (-0.05, 0.2, 0.3),
            (0.3, -0.3, 0.0),
            (0.02, 0.33, 0.8),
        ] {
            let flash = found(&shot(128, x, y, room)).expect("a photo");
            let beside = flash.truncate() - Vec2::new(x, y);
            assert!(beside.length() < 0.02, "({x}, {y}), room {room}: {flash}");
            assert_eq!(flash.z, 1.0);
        }
    }

    /// A search of every place within reach, with the lights that suit each found from scratch.
    #[test]
    fn hardly_any_place_is_better() {
        for (x, y, bend) in [(0.08, -0.03, 0.0), (-0.15, 0.1, 0.5), (0.0, 0.0, -0.4), (0.2, 0.2, 0.3)] {
            let mut s = shot(SIDE, x, y, 0.2);
            // What the maps do not explain: waves, and a falloff that is not theirs.
            for (i, value) in s.photo.iter_mut().enumerate() {
                let (column, row) = (i % SIDE, i / SIDE % SIDE);
                let radius = crate::crf::feature::radius_squared(column, row, SIDE);
                *value =
                    (*value * (1.0 + bend * radius) * (1.0 + 0.1 * (0.7 * column as f32).sin())).min(0.99);
            }
            s.clipped.fill(0);
            let nowhere = vec![0; SIDE * SIDE];
            let mut render = vec![0.0; 3 * SIDE * SIDE];
            let photo = s.photo();
            let mut fit =
                Fit { photo, clipped: &nowhere, maps: s.maps(), f0: F0, render: &mut render, exec: &Inline };
            let mut cost = |place: Vec2| {
                fit.light(place).expect("scene");
                let lights = lights(&photo, fit.render, fit.maps.albedo, &Inline).expect("usable");
                fit.error(place, &lights)
            };
            let mut least = f64::INFINITY;
            for i in -14..=14 {
                for j in -14..=14 {
                    least = least.min(cost(Vec2::new(i as f32, j as f32) * 0.025));
                }
            }
            let is = cost(found(&s).expect("a photo").truncate());
            assert!(is <= 1.02 * least, "({x}, {y}), {bend}: {is} for {least}");
        }
    }

    #[test]
    fn a_photo_that_does_not_say_leaves_the_flash_at_the_camera() {
        let mut s = scenery(128, F0, 1.0);
        s.clipped.fill(crate::frame::ALL_CLIPPED);
        assert_eq!(found(&s), Ok(Vec3::Z));
        let mut s = scenery(128, F0, 1.0);
        s.photo.fill(0.0);
        assert_eq!(found(&s), Ok(Vec3::Z));
        // Maps that give no light at all: the largest numbers there are.
        let mut s = scenery(128, F0, 1.0);
        s.albedo.fill(f32::MAX);
        assert!(found(&s).expect("no panic").is_finite());
    }

    #[test]
    fn wrong_shapes_and_too_little_memory_are_errors() {
        let s = scenery(64, F0, 1.0);
        let mut memory = vec![0; flash_position_bytes(64)];
        let small = LinearImage { size: 32, ..s.photo() };
        let arena = &mut Arena::new(&mut memory);
        assert!(matches!(
            flash_position(&small, &s.maps(), F0, &Inline, arena),
            Err(Error::PlaneLength { .. })
        ));
        let wide = LinearImage { fov_deg: 200.0, ..s.photo() };
        assert_eq!(flash_position(&wide, &s.maps(), F0, &Inline, arena), Err(Error::FieldOfView));
        let arena = &mut Arena::new(&mut memory[..1000]);
        let error = flash_position(&s.photo(), &s.maps(), F0, &Inline, arena);
        assert!(matches!(error, Err(Error::WorkspaceTooSmall { .. })), "{error:?}");
        assert_eq!(s.photo().fov_deg, FOV);
    }
}
