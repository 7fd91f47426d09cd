//! `flashmat capture` and `flashmat render` do what their contract says.

use crate::common::{FILES, Folder, capture, flashmat, names, photo, report, stderr, stdout};
use crate::schema::{complaints, report_schema};
use image::{DynamicImage, GenericImageView, ImageBuffer, Luma, LumaA, Rgb, Rgba};
use serde_json::Value;
use std::path::Path;

#[test]
fn a_photo_gives_all_files_and_a_report_to_the_letter() {
    let folder = Folder::new();
    let out = folder.path("out");
    let run = capture(&[&folder.photo("tiles.png")], &out, &[]);
    assert!(run.status.success(), "{}", stderr(&run));
    assert_eq!(stderr(&run), "");
    assert_eq!(stdout(&run).lines().count(), 1);
    assert_eq!(names(&out), ["tiles"], "nothing else is left behind");
    let tiles = out.join("tiles");
    assert_eq!(names(&tiles), FILES);
    for name in ["albedo.png", "normal.png", "render.png"] {
        let picture = image::open(tiles.join(name)).expect(name);
        assert_eq!((picture.dimensions(), picture.color()), ((128, 128), image::ColorType::Rgb8), "{name}");
    }
    let roughness = image::open(tiles.join("roughness.png")).expect("roughness");
    assert_eq!((roughness.dimensions(), roughness.color()), ((128, 128), image::ColorType::L8));
    let sheet = image::open(tiles.join("sheet.png")).expect("sheet");
    assert!(sheet.width() > 3 * 256 && sheet.height() > 2 * 256);

    let report: Value =
        serde_json::from_slice(&std::fs::read(tiles.join("report.json")).expect("report")).expect("json");
    assert_eq!(report["version"], env!("CARGO_PKG_VERSION"));
    assert_eq!(report["size"], 128);
    assert!(report["model"]["name"].is_string() && report["model"]["hash"].is_string());
    let probabilities = report["class"]["probabilities"].as_object().expect("probabilities");
    let classes = ["fabric", "ground", "leather", "metal", "stone-diff", "stone-spec", "polymer", "wood"];
    assert_eq!(probabilities.len(), classes.len());
    let sum: f64 = classes.iter().map(|c| probabilities[*c].as_f64().expect("number")).sum();
    assert!((sum - 1.0).abs() < 1e-3, "{sum}");
    assert!(classes.contains(&report["class"]["name"].as_str().expect("name")));
    let timings = report["timings_ms"].as_object().expect("timings");
    let stages = "frame global flash highlight albedo texture normal search roughness level relight total";
    let stages: Vec<_> = stages.split(' ').collect();
    assert!(timings.len() == stages.len() && stages.iter().all(|s| timings[*s].is_number()));
    for field in ["light_scale", "residual", "workspace_bytes"] {
        assert!(report[field].is_number(), "{field}");
    }
    assert_eq!(report["engine"], "int8");
    assert!(report["level"].is_string() && report["warnings"].is_array());
    let photo = folder.path("tiles.png");
    assert_eq!(report["photo"]["path"], photo.display().to_string());
    assert_eq!(report["photo"]["bytes"], std::fs::metadata(&photo).expect("photo").len());
    let mut files: Vec<_> = report["files"].as_array().expect("files").iter().map(Value::to_string).collect();
    files.sort();
    assert_eq!(files, FILES.map(|name| format!("\"{name}\"")));
}

/// The schema is no sieve: a report with a wrong field of any kind is found out.
#[test]
fn a_report_that_breaks_its_schema_is_found_out() {
    let folder = Folder::new();
    let out = folder.path("out");
    assert!(capture(&[&folder.photo("a.png")], &out, &["--no-refine"]).status.success());
    let (good, schema) = (report(&out.join("a")).expect("report"), report_schema());
    let breaks: [(&str, Value); 10] = [
        ("/schema", 2.into()),
        ("/version", "one".into()),
        ("/photo/sha256", "ABC".into()),
        ("/photo/bytes", 0.into()),
        ("/files/0", "../a".into()),
        ("/class/name", "cheese".into()),
        ("/class/probabilities/wood", 1.5.into()),
        ("/flash", vec![0.0, 1.0].into()),
        ("/timings_ms/total", (-1).into()),
        ("/warnings", "none".into()),
    ];
    for (pointer, value) in breaks {
        let mut bad = good.clone();
        *bad.pointer_mut(pointer).expect(pointer) = value;
        assert_eq!(complaints(&schema, &schema, &bad, "").len(), 1, "{pointer}");
    }
    for name in good.as_object().expect("object").keys() {
        let mut bad = good.clone();
        bad.as_object_mut().expect("object").remove(name);
        assert_eq!(complaints(&schema, &schema, &bad, "").len(), 1, "{name}");
    }
    let mut bad = good;
    bad["more"] = true.into();
    assert_eq!(complaints(&schema, &schema, &bad, ""), ["/more: unknown"]);
}

