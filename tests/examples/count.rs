//! Runs one hot stage on a fixed input, for a counter of instructions around it (`tests/counts/check.sh`):
//! `count STAGE LEVEL [SIZE [RUNS]]`; without arguments, the names of the stages.
//!
//! A counter that can switch itself on and off counts inside [`counted`] alone; for one that cannot, the stage is the
//! count of two runs less that of one. One thread, the level as told: what the CPU has beyond it does not matter.
use cpu_time::ThreadTime;
use flashmat_core::base::arena::Arena;
use flashmat_core::base::exec::{At, Inline};
use flashmat_core::base::simd::{Level, Simd};
use flashmat_core::brdf::{self, Light};
use flashmat_core::crf::scenes::{FOV, Scene};
use flashmat_core::crf::{self, Coefficients, Energy, Options};
use flashmat_core::frame::{FieldOfView, Frame, LinearImage, prepare, prepare_bytes};
use flashmat_core::highlight;
use flashmat_core::kernels::Kernels;
use flashmat_core::maps::{Maps, MapsMut};
use flashmat_core::net::{Model, Network};
use flashmat_core::search;
use flashmat_tests::models::{Widths, random_model};
use flashmat_tests::runs::{NetRun, smooth_photo};

const STAGES: [&str; 11] = [
    "load",
    "frame-rgb",
    "frame-yuv",
    "network",
    "highlight",
    "flash",
    "crf-albedo",
    "crf-normal",
    "search",
    "crf-roughness",
    "render",
];

/// Calls `work`, which stays a call with a name to be found by, and prints the CPU time of the quickest run.
fn timed(runs: usize, mut work: impl FnMut()) {
    let times = (0..runs).map(|_| {
        let start = ThreadTime::now();
        counted(&mut work);
        start.elapsed().as_secs_f64() * 1e3
    });
    println!("{:.3} ms", times.fold(f64::INFINITY, f64::min));
}

#[inline(never)]
fn counted(work: &mut impl FnMut()) {
    work();
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (stage, level, rest) = match &arguments[..] {
        [] => return STAGES.iter().for_each(|stage| println!("{stage}")),
        [stage, level, rest @ ..] if rest.len() <= 2 => (stage, level, rest),
        _ => panic!("count STAGE LEVEL [SIZE [RUNS]]"),
    };
    let number =
        |index: usize, default| rest.get(index).map_or(default, |text| text.parse().expect("a number"));
    let (size, runs) = (number(0, 128), number(1, 1));
    let level = Level::from_name(level).expect("a level's name");
    let exec = At::new(&Inline, Simd::for_level(level).expect("a level of this CPU"));
    match stage.as_str() {
        "load" => {
            let file = random_model(&Widths::phone(), 1);
            timed(runs, || drop(Model::from_bytes(&file).expect("a model")));
        }
        "frame-rgb" => frame(runs, size, &exec, false),
        "frame-yuv" => frame(runs, size, &exec, true),
        "network" => network(runs, size, level),
        "crf-albedo" => {
            refine(runs, &Scene::tiles(size, 81).albedo(), &Coefficients::default().albedo, &exec)
        }
        "crf-normal" => {
            refine(runs, &Scene::tiles(size, 81).normal(), &Coefficients::default().normal, &exec)
        }
        "crf-roughness" => {
            refine(runs, &Scene::tiles(size, 81).roughness(), &Coefficients::default().roughness, &exec);
        }
        "highlight" => {
            let mut scene = Scene::tiles(size, 81);
            let (rgb, clipped) = (scene.photo.clone(), scene.clipped.clone());
            let photo = LinearImage::new(size, &rgb, &clipped, FOV);
            let mut work = vec![0; highlight::workspace_bytes(size).max(highlight::retexture_bytes(size))];
            let Scene { albedo, normal, roughness, .. } = &mut scene;
            timed(runs, || {
                let mut maps = MapsMut { size, albedo, normal, roughness };
                highlight::restore(&photo, &mut maps, 0.05, &exec, &mut Arena::new(&mut work))
                    .expect("restored");
                highlight::level_roughness(&photo, &mut maps, 0.05, &exec, &mut Arena::new(&mut work))
                    .expect("levelled");
                highlight::retexture(&photo, &mut maps, 0.05, &exec, &mut Arena::new(&mut work))
                    .expect("retextured");
            });
        }
        "flash" => {
            let scene = Scene::tiles(size, 81);
            let Scene { albedo, normal, roughness, .. } = &scene;
            let (photo, maps) = (scene.image(), Maps { size, albedo, normal, roughness });
            let mut work = vec![0; search::flash_position_bytes(size)];
            timed(runs, || {
                search::flash_position(&photo, &maps, 0.05, &exec, &mut Arena::new(&mut work))
                    .expect("found");
            });
        }
        "search" => {
            let (scene, light) = (Scene::tiles(size, 81), Light::default());
            let (mut found, mut seen) = (vec![0.0; size * size], vec![0.0; size * size]);
            timed(runs, || {
                let (photo, albedo, normal) = (scene.image(), &scene.albedo, &scene.normal);
                search::roughness(&photo, albedo, normal, 0.05, &light, &exec, &mut found, &mut seen)
                    .expect("searched");
            });
        }
        "render" => {
            let scene = Scene::tiles(size, 81);
            let Scene { albedo, normal, roughness, .. } = &scene;
            let maps = Maps { size, albedo, normal, roughness };
            let mut out = vec![0.0; 3 * size * size];
            timed(runs, || {
                brdf::render(&maps, 0.05, &brdf::Scene::flash(FOV, 1.0), &exec, &mut out).expect("rendered");
            });
        }
        other => panic!("no stage named {other}: {STAGES:?}"),
    }
}

/// A photo of 1000 x 750 pixels to maps of `size`.
fn frame(runs: usize, size: usize, exec: &At<'_>, yuv: bool) {
    let (width, height) = (1000, 750);
    let data: Vec<u8> = (0..3 * width * height).map(|i| (40 + i * 7919 % 199) as u8).collect();
    let frame = if yuv {
        Frame::nv12(&data, width, &data[width * height..], width, width, height)
    } else {
        Frame::rgb8(&data, width, height, 3 * width)
    };
    let frame = frame.expect("a frame");
    let mut work = vec![0; prepare_bytes(size)];
    timed(runs, || {
        prepare(&frame, size, &FieldOfView::default(), exec, &mut Arena::new(&mut work)).expect("prepared");
    });
}

fn network(runs: usize, size: usize, level: Level) {
    let file = random_model(&Widths::phone(), 1);
    let model = Model::from_bytes(&file).expect("a model");
    let macs = model.graph().macs(size);
    let kernels = Kernels::for_level(level).expect("a level of this CPU");
    let network = Network::new(model, size, kernels).expect("a multiple of 128");
    let mut run = NetRun::new(&network, size, smooth_photo(size));
    timed(runs, || {
        run.run(&network, None, &Inline, None).expect("a run");
    });
    println!("{macs} products in each run");
}

fn refine<E: Energy<N>, const N: usize>(runs: usize, energy: &E, raw: &[f32; N], exec: &At<'_>) {
    let mut work = vec![0; crf::workspace_bytes::<E, N>(energy.size())];
    let mut out = energy.unary(0).to_vec();
    timed(runs, || {
        crf::refine(energy, raw, &Options::default(), &mut out, exec, &mut Arena::new(&mut work))
            .expect("refined");
    });
}
