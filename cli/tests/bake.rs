//! bake, render and evaluate, end to end.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use relight_core::basis::FAMILIES;
use scene::pictures::{encoded, psnr, read_exr, read_png};
use scene::{icon72, json_of, made, name, number, relight, relight_words, strings, write_lines};
use serde_json::Value;
use std::fs;

/// Mean PSNR that `evaluate --json` gives.
fn mean_psnr(evaluation: &Value) -> f64 {
    number(evaluation, "mean.psnr")
}

#[test]
fn every_basis_is_baked_rendered_and_judged_alike() {
    let folder = made(20);
    let here = folder.path();
    // dB on all pictures that were fitted; Lambert's law has a kink that smooth functions round off.
    let least = [("ptm", 28.0), ("sh", 38.0), ("hsh", 36.0), ("srbf", 34.0), ("pca", 36.0)];
    let photograph = read_png(&here.join("capture").join(name(13))).0.samples;
    let [x, y, z] = scene::light(13, 20);
    for family in &FAMILIES {
        let basis = family.name;
        relight(here, &format!("bake capture -o {basis}.ktx2 --basis {basis} --precision f32")).ok();
        relight(here, &format!("render {basis}.ktx2 -o {basis}.png --depth 16 --light {x:.6},{y:.6},{z:.6}"))
            .ok();
        let judged = relight(here, &format!("evaluate {basis}.ktx2 capture --json")).ok().json();
        let (_, least) = least.iter().find(|(name, _)| *name == basis).expect("a bound for the new basis");
        assert!(mean_psnr(&judged) > *least, "{basis}: {} dB", mean_psnr(&judged));
        // What evaluate says of a picture is what its rendering shows.
        let rendered = psnr(&read_png(&here.join(format!("{basis}.png"))).0.samples, &photograph);
        let said = number(&judged["pictures"][13], "psnr");
        assert!((rendered - said).abs() < 0.01, "{basis}: {rendered} dB rendered, {said} dB evaluated");
        let info = relight(here, &format!("info {basis}.ktx2 --json")).ok().json();
        assert!(info["basis"].as_str().unwrap().starts_with(&format!("{basis}, ")), "{info}");
        assert_eq!((&info["size"], &info["lights"]), (&"24 x 16".into(), &"20".into()));
    }
}

#[test]
fn a_real_capture_is_predicted_as_well_as_promised() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let input = icon72();
    let held_out = |options: &str, file: &str| {
        let words: Vec<_> = ["bake", input.to_str().unwrap(), "-o", file]
            .into_iter()
            .chain("--report r.json --holdout every:6".split(' '))
            .chain(options.split(' '))
            .collect();
        let printed = relight_words(here, &words).ok().stdout;
        let mean = mean_psnr(&json_of(&here.join("r.json"))["holdout"]);
        assert!(printed.contains(&format!("held out, 12 pictures: mean PSNR {mean:.2} dB")), "{printed}");
        mean
    };
    for (basis, least) in [("ptm -k 6", 25.2), ("ptm -k 15", 27.6), ("hsh -k 16", 27.6), ("srbf -k 25", 28.0)]
    {
        let whole = held_out(&format!("--basis {basis} --precision f32"), "f32.ktx2");
        assert!(whole >= least, "{basis} in f32: {whole} dB");
        let bytes = held_out(&format!("--basis {basis}"), "u8.ktx2");
        assert!((bytes - whole).abs() < 0.1, "{basis}: {bytes} dB in u8, {whole} dB in f32");
        // The bytes are a quarter of the floats, so u8 was not quietly kept in floats.
        let size = |name: &str| fs::metadata(here.join(name)).unwrap().len();
        assert!(size("f32.ktx2") > 39 * size("u8.ktx2") / 10);
    }
}

