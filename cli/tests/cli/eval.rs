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
    for part in ["wood", "metal", "all", "plain guess", "2 materials"] {
        assert!(table.contains(part), "{part}: {table}");
    }
    let text = std::fs::read_to_string(&csv).expect("csv");
    let rows: Vec<Vec<&str>> = text.lines().map(|l| l.split(',').collect()).collect();
    assert_eq!(rows.len(), 3);
    assert!(rows.iter().all(|r| r.len() == rows[0].len()), "{text}");
    // The truth is flat and half rough: the plain guess has next to no error there.
    let guess = |row: usize, column: &str| -> f64 {
        let at = rows[0].iter().position(|c| *c == column).expect(column);
        rows[row][at].parse().expect("number")
    };
    assert!(guess(1, "guess_normal_mse_paper") < 1e-4 && guess(1, "guess_roughness_mse_paper") < 1e-4);

    let mut command = flashmat(["eval", "--size", "128", "--no-refine", "--split", "test"]);
    let run = command.arg(folder.path("data")).output().expect("run");
    assert!(stdout(&run).contains("1 materials") && !stdout(&run).contains("metal "), "{}", stdout(&run));
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
    assert!(stdout(&run).contains("1 materials"));
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
