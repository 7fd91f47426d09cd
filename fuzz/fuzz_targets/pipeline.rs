//! The whole pipeline at 128 x 128 on hostile photos: a capture gives maps that keep their ranges, and, now and then
//! asked, the same ones without vector registers; or an error.
#![no_main]

use flashmat_fuzz::core::{
    CaptureOptions, Class, Error, Frame, Level, Model, Session, SessionOptions, Silent,
};
use flashmat_fuzz::{Bytes, Photo, TOY, fov};
use libfuzzer_sys::fuzz_target;
use std::cell::RefCell;

thread_local! {
    static FASTEST: RefCell<Session<'static>> = RefCell::new(session(None));
    static SCALAR: RefCell<Session<'static>> = RefCell::new(session(Some(Level::Scalar)));
}

fn session(level: Option<Level>) -> Session<'static> {
    let model = Model::from_bytes(TOY).expect("the toy model");
    Session::new(model, &SessionOptions { size: 128, level, threads: 1 }).expect("a session")
}

/// The maps' bits and the numbers beside them.
fn capture(
    session: &RefCell<Session<'_>>,
    frame: &Frame<'_>,
    options: &CaptureOptions,
) -> Result<Vec<u32>, Error> {
    let mut session = session.borrow_mut();
    let capture = session.capture(frame, options, &mut Silent)?;
    let maps = capture.maps;
    assert!(maps.albedo.iter().chain(maps.roughness).all(|v| (0.0..=1.0).contains(v)), "outside [0,1]");
    assert!(capture.observability.iter().all(|v| (0.0..=1.0).contains(v)), "observability");
    let plane = maps.normal.len() / 3;
    for i in 0..plane {
        let [x, y, z] = [0, 1, 2].map(|c| maps.normal[c * plane + i]);
        let length = x * x + y * y + z * z;
        assert!(z > 0.0 && (length - 1.0).abs() < 1e-3, "normal {x} {y} {z}");
    }
    assert!(capture.render.iter().all(|v| v.is_finite() && *v >= 0.0), "render");
    let sum: f32 = capture.probabilities.0.iter().sum();
    assert!((sum - 1.0).abs() < 1e-3, "probabilities sum to {sum}");
    let facts = [capture.f0, capture.light_scale, capture.room_light, capture.residual];
    assert!(facts.iter().all(|v| v.is_finite() && *v >= 0.0), "{facts:?}");
    let all = maps.albedo.iter().chain(maps.normal).chain(maps.roughness).chain(capture.render).chain(&facts);
    Ok(all.map(|v| v.to_bits()).collect())
}

fuzz_target!(|data: &[u8]| {
    let mut bytes = Bytes::new(data);
    let options = CaptureOptions {
        fov: fov(&mut bytes),
        class: [None, Class::ALL.get(usize::from(bytes.u8())).copied()][usize::from(bytes.u8() % 2)],
        light_scale: if bytes.u8() % 4 == 0 { Some(bytes.real(1e-3, 1e3)) } else { None },
        // Ten times as slow as all the rest.
        refine: bytes.u8() % 16 == 1,
        ..CaptureOptions::default()
    };
    let twice = bytes.u8() % 16 == 1;
    let photo = Photo::new(&mut bytes, 200);
    let Ok(frame) = photo.frame() else { return };
    let first = FASTEST.with(|session| capture(session, &frame, &options));
    if twice {
        let second = SCALAR.with(|session| capture(session, &frame, &options));
        assert!(first == second, "a CPU level changed a bit");
    }
});
