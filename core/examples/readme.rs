//! The README's lines for Rust, on a photo that is made here.
//!
//! `cargo run --release -p flashmat-core --example readme -- models/phone.fmat`
use flashmat_core::capture::CaptureOptions;
use flashmat_core::frame::Frame;
use flashmat_core::net::Model;
use flashmat_core::{Session, SessionOptions, Silent};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("give a model file, such as models/phone.fmat")?;
    let (width, height) = (400, 300);
    let rgb: Vec<u8> = (0..3 * width * height).map(|i| (90 + i / 3 % width / 40 % 2 * 80) as u8).collect();

    let bytes = std::fs::read(path)?;
    let mut session = Session::new(Model::from_bytes(&bytes)?, &SessionOptions::default())?;
    let frame = Frame::rgb8(&rgb, width, height, 3 * width)?;
    let capture = session.capture(&frame, &CaptureOptions::default(), &mut Silent)?;
    let middle = capture.maps.size * capture.maps.size / 2;
    println!("{}, roughness {:.2}", capture.class.name(), capture.maps.roughness[middle]);
    Ok(())
}
