//! Why bytes are not a model that this crate can run: one variant per broken rule of `docs/model-format.md`.
use core::fmt;

/// The format version of model files that this crate reads.
pub const FORMAT_VERSION: u32 = 2;

/// A broken rule of the model file format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ModelError {
    /// The bytes do not begin with a model file's magic.
    NotAModel,
    /// The file is of another format version.
    Version {
        /// The version that the header names.
        found: u32,
    },
    /// The file ends before its header or section table does, or is not as long as its header says.
    Length {
        /// Bytes that the file should have.
        needed: u64,
        /// Bytes that it has.
        given: u64,
    },
    /// The checksum differs: the file is damaged.
    Checksum,
    /// A field that must be zero is not.
    Reserved,
    /// More sections than the format has.
    SectionCount {
        /// Sections that the header names.
        found: u32,
    },
    /// A section of unknown kind.
    SectionKind {
        /// Its four letters.
        kind: [u8; 4],
    },
    /// A section that occurs twice.
    SectionTwice {
        /// Its four letters.
        kind: [u8; 4],
    },
    /// A section that is not there.
    SectionMissing {
        /// Its four letters.
        kind: [u8; 4],
    },
    /// A section that starts off a 64-byte boundary, overlaps what comes before, or ends beyond the file.
    SectionBounds {
        /// Its four letters.
        kind: [u8; 4],
    },
    /// A section whose length is not what its contents need.
    SectionLength {
        /// Its four letters.
        kind: [u8; 4],
    },
    /// A text that is not UTF-8, or a name that is not printable ASCII padded with zeros.
    Text,
    /// More tensors or layers than the engine has room for, or none.
    Count {
        /// What the file names.
        found: u32,
        /// The most that there may be.
        limit: u32,
    },
    /// A tensor with channels, divisor, scale or zero point outside their limits.
    Tensor {
        /// Its number in the file.
        tensor: u32,
    },
    /// Tensor 0 is not the input that the engine fills: 6 channels, divisor 1, scale 1/255, zero point -128.
    Input,
    /// The logits tensor is not a vector of 8 that a dense layer writes.
    Logits,
    /// A layer of unknown kind.
    LayerKind {
        /// Its number in the file.
        layer: u32,
    },
    /// A layer names a tensor that does not exist, that no layer has written yet, or that is of the wrong sort.
    LayerSource {
        /// Its number in the file.
        layer: u32,
    },
    /// A layer writes a tensor that does not exist, is written already, or is of the wrong sort or shape.
    LayerOutput {
        /// Its number in the file.
        layer: u32,
    },
    /// A layer's kernel, stride, padding, shuffle or flags are outside their limits or do not fit together.
    LayerShape {
        /// Its number in the file.
        layer: u32,
    },
    /// A layer's parameters lie outside their section.
    LayerBounds {
        /// Its number in the file.
        layer: u32,
    },
    /// A layer's parameters hold a value outside its range: not finite, a scale not positive, a bias too large, a
    /// weight code of -128.
    LayerValue {
        /// Its number in the file.
        layer: u32,
    },
    /// A layer's column sums are not those of its weights.
    LayerSums {
        /// Its number in the file.
        layer: u32,
    },
    /// A map has no head, or two.
    Heads,
    /// A CRF coefficient that is negative or not finite.
    Crf,
    /// A default of light or camera outside its range.
    Defaults,
}

impl fmt::Display for ModelError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let letters = |kind: [u8; 4]| kind.map(|c| if c.is_ascii_graphic() { char::from(c) } else { '?' });
        let mut section = |kind: [u8; 4], what: &str| {
            let [a, b, c, d] = letters(kind);
            write!(f, "section {a}{b}{c}{d} {what}")
        };
        match *self {
            Self::NotAModel => f.write_str("not a Flashmat model file"),
            Self::Version { found } => {
                write!(f, "model format version {found}; this build reads version {}", FORMAT_VERSION)
            }
            Self::Length { needed, given } => {
                write!(f, "{given} bytes where {needed} are needed: the file is cut short or has extra bytes")
            }
            Self::Checksum => f.write_str("checksum differs: the file is damaged"),
            Self::Reserved => f.write_str("a reserved field is not zero"),
            Self::SectionCount { found } => write!(f, "{found} sections; the format has fewer"),
            Self::SectionKind { kind } => section(kind, "is of unknown kind"),
            Self::SectionTwice { kind } => section(kind, "occurs twice"),
            Self::SectionMissing { kind } => section(kind, "is missing"),
            Self::SectionBounds { kind } => section(kind, "does not lie in the file as it should"),
            Self::SectionLength { kind } => section(kind, "has a wrong length"),
            Self::Text => f.write_str("a text or name is not valid"),
            Self::Count { found, limit } => write!(f, "{found} tensors or layers; 1 to {limit} are possible"),
            Self::Tensor { tensor } => write!(f, "tensor {tensor} is out of limits"),
            Self::Input => f.write_str("the first tensor is not the network's input"),
            Self::Logits => f.write_str("the class logits are not a dense layer's 8 outputs"),
            Self::LayerKind { layer } => write!(f, "layer {layer} is of unknown kind"),
            Self::LayerSource { layer } => write!(f, "layer {layer} reads a tensor that it cannot read"),
            Self::LayerOutput { layer } => write!(f, "layer {layer} writes a tensor that it cannot write"),
            Self::LayerShape { layer } => {
                write!(f, "layer {layer} has a kernel, stride or padding that does not fit")
            }
            Self::LayerBounds { layer } => {
                write!(f, "layer {layer} has parameters outside the file's sections")
            }
            Self::LayerValue { layer } => write!(f, "layer {layer} has a parameter outside its range"),
            Self::LayerSums { layer } => {
                write!(f, "layer {layer} has column sums that are not those of its weights")
            }
            Self::Heads => f.write_str("albedo, normal and roughness need one head each"),
            Self::Crf => f.write_str("a CRF coefficient is negative or not finite"),
            Self::Defaults => f.write_str("a default of light or camera is out of range"),
        }
    }
}

impl core::error::Error for ModelError {}
