//! Writes what the Rust API makes of photos in every pixel format, for the Java tests to compare with bit for bit:
//! `cargo run -p flashmat-jni --example reference -- OUT`.
//!
//! Calls [`flashmat_core`] directly, nothing of the bridge. Big-endian, as Java reads: "FMREF002", number of cases;
//! each: name (u16 length, UTF-8), 11 layout values, field of view (kind, value, target), class, refine, number of
//! planes, planes (i32 length, bytes in native order), then 29 numbers, 14 planes of 128 x 128 f32, and the
//! GLB of that name (i32 length, bytes).
use flashmat_core::capture::CaptureOptions;
use flashmat_core::frame::{Encoding, FieldOfView, Frame, PhotoFov, Range, Rotation, YuvMatrix, YuvPlanes};
use flashmat_core::net::{Class, Model};
use flashmat_core::{Session, SessionOptions, Silent};
use flashmat_export::{Pictures, glb};
use std::io::Write;

const TOY: &[u8] = include_bytes!("../../../tests/golden/toy.fmat");
const SIZE: usize = 128;

/// A photo and what to do with it. Strides in the format's values.
struct Case {
    name: &'static str,
    format: i32,
    width: usize,
    height: usize,
    row: usize,
    pixel: usize,
    chroma_row: usize,
    chroma_pixel: usize,
    rotation: Rotation,
    encoding: Encoding,
    matrix: YuvMatrix,
    range: Range,
    photo_fov: PhotoFov,
    light_scale: Option<f32>,
    class: Option<Class>,
    refine: bool,
}

const PLAIN: Case = Case {
    name: "rgb8",
    format: 0,
    width: 150,
    height: 141,
    row: 450,
    pixel: 1,
    chroma_row: 0,
    chroma_pixel: 0,
    rotation: Rotation::None,
    encoding: Encoding::Srgb,
    matrix: YuvMatrix::Bt601,
    range: Range::Full,
    photo_fov: PhotoFov::Unknown,
    light_scale: None,
    class: None,
    refine: true,
};

fn cases() -> Vec<Case> {
    let yuv = |name, format, row, chroma_row, chroma_pixel| Case {
        name,
        format,
        row,
        chroma_row,
        chroma_pixel,
        width: 151,
        height: 139,
        ..PLAIN
    };
    vec![
        PLAIN,
        Case {
            name: "rgb8, linear, class given",
            encoding: Encoding::Linear,
            class: Some(Class::Metal),
            ..PLAIN
        },
        Case { name: "rgb8, Display P3, unrefined", encoding: Encoding::DisplayP3, refine: false, ..PLAIN },
        Case { name: "rgb8, fewer pixels than maps", width: 40, height: 33, row: 121, ..PLAIN },
        Case { name: "rgba8, padded, turned 90", format: 1, row: 613, rotation: Rotation::Cw90, ..PLAIN },
        Case { name: "bgra8, turned 180", format: 2, row: 600, rotation: Rotation::Cw180, ..PLAIN },
        Case { name: "rgb16, padded", format: 3, row: 455, photo_fov: PhotoFov::ShorterSide(60.0), ..PLAIN },
        Case {
            name: "rgb_f32",
            format: 4,
            photo_fov: PhotoFov::Focal35mm(26.0),
            light_scale: Some(0.75),
            encoding: Encoding::Linear,
            ..PLAIN
        },
        Case { matrix: YuvMatrix::Bt709, range: Range::Limited, ..yuv("nv12, video colour", 5, 160, 152, 2) },
        Case { rotation: Rotation::Cw270, ..yuv("nv21, turned 270", 6, 151, 154, 2) },
        yuv("I420", 7, 151, 76, 1),
        Case { rotation: Rotation::Cw90, ..yuv("YUV_420_888, chroma interleaved", 7, 192, 192, 2) },
        Case { pixel: 2, row: 303, ..yuv("YUV_420_888, luma strided", 7, 303, 160, 2) },
    ]
}

/// Pixels of a plane: bright in the middle, a pattern, and noise from a fixed seed.
fn plane(case: &Case, number: usize) -> Vec<u8> {
    let chroma = case.format >= 5 && number > 0;
    let (width, height) =
        if chroma { (case.width.div_ceil(2), case.height.div_ceil(2)) } else { (case.width, case.height) };
    let (row, pixel) = if chroma { (case.chroma_row, case.chroma_pixel) } else { (case.row, case.pixel) };
    let channels = match case.format {
        0 | 3 | 4 => 3,
        1 | 2 => 4,
        5 | 6 if chroma => 2,
        _ => 1,
    };
    let step = if channels > 1 { channels } else { pixel };
    let mut state = 0x2545_f491_u32.wrapping_add(number as u32 + case.format as u32 * 7);
    let mut values = vec![0.0_f32; row * (height - 1) + step * (width - 1) + channels];
    for y in 0..height {
        for x in 0..width {
            for channel in 0..channels {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let noise = (state >> 16) as f32 / 65536.0 - 0.5;
                let (u, v) = (x as f32 / width as f32 - 0.5, y as f32 / height as f32 - 0.5);
                let pattern = ((x / 9 + y / 13 + channel) % 3) as f32 / 3.0;
                let glow = 1.0 - 1.2 * (u * u + v * v);
                values[y * row + x * step + channel] = if chroma {
                    0.5 + 0.08 * (pattern - 0.3) + 0.02 * noise
                } else {
                    (glow * (0.25 + 0.4 * pattern) + 0.05 * noise).clamp(0.0, 1.0)
                };
            }
        }
    }
    match case.format {
        3 => values.iter().flat_map(|v| ((v * 65535.0) as u16).to_ne_bytes()).collect(),
        4 => values.iter().flat_map(|v| v.to_ne_bytes()).collect(),
        _ => values.iter().map(|v| (v * 255.0) as u8).collect(),
    }
}

