//! The int8 engine against the numpy reference: every tensor bit for bit, on every level.
use flashmat_core::base::exec::{Inline, Pool};
use flashmat_core::kernels::Kernels;
use flashmat_core::net::graph::Tensor;
use flashmat_core::net::{Class, Model, Network, Tap};
use flashmat_tests::golden::{Expected, TOY_MODEL, TOY_SIZE, toy, toy_photo};
use flashmat_tests::runs::NetRun;
use std::collections::BTreeMap;

struct Check<'a> {
    expected: &'a BTreeMap<String, Expected>,
    seen: usize,
}

impl Tap for Check<'_> {
    fn image(&mut self, _: usize, tensor: &Tensor<'_>, codes: &[i8]) {
        let name = tensor.name.as_str();
        self.expected[name].assert_codes(name, codes);
        self.seen += 1;
    }

    fn vector(&mut self, _: usize, tensor: &Tensor<'_>, values: &[f32]) {
        let name = tensor.name.as_str();
        assert_eq!(self.expected[name].distance(name, values), 0.0, "{name}");
        self.seen += 1;
    }
}

fn levels() -> impl Iterator<Item = &'static Kernels> {
    let required = std::env::var("FLASHMAT_REQUIRE_LEVEL").ok();
    if let Some(required) = required {
        assert!(Kernels::supported().any(|k| k.level().name() == required), "{required} does not run here");
    }
    Kernels::supported().inspect(|k| println!("level {}", k.level().name()))
}

#[test]
fn every_tensor_is_the_reference_on_every_level() {
    let expected = toy();
    let model = Model::from_bytes(TOY_MODEL).expect("the golden model");
    assert!(model.has_float());
    let mut maps: Option<Vec<f32>> = None;
    for kernels in levels() {
        let network = Network::new(model.clone(), TOY_SIZE, kernels).expect("128 suits");
        let mut run = NetRun::new(&network, TOY_SIZE, toy_photo());
        let mut check = Check { expected: &expected, seen: 0 };
        let answer = run.run(&network, None, &Inline, Some(&mut check)).expect("a run");
        assert_eq!(check.seen, model.graph().tensors().len());
        assert!(expected["probabilities"].distance("probabilities", &answer.predicted.0) < 1e-6);
        for (class, group) in [(None, "map"), (Some(Class::Metal), "metal")] {
            run.run(&network, class, &Inline, None).expect("a run");
            for map in ["albedo", "normal", "roughness"] {
                let distance = expected[&format!("{group}/{map}")].distance(map, run.map(map));
                // The probabilities differ in the last bit: a weight's code may then round the other way.
                let limit = if class.is_some() { 1e-6 } else { 2e-3 };
                println!("{} {group}/{map}: {distance:.1e}", kernels.name());
                assert!(distance < limit, "{group}/{map}: {distance}");
            }
        }
        run.light_scale = Some(1.5);
        run.run(&network, None, &Inline, None).expect("a run");
        for map in ["albedo", "normal", "roughness"] {
            let distance = expected[&format!("lit/{map}")].distance(map, run.map(map));
            assert!(distance < 2e-3, "lit/{map}: {distance}");
        }
        let bits = [&run.albedo[..], &run.normal, &run.roughness].concat();
        assert_eq!(maps.get_or_insert_with(|| bits.clone()), &bits, "{} differs", kernels.name());
    }
}

/// Names of the tensors that were written.
#[derive(Default)]
struct Written(Vec<String>);

impl Tap for Written {
    fn image(&mut self, _: usize, tensor: &Tensor<'_>, _: &[i8]) {
        self.0.push(tensor.name.as_str().to_owned());
    }

    fn vector(&mut self, _: usize, tensor: &Tensor<'_>, _: &[f32]) {
        self.0.push(tensor.name.as_str().to_owned());
    }
}

#[test]
fn a_class_that_is_known_spares_the_classifier_and_changes_no_bit() {
    let model = Model::from_bytes(TOY_MODEL).expect("the golden model");
    let network = Network::new(model, TOY_SIZE, Kernels::scalar()).expect("128 suits");
    let mut own = NetRun::new(&network, TOY_SIZE, toy_photo());
    let mut all = Written::default();
    let found = own.run(&network, None, &Inline, Some(&mut all)).expect("a run");
    let mut told = NetRun::new(&network, TOY_SIZE, toy_photo());
    told.known = Some(found.predicted);
    let mut some = Written::default();
    assert_eq!(told.run(&network, None, &Inline, Some(&mut some)).expect("a run"), found);
    for map in ["albedo", "normal", "roughness"] {
        assert_eq!(own.map(map), told.map(map), "{map}");
    }
    let spared: Vec<_> = all.0.iter().filter(|name| !some.0.contains(name)).collect();
    println!("not run: {spared:?}");
    assert!(spared.iter().any(|name| *name == "logits") && spared.iter().any(|name| *name == "hidden"));
    assert!(some.0.iter().all(|name| all.0.contains(name)) && some.0.iter().any(|name| name == "enc1"));
}

#[test]
fn threads_change_no_bit() {
    let model = Model::from_bytes(TOY_MODEL).expect("the golden model");
    let network = Network::new(model, TOY_SIZE, Kernels::scalar()).expect("128 suits");
    let mut alone = NetRun::new(&network, TOY_SIZE, toy_photo());
    alone.run(&network, None, &Inline, None).expect("a run");
    for threads in [2, 3] {
        let mut together = NetRun::new(&network, TOY_SIZE, toy_photo());
        together.run(&network, None, &Pool::new(threads).expect("threads"), None).expect("a run");
        for map in ["albedo", "normal", "roughness"] {
            assert_eq!(alone.map(map), together.map(map), "{map}, {threads} threads");
        }
    }
}

#[test]
fn an_override_is_reported_beside_the_prediction() {
    let model = Model::from_bytes(TOY_MODEL).expect("the golden model");
    let network = Network::new(model, TOY_SIZE, Kernels::scalar()).expect("128 suits");
    let mut run = NetRun::new(&network, TOY_SIZE, toy_photo());
    let free = run.run(&network, None, &Inline, None).expect("a run");
    let wood = run.run(&network, Some(Class::Wood), &Inline, None).expect("a run");
    assert_eq!((free.used, wood.predicted), (free.predicted, free.predicted));
    assert_eq!(wood.used.best(), Class::Wood);
}
