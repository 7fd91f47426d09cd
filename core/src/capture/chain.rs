//! What is known of one photo, and a method for each stage that adds to it.
//!
//! A refined map takes the place of the network's. Without refinement only the network, the flash and the re-render do
//! anything, and the maps stay as the network has them. Large photos are refined smaller (`reduced`).
use super::reduced::{crf_size, refine_at};
use super::{Capture, CaptureOptions, SolverReports, Steps};
use crate::Error;
use crate::base::arena::Arena;
use crate::base::exec::{Executor, Watch, within};
use crate::base::resample::shrunk;
use crate::brdf::{self, Light, Scene};
use crate::crf::{self, Albedo, Coefficients, Energy, Normal, Roughness};
use crate::frame::{self, Frame, LinearImage};
use crate::maps::{Maps, MapsMut};
use crate::net::{Class, ClassProbabilities, Classification, Inference, Mixing};
use crate::search::{self, Lights};
use crate::{Observer, highlight};

/// One photo on its way through the stages; all slices lie in the workspace.
pub(super) struct Chain<'a> {
    options: CaptureOptions,
    photo: LinearImage<'a>,
    maps: MapsMut<'a>,
    classification: Classification,
    f0: f32,
    coefficients: Coefficients,
    /// The search's roughness, and how much each pixel says of it.
    searched: &'a mut [f32],
    observability: &'a mut [f32],
    solver: SolverReports,
    render: &'a mut [f32],
    lights: Lights,
    residual: f32,
}

impl<'a> Chain<'a> {
    /// The photo, upright, square and linear, and memory for its maps.
    pub(super) fn frame(
        frame: &Frame<'_>,
        size: usize,
        options: &CaptureOptions,
        exec: &dyn Executor,
        arena: &mut Arena<'a>,
    ) -> Result<Self, Error> {
        let photo = frame::prepare(frame, size, &options.fov, exec, arena)?;
        let exposure = search::check_exposure(&photo, exec)?;
        let plane = size * size;
        Ok(Self {
            options: *options,
            photo: LinearImage { exposure, light_scale: options.light_scale, ..photo },
            maps: MapsMut {
                size,
                albedo: arena.take(3 * plane)?,
                normal: arena.take(3 * plane)?,
                roughness: arena.take(plane)?,
            },
            classification: Mixing::only(options.class).classification(ClassProbabilities::UNIFORM),
            f0: brdf::f0(0.0),
            coefficients: Coefficients::default(),
            searched: &mut [],
            observability: &mut [],
            solver: SolverReports::default(),
            render: &mut [],
            lights: Lights::default(),
            residual: 0.0,
        })
    }

    /// First maps and class, and what follows from the class: F0 and the CRFs' coefficients.
    pub(super) fn global(
        &mut self,
        inference: &dyn Inference,
        exec: &dyn Executor,
        arena: &mut Arena<'a>,
        observer: &mut dyn Observer,
    ) -> Result<(), Error> {
        let mixing = Mixing::only(self.options.class);
        self.classification = inference.infer(&self.photo, mixing, exec, arena, &mut self.maps, observer)?;
        let used = &self.classification.used;
        let sets = Class::ALL.map(|class| Coefficients::from_array(&inference.model().crf(class)));
        self.coefficients = Coefficients::mixed(&sets, &used.0);
        self.f0 = brdf::f0(used.of(Class::Metal));
        Ok(())
    }

    /// The flash, where these maps say that it is.
    pub(super) fn flash(&mut self, exec: &dyn Executor, arena: &mut Arena<'a>) -> Result<(), Error> {
        self.photo.flash = search::flash_position(&self.photo, &self.maps.as_maps(), self.f0, exec, arena)?;
        Ok(())
    }

    /// Albedo below highlights.
    pub(super) fn highlight(&mut self, exec: &dyn Executor, arena: &mut Arena<'a>) -> Result<(), Error> {
        if !self.options.refine {
            return Ok(());
        }
        highlight::restore(&self.photo, &mut self.maps, self.f0, exec, arena)
    }

