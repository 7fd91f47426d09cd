//! The frame stage: any format, size, stride, rotation, range and field of view. What is accepted becomes a picture in
//! \[0,1\], the same bits with and without vector registers.
#![no_main]

use flashmat_fuzz::core::{Arena, At, Error, Inline, Level, Simd, prepare, prepare_bytes};
use flashmat_fuzz::{Bytes, Photo, fov};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let mut bytes = Bytes::new(data);
    let usual = 1 + usize::from(bytes.u8()) % 96;
    let size = bytes.amount(usual);
    let fov = fov(&mut bytes);
    let photo = Photo::new(&mut bytes, 300);
    let Ok(frame) = photo.frame() else { return };
    let crop = frame.crop(&fov);
    if let Ok(crop) = crop {
        let (width, height) = (frame.width() as f64, frame.height() as f64);
        assert!(crop.side > 0.0 && crop.x >= 0.0 && crop.y >= 0.0, "{crop:?}");
        assert!(crop.x + crop.side <= width + 1e-6 && crop.y + crop.side <= height + 1e-6, "{crop:?}");
        assert!(crop.fov_deg > 0.0 && crop.fov_deg <= 170.1, "{crop:?}");
    }
    // Sizes that are refused anyway need no memory.
    let memory = if size <= 512 { prepare_bytes(size) } else { 1 << 16 };
    let at = |simd: Simd| -> Result<(Vec<u32>, Vec<u8>), Error> {
        let mut workspace = vec![0xA5; memory];
        let image = prepare(&frame, size, &fov, &At::new(&Inline, simd), &mut Arena::new(&mut workspace))?;
        image.check().expect("lengths");
        assert!(image.rgb.iter().all(|v| (0.0..=1.0).contains(v)), "outside [0,1]");
        Ok((image.rgb.iter().map(|v| v.to_bits()).collect(), image.clipped.to_vec()))
    };
    let fastest = at(Simd::for_level(Level::detect()).expect("its own level"));
    match &fastest {
        Ok(_) => assert!(crop.is_ok()),
        Err(error) => {
            assert!(crop.is_err() || !(1..=512).contains(&size), "refused a good photo: {error}");
        }
    }
    assert_eq!(fastest, at(Simd::BASELINE), "a CPU level changed a bit");
});
