//! Captures and command lines that can't be meant: one sentence, the right exit code, and every
//! file as it was before.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use scene::pictures::{write_made, write_made_exr};
use scene::{light, light_lines, made, name, relight, relight_words, snapshot, write_lines};
use std::fs;
use std::path::Path;

/// A made capture and an older asset in `out`, which no failure may touch.
fn folder() -> tempfile::TempDir {
    let folder = made(12);
    fs::create_dir(folder.path().join("out")).unwrap();
    for name in ["a.ktx2", "a.exr", "a.ptm", "a.png", "a.json"] {
        fs::write(folder.path().join("out").join(name), "older").unwrap();
    }
    folder
}

/// Runs `line` and fails unless it is refused so and no file below `folder` changed.
#[track_caller]
fn assert_refused(folder: &Path, line: &str, code: i32, words: &[&str]) {
    let before = snapshot(folder);
    relight(folder, line).assert_refused(code, words);
    let after = snapshot(folder);
    let changed: Vec<_> =
        before.keys().chain(after.keys()).filter(|p| before.get(*p) != after.get(*p)).collect();
    assert!(changed.is_empty(), "relight {line} changed {changed:?}");
}

/// Refuses to bake `capture` after `damage` was done to it.
#[track_caller]
fn assert_capture_refused(damage: impl FnOnce(&Path), code: i32, words: &[&str]) {
    let folder = folder();
    damage(&folder.path().join("capture"));
    for output in ["out/a.ktx2", "out/a.exr", "out/a.ptm"] {
        assert_refused(folder.path(), &format!("bake capture -o {output} --report out/a.json"), code, words);
    }
    relight_words(folder.path(), &["bake", "capture", "-o", "out/b.ktx2"]).assert_refused(code, words);
}

#[test]
fn damaged_pictures_are_named() {
    let cut = |path: &Path, keep: usize| fs::write(path, &fs::read(path).unwrap()[..keep]).unwrap();
    assert_capture_refused(|capture| cut(&capture.join(name(4)), 300), 3, &["p04.png"]);
    assert_capture_refused(|capture| cut(&capture.join(name(4)), 0), 3, &["p04.png"]);
    assert_capture_refused(|capture| fs::write(capture.join(name(4)), "GIF89a").unwrap(), 3, &["p04.png"]);
    let folder = tempfile::tempdir().unwrap();
    scene::copy_icon72(&folder.path().join("capture"), 1);
    cut(&folder.path().join("capture/image05.jpg"), 9000);
    assert_refused(
        folder.path(),
        "bake capture -o a.ktx2",
        3,
        &["image05.jpg", "truncated", "copy it again"],
    );
}

#[test]
fn a_missing_picture_is_named_with_its_line_and_a_similar_one() {
    let missing = |capture: &Path| fs::rename(capture.join(name(4)), capture.join("q04.png")).unwrap();
    let words =
        ["lights.lp", "1 of 12 pictures", "line 6: 'p04.png'", "similar: 'q04.png'", "correct the names"];
    assert_capture_refused(missing, 3, &words);
}

#[test]
fn light_files_that_say_nothing_or_nonsense_are_refused_by_line() {
    let lines = |change: fn(&mut Vec<String>)| {
        move |capture: &Path| {
            let mut lines = light_lines(12);
            change(&mut lines);
            write_lines(&capture.join("lights.lp"), &lines);
        }
    };
    assert_capture_refused(lines(Vec::clear), 3, &["lights.lp", "lists no light", "name x y z"]);
    assert_capture_refused(
        lines(|lines| lines[2] = "p02.png 0.1 nan 1".to_owned()),
        3,
        &["lights.lp", "line 4", "'p02.png'", "not finite", "give finite numbers"],
    );
    assert_capture_refused(
        lines(|lines| lines[2] = "p02.png 0 0 0".to_owned()),
        3,
        &["line 4", "(0, 0, 0)", "points nowhere"],
    );
    assert_capture_refused(
        lines(|lines| lines[2] = "p02.png 0.1 0.2".to_owned()),
        3,
        &["line 4", "2 numbers where 3 are needed"],
    );
    assert_capture_refused(lines(|lines| lines[3] = lines[2].clone()), 3, &["lights.lp", "p02.png", "line"]);
    assert_capture_refused(|capture| fs::write(capture.join("lights.lp"), [0, 1, 2]).unwrap(), 3, &["UTF-8"]);
}

