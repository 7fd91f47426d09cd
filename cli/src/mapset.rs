//! Material maps read from a folder: those of a capture, or those of a ground-truth material.
use crate::failure::Failure;
use crate::material::OwnedMaps;
use crate::photo::{self, Photo, Pixels};
use flashmat_core::base::arena::Arena;
use flashmat_core::base::exec::Inline;
use flashmat_core::frame::{self, Encoding, FieldOfView};
use glam::Vec3;
use std::path::{Path, PathBuf};

/// Reads `albedo`, `normal` and `roughness` (PNG, JPEG, TIFF or WebP) from `folder`: the central square, averaged to
/// `size` pixels a side, or as many as the albedo has.
pub(crate) fn read(folder: &Path, size: Option<usize>) -> Result<OwnedMaps, Failure> {
    let albedo = photo::read_map(&find(folder, "albedo")?)?;
    let size = size.unwrap_or(albedo.width.min(albedo.height) as usize);
    let load = |name: &str| -> Result<Vec<f32>, Failure> {
        let path = find(folder, name)?;
        planes(&photo::read_map(&path)?, Encoding::Linear, size).map_err(|e| Failure::core(&path, &e))
    };
    let albedo = planes(&albedo, Encoding::Srgb, size).map_err(|e| Failure::core(folder, &e))?;
    let mut normal = load("normal")?;
    unit_vectors(&mut normal);
    let mut roughness = load("roughness")?;
    roughness.truncate(size * size);
    Ok(OwnedMaps { size, albedo, normal, roughness })
}

/// `folder/name` with whatever extension is there.
fn find(folder: &Path, name: &str) -> Result<PathBuf, Failure> {
    let extensions = ["png", "jpg", "jpeg", "tif", "tiff", "webp"];
    let mut paths = extensions.iter().map(|e| folder.join(name).with_extension(e));
    paths.find(|p| p.is_file()).ok_or_else(|| {
        let what = format!("holds no {name} map ({name}.png or .jpg)");
        Failure::new(
            folder,
            what,
            "give a folder that `flashmat capture` wrote, or one with these three maps",
        )
    })
}

/// The central square of a picture as 3 planes, averaged to `size` a side in linear values.
pub(crate) fn planes(
    picture: &Photo,
    encoding: Encoding,
    size: usize,
) -> Result<Vec<f32>, flashmat_core::Error> {
    // Files of floats hold linear values.
    let encoding = if matches!(picture.pixels, Pixels::RgbF32(_)) { Encoding::Linear } else { encoding };
    let frame = picture.frame(encoding)?;
    let mut bytes = vec![0_u8; frame::prepare_bytes(size)];
    let image = frame::prepare(&frame, size, &FieldOfView::default(), &Inline, &mut Arena::new(&mut bytes))?;
    Ok(image.rgb.to_vec())
}

/// Codes (n + 1) / 2 in three planes to unit vectors; where there is no direction, straight up.
fn unit_vectors(codes: &mut [f32]) {
    let (x, rest) = codes.split_at_mut(codes.len() / 3);
    let (y, z) = rest.split_at_mut(rest.len() / 2);
    for ((x, y), z) in x.iter_mut().zip(y).zip(z) {
        let n = (Vec3::new(*x, *y, *z) * 2.0 - Vec3::ONE).normalize_or(Vec3::Z);
        [*x, *y, *z] = n.to_array();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::png::{self, Depth};

    #[test]
    fn maps_come_back_as_they_were_written() {
        let folder = std::env::temp_dir().join(format!("flashmat-mapset-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("folder");
        let n = 32;
        let at = |i: usize| (i % n) as f32 / n as f32;
        let tilt = |i: usize| Vec3::new(at(i) - 0.5, 0.3, 1.0).normalize();
        let maps = OwnedMaps {
            size: n,
            albedo: (0..3 * n * n).map(at).collect(),
            normal: (0..3).flat_map(|c| (0..n * n).map(move |i| tilt(i)[c])).collect(),
            roughness: (0..n * n).map(|i| 1.0 - at(i)).collect(),
        };
        let view = maps.view();
        let save = |name: &str, body: &dyn Fn(&mut Vec<u8>)| {
            let mut bytes = Vec::new();
            body(&mut bytes);
            std::fs::write(folder.join(name), bytes).expect("write");
        };
        save("albedo.png", &|f| png::albedo(f, &view, Depth::Sixteen).expect("albedo"));
        save("normal.png", &|f| png::normal(f, &view, Depth::Sixteen).expect("normal"));
        assert!(
            read(&folder, None).expect_err("no roughness").to_string().contains("holds no roughness map")
        );
        save("roughness.png", &|f| png::roughness(f, &view, Depth::Sixteen).expect("roughness"));
        let read = read(&folder, None).expect("maps");
        let pairs =
            [(&maps.albedo, &read.albedo), (&maps.normal, &read.normal), (&maps.roughness, &read.roughness)];
        for (wanted, got) in pairs {
            assert_eq!(wanted.len(), got.len());
            assert!(wanted.iter().zip(got).all(|(w, g)| (w - g).abs() < 1e-4));
        }
        std::fs::remove_dir_all(folder).expect("clean");
    }
}
