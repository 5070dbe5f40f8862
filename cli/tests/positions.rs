//! Positions from depths and cameras, and in assets.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use exr::prelude::{self as ex, WritableImage};
use relight_core::{PointKind, PositionMap};
use relight_formats::{read_position_file, read_positions};
use scene::{HEIGHT, WIDTH, made, number, relight, snapshot};
use std::fs;
use std::path::{Path, PathBuf};

const LIMIT: u64 = 64 << 20;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn write_depth(path: &Path, (width, height): (usize, usize), name: &str, depths: &[f32]) {
    let channels =
        ["other", name].map(|name| ex::AnyChannel::new(name, ex::FlatSamples::F32(depths.to_vec())));
    let channels = ex::AnyChannels::sort(channels.into_iter().collect());
    let layer = ex::Layer::new(
        (width, height),
        ex::LayerAttributes::default(),
        ex::Encoding::SMALL_LOSSLESS,
        channels,
    );
    ex::Image::from_layer(layer).write().to_file(path).unwrap();
}

/// The largest distance of a coordinate in `found` from that in `expected`, which have the same surfaces.
#[track_caller]
fn worst(found: &PositionMap, expected: &PositionMap) -> f32 {
    assert_eq!((found.width, found.height), (expected.width, expected.height));
    let mut worst = 0.0f32;
    for (i, (found, expected)) in found.points.iter().zip(&expected.points).enumerate() {
        assert_eq!(PointKind::of(*found), PointKind::of(*expected), "pixel {i}: {found:?} {expected:?}");
        if PointKind::of(*found) == PointKind::Surface {
            worst = (0..3).fold(worst, |worst, c| worst.max((found[c] - expected[c]).abs()));
        }
    }
    worst
}

#[test]
fn positions_agree_with_the_renderers() {
    let folder = tempfile::tempdir().unwrap();
    for (set, points) in [("court", 13245), ("house", 15579), ("panorama", 11196)] {
        let data = root().join("../shared/data").join(set);
        if !data.is_dir() {
            println!("skipped: no {}", data.display());
            continue;
        }
        let data = data.canonicalize().unwrap();
        let data = data.display();
        let line = format!("positions --depth {data}/depth.exr --camera {data}/camera.json -o {set}.exr");
        let run = relight(folder.path(), &line).ok();
        assert!(run.stdout.contains(&format!("{points} points from ")), "{}", run.stdout);
        let found = read_position_file(&folder.path().join(set).with_extension("exr"), LIMIT).unwrap();
        let expected = read_position_file(Path::new(&format!("{data}/position.exr")), LIMIT).unwrap();
        let worst = worst(&found, &expected);
        println!("{set}: {worst}");
        assert!(worst < 1e-4, "{set}: {worst}");
    }
}

#[test]
fn positions_of_some_of_their_pixels_agree_too() {
    let folder = tempfile::tempdir().unwrap();
    for (set, size) in [("court", (160, 120)), ("house", (160, 120)), ("panorama", (256, 64))] {
        let data = root().join("testdata/positions").join(set).canonicalize().unwrap();
        let nothing = [f32::NAN; 3];
        let mut expected =
            PositionMap { width: size.0, height: size.1, points: vec![nothing; size.0 * size.1] };
        let mut depths = vec![0.0; size.0 * size.1];
        for line in fs::read_to_string(data.join("points.txt")).unwrap().lines() {
            let numbers: Vec<f32> = line.split(' ').map(|number| number.parse().unwrap()).collect();
            let at = numbers[1] as usize * size.0 + numbers[0] as usize;
            (depths[at], expected.points[at]) = (numbers[2] / 4.0, [numbers[3], numbers[4], numbers[5]]);
        }
        write_depth(&folder.path().join("depth.exr"), size, "quarter", &depths);
        let camera = data.join("camera.json");
        let line = format!(
            "positions --depth depth.exr --channel quarter --depth-scale 4 --camera {} -o p.exr",
            camera.display()
        );
        relight(folder.path(), &line).ok();
        let found = read_position_file(&folder.path().join("p.exr"), LIMIT).unwrap();
        let worst = worst(&found, &expected);
        assert!(worst > 0.0 && worst < 1e-4, "{set}: {worst}");
    }
}

/// A made capture, `depth.exr` of a slanted plane with a hole and sky, and its parallel `camera.toml`.
fn folder() -> tempfile::TempDir {
    let folder = made(12);
    let depth = |i: usize| match i {
        7 => f32::NAN,
        8 => f32::INFINITY,
        _ => 3.0 + 0.25 * (i % WIDTH) as f32,
    };
    let depths: Vec<f32> = (0..WIDTH * HEIGHT).map(depth).collect();
    write_depth(&folder.path().join("depth.exr"), (WIDTH, HEIGHT), "Z", &depths);
    let camera = format!(
        "kind = 'orthographic'\nwidth = {WIDTH}\nheight = {HEIGHT}\nwidth_units = 12\neye = [0, 0, 10]\n\
         v = 'scene_to_eye'\nforward = [0, 0, 1]\nup = [0, 1, 0]\n"
    );
    fs::write(folder.path().join("camera.toml"), camera).unwrap();
    folder
}

