//! What C gives as what the core takes: frames, options. Numbers are looked up, unknown ones refused.
use crate::failure::Failure;
use crate::ptr;
use crate::status::flashmat_status as Status;
use crate::types::{
    flashmat_capture_options, flashmat_class, flashmat_encoding, flashmat_format, flashmat_frame,
    flashmat_level, flashmat_plane, flashmat_rotation, flashmat_yuv_matrix, flashmat_yuv_range,
};
use bytemuck::Pod;
use core::ops::ControlFlow;
use flashmat_core::base::simd::Level;
use flashmat_core::capture::CaptureOptions;
use flashmat_core::frame::{Encoding, FieldOfView, Frame, PhotoFov, Range, Rotation, YuvMatrix, YuvPlanes};
use flashmat_core::net::Class;
use flashmat_core::{Observer, Stage};

/// Pixels per side when the caller names none.
const DEFAULT_SIZE: usize = 256;

fn unknown(what: &str, code: u32) -> Failure {
    Failure::new(Status::UnknownValue, format_args!("{what}: {code} is not one of its values"))
}

/// The value that belongs to `code`.
fn lookup<T: Copy>(what: &str, code: u32, values: &[(u32, T)]) -> Result<T, Failure> {
    let found = values.iter().find(|&&(number, _)| number == code);
    found.map(|&(_, value)| value).ok_or_else(|| unknown(what, code))
}

/// The class of a number; `Auto` is none.
pub(crate) fn class(code: u32) -> Result<Option<Class>, Failure> {
    if code == flashmat_class::Auto as u32 {
        return Ok(None);
    }
    let found = Class::ALL.into_iter().find(|&class| class_code(class) == code);
    found.map(Some).ok_or_else(|| unknown("class_override", code))
}

/// The number of a class.
pub(crate) const fn class_code(class: Class) -> u32 {
    let code = match class {
        Class::Fabric => flashmat_class::Fabric,
        Class::Ground => flashmat_class::Ground,
        Class::Leather => flashmat_class::Leather,
        Class::Metal => flashmat_class::Metal,
        Class::StoneDiff => flashmat_class::StoneDiff,
        Class::StoneSpec => flashmat_class::StoneSpec,
        Class::Polymer => flashmat_class::Polymer,
        Class::Wood => flashmat_class::Wood,
    };
    code as u32
}

const LEVELS: [(u32, Level); 6] = [
    (flashmat_level::Scalar as u32, Level::Scalar),
    (flashmat_level::Avx2 as u32, Level::Avx2),
    (flashmat_level::Avx512Vnni as u32, Level::Avx512Vnni),
    (flashmat_level::Neon as u32, Level::Neon),
    (flashmat_level::DotProd as u32, Level::DotProd),
    (flashmat_level::I8mm as u32, Level::I8mm),
];

/// The level of a number; `Auto` is none.
pub(crate) fn level(code: u32) -> Result<Option<Level>, Failure> {
    if code == flashmat_level::Auto as u32 {
        return Ok(None);
    }
    lookup("level", code, &LEVELS).map(Some)
}

/// The number of a level.
#[cfg(feature = "std")]
pub(crate) fn level_code(level: Level) -> u32 {
    LEVELS.iter().find(|&&(_, l)| l == level).map_or(flashmat_level::Auto as u32, |&(code, _)| code)
}

/// The number of a stage.
pub(crate) const fn stage_code(stage: Stage) -> u32 {
    use crate::types::flashmat_stage as Code;
    let code = match stage {
        Stage::Frame => Code::Frame,
        Stage::Global => Code::Global,
        Stage::Flash => Code::Flash,
        Stage::Highlight => Code::Highlight,
        Stage::Albedo => Code::Albedo,
        Stage::Texture => Code::Texture,
        Stage::Normal => Code::Normal,
        Stage::Search => Code::Search,
        Stage::Roughness => Code::Roughness,
        Stage::Level => Code::Level,
        Stage::Relight => Code::Relight,
    };
    code as u32
}

/// Pixels per side.
pub(crate) fn size(size: u32) -> usize {
    if size == 0 { DEFAULT_SIZE } else { size as usize }
}

