//! The stages between photo and material as types: `First` -> `WithAlbedo` -> `WithNormal` -> `Searched` -> `Refined`.
//!
//! A refined map takes the place of the network's; without refinement each stage hands the maps on as they are, and the
//! search is left out. Large photos are refined smaller (`reduced`).
use super::reduced::{crf_size, refine_at};
use super::{CaptureOptions, SolverReports, Steps};
use crate::Error;
use crate::base::arena::Arena;
use crate::base::exec::{Executor, Watch, within};
use crate::base::resample::shrunk;
use crate::brdf::{self, Light, Scene};
use crate::crf::{self, Albedo, Coefficients, Energy, Normal, Roughness};
use crate::frame::LinearImage;
use crate::maps::{Maps, MapsMut};
use crate::net::{Class, Classification, Inference, Mixing, Model};
use crate::{Observer, highlight, search};

/// What every stage of a run reads.
pub(super) struct Run<'r, 'a> {
    pub(super) photo: LinearImage<'a>,
    pub(super) options: &'r CaptureOptions,
    pub(super) exec: &'r dyn Executor,
}

/// The network's maps.
pub(super) struct First<'a> {
    maps: MapsMut<'a>,
    classification: Classification,
}

/// The maps, their albedo refined.
pub(super) struct WithAlbedo<'a> {
    maps: MapsMut<'a>,
    classification: Classification,
    f0: f32,
    coefficients: Coefficients,
    solver: SolverReports,
}

/// Albedo and normals refined.
pub(super) struct WithNormal<'a>(WithAlbedo<'a>);

/// The search's roughness beside the refined maps; none without refinement.
pub(super) struct Searched<'a> {
    before: WithAlbedo<'a>,
    roughness: Option<&'a mut [f32]>,
    observability: &'a [f32],
}

/// The material.
pub(super) struct Refined<'a> {
    pub(super) maps: MapsMut<'a>,
    pub(super) observability: &'a [f32],
    pub(super) classification: Classification,
    pub(super) f0: f32,
    pub(super) solver: SolverReports,
}

impl<'a> First<'a> {
    pub(super) fn infer(
        run: &Run<'_, 'a>,
        engine: &dyn Inference,
        arena: &mut Arena<'a>,
        observer: &mut dyn Observer,
    ) -> Result<Self, Error> {
        let size = run.photo.size;
        let plane = size * size;
        let mut maps = MapsMut {
            size,
            albedo: arena.take(3 * plane)?,
            normal: arena.take(3 * plane)?,
            roughness: arena.take(plane)?,
        };
        let mixing = Mixing::only(run.options.class);
        let classification = engine.infer(&run.photo, mixing, run.exec, arena, &mut maps, observer)?;
        Ok(Self { maps, classification })
    }

    /// The run, its photo's flash where these maps say that it is.
    pub(super) fn lit<'r>(&self, run: &Run<'r, 'a>, arena: &mut Arena<'a>) -> Result<Run<'r, 'a>, Error> {
        let f0 = brdf::f0(self.classification.used.of(Class::Metal));
        let flash = search::flash_position(&run.photo, &self.maps.as_maps(), f0, run.exec, arena)?;
        Ok(Run { photo: LinearImage { flash, ..run.photo }, ..*run })
    }

    pub(super) fn albedo(
        self,
        run: &Run<'_, 'a>,
        model: &Model<'_>,
        arena: &mut Arena<'a>,
        steps: &mut Steps<'_>,
    ) -> Result<WithAlbedo<'a>, Error> {
        let Self { mut maps, classification } = self;
        let sets = Class::ALL.map(|class| Coefficients::from_array(&model.crf(class)));
        let coefficients = Coefficients::mixed(&sets, &classification.used.0);
        let mut solver = SolverReports::default();
        let (n, m) = (maps.size, crf_size(maps.size));
        let f0 = brdf::f0(classification.used.of(Class::Metal));
        if run.options.refine {
            within(run.exec, || highlight::restore(&run.photo, &mut maps, f0, run.exec, arena))?;
            steps.at(0.2)?;
        }
        if run.options.refine && m < n {
            let mut arena = arena.scope();
            let photo = shrunk(run.photo.rgb, n, m, run.exec, &mut arena)?;
            let albedo = shrunk(maps.albedo, n, m, run.exec, &mut arena)?;
            let energy = Albedo { size: m, photo, albedo };
            let mut watch = steps.part(0.2, 0.8);
            solver[0] =
                refined_smaller(&energy, &coefficients.albedo, run, maps.albedo, &mut arena, &mut watch)?;
        } else if run.options.refine {
            let energy = Albedo { size: n, photo: run.photo.rgb, albedo: maps.albedo };
            let mut watch = steps.part(0.2, 0.8);
            (maps.albedo, solver[0]) = refined(&energy, &coefficients.albedo, run, arena, &mut watch)?;
        }
        if run.options.refine {
            steps.at(0.8)?;
            within(run.exec, || highlight::retexture(&run.photo, &mut maps, f0, run.exec, arena))?;
        }
        Ok(WithAlbedo { maps, classification, f0, coefficients, solver })
    }
}

/// The refined map in memory of its own, and what the solver did.
fn refined<'a, E: Energy<N>, const N: usize>(
    energy: &E,
    coefficients: &[f32; N],
    run: &Run<'_, 'a>,
    arena: &mut Arena<'a>,
    watch: Watch<'_>,
) -> Result<(&'a mut [f32], crf::Report), Error> {
    let out = arena.take(energy.unary(0).len())?;
    let report = crf::refine_watched(energy, coefficients, &run.options.solver, out, run.exec, arena, watch)?;
    Ok((out, report))
}