#[test]
fn folders_without_one_light_file_are_refused() {
    assert_capture_refused(
        |capture| fs::remove_file(capture.join("lights.lp")).unwrap(),
        3,
        &["capture", "holds no .lp file", "give its path"],
    );
    assert_capture_refused(
        |capture| fs::copy(capture.join("lights.lp"), capture.join("b.LP")).map(|_| ()).unwrap(),
        3,
        &["2 .lp files (b.LP, lights.lp)", "give the path"],
    );
    let empty = |capture: &Path| {
        fs::remove_dir_all(capture).unwrap();
        fs::create_dir(capture).unwrap();
    };
    assert_capture_refused(empty, 3, &["holds no .lp file"]);
    assert_capture_refused(|capture| fs::remove_dir_all(capture).unwrap(), 4, &["capture", "No such file"]);
}

#[test]
fn pictures_that_do_not_go_together_are_refused() {
    assert_capture_refused(
        |capture| write_made(&capture.join(name(7)), light(7, 12), 20, 16),
        3,
        &["p07.png", "20 x 16", "p00.png is 24 x 16", "crop or rescale"],
    );
    let mixed = |capture: &Path| {
        fs::remove_file(capture.join(name(7))).unwrap();
        write_made_exr(&capture.join("p07.exr"), light(7, 12), None);
    };
    assert_capture_refused(mixed, 3, &["p07.exr", "floats", "p00.png", "convert"]);
}

#[test]
fn a_pixel_that_is_no_number_is_named() {
    let bad = |capture: &Path| {
        for i in 0..12 {
            fs::remove_file(capture.join(name(i))).unwrap();
            let path = capture.join(name(i)).with_extension("exr");
            write_made_exr(&path, light(i, 12), (i == 5).then_some((17, 3)));
        }
    };
    let folder = folder();
    bad(&folder.path().join("capture"));
    for output in ["out/a.ktx2", "out/a.exr"] {
        let words = ["p05.exr", "17", "3"];
        assert_refused(folder.path(), &format!("bake capture -o {output} --precision f16"), 3, &words);
    }
}

#[test]
fn sizes_and_options_that_a_basis_lacks_are_refused_with_those_it_has() {
    let folder = folder();
    for (options, words) in [
        ("--basis rbf", &["'rbf'", "ptm, sh, hsh, srbf"][..]),
        ("-k six", &["'six'", "whole number"]),
        ("-k -6", &["'-6'", "whole number"]),
        ("-k 7", &["ptm", "7 functions", "6, 10, 15"]),
        ("--basis hsh -k 10", &["hsh", "10 functions", "1, 4, 9, 16"]),
        ("--basis srbf -k 129", &["any from 1 to 128"]),
        ("--order 2", &["ptm takes no --order", "-k or --degree"]),
        ("--basis srbf --degree 2", &["srbf takes no --degree", "use -k"]),
        ("--spread 1", &["--spread", "srbf", "ptm has no such choice"]),
        ("--basis srbf --spread 11", &["--spread", "0.1 to 10"]),
        ("-k 9 --order 2 --basis sh", &["--k", "cannot be used with", "--order"]),
        ("--ridge -1", &["--ridge", "'-1'", "0 to 1"]),
        ("--color grey", &["'grey'", "rgb, lrgb"]),
        ("--holdout every:1", &["'1'", "every:N"]),
        ("--holdout half", &["'half'", "every:N", "random:N"]),
        ("--holdout every:40", &["12 of 12 pictures to fit and 0 to judge by"]),
        ("--holdout random:12", &["0 of 12 pictures to fit"]),
        ("--holdout capture/lights.lp", &["0 of 12 pictures to fit"]),
        ("-j 0", &["'0'", "1..=1024"]),
        ("--memory lots", &["'lots'", "800M"]),
        ("--memory 1k", &["1k", "1M..1024T"]),
    ] {
        assert_refused(folder.path(), &format!("bake capture -o out/a.ktx2 {options}"), 2, words);
    }
    assert_refused(folder.path(), "bake capture -o out/a.ktx2 --holdout none.lp", 4, &["none.lp"]);
    assert_refused(folder.path(), "bake capture -o out/a.ktx2 --memory 1M", 5, &["1 MiB", "raise --memory"]);
    assert_refused(folder.path(), "bake capture -o out/a.ktx2 --cpu mmx", 2, &["'mmx'", "baseline"]);
}

