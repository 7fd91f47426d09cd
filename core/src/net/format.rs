//! The model file's container: header, section table, checksum. Bytes in, checked sections out, nothing copied.
//!
//! Layout: `docs/model-format.md`. The bytes need no alignment: numbers are read as little-endian bytes through
//! [`F32s`] and [`I32s`]. After [`Sections::parse`] every section lies within the bytes; what is in them is checked
//! by [`super::graph`].
use crate::ModelError;
use crate::base::FORMAT_VERSION;

/// First eight bytes of a model file.
pub const MAGIC: [u8; 8] = *b"FLASHMAT";
/// Alignment of sections within the file.
const ALIGN: usize = 64;
const HEADER: usize = 64;
const TABLE_ENTRY: usize = 32;
/// CRF coefficients per class: albedo a0, a1, b1, b2, b3; normal a, b1, b2; roughness a0, a1, b1, b2.
pub const CRF_COEFFICIENTS: usize = 12;

const KINDS: [[u8; 4]; 8] = [*b"META", *b"GRPH", *b"WGT8", *b"PARM", *b"WGTF", *b"CRFC", *b"DFLT", *b"CARD"];
const FLOATS: usize = 4;

/// Little-endian f32 values in place.
#[derive(Clone, Copy, Debug)]
pub struct F32s<'m>(&'m [u8]);

/// Little-endian i32 values in place.
#[derive(Clone, Copy, Debug)]
pub struct I32s<'m>(&'m [u8]);

macro_rules! numbers {
    ($view:ident, $number:ty) => {
        impl<'m> $view<'m> {
            /// `count` values from byte `offset` of `section`; `None` when they are not all in it.
            #[must_use]
            pub fn new(section: &'m [u8], offset: u32, count: usize) -> Option<Self> {
                let start = usize::try_from(offset).ok()?;
                let end = start.checked_add(count.checked_mul(4)?)?;
                section.get(start..end).map(Self)
            }

            /// Number of values.
            #[must_use]
            pub fn len(&self) -> usize {
                self.0.len() / 4
            }

            /// Whether there are none.
            #[must_use]
            pub fn is_empty(&self) -> bool {
                self.0.is_empty()
            }

            /// The values in order.
            pub fn iter(&self) -> impl ExactSizeIterator<Item = $number> + Clone + use<'m> {
                let (fours, _) = self.0.as_chunks::<4>();
                fours.iter().map(|&bytes| <$number>::from_le_bytes(bytes))
            }

            /// The `index`th run of `count` values; empty past the end.
            #[must_use]
            pub fn run(&self, index: usize, count: usize) -> Self {
                let bytes = count.saturating_mul(4);
                let start = index.saturating_mul(bytes);
                Self(self.0.get(start..start.saturating_add(bytes)).unwrap_or(&[]))
            }
        }
    };
}
numbers!(F32s, f32);
numbers!(I32s, i32);

/// How the training renders were lit and seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Defaults {
    /// Field of view over the square crop, in degrees.
    pub fov_deg: f32,
    /// Pixels per side that the network was trained at: larger photos are seen at this size first, at their own for
    /// the detail only (`net::scales`). 0: every size alike.
    pub base_size: u32,
    /// Pixels per side of the largest photos that the network was trained at beside those: up to it, both looks have
    /// an equal say in the large shapes of normals. 0: none were larger.
    pub top_size: u32,
}

/// The sections of a model file whose container rules hold.
#[derive(Clone, Copy, Debug)]
pub struct Sections<'m> {
    /// JSON: name, class names, training summary.
    pub meta: &'m str,
    /// The model card, Markdown.
    pub card: &'m str,
    /// Tensor and layer records.
    pub graph: &'m [u8],
    /// Packed int8 weights.
    pub weights: &'m [u8],
    /// Biases, scales, column sums, dense and head weights.
    pub params: &'m [u8],
    /// Float weights of the convolutions, for the float engine.
    pub floats: Option<&'m [u8]>,
    /// 8 x [`CRF_COEFFICIENTS`] values, non-negative.
    pub crf: F32s<'m>,
    /// Light and camera.
    pub defaults: Defaults,
    /// The file's CRC-32: its short name in reports.
    pub checksum: u32,
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    bytes.get(at..).and_then(<[u8]>::first_chunk).map_or(0, |&b| u32::from_le_bytes(b))
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    bytes.get(at..).and_then(<[u8]>::first_chunk).map_or(0, |&b| u64::from_le_bytes(b))
}

