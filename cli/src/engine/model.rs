//! The model: the embedded one, or a file.
use crate::failure::Failure;
use flashmat_core::Error;
use flashmat_core::net::Model;
use sha2::{Digest, Sha256};
use std::borrow::Cow;
use std::path::{Path, PathBuf};

/// The model that ships with the program.
static EMBEDDED: &[u8] = include_bytes!("../../../models/phone.fmat");

/// The largest model file that is read, in bytes.
const MAX_BYTES: u64 = 1 << 30;

/// A model file's bytes.
pub(crate) struct ModelFile {
    path: PathBuf,
    bytes: Cow<'static, [u8]>,
}

/// A model whose rules have been checked.
#[derive(Clone)]
pub(crate) struct Loaded<'m> {
    /// Where it is from, for messages.
    pub(crate) path: PathBuf,
    pub(crate) model: Model<'m>,
    pub(crate) name: String,
    /// SHA-256 of the file, in hexadecimal.
    pub(crate) hash: String,
    /// Bytes of the file.
    pub(crate) bytes: usize,
}

impl ModelFile {
    /// Reads `path`, or takes the embedded model.
    pub(crate) fn load(path: Option<&Path>) -> Result<Self, Failure> {
        let Some(path) = path else {
            return Ok(Self { path: PathBuf::from("embedded model"), bytes: Cow::Borrowed(EMBEDDED) });
        };
        let reading = |e| Failure::reading(path, &e);
        let metadata = std::fs::metadata(path).map_err(reading)?;
        if metadata.is_dir() || metadata.len() > MAX_BYTES {
            return Err(not_a_model(path, "it is a folder or far too large"));
        }
        Ok(Self { path: path.to_owned(), bytes: Cow::Owned(std::fs::read(path).map_err(reading)?) })
    }

    /// The file as it is.
    pub(crate) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Checks the file.
    pub(crate) fn parse(&self) -> Result<Loaded<'_>, Failure> {
        let model = Model::from_bytes(&self.bytes).map_err(|error| match error {
            Error::Model(rule) => not_a_model(&self.path, &rule.to_string()),
            other => not_a_model(&self.path, &other.to_string()),
        })?;
        let meta: serde_json::Value = serde_json::from_str(model.meta()).unwrap_or_default();
        let name = meta.get("name").and_then(|n| n.as_str()).unwrap_or("unnamed").to_owned();
        let hash = Sha256::digest(&self.bytes).iter().map(|byte| format!("{byte:02x}")).collect();
        Ok(Loaded { path: self.path.clone(), model, name, hash, bytes: self.bytes.len() })
    }
}

fn not_a_model(path: &Path, rule: &str) -> Failure {
    let what = format!("cannot be used as a model: {}", rule.replace("; ", ", "));
    Failure::new(path, what, "get the file again, or leave out --model to use the embedded model")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_embedded_model_keeps_every_rule() {
        let file = ModelFile::load(None).expect("embedded");
        let loaded = file.parse().expect("valid");
        assert_eq!(loaded.hash.len(), 64);
        assert_ne!(loaded.name, "unnamed");
    }
}