/// Refines `map` in place by `energy`, whose inputs were shrunk; returns what the solver did.
fn refined_smaller<E: Energy<N>, const N: usize>(
    energy: &E,
    coefficients: &[f32; N],
    run: &Run<'_, '_>,
    map: &mut [f32],
    arena: &mut Arena<'_>,
    watch: Watch<'_>,
) -> Result<crf::Report, Error> {
    refine_at(energy, coefficients, &run.options.solver, (map, run.photo.size), run.exec, arena, watch)
}

impl<'a> WithAlbedo<'a> {
    pub(super) fn normal(
        mut self,
        run: &Run<'_, 'a>,
        arena: &mut Arena<'a>,
        steps: &mut Steps<'_>,
    ) -> Result<WithNormal<'a>, Error> {
        let mut watch = steps.part(0.0, 1.0);
        let maps = &mut self.maps;
        let (n, m) = (maps.size, crf_size(maps.size));
        if run.options.refine && m < n {
            let mut arena = arena.scope();
            let normal = shrunk(maps.normal, n, m, run.exec, &mut arena)?;
            let albedo = shrunk(maps.albedo, n, m, run.exec, &mut arena)?;
            let energy = Normal { size: m, normal, albedo };
            self.solver[1] = refined_smaller(
                &energy,
                &self.coefficients.normal,
                run,
                maps.normal,
                &mut arena,
                &mut watch,
            )?;
        } else if run.options.refine {
            let energy = Normal { size: n, normal: maps.normal, albedo: maps.albedo };
            (maps.normal, self.solver[1]) =
                refined(&energy, &self.coefficients.normal, run, arena, &mut watch)?;
        }
        Ok(WithNormal(self))
    }
}

impl<'a> WithNormal<'a> {
    pub(super) fn search(
        self,
        run: &Run<'_, 'a>,
        arena: &mut Arena<'a>,
        steps: &mut Steps<'_>,
    ) -> Result<Searched<'a>, Error> {
        let Self(before) = self;
        let MapsMut { size, ref albedo, ref normal, ref roughness } = before.maps;
        let f0 = before.f0;
        if !run.options.refine {
            let observability = arena.zeroed(size * size)?;
            return Ok(Searched { before, roughness: None, observability });
        }
        let (found, seen) = (arena.take::<f32>(size * size)?, arena.take::<f32>(size * size)?);
        let mut scope = arena.scope();
        let render = scope.take::<f32>(3 * size * size)?;
        let scene = Scene::of(&run.photo);
        let maps = Maps { size, albedo, normal, roughness };
        let strength = within(run.exec, || {
            brdf::render(&maps, f0, &scene, run.exec, render)?;
            search::light_scale(&run.photo, render, run.exec)
        })?;
        steps.at(0.2)?;
        let light = Light { strength, ..scene.light };
        let mut watch = steps.part(0.2, 1.0);
        let out = (&mut *found, &mut *seen);
        search::roughness_watched(&run.photo, (albedo, normal), f0, &light, run.exec, out, &mut watch)?;
        Ok(Searched { before, roughness: Some(found), observability: seen })
    }
}

impl<'a> Searched<'a> {
    pub(super) fn roughness(
        self,
        run: &Run<'_, 'a>,
        arena: &mut Arena<'a>,
        steps: &mut Steps<'_>,
    ) -> Result<Refined<'a>, Error> {
        let WithAlbedo { mut maps, classification, f0, coefficients, mut solver } = self.before;
        let (n, m) = (maps.size, crf_size(maps.size));
        let observability = self.observability;
        let Some(search) = self.roughness else {
            return Ok(Refined { maps, observability, classification, f0, solver });
        };
        if m < n {
            // Where a pixel says nothing of its roughness, what the search found there means nothing.
            search.iter_mut().zip(observability).for_each(|(found, seen)| *found *= seen);
            let mut arena = arena.scope();
            let photo = shrunk(run.photo.rgb, n, m, run.exec, &mut arena)?;
            let albedo = shrunk(maps.albedo, n, m, run.exec, &mut arena)?;
            let network = shrunk(maps.roughness, n, m, run.exec, &mut arena)?;
            let seen = shrunk(observability, n, m, run.exec, &mut arena)?;
            let search = shrunk(search, n, m, run.exec, &mut arena)?;
            search.iter_mut().zip(&*seen).for_each(|(found, seen)| *found /= seen.max(1e-6));
            let energy = Roughness { size: m, photo, albedo, network, search, observability: Some(seen) };
            let mut watch = steps.part(0.0, 0.7);
            solver[2] = refined_smaller(
                &energy,
                &coefficients.roughness,
                run,
                maps.roughness,
                &mut arena,
                &mut watch,
            )?;
        } else {
            let energy = Roughness {
                size: n,
                photo: run.photo.rgb,
                albedo: maps.albedo,
                network: maps.roughness,
                search,
                observability: Some(observability),
            };
            let mut watch = steps.part(0.0, 0.7);
            (maps.roughness, solver[2]) = refined(&energy, &coefficients.roughness, run, arena, &mut watch)?;
        }
        steps.at(0.7)?;
        within(run.exec, || highlight::level_roughness(&run.photo, &mut maps, f0, run.exec, arena))?;
        steps.at(0.8)?;
        Ok(Refined { maps, observability, classification, f0, solver })
    }
}
