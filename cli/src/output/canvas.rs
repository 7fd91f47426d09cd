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
            regular: font(include_bytes!("../../fonts/Inter-Regular.otf")),
            bold: font(include_bytes!("../../fonts/Inter-SemiBold.otf")),
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
        let mut before = None;
        for c in line.chars() {
            let id = self.font.glyph_id(c);
            pen += before.map_or(0.0, |b| font.kern(b, id));
            let glyph = id.with_scale_and_position(self.size, ab_glyph::point(pen, y));
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
            pen += font.h_advance(id);
            before = Some(id);
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
