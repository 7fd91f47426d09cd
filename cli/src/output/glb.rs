//! `material.glb`: the maps on a square, as one binary glTF 2.0 file for any viewer.
//!
//! Metallic-roughness: base colour = albedo (sRGB), G = roughness, B = metallic (P(metal), rounded), normals OpenGL.
//! `KHR_materials_ior` carries F0 (0.05 and up, by P(metal)), where glTF alone has 0.04. The square lies in z = 0, faces +z and has the size
//! in which the camera and the flash stand at (0, 0, 1): half a side is tan(fov / 2).
use super::png;
use crate::material::OwnedMaps;
use flashmat_core::brdf::{self, F0_DIELECTRIC};
use gltf_json as gltf;
use gltf_json::validation::{Checked, USize64};
use image::ExtendedColorType;
use std::collections::BTreeMap;
use std::io::{self, Write};

/// Writes the file. `f0` is the reflectance at normal incidence, blended by P(metal); `fov_deg` the angle of view over
/// the maps; `name` the material's name.
pub(crate) fn write(
    out: &mut dyn Write,
    name: &str,
    maps: &OwnedMaps,
    f0: f32,
    fov_deg: f32,
) -> io::Result<()> {
    let mut root = gltf::Root {
        asset: gltf::Asset {
            generator: Some(format!("flashmat {}", env!("CARGO_PKG_VERSION"))),
            ..Default::default()
        },
        extensions_used: vec!["KHR_materials_ior".to_owned()],
        ..Default::default()
    };
    let mut bin = Bin::default();
    let material = material(&mut root, &mut bin, name, maps, f0)?;
    let mesh = quad(&mut root, &mut bin, name, material, (fov_deg.to_radians() / 2.0).tan());
    let node = root.push(gltf::Node { mesh: Some(mesh), name: Some(name.to_owned()), ..Default::default() });
    let scene = root.push(gltf::Scene {
        nodes: vec![node],
        name: None,
        extensions: None,
        extras: Default::default(),
    });
    root.scene = Some(scene);
    bin.pad();
    root.push(gltf::Buffer {
        byte_length: bin.length(0),
        name: None,
        uri: None,
        extensions: None,
        extras: Default::default(),
    });
    let mut json = gltf::serialize::to_vec(&root).map_err(io::Error::other)?;
    json.resize(json.len().next_multiple_of(4), b' ');
    container(out, &json, &bin.bytes)
}

/// The GLB container: header, JSON chunk, binary chunk; both chunks padded to 4 bytes already.
fn container(out: &mut dyn Write, json: &[u8], bin: &[u8]) -> io::Result<()> {
    let word = |n: usize| u32::try_from(n).map(u32::to_le_bytes).map_err(io::Error::other);
    out.write_all(b"glTF")?;
    out.write_all(&2_u32.to_le_bytes())?;
    out.write_all(&word(12 + 8 + json.len() + 8 + bin.len())?)?;
    for (kind, chunk) in [(b"JSON", json), (b"BIN\0", bin)] {
        out.write_all(&word(chunk.len())?)?;
        out.write_all(kind)?;
        out.write_all(chunk)?;
    }
    Ok(())
}

/// The binary chunk while it grows.
#[derive(Default)]
struct Bin {
    bytes: Vec<u8>,
}

impl Bin {
    fn pad(&mut self) {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
    }

    fn length(&self, from: usize) -> USize64 {
        USize64(self.bytes.len().saturating_sub(from) as u64)
    }

    /// Appends `data` on a 4-byte boundary and describes it.
    fn view(
        &mut self,
        root: &mut gltf::Root,
        data: &[u8],
        target: Option<gltf::buffer::Target>,
    ) -> gltf::Index<gltf::buffer::View> {
        self.pad();
        let start = self.bytes.len();
        self.bytes.extend_from_slice(data);
        root.push(gltf::buffer::View {
            buffer: gltf::Index::new(0),
            byte_length: self.length(start),
            byte_offset: Some(USize64(start as u64)),
            byte_stride: None,
            name: None,
            target: target.map(Checked::Valid),
            extensions: None,
            extras: Default::default(),
        })
    }
}

