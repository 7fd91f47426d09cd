//! Whether a JPEG file holds its whole picture. Decoders fill what is missing with grey and say nothing.

/// Walks the segments up to the end-of-image marker; `false` when the file ends before it.
///
/// Thumbnails and depth maps lie inside application segments, which are skipped whole, and bytes after the marker
/// (motion photos) do not matter.
pub(crate) fn is_complete(bytes: &[u8]) -> bool {
    let mut rest = bytes;
    loop {
        // To the next marker: entropy-coded bytes, stuffed zeros (FF 00) and restart markers (FF D0..D7) are data.
        let Some(at) = rest.iter().position(|&b| b == 0xff) else { return false };
        rest = rest.get(at + 1..).unwrap_or(&[]);
        let Some((&marker, after)) = rest.split_first() else { return false };
        match marker {
            0xd9 => return true,
            // Fill bytes: the marker may still follow.
            0xff => {}
            0x00 | 0x01 | 0xd0..=0xd8 => rest = after,
            _ => {
                let Some((length, _)) = after.split_first_chunk::<2>() else { return false };
                let length = usize::from(u16::from_be_bytes(*length));
                let Some(next) = after.get(length.max(2)..) else { return false };
                rest = next;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::is_complete;

    fn jpeg() -> Vec<u8> {
        let picture = image::RgbImage::from_fn(40, 30, |x, y| {
            image::Rgb([x as u8 * 6, y as u8 * 8, (x * y * 37) as u8])
        });
        let mut bytes = Vec::new();
        image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 95)
            .encode_image(&picture)
            .expect("encode");
        bytes
    }

    #[test]
    fn only_the_whole_file_is_complete() {
        let whole = jpeg();
        assert!(is_complete(&whole));
        for length in 0..whole.len() {
            assert!(!is_complete(&whole[..length]), "cut to {length} of {}", whole.len());
        }
    }

    #[test]
    fn an_end_marker_inside_a_segment_does_not_count_and_bytes_after_the_end_do_not_matter() {
        let mut bytes = vec![0xff, 0xd8, 0xff, 0xe1, 0, 6, 0xff, 0xd9, 0xff, 0xd9];
        assert!(!is_complete(&bytes));
        bytes.extend([0xff, 0xda, 0, 2, 1, 0xff, 0, 2, 0xff, 0xd0, 3]);
        assert!(!is_complete(&bytes));
        bytes.extend([0xff, 0xff, 0xd9, 7, 7]);
        assert!(is_complete(&bytes));
    }
}
