//! What a capture leaves on disk.
mod canvas;
pub(crate) mod files;
mod names;
pub(crate) mod owner;
pub(crate) mod places;
pub(crate) mod png;
pub(crate) mod report;
mod sheet;

use crate::engine::{Facts, light};
use crate::failure::Failure;
use crate::interrupt;
use crate::material::Material;
use files::{Staging, System};
use flashmat_export::{Pictures, glb};
use owner::{Holds, Source};
use png::Depth;
use std::io::{self, Write};
use std::path::Path;

/// Writes all files of `material`, found in the photo `source`, to the folder `target`, whole or not at all. `false`,
/// and nothing done, if another photo's result is there.
pub(crate) fn write_all(
    target: &Path,
    name: &str,
    material: &Material,
    facts: &Facts,
    depth: Depth,
    source: &Source,
) -> Result<bool, Failure> {
    let maps = material.maps.view();
    let size = maps.size;
    let relit = light::from_the_side(material)
        .map_err(|e| Failure::writing(&target.join("sheet.png"), &io::Error::other(e)))?;
    let mut folder = Staging::new(&System, target)?;
    folder.write("albedo.png", |f| png::albedo(f, &maps, depth))?;
    folder.write("normal.png", |f| png::normal(f, &maps, depth))?;
    folder.write("roughness.png", |f| png::roughness(f, &maps, depth))?;
    folder.write("render.png", |f| png::linear(f, &material.render, size, depth))?;
    folder.write("sheet.png", |f| sheet::write(f, name, material, &relit))?;
    folder.write("material.glb", |f| write_glb(f, name, material))?;
    folder.write(owner::REPORT, |f| report::Report::new(material, facts, source).write(f))?;
    if interrupt::asked() {
        return Err(Failure::new(target, "interrupted", "run it again"));
    }
    let hash = || Some(source.sha256.clone());
    let may_replace = |folder: &Path| !matches!(owner::holds(folder, &mut hash.clone()), Holds::Other(_));
    folder.commit(&may_replace)
}

/// The maps on a square, for any viewer of glTF.
fn write_glb(out: &mut dyn Write, name: &str, material: &Material) -> io::Result<()> {
    let pictures = Pictures::Planes(material.maps.view());
    let file = glb::Material { name, pictures, f0: material.f0, fov_deg: material.fov_deg };
    let file = glb::file(&file).map_err(io::Error::other)?;
    file.parts().into_iter().try_for_each(|part| out.write_all(part))
}

/// The files of [`write_all`] without a disk, maps in both depths; the sheet only if asked. For the fuzzers.
pub(crate) fn in_memory(
    name: &str,
    material: &Material,
    facts: &Facts,
    source: &Source,
    sheet: bool,
) -> io::Result<Vec<(&'static str, Vec<u8>)>> {
    let mut files = Vec::new();
    let mut file = |name, write: &dyn Fn(&mut dyn Write) -> io::Result<()>| -> io::Result<()> {
        let mut bytes = Vec::new();
        write(&mut bytes)?;
        files.push((name, bytes));
        Ok(())
    };
    let maps = material.maps.view();
    for depth in [Depth::Eight, Depth::Sixteen] {
        file("albedo.png", &|f| png::albedo(f, &maps, depth))?;
        file("normal.png", &|f| png::normal(f, &maps, depth))?;
        file("roughness.png", &|f| png::roughness(f, &maps, depth))?;
        file("render.png", &|f| png::linear(f, &material.render, maps.size, depth))?;
    }
    if sheet {
        let relit = light::from_the_side(material).map_err(io::Error::other)?;
        file("sheet.png", &|f| sheet::write(f, name, material, &relit))?;
    }
    file("material.glb", &|f| write_glb(f, name, material))?;
    file(owner::REPORT, &|f| report::Report::new(material, facts, source).write(f))?;
    Ok(files)
}
