//! Every frame format through the C functions gives what the Rust API gives, bit for bit: as C99 on the static library,
//! C++17 on the shared one, under sanitizers and valgrind.
mod common;

use common::{Build, program, root, run, run_valgrind, scratch, toy_model, valgrind};
use flashmat_core::capture::{Capture, CaptureOptions};
use flashmat_core::frame::transfer::linear_to_srgb;
use flashmat_core::frame::{Encoding, FieldOfView, Frame, PhotoFov, Range, Rotation, YuvMatrix, YuvPlanes};
use flashmat_core::maps::{Maps, encode_rgb_row};
use flashmat_core::net::{Class, Model};
use flashmat_core::{Session, SessionOptions, Silent};
use flashmat_export::{Pictures, glb};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

const SIZE: usize = 128;

/// A plane as C gets it: bytes, row stride, pixel stride.
type Plane = (Vec<u8>, u32, u32);

/// A capture as numbers for C.
#[derive(Default)]
struct Case {
    /// Format, width, height, rotation, encoding, matrix, range, class, skip_refinement.
    numbers: [u32; 9],
    /// Field of view of the photo, focal length, target.
    fov: [f32; 3],
    light_scale: f32,
    planes: Vec<Plane>,
}

impl Case {
    fn write(&self, path: &Path) {
        let mut bytes: Vec<u8> = self.numbers.iter().flat_map(|n| n.to_ne_bytes()).collect();
        bytes.extend(self.fov.iter().chain([&self.light_scale]).flat_map(|n| n.to_ne_bytes()));
        bytes.extend((self.planes.len() as u32).to_ne_bytes());
        for (data, row, pixel) in &self.planes {
            bytes.extend([data.len() as u32, *row, *pixel].iter().flat_map(|n| n.to_ne_bytes()));
            bytes.extend(data);
        }
        fs::write(path, bytes).expect("writable");
    }
}

/// Light on a checked surface, with some noise: seeded, the same every time.
fn values(count: usize, width: usize) -> Vec<f32> {
    let mut state = 0x1234_5678_u32;
    let light = |i: usize| {
        let (x, y) =
            ((i / 3 % width) as f32 / width as f32 - 0.5, (i / 3 / width) as f32 / width as f32 - 0.4);
        let dark = if (i / 3 % width / 16 + i / 3 / width / 16).is_multiple_of(2) { 1.0 } else { 0.4 };
        0.75 * dark * (1.0 - x * x - y * y).max(0.1) * [1.0, 0.7, 0.5][i % 3]
    };
    (0..count)
        .map(|i| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            light(i) + 0.05 * (state >> 8) as f32 / (1 << 24) as f32
        })
        .collect()
}

fn bytes(count: usize, width: usize) -> Vec<u8> {
    values(count, width).iter().map(|v| (v * 255.0) as u8).collect()
}

/// The Rust API's results for a case.
type Expected = Box<dyn Fn(&Case) -> Vec<u8>>;

/// Checks one frame: what C made of `case` is what the session makes of `frame`.
struct Check {
    case: Case,
    frame: Expected,
}

