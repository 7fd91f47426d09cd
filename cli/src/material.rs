//! What a capture gives, owned: the material's maps and the facts around them.
use crate::engine::Timings;
use flashmat_core::maps::{Maps, MapsMut};
use flashmat_core::net::Class;
use glam::Vec3;

/// Owned maps; units as in [`Maps`].
#[derive(Clone, Debug)]
pub(crate) struct OwnedMaps {
    pub(crate) size: usize,
    pub(crate) albedo: Vec<f32>,
    pub(crate) normal: Vec<f32>,
    pub(crate) roughness: Vec<f32>,
}

impl OwnedMaps {
    pub(crate) fn view(&self) -> Maps<'_> {
        Maps { size: self.size, albedo: &self.albedo, normal: &self.normal, roughness: &self.roughness }
    }

    pub(crate) fn view_mut(&mut self) -> MapsMut<'_> {
        let Self { size, albedo, normal, roughness } = self;
        MapsMut { size: *size, albedo, normal, roughness }
    }
}

/// One photo's result.
#[derive(Clone, Debug)]
pub(crate) struct Material {
    pub(crate) maps: OwnedMaps,
    /// The photo as the network saw it: 3 planes, linear RGB.
    pub(crate) photo: Vec<f32>,
    /// The maps under the estimated flash and room, at the photo's exposure: 3 planes, linear RGB.
    pub(crate) render: Vec<f32>,
    /// Angle of view over the maps, in degrees.
    pub(crate) fov_deg: f32,
    pub(crate) class: Class,
    /// The class is the user's word, not the network's.
    pub(crate) class_given: bool,
    /// What the network believes, in the order of [`Class::ALL`].
    pub(crate) probabilities: [f32; Class::ALL.len()],
    /// Specular reflectance at normal incidence.
    pub(crate) f0: f32,
    /// The flash's strength times the photo's exposure.
    pub(crate) light_scale: f32,
    /// Where the flash is, in plane units: the plane is z = 0, the camera at (0,0,1).
    pub(crate) flash: Vec3,
    /// The room's even light as a share of the flash's, [0,1].
    pub(crate) room_light: f32,
    /// RMSE of re-render against photo, gamma 2.2, clipped pixels left out.
    pub(crate) residual: f32,
    pub(crate) timings_ms: Timings,
    pub(crate) workspace_bytes: usize,
    pub(crate) warnings: Vec<String>,
}

impl Material {
    /// The strength of a flash that alone makes the maps as bright as the photo at the centre.
    pub(crate) fn brightness(&self) -> f32 {
        self.light_scale * (1.0 + self.room_light)
    }

    /// The class and how sure it is, as in "wood 82 %".
    pub(crate) fn class_line(&self) -> String {
        let name = self.class.name();
        if self.class_given {
            return format!("{name} (as told)");
        }
        let p = self.probabilities.get(self.class as usize).copied().unwrap_or(0.0);
        format!("{name} {:.0} %", 100.0 * p)
    }
}
