//! Failures as Java exceptions: one class of `FlashmatException` for each of core's errors, with core's message.
use flashmat_core::Error;
use jni::Env;
use jni::errors::ErrorPolicy;
use jni::jni_str;
use jni::strings::{JNIStr, JNIString};
use std::any::Any;

/// Why a native call gave nothing.
#[derive(Debug)]
pub(crate) enum Failure {
    /// Core said no: its own exception class.
    Core(Error),
    /// An argument is null: `NullPointerException`.
    Null(&'static str),
    /// An argument breaks the bridge's rules: `IllegalArgumentException`.
    Argument(String),
    /// The engine is closed: `IllegalStateException`.
    Closed,
    /// The engine cannot do this now: `IllegalStateException`.
    State(String),
    /// A call into Java failed; the exception that it threw stays as it is.
    Java(jni::errors::Error),
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        Self::Core(error)
    }
}

impl From<jni::errors::Error> for Failure {
    fn from(error: jni::errors::Error) -> Self {
        Self::Java(error)
    }
}

const INTERNAL: &JNIStr = jni_str!("com/flashmat/FlashmatException$Internal");

/// The exception class of an error.
fn class_of(error: &Error) -> &'static JNIStr {
    match error {
        Error::WorkspaceTooSmall { .. } => jni_str!("com/flashmat/FlashmatException$WorkspaceTooSmall"),
        Error::Cancelled => jni_str!("com/flashmat/FlashmatException$Cancelled"),
        Error::FrameEmpty => jni_str!("com/flashmat/FlashmatException$FrameEmpty"),
        Error::FrameTooLarge => jni_str!("com/flashmat/FlashmatException$FrameTooLarge"),
        Error::FrameStride { .. } => jni_str!("com/flashmat/FlashmatException$FrameStride"),
        Error::FrameBuffer { .. } => jni_str!("com/flashmat/FlashmatException$FrameBuffer"),
        Error::FramePixel { .. } => jni_str!("com/flashmat/FlashmatException$FramePixel"),
        Error::FieldOfView => jni_str!("com/flashmat/FlashmatException$FieldOfView"),
        Error::FocalLength => jni_str!("com/flashmat/FlashmatException$FocalLength"),
        Error::LightScale => jni_str!("com/flashmat/FlashmatException$LightScale"),
        Error::Size { .. } => jni_str!("com/flashmat/FlashmatException$Size"),
        Error::PlaneLength { .. } => jni_str!("com/flashmat/FlashmatException$PlaneLength"),
        Error::LightBelowPlane => jni_str!("com/flashmat/FlashmatException$LightBelowPlane"),
        Error::NoUsablePixels => jni_str!("com/flashmat/FlashmatException$NoUsablePixels"),
        Error::PhotoBlack => jni_str!("com/flashmat/FlashmatException$PhotoBlack"),
        Error::Threads => jni_str!("com/flashmat/FlashmatException$Threads"),
        Error::Model(_) => jni_str!("com/flashmat/FlashmatException$Model"),
        Error::NetworkSize { .. } => jni_str!("com/flashmat/FlashmatException$NetworkSize"),
        Error::LevelUnsupported { .. } => jni_str!("com/flashmat/FlashmatException$LevelUnsupported"),
        Error::CrfInput => jni_str!("com/flashmat/FlashmatException$CrfInput"),
        // Core's enum may grow; `every_error_of_core_has_its_class` fails until the new one is listed above.
        _ => INTERNAL,
    }
}

/// Exception class and message.
fn exception(failure: Failure) -> (&'static JNIStr, String) {
    let illegal_state = jni_str!("java/lang/IllegalStateException");
    match failure {
        Failure::Core(error) => (class_of(&error), error.to_string()),
        Failure::Null(what) => (jni_str!("java/lang/NullPointerException"), format!("{what} is null")),
        Failure::Argument(message) => (jni_str!("java/lang/IllegalArgumentException"), message),
        Failure::Closed => (illegal_state, "the engine is closed".to_owned()),
        Failure::State(message) => (illegal_state, message),
        Failure::Java(error) => (INTERNAL, error.to_string()),
    }
}

