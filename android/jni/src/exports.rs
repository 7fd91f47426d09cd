//! The exported functions of `com.flashmat.NativeBridge`, in its order: check arguments, call, write out.
#![allow(unsafe_code, reason = "exports keep their names; nothing here is unsafe beyond that")]
#![allow(non_snake_case, reason = "JNI names the functions")]
use crate::engine::{self, Engine};
use crate::frame::{Layout, Planes};
use crate::progress::Listener;
use crate::{ABI, Failure, Throw, buffer, output};
use flashmat_core::SessionOptions;
use flashmat_core::base::simd::Level;
use flashmat_core::capture::CaptureOptions;
use flashmat_core::frame::{FieldOfView, PhotoFov};
use flashmat_core::net::Class;
use flashmat_export::{Pictures, glb};
use jni::objects::{JByteArray, JByteBuffer, JClass, JFloatArray, JIntArray, JObject, JString};
use jni::sys::{jboolean, jfloat, jint, jlong};
use jni::{Env, EnvUnowned};
use std::sync::Arc;

fn find(handle: jlong) -> Result<Arc<Engine>, Failure> {
    engine::get(handle.cast_unsigned())
}

fn not_negative(value: jint, what: &str) -> Result<usize, Failure> {
    usize::try_from(value).map_err(|_| Failure::Argument(format!("{what} is negative: {value}")))
}

/// Closing and cancelling a closed engine are no mistakes: another thread may just have closed it.
fn unless_closed(result: Result<(), Failure>) -> Result<(), Failure> {
    match result {
        Err(Failure::Closed) => Ok(()),
        other => other,
    }
}

/// `int abi()`
#[unsafe(no_mangle)]
pub(crate) extern "system" fn Java_com_flashmat_NativeBridge_abi<'local>(
    _env: EnvUnowned<'local>,
    _class: JClass<'local>,
) -> jint {
    ABI
}

/// `String version()`
#[unsafe(no_mangle)]
pub(crate) extern "system" fn Java_com_flashmat_NativeBridge_version<'local>(
    mut env: EnvUnowned<'local>,
    _class: JClass<'local>,
) -> JString<'local> {
    env.with_env(|env| Ok::<_, Failure>(env.new_string(env!("CARGO_PKG_VERSION"))?)).resolve::<Throw>()
}

/// `long create(ByteBuffer model, int size, int level, int threads)`; level -1: the CPU's best.
#[unsafe(no_mangle)]
pub(crate) extern "system" fn Java_com_flashmat_NativeBridge_create<'local>(
    mut env: EnvUnowned<'local>,
    _class: JClass<'local>,
    model: JByteBuffer<'local>,
    size: jint,
    level: jint,
    threads: jint,
) -> jlong {
    env.with_env(|env| {
        let level = match level {
            -1 => None,
            number => {
                let level = usize::try_from(number).ok().and_then(|number| Level::ALL.get(number));
                Some(*level.ok_or_else(|| Failure::Argument(format!("no level has the number {number}")))?)
            }
        };
        let size = not_negative(size, "size")?;
        let threads = not_negative(threads, "threads")?;
        let given = buffer::read(env, &model, "model")?;
        // The engine's own copy: Java may reuse, unmap or change its buffer afterwards.
        let mut bytes = Vec::new();
        let no_memory = flashmat_core::Error::WorkspaceTooSmall { needed: given.len(), available: 0 };
        bytes.try_reserve_exact(given.len()).map_err(|_| Failure::Core(no_memory))?;
        bytes.extend_from_slice(given);
        let handle = engine::open(bytes, &SessionOptions { size, level, threads })?;
        Ok::<_, Failure>(handle.cast_signed())
    })
    .resolve::<Throw>()
}

/// `void destroy(long engine)`; waits for the capture that runs.
#[unsafe(no_mangle)]
pub(crate) extern "system" fn Java_com_flashmat_NativeBridge_destroy<'local>(
    mut env: EnvUnowned<'local>,
    _class: JClass<'local>,
    handle: jlong,
) {
    env.with_env(|_| unless_closed(engine::close(handle.cast_unsigned()))).resolve::<Throw>();
}

/// `void cancel(long engine)`
#[unsafe(no_mangle)]
pub(crate) extern "system" fn Java_com_flashmat_NativeBridge_cancel<'local>(
    mut env: EnvUnowned<'local>,
    _class: JClass<'local>,
    handle: jlong,
) {
    env.with_env(|_| unless_closed(find(handle).map(|engine| engine.cancel()))).resolve::<Throw>();
}

