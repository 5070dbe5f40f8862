//! The error budget of `bake --report`: stages that add up to what `evaluate` measures, held against other files and other
//! commands.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use scene::pictures::write_made_exr;
use scene::{copy_icon72, json_of, light, light_lines, made, name, names_in, number, relight, write_lines};
use serde_json::Value;
use std::fs;
use std::path::Path;

const CROP: &str = "--crop 64x48+160+180";

/// A made capture whose pictures hold the green channel alone.
fn made_grey(count: usize) -> tempfile::TempDir {
    let folder = made(count);
    for i in 0..count {
        let path = folder.path().join("capture").join(name(i));
        let picture = image::open(&path).unwrap().into_rgb8();
        image::GrayImage::from_fn(picture.width(), picture.height(), |x, y| {
            image::Luma([picture.get_pixel(x, y).0[1]])
        })
        .save(path)
        .unwrap();
    }
    folder
}

/// A made capture of linear floats.
fn made_float(count: usize) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let capture = folder.path().join("capture");
    fs::create_dir(&capture).unwrap();
    let exr = |line: String| line.replace(".png", ".exr");
    for i in 0..count {
        write_made_exr(&capture.join(exr(name(i))), light(i, count), None);
    }
    write_lines(&capture.join("lights.lp"), &light_lines(count).into_iter().map(exr).collect::<Vec<_>>());
    folder
}

/// A twelfth part of the real one.
fn icon72() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    copy_icon72(&folder.path().join("capture"), 2);
    folder
}

/// Root mean square errors of all pictures of the capture, as `evaluate` finds them.
fn evaluated(folder: &Path, asset: &str, options: &str) -> Vec<(String, f64)> {
    let found = relight(folder, &format!("evaluate {asset} capture --json {options}")).ok().json();
    let pictures = found["pictures"].as_array().unwrap();
    pictures.iter().map(|p| (p["name"].as_str().unwrap().to_owned(), number(p, "rmse"))).collect()
}

/// The mean squared error over those of `pictures` that `is_judge` takes by their place.
fn mean_square(pictures: &[(String, f64)], is_judge: impl Fn(usize) -> bool) -> f64 {
    let judged: Vec<f64> =
        pictures.iter().enumerate().filter(|(i, _)| is_judge(*i)).map(|(_, (_, rmse))| rmse * rmse).collect();
    judged.iter().sum::<f64>() / judged.len() as f64
}

fn stage(budget: &Value, name: &str) -> f64 {
    let stages = budget["stages"].as_array().unwrap();
    let found = stages.iter().find(|stage| stage["name"] == name);
    number(found.unwrap_or_else(|| panic!("no stage {name} in {stages:?}")), "adds_mse")
}

/// Bakes with a report, holds the budget to `evaluate`, and gives it.
fn checked(folder: &Path, output: &str, bake: &str, pictures: &str, every: usize, stages: &str) -> Value {
    let holdout = if every > 0 { format!("--holdout every:{every}") } else { String::new() };
    relight(folder, &format!("bake capture -o {output} {bake} {pictures} {holdout} --report r.json")).ok();
    let report = json_of(&folder.join("r.json"));
    scene::schema::check("bake", &report);
    let budget = report["error_budget"].clone();
    assert_eq!(scene::strings(&budget["stages"], "name").join(" + "), stages, "{bake}");

    let found = evaluated(folder, output, pictures);
    let is_judge = |i: usize| every == 0 || i % every == every / 2;
    let (total, measured) = (number(&budget, "total_mse"), mean_square(&found, is_judge));
    println!("{bake}: {}", budget["stages"]);
    assert!((total - measured).abs() < 1e-12, "{bake}: {total}, evaluate has {measured}");
    let adds = budget["stages"].as_array().unwrap().iter().map(|stage| number(stage, "adds_mse"));
    assert!((adds.sum::<f64>() - measured).abs() < 1e-12, "{bake}: stages don't add up to {measured}");
    let last = budget["stages"].as_array().unwrap().last().unwrap();
    assert!((number(last, "rmse_after") - measured.sqrt()).abs() < 1e-12);
    assert!((number(&budget, "total_rmse") - measured.sqrt()).abs() < 1e-12);

    // By light: those that judge, in their order, the last figure that of the file.
    let judged: Vec<_> = found.iter().enumerate().filter(|(i, _)| is_judge(*i)).map(|(_, p)| p).collect();
    let lights = budget["lights"].as_array().unwrap();
    assert_eq!(lights.len(), judged.len());
    for (light, (name, rmse)) in lights.iter().zip(&judged) {
        let after = light["mse_after"].as_array().unwrap();
        assert_eq!(light["name"], **name);
        assert_eq!(after.len(), budget["stages"].as_array().unwrap().len() - usize::from(every > 0));
        assert!((after.last().unwrap().as_f64().unwrap() - rmse * rmse).abs() < 1e-12, "{name}");
    }
    let worst = judged.iter().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
    assert_eq!(budget["worst_light"]["name"], worst.0);
    assert!((number(&budget, "worst_light.rmse") - worst.1).abs() < 1e-12);
    assert_eq!(budget["gpu"].is_null(), budget["gpu_missing"].is_string());
    budget
}