#[test]
fn quiet_says_nothing_and_sixteen_bits_are_sixteen() {
    let folder = Folder::new();
    let out = folder.path("out");
    let run = capture(&[&folder.photo("a.jpg")], &out, &["--quiet", "--bit-depth", "16"]);
    assert!(run.status.success(), "{}", stderr(&run));
    assert_eq!((stdout(&run), stderr(&run)), (String::new(), String::new()));
    let color = |name: &str| image::open(out.join("a").join(name)).expect(name).color();
    assert_eq!(color("albedo.png"), image::ColorType::Rgb16);
    assert_eq!(color("normal.png"), image::ColorType::Rgb16);
    assert_eq!(color("roughness.png"), image::ColorType::L16);
}

#[test]
fn sixteen_bit_and_grey_and_alpha_pictures_of_every_format_are_accepted() {
    let folder = Folder::new();
    let tiles = photo(160, 144);
    let at = |x: u32, y: u32| tiles.get_pixel(x, y).0;
    let deep: ImageBuffer<Rgb<u16>, _> =
        ImageBuffer::from_fn(160, 144, |x, y| Rgb(at(x, y).map(|v| u16::from(v) * 257)));
    let grey = ImageBuffer::from_fn(160, 144, |x, y| Luma([at(x, y)[0]]));
    let grey_deep: ImageBuffer<Luma<u16>, _> =
        ImageBuffer::from_fn(160, 144, |x, y| Luma([u16::from(at(x, y)[0]) * 257]));
    let grey_alpha = ImageBuffer::from_fn(160, 144, |x, y| LumaA([at(x, y)[0], 200]));
    let alpha = ImageBuffer::from_fn(160, 144, |x, y| Rgba([at(x, y)[0], at(x, y)[1], at(x, y)[2], 255]));
    let pictures = [
        ("deep.png", DynamicImage::ImageRgb16(deep.clone())),
        ("deep.tiff", DynamicImage::ImageRgb16(deep)),
        ("grey.png", DynamicImage::ImageLuma8(grey.clone())),
        ("grey.jpg", DynamicImage::ImageLuma8(grey)),
        ("grey_deep.png", DynamicImage::ImageLuma16(grey_deep)),
        ("grey_alpha.png", DynamicImage::ImageLumaA8(grey_alpha)),
        ("alpha.png", DynamicImage::ImageRgba8(alpha.clone())),
        ("alpha.webp", DynamicImage::ImageRgba8(alpha)),
        ("plain.tiff", DynamicImage::ImageRgb8(tiles.clone())),
    ];
    let out = folder.path("out");
    let paths: Vec<_> = pictures
        .iter()
        .map(|(name, picture)| {
            let path = folder.path(name);
            picture.save(&path).expect(name);
            path
        })
        .collect();
    let run = capture(&paths.iter().map(|p| p.as_path()).collect::<Vec<_>>(), &out, &[]);
    assert!(run.status.success(), "{}", stderr(&run));
    // One stem twice: numbered in the order of the arguments.
    let made = ["alpha", "alpha-2", "deep", "deep-2", "grey", "grey-2", "grey_alpha", "grey_deep", "plain"];
    assert_eq!(names(&out), made);
    let report = std::fs::read_to_string(out.join("grey_alpha/report.json")).expect("report");
    assert!(report.contains("alpha channel was left out"));
    let said = stderr(&run);
    let warning =
        format!("flashmat: {}: warning: the photo is partly", folder.path("grey_alpha.png").display());
    assert!(said.lines().count() == 1 && said.starts_with(&warning), "{said}");
    // The same values in 8 and 16 bits give the same maps.
    let maps = |name: &str| std::fs::read(out.join(name).join("albedo.png")).expect("albedo");
    assert_eq!(maps("deep"), maps("deep-2"));
    assert_eq!(maps("alpha"), maps("plain"));
}

