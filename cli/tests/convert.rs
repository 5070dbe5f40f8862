//! `relight convert`: between all formats, what is kept to the bit, what is refitted and what that is said to
//! lose, and what is refused.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use relight_core::sphere::{Cap, fibonacci_in};
use relight_core::{CpuLevel, Direction, RelightingMaps, Texels, relighter};
use relight_formats::{read_asset, read_positions};
use scene::pictures::{psnr, read_png};
use scene::{icon72, names_in, number, relight, relight_words, snapshot, write_lines};
use std::fs;
use std::path::Path;

const FORMATS: [&str; 6] = ["ktx2", "dds", "exr", "ptm", "rti", "web"];

/// A part of the real capture, baked with `options`.
fn bake(folder: &Path, output: &str, options: &str) {
    let input = icon72();
    let words = ["bake", input.to_str().unwrap(), "-o", output, "--crop", "40x24+160+180"];
    relight_words(folder, &words.into_iter().chain(options.split_whitespace()).collect::<Vec<_>>()).ok();
}

fn read(path: &Path) -> RelightingMaps {
    read_asset(path, 1 << 30).unwrap()
}

/// The codes of every plane.
fn codes(maps: &RelightingMaps) -> Vec<Vec<u8>> {
    let of_plane = |texels: &Texels| match texels {
        Texels::U8(codes) => codes.clone(),
        other => panic!("{other:?} are no codes"),
    };
    maps.planes.iter().map(|plane| of_plane(&plane.texels)).collect()
}

/// `count` directions of half the sphere.
fn half_sphere(count: usize) -> Vec<Direction> {
    fibonacci_in(Cap { axis: Direction::OUT, radius: std::f64::consts::FRAC_PI_2 }, count)
}

/// PSNR of `b` against `a` over `lights`, both relit, encoded and clipped.
fn loss_of(a: &RelightingMaps, b: &RelightingMaps, lights: &[Direction]) -> f64 {
    let samples = |maps: &RelightingMaps| -> Vec<f64> {
        let relit = |&light: &Direction| {
            relighter::relight(maps, light, CpuLevel::detect()).encoded_from(maps.model.space).samples
        };
        lights.iter().flat_map(relit).map(f64::from).collect()
    };
    psnr(&samples(a), &samples(b))
}

#[test]
fn every_format_becomes_every_other_and_keeps_what_the_other_holds() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    // Each has functions that some formats lack.
    let inputs = [
        ("a.ktx2", "--basis srbf -k 9"),
        ("a.dds", "--basis sh --color lrgb"),
        ("a.exr", "--space linear"),
        ("a.ptm", ""),
        ("a.rti", "--basis hsh -k 9"),
        ("a.web", "--basis pca -k 6"),
    ];
    for (input, options) in inputs {
        bake(here, input, options);
        let before = read(&here.join(input));
        for format in FORMATS {
            let output = format!("b.{format}");
            let done = relight(here, &format!("convert {input} -o {output} --json")).ok().json();
            let after = read(&here.join(&output));
            let held = match format {
                "ktx2" | "dds" | "exr" => true,
                "web" => !["a.ktx2", "a.exr"].contains(&input),
                own => input == format!("a.{own}"),
            };
            assert_eq!(done["way"] == "planes kept", held, "{input} to {format}: {}", done["way"]);
            assert!(!held || before.model.basis == after.model.basis, "{input} to {format}");
            // Least squares between functions of this size; what is kept loses its quantisation alone.
            let said = done["loss"]["psnr"].as_f64().unwrap_or(f64::INFINITY);
            let least = match (held, format) {
                (false, _) => 18.0,
                (true, "web") => 45.0,
                _ => 65.0,
            };
            assert!(said > least, "{input} to {format}: {said} dB");
            let lights = half_sphere(64);
            let measured = loss_of(&before, &after, &lights);
            assert!(
                measured == said || (measured - said).abs() < 1e-3,
                "{input} to {format}: {measured}, {said}"
            );
        }
    }
}

