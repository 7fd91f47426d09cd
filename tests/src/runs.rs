//! One network run on owned memory, as tests and benches need it.
use flashmat_core::base::arena::Arena;
use flashmat_core::base::exec::Executor;
use flashmat_core::frame::LinearImage;
use flashmat_core::maps::MapsMut;
use flashmat_core::net::{Class, ClassProbabilities, Classification, Mixing, Network, Tap};
use flashmat_core::{Error, Silent};

/// Memory of a network run, to be used again and again.
#[derive(Clone, Debug)]
pub struct NetRun {
    size: usize,
    rgb: Vec<f32>,
    clipped: Vec<u8>,
    /// The light's scale, if known.
    pub light_scale: Option<f32>,
    /// The class probabilities, if another look has found them.
    pub known: Option<ClassProbabilities>,
    workspace: Vec<u8>,
    /// 3 planes.
    pub albedo: Vec<f32>,
    /// 3 planes.
    pub normal: Vec<f32>,
    /// 1 plane.
    pub roughness: Vec<f32>,
}

impl NetRun {
    /// Memory for `network` at `size`, over a planar linear photo.
    #[must_use]
    pub fn new(network: &Network<'_>, size: usize, rgb: Vec<f32>) -> Self {
        let pixels = size * size;
        // Noise in the workspace: a run must not depend on what was there.
        let workspace = (0..network.workspace_bytes()).map(|i| (i * 193 + 71) as u8).collect();
        let clipped = vec![0; pixels];
        let (albedo, normal, roughness) = (vec![0.0; 3 * pixels], vec![0.0; 3 * pixels], vec![0.0; pixels]);
        Self { size, rgb, clipped, light_scale: None, known: None, workspace, albedo, normal, roughness }
    }

    /// Runs the network; allocates nothing.
    ///
    /// # Errors
    /// The network's.
    pub fn run(
        &mut self,
        network: &Network<'_>,
        class: Option<Class>,
        exec: &dyn Executor,
        tap: Option<&mut dyn Tap>,
    ) -> Result<Classification, Error> {
        let mixing = Mixing { known: self.known, ..Mixing::only(class) };
        let photo = LinearImage {
            light_scale: self.light_scale,
            ..LinearImage::new(self.size, &self.rgb, &self.clipped, 43.35)
        };
        let mut maps = MapsMut {
            size: self.size,
            albedo: &mut self.albedo,
            normal: &mut self.normal,
            roughness: &mut self.roughness,
        };
        let mut arena = Arena::new(&mut self.workspace);
        match tap {
            Some(tap) => network.run_tapped(&photo, mixing, exec, &mut arena, &mut maps, &mut Silent, tap),
            None => network.run(&photo, mixing, exec, &mut arena, &mut maps, &mut Silent),
        }
    }

    /// A map by its name.
    #[must_use]
    pub fn map(&self, name: &str) -> &[f32] {
        match name {
            "albedo" => &self.albedo,
            "normal" => &self.normal,
            _ => &self.roughness,
        }
    }
}

/// A smooth photo with a bright middle, linear, planar.
#[must_use]
pub fn smooth_photo(size: usize) -> Vec<f32> {
    let value = |i: usize| {
        let (channel, x, y) = (i / (size * size), i % size, i / size % size);
        let (u, v) = (x as f32 / size as f32 - 0.5, y as f32 / size as f32 - 0.5);
        let wave = ((u * (9.0 + channel as f32)).sin() * (v * 13.0).cos()).abs();
        (0.2 + 0.5 * wave) * (-4.0 * (u * u + v * v)).exp()
    };
    (0..3 * size * size).map(value).collect()
}
