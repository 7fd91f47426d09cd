//! A picture to draw on: rectangles, images and text in sRGB codes.
use ab_glyph::{Font, FontRef, ScaleFont};
use image::{Rgb, RgbImage};

/// An sRGB colour.
pub(crate) type Colour = [u8; 3];

/// The two weights of the typeface (Inter, SIL Open Font License, see `fonts/OFL.txt`).
pub(crate) struct Fonts {
    pub(crate) regular: FontRef<'static>,
    pub(crate) bold: FontRef<'static>,
}

impl Fonts {
    pub(crate) fn load() -> Self {
        let font = |bytes: &'static [u8]| FontRef::try_from_slice(bytes).expect("the embedded font is whole");
        Self {
            regular: font(include_bytes!("../../fonts/Inter-Regular.ttf")),
            bold: font(include_bytes!("../../fonts/Inter-SemiBold.ttf")),
        }
    }
}

/// One line of text: where its baseline is, how it looks.
#[derive(Clone, Copy)]
pub(crate) struct Text<'a> {
    pub(crate) font: &'a FontRef<'static>,
    /// Height of the font in pixels.
    pub(crate) size: f32,
    pub(crate) colour: Colour,
}

impl Text<'_> {
    /// Pixels that `line` takes across.
    pub(crate) fn width(&self, line: &str) -> f32 {
        let font = self.font.as_scaled(self.size);
        let mut width = 0.0;
        let mut before = None;
        for c in line.chars() {
            let glyph = self.font.glyph_id(c);
            width += before.map_or(0.0, |b| font.kern(b, glyph)) + font.h_advance(glyph);
            before = Some(glyph);
        }
        width
    }

    /// `line`, its end replaced by an ellipsis where it is wider than `width`. Characters that the font lacks become
    /// question marks.
    pub(crate) fn fit(&self, line: &str, width: f32) -> String {
        let known = |c: char| if self.font.glyph_id(c).0 == 0 { '?' } else { c };
        let mut line: String = line.chars().map(known).collect();
        if self.width(&line) <= width {
            return line;
        }
        while line.pop().is_some() {
            let shorter = format!("{}…", line.trim_end());
            if self.width(&shorter) <= width {
                return shorter;
            }
        }
        line
    }

    /// Draws `line` from `x`, its baseline at `y`.
    pub(crate) fn draw(&self, canvas: &mut RgbImage, x: f32, y: f32, line: &str) {
        let font = self.font.as_scaled(self.size);
        let mut pen = x;
        // The letter before, and where it starts.
        let mut before = None;
        for c in line.chars() {
            let id = self.font.glyph_id(c);
            let advance = font.h_advance(id);
            // An accent of its own (as in names from macOS) goes onto its letter; fonts place it by the letter's start.
            let is_accent = advance == 0.0;
            if let (Some((letter, _)), false) = (before, is_accent) {
                pen += font.kern(letter, id);
            }
            let at = before.filter(|_| is_accent).map_or(pen, |(_, start)| start);
            let glyph = id.with_scale_and_position(self.size, ab_glyph::point(at, y));
            if let Some(outline) = self.font.outline_glyph(glyph) {
                let corner = outline.px_bounds().min;
                outline.draw(|dx, dy, coverage| {
                    blend(
                        canvas,
                        corner.x as i64 + i64::from(dx),
                        corner.y as i64 + i64::from(dy),
                        self.colour,
                        coverage,
                    );
                });
            }
            if !is_accent {
                before = Some((id, pen));
                pen += advance;
            }
        }
    }

    /// Draws `line` so that it ends at `x`.
    pub(crate) fn draw_right(&self, canvas: &mut RgbImage, x: f32, y: f32, line: &str) {
        self.draw(canvas, x - self.width(line), y, line);
    }
}

fn blend(canvas: &mut RgbImage, x: i64, y: i64, colour: Colour, coverage: f32) {
    let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y)) else { return };
    if let Some(pixel) = canvas.get_pixel_mut_checked(x, y) {
        for (channel, ink) in pixel.0.iter_mut().zip(colour) {
            let under = f32::from(*channel);
            *channel = (under + (f32::from(ink) - under) * coverage.clamp(0.0, 1.0)).round() as u8;
        }
    }
}

/// Fills a rectangle; parts outside are left out.
pub(crate) fn fill(canvas: &mut RgbImage, (x, y): (u32, u32), (width, height): (u32, u32), colour: Colour) {
    for row in y..y.saturating_add(height).min(canvas.height()) {
        for column in x..x.saturating_add(width).min(canvas.width()) {
            canvas.put_pixel(column, row, Rgb(colour));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawn(font: &FontRef<'static>, line: &str) -> RgbImage {
        let mut canvas = RgbImage::new(400, 60);
        Text { font, size: 34.0, colour: [255; 3] }.draw(&mut canvas, 10.0, 44.0, line);
        canvas
    }

    #[test]
    fn letters_of_europe_are_shown_and_no_others_pretended() {
        let fonts = Fonts::load();
        for font in [&fonts.regular, &fonts.bold] {
            let text = Text { font, size: 34.0, colour: [255; 3] };
            let known = "Küche Fußboden ünï — Œuvre Żółć Ñandú İğne Δρύς Дуб 1²×³ 90° …";
            assert_eq!(text.fit(known, 1e6), known);
            assert_eq!(text.fit("木 a", 1e6), "? a");
            assert_ne!(drawn(font, "ü"), drawn(font, "u"));
            // An accent of its own lies over its letter and takes no place of its own.
            assert!((text.width("u\u{308}x") - text.width("ux")).abs() < 2.0);
            let (split, whole) = (drawn(font, "u\u{308}"), drawn(font, "ü"));
            let ink = |p: &RgbImage| p.pixels().map(|p| u64::from(p.0[0])).sum::<u64>() as f64;
            let apart: u64 = split.iter().zip(whole.iter()).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
            assert!((apart as f64) < 0.6 * ink(&whole), "{apart} of {}", ink(&whole));
        }
    }
}
