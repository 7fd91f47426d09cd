//! `flashmat eval` and `flashmat bench` on small inputs.

use crate::common::{Folder, flashmat, stderr, stdout};
use image::{GrayImage, Luma, Rgb, RgbImage};

/// Two materials, and a folder that is none.
fn data_set(folder: &Folder) {
    for (class, name, shade) in [("wood", "planks", 90), ("metal", "plate", 180)] {
        let at = folder.path(&format!("data/{class}/{name}"));
        std::fs::create_dir_all(&at).expect("folder");
        RgbImage::from_fn(150, 140, |x, _| Rgb([shade, shade - (x % 50) as u8, 60]))
            .save(at.join("albedo.jpg"))
            .expect("albedo");
        RgbImage::from_pixel(150, 140, Rgb([128, 128, 255])).save(at.join("normal.png")).expect("normal");
        GrayImage::from_pixel(150, 140, Luma([128])).save(at.join("roughness.png")).expect("roughness");
    }
    std::fs::create_dir_all(folder.path("data/unknown/thing")).expect("folder");
    folder.file("splits.tsv", b"class\tname\tsplit\nwood\tplanks\ttest\nmetal\tplate\ttrain\n");
}

#[test]
fn the_table_has_each_class_and_the_csv_each_material() {
    let folder = Folder::new();
    data_set(&folder);
    let csv = folder.path("errors.csv");
    let mut command = flashmat(["eval", "--size", "128", "--threads", "2", "--no-refine", "--csv"]);
    let run = command.arg(&csv).arg(folder.path("data")).output().expect("run");
    assert!(run.status.success(), "{}", stderr(&run));
    let table = stdout(&run);
    for part in ["wood", "metal", "int8, not refined", "constants", "mean colour", "classical", "2 photos"] {
        assert!(table.contains(part), "{part}: {table}");
    }
    let text = std::fs::read_to_string(&csv).expect("csv");
    // Names are quoted: method and material.
    let rows: Vec<Vec<&str>> =
        text.lines().map(|l| l.split(',').filter(|cell| *cell != " not refined\"").collect()).collect();
    assert_eq!(rows.len(), 1 + 4 * 2);
    assert!(rows.iter().all(|r| r.len() == rows[0].len()), "{text}");
    // The truth is flat and half rough: the guess has next to no error there.
    let column = |name: &str| rows[0].iter().position(|c| *c == name).expect("column");
    let guesses: Vec<_> = rows.iter().filter(|r| r[0] == "\"mean colour\"").collect();
    assert_eq!(guesses.len(), 2);
    for name in ["normal_mse_paper", "roughness_mse_paper"] {
        assert!(guesses.iter().all(|r| r[column(name)].parse::<f64>().expect("number") < 1e-4), "{text}");
    }
    for row in &rows[1..] {
        let value = |name: &str| row[column(name)].parse::<f64>().expect("number");
        assert!(value("albedo_scaled_mse_paper") <= value("albedo_mse_paper") + 1e-6, "{text}");
    }

    let mut command = flashmat(["eval", "--size", "128", "--no-refine", "--split", "test"]);
    let run = command.arg(folder.path("data")).output().expect("run");
    assert!(stdout(&run).contains("1 photos") && !stdout(&run).contains("metal "), "{}", stdout(&run));
}

/// Folders as `python -m flashmat_train testset` makes them: the photo counts, not the maps' own render.
#[test]
fn photos_of_the_data_set_are_used_and_environments_are_added() {
    let folder = Folder::new();
    data_set(&folder);
    let at = folder.path("data/wood/planks");
    let eval = |more: &[&str]| {
        let mut command = flashmat(["eval", "--size", "128", "--no-refine", "--split", "test"]);
        let run = command.args(more).arg(folder.path("data")).output().expect("run");
        (stdout(&run), stderr(&run))
    };
    let colour = |table: &str| table.lines().find(|l| l.starts_with("mean colour")).map(str::to_owned);
    let (rendered, _) = eval(&[]);
    RgbImage::from_pixel(128, 128, Rgb([250, 20, 20])).save(at.join("photo.png")).expect("photo");
    let (taken, _) = eval(&[]);
    assert!(colour(&rendered).is_some() && colour(&rendered) != colour(&taken), "{rendered}{taken}");
    assert_eq!(colour(&eval(&["--environment", "0"]).0), colour(&rendered));
    let (_, complaint) = eval(&["--environment", "0.5"]);
    assert!(complaint.contains("scene.json: cannot be read"), "{complaint}");

    RgbImage::from_pixel(128, 128, Rgb([40, 40, 40])).save(at.join("environment.png")).expect("environment");
    std::fs::write(at.join("scene.json"), "{\"environment_white\": 2.0, \"class\": \"wood\"}")
        .expect("scene");
    let markdown = folder.path("table.md");
    let sweep = folder.path("sweep.csv");
    let files = ["--markdown", markdown.to_str().expect("path"), "--sweep", sweep.to_str().expect("path")];
    let (brighter, complaint) = eval(&[&["--environment", "0.5"], &files[..]].concat());
    assert!(complaint.is_empty() && colour(&brighter) != colour(&rendered), "{complaint}{brighter}");
    let text = std::fs::read_to_string(&markdown).expect("markdown");
    assert!(text.contains("| int8, not refined |") && text.contains("| total (1) |"), "{text}");
    let text = std::fs::read_to_string(&sweep).expect("sweep");
    assert_eq!(text.lines().count(), 10);
    assert!(text.lines().nth(9).is_some_and(|l| l.starts_with("0.80,")), "{text}");
}

#[test]
fn a_broken_material_is_named_and_the_others_counted() {
    let folder = Folder::new();
    data_set(&folder);
    std::fs::remove_file(folder.path("data/metal/plate/normal.png")).expect("remove");
    let mut command = flashmat(["eval", "--size", "128", "--no-refine"]);
    let run = command.arg(folder.path("data")).output().expect("run");
    assert_eq!(run.status.code(), Some(1));
    assert!(stderr(&run).contains("plate: holds no normal map"), "{}", stderr(&run));
    assert!(stdout(&run).contains("1 photos"));
    let run = flashmat(["eval"]).arg(folder.path("data/unknown")).output().expect("run");
    assert!(stderr(&run).contains("holds no materials"), "{}", stderr(&run));
    let run = flashmat(["eval"]).arg(folder.path("nothing")).output().expect("run");
    assert!(stderr(&run).contains("no such file"), "{}", stderr(&run));
}

#[test]
fn bench_times_each_stage() {
    let run = flashmat(["bench", "--runs", "1", "--size", "128", "--level", "scalar", "--threads", "1"]);
    let run = { run }.output().expect("run");
    assert!(run.status.success(), "{}", stderr(&run));
    assert!(stdout(&run).lines().any(|l| l.contains("scalar") && l.contains("MiB")), "{}", stdout(&run));
}
