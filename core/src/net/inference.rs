//! What gives the first maps of a photo.
use super::{Classification, Mixing, Model, Network};
use crate::base::arena::Arena;
use crate::base::exec::Executor;
use crate::frame::LinearImage;
use crate::maps::MapsMut;
use crate::{Error, Observer};

/// Gives the first maps: the int8 [`Network`], or another implementation that runs the same model.
pub trait Inference {
    /// The model: its CRF coefficients refine the maps.
    fn model(&self) -> &Model<'_>;
    /// Pixels per side.
    fn size(&self) -> usize;
    /// Bytes of workspace for one run.
    fn workspace_bytes(&self) -> usize;
    /// Photo to first maps; `mixing` has a say in the class probabilities that mix the heads.
    ///
    /// # Errors
    /// As the implementation's own.
    fn infer(
        &self,
        photo: &LinearImage<'_>,
        mixing: Mixing,
        exec: &dyn Executor,
        arena: &mut Arena<'_>,
        maps: &mut MapsMut<'_>,
        observer: &mut dyn Observer,
    ) -> Result<Classification, Error>;
}

impl Inference for Network<'_> {
    fn model(&self) -> &Model<'_> {
        self.model()
    }

    fn size(&self) -> usize {
        self.size()
    }

    fn workspace_bytes(&self) -> usize {
        self.workspace_bytes()
    }

    fn infer(
        &self,
        photo: &LinearImage<'_>,
        mixing: Mixing,
        exec: &dyn Executor,
        arena: &mut Arena<'_>,
        maps: &mut MapsMut<'_>,
        observer: &mut dyn Observer,
    ) -> Result<Classification, Error> {
        self.run(photo, mixing, exec, arena, maps, observer)
    }
}