#[test]
fn targets_that_can_not_be_written_are_refused() {
    let folder = folder();
    let here = folder.path();
    fs::create_dir(here.join("out/folder.ktx2")).unwrap();
    for (target, code, words) in [
        ("none/a.ktx2", 4, &["none/a.ktx2", "there is no folder none"][..]),
        // Stands for a folder without permission, which root does not know.
        ("out/a.png/a.ktx2", 4, &["out/a.png/a.ktx2", "there is no folder"]),
        ("out/folder.ktx2", 2, &["out/folder.ktx2", "is a folder", "name a file"]),
        ("out/a.tga", 2, &["out/a.tga", ".ktx2, .dds, .exr, .ptm"]),
        ("out/a", 2, &["out/a", ".ktx2, .dds, .exr, .ptm"]),
        // What stands there is no file of an asset.
        ("out/a.dds", 2, &["out/a.json", "no part", "another name"]),
        ("out/a.ktx2 --block bc8", 2, &["none, auto or a format", "bc7"]),
        ("out/a.ktx2 --block bc7 --precision f16", 2, &["--precision f16 and --block exclude"]),
        ("out/a.ktx2 --bits-per-pixel 8", 2, &["--bits-per-pixel belongs to --block auto"]),
        ("out/a.ktx2 --block auto --bits-per-pixel 1", 5, &["--bits-per-pixel"]),
        ("out/a.ptm --block bc1", 2, &["out/a.ptm", "bc1"]),
        ("out/a.exr --mips", 2, &["out/a.exr"]),
        ("out/a.dds --zstd", 2, &["out/a.dds"]),
        ("out/a.ktx2 --zstd=20", 2, &["--zstd", "1..=19"]),
        ("out/a.ptm --basis hsh", 2, &["out/a.ptm", "ptm with 6 functions, not hsh with 9", "--basis ptm"]),
        ("out/a.ptm -k 10", 2, &["out/a.ptm", "not ptm with 10"]),
        ("out/a.ptm --precision f16", 2, &["out/a.ptm", "u8", "not f16"]),
        ("out/a.exr --precision u8", 2, &["out/a.exr", "f16 or f32, not u8"]),
        ("out/a.ktx2 --report none/a.json", 4, &["none/a.json", "there is no folder none"]),
    ] {
        assert_refused(here, &format!("bake capture -o {target}"), code, words);
    }
    // They are refused before the work, not after it: a damaged picture is not met.
    fs::write(
        here.join("capture").join(name(4)),
        &fs::read(here.join("capture").join(name(4))).unwrap()[..300],
    )
    .unwrap();
    assert_refused(here, "bake capture -o none/a.ktx2", 4, &["none"]);
    assert_refused(here, "bake capture -o out/a.ktx2 --report none/a.json", 4, &["none"]);
}

