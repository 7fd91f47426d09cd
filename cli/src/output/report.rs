//! `report.json`: what was found, in which photo, with which model, how long it took. The fields are a contract:
//! `docs/report.md`, and `docs/report.schema.json` for programs.
use super::owner::{FILES, Source};
use crate::engine::{Facts, Timings};
use crate::material::Material;
use glam::Vec3;
use serde::{Deserialize, Serialize};
use std::io::{self, Write};

/// The schema's version: it grows when a field goes or changes its meaning, not when one is added.
const SCHEMA: u32 = 1;

/// The whole report.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Report {
    /// Version of the schema; 0 in reports that did not say.
    #[serde(default)]
    pub(crate) schema: u32,
    /// Version of the program.
    pub(crate) version: String,
    /// The photo file; older reports do not name it.
    #[serde(default)]
    pub(crate) photo: Option<Source>,
    /// Names of the files of this result, this one included.
    #[serde(default)]
    pub(crate) files: Vec<String>,
    pub(crate) model: ModelName,
    /// Pixels per side of the maps.
    pub(crate) size: usize,
    pub(crate) class: Class,
    pub(crate) light_scale: f32,
    /// Where the flash is, in plane units: the plane is z = 0, the camera at (0,0,1).
    #[serde(default = "default_flash")]
    pub(crate) flash: [f32; 3],
    /// The room's even light as a share of the flash's at the centre, [0,1].
    #[serde(default)]
    pub(crate) room_light: f32,
    /// RMSE of the re-render against the photo, gamma 2.2, clipped pixels left out.
    pub(crate) residual: f32,
    /// Angle of view over the maps, in degrees.
    #[serde(default = "default_fov")]
    pub(crate) fov_deg: f32,
    /// Specular reflectance at normal incidence that the re-render used.
    #[serde(default = "default_f0")]
    pub(crate) f0: f32,
    pub(crate) timings_ms: Timings,
    pub(crate) workspace_bytes: usize,
    pub(crate) engine: String,
    pub(crate) level: String,
    pub(crate) warnings: Vec<String>,
}

/// Which model it was.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct ModelName {
    pub(crate) name: String,
    /// SHA-256 of the model file, in hexadecimal.
    pub(crate) hash: String,
}

/// The material class.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Class {
    pub(crate) name: String,
    pub(crate) probabilities: Probabilities,
}

/// One probability for each class, in the network's order.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct Probabilities {
    fabric: f32,
    ground: f32,
    leather: f32,
    metal: f32,
    stone_diff: f32,
    stone_spec: f32,
    polymer: f32,
    wood: f32,
}

impl From<[f32; 8]> for Probabilities {
    fn from([fabric, ground, leather, metal, stone_diff, stone_spec, polymer, wood]: [f32; 8]) -> Self {
        Self { fabric, ground, leather, metal, stone_diff, stone_spec, polymer, wood }
    }
}

fn default_fov() -> f32 {
    flashmat_core::frame::FieldOfView::TARGET_DEG
}

/// At the camera.
fn default_flash() -> [f32; 3] {
    Vec3::Z.to_array()
}

fn default_f0() -> f32 {
    flashmat_core::brdf::F0_DIELECTRIC
}

impl Report {
    /// The report of `material`, found in the photo `source` by an engine with the given `facts`.
    pub(crate) fn new(material: &Material, facts: &Facts, source: &Source) -> Self {
        Self {
            schema: SCHEMA,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            photo: Some(source.clone()),
            files: FILES.map(str::to_owned).into(),
            model: ModelName { name: facts.model_name.clone(), hash: facts.model_hash.clone() },
            size: material.maps.size,
            class: Class {
                name: material.class.name().to_owned(),
                probabilities: material.probabilities.into(),
            },
            light_scale: material.light_scale,
            flash: material.flash.to_array(),
            room_light: material.room_light,
            residual: material.residual,
            fov_deg: material.fov_deg,
            f0: material.f0,
            timings_ms: material.timings_ms,
            workspace_bytes: material.workspace_bytes,
            engine: facts.engine.to_owned(),
            level: facts.level.to_owned(),
            warnings: material.warnings.clone(),
        }
    }

    /// Writes the report as indented JSON.
    pub(crate) fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        serde_json::to_writer_pretty(&mut *out, self)?;
        out.write_all(b"\n")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use flashmat_core::net::Class;

    #[test]
    fn probabilities_keep_the_names_and_the_order_of_the_classes() {
        let p = Probabilities::from([0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7]);
        let text = serde_json::to_string(&p).expect("json");
        let wanted: Vec<_> =
            Class::ALL.iter().zip(0..).map(|(c, i)| format!("\"{}\":0.{i}", c.name())).collect();
        assert_eq!(text, format!("{{{}}}", wanted.join(",")));
        assert_eq!(serde_json::from_str::<Probabilities>(&text).expect("json"), p);
    }
}
