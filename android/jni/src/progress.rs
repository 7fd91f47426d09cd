//! Core's observer on a Java `ProgressListener`.
use crate::engine::Engine;
use flashmat_core::{Observer, Stage};
use jni::objects::{JClass, JObject, JValue};
use jni::{Env, jni_sig, jni_str};
use std::ops::ControlFlow;

/// Stops when the engine is cancelled, the listener says so, or the listener throws.
pub(crate) struct Listener<'r, 'local> {
    pub(crate) env: &'r mut Env<'local>,
    pub(crate) bridge: &'r JClass<'local>,
    /// Null: nobody listens.
    pub(crate) listener: &'r JObject<'local>,
    pub(crate) engine: &'r Engine,
    /// [`Engine::cancel_count`] when the capture was asked for.
    pub(crate) since: u64,
    /// Why Java could not be told; its exception is pending.
    pub(crate) failed: Option<jni::errors::Error>,
}

impl Listener<'_, '_> {
    fn tell(&mut self, stage: Stage, fraction: f32) -> jni::errors::Result<bool> {
        let number = Stage::ALL.iter().position(|&s| s == stage).unwrap_or_default();
        let number = i32::try_from(number).unwrap_or_default();
        let arguments = [JValue::Object(self.listener), JValue::Int(number), JValue::Float(fraction)];
        let name = jni_str!("onProgress");
        let signature = jni_sig!("(Lcom/flashmat/ProgressListener;IF)Z");
        self.env.call_static_method(self.bridge, name, signature, &arguments)?.z()
    }
}

impl Observer for Listener<'_, '_> {
    fn progress(&mut self, stage: Stage, fraction: f32) -> ControlFlow<()> {
        if self.failed.is_some() || self.engine.cancelled_since(self.since) {
            return ControlFlow::Break(());
        }
        if self.listener.is_null() {
            return ControlFlow::Continue(());
        }
        match self.tell(stage, fraction) {
            Ok(true) => ControlFlow::Continue(()),
            Ok(false) => ControlFlow::Break(()),
            Err(error) => {
                self.failed = Some(error);
                ControlFlow::Break(())
            }
        }
    }
}
