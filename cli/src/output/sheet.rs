//! `sheet.png`: photo, maps and re-renderings of one material on one labelled picture, for the eye.
use super::canvas::{Colour, Fonts, Text, fill};
use super::png;
use crate::material::Material;
use flashmat_core::Error;
use flashmat_core::maps::{Coding, encode_row};
use flashmat_core::net::Class;
use image::RgbImage;
use image::imageops::{self, FilterType};
use std::io::{self, Write};

const BACKGROUND: Colour = [27, 28, 31];
const TRACK: Colour = [45, 47, 52];
const BORDER: Colour = [62, 64, 70];
const BAR: Colour = [112, 116, 126];
const ACCENT: Colour = [236, 177, 86];
const BRIGHT: Colour = [240, 241, 243];
const DIM: Colour = [158, 162, 170];

const MARGIN: u32 = 32;
const GAP: u32 = 24;
const HEADER: u32 = 88;
/// Height of a panel's two lines of text above it.
const LABEL: u32 = 44;
/// Width of the column with the class probabilities.
const SIDE: u32 = 236;

/// Draws the sheet. `relit` is the material under a light from the side, 3 planes of linear RGB.
pub(crate) fn write(out: &mut dyn Write, name: &str, material: &Material, relit: &[f32]) -> io::Result<()> {
    let sheet = draw(name, material, relit).map_err(io::Error::other)?;
    let (width, height) = (sheet.width() as usize, sheet.height() as usize);
    png::rgb8(out, sheet.as_raw(), (width, height))
}

fn draw(name: &str, material: &Material, relit: &[f32]) -> Result<RgbImage, Error> {
    let size = material.maps.size;
    let panel = u32::try_from(size.clamp(256, 512)).unwrap_or(512);
    let width = 2 * MARGIN + 3 * panel + 3 * GAP + SIDE;
    let height = MARGIN + HEADER + 2 * (LABEL + panel) + GAP + MARGIN;
    let fonts = Fonts::load();
    let mut canvas = RgbImage::from_pixel(width, height, image::Rgb(BACKGROUND));
    header(&mut canvas, &fonts, name, material);

    let view = material.maps.view();
    let linear =
        |planes: &[f32]| picture(size, panel, |y, line| encode_row(planes, size, y, Coding::Srgb, line));
    let re_render = format!("same light, residual {:.3}", material.residual);
    let panels = [
        ("Photo", "as the network saw it", linear(&material.photo)?),
        ("Re-render", re_render.as_str(), linear(&material.render)?),
        ("Relit", "the maps, light from the left", linear(relit)?),
        ("Albedo", "base colour without light", picture(size, panel, |y, line| view.albedo_row(y, line))?),
        (
            "Normal",
            "x right, y up, z to the camera",
            picture(size, panel, |y, line| view.normal_row(y, line))?,
        ),
        (
            "Roughness",
            "dark is glossy, bright is matt",
            picture(size, panel, |y, line| {
                let mut grey = vec![0_u8; size];
                view.roughness_row(y, &mut grey)?;
                line.iter_mut().zip(grey.iter().flat_map(|&g| [g; 3])).for_each(|(code, g)| *code = g);
                Ok(())
            })?,
        ),
    ];
    for (i, (label, caption, picture)) in (0_u32..).zip(panels) {
        let x = MARGIN + i % 3 * (panel + GAP);
        let y = MARGIN + HEADER + i / 3 * (LABEL + panel + GAP);
        let bold = Text { font: &fonts.bold, size: 17.0, colour: BRIGHT };
        bold.draw(&mut canvas, x as f32, (y + 14) as f32, label);
        let small = Text { font: &fonts.regular, size: 13.5, colour: DIM };
        small.draw(&mut canvas, x as f32, (y + 33) as f32, caption);
        fill(&mut canvas, (x - 1, y + LABEL - 1), (panel + 2, panel + 2), BORDER);
        imageops::replace(&mut canvas, &picture, i64::from(x), i64::from(y + LABEL));
    }
    let left = MARGIN + 3 * (panel + GAP);
    class_bars(&mut canvas, &fonts, material, left, MARGIN + HEADER);
    facts(&mut canvas, &fonts, material, left, MARGIN + HEADER + LABEL + panel + GAP);
    Ok(canvas)
}

