//! Doors for the fuzzers of `fuzz/`, which cannot reach private modules. No interface: they change with the program.
use crate::engine::{Facts, Timings};
use crate::material::{Material, OwnedMaps};
use crate::output::{self, owner::Source, report::Report};
use crate::photo::{self, Pixels};
use flashmat_core::net::Class;
use glam::Vec3;
use std::io;
use std::path::Path;

/// Reads the photo file at `path` and checks what the rest of the program takes for granted.
///
/// `Err` holds what the user would be told.
///
/// # Errors
/// As the program: the file is no photo, or a broken one.
pub fn read_photo(path: &Path) -> Result<(), String> {
    let photo = photo::read(path).map_err(|failure| failure.to_string())?;
    let (width, height) = (photo.width as usize, photo.height as usize);
    assert!(photo.width.min(photo.height) >= photo::MIN_SIDE, "{width} x {height} is below the least size");
    let values = match &photo.pixels {
        Pixels::Rgb8(pixels) => pixels.len(),
        Pixels::Rgb16(pixels) => pixels.len(),
        Pixels::RgbF32(pixels) => pixels.len(),
    };
    assert_eq!(values, 3 * width * height, "{width} x {height} pixels");
    if let Some(mm) = photo.focal_35mm {
        assert!(flashmat_core::frame::FOCAL_35MM.contains(&mm), "focal length {mm}");
    }
    Ok(())
}

/// A material to write: `planes` are albedo, normals and roughness, seven planes of `size` x `size`.
#[derive(Clone, Debug)]
pub struct Sample {
    /// The material's name.
    pub name: String,
    /// Pixels per side.
    pub size: usize,
    /// Albedo, normals, roughness.
    pub planes: Vec<f32>,
    /// F0, field of view in degrees, light scale, room light, residual, milliseconds.
    pub facts: [f32; 6],
    /// What the report warns of; the first also names the model.
    pub warnings: Vec<String>,
}

/// The files of [`Sample`], by name.
pub type Files = Vec<(&'static str, Vec<u8>)>;

/// Writes what `capture` writes: maps in 8 and 16 bits, GLB, report, and, if asked, the sheet.
///
/// # Errors
/// As the writers.
pub fn write(sample: &Sample, sheet: bool) -> io::Result<Files> {
    let plane = sample.size * sample.size;
    let [f0, fov_deg, light_scale, room_light, residual, time] = sample.facts;
    let maps = OwnedMaps {
        size: sample.size,
        albedo: sample.planes[..3 * plane].to_vec(),
        normal: sample.planes[3 * plane..6 * plane].to_vec(),
        roughness: sample.planes[6 * plane..7 * plane].to_vec(),
    };
    let material = Material {
        photo: maps.albedo.clone(),
        render: maps.albedo.clone(),
        maps,
        fov_deg,
        class: Class::Wood,
        class_given: false,
        probabilities: [0.125; Class::ALL.len()],
        f0,
        light_scale,
        flash: Vec3::new(room_light, residual, 1.0),
        room_light,
        residual,
        timings_ms: Timings { total: f64::from(time), ..Timings::default() },
        workspace_bytes: plane,
        warnings: sample.warnings.clone(),
    };
    let facts = Facts {
        model_name: sample.warnings.first().cloned().unwrap_or_default(),
        model_hash: String::new(),
        engine: "int8",
        level: "scalar",
    };
    let source = Source { path: sample.name.clone(), bytes: 1, sha256: String::new(), stamp: None };
    output::in_memory(&sample.name, &material, &facts, &source, sheet)
}

/// Reads a report as `render` does and writes it again; none: it is no report.
#[must_use]
pub fn rewrite_report(bytes: &[u8]) -> Option<Vec<u8>> {
    let report: Report = serde_json::from_slice(bytes).ok()?;
    let mut again = Vec::new();
    report.write(&mut again).ok()?;
    Some(again)
}