#[test]
fn floats_come_back_to_the_bit_and_codes_to_the_code() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    bake(here, "a.ktx2", "--basis sh -k 16 --precision f32 --wrap repeat");
    relight(here, "convert a.ktx2 -o a.exr").ok();
    relight(here, "convert a.exr -o b.ktx2 --wrap repeat").ok();
    let (a, b) = (read(&here.join("a.ktx2")), read(&here.join("b.ktx2")));
    assert_eq!(a, b);
    assert!(fs::read(here.join("a.ktx2")).unwrap() == fs::read(here.join("b.ktx2")).unwrap());
    // What lies beyond the edge is copied too.
    relight(here, "convert a.ktx2 -o c.dds").ok();
    assert!(fs::read_to_string(here.join("c.json")).unwrap().contains("\"repeat\""));

    for (own, options) in
        [("ptm", ""), ("ptm", "--color lrgb"), ("rti", "--basis hsh"), ("rti", "--basis hsh -k 4")]
    {
        let name = format!("a.{own}");
        bake(here, &name, options);
        relight(here, &format!("convert {name} -o there.ktx2")).ok();
        let said = relight(here, &format!("convert there.ktx2 -o back.{own}")).ok().stdout;
        assert!(said.contains("nothing lost"), "{own} {options}: {said}");
        let [a, there, back] = [&name, "there.ktx2", &format!("back.{own}")].map(|f| read(&here.join(f)));
        assert!(codes(&a) == codes(&there) && codes(&a) == codes(&back), "{own} {options}");
        assert!(fs::read(here.join(&name)).unwrap() == fs::read(here.join(format!("back.{own}"))).unwrap());
    }
}

#[test]
fn a_refit_is_what_its_loss_says_and_a_renderer_sees_it() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    bake(here, "a.ktx2", "--basis sh -k 25 --precision f32");
    let done = relight(here, "convert a.ktx2 -o b.ptm --json").ok().json();
    assert_eq!(
        (done["to"]["family"].as_str(), done["way"].as_str()),
        (Some("ptm"), Some("functions refitted"))
    );
    // Pictures of `render`, by another decoder.
    let lights = half_sphere(64);
    let line = |(i, light): (usize, &Direction)| {
        let [x, y, z] = light.components();
        format!("l{i}.png {x} {y} {z}")
    };
    write_lines(&here.join("lights.lp"), &lights.iter().enumerate().map(line).collect::<Vec<_>>());
    let pictures = |asset: &str| -> Vec<f64> {
        relight(here, &format!("render {asset} --lights lights.lp -o {asset}.d --depth 16")).ok();
        (0..64).flat_map(|i| read_png(&here.join(format!("{asset}.d/l{i}.png"))).0.samples).collect()
    };
    let seen = psnr(&pictures("a.ktx2"), &pictures("b.ptm"));
    let said = number(&done, "loss.psnr");
    assert!((seen - said).abs() < 0.01, "{seen} dB seen, {said} dB said");
    // No other polynomials are nearer: those fitted to the photographs are not.
    bake(here, "p.ktx2", "--precision f32");
    let (a, fitted) = (read(&here.join("a.ktx2")), read(&here.join("p.ktx2")));
    assert!(loss_of(&a, &fitted, &lights) < said, "the fit to photographs is nearer");
    // More functions lose less, and what holds all of them loses nothing to speak of.
    let lost = |options: &str| {
        let done = relight(here, &format!("convert a.ktx2 -o c.ktx2 --json {options}")).ok().json();
        done["loss"]["psnr"].as_f64().unwrap_or(f64::INFINITY)
    };
    let steps = ["-k 4", "-k 9", "-k 16", "--basis sh -k 36"].map(lost);
    assert!(steps.is_sorted() && steps[3] > 90.0, "{steps:?}");
}

#[test]
fn base_colours_learned_planes_and_other_spaces_are_fitted_to_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    bake(here, "a.ktx2", "--basis hsh -k 9 --precision f32");
    bake(here, "linear.ktx2", "--space linear --precision f32");
    let a = read(&here.join("a.ktx2"));
    for (input, options, layout, way, least) in [
        ("a.ktx2", "--color lrgb", "lrgb", "fitted to its pictures", 25.0),
        ("a.ktx2", "--basis pca -k 12", "shared", "learned from its pictures", 35.0),
        ("a.ktx2", "--planes 12 --color ycc", "shared", "learned from its pictures", 30.0),
        ("a.ktx2", "--planes 27 --precision f16", "shared", "learned from its pictures", 45.0),
    ] {
        let done = relight(here, &format!("convert {input} -o b.ktx2 --json {options}")).ok().json();
        assert_eq!(
            (done["to"]["layout"].as_str(), done["way"].as_str()),
            (Some(layout), Some(way)),
            "{options}"
        );
        let (said, seen) =
            (number(&done, "loss.psnr"), loss_of(&a, &read(&here.join("b.ktx2")), &half_sphere(64)));
        assert!(said > least && (said - seen).abs() < 1e-3, "{options}: {said} dB, {seen} dB");
    }
    // Encoded values of linear polynomials are none, but near them.
    let done = relight(here, "convert linear.ktx2 -o b.ptm --json").ok().json();
    assert_eq!(
        (done["to"]["space"].as_str(), done["from"]["space"].as_str()),
        (Some("encoded"), Some("linear"))
    );
    assert!(number(&done, "loss.psnr") > 20.0, "{}", done["loss"]);
    bake(here, "learned.exr", "--basis pca -k 9 --space linear");
    let done = relight(here, "convert learned.exr -o c.web --json").ok().json();
    assert_eq!(done["way"].as_str(), Some("learned from its pictures"));
    assert!(number(&done, "loss.psnr") > 25.0, "{}", done["loss"]);
    // Luminance times base colour is multiplied out, exactly.
    bake(here, "l.ktx2", "--color lrgb --precision f32");
    let done = relight(here, "convert l.ktx2 -o m.ktx2 --color rgb --json").ok().json();
    assert_eq!(
        (done["to"]["layout"].as_str(), done["way"].as_str()),
        (Some("rgb"), Some("planes multiplied out"))
    );
    assert!(number(&done, "loss.rmse") < 1e-6, "{}", done["loss"]);
}