/// Throws failures and panics; the native method returns 0, false or null.
pub(crate) struct Throw;

impl<T: Default> ErrorPolicy<T, Failure> for Throw {
    type Captures<'unowned_env_local: 'native_method, 'native_method> = ();

    fn on_error<'unowned_env_local: 'native_method, 'native_method>(
        env: &mut Env<'unowned_env_local>,
        (): &mut (),
        failure: Failure,
    ) -> jni::errors::Result<T> {
        // A listener's own exception, or an OutOfMemoryError of the JVM, goes on as it is.
        if !env.exception_check() {
            let (class, message) = exception(failure);
            // Throwing is reported as an error by design; the exception is what we want.
            let _ = env.throw_new(class, JNIString::from(message));
        }
        Ok(T::default())
    }

    fn on_panic<'unowned_env_local: 'native_method, 'native_method>(
        env: &mut Env<'unowned_env_local>,
        (): &mut (),
        payload: Box<dyn Any + Send + 'static>,
    ) -> jni::errors::Result<T> {
        let text = payload.downcast_ref::<&str>().copied();
        let text = text.or_else(|| payload.downcast_ref::<String>().map(String::as_str)).unwrap_or("unknown");
        if !env.exception_check() {
            let _ = env.throw_new(INTERNAL, JNIString::from(format!("a defect of the library: {text}")));
        }
        Ok(T::default())
    }
}

/// One of each of core's errors.
#[cfg(any(test, feature = "test-hooks"))]
pub(crate) fn all() -> Vec<Error> {
    use flashmat_core::{ModelError, base::simd::Level};
    let (needed, given) = (2, 1);
    vec![
        Error::WorkspaceTooSmall { needed, available: 1 },
        Error::Cancelled,
        Error::FrameEmpty,
        Error::FrameTooLarge,
        Error::FrameStride { needed, given },
        Error::FrameBuffer { needed, given },
        Error::FramePixel { x: 1, y: 2 },
        Error::FieldOfView,
        Error::FocalLength,
        Error::LightScale,
        Error::Size { size: 0 },
        Error::PlaneLength { needed, given },
        Error::LightBelowPlane,
        Error::NoUsablePixels,
        Error::PhotoBlack,
        Error::Threads,
        Error::Model(ModelError::Checksum),
        Error::NetworkSize { size: 100, multiple: 128 },
        Error::LevelUnsupported { level: Level::I8mm },
        Error::CrfInput,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    /// The variants' names, from core's source: the oracle that notices a new one.
    fn variants() -> BTreeSet<String> {
        let source = include_str!("../../../core/src/base/error.rs");
        let body = source.split("pub enum Error {").nth(1).expect("the enum");
        let body = body.split("\n}").next().expect("its end");
        let lines = body.lines().filter(|line| line.starts_with("    ") && !line.starts_with("     "));
        let names =
            lines.map(|line| line.trim().chars().take_while(|c| c.is_alphanumeric()).collect::<String>());
        names.filter(|name| !name.is_empty()).collect()
    }

    #[test]
    fn every_error_of_core_has_its_class() {
        let covered: BTreeSet<String> = all()
            .iter()
            .map(|error| {
                let class = class_of(error).to_str().into_owned();
                let name =
                    class.strip_prefix("com/flashmat/FlashmatException$").expect("of the family").to_owned();
                assert!(format!("{error:?}").starts_with(&name), "{error:?} has class {name}");
                name
            })
            .collect();
        // tract's errors exist only in builds with its feature, which the Android library is not.
        let feature_only: BTreeSet<String> = ["Float".to_owned()].into();
        let wanted: BTreeSet<String> = variants().difference(&feature_only).cloned().collect();
        assert_eq!(covered, wanted);
    }

    #[test]
    fn the_java_family_has_the_same_classes() {
        let java = include_str!("../../flashmat/src/main/java/com/flashmat/FlashmatException.java");
        for error in all() {
            let class = class_of(&error).to_str().into_owned();
            let name = class.rsplit('$').next().expect("a name");
            assert!(java.contains(&format!("public static final class {name} extends ")), "{name}");
        }
        assert!(java.contains("public static final class Internal extends "));
    }
}