const SOURCE: &str = "--depth depth.exr --camera camera.toml";

#[test]
fn bakes_store_positions_beside_their_planes() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    relight(folder.path(), &format!("positions {SOURCE} -o p.exr --depth-kind z")).ok();
    let info = relight(folder.path(), "info p.exr").ok().stdout;
    assert!(info.contains("position map") && info.contains("24 x 16"), "{info}");
    let given = read_position_file(&at("p.exr"), LIMIT).unwrap();
    assert_eq!(given.counts(), [WIDTH * HEIGHT - 2, 1, 1]);
    // Half a unit a pixel, y up, z the eye's less the depth.
    assert_eq!(given.points[0], [-5.75, 3.75, 7.0]);
    assert_eq!(given.points[2 * WIDTH + 23], [5.75, 2.75, 10.0 - 3.0 - 0.25 * 23.0]);
    relight(folder.path(), "bake capture -o bare.ktx2").ok();
    for (line, precision, name, allowed) in [
        ("-o a.ktx2 --positions p.exr", "f16", "a.ktx2", 5.75 / 4096.0),
        ("-o b.ktx2 --positions p.exr --positions-precision float --split --mips", "f32", "b.ktx2", 0.0),
        ("-o a.dds --depth depth.exr --camera camera.toml --mips", "f16", "a.dds", 5.75 / 4096.0),
        ("-o a.exr --depth depth.exr --camera camera.toml --depth-kind z", "f32", "a.exr", 0.0),
    ] {
        let run = relight(folder.path(), &format!("bake capture {line} --report r.json")).ok();
        let words = format!("positions as {precision}: 382 points from -5.75 -3.75 1.25 to 5.75 3.75 7");
        assert!(run.stdout.contains(&words), "{}", run.stdout);
        let report: serde_json::Value = serde_json::from_slice(&fs::read(at("r.json")).unwrap()).unwrap();
        assert_eq!(report["positions"]["precision"], precision);
        assert_eq!(number(&report, "positions.surface"), 382.0);
        let info = relight(folder.path(), &format!("info {name}")).ok().stdout;
        let row = info.lines().find(|row| row.starts_with("positions")).unwrap();
        assert!(row.contains(precision), "{row}");
        let found = read_positions(&at(name), LIMIT).unwrap().unwrap();
        let worst = worst(&found, &given);
        assert!(worst <= allowed, "{name}: {worst}");
        assert_eq!(worst == 0.0, allowed == 0.0, "{name}: {worst}");
    }
    // Directional light needs none of it, not even the file.
    fs::remove_file(at("a_positions.ktx2")).unwrap();
    for asset in ["a", "bare"] {
        relight(folder.path(), &format!("render {asset}.ktx2 --light 1,2,3 -o {asset}.png")).ok();
    }
    assert_eq!(fs::read(at("a.png")).unwrap(), fs::read(at("bare.png")).unwrap());
    let report = relight(folder.path(), "bake capture -o c.ktx2 --report r.json").ok();
    assert!(!report.stdout.contains("positions"), "{}", report.stdout);
    assert!(read_positions(&at("c.ktx2"), LIMIT).unwrap().is_none());
}

#[test]
fn bytes_do_not_depend_on_threads_and_a_job_file_has_the_same_keys() {
    let folder = folder();
    let runs = ["-j 1", "-j 2"].map(|jobs| {
        relight(folder.path(), &format!("positions {SOURCE} -o p.exr {jobs}")).ok();
        relight(folder.path(), &format!("bake capture -o a.ktx2 --positions p.exr --zstd=3 {jobs}")).ok();
        relight(folder.path(), &format!("bake capture -o a.exr {SOURCE} {jobs}")).ok();
        snapshot(folder.path())
    });
    assert!(runs[0].contains_key(&folder.path().join("a_positions.ktx2")));
    assert!(runs[0] == runs[1], "different bytes");
    fs::create_dir(folder.path().join("jobs")).unwrap();
    let job =
        "input = '../capture'\noutput = '../a.exr'\ndepth = '../depth.exr'\ncamera = '../camera.toml'\n";
    fs::write(folder.path().join("jobs/job.toml"), job).unwrap();
    relight(folder.path(), "bake jobs/job.toml").ok();
    assert_eq!(fs::read(folder.path().join("a.exr")).unwrap(), runs[0][&folder.path().join("a.exr")]);
}

