//! What photos are called never decides where results go or whose result is lost.

use crate::common::{FILES, Folder, capture, flashmat, names, photo, report, stderr};
use image::imageops;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

fn read(path: PathBuf) -> Vec<u8> {
    std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// A photo of these bytes under another name.
fn named(folder: &Folder, name: impl AsRef<Path>) -> PathBuf {
    let path = folder.path("photos").join(name);
    std::fs::create_dir_all(path.parent().expect("parent")).expect("folder");
    photo(160, 144).save_with_format(&path, image::ImageFormat::Png).expect("save");
    path
}

fn run(photos: &[&Path], out: &Path) {
    let run = capture(photos, out, &["--no-refine"]);
    assert!(run.status.success(), "{}", stderr(&run));
}

#[test]
fn a_stem_of_dots_does_not_leave_the_folder() {
    let folder = Folder::new();
    let out = folder.path("in/out");
    let mine = folder.file("report.json", b"mine");
    for name in ["...jpg", "..jpg", "...", "....", ". .jpg", ".. .jpg"] {
        run(&[&named(&folder, name)], &out);
    }
    assert_eq!(names(&folder.path("")), ["in", "photos", "report.json"]);
    assert_eq!(names(&folder.path("in")), ["out"]);
    assert_eq!(read(mine), b"mine");
    // One photo, whatever it is called: one result.
    assert_eq!(names(&out), ["photo"]);
    assert_eq!(names(&out.join("photo")), FILES);
}

#[cfg(unix)]
#[test]
fn odd_names_get_safe_folders() {
    use std::os::unix::ffi::OsStringExt;
    let folder = Folder::new();
    let long = "l".repeat(250);
    let cases = [
        (OsString::from("con.png"), "_con"),
        ("end. .png".into(), "end"),
        ("a:b?.png".into(), "a_b_"),
        (".flashmat-x.part.png".into(), "_.flashmat-x.part"),
        ("Küche 木.png".into(), "Küche 木"),
        (format!("{long}.png").into(), &long[..240]),
        (OsString::from_vec(b"caf\xe9.png".to_vec()), "caf_"),
    ];
    for (i, (name, wanted)) in cases.into_iter().enumerate() {
        let out = folder.path(&format!("out{i}"));
        run(&[&named(&folder, &name)], &out);
        assert_eq!(names(&out), [wanted]);
        assert_eq!(names(&out.join(wanted)), FILES);
    }
}

/// Different photos, one name to some file system: in one run and in two.
#[test]
fn names_that_differ_by_case_or_bad_bytes_get_folders_of_their_own() {
    let folder = Folder::new();
    let lower = named(&folder, "a/case.png");
    let upper = folder.path("photos/b/CASE.PNG");
    std::fs::create_dir_all(folder.path("photos/b")).expect("folder");
    imageops::rotate90(&photo(144, 160)).save(&upper).expect("save");
    let out = folder.path("out");
    run(&[&lower, &upper], &out);
    assert_eq!(names(&out), ["CASE-2", "case"]);
    let out = folder.path("two");
    run(&[&lower], &out);
    run(&[&upper], &out);
    assert_eq!(names(&out), ["CASE-2", "case"]);
    run(&[&upper, &lower], &out);
    assert_eq!(names(&out), ["CASE-2", "case"], "each knows its own");
    #[cfg(unix)]
    {
        use std::os::unix::ffi::OsStringExt;
        let one = named(&folder, OsString::from_vec(b"n\xe9.png".to_vec()));
        let other = folder.path("photos").join(OsString::from_vec(b"n\xe8.png".to_vec()));
        std::fs::copy(&upper, &other).expect("copy");
        let out = folder.path("three");
        run(&[&one], &out);
        run(&[&other], &out);
        assert_eq!(names(&out), ["n_", "n_-2"]);
    }
}

#[test]
fn another_photo_s_result_is_never_replaced() {
    let folder = Folder::new();
    let out = folder.path("out");
    let one = named(&folder, "a/x.png");
    let other = folder.path("photos/b/x.png");
    std::fs::create_dir_all(folder.path("photos/b")).expect("folder");
    imageops::flip_horizontal(&photo(150, 144)).save(&other).expect("save");
    run(&[&one, &other], &out);
    let first = read(out.join("x/albedo.png"));
    let second = read(out.join("x-2/albedo.png"));
    assert_ne!(first, second);
    // The second alone, again: its own result is replaced, and the user hears why it is not in x.
    std::fs::write(out.join("x-2/albedo.png"), "old").expect("write");
    let again = capture(&[&other], &out, &["--no-refine"]);
    let line = stderr(&again);
    assert!(line.lines().count() == 1 && line.contains("out/x holds the result of"), "{line}");
    assert_eq!((read(out.join("x/albedo.png")), read(out.join("x-2/albedo.png"))), (first.clone(), second));
    assert_eq!(names(&out), ["x", "x-2"]);
    // The same photo from elsewhere has the same result; an edited one has not.
    let moved = folder.path("photos/c/x.png");
    std::fs::create_dir_all(folder.path("photos/c")).expect("folder");
    std::fs::copy(&one, &moved).expect("copy");
    run(&[&moved], &out);
    assert_eq!(names(&out), ["x", "x-2"]);
    assert_eq!(report(&out.join("x")).expect("report")["photo"]["path"], moved.display().to_string());
    photo(160, 150).save(&one).expect("save");
    run(&[&one], &out);
    assert_eq!(names(&out), ["x", "x-2", "x-3"]);
    assert_eq!(read(out.join("x/albedo.png")), first);
}

/// Ground truth of the same name, in a folder that was given as the results' by mistake.
#[test]
fn maps_without_a_report_are_not_overwritten() {
    let folder = Folder::new();
    let out = folder.path("data");
    let planks = named(&folder, "planks.png");
    std::fs::create_dir_all(out.join("planks")).expect("folder");
    let truth = folder.file("data/planks/albedo.png", b"truth");
    run(&[&planks], &out);
    assert_eq!(read(truth), b"truth");
    assert_eq!(names(&out), ["planks", "planks-2"]);
    // A folder with other things is free.
    std::fs::create_dir_all(folder.path("free/planks")).expect("folder");
    folder.file("free/planks/notes.txt", b"mine");
    run(&[&planks], &folder.path("free"));
    assert_eq!(names(&folder.path("free")), ["planks"]);
    assert_eq!(names(&folder.path("free/planks")).len(), FILES.len() + 1);
}

/// Two programs, two photos of one name, one folder: both results are there.
#[test]
fn two_programs_with_one_name_keep_both_results() {
    let folder = Folder::new();
    let one = named(&folder, "a/x.png");
    let other = folder.path("photos/b/x.png");
    std::fs::create_dir_all(folder.path("photos/b")).expect("folder");
    imageops::flip_horizontal(&photo(150, 144)).save(&other).expect("save");
    for round in 0..3 {
        let out = folder.path(&format!("out{round}"));
        let start = |photo: &Path| {
            let mut command =
                flashmat(["capture", "--size", "128", "--threads", "1", "--no-refine", "-q", "--out"]);
            command.arg(&out).arg(photo).spawn().expect("start")
        };
        for mut child in [start(&one), start(&other)] {
            assert!(child.wait().expect("end").success());
        }
        assert_eq!(names(&out), ["x", "x-2"]);
        let mut paths =
            ["x", "x-2"].map(|n| report(&out.join(n)).expect("report")["photo"]["path"].to_string());
        paths.sort();
        assert_ne!(paths[0], paths[1]);
    }
}