    /// The albedo's CRF.
    pub(super) fn albedo(
        &mut self,
        exec: &dyn Executor,
        arena: &mut Arena<'a>,
        steps: &mut Steps<'_>,
    ) -> Result<(), Error> {
        if !self.options.refine {
            return Ok(());
        }
        let (n, m) = (self.maps.size, crf_size(self.maps.size));
        let (coefficients, options) = (&self.coefficients.albedo, &self.options.solver);
        let watch: Watch<'_> = &mut steps.rest(0.0);
        self.solver[0] = if m < n {
            let mut arena = arena.scope();
            let photo = shrunk(self.photo.rgb, n, m, exec, &mut arena)?;
            let albedo = shrunk(self.maps.albedo, n, m, exec, &mut arena)?;
            let energy = Albedo { size: m, photo, albedo };
            refine_at(&energy, coefficients, options, (self.maps.albedo, n), exec, &mut arena, watch)?
        } else {
            let energy = Albedo { size: n, photo: self.photo.rgb, albedo: self.maps.albedo };
            let (albedo, report) = refined(&energy, coefficients, options, exec, arena, watch)?;
            self.maps.albedo = albedo;
            report
        };
        Ok(())
    }

    /// Texture that burnt out.
    pub(super) fn texture(&mut self, exec: &dyn Executor, arena: &mut Arena<'a>) -> Result<(), Error> {
        if !self.options.refine {
            return Ok(());
        }
        highlight::retexture(&self.photo, &mut self.maps, self.f0, exec, arena)
    }

    /// The normals' CRF.
    pub(super) fn normal(
        &mut self,
        exec: &dyn Executor,
        arena: &mut Arena<'a>,
        steps: &mut Steps<'_>,
    ) -> Result<(), Error> {
        if !self.options.refine {
            return Ok(());
        }
        let (n, m) = (self.maps.size, crf_size(self.maps.size));
        let (coefficients, options) = (&self.coefficients.normal, &self.options.solver);
        let watch: Watch<'_> = &mut steps.rest(0.0);
        self.solver[1] = if m < n {
            let mut arena = arena.scope();
            let normal = shrunk(self.maps.normal, n, m, exec, &mut arena)?;
            let albedo = shrunk(self.maps.albedo, n, m, exec, &mut arena)?;
            let energy = Normal { size: m, normal, albedo };
            refine_at(&energy, coefficients, options, (self.maps.normal, n), exec, &mut arena, watch)?
        } else {
            let energy = Normal { size: n, normal: self.maps.normal, albedo: self.maps.albedo };
            let (normal, report) = refined(&energy, coefficients, options, exec, arena, watch)?;
            self.maps.normal = normal;
            report
        };
        Ok(())
    }

    /// The roughness that explains the photo best, pixel by pixel, under the light that explains it best.
    pub(super) fn search(
        &mut self,
        exec: &dyn Executor,
        arena: &mut Arena<'a>,
        steps: &mut Steps<'_>,
    ) -> Result<(), Error> {
        let size = self.maps.size;
        if !self.options.refine {
            self.observability = arena.zeroed(size * size)?;
            return Ok(());
        }
        self.searched = arena.take(size * size)?;
        self.observability = arena.take(size * size)?;
        let mut scope = arena.scope();
        let render = scope.take::<f32>(3 * size * size)?;
        let (photo, f0, scene) = (&self.photo, self.f0, Scene::of(&self.photo));
        let maps = self.maps.as_maps();
        let strength = within(exec, || {
            brdf::render(&maps, f0, &scene, exec, render)?;
            search::light_scale(photo, render, exec)
        })?;
        steps.at(0.2)?;
        let light = Light { strength, ..scene.light };
        let out = (&mut *self.searched, &mut *self.observability);
        let watch: Watch<'_> = &mut steps.rest(0.2);
        search::roughness_watched(photo, (maps.albedo, maps.normal), f0, &light, exec, out, watch)
    }

