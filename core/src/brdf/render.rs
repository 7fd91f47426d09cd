//! The flash renderer: maps on the plane z = 0, seen from (0,0,1), lit by one point light.
//!
//! Radiance = f (n.l) E with E = pi strength / dist². The light's strength 1 is the one that gives a flat white
//! Lambertian under the default flash radiance 1 at the image's centre. No cosine at the light, no second bounce,
//! no shadows: the plane's relief is in its normals alone.
use super::Angles;
use crate::Error;
use crate::base::exec::{Executor, ROWS_PER_BLOCK, for_each_row_block, planes3};
use crate::base::lanes::{LANES, Lanes, load, load3, store};
use crate::base::math::approx::rsqrt;
use crate::base::planes::{check_planes, plane_row};
use crate::frame::LinearImage;
use crate::frame::geometry::Geometry;
use crate::maps::Maps;
use core::f32::consts::PI;
use glam::Vec3;

/// A white point light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Position in plane units: the plane is z = 0, the camera at (0,0,1).
    pub position: Vec3,
    /// Strength; see the module's description.
    pub strength: f32,
}

impl Default for Light {
    /// The flash: at the camera, strength 1.
    fn default() -> Self {
        Self { position: Vec3::Z, strength: 1.0 }
    }
}

/// Camera and light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scene {
    /// Field of view over the square, in degrees; the camera is at (0,0,1).
    pub fov_deg: f32,
    /// The light.
    pub light: Light,
}

impl Scene {
    /// A flash at the camera, of the given strength.
    #[must_use]
    pub fn flash(fov_deg: f32, strength: f32) -> Self {
        Self { fov_deg, light: Light { strength, ..Light::default() } }
    }

    /// The scene of a photo: its field of view, and its flash at strength 1.
    #[must_use]
    pub fn of(photo: &LinearImage<'_>) -> Self {
        Self { fov_deg: photo.fov_deg, light: Light { position: photo.flash, strength: 1.0 } }
    }

    pub(crate) fn check(&self) -> Result<(), Error> {
        let Light { position, strength } = self.light;
        if !(position.is_finite() && position.z > 0.0 && strength.is_finite() && strength >= 0.0) {
            return Err(Error::LightBelowPlane);
        }
        if (1.0..=170.0).contains(&self.fov_deg) { Ok(()) } else { Err(Error::FieldOfView) }
    }
}

/// Light that reaches a point of the plane, and where from.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Incident {
    pub(crate) light: Vec3,
    pub(crate) view: Vec3,
    /// E = pi strength / dist².
    pub(crate) irradiance: f32,
}

impl Incident {
    #[inline(always)]
    pub(crate) fn at(point: Vec3, light: &Light) -> Self {
        let (to_light, to_camera) = (light.position - point, Vec3::Z - point);
        let dist2 = to_light.length_squared();
        Self {
            light: to_light * rsqrt(dist2),
            view: to_camera * rsqrt(to_camera.length_squared()),
            irradiance: PI * light.strength / dist2,
        }
    }
}

/// Renders `maps` into `out`: 3 planes, linear RGB radiance, not clamped. F0 is one value for the whole material.
///
/// # Errors
/// [`Error::PlaneLength`] and [`Error::Size`] when maps or `out` do not fit, [`Error::LightBelowPlane`],
/// [`Error::FieldOfView`].
pub fn render(
    maps: &Maps<'_>,
    f0: f32,
    scene: &Scene,
    exec: &dyn Executor,
    out: &mut [f32],
) -> Result<(), Error> {
    maps.check()?;
    scene.check()?;
    let n = maps.size;
    check_planes(n, 3, out.len())?;
    let geometry = Geometry::new(n, scene.fov_deg);
    for_each_row_block(exec, n, ROWS_PER_BLOCK, planes3(out, n, n), &|range, [mut r, mut g, mut b]| {
        exec.simd().run(
            #[inline(always)]
            || {
                for (row, ((r, g), b)) in range.zip(r.rows().zip(g.rows()).zip(b.rows())) {
                    for start in (0..n).step_by(LANES) {
                        let [red, green, blue] = run(maps, f0, &geometry, &scene.light, row, start);
                        store(&red, r, start);
                        store(&green, g, start);
                        store(&blue, b, start);
                    }
                }
            },
        );
    });
    Ok(())
}