const PLAIN: &str = "fit + quantisation";
const HELD_OUT: &str = "fit + held-out + quantisation";

#[test]
fn stages_of_polynomials_in_8_bits_are_the_differences_of_files() {
    let folder = icon72();
    let here = folder.path();
    let budget = checked(here, "a.ktx2", "--basis ptm", CROP, 6, HELD_OUT);
    // Each stage from files of their own: the float bake, which has two, and the 8-bit one.
    let float = checked(here, "f.ktx2", "--basis ptm --precision f32", CROP, 6, "fit + held-out");
    let is_judge = |i: usize| i % 6 == 3;
    let of_float = evaluated(here, "f.ktx2", CROP);
    let (seen, judged) = (mean_square(&of_float, |i| !is_judge(i)), mean_square(&of_float, is_judge));
    let codes = mean_square(&evaluated(here, "a.ktx2", CROP), is_judge);
    for budget in [&budget, &float] {
        assert!((stage(budget, "fit") - seen).abs() < 1e-12);
        assert!((stage(budget, "held-out") - (judged - seen)).abs() < 1e-12);
    }
    assert!((stage(&budget, "quantisation") - (codes - judged)).abs() < 1e-12);
    assert!(codes != judged && seen != judged);
}

#[test]
fn stages_of_blocks_are_the_differences_of_files() {
    let folder = icon72();
    let here = folder.path();
    let basis = "--basis srbf -k 16";
    let stages = "fit + quantisation + block coding";
    let all = |_: usize| true;
    let of = |file: &str, options: &str| {
        relight(here, &format!("bake capture -o {file} {basis} {options} {CROP}")).ok();
        mean_square(&evaluated(here, file, CROP), all)
    };
    let (float, codes) = (of("f.ktx2", "--precision f32"), of("c.ktx2", ""));
    // BC7 has the ranges of 8-bit codes.
    let budget = checked(here, "a.dds", &format!("{basis} --block bc7 --mips"), CROP, 0, stages);
    assert!((stage(&budget, "fit") - float).abs() < 1e-12);
    assert!((stage(&budget, "quantisation") - (codes - float)).abs() < 1e-12);
    assert!(stage(&budget, "block coding") > 0.0);
    // What BC6H holds were halves, signed blocks codes around 0.
    let halves = of("h.ktx2", "--precision f16");
    let budget = checked(here, "a.ktx2", &format!("{basis} --block bc6hs"), CROP, 0, stages);
    let quantisation = stage(&budget, "quantisation");
    assert!((quantisation - (halves - float)).abs() < 1e-12, "{quantisation}, {}", halves - float);
    let budget = checked(here, "s.ktx2", &format!("{basis} --block bc5s"), CROP, 0, stages);
    let quantisation = stage(&budget, "quantisation");
    assert!(quantisation.abs() < 4.0 * (codes - float).abs() + 1e-6, "{quantisation}");
    // Blocks and codes in one asset.
    let options = "--basis ptm --color lrgb --block auto --bits-per-pixel 40";
    checked(here, "m.ktx2", options, CROP, 0, stages);
}

