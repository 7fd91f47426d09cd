//! The material on a square, as one binary glTF 2.0 file for any viewer.
//!
//! Metallic-roughness: base colour = albedo (sRGB), G = roughness, B = metallic, normals as OpenGL has them, with
//! tangents along x. `KHR_materials_ior` carries F0, where glTF alone has 0.04. The square lies in z = 0, faces +z and
//! has the size in which camera and flash stand at (0, 0, 1): half a side is tan(field of view / 2).
use crate::orm::{Surface, packer};
use crate::png::{self, Colour};
use crate::{Error, Pictures};
use alloc::string::String;
use alloc::vec::Vec;
use core::fmt::Write as _;

/// What a file is made of.
#[derive(Clone, Copy, Debug)]
pub struct Material<'a> {
    /// Name of the material, the mesh and the node.
    pub name: &'a str,
    /// Albedo, normal, roughness.
    pub pictures: Pictures<'a>,
    /// Reflectance at normal incidence, as the capture reports it: blended by P(metal) or by the class given.
    pub f0: f32,
    /// Angle of view over the maps, in degrees.
    pub fov_deg: f32,
}

/// A file, in two parts that follow each other: its pictures are not copied once more.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Glb {
    head: Vec<u8>,
    bin: Vec<u8>,
}

impl Glb {
    /// The file's bytes.
    #[must_use]
    pub fn parts(&self) -> [&[u8]; 2] {
        [&self.head, &self.bin]
    }

    /// The file's bytes in one piece.
    #[must_use]
    pub fn to_vec(&self) -> Vec<u8> {
        self.parts().concat()
    }
}

