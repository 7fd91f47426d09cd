//! Directories of TIFF and BigTIFF files: just their fields, however odd the pictures are that they describe.
use std::io::{self, Read, Seek, SeekFrom};

/// The most directories, and the most values of a field, that are looked at.
const MOST_DIRECTORIES: usize = 64;
const MOST_ENTRIES: u64 = 4096;
const MOST_VALUES: u64 = 1 << 24;

/// Tags by number.
pub(super) mod tag {
    pub(in super::super) const NEW_SUBFILE_TYPE: u16 = 254;
    pub(in super::super) const SUBFILE_TYPE: u16 = 255;
    pub(in super::super) const WIDTH: u16 = 256;
    pub(in super::super) const HEIGHT: u16 = 257;
    pub(in super::super) const COMPRESSION: u16 = 259;
    pub(in super::super) const PHOTOMETRIC: u16 = 262;
    pub(in super::super) const ORIENTATION: u16 = 274;
    pub(in super::super) const SUB_DIRECTORIES: u16 = 330;
    pub(in super::super) const ICC_PROFILE: u16 = 34675;
    pub(in super::super) const EXIF_DIRECTORY: u16 = 0x8769;
    pub(in super::super) const INTEROPERABILITY: u16 = 0xa005;
    pub(in super::super) const DNG_VERSION: u16 = 50706;
}

/// One field: where its values lie.
#[derive(Clone, Copy, Debug)]
struct Field {
    tag: u16,
    kind: u16,
    count: u64,
    at: u64,
}

/// One directory.
#[derive(Clone, Debug, Default)]
pub(super) struct Directory {
    /// Where it lies in the file.
    pub(super) at: u64,
    fields: Vec<Field>,
}

/// Reads directories of a file.
pub(super) struct Directories<'r, R> {
    file: &'r mut R,
    little: bool,
    big: bool,
    length: u64,
}

impl<'r, R: Read + Seek> Directories<'r, R> {
    /// Reads the file's header.
    pub(super) fn new(file: &'r mut R) -> io::Result<Self> {
        let length = file.seek(SeekFrom::End(0))?;
        file.rewind()?;
        let mut head = [0; 4];
        file.read_exact(&mut head)?;
        Ok(Self { file, little: head.starts_with(b"II"), big: head.contains(&43), length })
    }

    /// The directories of the main chain, as far as it is sound.
    pub(super) fn chain(&mut self) -> Vec<Directory> {
        let mut found: Vec<Directory> = Vec::new();
        let mut at = if self.big { self.number(8, 8) } else { self.number(4, 4) };
        while let Ok(place) = at
            && place != 0
            && found.len() < MOST_DIRECTORIES
            && found.iter().all(|d| d.at != place)
        {
            let Ok((directory, next)) = self.directory(place) else { break };
            found.push(directory);
            at = Ok(next);
        }
        found
    }

    /// The directories that a field of `directory` points to.
    pub(super) fn below(&mut self, directory: &Directory, tag: u16) -> Vec<Directory> {
        let places = self.numbers(directory, tag);
        places
            .into_iter()
            .take(MOST_DIRECTORIES)
            .filter_map(|at| self.directory(at).ok())
            .map(|(d, _)| d)
            .collect()
    }

    fn directory(&mut self, at: u64) -> io::Result<(Directory, u64)> {
        let (count_size, size, inline) = if self.big { (8, 20, 8) } else { (2, 12, 4) };
        let count = self.number(at, count_size)?.min(MOST_ENTRIES);
        let mut fields = Vec::new();
        for i in 0..count {
            let entry = at + count_size + i * size;
            let (tag, kind) = (self.number(entry, 2)? as u16, self.number(entry + 2, 2)? as u16);
            let count = self.number(entry + 4, inline)?;
            let value = entry + 4 + inline;
            let bytes = count.saturating_mul(size_of(kind));
            let place = if bytes <= inline { Ok(value) } else { self.number(value, inline) }?;
            // A field whose values lie beyond the file's end counts as absent.
            if bytes > 0 && place.checked_add(bytes).is_some_and(|end| end <= self.length) {
                fields.push(Field { tag, kind, count, at: place });
            }
        }
        // A missing end of the list is the end of the chain.
        let next = self.number(at + count_size + count * size, inline).unwrap_or(0);
        Ok((Directory { at, fields }, next))
    }

