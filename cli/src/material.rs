//! What a capture gives, owned: the material's maps and the facts around them.
use crate::engine::Timings;
use flashmat_core::maps::Maps;

/// The eight class names, in the order of the probabilities.
pub(crate) const CLASSES: [&str; 8] =
    ["fabric", "ground", "leather", "metal", "stone-diff", "stone-spec", "polymer", "wood"];
/// Index of metal in [`CLASSES`].
pub(crate) const METAL: usize = 3;

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
}

/// One photo's result.
#[derive(Clone, Debug)]
pub(crate) struct Material {
    pub(crate) maps: OwnedMaps,
    /// The photo as the network saw it: 3 planes, linear RGB.
    pub(crate) photo: Vec<f32>,
    /// The maps under the estimated flash, at the photo's exposure: 3 planes, linear RGB.
    pub(crate) render: Vec<f32>,
    /// Angle of view over the maps, in degrees.
    pub(crate) fov_deg: f32,
    /// Index into [`CLASSES`].
    pub(crate) class: usize,
    pub(crate) probabilities: [f32; 8],
    pub(crate) light_scale: f32,
    /// RMSE of re-render against photo, gamma 2.2, clipped pixels left out.
    pub(crate) residual: f32,
    pub(crate) timings_ms: Timings,
    pub(crate) workspace_bytes: usize,
    pub(crate) warnings: Vec<String>,
}

impl Material {
    /// Name of the class.
    pub(crate) fn class_name(&self) -> &'static str {
        CLASSES.get(self.class).copied().unwrap_or("unknown")
    }

    /// Probability of metal.
    pub(crate) fn metal(&self) -> f32 {
        self.probabilities.get(METAL).copied().unwrap_or(0.0)
    }
}
