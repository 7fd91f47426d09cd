//! Data sets of known materials: folders CLASS/NAME/ with maps, and perhaps a photo of them.
use crate::engine::light;
use crate::failure::Failure;
use crate::mapset;
use crate::material::OwnedMaps;
use crate::photo::{self, Photo};
use flashmat_core::brdf;
use flashmat_core::frame::{Encoding, FieldOfView};
use flashmat_core::net::Class;
use glam::Vec3;
use std::fs;
use std::path::{Path, PathBuf};

/// Field of view of photos that the data set does not hold itself.
pub(crate) const FOV: f32 = FieldOfView::TARGET_DEG;

/// One ground-truth material.
pub(crate) struct Item {
    pub(crate) class: Class,
    pub(crate) name: String,
    pub(crate) folder: PathBuf,
}

impl Item {
    /// Specular reflectance at normal incidence.
    pub(crate) fn f0(&self) -> f32 {
        brdf::f0(if self.class == Class::Metal { 1.0 } else { 0.0 })
    }
}

/// A material's maps and the photo to find them from.
pub(crate) struct Shot {
    pub(crate) truth: OwnedMaps,
    pub(crate) photo: Photo,
}

/// What `scene.json` says that matters here; other entries are left alone.
#[derive(serde::Deserialize)]
struct SceneFile {
    /// Radiance of the highest code of `environment.png`.
    environment_white: f32,
}

/// The materials of `dataset`, sorted by class and name.
pub(crate) fn items(dataset: &Path, split: Option<&str>) -> Result<Vec<Item>, Failure> {
    let wanted = split.map(|split| names_of_split(dataset, split)).transpose()?;
    // Reading the folder itself first tells a wrong path from an empty data set.
    fs::read_dir(dataset).map_err(|e| Failure::reading(dataset, &e))?;
    let mut items = Vec::new();
    for class in Class::ALL {
        let class_name = class.name();
        let Ok(entries) = fs::read_dir(dataset.join(class_name)) else { continue };
        for entry in entries {
            let folder = entry.map_err(|e| Failure::reading(dataset, &e))?.path();
            let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
            // A photo still being made has a folder that ends so.
            let half_made = name.ends_with(".part");
            let in_split = wanted.as_ref().is_none_or(|w| w.contains(&format!("{class_name}\t{name}")));
            if folder.is_dir() && in_split && !half_made {
                items.push(Item { class, name, folder });
            }
        }
    }
    items.sort_by(|a, b| (a.class as usize, &a.name).cmp(&(b.class as usize, &b.name)));
    if items.is_empty() {
        let help = format!(
            "give a folder of CLASS/NAME/ folders, the classes being {}",
            Class::ALL.map(Class::name).join(", ")
        );
        return Err(Failure::new(dataset, "holds no materials", help));
    }
    Ok(items)
}

/// "class<tab>name" of each material of a split.
fn names_of_split(dataset: &Path, split: &str) -> Result<Vec<String>, Failure> {
    let beside = dataset.join("splits.tsv");
    let above = dataset.join("..").join("splits.tsv");
    let path = if beside.is_file() { beside } else { above };
    let text = fs::read_to_string(&path).map_err(|e| Failure::reading(&path, &e))?;
    let ends = format!("\t{split}");
    Ok(text.lines().filter_map(|line| line.trim_end().strip_suffix(&ends).map(str::to_owned)).collect())
}

/// The material's maps at `size`, and its photo.
///
/// The photo is `photo.png` where there is one; otherwise, or with an `environment` strength, it is made here: the
/// core's own render under a flash of strength 1 at the camera, plus so much of `environment.png`, 8-bit sRGB.
pub(crate) fn shot(item: &Item, size: usize, environment: Option<f32>) -> Result<Shot, Failure> {
    let truth = mapset::read(&item.folder, Some(size))?;
    let taken = item.folder.join("photo.png");
    if environment.is_none() && taken.is_file() {
        return Ok(Shot { truth, photo: photo::read(&taken)? });
    }
    let failed = |e: flashmat_core::Error| Failure::core(&item.folder, &e);
    let mut radiance = light::relight(&truth, item.f0(), FOV, Vec3::Z, 1.0).map_err(failed)?;
    let strength = environment.unwrap_or(0.0);
    if strength > 0.0 {
        let around = ambient(&item.folder, size)?;
        radiance.iter_mut().zip(&around).for_each(|(sum, ambient)| *sum += strength * ambient);
    }
    Ok(Shot { truth, photo: Photo::of_radiance(&radiance, size).map_err(failed)? })
}

/// The radiance under the environment alone, at strength 1: 3 planes.
fn ambient(folder: &Path, size: usize) -> Result<Vec<f32>, Failure> {
    let path = folder.join("scene.json");
    let text = fs::read_to_string(&path).map_err(|e| Failure::reading(&path, &e))?;
    let help = "make the photos with `python -m flashmat_train testset`";
    let scene: SceneFile =
        serde_json::from_str(&text).map_err(|e| Failure::new(&path, e.to_string(), help))?;
    let path = folder.join("environment.png");
    let mut planes = mapset::planes(&photo::read_map(&path)?, Encoding::Linear, size)
        .map_err(|e| Failure::core(&path, &e))?;
    planes.iter_mut().for_each(|value| *value *= scene.environment_white);
    Ok(planes)
}