/// The photo, borrowed.
pub(crate) fn frame<'a>(frame: &flashmat_frame) -> Result<Frame<'a>, Failure> {
    use flashmat_format as F;
    let (width, height) = (frame.width as usize, frame.height as usize);
    let is = |format: F| frame.format == format as u32;
    let planes = if is(F::Yuv420) {
        3
    } else if is(F::Nv12) || is(F::Nv21) {
        2
    } else {
        1
    };
    let view = Planes { frame, width, used: planes };
    let built = if is(F::Rgb8) {
        let (data, stride) = view.packed::<u8>(3)?;
        Frame::rgb8(data, width, height, stride)
    } else if is(F::Rgba8) {
        let (data, stride) = view.packed::<u8>(4)?;
        Frame::rgba8(data, width, height, stride)
    } else if is(F::Bgra8) {
        let (data, stride) = view.packed::<u8>(4)?;
        Frame::bgra8(data, width, height, stride)
    } else if is(F::Rgb16) {
        let (data, stride) = view.packed::<u16>(3)?;
        Frame::rgb16(data, width, height, stride)
    } else if is(F::RgbF32) {
        let (data, stride) = view.packed::<f32>(3)?;
        Frame::rgb_f32(data, width, height, stride)
    } else if is(F::Nv12) || is(F::Nv21) {
        let (luma, luma_stride) = view.luma()?;
        let (chroma, stride) = view.chroma_pairs()?;
        let new = if is(F::Nv12) { Frame::nv12 } else { Frame::nv21 };
        new(luma, luma_stride, chroma, stride, width, height)
    } else if is(F::Yuv420) {
        Frame::yuv420(view.yuv420()?, width, height)
    } else {
        return Err(unknown("frame.format", frame.format));
    };
    finish(frame, built?, planes > 1)
}

/// Rotation and colour.
fn finish<'a>(frame: &flashmat_frame, built: Frame<'a>, is_yuv: bool) -> Result<Frame<'a>, Failure> {
    let rotations = [
        (flashmat_rotation::None as u32, Rotation::None),
        (flashmat_rotation::Cw90 as u32, Rotation::Cw90),
        (flashmat_rotation::Cw180 as u32, Rotation::Cw180),
        (flashmat_rotation::Cw270 as u32, Rotation::Cw270),
    ];
    let encodings = [
        (flashmat_encoding::Default as u32, None),
        (flashmat_encoding::Srgb as u32, Some(Encoding::Srgb)),
        (flashmat_encoding::Linear as u32, Some(Encoding::Linear)),
        (flashmat_encoding::DisplayP3 as u32, Some(Encoding::DisplayP3)),
    ];
    let matrices = [
        (flashmat_yuv_matrix::Default as u32, YuvMatrix::default()),
        (flashmat_yuv_matrix::Bt601 as u32, YuvMatrix::Bt601),
        (flashmat_yuv_matrix::Bt709 as u32, YuvMatrix::Bt709),
    ];
    let ranges = [
        (flashmat_yuv_range::Default as u32, Range::default()),
        (flashmat_yuv_range::Full as u32, Range::Full),
        (flashmat_yuv_range::Limited as u32, Range::Limited),
    ];
    let rotation = lookup("frame.rotation", frame.rotation, &rotations)?;
    let encoding = lookup("frame.encoding", frame.encoding, &encodings)?;
    let matrix = lookup("frame.yuv_matrix", frame.yuv_matrix, &matrices)?;
    let range = lookup("frame.yuv_range", frame.yuv_range, &ranges)?;
    if !is_yuv && (frame.yuv_matrix != 0 || frame.yuv_range != 0) {
        return Err(invalid(format_args!(
            "frame.yuv_matrix and yuv_range are for YUV formats; set them to 0"
        )));
    }
    let built = built.rotated(rotation).yuv_colour(matrix, range);
    Ok(encoding.map_or(built, |encoding| built.encoded(encoding)))
}

fn invalid(arguments: core::fmt::Arguments<'_>) -> Failure {
    Failure::new(Status::InvalidArgument, arguments)
}

const DATA: [&str; 3] = ["frame.planes[0].data", "frame.planes[1].data", "frame.planes[2].data"];

/// The planes of a frame, of which the format has `used`.
struct Planes<'f> {
    frame: &'f flashmat_frame,
    width: usize,
    used: usize,
}