#[test]
fn stages_of_other_files_and_fits_add_up() {
    let folder = icon72();
    let here = folder.path();
    checked(here, "a.exr", "--basis sh -k 9", CROP, 0, PLAIN);
    checked(here, "a.exr", "--basis sh -k 9 --precision f32", CROP, 0, "fit");
    checked(here, "b.ktx2", "--basis pca -k 9 --dither --zstd --split", CROP, 5, HELD_OUT);
    checked(here, "c.ktx2", "--basis hsh -k 9 --planes 7 --color ycc", CROP, 5, HELD_OUT);
    checked(here, "d.ktx2", "--robust", CROP, 0, PLAIN);
    checked(here, "e.ptm", "--color lrgb", CROP, 6, HELD_OUT);
    let budget =
        checked(here, "j.ptm", "--color lrgb --jpeg-quality 60", CROP, 6, &format!("{HELD_OUT} + JPEG"));
    // The same codes as without JPEG.
    let plain = json_of(&{
        relight(
            here,
            &format!("bake capture -o e.ptm --color lrgb {CROP} --holdout every:6 --report e.json"),
        )
        .ok();
        here.join("e.json")
    });
    assert_eq!(stage(&budget, "quantisation"), stage(&plain["error_budget"], "quantisation"));
    checked(here, "f.rti", "--basis hsh -k 9", CROP, 0, PLAIN);
    checked(here, "g.web", "--basis hsh -k 9", CROP, 0, &format!("{PLAIN} + JPEG"));
    checked(here, "h.web", "--basis pca -k 8", CROP, 0, &format!("{PLAIN} + JPEG"));
    let left = names_in(here);
    assert!(left.iter().all(|name| !name.starts_with('.')), "left behind: {left:?}");
}

#[test]
fn stages_of_grey_and_float_pictures_and_of_near_lamps_add_up() {
    let grey = made_grey(14);
    checked(
        grey.path(),
        "a.ktx2",
        "--basis hsh -k 4 --block bc4",
        "",
        4,
        &format!("{HELD_OUT} + block coding"),
    );
    let float = made_float(14);
    checked(float.path(), "a.dds", "--basis hsh -k 4", "", 0, PLAIN);
    checked(float.path(), "b.ktx2", "--basis hsh -k 4 --precision f16", "", 5, HELD_OUT);
    let near = made(14);
    let lamp = |i: usize| {
        let [x, y, z] = light(i, 14).map(|c| 40.0 * c);
        format!("{} {x} {y} {z}", name(i))
    };
    write_lines(&near.path().join("lamps.txt"), &(0..14).map(lamp).collect::<Vec<_>>());
    let pictures = "--near lamps.txt --scale 1 --vignetting 40";
    checked(near.path(), "a.ktx2", "--basis hsh -k 4", pictures, 4, HELD_OUT);
}

/// One grey picture judges: its error is at once the mean absolute one, which `evaluate` draws.
#[test]
fn heat_maps_and_worst_pixels_are_those_of_the_one_picture_that_judges() {
    let folder = made_grey(14);
    let here = folder.path();
    let bake =
        "bake capture/lights.lp -o a.ktx2 --basis hsh -k 4 --block bc1 --holdout every:14 --report r.json";
    fs::create_dir(here.join("maps")).unwrap();
    fs::write(here.join("maps/heatmap-jpeg.png"), "of another asset").unwrap();
    fs::write(here.join("maps/mine.txt"), "stays").unwrap();
    let said = relight(here, &format!("{bake} --heatmaps maps")).ok().stdout;
    let budget = json_of(&here.join("r.json"))["error_budget"].clone();
    let names = ["block-coding", "fit", "held-out", "quantisation"].map(|s| format!("heatmap-{s}.png"));
    let mut names = names.to_vec();
    names.push("mine.txt".to_owned());
    assert_eq!(names_in(&here.join("maps")), names);

    write_lines(&here.join("capture/one.lp"), &light_lines(14)[7..8]);
    let found = relight(here, "evaluate a.ktx2 capture/one.lp --json --heatmap h.png").ok().json();
    let read = |file: &str| image::open(here.join(file)).unwrap().into_rgb8();
    let expected = read("h.png");
    assert!(near(&read("maps/heatmap-block-coding.png"), &expected));
    assert!(!near(&read("maps/heatmap-fit.png"), &expected));
    // Before blocks, and before codes: those of files without. BC1 has coarser steps and so other ranges than codes.
    for (stage, precision, close) in
        [("held-out", "f32", near as fn(&_, &_) -> bool), ("quantisation", "u8", near_on_the_whole)]
    {
        let bake = "bake capture/lights.lp -o b.ktx2 --basis hsh -k 4 --holdout every:14";
        relight(here, &format!("{bake} --precision {precision}")).ok();
        relight(here, "evaluate b.ktx2 capture/one.lp --heatmap b.png").ok();
        assert!(close(&read(&format!("maps/heatmap-{stage}.png")), &read("b.png")), "{stage}");
    }
    let worst = &budget["worst_pixels"][0];
    let picture = &found["pictures"][0];
    assert_eq!((&worst["x"], &worst["y"]), (&picture["worst_pixel"][0], &picture["worst_pixel"][1]));
    assert!((number(worst, "rmse") - number(picture, "max")).abs() < 1e-6);

    let total = number(&budget, "total_mse");
    for words in [
        "error budget (mean squared): fit ".to_owned(),
        format!(" = {total:.2e} (root {:.4}), of the file over 1 left-out pictures", total.sqrt()),
        format!(
            "worst light {}, RMSE {:.4}; worst pixel {}, {}, RMSE",
            name(7),
            total.sqrt(),
            worst["x"],
            worst["y"]
        ),
    ] {
        assert!(said.contains(&words), "no '{words}' in\n{said}");
    }
}