#[test]
fn threads_do_not_change_the_maps() {
    let folder = Folder::new();
    let photos = ["a.png", "b.png", "c.png"].map(|name| folder.photo(name));
    let read = |out: &Path| -> Vec<Vec<u8>> {
        let files = ["a", "b", "c"].iter().flat_map(|s| ["albedo", "normal", "roughness"].map(|m| (*s, m)));
        files.map(|(s, m)| std::fs::read(out.join(s).join(m).with_extension("png")).expect(m)).collect()
    };
    let mut results = Vec::new();
    for threads in ["1", "2", "5"] {
        let out = folder.path(threads);
        let mut command = flashmat(["capture", "--quiet", "--size", "128", "--threads", threads, "--out"]);
        let run = command.arg(&out).args(&photos).output().expect("run");
        assert!(run.status.success(), "{}", stderr(&run));
        results.push(read(&out));
    }
    assert!(results.iter().all(|r| *r == results[0]));
}

#[test]
fn a_class_that_the_user_insists_on_is_taken() {
    let folder = Folder::new();
    let out = folder.path("out");
    let run = capture(&[&folder.photo("a.png")], &out, &["--class", "metal", "--no-refine"]);
    assert!(run.status.success(), "{}", stderr(&run));
    let report = std::fs::read_to_string(out.join("a/report.json")).expect("report");
    let report: Value = serde_json::from_str(&report).expect("json");
    assert_eq!(report["class"]["name"], "metal");
    let run = capture(&[&folder.path("a.png")], &out, &["--class", "cheese"]);
    assert_eq!(run.status.code(), Some(2), "a wrong option is a usage error");
    assert!(stderr(&run).contains("stone-diff"), "{}", stderr(&run));
}

#[test]
fn a_second_run_replaces_the_first_and_keeps_other_files() {
    let folder = Folder::new();
    let out = folder.path("out");
    let photo = folder.photo("a.png");
    assert!(capture(&[&photo], &out, &[]).status.success());
    std::fs::write(out.join("a/notes.txt"), "mine").expect("write");
    std::fs::write(out.join("a/albedo.png"), "broken").expect("write");
    assert!(capture(&[&photo], &out, &[]).status.success());
    image::open(out.join("a/albedo.png")).expect("a new picture");
    assert_eq!(names(&out.join("a")).len(), FILES.len() + 1);
    assert_eq!(names(&out), ["a"]);
}

/// A render of the earlier maps is none of the new ones.
#[test]
fn a_second_run_removes_what_was_rendered_from_the_first() {
    let folder = Folder::new();
    let out = folder.path("out");
    let photo = folder.photo("a.png");
    assert!(capture(&[&photo], &out, &["--no-refine"]).status.success());
    assert!(flashmat(["render"]).arg(out.join("a")).status().expect("run").success());
    assert!(out.join("a/relit.png").exists());
    assert!(capture(&[&photo], &out, &["--no-refine"]).status.success());
    assert_eq!(names(&out.join("a")), FILES);
}

#[test]
fn without_a_light_render_gives_the_photo_s_picture_again() {
    let folder = Folder::new();
    let out = folder.path("out");
    // A flash beside the camera, and a room.
    let tiles = image::RgbImage::from_fn(160, 144, |x, y| {
        let (dx, dy) = (x as f32 / 160.0 - 0.3, y as f32 / 144.0 - 0.6);
        let tile = if (x / 20 + y / 20) % 2 == 0 { 150.0 } else { 90.0 };
        let value = tile * (0.4 + 0.8 / (1.0 + 4.0 * (dx * dx + dy * dy)));
        Rgb([value as u8, (0.8 * value) as u8, (0.5 * value) as u8])
    });
    let photo = folder.path("a.png");
    tiles.save(&photo).expect("save");
    assert!(capture(&[&photo], &out, &["--bit-depth", "16"]).status.success());
    let maps = out.join("a");
    let run = flashmat(["render"]).arg(&maps).output().expect("run");
    assert!(run.status.success(), "{}", stderr(&run));
    let open = |name: &str| image::open(maps.join(name)).expect(name).into_rgb8();
    let (render, relit) = (open("render.png"), open("relit.png"));
    let worst = render.iter().zip(relit.iter()).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(worst <= Some(1), "{worst:?}");
    let run = flashmat(["render", "--out", "x.jpg"]).arg(&maps).output().expect("run");
    assert_eq!(run.status.code(), Some(2));
    assert!(stderr(&run).contains("must end in .png"), "{}", stderr(&run));
}

