//! `flashmat render`: captured maps under another light.
use super::{complain, say};
use crate::engine::light;
use crate::failure::Failure;
use crate::mapset;
use crate::material::OwnedMaps;
use crate::output::files;
use crate::output::owner;
use crate::output::png::{self, Depth};
use crate::output::report::Report;
use flashmat_core::Error;
use flashmat_core::brdf::F0_DIELECTRIC;
use flashmat_core::frame::FieldOfView;
use glam::Vec3;
use std::path::{Path, PathBuf};

/// How often a folder that changes while it is read is read again.
const ROUNDS: usize = 4;

/// What to light, and how.
#[derive(clap::Args)]
pub(crate) struct RenderArgs {
    /// A folder that `flashmat capture` wrote.
    #[arg(value_name = "MAPS_DIR")]
    maps: PathBuf,
    /// Where the light is, in plane units: the plane is z = 0 with x right and y up, the camera is at 0,0,1, and maps of
    /// a field of view of 43.35 degrees reach 0.397 to each side [default: the photo's own light as the report has it,
    /// flash and room, which gives render.png again].
    #[arg(long, value_name = "X,Y,Z", value_parser = position, allow_hyphen_values = true)]
    light: Option<Vec3>,
    /// How strong the light is; 1 is as strong as the photo's flash and room together.
    #[arg(long, value_name = "S", default_value_t = 1.0, value_parser = strength, allow_negative_numbers = true)]
    strength: f32,
    /// The picture to write, a PNG file [default: MAPS_DIR/relit.png].
    #[arg(long, value_name = "FILE", value_parser = png_file())]
    out: Option<PathBuf>,
}

/// A path that does not promise another format than PNG.
fn png_file() -> impl clap::builder::TypedValueParser<Value = PathBuf> {
    use clap::builder::TypedValueParser as _;
    clap::builder::PathBufValueParser::new().try_map(|path| {
        match path.extension().is_none_or(|e| e.eq_ignore_ascii_case("png")) {
            true => Ok(path),
            false => Err("must end in .png: render writes PNG pictures"),
        }
    })
}

fn position(text: &str) -> Result<Vec3, String> {
    let help = "must be three numbers with the light above the plane, as in -0.8,0.4,0.6";
    let numbers: Vec<f32> = text.split(',').filter_map(|n| n.trim().parse().ok()).collect();
    match (<[f32; 3]>::try_from(numbers), text.split(',').count()) {
        (Ok(xyz), 3) if Vec3::from(xyz).is_finite() && xyz[2] > 0.0 => Ok(xyz.into()),
        _ => Err(help.to_owned()),
    }
}

fn strength(text: &str) -> Result<f32, String> {
    let fits = |s: &f32| s.is_finite() && *s >= 0.0;
    text.parse().ok().filter(fits).ok_or_else(|| "must be a number of 0 or more".to_owned())
}

/// Runs the command; `false` when it failed.
pub(crate) fn run(args: &RenderArgs) -> bool {
    match render(args) {
        Ok(out) => {
            say(&out.display());
            true
        }
        Err(failure) => {
            complain(&failure);
            false
        }
    }
}

fn render(args: &RenderArgs) -> Result<PathBuf, Failure> {
    let (maps, report) = read(&args.maps)?;
    let photo_light = PhotoLight::of(report.as_ref());
    let picture = photo_light.relight(&maps, args.light, args.strength);
    let picture = picture.map_err(|e| Failure::core(&args.maps, &e))?;
    let out = args.out.clone().unwrap_or_else(|| args.maps.join(owner::RELIT));
    files::write_file(&out, |f| png::linear(f, &picture, maps.size, Depth::Eight))?;
    Ok(out)
}

/// Maps and report of one capture, also where another one is just taking its place.
fn read(folder: &Path) -> Result<(OwnedMaps, Option<Report>), Failure> {
    for _ in 0..ROUNDS {
        let before = report_text(folder)?;
        let maps = mapset::read(folder, None);
        if report_text(folder)? == before {
            return Ok((maps?, before.map(|text| parse_report(folder, &text)).transpose()?));
        }
    }
    Err(Failure::new(folder, "changes while it is read", "wait for the capture to end"))
}

/// The light of the photo that the maps come from.
struct PhotoLight {
    f0: f32,
    fov_deg: f32,
    flash: Vec3,
    strength: f32,
    /// As a share of the flash's.
    room: f32,
}

impl PhotoLight {
    /// As the report has it; a flash of strength 1 at the camera where there is none.
    fn of(report: Option<&Report>) -> Self {
        match report {
            Some(r) => Self {
                f0: r.f0,
                fov_deg: r.fov_deg,
                flash: r.flash.into(),
                strength: r.light_scale,
                room: r.room_light,
            },
            None => Self {
                f0: F0_DIELECTRIC,
                fov_deg: FieldOfView::TARGET_DEG,
                flash: Vec3::Z,
                strength: 1.0,
                room: 0.0,
            },
        }
    }

    /// The maps under `light`, or under this one: 3 planes of linear radiance.
    fn relight(&self, maps: &OwnedMaps, light: Option<Vec3>, factor: f32) -> Result<Vec<f32>, Error> {
        let strength = factor * self.strength;
        if let Some(light) = light {
            return light::relight(maps, self.f0, self.fov_deg, light, strength * (1.0 + self.room));
        }
        let mut picture = light::relight(maps, self.f0, self.fov_deg, self.flash, strength)?;
        for (value, albedo) in picture.iter_mut().zip(&maps.albedo) {
            *value += strength * self.room * albedo;
        }
        Ok(picture)
    }
}

/// The capture's report as text; maps from elsewhere have none.
fn report_text(folder: &Path) -> Result<Option<Vec<u8>>, Failure> {
    let path = folder.join(owner::REPORT);
    match std::fs::read(&path) {
        Ok(text) => Ok(Some(text)),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(e) => Err(Failure::reading(&path, &e)),
    }
}

fn parse_report(folder: &Path, text: &[u8]) -> Result<Report, Failure> {
    let help = "capture the photo again, or remove the file to render with defaults";
    serde_json::from_slice(text)
        .map_err(|e| Failure::new(&folder.join(owner::REPORT), format!("is not a report: {e}"), help))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lights_are_three_numbers_above_the_plane() {
        assert_eq!(position("-0.5, 0.25,1"), Ok(Vec3::new(-0.5, 0.25, 1.0)));
        for bad in ["", "1,2", "1,2,3,4", "1,2,x,3", "0,0,0", "0,0,-1", "nan,0,1", "0,0,inf"] {
            assert!(position(bad).is_err(), "{bad}");
        }
        assert!(strength("-1").is_err() && strength("inf").is_err() && strength("0").is_ok());
    }
}