fn material(
    root: &mut gltf::Root,
    bin: &mut Bin,
    name: &str,
    maps: &OwnedMaps,
    f0: f32,
) -> io::Result<gltf::Index<gltf::Material>> {
    let view = maps.view();
    // F0 is blended by P(metal): half-way is P = 0.5. A metal's F0 is its base colour, whatever the index says.
    let (metallic, dielectric_f0) = if f0 >= brdf::f0(0.5) { (u8::MAX, F0_DIELECTRIC) } else { (0, f0) };
    let albedo = png::codes::<u8>(maps.size, 3, |y, line| view.albedo_row(y, line))?;
    let normal = png::codes::<u8>(maps.size, 3, |y, line| view.normal_row(y, line))?;
    let roughness = png::codes::<u8>(maps.size, 1, |y, line| view.roughness_row(y, line))?;
    // R is not read; full white keeps the picture usable as an occlusion map.
    let surface: Vec<u8> = roughness.iter().flat_map(|&r| [u8::MAX, r, metallic]).collect();
    let sampler = root.push(gltf::texture::Sampler {
        mag_filter: Some(Checked::Valid(gltf::texture::MagFilter::Linear)),
        min_filter: Some(Checked::Valid(gltf::texture::MinFilter::LinearMipmapLinear)),
        wrap_s: Checked::Valid(gltf::texture::WrappingMode::ClampToEdge),
        wrap_t: Checked::Valid(gltf::texture::WrappingMode::ClampToEdge),
        ..Default::default()
    });
    let mut texture = |name: &str, codes: &[u8]| -> io::Result<gltf::Index<gltf::Texture>> {
        let mut file = Vec::new();
        png::encode(&mut file, codes, maps.size, maps.size, ExtendedColorType::Rgb8)?;
        let buffer_view = Some(bin.view(root, &file, None));
        let source = root.push(gltf::Image {
            buffer_view,
            mime_type: Some(gltf::image::MimeType("image/png".to_owned())),
            name: Some(name.to_owned()),
            uri: None,
            extensions: None,
            extras: Default::default(),
        });
        Ok(root.push(gltf::Texture {
            name: Some(name.to_owned()),
            sampler: Some(sampler),
            source,
            extensions: None,
            extras: Default::default(),
        }))
    };
    let base_color = texture("albedo", &albedo)?;
    let metallic_roughness = texture("metallic-roughness", &surface)?;
    let normal = texture("normal", &normal)?;
    let info = |index| {
        Some(gltf::texture::Info { index, tex_coord: 0, extensions: None, extras: Default::default() })
    };
    Ok(root.push(gltf::Material {
        name: Some(name.to_owned()),
        pbr_metallic_roughness: gltf::material::PbrMetallicRoughness {
            base_color_texture: info(base_color),
            metallic_roughness_texture: info(metallic_roughness),
            ..Default::default()
        },
        normal_texture: Some(gltf::material::NormalTexture {
            index: normal,
            scale: 1.0,
            tex_coord: 0,
            extensions: None,
            extras: Default::default(),
        }),
        extensions: Some(gltf::extensions::material::Material {
            ior: Some(gltf::extensions::material::Ior {
                ior: gltf::extensions::material::IndexOfRefraction(index_of_refraction(dielectric_f0)),
                extras: Default::default(),
            }),
        }),
        ..Default::default()
    }))
}

/// F0 = ((n - 1) / (n + 1))², solved for n.
fn index_of_refraction(f0: f32) -> f32 {
    (1.0 + f0.sqrt()) / (1.0 - f0.sqrt())
}