/// `String level(long engine)`
#[unsafe(no_mangle)]
pub(crate) extern "system" fn Java_com_flashmat_NativeBridge_level<'local>(
    mut env: EnvUnowned<'local>,
    _class: JClass<'local>,
    handle: jlong,
) -> JString<'local> {
    env.with_env(|env| Ok::<_, Failure>(env.new_string(find(handle)?.level)?)).resolve::<Throw>()
}

/// `long workspaceBytes(long engine)`
#[unsafe(no_mangle)]
pub(crate) extern "system" fn Java_com_flashmat_NativeBridge_workspaceBytes<'local>(
    mut env: EnvUnowned<'local>,
    _class: JClass<'local>,
    handle: jlong,
) -> jlong {
    env.with_env(|_| Ok::<_, Failure>(find(handle)?.workspace_bytes as jlong)).resolve::<Throw>()
}

/// `String modelMeta(long engine)`
#[unsafe(no_mangle)]
pub(crate) extern "system" fn Java_com_flashmat_NativeBridge_modelMeta<'local>(
    mut env: EnvUnowned<'local>,
    _class: JClass<'local>,
    handle: jlong,
) -> JString<'local> {
    env.with_env(|env| Ok::<_, Failure>(env.new_string(&find(handle)?.meta)?)).resolve::<Throw>()
}

/// `long modelChecksum(long engine)`
#[unsafe(no_mangle)]
pub(crate) extern "system" fn Java_com_flashmat_NativeBridge_modelChecksum<'local>(
    mut env: EnvUnowned<'local>,
    _class: JClass<'local>,
    handle: jlong,
) -> jlong {
    env.with_env(|_| Ok::<_, Failure>(jlong::from(find(handle)?.checksum))).resolve::<Throw>()
}

/// `void capture(long engine, int[] layout, ByteBuffer plane0, ByteBuffer plane1, ByteBuffer plane2, int fovKind,
/// float fov, float targetFov, float lightScale, int materialClass, boolean refine, ProgressListener listener,
/// ByteBuffer maps, float[] numbers)`
#[unsafe(no_mangle)]
pub(crate) extern "system" fn Java_com_flashmat_NativeBridge_capture<'local>(
    mut env: EnvUnowned<'local>,
    class: JClass<'local>,
    handle: jlong,
    layout: JIntArray<'local>,
    plane0: JByteBuffer<'local>,
    plane1: JByteBuffer<'local>,
    plane2: JByteBuffer<'local>,
    fov_kind: jint,
    fov: jfloat,
    target_fov: jfloat,
    light_scale: jfloat,
    material_class: jint,
    refine: jboolean,
    listener: JObject<'local>,
    maps: JByteBuffer<'local>,
    numbers: JFloatArray<'local>,
) {
    env.with_env(|env| {
        let engine = find(handle)?;
        let options = capture_options((fov_kind, fov, target_fov), light_scale, material_class, refine)?;
        let planes = Planes { first: &plane0, second: &plane1, third: &plane2 };
        let outputs = Outputs { maps, numbers };
        capture(env, &class, &engine, &layout, &planes, &options, &listener, outputs)
    })
    .resolve::<Throw>();
}

/// Photo's field of view by kind (0 unknown, 1 degrees over the shorter side, 2 mm of 35 mm equivalent) and the
/// target's; light scale 0: not known; class -1: the classifier decides.
fn capture_options(
    (kind, fov, target_deg): (jint, jfloat, jfloat),
    light_scale: jfloat,
    class: jint,
    refine: bool,
) -> Result<CaptureOptions, Failure> {
    let photo = match kind {
        0 => PhotoFov::Unknown,
        1 => PhotoFov::ShorterSide(fov),
        2 => PhotoFov::Focal35mm(fov),
        other => return Err(Failure::Argument(format!("no field of view has the kind {other}"))),
    };
    let class = match class {
        -1 => None,
        number => {
            let class = usize::try_from(number).ok().and_then(|number| Class::ALL.get(number));
            Some(*class.ok_or_else(|| Failure::Argument(format!("no class has the number {number}")))?)
        }
    };
    // NaN is not 0: the core refuses it.
    let light_scale = (light_scale != 0.0).then_some(light_scale);
    let fov = FieldOfView { photo, target_deg };
    Ok(CaptureOptions { fov, class, light_scale, refine, ..CaptureOptions::default() })
}

/// Where a capture goes.
struct Outputs<'local> {
    maps: JByteBuffer<'local>,
    numbers: JFloatArray<'local>,
}