const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// Makes the file.
///
/// # Errors
/// All of [`Error`].
pub fn file(material: &Material<'_>) -> Result<Glb, Error> {
    let Material { name, pictures, f0, fov_deg } = *material;
    let surface = Surface::of_f0(f0)?;
    if !(fov_deg > 0.0 && fov_deg < 180.0) {
        return Err(Error::FieldOfView);
    }
    pictures.check()?;
    let half = libm::tanf(fov_deg.to_radians() / 2.0);
    let size = (pictures.size(), pictures.size());

    let mut bin = Bin::default();
    // The order in which the scene names them.
    bin.view(&png::file(size, Colour::Rgb, |y, row| pictures.albedo_row(y, row))?, None);
    bin.view(&png::file(size, Colour::Rgb, packer(pictures, surface))?, None);
    bin.view(&png::file(size, Colour::Rgb, |y, row| pictures.normal_row(y, row))?, None);
    // Top left, bottom left, bottom right, top right; texture rows run down.
    let corners = [(-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (1.0, 1.0)];
    bin.floats(&corners.map(|(x, y)| [x * half, y * half, 0.0]));
    bin.floats(&[[0.0, 0.0, 1.0]; 4]);
    bin.floats(&[[1.0, 0.0, 0.0, 1.0]; 4]);
    bin.floats(&corners.map(|(x, y)| [(x + 1.0) / 2.0, (1.0 - y) / 2.0]));
    let triangles: [u16; 6] = [0, 1, 2, 0, 2, 3];
    bin.view(triangles.map(u16::to_le_bytes).as_flattened(), Some(ELEMENT_ARRAY_BUFFER));
    bin.pad();

    let json = scene(&quoted(name), half, surface.ior, &bin);
    Ok(Glb { head: head(json, bin.bytes.len())?, bin: bin.bytes })
}

/// The container up to the binary chunk's data: its head, the JSON chunk, the binary chunk's head.
fn head(mut json: String, bin: usize) -> Result<Vec<u8>, Error> {
    let padding = json.len().next_multiple_of(4) - json.len();
    json.extend(core::iter::repeat_n(' ', padding));
    let word = |n: usize| u32::try_from(n).map(u32::to_le_bytes).map_err(|_| Error::Size);
    let mut head = Vec::with_capacity(28 + json.len());
    head.extend(b"glTF");
    head.extend(2_u32.to_le_bytes());
    head.extend(word(28_usize.saturating_add(json.len()).saturating_add(bin))?);
    head.extend(word(json.len())?);
    head.extend(b"JSON");
    head.extend(json.as_bytes());
    head.extend(word(bin)?);
    head.extend(b"BIN\0");
    Ok(head)
}

/// The binary chunk while it grows, and the views that describe it.
#[derive(Default)]
struct Bin {
    bytes: Vec<u8>,
    views: String,
}

impl Bin {
    fn pad(&mut self) {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
    }

    /// Appends `data` on a 4-byte boundary and describes it.
    fn view(&mut self, data: &[u8], target: Option<u32>) {
        self.pad();
        let comma = if self.views.is_empty() { "" } else { "," };
        // Writing to a string cannot fail, here and below.
        let _ = write!(
            self.views,
            r#"{comma}{{"buffer":0,"byteOffset":{},"byteLength":{}"#,
            self.bytes.len(),
            data.len()
        );
        if let Some(target) = target {
            let _ = write!(self.views, r#","target":{target}"#);
        }
        self.views.push('}');
        self.bytes.extend_from_slice(data);
    }

    fn floats<const N: usize>(&mut self, values: &[[f32; N]]) {
        let bytes: Vec<u8> = values.as_flattened().iter().flat_map(|value| value.to_le_bytes()).collect();
        self.view(&bytes, Some(ARRAY_BUFFER));
    }
}

/// The JSON chunk. `name` is a JSON string already.
fn scene(name: &str, half: f32, ior: f32, bin: &Bin) -> String {
    let (version, bytes, views) = (env!("CARGO_PKG_VERSION"), bin.bytes.len(), &bin.views);
    let picture = |view: u32, name: &str| {
        alloc::format!(r#"{{"bufferView":{view},"mimeType":"image/png","name":"{name}"}}"#)
    };
    let pictures = [picture(0, "albedo"), picture(1, "metallic-roughness"), picture(2, "normal")].join(",");
    let textures = [0, 1, 2].map(|i| alloc::format!(r#"{{"sampler":0,"source":{i}}}"#)).join(",");
    let vertices = |view: u32, kind: &str, range: &str| {
        alloc::format!(r#"{{"bufferView":{view},"componentType":5126,"count":4,"type":"{kind}"{range}}}"#)
    };
    let range = alloc::format!(r#","min":[-{half},-{half},0],"max":[{half},{half},0]"#);
    let accessors = [
        vertices(3, "VEC3", &range),
        vertices(4, "VEC3", ""),
        vertices(5, "VEC4", ""),
        vertices(6, "VEC2", ""),
        String::from(r#"{"bufferView":7,"componentType":5123,"count":6,"type":"SCALAR"}"#),
    ]
    .join(",");
    // Sampler: linear with mipmaps, clamped to the edge. Mode 4: triangles.
    alloc::format!(
        r#"{{"asset":{{"version":"2.0","generator":"flashmat {version}"}},"extensionsUsed":["KHR_materials_ior"],"#
    ) + &alloc::format!(r#""scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0,"name":{name}}}],"#)
        + &alloc::format!(
            r#""meshes":[{{"name":{name},"primitives":[{{"attributes":{{"POSITION":0,"NORMAL":1,"#
        )
        + r#""TANGENT":2,"TEXCOORD_0":3},"indices":4,"material":0,"mode":4}]}],"#
        + &alloc::format!(
            r#""materials":[{{"name":{name},"pbrMetallicRoughness":{{"baseColorTexture":{{"index":0}},"#
        )
        + r#""metallicRoughnessTexture":{"index":1}},"normalTexture":{"index":2},"#
        + &alloc::format!(r#""extensions":{{"KHR_materials_ior":{{"ior":{ior}}}}}}}],"#)
        + &alloc::format!(r#""textures":[{textures}],"images":[{pictures}],"#)
        + r#""samplers":[{"magFilter":9729,"minFilter":9987,"wrapS":33071,"wrapT":33071}],"#
        + &alloc::format!(r#""accessors":[{accessors}],"bufferViews":[{views}],"#)
        + &alloc::format!(r#""buffers":[{{"byteLength":{bytes}}}]}}"#)
}

/// A JSON string.
fn quoted(text: &str) -> String {
    let mut out = String::with_capacity(text.len() + 2);
    out.push('"');
    for c in text.chars() {
        match c {
            '"' | '\\' => out.extend(['\\', c]),
            '\0'..='\x1f' => {
                let _ = write!(out, "\\u{:04x}", u32::from(c));
            }
            _ => out.push(c),
        }
    }
    out.push('"');
    out
}