    fn number(&mut self, at: u64, bytes: u64) -> io::Result<u64> {
        let mut buffer = [0; 8];
        let part = buffer.get_mut(..bytes as usize).unwrap_or(&mut []);
        self.file.seek(SeekFrom::Start(at))?;
        self.file.read_exact(part)?;
        if self.little {
            part.reverse();
        }
        Ok(part.iter().fold(0, |n, &b| n << 8 | u64::from(b)))
    }

    /// The unsigned values of a field; none where there is none.
    pub(super) fn numbers(&mut self, directory: &Directory, tag: u16) -> Vec<u64> {
        let Some(field) = directory.field(tag) else { return Vec::new() };
        let bytes = match field.kind {
            1 | 3 | 4 | 7 | 13 | 16 | 18 => size_of(field.kind),
            _ => return Vec::new(),
        };
        (0..field.count.min(MOST_DIRECTORIES as u64))
            .map_while(|i| self.number(field.at + i * bytes, bytes).ok())
            .collect()
    }

    /// The first value of a field.
    pub(super) fn first(&mut self, directory: &Directory, tag: u16) -> Option<u64> {
        self.numbers(directory, tag).first().copied()
    }

    /// The first value of a field as a float: a number or a ratio.
    pub(super) fn real(&mut self, directory: &Directory, tag: u16) -> Option<f32> {
        let field = *directory.field(tag)?;
        if field.kind != 5 {
            return self.first(directory, tag).map(|v| v as f32);
        }
        let (over, under) = (self.number(field.at, 4).ok()?, self.number(field.at + 4, 4).ok()?);
        Some(over as f32 / under as f32).filter(|v| v.is_finite())
    }

    /// The bytes of a field: a text or a profile.
    pub(super) fn bytes(&mut self, directory: &Directory, tag: u16) -> Option<Vec<u8>> {
        let field = *directory.field(tag)?;
        if !matches!(field.kind, 1 | 2 | 7) || field.count > MOST_VALUES {
            return None;
        }
        let mut bytes = vec![0; field.count as usize];
        self.file.seek(SeekFrom::Start(field.at)).ok()?;
        self.file.read_exact(&mut bytes).ok()?;
        Some(bytes)
    }
}

impl Directory {
    fn field(&self, tag: u16) -> Option<&Field> {
        self.fields.iter().find(|f| f.tag == tag)
    }

    /// Whether it has the field.
    pub(super) fn has(&self, tag: u16) -> bool {
        self.field(tag).is_some()
    }
}

/// Bytes of a value; 0: an unknown type.
const fn size_of(kind: u16) -> u64 {
    match kind {
        1 | 2 | 6 | 7 => 1,
        3 | 8 => 2,
        4 | 9 | 11 | 13 => 4,
        5 | 10 | 12 | 16 | 17 | 18 => 8,
        _ => 0,
    }
}

/// The file as if its first directory were another: decoders that read only the main chain's first picture read any.
pub(super) struct StartingAt<R> {
    file: R,
    /// The header's pointer in the file's own byte order, and where it stands.
    pointer: Vec<u8>,
    pointer_at: u64,
    at: u64,
}

impl<R: Read + Seek> StartingAt<R> {
    pub(super) fn new(mut file: R, directory: u64) -> io::Result<Self> {
        let mut head = [0; 4];
        file.rewind()?;
        file.read_exact(&mut head)?;
        let (size, pointer_at) = if head.contains(&43) { (8, 8) } else { (4, 4) };
        let mut pointer = directory.to_le_bytes().get(..size).unwrap_or(&[]).to_vec();
        if head.starts_with(b"MM") {
            pointer.reverse();
        }
        file.rewind()?;
        Ok(Self { file, pointer, pointer_at, at: 0 })
    }
}

impl<R: Read> Read for StartingAt<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.file.read(buffer)?;
        let pointer_end = self.pointer_at + self.pointer.len() as u64;
        if self.at < pointer_end {
            for (byte, at) in buffer.iter_mut().take(count).zip(self.at..pointer_end) {
                if let Some(patch) =
                    at.checked_sub(self.pointer_at).and_then(|i| self.pointer.get(i as usize))
                {
                    *byte = *patch;
                }
            }
        }
        self.at += count as u64;
        Ok(count)
    }
}

impl<R: Seek> Seek for StartingAt<R> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.at = self.file.seek(to)?;
        Ok(self.at)
    }
}
