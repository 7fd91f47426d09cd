//! The float engine (tract) against the double-precision reference, and the int8 engine against the float engine.
#![cfg(feature = "tract")]
use flashmat_core::Silent;
use flashmat_core::base::arena::Arena;
use flashmat_core::base::exec::Inline;
use flashmat_core::base::simd::Level;
use flashmat_core::frame::LinearImage;
use flashmat_core::maps::MapsMut;
use flashmat_core::net::Inference;
use flashmat_core::net::tract::FloatNetwork;
use flashmat_core::net::{Mixing, Model};
use flashmat_tests::golden::{TOY_MODEL, TOY_SIZE, toy, toy_photo};
use flashmat_tests::runs::smooth_photo;
use flashmat_tests::snr::layer_snr;

#[test]
fn float_tensors_and_maps_are_the_reference() {
    let (expected, rgb) = (toy(), toy_photo());
    let model = Model::from_bytes(TOY_MODEL).expect("the golden model");
    let network = FloatNetwork::new(model.clone(), TOY_SIZE).expect("float weights");
    let clipped = vec![0; TOY_SIZE * TOY_SIZE];
    let photo = LinearImage::new(TOY_SIZE, &rgb, &clipped, 43.35);
    for (number, values) in network.tensors(&photo).expect("a run") {
        let name = model.graph().tensors()[number].name.as_str();
        let distance = expected[&format!("float/{name}")].distance(name, &values);
        println!("{name}: {distance:.1e}");
        assert!(distance < 2e-5, "{name}: {distance}");
    }
    let pixels = TOY_SIZE * TOY_SIZE;
    let (mut albedo, mut normal, mut roughness) =
        (vec![0.0; 3 * pixels], vec![0.0; 3 * pixels], vec![0.0; pixels]);
    let mut maps =
        MapsMut { size: TOY_SIZE, albedo: &mut albedo, normal: &mut normal, roughness: &mut roughness };
    let answer = network
        .infer(&photo, Mixing::default(), &Inline, &mut Arena::new(&mut []), &mut maps, &mut Silent)
        .expect("a run");
    assert!(expected["float/probabilities"].distance("probabilities", &answer.predicted.0) < 1e-5);
    for (name, values) in [("albedo", &albedo), ("normal", &normal), ("roughness", &roughness)] {
        assert!(expected[&format!("float/map/{name}")].distance(name, values) < 2e-5, "{name}");
    }
}

/// Random weights (some seeds leave a tensor little of its range: this one does not); the trained model is asked below.
#[test]
fn int8_follows_float_layer_by_layer() {
    let model = Model::from_bytes(TOY_MODEL).expect("the golden model");
    let report = layer_snr(&model, TOY_SIZE, &toy_photo(), Level::detect()).expect("both run");
    assert_eq!(report.len(), model.graph().tensors().len() - 1);
    for layer in &report {
        println!(
            "{:12} {:5.1} dB{}",
            layer.name,
            layer.db,
            if layer.feeds_head { "  (a head reads it)" } else { "" }
        );
        assert!(layer.db > 30.0, "{layer:?}");
    }
}

/// Least signal over rounding in the classifier and its trunk, decibels.
const CLASS_DB: f64 = 16.0;

/// The product's file has no float weights: the float engine then runs what the int8 weights stand for, and only the
/// rounding of activations (and of the mixed heads) is between the two engines.
#[test]
fn a_file_without_float_weights_runs_too() {
    let bytes =
        std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/../models/phone.fmat")).expect("the model");
    let model = Model::from_bytes(&bytes).expect("a model");
    assert!(!model.has_float());
    let report = layer_snr(&model, 128, &smooth_photo(128), Level::detect()).expect("both run");
    for layer in &report {
        println!(
            "{:14} {:5.1} dB{}",
            layer.name,
            layer.db,
            if layer.feeds_head { "  (a head reads it)" } else { "" }
        );
        // The detail's range is that of edges, the normals' that of steep relief, and this photo has little of both. What
        // int8 costs the maps is in the model's card.
        let wide = ["detail", "normal.dec5"].contains(&layer.name.as_str());
        // The trunk's narrow tensors have no ReLU and a few large values; its classes are what counts (the model's card).
        let of_class = layer.name.starts_with("trunk") || ["hidden", "logits"].contains(&layer.name.as_str());
        let least = if of_class {
            CLASS_DB
        } else if layer.feeds_head && !wide {
            30.0
        } else {
            20.0
        };
        assert!(layer.db > least, "{layer:?}");
    }
    // The three decoders' last tensors, and the detail.
    assert_eq!(report.iter().filter(|layer| layer.feeds_head).count(), 4);
}