fn checks() -> Vec<Check> {
    let mut checks = Vec::new();
    let mut add = |case: Case, frame: Expected| checks.push(Check { case, frame });
    let plain = CaptureOptions::default;
    let raw = || CaptureOptions { refine: false, ..CaptureOptions::default() };

    // Packed bytes, no padding; all defaults, refined.
    let (w, h) = (150, 140);
    let case = Case {
        numbers: [1, w, h, 0, 0, 0, 0, 0, 0],
        planes: vec![(bytes(3 * 150 * 140, 150), 0, 0)],
        ..Case::default()
    };
    add(
        case,
        Box::new(move |case| {
            expected(&Frame::rgb8(&case.planes[0].0, 150, 140, 450).expect("frame"), &plain())
        }),
    );
    // Padded rows that end with their last pixel, a quarter turn, an override, a field of view.
    let case = Case {
        numbers: [1, 130, 161, 90, 1, 0, 0, 4, 0],
        fov: [60.0, 0.0, 0.0],
        light_scale: 0.5,
        planes: vec![(bytes(400 * 160 + 390, 133), 400, 3)],
    };
    add(
        case,
        Box::new(move |case| {
            let frame = Frame::rgb8(&case.planes[0].0, 130, 161, 400).expect("frame").rotated(Rotation::Cw90);
            let options = CaptureOptions {
                class: Some(Class::Metal),
                light_scale: Some(0.5),
                fov: FieldOfView::shorter_side(60.0),
                ..plain()
            };
            expected(&frame.encoded(Encoding::Srgb), &options)
        }),
    );
    let case = Case {
        numbers: [2, 140, 140, 180, 3, 0, 0, 0, 1],
        fov: [0.0, 26.0, 0.0],
        light_scale: 0.0,
        planes: vec![(bytes(4 * 141 * 140, 188), 4 * 141, 4)],
    };
    add(
        case,
        Box::new(move |case| {
            let frame =
                Frame::rgba8(&case.planes[0].0, 140, 140, 564).expect("frame").rotated(Rotation::Cw180);
            let options = CaptureOptions { fov: FieldOfView::focal_35mm(26.0), ..raw() };
            expected(&frame.encoded(Encoding::DisplayP3), &options)
        }),
    );
    let case = Case {
        numbers: [3, 128, 129, 270, 2, 0, 0, 8, 1],
        fov: [70.0, 0.0, 30.0],
        light_scale: 0.0,
        planes: vec![(bytes(4 * 128 * 129, 171), 512, 0)],
    };
    add(
        case,
        Box::new(move |case| {
            let frame =
                Frame::bgra8(&case.planes[0].0, 128, 129, 512).expect("frame").rotated(Rotation::Cw270);
            let fov = FieldOfView { photo: PhotoFov::ShorterSide(70.0), target_deg: 30.0 };
            expected(
                &frame.encoded(Encoding::Linear),
                &CaptureOptions { class: Some(Class::Wood), fov, ..raw() },
            )
        }),
    );
    let wide: Vec<u16> = values(3 * 131 * 130, 131).iter().map(|v| (v * 65535.0) as u16).collect();
    let wide_bytes = wide.iter().flat_map(|v| v.to_ne_bytes()).collect();
    let case = Case {
        numbers: [4, 131, 130, 0, 0, 0, 0, 0, 1],
        planes: vec![(wide_bytes, 0, 6)],
        ..Case::default()
    };
    add(case, Box::new(move |_| expected(&Frame::rgb16(&wide, 131, 130, 393).expect("frame"), &raw())));
    let float = values(400 * 130, 133);
    let float_bytes = float.iter().flat_map(|v| v.to_ne_bytes()).collect();
    let case = Case {
        numbers: [5, 130, 130, 0, 0, 0, 0, 0, 1],
        planes: vec![(float_bytes, 1600, 12)],
        ..Case::default()
    };
    add(case, Box::new(move |_| expected(&Frame::rgb_f32(&float, 130, 130, 400).expect("frame"), &raw())));
    // YUV with odd sides.
    for (format, matrix, range) in [(6, 0, 0), (6, 2, 2), (7, 1, 1)] {
        let planes = vec![(bytes(160 * 151, 53), 160, 1), (bytes(152 * 76, 40), 152, 2)];
        let case = Case { numbers: [format, 151, 151, 0, 0, matrix, range, 0, 1], planes, ..Case::default() };
        add(
            case,
            Box::new(move |case| {
                let (y, uv) = (&case.planes[0].0, &case.planes[1].0);
                let new = if format == 6 { Frame::nv12 } else { Frame::nv21 };
                let frame = new(y, 160, uv, 152, 151, 151).expect("frame");
                let frame =
                    if matrix == 2 { frame.yuv_colour(YuvMatrix::Bt709, Range::Limited) } else { frame };
                expected(&frame, &raw())
            }),
        );
    }
    for (pixel, stride) in [(1, 70), (2, 140)] {
        let chroma = 69 * stride + 69 * pixel + 1;
        let planes = vec![
            (bytes(140 * 140, 47), 0, 0),
            (bytes(chroma, 40), stride as u32, pixel as u32),
            (bytes(chroma, 31), stride as u32, pixel as u32),
        ];
        let case = Case { numbers: [8, 140, 140, 0, 0, 0, 0, 0, 1], planes, ..Case::default() };
        add(
            case,
            Box::new(move |case| {
                let [y, u, v] = [0, 1, 2].map(|plane| case.planes[plane].0.as_slice());
                let planes = YuvPlanes {
                    y,
                    y_row_stride: 140,
                    y_pixel_stride: 1,
                    u,
                    v,
                    uv_row_stride: stride,
                    uv_pixel_stride: pixel,
                };
                expected(&Frame::yuv420(planes, 140, 140).expect("frame"), &raw())
            }),
        );
    }
    checks
}