#[test]
fn rates_that_learn_nothing_are_refused() {
    for rate in ["nan", "inf", "-1", "0", "2"] {
        let run = flashmat(["learn-crf", "none", "--val", "none", "--out", "m", "--rate", rate]);
        let run = { run }.output().expect("run");
        assert_eq!(run.status.code(), Some(2), "{rate}");
        assert!(stderr(&run).contains("must be 1e-9 to 1"), "{}", stderr(&run));
    }
}

#[test]
fn the_flash_s_own_place_renders_the_flash_picture_again() {
    let folder = Folder::new();
    let out = folder.path("out");
    assert!(capture(&[&folder.photo("a.png")], &out, &["--bit-depth", "16"]).status.success());
    let maps = out.join("a");
    let report = std::fs::read(maps.join("report.json")).expect("report");
    let report: Value = serde_json::from_slice(&report).expect("json");
    let flash = report["flash"].as_array().expect("three numbers").iter().map(ToString::to_string);
    let light = flash.collect::<Vec<_>>().join(",");
    let run = flashmat(["render", "--light", &light]).arg(&maps).output().expect("run");
    assert!(run.status.success(), "{}", stderr(&run));
    let open = |name: &str| image::open(maps.join(name)).expect(name).into_rgb8();
    let (render, relit) = (open("render.png"), open("relit.png"));
    let worst = render.iter().zip(relit.iter()).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(worst <= Some(3), "{worst:?}");

    let side = folder.path("side.png");
    let run =
        flashmat(["render", "--light", "-0.9,0,0.4", "--out"]).arg(&side).arg(&maps).output().expect("run");
    assert!(run.status.success(), "{}", stderr(&run));
    let side = image::open(side).expect("side").into_luma8();
    let mean = |x0: u32| {
        let sum: u32 = (0..128)
            .flat_map(|y| (x0..x0 + 32).map(move |x| (x, y)))
            .map(|(x, y)| u32::from(side.get_pixel(x, y).0[0]))
            .sum();
        sum / (32 * 128)
    };
    assert!(mean(0) > mean(96), "lit from the left");
}

#[test]
fn render_names_what_is_missing() {
    let folder = Folder::new();
    let run = flashmat(["render", "--light", "0,0,1"]).arg(folder.path("")).output().expect("run");
    assert_eq!(run.status.code(), Some(1));
    assert!(stderr(&run).contains("holds no albedo map"), "{}", stderr(&run));
    let run = flashmat(["render", "--light", "0,0,-1", "x"]).output().expect("run");
    assert_eq!(run.status.code(), Some(2));
    assert!(stderr(&run).contains("above the plane"), "{}", stderr(&run));
}

#[test]
fn a_known_light_scale_sets_the_albedos_brightness_and_nonsense_is_refused() {
    let folder = Folder::new();
    let tiles = folder.photo("tiles.png");
    let mean = |scale: &str| {
        let out = folder.path(scale);
        let run = capture(&[&tiles], &out, &["--no-refine", "--light-scale", scale]);
        assert!(run.status.success(), "{}", stderr(&run));
        let albedo = image::open(out.join("tiles/albedo.png")).expect("albedo").to_rgb8();
        albedo.pixels().map(|p| p.0.iter().map(|&v| f64::from(v)).sum::<f64>()).sum::<f64>()
    };
    // The same photo under a light four times as strong is a darker material.
    assert!(mean("0.5") > 1.2 * mean("2"));
    for nonsense in ["0", "-1", "nan", "1e9", "bright"] {
        let run = capture(&[&tiles], &folder.path("out"), &["--light-scale", nonsense]);
        assert!(!run.status.success());
        assert!(stderr(&run).contains("must be 0.001 to 1000"), "{}", stderr(&run));
    }
}