#[test]
fn the_pictures_held_out_are_every_sixth_from_the_fourth() {
    let folder = made(20);
    let here = folder.path();
    relight(here, "bake capture -o a.ktx2 --basis hsh -k 4 --holdout every:6 --report r.json").ok();
    let report = json_of(&here.join("r.json"));
    assert_eq!(strings(&report["holdout"]["pictures"], "name"), [name(3), name(9), name(15)]);
    let fitted: Vec<_> = (0..20).filter(|i| ![3, 9, 15].contains(i)).map(name).collect();
    assert_eq!(strings(&report["lights"], "name"), fitted);
    assert_eq!(relight(here, "info a.ktx2 --json").ok().json()["lights"], "17");

    // The same asset comes of a capture that lacks them, and of their light file as the hold-out.
    let lines = scene::light_lines(20);
    let capture = here.join("capture");
    let rest = here.join("rest");
    fs::create_dir(&rest).unwrap();
    let is_out = |line: &&String| [3, 9, 15].iter().any(|&i| line.starts_with(&name(i)));
    let kept: Vec<String> = lines.iter().filter(|line| !is_out(line)).cloned().collect();
    for i in 0..20 {
        fs::copy(capture.join(name(i)), rest.join(name(i))).unwrap();
    }
    write_lines(&rest.join("kept.lp"), &kept);
    write_lines(&rest.join("out.lp"), &lines.iter().filter(is_out).cloned().collect::<Vec<_>>());
    write_lines(&rest.join("all.lp"), &lines);
    relight(here, "bake rest/kept.lp -o b.ktx2 --basis hsh -k 4").ok();
    relight(here, "bake rest/all.lp -o c.ktx2 --basis hsh -k 4 --holdout rest/out.lp --report c.json").ok();
    let bytes = |name: &str| fs::read(here.join(name)).unwrap();
    assert!(bytes("a.ktx2") == bytes("b.ktx2") && bytes("a.ktx2") == bytes("c.ktx2"));
    assert_eq!(json_of(&here.join("c.json"))["holdout"], report["holdout"]);
    // And evaluating it against them says what the report says.
    assert_eq!(relight(here, "evaluate a.ktx2 rest/out.lp --json").ok().json(), report["holdout"]);
}

#[test]
fn evaluations_have_figures_for_each_picture_their_mean_and_the_worst() {
    let folder = made(20);
    let here = folder.path();
    relight(here, "bake capture -o a.ktx2").ok();
    let judged = relight(here, "evaluate a.ktx2 capture --json --heatmap heat.png").ok().json();
    assert_eq!(judged["values"], "encoded");
    let pictures = judged["pictures"].as_array().unwrap();
    assert_eq!(strings(&judged["pictures"], "name"), (0..20).map(name).collect::<Vec<_>>());
    for key in ["psnr", "rmse", "max", "saturation_shift"] {
        let mean = pictures.iter().map(|picture| number(picture, key)).sum::<f64>() / 20.0;
        assert!((mean - number(&judged["mean"], key)).abs() < 1e-12, "{key}");
    }
    assert!(pictures.iter().all(|p| p["mean_shift"].as_array().unwrap().len() == 3));
    let worst = pictures.iter().min_by(|a, b| number(a, "psnr").total_cmp(&number(b, "psnr"))).unwrap();
    assert_eq!(&judged["worst"], worst);
    let (x, y) = (worst["worst_pixel"][0].as_u64().unwrap(), worst["worst_pixel"][1].as_u64().unwrap());
    assert!(x < 24 && y < 16);
    let (heat, _) = read_png(&here.join("heat.png"));
    assert_eq!((heat.width, heat.height), (24, 16));
    assert!(heat.samples.iter().any(|value| *value > 0.1), "a heat map without heat");

    // The table says the same, one line a picture.
    let table = relight(here, "evaluate a.ktx2 capture").ok().stdout;
    let mean = format!("{:7.2}  {:.4}", mean_psnr(&judged), number(&judged, "mean.rmse"));
    let has = |start: &str, end: &str| table.lines().any(|l| l.starts_with(start) && l.ends_with(end));
    assert!(has(&mean, "mean of 20"), "no {mean} in\n{table}");
    for picture in pictures {
        assert!(has(&format!("{:7.2}", number(picture, "psnr")), picture["name"].as_str().unwrap()));
    }
}

