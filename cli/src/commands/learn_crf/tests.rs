//! The chain against the shipped pipeline, the gradient against finite differences.
use super::gradient::{Values, accumulate, loss};
use super::sample::{Sample, Sets, Stage};
use super::*;
use crate::material::OwnedMaps;
use crate::output::png::{self, Depth};
use glam::Vec3;

const SIZE: usize = 128;
const TIGHT: crf::Options = crf::Options { tolerance: 1e-7, max_iterations: 200 };

/// A folder of one wavy, striped material; removed with the value.
struct Material(PathBuf);

impl Material {
    fn new(name: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("flashmat-learn-{}-{name}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("folder");
        let wave = |i: usize, f: f32| ((i % SIZE) as f32 * f + (i / SIZE) as f32 * 0.13).sin();
        let pixels = SIZE * SIZE;
        let tilt = |i: usize| Vec3::new(0.3 * wave(i, 0.2), 0.2 * wave(i, 0.07), 1.0).normalize();
        let maps = OwnedMaps {
            size: SIZE,
            albedo: (0..3 * pixels)
                .map(|i| 0.3 + 0.2 * wave(i % pixels, 0.1 + 0.1 * (i / pixels) as f32))
                .collect(),
            normal: (0..3).flat_map(|c| (0..pixels).map(move |i| tilt(i)[c])).collect(),
            roughness: (0..pixels).map(|i| 0.5 + 0.2 * wave(i, 0.05)).collect(),
        };
        let save = |name: &str, body: &dyn Fn(&mut Vec<u8>)| {
            let mut bytes = Vec::new();
            body(&mut bytes);
            std::fs::write(folder.join(name), bytes).expect("write");
        };
        let view = maps.view();
        save("albedo.png", &|f| png::albedo(f, &view, Depth::Sixteen).expect("albedo"));
        save("normal.png", &|f| png::normal(f, &view, Depth::Sixteen).expect("normal"));
        save("roughness.png", &|f| png::roughness(f, &view, Depth::Sixteen).expect("roughness"));
        Self(folder)
    }

    fn item(&self) -> Item {
        Item { class: Class::Wood, name: "waves".to_owned(), folder: self.0.clone() }
    }
}

impl Drop for Material {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Sets that differ from class to class, far from zero.
fn strong() -> Sets {
    Class::ALL.map(|class| {
        let k = 1.0 + 0.1 * class as usize as f32;
        Coefficients {
            albedo: [0.5, 0.1 * k, 0.1, 0.2 * k, 0.2],
            normal: [0.5, 0.2 * k, 0.3],
            roughness: [0.4 * k, 0.3, 0.1, 0.2],
        }
        .normalised()
    })
}

fn sample_of(material: &Material, file: &ModelFile, refine: bool) -> (Sample, crate::material::Material) {
    let settings = Settings { size: SIZE, refine: false, ..Settings::default() };
    let model = file.parse().expect("model");
    let mut engine = Engine::new(&model, &settings).expect("engine");
    let sample = Sample::new(&mut engine, &material.item(), SIZE, None).expect("sample");
    let mut engine = Engine::new(&model, &Settings { refine, ..settings }).expect("engine");
    let shot = dataset::shot(&material.item(), SIZE, None).expect("shot");
    let capture =
        engine.capture(&shot.photo, &mut |_, _| std::ops::ControlFlow::Continue(())).expect("capture");
    (sample, capture)
}

#[test]
fn the_chain_is_the_shipped_one_bit_for_bit() {
    let material = Material::new("chain");
    let strong = strong().map(|set| set.to_array());
    let bytes = rewrite::with_crf(ModelFile::load(None).expect("model").bytes(), &strong).expect("written");
    let path = material.0.join("model.fmat");
    std::fs::write(&path, bytes).expect("write");
    let file = ModelFile::load(Some(&path)).expect("model");
    let (mut sample, capture) = sample_of(&material, &file, true);
    let sets = strong.map(|values| Coefficients::from_array(&values));
    let mut workspace = Sample::workspace(SIZE);
    for stage in Stage::ALL {
        sample.advance(stage, &sets, &mut workspace).expect("advanced");
        let (ours, shipped) = match stage {
            Stage::Albedo => (&sample.refined.albedo, &capture.maps.albedo),
            Stage::Normal => (&sample.refined.normal, &capture.maps.normal),
            Stage::Roughness => (&sample.refined.roughness, &capture.maps.roughness),
        };
        assert!(ours == shipped, "{stage:?}");
    }
    assert_ne!(capture.maps.albedo, sample.first.albedo);
}

#[test]
fn the_gradient_by_every_class_is_that_of_finite_differences() {
    let material = Material::new("gradient");
    let file = ModelFile::load(None).expect("model");
    let (mut sample, _) = sample_of(&material, &file, false);
    // Two classes share the photo; the others have no say.
    sample.probabilities = [0.0, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.7];
    let sets = strong();
    let mut workspace = Sample::workspace(SIZE);
    for stage in Stage::ALL {
        let mut exact: Values = [[0.0; COUNT]; CLASSES];
        accumulate(&sample, stage, &sets, &TIGHT, &mut workspace, &mut exact).expect("gradient");
        assert!(exact[0].iter().all(|&g| g == 0.0));
        let mut at = |class: usize, k: usize, step: f32| {
            let mut moved = sets.map(|set| set.to_array());
            moved[class][k] += step;
            let moved = moved.map(|values| Coefficients::from_array(&values));
            let mut unused = [[0.0; COUNT]; CLASSES];
            accumulate(&sample, stage, &moved, &TIGHT, &mut workspace, &mut unused).expect("loss")
        };
        let mut numeric = Vec::new();
        for (class, count) in [(1, 2), (7, COUNT)] {
            for k in range(stage).take(count) {
                // Wide steps, so that the weights' 8 bits average out; the four points cancel the third order.
                let h = 0.12 * sets[class].to_array()[k];
                let slope = 8.0 * (at(class, k, h) - at(class, k, -h))
                    - (at(class, k, 2.0 * h) - at(class, k, -2.0 * h));
                numeric.push((class, k, slope / (12.0 * f64::from(h))));
            }
        }
        let scale = numeric.iter().fold(0.0_f64, |a, (_, _, n)| a.max(n.abs()));
        assert!(scale > 0.0);
        for (class, k, numeric) in numeric {
            let ours = exact[class][k];
            println!("{stage:?} {class} {k}: {ours:e} {numeric:e}");
            let tolerance = 2e-2 * numeric.abs() + 5e-3 * scale;
            assert!((ours - numeric).abs() <= tolerance, "{stage:?} {class} {k}: {ours:e} {numeric:e}");
        }
        sample.advance(stage, &sets, &mut workspace).expect("advanced");
    }
}

#[test]
fn losses_are_in_the_papers_convention_and_every_photo_comes_once_an_epoch() {
    assert!((loss(Stage::Albedo, &[0.5, 0.0], &[0.0, 0.0]) - 0.5).abs() < 1e-9);
    assert!((loss(Stage::Normal, &[0.5, 0.0], &[0.0, 0.0]) - 0.125).abs() < 1e-9);
    let mut order = Order::new(7, 3);
    let mut epochs = Vec::new();
    for _ in 0..2 {
        let mut seen = Vec::new();
        loop {
            let (batch, ends) = order.batch(3);
            seen.extend(batch);
            if ends {
                break;
            }
        }
        epochs.push(seen.clone());
        seen.sort_unstable();
        assert_eq!(seen, [0, 1, 2, 3, 4, 5, 6]);
    }
    assert_ne!(epochs[0], epochs[1]);
}
