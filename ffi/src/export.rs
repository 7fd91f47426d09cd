//! A captured material as a file, handed to a function of the caller's.
#![expect(unsafe_code, reason = "unmangled names")]

use crate::failure::Failure;
use crate::guard::guard;
use crate::ptr;
use crate::status::flashmat_status;
use crate::types::{flashmat_buffer, flashmat_map_format, flashmat_maps, flashmat_report, flashmat_write};
use bytemuck::Pod;
use core::ffi::{c_char, c_void};
use flashmat_core::maps::Maps;
use flashmat_export::{Error, Pictures, glb};

/// A captured material on a square, as one binary glTF 2.0 file for any viewer: albedo, normals, roughness, metallic,
/// index of refraction. The same bytes as the command line's material.glb of the same capture.
///
/// size: pixels per side of the maps.
/// maps: as they were given to the capture that filled them, in either format; albedo, normal and roughness are read,
/// the others may be NULL.
/// report: of the same capture; f0 and fov_deg are read.
/// name: the material's, UTF-8, ends with NUL.
/// write: takes the file's bytes, in order, in one call or several. user: its first argument.
/// Owner of everything: the caller.
/// Threads: any, also during captures, as long as they do not write to these maps.
/// Memory: that of the file, from the system. Not in the bare-metal build.
/// Errors: NULL_POINTER, MISALIGNED, STRUCT_SIZE, UNKNOWN_VALUE, INVALID_ARGUMENT, BUFFER_TOO_SMALL (a map is shorter
/// than size says), CANCELLED (write said so), INTERNAL.
#[unsafe(no_mangle)]
pub extern "C" fn flashmat_export_glb(
    size: u32,
    maps: *const flashmat_maps,
    report: *const flashmat_report,
    name: *const c_char,
    write: flashmat_write,
    user: *mut c_void,
) -> flashmat_status {
    guard(|| {
        let pictures = pictures(&ptr::read_struct(maps, "maps")?, size as usize)?;
        let report = ptr::read_struct(report, "report")?;
        let name = ptr::text(name, "name")?;
        let write =
            write.ok_or_else(|| Failure::new(flashmat_status::NullPointer, format_args!("write is NULL")))?;
        let material = glb::Material { name, pictures, f0: report.f0, fov_deg: report.fov_deg };
        let file = glb::file(&material).map_err(failure)?;
        for part in file.parts() {
            if write(user, part.as_ptr().cast(), part.len()) != 0 {
                return Err(Failure::new(
                    flashmat_status::Cancelled,
                    format_args!("write stopped the export"),
                ));
            }
        }
        Ok(())
    })
}

fn failure(error: Error) -> Failure {
    Failure::new(flashmat_status::InvalidArgument, format_args!("{error}"))
}

/// The maps that a file needs, in the format that they have.
fn pictures<'a>(maps: &flashmat_maps, size: usize) -> Result<Pictures<'a>, Failure> {
    flashmat_core::base::planes::check_planes(size, 0, 0).map_err(|_| {
        Failure::new(flashmat_status::InvalidArgument, format_args!("size: {size} is not one of maps"))
    })?;
    if maps.format == flashmat_map_format::F32 as u32 {
        Ok(Pictures::Planes(Maps {
            size,
            albedo: map(maps.albedo, 3 * size * size, "maps.albedo")?,
            normal: map(maps.normal, 3 * size * size, "maps.normal")?,
            roughness: map(maps.roughness, size * size, "maps.roughness")?,
        }))
    } else if maps.format == flashmat_map_format::U8 as u32 {
        Ok(Pictures::Codes {
            size,
            albedo: map(maps.albedo, 3 * size * size, "maps.albedo")?,
            normal: map(maps.normal, 3 * size * size, "maps.normal")?,
            roughness: map(maps.roughness, size * size, "maps.roughness")?,
        })
    } else {
        let text = format_args!("maps.format: {} is not one of its values", maps.format);
        Err(Failure::new(flashmat_status::UnknownValue, text))
    }
}

/// The first `len` values of a map, which may have room for more.
fn map<'a, T: Pod>(buffer: flashmat_buffer, len: usize, what: &str) -> Result<&'a [T], Failure> {
    let values = ptr::slice(buffer.data.cast_const(), buffer.bytes, what)?;
    values.get(..len).ok_or_else(|| {
        let (given, needed) = (buffer.bytes, len * size_of::<T>());
        Failure::new(
            flashmat_status::BufferTooSmall,
            format_args!("{what}: {given} bytes given, {needed} needed"),
        )
    })
}
