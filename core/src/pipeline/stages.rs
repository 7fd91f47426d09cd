//! The stages between photo and material as types: `First` -> `WithAlbedo` -> `WithNormal` -> `Searched` -> `Refined`.
//!
//! Without refinement each stage hands its maps on as they are, and the search is left out.
use super::{CaptureOptions, Engine, SolverReports};
use crate::Error;
use crate::arena::Arena;
use crate::brdf::{self, Light};
use crate::crf::{self, Albedo, Coefficients, Normal, Roughness};
use crate::exec::Executor;
use crate::frame::LinearImage;
use crate::maps::{Maps, MapsMut};
use crate::net::{Class, ClassProbabilities, Classification, Model};
use crate::{Observer, search};

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

/// The network's maps, their albedo refined.
pub(super) struct WithAlbedo<'a> {
    first: First<'a>,
    coefficients: Coefficients,
    albedo: &'a mut [f32],
    solver: SolverReports,
}

/// Albedo and normals refined.
pub(super) struct WithNormal<'a> {
    before: WithAlbedo<'a>,
    normal: &'a mut [f32],
}

/// The search's roughness beside the refined maps.
pub(super) struct Searched<'a> {
    before: WithNormal<'a>,
    f0: f32,
    roughness: &'a mut [f32],
    observability: &'a mut [f32],
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
        engine: &dyn Engine,
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
        let mixing = run.options.class.map(ClassProbabilities::certain);
        let classification = engine.infer(&run.photo, mixing, run.exec, arena, &mut maps, observer)?;
        Ok(Self { maps, classification })
    }

    pub(super) fn albedo(
        self,
        run: &Run<'_, 'a>,
        model: &Model<'_>,
        arena: &mut Arena<'a>,
    ) -> Result<WithAlbedo<'a>, Error> {
        let sets = Class::ALL.map(|class| Coefficients::from_array(&model.crf(class)));
        let coefficients = Coefficients::mixed(&sets, &self.classification.used.0);
        let albedo = arena.take(self.maps.albedo.len())?;
        let mut solver = SolverReports::default();
        if run.options.refine {
            let energy = Albedo { size: self.maps.size, photo: run.photo.rgb, albedo: self.maps.albedo };
            solver[0] =
                crf::refine(&energy, &coefficients.albedo, &run.options.solver, albedo, run.exec, arena)?;
        } else {
            albedo.copy_from_slice(self.maps.albedo);
        }
        Ok(WithAlbedo { first: self, coefficients, albedo, solver })
    }
}

impl<'a> WithAlbedo<'a> {
    pub(super) fn normal(
        mut self,
        run: &Run<'_, 'a>,
        arena: &mut Arena<'a>,
    ) -> Result<WithNormal<'a>, Error> {
        let normal = arena.take(self.first.maps.normal.len())?;
        if run.options.refine {
            let energy =
                Normal { size: self.first.maps.size, normal: self.first.maps.normal, albedo: self.albedo };
            let coefficients = &self.coefficients.normal;
            self.solver[1] =
                crf::refine(&energy, coefficients, &run.options.solver, normal, run.exec, arena)?;
        } else {
            normal.copy_from_slice(self.first.maps.normal);
        }
        Ok(WithNormal { before: self, normal })
    }
}

impl<'a> WithNormal<'a> {
    pub(super) fn search(self, run: &Run<'_, 'a>, arena: &mut Arena<'a>) -> Result<Searched<'a>, Error> {
        let first = &self.before.first;
        let size = first.maps.size;
        let metal = first.classification.used.of(Class::Metal);
        let f0 = brdf::f0(metal);
        let roughness = arena.take::<f32>(size * size)?;
        let observability = arena.zeroed::<f32>(size * size)?;
        if run.options.refine {
            let mut scope = arena.scope();
            let render = scope.take::<f32>(3 * size * size)?;
            let maps = Maps {
                size,
                albedo: self.before.albedo,
                normal: self.normal,
                roughness: first.maps.roughness,
            };
            let strength = super::relight(&maps, f0, &run.photo, run.exec, render)?;
            let light = Light { strength, ..Light::default() };
            search::roughness(
                &run.photo,
                self.before.albedo,
                self.normal,
                f0,
                &light,
                run.exec,
                roughness,
                observability,
            )?;
        } else {
            roughness.copy_from_slice(first.maps.roughness);
        }
        Ok(Searched { before: self, f0, roughness, observability })
    }
}

impl<'a> Searched<'a> {
    pub(super) fn roughness(self, run: &Run<'_, 'a>, arena: &mut Arena<'a>) -> Result<Refined<'a>, Error> {
        let WithNormal { before, normal } = self.before;
        let WithAlbedo { first, coefficients, albedo, mut solver } = before;
        let size = first.maps.size;
        let roughness = arena.take(first.maps.roughness.len())?;
        if run.options.refine {
            let energy = Roughness {
                size,
                photo: run.photo.rgb,
                albedo,
                network: first.maps.roughness,
                search: self.roughness,
                observability: Some(self.observability),
            };
            let coefficients = &coefficients.roughness;
            solver[2] = crf::refine(&energy, coefficients, &run.options.solver, roughness, run.exec, arena)?;
        } else {
            roughness.copy_from_slice(first.maps.roughness);
        }
        Ok(Refined {
            maps: MapsMut { size, albedo, normal, roughness },
            observability: self.observability,
            classification: first.classification,
            f0: self.f0,
            solver,
        })
    }
}