fn all_zero(bytes: &[u8]) -> bool {
    bytes.iter().all(|&b| b == 0)
}

impl<'m> Sections<'m> {
    /// Checks header, checksum and section table, and the sections that are one fixed record.
    ///
    /// # Errors
    /// The [`ModelError`] of the first rule that is broken.
    pub fn parse(bytes: &'m [u8]) -> Result<Self, ModelError> {
        let given = bytes.len() as u64;
        if bytes.get(..MAGIC.len()).is_none_or(|magic| magic != MAGIC) {
            return Err(ModelError::NotAModel);
        }
        let header = bytes.get(..HEADER).ok_or(ModelError::Length { needed: HEADER as u64, given })?;
        let version = u32_at(header, 8);
        if version != FORMAT_VERSION {
            return Err(ModelError::Version { found: version });
        }
        let count = u32_at(header, 12);
        if count as usize > KINDS.len() {
            return Err(ModelError::SectionCount { found: count });
        }
        let needed = u64_at(header, 16);
        if needed != given {
            return Err(ModelError::Length { needed, given });
        }
        if !all_zero(header.get(28..).unwrap_or(&[])) {
            return Err(ModelError::Reserved);
        }
        let payload = bytes.get(HEADER..).unwrap_or(&[]);
        let checksum = u32_at(header, 24);
        if crc32(payload) != checksum {
            return Err(ModelError::Checksum);
        }
        let table_end = HEADER + count as usize * TABLE_ENTRY;
        let table =
            bytes.get(HEADER..table_end).ok_or(ModelError::Length { needed: table_end as u64, given })?;
        let found = Self::read_table(bytes, table, table_end)?;
        let mut required = [&[] as &[u8]; KINDS.len()];
        for ((slot, section), kind) in required.iter_mut().zip(found).zip(KINDS) {
            *slot = match section {
                Some(section) => section,
                None if kind == KINDS[FLOATS] => &[],
                None => return Err(ModelError::SectionMissing { kind }),
            };
        }
        let [meta, graph, weights, params, _, crf, defaults, card] = required;
        Ok(Self {
            meta: core::str::from_utf8(meta).map_err(|_| ModelError::Text)?,
            card: core::str::from_utf8(card).map_err(|_| ModelError::Text)?,
            graph,
            weights,
            params,
            floats: found[FLOATS],
            crf: read_crf(crf)?,
            defaults: read_defaults(defaults)?,
            checksum,
        })
    }

    /// The section of each kind, in the order of [`KINDS`].
    fn read_table(
        bytes: &'m [u8],
        table: &[u8],
        table_end: usize,
    ) -> Result<[Option<&'m [u8]>; KINDS.len()], ModelError> {
        let mut found = [None; KINDS.len()];
        let mut free = table_end;
        for entry in table.chunks_exact(TABLE_ENTRY) {
            let kind = entry.first_chunk().copied().unwrap_or([0; 4]);
            let at = KINDS.iter().position(|&k| k == kind).ok_or(ModelError::SectionKind { kind })?;
            if u32_at(entry, 4) != 0 || u64_at(entry, 24) != 0 {
                return Err(ModelError::Reserved);
            }
            let bounds = ModelError::SectionBounds { kind };
            let start = usize::try_from(u64_at(entry, 8)).map_err(|_| bounds)?;
            let length = usize::try_from(u64_at(entry, 16)).map_err(|_| bounds)?;
            let end = start.checked_add(length).ok_or(bounds)?;
            if !start.is_multiple_of(ALIGN) || start < free {
                return Err(bounds);
            }
            let section = bytes.get(start..end).ok_or(bounds)?;
            let slot = found.get_mut(at).ok_or(bounds)?;
            if slot.replace(section).is_some() {
                return Err(ModelError::SectionTwice { kind });
            }
            free = end;
        }
        Ok(found)
    }
}

fn read_crf(section: &[u8]) -> Result<F32s<'_>, ModelError> {
    let count = 8 * CRF_COEFFICIENTS;
    let length = ModelError::SectionLength { kind: *b"CRFC" };
    if section.len() != count * 4 {
        return Err(length);
    }
    let values = F32s::new(section, 0, count).ok_or(length)?;
    if values.iter().all(|v| v.is_finite() && v >= 0.0) { Ok(values) } else { Err(ModelError::Crf) }
}