#[test]
fn float_pictures_are_fitted_linear_and_judged_on_both_scales() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    fs::create_dir(here.join("capture")).unwrap();
    let mut lines = scene::light_lines(20);
    for (i, line) in lines.iter_mut().enumerate() {
        *line = line.replace(".png", ".exr");
        let path = here.join("capture").join(name(i)).with_extension("exr");
        scene::pictures::write_made_exr(&path, scene::light(i, 20), None);
    }
    write_lines(&here.join("capture/lights.lp"), &lines);
    relight(here, "bake capture -o a.ktx2 --basis hsh -k 9 --precision f32").ok();
    let info = relight(here, "info a.ktx2 --json").ok().json();
    assert_eq!((&info["space"], &info["texels"]), (&"linear".into(), &"f32".into()));
    let judged = relight(here, "evaluate a.ktx2 capture --json").ok().json();
    assert_eq!(judged["values"], "linear");
    assert!(mean_psnr(&judged) > 28.0, "{}", judged["mean"]);
    // Both figures are those of the rendering.
    let [x, y, z] = scene::light(13, 20);
    relight(here, &format!("render a.ktx2 -o a.exr --depth float --light {x:.6},{y:.6},{z:.6}")).ok();
    let relit = read_exr(&here.join("a.exr")).0.samples;
    let photograph = read_exr(&here.join("capture/p13.exr")).0.samples;
    let curve = |values: &[f64]| values.iter().map(|value| encoded(value.max(0.0))).collect::<Vec<_>>();
    let picture = &judged["pictures"][13];
    for (said, rendered) in [
        (number(picture, "psnr"), psnr(&relit, &photograph)),
        (number(picture, "psnr_encoded"), psnr(&curve(&relit), &curve(&photograph))),
    ] {
        assert!((said - rendered).abs() < 0.01, "{rendered} dB rendered, {said} dB evaluated");
    }
}

#[test]
fn few_lights_lower_the_default_size_with_a_note() {
    let folder = made(5);
    let refitted = relight(folder.path(), "bake capture -o a.ktx2 --basis hsh").ok();
    assert!(
        refitted.stderr.contains("note: 5 lights do not carry the usual 9 functions of hsh; 4 are fitted"),
        "{}",
        refitted.stderr
    );
    assert!(refitted.stdout.contains("hsh with 4 functions"), "{}", refitted.stdout);
    let asked = relight(folder.path(), "bake capture -o a.ktx2 --basis hsh -k 9").ok();
    assert!(asked.stderr.contains("the largest hsh that these lights carry is -k 4"), "{}", asked.stderr);
}

#[test]
fn first_use_as_in_the_readme_with_blanks_in_names() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let capture = here.join("Schöne Münze, Vorderseite");
    scene::copy_icon72(&capture, 1);
    let out = here.join("all my assets");
    fs::create_dir(&out).unwrap();
    let (capture, asset) = (capture.to_str().unwrap(), out.join("münze 1.ktx2"));
    let asset = asset.to_str().unwrap();
    let before = scene::snapshot(capture.as_ref());
    let baked = relight_words(here, &["bake", capture, "-o", asset]).ok();
    assert!(baked.stdout.starts_with(&format!("{asset}: 402 x 395, ptm with 6 functions, u8, from 72")));
    assert_eq!(baked.stderr, "", "a clean capture needs no words");
    let picture = out.join("von links.png");
    relight_words(here, &["render", asset, "-o", picture.to_str().unwrap(), "--angles", "180,30"]).ok();
    let said = relight_words(here, &["evaluate", asset, capture]).ok().stdout;
    assert!(said.contains("image72.jpg") && said.contains("mean of 72"), "{said}");
    let (picture, bits) = read_png(&picture);
    assert_eq!((picture.width, picture.height, bits), (402, 395, 8));
    assert_eq!(scene::names_in(&out), ["münze 1.ktx2", "von links.png"]);
    assert!(before == scene::snapshot(capture.as_ref()), "the capture's folder was touched");
}