/// The radiance of a run of pixels.
#[inline(always)]
fn run(maps: &Maps<'_>, f0: f32, geometry: &Geometry, light: &Light, row: usize, start: usize) -> [Lanes; 3] {
    let n = maps.size;
    let albedo = load3(maps.albedo, n, row, start);
    let normal = load3(maps.normal, n, row, start);
    let roughness = load(plane_row(maps.roughness, n, row), start);
    let mut out = [[0.0; LANES]; 3];
    for i in 0..LANES {
        let at = Incident::at(geometry.point(row, start + i), light);
        let normal = Vec3::new(normal[0][i], normal[1][i], normal[2][i]);
        let (angles, lit) = Angles::anyhow(normal, at.light, at.view);
        let specular = angles.specular(roughness[i], f0);
        let factor = angles.n_dot_l * at.irradiance;
        for c in 0..3 {
            let radiance = (albedo[c][i] * (1.0 / PI) + specular) * factor;
            out[c][i] = if lit { radiance } else { 0.0 };
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::exec::Inline;
    use std::vec;
    use std::vec::Vec;

    struct Flat {
        albedo: Vec<f32>,
        normal: Vec<f32>,
        roughness: Vec<f32>,
    }

    impl Flat {
        fn new(n: usize, albedo: f32, roughness: f32) -> Self {
            let mut normal = vec![0.0; 3 * n * n];
            normal[2 * n * n..].fill(1.0);
            Self { albedo: vec![albedo; 3 * n * n], normal, roughness: vec![roughness; n * n] }
        }

        fn render(&self, n: usize, f0: f32, scene: &Scene) -> Result<Vec<f32>, Error> {
            let maps =
                Maps { size: n, albedo: &self.albedo, normal: &self.normal, roughness: &self.roughness };
            let mut out = vec![f32::NAN; 3 * n * n];
            render(&maps, f0, scene, &Inline, &mut out).map(|()| out)
        }
    }

    #[test]
    fn white_lambertian_under_the_flash_is_white_at_the_centre() {
        let out = Flat::new(1, 1.0, 1.0).render(1, 0.0, &Scene::flash(43.35, 1.0)).expect("scene");
        // What is left of the specular term at F0 = 0: 2^-12.53789 / 4.
        assert!((out[0] - 1.0 - 1.681_757e-4 / 4.0).abs() < 1e-6, "{}", out[0]);
    }

    #[test]
    fn a_corner_by_hand() {
        // n = 2, 90 degrees: pixel (0,0) is the point (-0.5, 0.5, 0); dist² = 1.5, l = v = (0.5,-0.5,1)/sqrt(1.5),
        // n.l = 1/sqrt(1.5) = 0.8164966, n.h the same. Strength 2, r = 1: D = 1/pi, F = 0.0501598,
        // G1/n.v = 1/(0.9082483) each, specular = 0.0501598/(4 pi) * 1.2122501.
        // radiance = (0.5 + 0.0501598/4 * 1.2122501) * 0.8164966 * 2/1.5 = 0.5608807.
        let out = Flat::new(2, 0.5, 1.0).render(2, 0.05, &Scene::flash(90.0, 2.0)).expect("scene");
        assert!((out[0] - 0.560_880_7).abs() < 2e-6, "{}", out[0]);
        // All four corners are alike.
        assert!(out.iter().all(|v| (v - out[0]).abs() < 1e-6));
    }

    #[test]
    fn the_lit_side_is_the_light_s_side() {
        let light = Light { position: Vec3::new(0.4, 0.3, 0.5), strength: 1.0 };
        let out = Flat::new(8, 0.8, 0.7).render(8, 0.05, &Scene { fov_deg: 43.35, light }).expect("scene");
        assert!(out[7] > out[0] && out[7] > out[63] && out[7] > out[56], "top right is brightest");
    }

    #[test]
    fn misuse_is_an_error() {
        let flat = Flat::new(2, 0.5, 0.5);
        let below = Light { position: Vec3::new(0.0, 0.0, -0.1), strength: 1.0 };
        assert_eq!(flat.render(2, 0.05, &Scene { fov_deg: 43.0, light: below }), Err(Error::LightBelowPlane));
        assert_eq!(flat.render(2, 0.05, &Scene::flash(f32::NAN, 1.0)), Err(Error::FieldOfView));
        assert_eq!(
            flat.render(3, 0.05, &Scene::flash(43.0, 1.0)),
            Err(Error::PlaneLength { needed: 27, given: 12 })
        );
    }

    #[cfg(feature = "parallel")]
    #[test]
    fn threads_do_not_change_a_bit() {
        let n = 37;
        let flat = Flat::new(n, 0.3, 0.4);
        let maps = Maps { size: n, albedo: &flat.albedo, normal: &flat.normal, roughness: &flat.roughness };
        let inline = flat.render(n, 0.05, &Scene::flash(43.35, 1.0)).expect("scene");
        let pool = crate::base::exec::Pool::new(3).expect("threads");
        let mut out = vec![0.0; 3 * n * n];
        render(&maps, 0.05, &Scene::flash(43.35, 1.0), &pool, &mut out).expect("scene");
        assert_eq!(out, inline);
    }
}
