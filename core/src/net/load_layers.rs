//! Layer records to [`Op`](super::graph::Op)s, one reader for each kind; [`Loader`] has what they share.
use super::format::{F32s, I32s};
use super::graph::{Conv, Dense, Depthwise, MAX_BIAS, MeanPool, MixHead, PackedWindow};
use super::load::{Fields, Loader, NONE, field};
use super::{CLASSES, Map};
use crate::ModelError;
use crate::kernels::pack;

/// Most pixels of a map per pixel of a head, in each direction.
const MAX_SHUFFLE: u32 = 4;

/// Weights and bias in real units.
type Real<'m> = (F32s<'m>, F32s<'m>);

impl<'m> Loader<'_, 'm> {
    pub(super) fn read_conv(&mut self, fields: &mut Fields) -> Result<Conv<'m>, ModelError> {
        let (sources, cin, divisor) = self.sources(fields)?;
        let window = self.window(fields, cin)?;
        let (relu, relu6) = self.clipped(fields.take(field::RELU))?;
        let cout = fields.take(field::COUT) as usize;
        let output = self.write(fields.take(field::OUTPUT), cout, divisor * window.stride)?;
        let shape = pack::Shape::new(cout, window.height, window.width, cin);
        let weights = self.codes(fields, shape.packed_len())?;
        let (bias, weight_scale) = self.units(fields, cout)?;
        let second = sources.second.and_then(|s| self.tensors.get(s.tensor())).map_or(0, |t| t.channels);
        let count = if second > 0 { 2 * cout } else { cout };
        let sums =
            I32s::new(self.sections.params, fields.take(field::SUMS), count).ok_or(self.bounds_error())?;
        if !pack::sums_match(weights, &shape, cin - second, sums.iter()) {
            return Err(ModelError::LayerSums { layer: self.layer });
        }
        let float = self.real(fields, cout * window.height * window.width * cin, cout)?;
        let window = PackedWindow::new(window);
        Ok(Conv { sources, output, window, cin, cout, relu, relu6, weights, bias, weight_scale, sums, float })
    }

    pub(super) fn read_depthwise(&mut self, fields: &mut Fields) -> Result<Depthwise<'m>, ModelError> {
        let (sources, channels, divisor) = self.sources(fields)?;
        if sources.second.is_some() || sources.first.upsample {
            return Err(self.shape_error());
        }
        let window = self.window(fields, 1)?;
        let (relu, relu6) = self.clipped(fields.take(field::RELU))?;
        if fields.take(field::COUT) as usize != channels {
            return Err(self.shape_error());
        }
        let output = self.write(fields.take(field::OUTPUT), channels, divisor * window.stride)?;
        let count = window.height * window.width * channels;
        let weights = self.codes(fields, count)?;
        let (bias, weight_scale) = self.units(fields, channels)?;
        let float = self.real(fields, count, channels)?;
        let source = sources.first.tensor();
        let window = PackedWindow::new(window);
        Ok(Depthwise { source, output, window, channels, relu, relu6, weights, bias, weight_scale, float })
    }

    /// ReLU, and whether it ends at 6.
    fn clipped(&self, value: u32) -> Result<(bool, bool), ModelError> {
        if value == 2 { Ok((true, true)) } else { self.flag(value).map(|relu| (relu, false)) }
    }

    /// `count` int8 weights. Symmetric: kernels may add two products in 16 bits.
    fn codes(&self, fields: &mut Fields, count: usize) -> Result<&'m [i8], ModelError> {
        let start = fields.take(field::WEIGHTS) as usize;
        let bytes = start.checked_add(count).and_then(|end| self.sections.weights.get(start..end));
        let codes: &[i8] = bytemuck::cast_slice(bytes.ok_or(self.bounds_error())?);
        if codes.contains(&i8::MIN) { Err(self.value_error()) } else { Ok(codes) }
    }

    /// Bias and weight scale of each output channel.
    fn units(&self, fields: &mut Fields, cout: usize) -> Result<(I32s<'m>, F32s<'m>), ModelError> {
        let params = self.sections.params;
        let bias = I32s::new(params, fields.take(field::BIAS), cout).ok_or(self.bounds_error())?;
        if bias.iter().any(|b| b.unsigned_abs() > MAX_BIAS.unsigned_abs()) {
            return Err(self.value_error());
        }
        let weight_scale = self.floats(fields.take(field::WEIGHT_SCALE), cout)?;
        if weight_scale.iter().any(|s| s <= 0.0) {
            return Err(self.value_error());
        }
        Ok((bias, weight_scale))
    }

    /// `count` float weights and `cout` biases, where the file has them.
    fn real(&self, fields: &mut Fields, count: usize, cout: usize) -> Result<Option<Real<'m>>, ModelError> {
        let (at, bias_at) = (fields.take(field::FLOAT_WEIGHTS), fields.take(field::FLOAT_BIAS));
        match (at, bias_at, self.sections.floats) {
            (NONE, NONE, _) => Ok(None),
            (_, _, Some(section)) => {
                let weights = F32s::new(section, at, count).ok_or(self.bounds_error())?;
                let bias = F32s::new(section, bias_at, cout).ok_or(self.bounds_error())?;
                Ok(Some((self.finite(weights)?, self.finite(bias)?)))
            }
            _ => Err(self.bounds_error()),
        }
    }

    pub(super) fn read_pool(&mut self, fields: &mut Fields) -> Result<MeanPool, ModelError> {
        let (source, shape) = self.read(fields.take(field::SOURCE0), true)?;
        let (second, more) = self.second(fields, true)?;
        let channels = fields.take(field::COUT) as usize;
        if channels != shape.channels + more {
            return Err(self.shape_error());
        }
        let output = self.write(fields.take(field::OUTPUT), channels, 0)?;
        Ok(MeanPool { source, second, output })
    }

    pub(super) fn read_dense(&mut self, fields: &mut Fields) -> Result<Dense<'m>, ModelError> {
        let (source, shape) = self.read(fields.take(field::SOURCE0), false)?;
        let (second, more) = self.second(fields, false)?;
        let relu = self.flag(fields.take(field::RELU))?;
        let cout = fields.take(field::COUT) as usize;
        let output = self.write(fields.take(field::OUTPUT), cout, 0)?;
        let weights = self.floats(fields.take(field::WEIGHTS), cout * (shape.channels + more))?;
        let bias = self.floats(fields.take(field::BIAS), cout)?;
        Ok(Dense { source, second, output, relu, weights, bias })
    }

    pub(super) fn read_head(
        &mut self,
        fields: &mut Fields,
        logits: usize,
    ) -> Result<MixHead<'m>, ModelError> {
        let (sources, cin, divisor) = self.sources(fields)?;
        let window = self.window(fields, cin)?;
        let shuffle = fields.take(field::SHUFFLE);
        let classes = fields.take(field::CLASSES) as usize;
        let map = match fields.take(field::MAP) {
            1 => Map::Albedo,
            2 => Map::Normal,
            3 => Map::Roughness,
            _ => return Err(self.shape_error()),
        };
        let cout = fields.take(field::COUT) as usize;
        let output = fields.take(field::OUTPUT);
        let shape_holds = window.stride == 1
            && (1..=MAX_SHUFFLE).contains(&shuffle)
            && shuffle as usize == divisor
            && (classes == 1 || classes == CLASSES)
            && cout == map.channels() * divisor * divisor
            && output == NONE;
        if !shape_holds {
            return Err(self.shape_error());
        }
        if self.written.get(logits) != Some(&true) {
            return Err(self.source_error());
        }
        let each = cout * window.height * window.width * cin;
        let weights = self.floats(fields.take(field::WEIGHTS), classes * each)?;
        let bias = self.floats(fields.take(field::BIAS), classes * cout)?;
        let window = PackedWindow::new(window);
        Ok(MixHead { sources, map, window, cin, cout, shuffle: divisor, classes, weights, bias })
    }

    /// The second source, if there is one, of a layer that reads images or vectors as they are, and its channels.
    fn second(&self, fields: &mut Fields, image: bool) -> Result<(Option<usize>, usize), ModelError> {
        match fields.take(field::SOURCE1) {
            NONE => Ok((None, 0)),
            id => self.read(id, image).map(|(tensor, shape)| (Some(tensor), shape.channels)),
        }
    }
}