#[test]
fn what_does_not_fit_is_one_sentence_and_changes_nothing() {
    let folder = folder();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    let camera = fs::read_to_string(folder.path().join("camera.toml")).unwrap();
    write("nan.toml", &camera.replace("[0, 0, 10]", "[0, nan, 10]"));
    write("wide.toml", &camera.replace("width = 24", "width = 25"));
    write("bad.toml", &camera.replace("up =", "upwards ="));
    write("pano.json", "{\"kind\": \"pano\", \"width\": 24, \"height\": 16, \"eye\": [0, 0, 0]}");
    write("short.exr", "v/1");
    let depth = fs::read(folder.path().join("depth.exr")).unwrap();
    fs::write(folder.path().join("cut.exr"), &depth[..depth.len() / 2]).unwrap();
    write_depth(&folder.path().join("other.exr"), (16, 24), "Z", &[1.0; WIDTH * HEIGHT]);
    relight(folder.path(), &format!("positions {SOURCE} -o p.exr")).ok();
    let before = snapshot(folder.path());
    for (line, code, words) in [
        (
            "positions --depth depth.exr --camera nan.toml -o q.exr",
            3,
            &["nan.toml", "a coordinate is NaN"][..],
        ),
        (
            "positions --depth depth.exr --camera bad.toml -o q.exr",
            3,
            &["unknown field `upwards`", "at line 8"],
        ),
        ("positions --depth depth.exr --camera wide.toml -o q.exr", 3, &["24 x 16", "25 x 16"]),
        ("positions --depth depth.exr --camera no.toml -o q.exr", 4, &["no.toml"]),
        ("positions --depth no.exr --camera camera.toml -o q.exr", 4, &["no.exr"]),
        ("positions --depth cut.exr --camera camera.toml -o q.exr", 3, &["cut.exr", "damaged"]),
        ("positions --depth short.exr --camera camera.toml -o q.exr", 3, &["short.exr"]),
        ("positions --depth depth.exr --camera pano.json --depth-kind z -o q.exr", 2, &["no z"]),
        (
            "positions --depth depth.exr --channel Y --camera camera.toml -o q.exr",
            3,
            &["no channel 'Y'", "Z, other"],
        ),
        ("positions --depth depth.exr --camera camera.toml --depth-scale 0 -o q.exr", 2, &["1e-12 to 1e12"]),
        ("positions --depth depth.exr --camera camera.toml -o q.png", 2, &["q.png", "written as .exr"]),
        ("positions --depth depth.exr --camera camera.toml -o depth.exr", 2, &["a name of its own"]),
        ("positions --depth depth.exr -o q.exr", 2, &["--camera <FILE>"]),
        ("positions -o q.exr", 2, &["--depth <FILE>"]),
        ("bake capture -o a.ptm --positions p.exr", 2, &["ptm holds no positions", ".ktx2, .dds or .exr"]),
        ("bake capture -o a.exr --positions p.exr --positions-precision half", 2, &["f32, not f16"]),
        ("bake capture -o a.ktx2 --positions-precision half", 2, &["belongs to --positions or --depth"]),
        (
            "bake capture -o a.ktx2 --positions p.exr --depth depth.exr --camera camera.toml",
            2,
            &["cannot be used with"],
        ),
        ("bake capture -o a.ktx2 --camera camera.toml", 2, &["--depth <FILE>"]),
        ("bake capture -o a.ktx2 --positions other.exr", 3, &["other.exr", "no channels X, Y, Z"]),
        ("bake capture -o p.exr --positions p.exr", 2, &["a name of its own"]),
    ] {
        relight(folder.path(), line).assert_refused(code, words);
        assert!(snapshot(folder.path()) == before, "relight {line} changed files");
    }
    // A map of another view, and one that sees nothing.
    let square = camera.replace("width = 24\nheight = 16", "width = 16\nheight = 24");
    fs::write(folder.path().join("high.toml"), square).unwrap();
    relight(folder.path(), "positions --depth other.exr --camera high.toml --channel Z -o high.exr").ok();
    let words = ["high.exr", "16 x 24", "24 x 16"];
    relight(folder.path(), "bake capture -o a.ktx2 --positions high.exr").assert_refused(3, &words);
    write_depth(&folder.path().join("depth.exr"), (WIDTH, HEIGHT), "Z", &[0.0; WIDTH * HEIGHT]);
    let nothing = relight(folder.path(), &format!("positions {SOURCE} -o nothing.exr")).ok();
    assert!(nothing.stderr.contains("relight: note: no pixel has a surface"), "{}", nothing.stderr);
}