#[test]
fn renderings_that_can_not_be_made_are_refused() {
    let folder = folder();
    let here = folder.path();
    relight(here, "bake capture -o a.ktx2").ok();
    for (line, code, words) in [
        ("a.ktx2 -o out/a.png", 2, &["no light", "--light X,Y,Z", "--angles", "--lights"][..]),
        ("a.ktx2 -o out/a.exr --light 0,0,1 --depth 16", 2, &["out/a.exr", "half and float"]),
        ("a.ktx2 -o out/a.png --light 0,0,1 --depth half", 2, &["out/a.png", "8 and 16"]),
        ("a.ktx2 -o out/a.jpg --light 0,0,1", 2, &["out/a.jpg", ".png or .exr"]),
        ("a.ktx2 -o out/a.png --light 0,0,0", 2, &["(0, 0, 0)", "points nowhere"]),
        ("a.ktx2 -o out/a.png --light 0,0", 2, &["2 numbers where 3"]),
        ("a.ktx2 -o out/a.png --light 0,0,1,1,1,-1", 2, &["colour", "0..1e6"]),
        ("a.ktx2 -o out/a.png --light 0,0,1 --lights capture/lights.lp", 2, &["cannot be used with"]),
        ("a.ktx2 -o none/a.png --light 0,0,1", 4, &["none/a.png", "there is no folder none"]),
        ("a.ktx2 -o out/a.png --lights capture/lights.lp", 4, &["out/a.png"]),
        ("a.ktx2 -o out --lights none.lp", 4, &["none.lp"]),
        ("none.ktx2 -o out/a.png --light 0,0,1", 4, &["none.ktx2"]),
        ("out/a.ktx2 -o out/a.png --light 0,0,1", 3, &["out/a.ktx2", "no asset", ".ktx2, .dds, .exr, .ptm"]),
        ("capture/p00.png -o out/a.png --light 0,0,1", 3, &["p00.png", "no asset"]),
    ] {
        assert_refused(here, &format!("render {line}"), code, words);
    }
    let whole = fs::read(here.join("a.ktx2")).unwrap();
    fs::write(here.join("cut.ktx2"), &whole[..whole.len() - 5]).unwrap();
    assert_refused(here, "render cut.ktx2 -o out/a.png --light 0,0,1", 3, &["cut.ktx2"]);
    assert_refused(here, "info cut.ktx2", 3, &["cut.ktx2"]);
}

#[test]
fn evaluations_that_make_no_sense_are_refused() {
    let folder = folder();
    let here = folder.path();
    relight(here, "bake capture -o a.ktx2").ok();
    fs::create_dir(here.join("wide")).unwrap();
    for i in 0..3 {
        write_made(&here.join("wide").join(name(i)), light(i, 12), 25, 16);
    }
    write_lines(&here.join("wide/lights.lp"), &light_lines(12)[..3]);
    let words = ["a.ktx2 is 24 x 16", "wide/lights.lp are 25 x 16", "compare pictures of one size"];
    assert_refused(here, "evaluate a.ktx2 wide --heatmap out/a.png", 3, &words);
    assert_refused(here, "evaluate a.ktx2 out", 3, &["out", "no .lp file"]);
    assert_refused(here, "evaluate capture/p00.png capture", 3, &["p00.png", "no asset"]);
    assert_refused(here, "evaluate a.ktx2 capture --heatmap none/h.png", 4, &["none/h.png", "no folder"]);
    // A heat map is a PNG: another name would lie about the bytes.
    assert_refused(here, "evaluate a.ktx2 capture --heatmap out/h.jpg", 2, &["out/h.jpg", ".png"]);
    assert_refused(here, "evaluate a.ktx2 capture --heatmap out/a.exr", 2, &["out/a.exr", ".png"]);
    assert_refused(here, "info out/a.json", 3, &["out/a.json", "JPEG, PNG"]);
    assert_refused(here, "info none", 4, &["none"]);
}

#[test]
fn light_files_of_the_wild_are_read() {
    let folder = made(12);
    let here = folder.path();
    relight(here, "bake capture -o a.ktx2").ok();
    let lines = light_lines(12);
    // Decimal commas, Windows paths in capitals, CRLF, tabs and a wrong count.
    let wild: Vec<String> = lines
        .iter()
        .map(|line| {
            let (name, vector) = line.split_once(' ').unwrap();
            format!(
                "H:\\RTI Data\\{}\t{} \r",
                name.to_uppercase(),
                vector.replace('.', ",").replace(' ', "\t")
            )
        })
        .collect();
    fs::write(here.join("capture/lights.lp"), format!("13\r\n{}\n", wild.join("\n"))).unwrap();
    let ran = relight(here, "bake capture -o b.ktx2").ok();
    assert!(ran.stderr.contains("says 13 pictures, 12 lines follow"), "{}", ran.stderr);
    assert!(fs::read(here.join("a.ktx2")).unwrap() == fs::read(here.join("b.ktx2")).unwrap());
}
