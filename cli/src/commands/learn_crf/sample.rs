//! What the CRFs see of one photo: the network's maps, and what the refinement makes of them stage by stage.
//!
//! The same calls as the pipeline's stages (a test compares the bits), but with the results of each stage kept, so that
//! coefficients can be learned one CRF after the other, as they run.
use crate::dataset::{self, Item};
use crate::engine::{Engine, light};
use crate::failure::Failure;
use crate::interrupt;
use crate::material::OwnedMaps;
use flashmat_core::base::arena::Arena;
use flashmat_core::base::exec::Executor;
use flashmat_core::brdf::{self, Light};
use flashmat_core::crf::{self, Albedo, Coefficients, Energy, Normal, Roughness};
use flashmat_core::frame::{self, FieldOfView, LinearImage};
use flashmat_core::maps::MapsMut;
use flashmat_core::net::Class;
use flashmat_core::{Error, highlight, search};
use glam::Vec3;

/// Coefficients of all classes.
pub(super) type Sets = [Coefficients; Class::ALL.len()];

/// One step of [`highlight`]: photo, maps, F0, executor, workspace.
type HighlightStep =
    fn(&LinearImage<'_>, &mut MapsMut<'_>, f32, &dyn Executor, &mut Arena<'_>) -> Result<(), Error>;

/// The three CRFs in the order in which they run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stage {
    Albedo,
    Normal,
    Roughness,
}

impl Stage {
    pub(super) const ALL: [Self; 3] = [Self::Albedo, Self::Normal, Self::Roughness];

    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Albedo => "albedo",
            Self::Normal => "normal",
            Self::Roughness => "roughness",
        }
    }
}

/// A photo as the pipeline sees it.
struct Photo {
    size: usize,
    rgb: Vec<f32>,
    clipped: Vec<u8>,
    fov_deg: f32,
    light_scale: Option<f32>,
    flash: Vec3,
}

impl Photo {
    fn image(&self) -> LinearImage<'_> {
        let photo = LinearImage::new(self.size, &self.rgb, &self.clipped, self.fov_deg);
        LinearImage { light_scale: self.light_scale, flash: self.flash, ..photo }
    }
}

/// One photo, its true maps, and what is known of it so far.
pub(super) struct Sample {
    pub(super) truth: OwnedMaps,
    /// The network's maps, the albedo filled in below highlights.
    pub(super) first: OwnedMaps,
    /// What the classifier believes: the coefficients are mixed with it.
    pub(super) probabilities: [f32; Class::ALL.len()],
    photo: Photo,
    f0: f32,
    /// As a capture has them; the network's until [`Sample::advance`] has refined them.
    pub(super) refined: OwnedMaps,
    searched: Vec<f32>,
    observability: Vec<f32>,
}

impl Sample {
    /// Runs the network (`engine` must not refine, and knows the same light scale) on the item's photo.
    pub(super) fn new(
        engine: &mut Engine<'_>,
        item: &Item,
        size: usize,
        light_scale: Option<f32>,
    ) -> Result<Self, Failure> {
        let failed = |e: Error| Failure::core(&item.folder, &e);
        let shot = dataset::shot(item, size, None)?;
        let found = engine.capture(&shot.photo, &mut |_, _| interrupt::flow()).map_err(failed)?;
        let clipped = clipped(&shot.photo, size).map_err(failed)?;
        let f0 = brdf::f0(found.probabilities.get(Class::Metal as usize).copied().unwrap_or(0.0));
        let mut refined = found.maps.clone();
        let photo = Photo {
            size,
            rgb: found.photo,
            clipped,
            fov_deg: found.fov_deg,
            light_scale,
            flash: found.flash,
        };
        below_highlights(highlight::restore, &photo, &mut refined, f0).map_err(failed)?;
        Ok(Self {
            truth: shot.truth,
            first: OwnedMaps { albedo: refined.albedo.clone(), ..found.maps },
            probabilities: found.probabilities,
            photo,
            f0,
            refined,
            searched: Vec::new(),
            observability: Vec::new(),
        })
    }

    /// Bytes of workspace for any of the CRFs.
    pub(super) fn workspace(size: usize) -> Vec<u8> {
        vec![0; crf::max_workspace_bytes(size)]
    }