fn quad(
    root: &mut gltf::Root,
    bin: &mut Bin,
    name: &str,
    material: gltf::Index<gltf::Material>,
    half: f32,
) -> gltf::Index<gltf::Mesh> {
    use gltf::accessor::{ComponentType as Component, GenericComponentType, Type};
    use gltf::buffer::Target;
    use gltf::mesh::Semantic;
    // Top left, bottom left, bottom right, top right; texture rows run down.
    let corners = [(-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (1.0, 1.0)];
    let positions = corners.map(|(x, y)| [x * half, y * half, 0.0_f32]);
    let uvs = corners.map(|(x, y)| [(x + 1.0) / 2.0, (1.0 - y) / 2.0_f32]);
    let mut accessor = |data: &[u8], count: u64, component, kind, target, range: Option<f32>| {
        let buffer_view = Some(bin.view(root, data, Some(target)));
        let corner = |s: f32| range.map(|r| gltf::Value::from(vec![s * r, s * r, 0.0]));
        root.push(gltf::Accessor {
            buffer_view,
            byte_offset: None,
            count: USize64(count),
            component_type: Checked::Valid(GenericComponentType(component)),
            extensions: None,
            extras: Default::default(),
            type_: Checked::Valid(kind),
            min: corner(-1.0),
            max: corner(1.0),
            name: None,
            normalized: false,
            sparse: None,
        })
    };
    let bytes = bytemuck::cast_slice::<f32, u8>;
    let vertices = Target::ArrayBuffer;
    let attributes = BTreeMap::from([
        (
            Semantic::Positions,
            accessor(bytes(positions.as_flattened()), 4, Component::F32, Type::Vec3, vertices, Some(half)),
        ),
        (
            Semantic::Normals,
            accessor(
                bytes([[0.0, 0.0, 1.0]; 4].as_flattened()),
                4,
                Component::F32,
                Type::Vec3,
                vertices,
                None,
            ),
        ),
        (
            Semantic::Tangents,
            accessor(
                bytes([[1.0, 0.0, 0.0, 1.0]; 4].as_flattened()),
                4,
                Component::F32,
                Type::Vec4,
                vertices,
                None,
            ),
        ),
        (
            Semantic::TexCoords(0),
            accessor(bytes(uvs.as_flattened()), 4, Component::F32, Type::Vec2, vertices, None),
        ),
    ]);
    let triangles: [u16; 6] = [0, 1, 2, 0, 2, 3];
    let triangles = triangles.map(u16::to_le_bytes);
    let indices =
        accessor(triangles.as_flattened(), 6, Component::U16, Type::Scalar, Target::ElementArrayBuffer, None);
    root.push(gltf::Mesh {
        name: Some(name.to_owned()),
        primitives: vec![gltf::mesh::Primitive {
            attributes: attributes.into_iter().map(|(k, v)| (Checked::Valid(k), v)).collect(),
            indices: Some(indices),
            material: Some(material),
            mode: Checked::Valid(gltf::mesh::Mode::Triangles),
            extensions: None,
            extras: Default::default(),
            targets: None,
        }],
        weights: None,
        extensions: None,
        extras: Default::default(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn maps() -> OwnedMaps {
        OwnedMaps {
            size: 4,
            albedo: vec![0.5; 48],
            normal: [vec![0.0; 32], vec![1.0; 16]].concat(),
            roughness: (0..16).map(|i| i as f32 / 15.0).collect(),
        }
    }

    #[test]
    fn the_gltf_crate_reads_back_what_was_written() {
        for (f0, metallic) in [(0.05, 0), (0.12, 0), (0.4, 255)] {
            let mut file = Vec::new();
            write(&mut file, "wood", &maps(), f0, 43.35).expect("write");
            assert_eq!(file.len() % 4, 0);
            let document = ::gltf::Gltf::from_slice(&file).expect("a valid file");
            let blob = document.blob.clone().expect("binary chunk");
            let primitive = document.meshes().next().expect("mesh").primitives().next().expect("primitive");
            let reader = primitive.reader(|_| Some(&blob));
            let positions: Vec<_> = reader.read_positions().expect("positions").collect();
            let half = 0.397_4; // tan(43.35 / 2)
            assert!((positions[0][0] + half).abs() < 1e-4 && (positions[0][1] - half).abs() < 1e-4);
            assert_eq!(reader.read_tex_coords(0).expect("uv").into_f32().next(), Some([0.0, 0.0]));
            assert_eq!(
                reader.read_indices().expect("indices").into_u32().collect::<Vec<_>>(),
                [0, 1, 2, 0, 2, 3]
            );
            assert_eq!(reader.read_tangents().expect("tangents").next(), Some([1.0, 0.0, 0.0, 1.0]));
            let material = primitive.material();
            // F0 = ((n - 1) / (n + 1))^2.
            let ior = material.ior().expect("ior");
            let wanted = if metallic == 0 { f0 } else { 0.05 };
            assert!((((ior - 1.0) / (ior + 1.0)).powi(2) - wanted).abs() < 1e-6);
            let pbr = material.pbr_metallic_roughness();
            let texture = pbr.metallic_roughness_texture().expect("texture").texture();
            let ::gltf::image::Source::View { view, .. } = texture.source().source() else {
                panic!("embedded")
            };
            let png = &blob[view.offset()..view.offset() + view.length()];
            let picture = image::load_from_memory(png).expect("png").into_rgb8();
            assert_eq!(picture.get_pixel(1, 0).0, [255, 17, metallic]);
            assert!(pbr.base_color_texture().is_some() && material.normal_texture().is_some());
        }
    }
}