#[expect(clippy::too_many_arguments, reason = "the export's, grouped")]
fn capture<'local>(
    env: &mut Env<'local>,
    bridge: &JClass<'local>,
    engine: &Engine,
    layout: &JIntArray<'local>,
    planes: &Planes<'_, 'local>,
    options: &CaptureOptions,
    listener: &JObject<'local>,
    mut outputs: Outputs<'local>,
) -> Result<(), Failure> {
    let since = engine.cancel_count();
    let layout = Layout::read(env, layout)?;
    let pixels = layout.pixels(env, planes)?;
    let frame = layout.frame(&pixels)?;
    let bytes = buffer::write(env, &mut outputs.maps, pixels.planes(), "maps")?;
    let out = output::planes_mut(bytes, engine.size)?;
    if outputs.numbers.is_null() {
        return Err(Failure::Null("numbers"));
    }
    if outputs.numbers.len(env)? != output::NUMBERS {
        return Err(Failure::Argument(format!("a capture gives {} numbers", output::NUMBERS)));
    }
    engine.with_session(|session| {
        session.with_dependent_mut(|_, session| {
            let mut observer = Listener { env, bridge, listener, engine, since, failed: None };
            let result = session.capture(&frame, options, &mut observer);
            if let Some(error) = observer.failed {
                return Err(Failure::Java(error));
            }
            let capture = result?;
            // Asked for while the last step ran: a cancelled capture gives nothing.
            if engine.cancelled_since(since) {
                return Err(Failure::Core(flashmat_core::Error::Cancelled));
            }
            outputs.numbers.set_region(observer.env, 0, &output::numbers(&capture))?;
            output::write(&capture, out);
            Ok(())
        })
    })
}

/// `void picture(ByteBuffer maps, int size, int picture, ByteBuffer rgba)`
#[unsafe(no_mangle)]
pub(crate) extern "system" fn Java_com_flashmat_NativeBridge_picture<'local>(
    mut env: EnvUnowned<'local>,
    _class: JClass<'local>,
    maps: JByteBuffer<'local>,
    size: jint,
    picture: jint,
    mut rgba: JByteBuffer<'local>,
) {
    env.with_env(|env| {
        let maps = buffer::read(env, &maps, "maps")?;
        let rgba = buffer::write(env, &mut rgba, &[maps], "picture")?;
        output::picture(maps, not_negative(size, "size")?, not_negative(picture, "picture")?, rgba)
    })
    .resolve::<Throw>();
}

/// `byte[] glb(ByteBuffer maps, int size, float f0, float fov, byte[] name)`; the name in UTF-8.
#[unsafe(no_mangle)]
pub(crate) extern "system" fn Java_com_flashmat_NativeBridge_glb<'local>(
    mut env: EnvUnowned<'local>,
    _class: JClass<'local>,
    maps: JByteBuffer<'local>,
    size: jint,
    f0: jfloat,
    fov: jfloat,
    name: JByteArray<'local>,
) -> JByteArray<'local> {
    env.with_env(|env| {
        if name.is_null() {
            return Err(Failure::Null("name"));
        }
        let name = String::from_utf8(env.convert_byte_array(&name)?)
            .map_err(|_| Failure::Argument("the name is not UTF-8".to_owned()))?;
        let maps = output::view(buffer::read(env, &maps, "maps")?, not_negative(size, "size")?)?;
        let material = glb::Material { name: &name, pictures: Pictures::Planes(maps), f0, fov_deg: fov };
        let file = glb::file(&material).map_err(|error| Failure::Argument(error.to_string()))?;
        let parts = file.parts();
        let array = env.new_byte_array(parts.iter().map(|part| part.len()).sum())?;
        let mut start = 0;
        for part in parts {
            array.set_region(env, start, bytemuck::cast_slice(part))?;
            // All of them fit one array.
            start += part.len() as jint;
        }
        Ok(array)
    })
    .resolve::<Throw>()
}

/// `void fail(long engine, int error)`: throws core's error of that number, or panics inside the engine (-1). For
/// tests only.
#[cfg(feature = "test-hooks")]
#[unsafe(no_mangle)]
pub(crate) extern "system" fn Java_com_flashmat_NativeBridge_fail<'local>(
    mut env: EnvUnowned<'local>,
    _class: JClass<'local>,
    handle: jlong,
    error: jint,
) {
    env.with_env(|_| {
        if error == -1 {
            return find(handle)?.with_session(|_| -> Result<(), Failure> { panic!("on purpose") });
        }
        let all = crate::error::all();
        let wanted = usize::try_from(error).ok().and_then(|number| all.get(number));
        Err(wanted.map_or_else(
            || Failure::Argument(format!("{} errors", all.len())),
            |&error| Failure::Core(error),
        ))
    })
    .resolve::<Throw>();
}