    /// The roughness' CRF.
    pub(super) fn roughness(
        &mut self,
        exec: &dyn Executor,
        arena: &mut Arena<'a>,
        steps: &mut Steps<'_>,
    ) -> Result<(), Error> {
        if !self.options.refine {
            return Ok(());
        }
        let (n, m) = (self.maps.size, crf_size(self.maps.size));
        let (coefficients, options) = (&self.coefficients.roughness, &self.options.solver);
        let watch: Watch<'_> = &mut steps.rest(0.0);
        self.solver[2] = if m < n {
            // Where a pixel says nothing of its roughness, what the search found there means nothing.
            self.searched.iter_mut().zip(&*self.observability).for_each(|(found, seen)| *found *= seen);
            let mut arena = arena.scope();
            let photo = shrunk(self.photo.rgb, n, m, exec, &mut arena)?;
            let albedo = shrunk(self.maps.albedo, n, m, exec, &mut arena)?;
            let network = shrunk(self.maps.roughness, n, m, exec, &mut arena)?;
            let seen = shrunk(self.observability, n, m, exec, &mut arena)?;
            let search = shrunk(self.searched, n, m, exec, &mut arena)?;
            search.iter_mut().zip(&*seen).for_each(|(found, seen)| *found /= seen.max(1e-6));
            let energy = Roughness { size: m, photo, albedo, network, search, observability: Some(seen) };
            refine_at(&energy, coefficients, options, (self.maps.roughness, n), exec, &mut arena, watch)?
        } else {
            let energy = Roughness {
                size: n,
                photo: self.photo.rgb,
                albedo: self.maps.albedo,
                network: self.maps.roughness,
                search: self.searched,
                observability: Some(self.observability),
            };
            let (roughness, report) = refined(&energy, coefficients, options, exec, arena, watch)?;
            self.maps.roughness = roughness;
            report
        };
        Ok(())
    }

    /// Roughness below highlights.
    pub(super) fn level(&mut self, exec: &dyn Executor, arena: &mut Arena<'a>) -> Result<(), Error> {
        if !self.options.refine {
            return Ok(());
        }
        highlight::level_roughness(&self.photo, &mut self.maps, self.f0, exec, arena)
    }

    /// The maps as the photo saw them, and how far from it they are.
    pub(super) fn relight(
        &mut self,
        exec: &dyn Executor,
        arena: &mut Arena<'a>,
        steps: &mut Steps<'_>,
    ) -> Result<(), Error> {
        let size = self.maps.size;
        self.render = arena.take(3 * size * size)?;
        let (photo, maps, render) = (&self.photo, self.maps.as_maps(), &mut *self.render);
        within(exec, || brdf::render(&maps, self.f0, &Scene::of(photo), exec, render))?;
        steps.at(0.5)?;
        self.lights = within(exec, || search::lights(photo, render, maps.albedo, exec))?;
        steps.at(0.75)?;
        for (value, albedo) in render.iter_mut().zip(maps.albedo) {
            *value = self.lights.flash * (*value + self.lights.room * albedo);
        }
        self.residual = within(exec, || search::residual(photo, render, exec))?;
        Ok(())
    }

    /// The result, when all stages are done.
    pub(super) fn capture(self) -> Capture<'a> {
        let MapsMut { size, albedo, normal, roughness } = self.maps;
        let Classification { predicted, .. } = self.classification;
        Capture {
            maps: Maps { size, albedo, normal, roughness },
            photo: self.photo,
            residual: self.residual,
            render: self.render,
            observability: self.observability,
            class: self.options.class.unwrap_or_else(|| predicted.best()),
            probabilities: predicted,
            f0: self.f0,
            light_scale: self.lights.flash,
            room_light: self.lights.room,
            solver: self.solver,
        }
    }
}

/// The refined map in memory of its own, and what the solver did.
fn refined<'a, E: Energy<N>, const N: usize>(
    energy: &E,
    coefficients: &[f32; N],
    options: &crf::Options,
    exec: &dyn Executor,
    arena: &mut Arena<'a>,
    watch: Watch<'_>,
) -> Result<(&'a mut [f32], crf::Report), Error> {
    let out = arena.take(energy.unary(0).len())?;
    let report = crf::refine_watched(energy, coefficients, options, out, exec, arena, watch)?;
    Ok((out, report))
}
