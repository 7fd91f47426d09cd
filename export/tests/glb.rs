//! GLB files against the `gltf` and `png` crates.
use flashmat_core::maps::Maps;
use flashmat_export::glb::{self, Material};
use flashmat_export::{Error, Pictures};
use std::io::Cursor;

const SIZE: usize = 4;

fn maps() -> (Vec<f32>, Vec<f32>, Vec<f32>) {
    let albedo = (0..3 * SIZE * SIZE).map(|i| i as f32 / 47.0).collect();
    let normal = [[0.0; 16], [0.6; 16], [0.8; 16]].concat();
    let roughness = (0..SIZE * SIZE).map(|i| i as f32 / 15.0).collect();
    (albedo, normal, roughness)
}

fn decoded(file: &[u8]) -> Vec<u8> {
    let mut reader = ::png::Decoder::new(Cursor::new(file)).read_info().expect("a PNG");
    let mut bytes = vec![0; reader.output_buffer_size().expect("a size")];
    reader.next_frame(&mut bytes).expect("pixels");
    bytes
}

fn codes(row: impl Fn(usize, &mut [u8]), channels: usize) -> Vec<u8> {
    let mut out = vec![0; channels * SIZE * SIZE];
    out.chunks_exact_mut(channels * SIZE).enumerate().for_each(|(y, line)| row(y, line));
    out
}

#[test]
fn the_gltf_crate_reads_back_what_was_written() {
    let (albedo, normal, roughness) = maps();
    let maps = Maps { size: SIZE, albedo: &albedo, normal: &normal, roughness: &roughness };
    for (f0, metallic) in [(0.05, 0), (0.12, 0), (0.4, 255)] {
        let material = Material { name: "wood", pictures: Pictures::Planes(maps), f0, fov_deg: 43.35 };
        let file = glb::file(&material).expect("a file").to_vec();
        assert_eq!(file.len() % 4, 0);
        let document = gltf::Gltf::from_slice(&file).expect("valid");
        let blob = document.blob.clone().expect("binary chunk");
        let primitive = document.meshes().next().expect("mesh").primitives().next().expect("primitive");
        let reader = primitive.reader(|_| Some(&blob));
        let positions: Vec<_> = reader.read_positions().expect("positions").collect();
        let half = 0.397_4; // tan(43.35 / 2)
        assert!((positions[0][0] + half).abs() < 1e-4 && (positions[0][1] - half).abs() < 1e-4);
        // Bounds are to the bit those of the positions.
        let bounds = primitive.bounding_box();
        assert_eq!((bounds.min, bounds.max), (positions[1], positions[3]));
        assert_eq!(reader.read_tex_coords(0).expect("uv").into_f32().next(), Some([0.0, 0.0]));
        let indices: Vec<_> = reader.read_indices().expect("indices").into_u32().collect();
        assert_eq!(indices, [0, 1, 2, 0, 2, 3]);
        assert_eq!(reader.read_normals().expect("normals").next(), Some([0.0, 0.0, 1.0]));
        assert_eq!(reader.read_tangents().expect("tangents").next(), Some([1.0, 0.0, 0.0, 1.0]));

        let material = primitive.material();
        assert_eq!(material.name(), Some("wood"));
        // F0 = ((n - 1) / (n + 1))²; a metal's is its base colour.
        let ior = material.ior().expect("ior");
        let wanted = if metallic == 0 { f0 } else { 0.05 };
        assert!((((ior - 1.0) / (ior + 1.0)).powi(2) - wanted).abs() < 1e-6);
        let pbr = material.pbr_metallic_roughness();
        let picture = |texture: gltf::Texture<'_>| {
            let gltf::image::Source::View { view, mime_type } = texture.source().source() else {
                panic!("embedded")
            };
            assert_eq!(mime_type, "image/png");
            decoded(&blob[view.offset()..view.offset() + view.length()])
        };
        let colour = picture(pbr.base_color_texture().expect("texture").texture());
        assert_eq!(colour, codes(|y, line| maps.albedo_row(y, line).expect("row"), 3));
        let slopes = picture(material.normal_texture().expect("texture").texture());
        assert_eq!(slopes, codes(|y, line| maps.normal_row(y, line).expect("row"), 3));
        let orm = picture(pbr.metallic_roughness_texture().expect("texture").texture());
        let wanted: Vec<u8> = (0..16).flat_map(|i| [255, 17 * i, metallic]).collect();
        assert_eq!(orm, wanted);
    }
}

#[test]
fn planes_and_their_codes_give_the_same_bytes() {
    let (albedo, normal, roughness) = maps();
    let maps = Maps { size: SIZE, albedo: &albedo, normal: &normal, roughness: &roughness };
    let pictures = Pictures::Codes {
        size: SIZE,
        albedo: &codes(|y, line| maps.albedo_row(y, line).expect("row"), 3),
        normal: &codes(|y, line| maps.normal_row(y, line).expect("row"), 3),
        roughness: &codes(|y, line| maps.roughness_row(y, line).expect("row"), 1),
    };
    let planes = Material { name: "oak", pictures: Pictures::Planes(maps), f0: 0.06, fov_deg: 40.0 };
    assert_eq!(glb::file(&planes), glb::file(&Material { pictures, ..planes }));
}

#[test]
fn any_name_is_a_name() {
    let (albedo, normal, roughness) = maps();
    let maps = Maps { size: SIZE, albedo: &albedo, normal: &normal, roughness: &roughness };
    for name in ["", "a \"toy\" \\ \u{fc}\n\u{1}\u{7f}\u{1fab5}", "\u{2028}</script>"] {
        let material = Material { name, pictures: Pictures::Planes(maps), f0: 0.05, fov_deg: 40.0 };
        let file = glb::file(&material).expect("a file").to_vec();
        let document = gltf::Gltf::from_slice(&file).expect("valid");
        assert_eq!(document.materials().next().expect("material").name(), Some(name));
        assert_eq!(document.nodes().next().expect("node").name(), Some(name));
    }
}

#[test]
fn what_makes_no_file_is_an_error() {
    let (albedo, normal, roughness) = maps();
    let maps = Maps { size: SIZE, albedo: &albedo, normal: &normal, roughness: &roughness };
    let good = Material { name: "", pictures: Pictures::Planes(maps), f0: 0.05, fov_deg: 40.0 };
    for f0 in [f32::NAN, -1.0, 1.0] {
        assert_eq!(glb::file(&Material { f0, ..good }), Err(Error::Reflectance));
    }
    for fov_deg in [f32::NAN, 0.0, 180.0, f32::INFINITY] {
        assert_eq!(glb::file(&Material { fov_deg, ..good }), Err(Error::FieldOfView));
    }
    let short = Pictures::Planes(Maps { normal: &normal[1..], ..maps });
    let needed = flashmat_core::Error::PlaneLength { needed: 48, given: 47 };
    assert_eq!(glb::file(&Material { pictures: short, ..good }), Err(Error::Maps(needed)));
    let none = Pictures::Codes { size: 0, albedo: &[], normal: &[], roughness: &[] };
    assert!(glb::file(&Material { pictures: none, ..good }).is_err());
}