/// An image of `size` a side from interleaved rows, scaled to `panel` a side.
fn picture(
    size: usize,
    panel: u32,
    row: impl Fn(usize, &mut [u8]) -> Result<(), Error>,
) -> Result<RgbImage, Error> {
    let mut codes = vec![0_u8; 3 * size * size];
    for (y, line) in codes.chunks_exact_mut(3 * size).enumerate() {
        row(y, line)?;
    }
    let side = u32::try_from(size).map_err(|_| Error::Size { size })?;
    let full = RgbImage::from_raw(side, side, codes).ok_or(Error::Size { size })?;
    Ok(if side == panel { full } else { imageops::resize(&full, panel, panel, FilterType::CatmullRom) })
}

fn header(canvas: &mut RgbImage, fonts: &Fonts, name: &str, material: &Material) {
    let right = (canvas.width() - MARGIN) as f32;
    let class = Text { font: &fonts.bold, size: 34.0, colour: ACCENT };
    let title = material.class_line();
    let class_width = class.width(&title);
    class.draw_right(canvas, right, (MARGIN + 28) as f32, &title);
    let heading = Text { font: &fonts.bold, size: 34.0, colour: BRIGHT };
    let room = right - MARGIN as f32 - class_width - GAP as f32;
    heading.draw(canvas, MARGIN as f32, (MARGIN + 28) as f32, &heading.fit(name, room));
    fill(canvas, (MARGIN, MARGIN + 52), (canvas.width() - 2 * MARGIN, 1), BORDER);
}

/// The class probabilities as labelled bars, in the fixed order of the classes.
fn class_bars(canvas: &mut RgbImage, fonts: &Fonts, material: &Material, x: u32, y: u32) {
    const STEP: u32 = 29;
    let bold = Text { font: &fonts.bold, size: 17.0, colour: BRIGHT };
    bold.draw(canvas, x as f32, (y + 14) as f32, "Class");
    for (i, (class, p)) in Class::ALL.into_iter().zip(material.probabilities).enumerate() {
        let top = y + LABEL + i as u32 * STEP;
        let p = p.clamp(0.0, 1.0);
        let chosen = class == material.class;
        let text = Text { font: &fonts.regular, size: 14.5, colour: if chosen { BRIGHT } else { DIM } };
        text.draw(canvas, x as f32, (top + 11) as f32, class.name());
        text.draw_right(canvas, (x + SIDE) as f32, (top + 11) as f32, &format!("{:.0} %", 100.0 * p));
        fill(canvas, (x, top + 18), (SIDE, 4), TRACK);
        let filled = (p * SIDE as f32).round() as u32;
        fill(canvas, (x, top + 18), (filled, 4), if chosen { ACCENT } else { BAR });
    }
}

/// A few numbers, for those who compare sheets.
fn facts(canvas: &mut RgbImage, fonts: &Fonts, material: &Material, x: u32, y: u32) {
    let bold = Text { font: &fonts.bold, size: 17.0, colour: BRIGHT };
    bold.draw(canvas, x as f32, (y + 14) as f32, "Facts");
    let size = material.maps.size;
    let lines = [
        ("residual", format!("{:.3}", material.residual)),
        ("light scale", format!("{:.2}", material.light_scale)),
        ("room's light", format!("{:.0} %", 100.0 * material.room_light)),
        ("field of view", format!("{:.1}°", material.fov_deg)),
        ("maps", format!("{size} × {size}")),
    ];
    for (i, (label, value)) in (0_u32..).zip(lines) {
        let baseline = (y + LABEL + 12 + i * 26) as f32;
        let dim = Text { font: &fonts.regular, size: 14.5, colour: DIM };
        dim.draw(canvas, x as f32, baseline, label);
        Text { colour: BRIGHT, ..dim }.draw_right(canvas, (x + SIDE) as f32, baseline, &value);
    }
}
