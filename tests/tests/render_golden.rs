//! The Rust renderer against the Python one (PyTorch, itself checked against Mitsuba 3): <= 1e-4.
use flashmat_core::base::exec::Inline;
use flashmat_core::brdf::{Light, Scene, render};
use flashmat_core::maps::Maps;
use glam::Vec3;
use serde::Deserialize;

#[derive(Deserialize)]
struct Golden {
    size: usize,
    values: usize,
    materials: Vec<Material>,
}

#[derive(Deserialize)]
struct Material {
    name: String,
    f0: f32,
    maps: usize,
    renders: Vec<Render>,
}

#[derive(Deserialize)]
struct Render {
    fov_deg: f32,
    light: [f32; 3],
    strength: f32,
    radiance: usize,
}

#[test]
fn the_renderer_agrees_with_the_training_kits() {
    let golden: Golden =
        serde_json::from_str(include_str!("../golden/render/render.json")).expect("the table");
    let bytes = include_bytes!("../golden/render/render.bin");
    let values: Vec<f32> = bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
    assert_eq!(values.len(), golden.values);
    let plane = golden.size * golden.size;
    let mut checked = 0;
    for material in &golden.materials {
        let planes = &values[material.maps..][..7 * plane];
        let (albedo, rest) = planes.split_at(3 * plane);
        let (normal, roughness) = rest.split_at(3 * plane);
        let maps = Maps { size: golden.size, albedo, normal, roughness };
        for expected in &material.renders {
            let light = Light { position: Vec3::from(expected.light), strength: expected.strength };
            let scene = Scene { fov_deg: expected.fov_deg, light };
            let mut out = vec![0.0; 3 * plane];
            render(&maps, material.f0, &scene, &Inline, &mut out).expect("a render");
            let worst = out
                .iter()
                .zip(&values[expected.radiance..])
                .map(|(a, b)| (a - b).abs() / b.abs().max(1.0))
                .fold(0.0_f32, f32::max);
            println!("{}, light {:?}: {worst:.2e}", material.name, expected.light);
            assert!(worst <= 1e-4, "{}, light {:?}: {worst}", material.name, expected.light);
            checked += 1;
        }
    }
    assert_eq!(checked, 9);
}
