//! A capture into the caller's memory: maps as floats or bytes, and the report.
use crate::failure::Failure;
use crate::input;
use crate::ptr::OutBuffer;
use crate::status::flashmat_status as Status;
use crate::types::{
    FLASHMAT_PHOTO_DARK, FLASHMAT_PHOTO_OVEREXPOSED, flashmat_buffer, flashmat_map_format, flashmat_maps,
    flashmat_report, flashmat_solver,
};
use bytemuck::Pod;
use flashmat_core::base::exec::Executor;
use flashmat_core::capture::Capture;
use flashmat_core::maps::{self, Coding};

/// Where a capture's results go, checked before the work is done.
pub(crate) enum Outputs<'a> {
    F32([OutBuffer<'a, f32>; 6]),
    U8([OutBuffer<'a, u8>; 6]),
}

/// Name and channels of the results, in the order of `flashmat_maps`.
const RESULTS: [(&str, usize); 6] = [
    ("maps.albedo", 3),
    ("maps.normal", 3),
    ("maps.roughness", 1),
    ("maps.render", 3),
    ("maps.photo", 3),
    ("maps.observability", 1),
];

/// The buffers, in the order of `flashmat_maps`.
pub(crate) fn buffers(maps: &flashmat_maps) -> [flashmat_buffer; 6] {
    [maps.albedo, maps.normal, maps.roughness, maps.render, maps.photo, maps.observability]
}

fn check<'a, T: Pod>(maps: &flashmat_maps, size: usize) -> Result<[OutBuffer<'a, T>; 6], Failure> {
    let all = buffers(maps);
    let buffer = |index: usize| {
        let (name, channels) = RESULTS[index];
        let len = channels * size * size;
        OutBuffer::new(all[index].data, all[index].bytes, len, name)
    };
    Ok([buffer(0)?, buffer(1)?, buffer(2)?, buffer(3)?, buffer(4)?, buffer(5)?])
}

impl Outputs<'_> {
    pub(crate) fn new(maps: &flashmat_maps, size: usize) -> Result<Self, Failure> {
        if maps.format == flashmat_map_format::F32 as u32 {
            Ok(Self::F32(check(maps, size)?))
        } else if maps.format == flashmat_map_format::U8 as u32 {
            Ok(Self::U8(check(maps, size)?))
        } else {
            let code = maps.format;
            let text = format_args!("maps.format: {code} is not one of its values");
            Err(Failure::new(Status::UnknownValue, text))
        }
    }

    pub(crate) fn write(&mut self, capture: &Capture<'_>, exec: &dyn Executor) -> Result<(), Failure> {
        let m = &capture.maps;
        match self {
            Self::F32(buffers) => {
                let planes = [
                    m.albedo,
                    m.normal,
                    m.roughness,
                    capture.render,
                    capture.photo.rgb,
                    capture.observability,
                ];
                for (buffer, planes) in buffers.iter_mut().zip(planes) {
                    if let Some(out) = buffer.as_mut() {
                        out.iter_mut().zip(planes).for_each(|(out, &value)| *out = value);
                    }
                }
                Ok(())
            }
            Self::U8(buffers) => {
                let results = [
                    (m.albedo, Coding::Srgb),
                    (m.normal, Coding::Signed),
                    (m.roughness, Coding::Linear),
                    (capture.render, Coding::Srgb),
                    (capture.photo.rgb, Coding::Srgb),
                    (capture.observability, Coding::Linear),
                ];
                for (buffer, (planes, coding)) in buffers.iter_mut().zip(results) {
                    if let Some(out) = buffer.as_mut() {
                        maps::encode(planes, m.size, coding, exec, out)?;
                    }
                }
                Ok(())
            }
        }
    }
}

/// The report of a capture.
pub(crate) fn report(capture: &Capture<'_>) -> flashmat_report {
    let exposure = &capture.photo.exposure;
    flashmat_report {
        struct_size: 0,
        material_class: input::class_code(capture.class),
        probabilities: capture.probabilities.0,
        light_scale: capture.light_scale,
        residual: capture.residual,
        f0: capture.f0,
        fov_deg: capture.photo.fov_deg,
        solver: capture.solver.map(|report| flashmat_solver {
            iterations: u32::try_from(report.iterations).unwrap_or(u32::MAX),
            residual: report.residual,
        }),
        room_light: capture.room_light,
        flash: capture.photo.flash.to_array(),
        overexposed: exposure.clipped,
        brightness: exposure.brightness,
        photo_flags: if exposure.is_overexposed() { FLASHMAT_PHOTO_OVEREXPOSED } else { 0 }
            | if exposure.is_dark() { FLASHMAT_PHOTO_DARK } else { 0 },
    }
}