/// Numbers, planes, GLB.
type Results = (Vec<f32>, Vec<f32>, Vec<u8>);

fn capture(case: &Case, planes: &[Vec<u8>]) -> Result<Results, Box<dyn std::error::Error>> {
    let (width, height, row) = (case.width, case.height, case.row);
    let wide: Vec<u16> = planes[0].chunks_exact(2).map(|b| u16::from_ne_bytes([b[0], b[1]])).collect();
    let float: Vec<f32> =
        planes[0].chunks_exact(4).map(|b| f32::from_ne_bytes([b[0], b[1], b[2], b[3]])).collect();
    let frame = match case.format {
        0 => Frame::rgb8(&planes[0], width, height, row)?,
        1 => Frame::rgba8(&planes[0], width, height, row)?,
        2 => Frame::bgra8(&planes[0], width, height, row)?,
        3 => Frame::rgb16(&wide, width, height, row)?,
        4 => Frame::rgb_f32(&float, width, height, row)?,
        5 => Frame::nv12(&planes[0], row, &planes[1], case.chroma_row, width, height)?,
        6 => Frame::nv21(&planes[0], row, &planes[1], case.chroma_row, width, height)?,
        _ => Frame::yuv420(
            YuvPlanes {
                y: &planes[0],
                y_row_stride: row,
                y_pixel_stride: case.pixel,
                u: &planes[1],
                v: &planes[2],
                uv_row_stride: case.chroma_row,
                uv_pixel_stride: case.chroma_pixel,
            },
            width,
            height,
        )?,
    };
    let frame = frame.rotated(case.rotation).encoded(case.encoding).yuv_colour(case.matrix, case.range);
    let fov = FieldOfView { photo: case.photo_fov, ..FieldOfView::default() };
    let options = CaptureOptions {
        fov,
        class: case.class,
        light_scale: case.light_scale,
        refine: case.refine,
        ..CaptureOptions::default()
    };
    let mut session =
        Session::new(Model::from_bytes(TOY)?, &SessionOptions { size: SIZE, level: None, threads: 1 })?;
    let capture = session.capture(&frame, &options, &mut Silent)?;
    let mut numbers = capture.probabilities.0.to_vec();
    numbers.push(capture.class as usize as f32);
    numbers.extend([capture.f0, capture.light_scale, capture.residual, capture.photo.fov_deg]);
    numbers.extend(capture.solver.map(|report| report.iterations as f32));
    numbers.extend(capture.solver.map(|report| report.residual));
    numbers.push(capture.room_light);
    numbers.extend(capture.photo.flash.to_array());
    let exposure = capture.photo.exposure;
    numbers.extend(exposure.clipped);
    let flag = |set| if set { 1.0 } else { 0.0 };
    numbers.extend([exposure.brightness, flag(exposure.is_overexposed()), flag(exposure.is_dark())]);
    let maps = [
        capture.maps.albedo,
        capture.maps.normal,
        capture.maps.roughness,
        capture.render,
        capture.photo.rgb,
        capture.observability,
    ]
    .concat();
    let (f0, fov_deg) = (capture.f0, capture.photo.fov_deg);
    let material = glb::Material { name: case.name, pictures: Pictures::Planes(capture.maps), f0, fov_deg };
    Ok((numbers, maps, glb::file(&material)?.to_vec()))
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("usage: reference OUT")?;
    let mut out = std::io::BufWriter::new(std::fs::File::create(path)?);
    let cases = cases();
    out.write_all(b"FMREF002")?;
    let ints = |out: &mut dyn Write, values: &[usize]| -> std::io::Result<()> {
        values.iter().try_for_each(|&value| out.write_all(&(value as i32).to_be_bytes()))
    };
    ints(&mut out, &[cases.len()])?;
    for case in &cases {
        let count = if case.format < 5 { 1 } else { 2 + usize::from(case.format == 7) };
        let planes: Vec<Vec<u8>> = (0..count).map(|number| plane(case, number)).collect();
        let (numbers, maps, glb) =
            capture(case, &planes).map_err(|error| format!("{}: {error}", case.name))?;
        out.write_all(&(case.name.len() as u16).to_be_bytes())?;
        out.write_all(case.name.as_bytes())?;
        ints(
            &mut out,
            &[case.format as usize, case.width, case.height, case.row, case.pixel, case.chroma_row],
        )?;
        ints(&mut out, &[case.chroma_pixel, case.rotation as usize, case.encoding as usize])?;
        ints(&mut out, &[case.matrix as usize, case.range as usize])?;
        let (kind, fov) = match case.photo_fov {
            PhotoFov::Unknown => (0, 0.0),
            PhotoFov::ShorterSide(degrees) => (1, degrees),
            PhotoFov::Focal35mm(mm) => (2, mm),
        };
        ints(&mut out, &[kind])?;
        out.write_all(&fov.to_be_bytes())?;
        out.write_all(&FieldOfView::TARGET_DEG.to_be_bytes())?;
        out.write_all(&case.light_scale.unwrap_or(0.0).to_be_bytes())?;
        out.write_all(&case.class.map_or(-1, |class| class as i32).to_be_bytes())?;
        ints(&mut out, &[usize::from(case.refine), count])?;
        for plane in &planes {
            ints(&mut out, &[plane.len()])?;
            out.write_all(plane)?;
        }
        for value in numbers.iter().chain(&maps) {
            out.write_all(&value.to_be_bytes())?;
        }
        ints(&mut out, &[glb.len()])?;
        out.write_all(&glb)?;
        println!("{}: class {}, residual {:.4}", case.name, numbers[8], numbers[11]);
    }
    out.flush()?;
    Ok(())
}