fn read_defaults(section: &[u8]) -> Result<Defaults, ModelError> {
    if section.len() != 20 && section.len() != 24 {
        return Err(ModelError::SectionLength { kind: *b"DFLT" });
    }
    let mut values = [0.0; 4];
    for (value, read) in values.iter_mut().zip(F32s(section).iter()) {
        *value = read;
    }
    let [fov_deg, light_distance, light_strength, exposure] = values;
    let base_size = u32_at(section, 16);
    let top_size = if section.len() == 24 { u32_at(section, 20) } else { 0 };
    let positive = |v: f32| v.is_finite() && v > 0.0;
    if (1.0..=170.0).contains(&fov_deg)
        && [light_distance, light_strength, exposure].into_iter().all(positive)
        && [base_size, top_size].into_iter().all(|size| size as usize <= crate::base::planes::MAX_SIZE)
    {
        // The training's light is a note of the file's; nothing reads it.
        Ok(Defaults { fov_deg, base_size, top_size })
    } else {
        Err(ModelError::Defaults)
    }
}

/// Tables for eight bytes at a time ("slicing by 8"): entry `[k][b]` advances byte b by k further zero bytes.
const CRC_TABLES: [[u32; 256]; 8] = {
    let mut tables = [[0_u32; 256]; 8];
    let mut byte = 0;
    while byte < 256 {
        let mut crc = byte as u32;
        let mut bit = 0;
        while bit < 8 {
            crc = if crc & 1 == 1 { 0xEDB8_8320 ^ (crc >> 1) } else { crc >> 1 };
            bit += 1;
        }
        tables[0][byte] = crc;
        byte += 1;
    }
    let mut k = 1;
    while k < 8 {
        let mut byte = 0;
        while byte < 256 {
            let crc = tables[k - 1][byte];
            tables[k][byte] = (crc >> 8) ^ tables[0][(crc & 0xFF) as usize];
            byte += 1;
        }
        k += 1;
    }
    tables
};

/// CRC-32 as in ISO 3309 and zlib.
#[must_use]
pub fn crc32(bytes: &[u8]) -> u32 {
    let step = |table: usize, byte: u32| CRC_TABLES[table][(byte & 0xFF) as usize];
    let mut crc = !0_u32;
    let (eights, rest) = bytes.as_chunks::<8>();
    for &[a, b, c, d, e, f, g, h] in eights {
        let low = crc ^ u32::from_le_bytes([a, b, c, d]);
        let high = u32::from_le_bytes([e, f, g, h]);
        crc = step(7, low)
            ^ step(6, low >> 8)
            ^ step(5, low >> 16)
            ^ step(4, low >> 24)
            ^ step(3, high)
            ^ step(2, high >> 8)
            ^ step(1, high >> 16)
            ^ step(0, high >> 24);
    }
    for &byte in rest {
        crc = (crc >> 8) ^ step(0, crc ^ u32::from(byte));
    }
    !crc
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crc_of_the_standard_check_string() {
        assert_eq!(crc32(b"123456789"), 0xCBF4_3926);
        assert_eq!(crc32(b""), 0);
        // Longer than one step of eight, against the bytewise definition.
        let data: [u8; 61] = core::array::from_fn(|i| (i * 37 + 11) as u8);
        let bytewise = !data.iter().fold(!0_u32, |crc, &b| {
            (0..8).fold(crc ^ u32::from(b), |c, _| if c & 1 == 1 { 0xEDB8_8320 ^ (c >> 1) } else { c >> 1 })
        });
        assert_eq!(crc32(&data), bytewise);
    }

    #[test]
    fn defaults_may_end_before_the_top_size() {
        let bytes = |base: u32, top: &[u32]| -> ([u8; 32], usize) {
            let mut out = [0; 32];
            let floats = [43.35_f32, 1.0, 1.0, 1.0].map(f32::to_bits);
            let numbers = floats.iter().chain([&base]).chain(top);
            let mut length = 0;
            for (slot, number) in out.chunks_exact_mut(4).zip(numbers) {
                slot.copy_from_slice(&number.to_le_bytes());
                length += 4;
            }
            (out, length)
        };
        let read = |base: u32, top: &[u32]| {
            let (bytes, length) = bytes(base, top);
            read_defaults(&bytes[..length]).map(|defaults| (defaults.base_size, defaults.top_size))
        };
        assert_eq!(read(128, &[]), Ok((128, 0)));
        assert_eq!(read(128, &[256]), Ok((128, 256)));
        assert_eq!(read(128, &[8193]), Err(ModelError::Defaults));
        assert_eq!(read(128, &[256, 0]), Err(ModelError::SectionLength { kind: *b"DFLT" }));
    }
}
