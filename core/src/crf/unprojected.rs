//! The minimum itself, before it is put where maps live: what a derivative is taken of.
use super::pairs::MAX_KERNELS;
use super::refine::Energy;
use crate::Error;
use crate::base::exec::Executor;

/// An energy whose minimum is left as it is.
#[derive(Clone, Copy, Debug)]
pub struct Unprojected<'e, E>(pub &'e E);

impl<E: Energy<N>, const N: usize> Energy<N> for Unprojected<'_, E> {
    const CHANNELS: usize = E::CHANNELS;
    const UNARIES: usize = E::UNARIES;
    const SIGMA_SPATIAL: f32 = E::SIGMA_SPATIAL;
    const SIGMA_POSITION: f32 = E::SIGMA_POSITION;
    const FEATURES: [usize; MAX_KERNELS] = E::FEATURES;

    fn size(&self) -> usize {
        self.0.size()
    }

    fn check(&self) -> Result<(), Error> {
        self.0.check()
    }

    fn unary(&self, term: usize) -> &[f32] {
        self.0.unary(term)
    }

    fn unary_map(&self, term: usize, exec: &dyn Executor, out: &mut [f32]) {
        self.0.unary_map(term, exec, out);
    }

    fn features(&self, kernel: usize, exec: &dyn Executor, out: &mut [f32]) {
        self.0.features(kernel, exec, out);
    }

    fn project(&self, _map: &mut [f32]) {}
}