#[test]
fn positions_go_along_where_they_can_and_mips_are_told_of() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    bake(here, "a.ktx2", "--mips");
    let points = relight_core::PositionMap {
        width: 40,
        height: 24,
        points: (0..960).map(|i| [i as f32 * 0.5 - 7.0, (i % 37) as f32, 3.0 / (1.0 + i as f32)]).collect(),
    };
    relight_formats::write_position_file(&here.join("p.exr"), &points).unwrap();
    bake_with_positions(here);
    for (output, exact) in [("b.exr", true), ("b.dds", true), ("b.ktx2", true)] {
        relight(here, &format!("convert p.ktx2 -o {output}")).ok();
        let back = read_positions(&here.join(output), 1 << 30).unwrap().unwrap();
        assert_eq!(back.points == points.points, exact, "{output}");
    }
    let said = relight(here, "convert p.ktx2 -o b.ptm").ok().stderr;
    assert!(said.contains("positions are left out: ptm holds none; write .ktx2"), "{said}");
    let said = relight(here, "convert a.ktx2 -o b.exr").ok().stderr;
    assert!(said.contains("6 mip levels are left out"), "{said}");
    let said = relight(here, "convert a.ktx2 -o b.dds --mips").ok().stderr;
    assert!(!said.contains("mip levels"), "{said}");
}

/// `p.ktx2`, with the positions of `p.exr` as floats.
fn bake_with_positions(here: &Path) {
    let input = icon72();
    // A crop of pictures is one of positions too: these are of the whole picture.
    let (width, height) = (402, 395);
    let part = relight_formats::read_position_file(&here.join("p.exr"), 1 << 30).unwrap();
    let mut points = vec![[0.0, 0.0, 1.0]; width * height];
    for (y, row) in part.points.chunks_exact(40).enumerate() {
        points[(180 + y) * width + 160..][..40].copy_from_slice(row);
    }
    let whole = relight_core::PositionMap { width, height, points };
    relight_formats::write_position_file(&here.join("whole.exr"), &whole).unwrap();
    let words = ["bake", input.to_str().unwrap(), "-o", "p.ktx2", "--crop", "40x24+160+180"];
    let more = ["--positions", "whole.exr", "--positions-precision", "float"];
    relight_words(here, &[&words[..], &more].concat()).ok();
}

#[test]
fn the_same_bytes_and_words_on_any_number_of_threads_and_any_processor() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    bake(here, "a.rti", "--basis hsh -k 16");
    for options in
        ["--basis sh", "--basis pca -k 4", "--color lrgb --block bc7", "--basis ptm --block auto --mips"]
    {
        let run = |machine: &str| {
            let said =
                relight(here, &format!("convert a.rti -o b.ktx2 --json {options} {machine}")).ok().stdout;
            (fs::read(here.join("b.ktx2")).unwrap(), said)
        };
        let expected = run("-j 1");
        assert!(expected == run("-j 3"), "{options}");
        assert!(expected == run("-j 2 --cpu baseline"), "{options}");
    }
}