/// The bytes that the C program writes: report, results as floats, results as codes.
fn expected(frame: &Frame<'_>, options: &CaptureOptions) -> Vec<u8> {
    let model = fs::read(toy_model()).expect("the toy model");
    let model = Model::from_bytes(&model).expect("a model");
    let mut session =
        Session::new(model, &SessionOptions { size: SIZE, level: None, threads: 1 }).expect("a session");
    let capture = session.capture(frame, options, &mut Silent).expect("a capture");
    let mut out = report(&capture);
    let planes = [capture.maps.albedo, capture.maps.normal, capture.maps.roughness, capture.render];
    for plane in planes.iter().chain([&capture.photo.rgb, &capture.observability]) {
        out.extend(plane.iter().flat_map(|v| v.to_ne_bytes()));
    }
    let maps = &capture.maps;
    let observability = Maps { roughness: capture.observability, ..*maps };
    let mut rows = |channels: usize, encode: &dyn Fn(usize, &mut [u8])| {
        for row in 0..SIZE {
            let mut codes = vec![0; channels * SIZE];
            encode(row, &mut codes);
            out.extend(codes);
        }
    };
    rows(3, &|row, out| maps.albedo_row(row, out).expect("row"));
    rows(3, &|row, out| maps.normal_row(row, out).expect("row"));
    rows(1, &|row, out| maps.roughness_row(row, out).expect("row"));
    rows(3, &|row, out| encode_rgb_row(capture.render, SIZE, row, out, linear_to_srgb).expect("row"));
    rows(3, &|row, out| encode_rgb_row(capture.photo.rgb, SIZE, row, out, linear_to_srgb).expect("row"));
    rows(1, &|row, out| observability.roughness_row(row, out).expect("row"));
    let (f0, fov_deg) = (capture.f0, capture.photo.fov_deg);
    let material = glb::Material { name: "parity", pictures: Pictures::Planes(*maps), f0, fov_deg };
    out.extend(glb::file(&material).expect("a file").to_vec());
    out
}

/// `flashmat_report` by hand.
fn report(capture: &Capture<'_>) -> Vec<u8> {
    let mut out = 116_u32.to_ne_bytes().to_vec();
    let class = Class::ALL.iter().position(|&c| c == capture.class).expect("a class") as u32 + 1;
    out.extend(class.to_ne_bytes());
    let floats = [capture.light_scale, capture.residual, capture.f0, capture.photo.fov_deg];
    out.extend(capture.probabilities.0.iter().chain(&floats).flat_map(|v| v.to_ne_bytes()));
    for solver in capture.solver {
        out.extend((solver.iterations as u32).to_ne_bytes());
        out.extend(solver.residual.to_ne_bytes());
    }
    out.extend(capture.room_light.to_ne_bytes());
    out.extend(capture.photo.flash.to_array().iter().flat_map(|v| v.to_ne_bytes()));
    let exposure = capture.photo.exposure;
    out.extend(exposure.clipped.iter().chain([&exposure.brightness]).flat_map(|v| v.to_ne_bytes()));
    let flags = u32::from(exposure.clipped_share() > 0.1) + 2 * u32::from(exposure.brightness < 0.01);
    out.extend(flags.to_ne_bytes());
    out
}

fn outputs(count: usize, test: &str) -> Vec<(PathBuf, PathBuf)> {
    let folder = scratch(test);
    (0..count).map(|i| (folder.join(format!("{i}.case")), folder.join(format!("{i}.out")))).collect()
}

#[test]
fn every_format_gives_what_the_rust_api_gives() {
    let checks = checks();
    let files = outputs(checks.len(), "parity");
    let wanted: Vec<Vec<u8>> = checks.iter().map(|check| (check.frame)(&check.case)).collect();
    for (check, (case, _)) in checks.iter().zip(&files) {
        check.case.write(case);
    }
    let source = root().join("tests/c/parity.c");
    for build in [Build::C99, Build::Cpp17, Build::Sanitized] {
        files.iter().for_each(|(_, out)| drop(fs::remove_file(out)));
        let mut command = Command::new(program(&source, build));
        command.arg(toy_model());
        command.args(files.iter().flat_map(|(case, out)| [case, out]));
        println!("{build:?}: {}", run(&mut command));
        for ((number, wanted), (_, out)) in wanted.iter().enumerate().zip(&files) {
            let got = fs::read(out).expect("results");
            assert_eq!(got.len(), wanted.len(), "case {number}");
            let differs = got.iter().zip(wanted).position(|(a, b)| a != b);
            assert_eq!(differs, None, "case {number}, {build:?}: first byte that differs");
        }
    }
    if valgrind() {
        // One case that is refined, one that is not: valgrind is slow.
        let (one, two) = (&files[0], &files[5]);
        let model = toy_model();
        let arguments = [&model, &one.0, &one.1, &two.0, &two.1].map(PathBuf::as_path);
        println!("valgrind: {}", run_valgrind(&program(&source, Build::C99), &arguments));
        // It knows other instructions, and the bits are the same.
        assert!(fs::read(&one.1).expect("results") == wanted[0]);
        assert!(fs::read(&two.1).expect("results") == wanted[5]);
    }
}
