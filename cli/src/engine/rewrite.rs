//! A model file with other CRF coefficients: one section and the checksum change, the rest stays byte for byte.
use flashmat_core::Error;
use flashmat_core::crf::coefficients::{CLASSES, COUNT};
use flashmat_core::net::Model;
use flashmat_core::net::format::crc32;

/// Layout of the container (docs/model-format.md).
const HEADER: usize = 64;
const TABLE_ENTRY: usize = 32;
const COUNT_AT: usize = 12;
const CHECKSUM_AT: usize = 24;

/// The file `bytes` with these coefficients (non-negative, finite), one set for each class.
///
/// Fails where `bytes` are no model, or the coefficients break the format's rules.
pub(crate) fn with_crf(bytes: &[u8], coefficients: &[[f32; COUNT]; CLASSES]) -> Result<Vec<u8>, Error> {
    // Only a file whose table is known to lie within it is written to.
    Model::from_bytes(bytes)?;
    let mut new = bytes.to_vec();
    let values = coefficients.iter().flatten().flat_map(|value| value.to_le_bytes());
    if let Some(start) = section(bytes, *b"CRFC") {
        new.iter_mut().skip(start).zip(values).for_each(|(byte, value)| *byte = value);
    }
    let checksum = crc32(new.get(HEADER..).unwrap_or(&[])).to_le_bytes();
    new.iter_mut().skip(CHECKSUM_AT).zip(checksum).for_each(|(byte, value)| *byte = value);
    Model::from_bytes(&new)?;
    Ok(new)
}

/// Where the section of this kind starts.
fn section(bytes: &[u8], kind: [u8; 4]) -> Option<usize> {
    let count = u32::from_le_bytes(*bytes.get(COUNT_AT..)?.first_chunk()?) as usize;
    let table = bytes.get(HEADER..)?.chunks_exact(TABLE_ENTRY).take(count);
    let entry = table.into_iter().find(|entry| entry.starts_with(&kind))?;
    usize::try_from(u64::from_le_bytes(*entry.get(8..)?.first_chunk()?)).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use flashmat_core::net::Class;

    #[test]
    fn new_coefficients_come_back_and_nothing_else_changes() {
        let old = crate::engine::ModelFile::load(None).expect("embedded");
        let mut wanted = [[0.0; COUNT]; CLASSES];
        for (at, value) in wanted.iter_mut().flatten().enumerate() {
            *value = at as f32 / 100.0;
        }
        let bytes = with_crf(old.bytes(), &wanted).expect("written");
        let model = Model::from_bytes(&bytes).expect("valid");
        assert_eq!(Class::ALL.map(|class| model.crf(class)), wanted);
        let changed = bytes.iter().zip(old.bytes()).filter(|(a, b)| a != b).count();
        assert!(bytes.len() == old.bytes().len() && changed <= 4 + 4 * COUNT * CLASSES, "{changed}");
        wanted[3][4] = -1.0;
        assert!(with_crf(old.bytes(), &wanted).is_err());
        assert!(with_crf(b"no model", &[[0.0; COUNT]; CLASSES]).is_err());
    }
}