#[test]
fn what_can_t_be_is_refused_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    bake(here, "a.ktx2", "--basis sh -k 9");
    bake(here, "linear.exr", "--basis pca -k 3 --space linear");
    let whole = fs::read(here.join("a.ktx2")).unwrap();
    fs::write(here.join("cut.ktx2"), &whole[..whole.len() - 99]).unwrap();
    fs::write(here.join("old.ptm"), "older").unwrap();
    fs::write(here.join("no.ktx2"), "no asset").unwrap();
    let before = snapshot(here);
    for (line, code, words) in [
        ("a.ktx2 -o old.ptm --basis sh", 2, &["ptm holds basis ptm", "not sh with 9"][..]),
        ("a.ktx2 -o b.rti -k 25", 2, &["rti holds basis hsh"]),
        ("a.ktx2 -o b.ktx2 --basis rbf", 2, &["'rbf'", "ptm, sh, hsh, srbf"]),
        ("a.ktx2 -o b.ktx2 --basis ptm -k 7", 2, &["7 functions", "6, 10, 15"]),
        ("a.ktx2 -o b.ktx2 --degree 3", 2, &["sh takes no --degree"]),
        ("a.ktx2 -o b.ktx2 --basis pca --planes 3", 2, &["--planes", "pca has -k"]),
        ("a.ktx2 -o b.ktx2 --basis pca --color lrgb", 2, &["--color lrgb", "learned"]),
        ("a.ktx2 -o b.ktx2 --color ycc", 2, &["--color ycc", "pca"]),
        ("a.ktx2 -o b.ktx2 --spread 1", 2, &["--spread belongs to --basis srbf"]),
        ("a.ktx2 -o b.ktx2 --ridge 2", 2, &["--ridge", "0 to 1"]),
        ("a.ktx2 -o b.exr --precision u8", 2, &["exr holds precision f16 or f32"]),
        ("a.ktx2 -o old.ptm --mips", 2, &["ptm holds no mip levels"]),
        ("a.ktx2 -o b.ktx2 --block bc7 --precision f16", 2, &["exclude each other"]),
        ("a.ktx2 -o a.ktx2", 2, &["a.ktx2 is another file of this command too"]),
        ("a.ktx2 -o b.tga", 2, &["no asset format", "ktx2"]),
        ("cut.ktx2 -o old.ptm", 3, &["cut.ktx2"]),
        ("no.ktx2 -o old.ptm", 3, &["no.ktx2"]),
        ("none.ktx2 -o old.ptm", 4, &["none.ktx2"]),
        ("a.ktx2 -o gone/b.ptm", 4, &["gone"]),
        ("a.ktx2 -o old.ptm --memory 1M", 5, &["--memory"]),
    ] {
        relight(here, &format!("convert {line}")).assert_refused(code, words);
        assert!(snapshot(here) == before, "convert {line} left something: {:?}", names_in(here));
    }
}

#[test]
fn outputs_are_told_from_inputs_by_where_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    bake(here, "a.ktx2", "--basis sh -k 9");
    let refused = &["another file of this command too"];
    fs::create_dir(here.join("below")).unwrap();
    relight(here, "convert a.ktx2 -o below/../a.ktx2").assert_refused(2, refused);
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("a.ktx2", here.join("link.ktx2")).unwrap();
        relight(here, "convert a.ktx2 -o link.ktx2").assert_refused(2, refused);
        relight(here, "convert link.ktx2 -o a.ktx2").assert_refused(2, refused);
    }
    // Another file of the same length and time is another file.
    fs::copy(here.join("a.ktx2"), here.join("twin.ktx2")).unwrap();
    let time = fs::metadata(here.join("a.ktx2")).unwrap().modified().unwrap();
    fs::File::options().write(true).open(here.join("twin.ktx2")).unwrap().set_modified(time).unwrap();
    relight(here, "convert a.ktx2 -o twin.ktx2 --block bc1").ok();
    assert_ne!(fs::read(here.join("a.ktx2")).unwrap(), fs::read(here.join("twin.ktx2")).unwrap());
}

/// A folder of another program, beside the checkout.
#[test]
fn web_folders_of_other_programs_become_ptm_and_textures() {
    let input = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/peer_web_ptm");
    let Ok(input) = input.canonicalize() else {
        println!("skipped: no {}", input.display());
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let peer = read(&input);
    for (output, least) in [("a.ptm", 50.0), ("a.ktx2", f64::INFINITY), ("a.rti", 20.0)] {
        let words = ["convert", input.to_str().unwrap(), "-o", output, "--json"];
        let done = relight_words(here, &words).ok().json();
        let said = done["loss"]["psnr"].as_f64().unwrap_or(f64::INFINITY);
        assert!(said >= least, "{output}: {said} dB");
        let seen = loss_of(&peer, &read(&here.join(output)), &half_sphere(64));
        assert!(seen == said || (seen - said).abs() < 1e-3, "{output}: {seen} dB seen, {said} dB said");
    }
}
