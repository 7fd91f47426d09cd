//! `flashmat render`: captured maps under another light.
use super::{complain, say};
use crate::engine::light;
use crate::failure::Failure;
use crate::mapset;
use crate::output::files;
use crate::output::png::{self, Depth};
use crate::output::report::Report;
use flashmat_core::brdf::F0_DIELECTRIC;
use flashmat_core::frame::FieldOfView;
use glam::Vec3;
use std::path::{Path, PathBuf};

/// What to light, and how.
#[derive(clap::Args)]
pub(crate) struct RenderArgs {
    /// A folder that `flashmat capture` wrote.
    #[arg(value_name = "MAPS_DIR")]
    maps: PathBuf,
    /// Where the light is, in plane units: the plane is z = 0 with x right and y up, the camera and the flash are at
    /// 0,0,1, and the maps reach 0.397 to each side (tan of half the angle of view).
    #[arg(long, value_name = "X,Y,Z", value_parser = position, allow_hyphen_values = true)]
    light: Vec3,
    /// How strong the light is; 1 is the photo's flash.
    #[arg(long, value_name = "S", default_value_t = 1.0, value_parser = strength)]
    strength: f32,
    /// The picture to write [default: MAPS_DIR/relit.png].
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
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
    let maps = mapset::read(&args.maps, None)?;
    let report = read_report(&args.maps)?;
    let (f0, fov_deg, scale) = report.map_or((F0_DIELECTRIC, FieldOfView::TARGET_DEG, 1.0), |r| {
        (r.f0, r.fov_deg, r.light_scale * (1.0 + r.room_light))
    });
    let picture = light::relight(&maps, f0, fov_deg, args.light, scale * args.strength)
        .map_err(|e| Failure::core(&args.maps, &e))?;
    let out = args.out.clone().unwrap_or_else(|| args.maps.join("relit.png"));
    files::write_file(&out, |f| png::linear(f, &picture, maps.size, Depth::Eight))?;
    Ok(out)
}

/// The capture's report; maps from elsewhere have none.
fn read_report(folder: &Path) -> Result<Option<Report>, Failure> {
    let path = folder.join("report.json");
    let text = match std::fs::read(&path) {
        Ok(text) => text,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(Failure::reading(&path, &e)),
    };
    let help = "capture the photo again, or remove the file to render with defaults";
    let report = serde_json::from_slice(&text);
    report.map(Some).map_err(|e| Failure::new(&path, format!("is not a report: {e}"), help))
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