/// Whether no samples of pictures differ by more than a code.
fn near(a: &image::RgbImage, b: &image::RgbImage) -> bool {
    a.dimensions() == b.dimensions() && a.iter().zip(b.iter()).all(|(a, b)| a.abs_diff(*b) <= 1)
}

/// Whether pictures differ by 4 codes a sample in the mean at most.
fn near_on_the_whole(a: &image::RgbImage, b: &image::RgbImage) -> bool {
    let differences: u64 = a.iter().zip(b.iter()).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
    a.dimensions() == b.dimensions() && differences <= 4 * a.len() as u64
}

#[test]
fn a_report_changes_no_byte_of_the_asset() {
    let folder = icon72();
    let here = folder.path();
    for options in
        ["a.ktx2 --block bc1 --mips --split", "a.exr", "a.ptm --jpeg-quality 80", "a.dds --basis pca -k 5"]
    {
        for (place, report) in [("with", "--report r.json"), ("without", "")] {
            fs::create_dir(here.join(place)).unwrap();
            relight(here, &format!("bake capture {CROP} {report} -o {place}/{options}")).ok();
        }
        let [with, without] = ["with", "without"].map(|place| {
            let files = names_in(&here.join(place));
            let bytes = |name: &String| fs::read(here.join(place).join(name)).unwrap();
            let bytes: Vec<_> = files.iter().map(bytes).collect();
            fs::remove_dir_all(here.join(place)).unwrap();
            (files, bytes)
        });
        assert!(with == without, "{options}: {:?}, {:?}", with.0, without.0);
    }
}

#[test]
fn heat_maps_need_a_report_and_a_folder_and_spare_what_is_read() {
    let folder = made(9);
    let here = folder.path();
    let bake = "bake capture -o a.ktx2 --basis hsh -k 4";
    relight(here, &format!("{bake} --heatmaps maps"))
        .assert_refused(2, &["--heatmaps maps", "--report", "give that too"]);
    fs::write(here.join("maps"), "a file").unwrap();
    relight(here, &format!("{bake} --report r.json --heatmaps maps"))
        .assert_refused(2, &["--heatmaps maps", "is a file", "name a folder"]);
    let lines: Vec<String> =
        light_lines(9).into_iter().map(|line| line.replace("p00.png", "heatmap-fit.png")).collect();
    fs::rename(here.join("capture/p00.png"), here.join("capture/heatmap-fit.png")).unwrap();
    write_lines(&here.join("capture/lights.lp"), &lines);
    relight(here, &format!("{bake} --report r.json --heatmaps capture"))
        .assert_refused(2, &["capture/heatmap-fit.png", "another file of this command"]);
    assert_eq!(names_in(here), ["capture", "maps"]);
}

#[test]
fn a_bake_of_little_memory_goes_without_a_budget_and_says_so() {
    let folder = icon72();
    let here = folder.path();
    // 64 functions of three channels at 402 x 395 pixels are 117 MiB.
    let line = "bake capture -o a.ktx2 --basis srbf -k 64 --memory 100M --report r.json --holdout every:9";
    let run = relight(here, line).ok();
    let words = "no error budget: the coefficients as floats take 117 MiB, --memory allows 100";
    assert!(run.stderr.contains(words), "{}", run.stderr);
    let report = json_of(&here.join("r.json"));
    scene::schema::check("bake", &report);
    assert!(report["error_budget"].is_null());
    assert!(number(&report, "holdout.mean.rmse") > 0.0, "the left-out pictures judge all the same");
    assert!(report["notes"].as_array().unwrap().iter().any(|note| note == words));
}