    pub(super) fn albedo_energy(&self) -> Albedo<'_> {
        Albedo { size: self.truth.size, photo: &self.photo.rgb, albedo: &self.first.albedo }
    }

    pub(super) fn normal_energy(&self) -> Normal<'_> {
        Normal { size: self.truth.size, normal: &self.first.normal, albedo: &self.refined.albedo }
    }

    pub(super) fn roughness_energy(&self) -> Roughness<'_> {
        Roughness {
            size: self.truth.size,
            photo: &self.photo.rgb,
            albedo: &self.refined.albedo,
            network: &self.first.roughness,
            search: &self.searched,
            observability: Some(&self.observability),
        }
    }

    /// The map of `stage` as its CRF, with the mixture of `sets`, leaves it: the coefficients are learned from this.
    pub(super) fn crf(&self, stage: Stage, sets: &Sets, workspace: &mut [u8]) -> Result<Vec<f32>, Error> {
        let mixed = Coefficients::mixed(sets, &self.probabilities);
        match stage {
            Stage::Albedo => refine(&self.albedo_energy(), &mixed.albedo, workspace),
            Stage::Normal => refine(&self.normal_energy(), &mixed.normal, workspace),
            Stage::Roughness => refine(&self.roughness_energy(), &mixed.roughness, workspace),
        }
    }

    /// Keeps the refined map of `stage`, filled in below highlights, for the stages after it; after the normals the
    /// roughness is searched.
    pub(super) fn advance(&mut self, stage: Stage, sets: &Sets, workspace: &mut [u8]) -> Result<(), Error> {
        let map = self.crf(stage, sets, workspace)?;
        let step: HighlightStep = match stage {
            Stage::Albedo => {
                self.refined.albedo = map;
                highlight::retexture
            }
            Stage::Normal => {
                self.refined.normal = map;
                return self.search();
            }
            Stage::Roughness => {
                self.refined.roughness = map;
                highlight::level_roughness
            }
        };
        below_highlights(step, &self.photo, &mut self.refined, self.f0)
    }

    /// Before the roughness is refined.
    fn search(&mut self) -> Result<(), Error> {
        let (photo, maps) = (self.photo.image(), &self.refined);
        let render = light::relight(maps, self.f0, photo.fov_deg, photo.flash, 1.0)?;
        let strength = search::light_scale(&photo, &render, &super::fast())?;
        let pixels = photo.size * photo.size;
        let (mut roughness, mut observability) = (vec![0.0; pixels], vec![0.0; pixels]);
        search::roughness(
            &photo,
            &maps.albedo,
            &maps.normal,
            self.f0,
            &Light { position: photo.flash, strength },
            &super::fast(),
            &mut roughness,
            &mut observability,
        )?;
        (self.searched, self.observability) = (roughness, observability);
        Ok(())
    }
}

/// One of the highlight's steps over the maps as refined so far, in place.
fn below_highlights(step: HighlightStep, photo: &Photo, maps: &mut OwnedMaps, f0: f32) -> Result<(), Error> {
    let bytes = highlight::workspace_bytes(photo.size)
        .max(highlight::retexture_bytes(photo.size))
        .max(highlight::level_roughness_bytes(photo.size));
    step(&photo.image(), &mut maps.view_mut(), f0, &super::fast(), &mut Arena::new(&mut vec![0; bytes]))
}

/// Where the photo, as the pipeline sees it, is clipped.
fn clipped(photo: &crate::photo::Photo, size: usize) -> Result<Vec<u8>, Error> {
    let frame = photo.frame(frame::Encoding::Srgb)?;
    let mut bytes = vec![0_u8; frame::prepare_bytes(size)];
    let image =
        frame::prepare(&frame, size, &FieldOfView::default(), &super::fast(), &mut Arena::new(&mut bytes))?;
    Ok(image.clipped.to_vec())
}

fn refine<E: Energy<N>, const N: usize>(
    energy: &E,
    coefficients: &[f32; N],
    workspace: &mut [u8],
) -> Result<Vec<f32>, Error> {
    let mut out = energy.unary(0).to_vec();
    let options = crf::Options::default();
    crf::refine(energy, coefficients, &options, &mut out, &super::fast(), &mut Arena::new(workspace))?;
    Ok(out)
}