impl Planes<'_> {
    fn get(&self, index: usize) -> Result<&flashmat_plane, Failure> {
        for (unused, plane) in self.frame.planes.iter().enumerate().skip(self.used) {
            if !plane.data.is_null() || plane.bytes != 0 || plane.row_stride != 0 || plane.pixel_stride != 0 {
                let used = self.used;
                return Err(invalid(format_args!(
                    "frame.planes[{unused}] is set, but the format has {used} of them; zero the others"
                )));
            }
        }
        self.frame.planes.get(index).ok_or_else(|| Failure::plain(Status::Internal))
    }

    /// A plane whose pixels are `values` values of `T`, and its row stride in values.
    fn plane<'a, T: Pod>(
        &self,
        index: usize,
        pixels: usize,
        values: usize,
    ) -> Result<(&'a [T], usize), Failure> {
        let plane = self.get(index)?;
        let pixel = values * size_of::<T>();
        if plane.pixel_stride != 0 && plane.pixel_stride != pixel {
            let given = plane.pixel_stride;
            return Err(invalid(format_args!(
                "frame.planes[{index}].pixel_stride is {given}; this format has {pixel} (or say 0)"
            )));
        }
        if plane.row_stride % size_of::<T>() != 0 {
            let given = plane.row_stride;
            return Err(invalid(format_args!(
                "frame.planes[{index}].row_stride is {given}, no whole number of {}-byte values",
                size_of::<T>()
            )));
        }
        let data = ptr::slice(plane.data, plane.bytes, DATA.get(index).copied().unwrap_or(""))?;
        let stride = plane.row_stride / size_of::<T>();
        Ok((data, if stride == 0 { pixels.saturating_mul(values) } else { stride }))
    }

    fn packed<'a, T: Pod>(&self, values: usize) -> Result<(&'a [T], usize), Failure> {
        self.plane(0, self.width, values)
    }

    fn luma<'a>(&self) -> Result<(&'a [u8], usize), Failure> {
        self.plane(0, self.width, 1)
    }

    fn chroma_pairs<'a>(&self) -> Result<(&'a [u8], usize), Failure> {
        self.plane(1, self.width.div_ceil(2), 2)
    }

    fn yuv420<'a>(&self) -> Result<YuvPlanes<'a>, Failure> {
        let plane = |index: usize, pixels: usize| -> Result<(&'a [u8], usize, usize), Failure> {
            let plane = self.get(index)?;
            let data = ptr::slice(plane.data, plane.bytes, DATA.get(index).copied().unwrap_or(""))?;
            let pixel = if plane.pixel_stride == 0 { 1 } else { plane.pixel_stride };
            let row = if plane.row_stride == 0 { pixels.saturating_mul(pixel) } else { plane.row_stride };
            Ok((data, row, pixel))
        };
        let (y, y_row_stride, y_pixel_stride) = plane(0, self.width)?;
        let (u, uv_row_stride, uv_pixel_stride) = plane(1, self.width.div_ceil(2))?;
        let (v, row, pixel) = plane(2, self.width.div_ceil(2))?;
        if (row, pixel) != (uv_row_stride, uv_pixel_stride) {
            return Err(invalid(format_args!("frame.planes[1] and [2] must have the same strides")));
        }
        Ok(YuvPlanes { y, y_row_stride, y_pixel_stride, u, v, uv_row_stride, uv_pixel_stride })
    }
}

/// Options of a capture; NULL: the defaults.
pub(crate) fn capture_options(options: Option<&flashmat_capture_options>) -> Result<CaptureOptions, Failure> {
    let Some(options) = options else { return Ok(CaptureOptions::default()) };
    let refine = match options.skip_refinement {
        0 => true,
        1 => false,
        other => return Err(unknown("skip_refinement", other)),
    };
    // NaN is not 0: the core refuses it.
    let given = |value: f32| value != 0.0;
    let photo = match (given(options.photo_fov_deg), given(options.focal_35mm)) {
        (false, false) => PhotoFov::Unknown,
        (true, false) => PhotoFov::ShorterSide(options.photo_fov_deg),
        (false, true) => PhotoFov::Focal35mm(options.focal_35mm),
        (true, true) => {
            return Err(invalid(format_args!("photo_fov_deg and focal_35mm are both set; give one of them")));
        }
    };
    let target_deg =
        if given(options.target_fov_deg) { options.target_fov_deg } else { FieldOfView::TARGET_DEG };
    Ok(CaptureOptions {
        fov: FieldOfView { photo, target_deg },
        class: class(options.class_override)?,
        light_scale: given(options.light_scale).then_some(options.light_scale),
        refine,
        ..CaptureOptions::default()
    })
}

/// Asks the caller's function, and `stop`, whether to go on.
pub(crate) struct Progress<S> {
    pub(crate) options: Option<flashmat_capture_options>,
    pub(crate) stop: S,
}

impl<S: Fn() -> bool> Observer for Progress<S> {
    fn progress(&mut self, stage: Stage, fraction: f32) -> ControlFlow<()> {
        let called = self.options.and_then(|options| {
            options.progress.map(|progress| progress(options.user, stage_code(stage), fraction))
        });
        if called.is_some_and(|answer| answer != 0) || (self.stop)() {
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    }
}
