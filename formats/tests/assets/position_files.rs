//! Cameras, depths and positions in files of their own.

use crate::lopsided::{LIMIT, names_in};
use exr::prelude::{self as ex, WritableImage};
use relight_core::{Camera, DepthKind, DepthMap, NO_SURFACE, PointKind, PositionMap, Projection, SKY};
use relight_formats::{
    FormatError, describe, read_camera_file, read_depth_file, read_position_file, write_position_file,
};
use std::fs;
use std::path::{Path, PathBuf};

const SETS: [&str; 3] = ["court", "house", "panorama"];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Writes channels of floats, or of halves where the name says so, which is then left out.
pub(crate) fn write_exr(path: &Path, (width, height): (usize, usize), channels: &[(&str, &[f32])]) {
    let channel = |(name, values): &(&str, &[f32])| match name.strip_prefix("half ") {
        Some(name) => {
            let halves = values.iter().map(|v| half::f16::from_f32(*v)).collect();
            ex::AnyChannel::new(name, ex::FlatSamples::F16(halves))
        }
        None => ex::AnyChannel::new(*name, ex::FlatSamples::F32(values.to_vec())),
    };
    let channels = ex::AnyChannels::sort(channels.iter().map(channel).collect());
    let tiles = ex::Encoding {
        compression: ex::Compression::ZIP1,
        blocks: ex::Blocks::Tiles(ex::Vec2(5, 3)),
        line_order: ex::LineOrder::Increasing,
    };
    let layer = ex::Layer::new((width, height), ex::LayerAttributes::default(), tiles, channels);
    ex::Image::from_layer(layer).write().to_file(path).unwrap();
}

fn apart(a: [f32; 3], b: [f32; 3]) -> f32 {
    (0..3).map(|i| (a[i] - b[i]).abs()).fold(0.0, f32::max)
}

/// Where the whole sets lie beside the checkout, all their pixels.
#[test]
fn positions_from_depths_are_the_renderers() {
    for set in SETS {
        let folder = root().join("../shared/data").join(set);
        if !folder.is_dir() {
            println!("skipped: no {}", folder.display());
            continue;
        }
        let camera = read_camera_file(&folder.join("camera.json")).unwrap();
        let depth = read_depth_file(&folder.join("depth.exr"), None, 1.0, LIMIT).unwrap();
        let rendered = read_position_file(&folder.join("position.exr"), LIMIT).unwrap();
        let found = PositionMap::from_depth(&camera, &depth, DepthKind::Ray).unwrap();
        let [surface, _, missing] = found.counts();
        assert_eq!(found.counts(), rendered.counts());
        assert!(surface > 10_000 && missing > 3_000, "{surface} {missing}");
        let pairs = found.points.iter().zip(&rendered.points);
        let worst =
            pairs.filter(|(p, _)| PointKind::of(**p) == PointKind::Surface).map(|(p, q)| apart(*p, *q));
        let worst = worst.fold(0.0, f32::max);
        println!("{set}: {surface} points, {worst} at most");
        assert!(worst < 1e-5, "{set}: {worst}");
    }
}

/// Some pixels of the same sets, by other files: the depth among colours, halves of which it is not.
#[test]
fn positions_of_some_pixels_are_the_renderers() {
    let folder = tempfile::tempdir().unwrap();
    for set in SETS {
        let data = root().join("testdata/positions").join(set);
        let camera = read_camera_file(&data.join("camera.json")).unwrap();
        let size = (camera.width, camera.height);
        let mut depths = vec![f32::NAN; size.0 * size.1];
        let mut expected = vec![NO_SURFACE; size.0 * size.1];
        for line in fs::read_to_string(data.join("points.txt")).unwrap().lines() {
            let numbers: Vec<f32> = line.split(' ').map(|number| number.parse().unwrap()).collect();
            let at = numbers[1] as usize * size.0 + numbers[0] as usize;
            (depths[at], expected[at]) = (numbers[2], [numbers[3], numbers[4], numbers[5]]);
        }
        let path = folder.path().join("depth.exr");
        let colors = vec![0.5; depths.len()];
        write_exr(
            &path,
            size,
            &[("half R", &colors), ("half G", &colors), ("half B", &colors), ("L.Depth.Z", &depths)],
        );
        let depth = read_depth_file(&path, None, 1.0, LIMIT).unwrap();
        let found = PositionMap::from_depth(&camera, &depth, DepthKind::Ray).unwrap();
        let mut surfaces = 0;
        for (i, (found, expected)) in found.points.iter().zip(&expected).enumerate() {
            assert_eq!(PointKind::of(*found), PointKind::of(*expected), "{set}, pixel {i}");
            if PointKind::of(*found) == PointKind::Surface {
                surfaces += 1;
                assert!(apart(*found, *expected) < 1e-5, "{set}, pixel {i}: {found:?} {expected:?}");
            }
        }
        assert!(surfaces > 25, "{set}: {surfaces}");
        // The same with z for depth, where the view has a middle.
        if camera.projection != (Projection::Equirectangular { latitude: 45f64.to_radians() }) {
            let z = |(i, depth): (usize, &f32)| {
                let ray = camera.ray((i % size.0) as f64 + 0.5, (i / size.0) as f64 + 0.5);
                let cosine: f64 = (0..3).map(|i| ray.direction[i] * camera.forward[i]).sum();
                (f64::from(*depth) * cosine) as f32
            };
            let z = DepthMap {
                width: size.0,
                height: size.1,
                depths: depths.iter().enumerate().map(z).collect(),
            };
            let of_z = PositionMap::from_depth(&camera, &z, DepthKind::Z).unwrap();
            let pairs = of_z.points.iter().zip(&found.points);
            assert!(pairs.map(|(p, q)| apart(*p, *q)).all(|apart| apart.is_nan() || apart < 1e-5));
        }
    }
}

#[test]
fn a_map_comes_back_bit_for_bit_and_the_same_map_is_the_same_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("p.exr");
    let mut points: Vec<[f32; 3]> =
        (0..35).map(|i| [i as f32 * 0.37 - 3.0, 1e-20 / (i + 1) as f32, -7e11]).collect();
    // The origin is a point like any other.
    (points[3], points[4], points[20]) = ([0.0; 3], NO_SURFACE, [-6e14, SKY as f32, 0.0]);
    let map = PositionMap { width: 7, height: 5, points };
    write_position_file(&path, &map).unwrap();
    let bytes = fs::read(&path).unwrap();
    let found = read_position_file(&path, LIMIT).unwrap();
    let bits = |map: &PositionMap| map.points.iter().flatten().map(|c| c.to_bits()).collect::<Vec<_>>();
    assert_eq!((found.width, found.height, bits(&found)), (7, 5, bits(&map)));
    write_position_file(&path, &found).unwrap();
    assert_eq!(fs::read(&path).unwrap(), bytes);
    let facts = describe(&path).unwrap();
    assert!(facts.contains(&("kind".to_owned(), "position map".to_owned())), "{facts:?}");
    assert!(facts.contains(&("size".to_owned(), "7 x 5".to_owned())), "{facts:?}");
    assert_eq!(names_in(folder.path()), ["p.exr"]);
    let none = PositionMap { width: 0, height: 5, points: Vec::new() };
    let refused = write_position_file(&folder.path().join("none.exr"), &none).unwrap_err().to_string();
    assert!(refused.contains("0 x 5 positions"), "{refused}");
    assert_eq!(names_in(folder.path()), ["p.exr"]);
}

#[test]
fn positions_of_renderers_are_found_and_their_zeros_are_no_surface() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("p.exr");
    let (x, y, z) = (
        [1.0, 0.0, 0.0, 3.0, f32::INFINITY, 7.5],
        [2.0, 0.0, 0.0, 4.0, 1.0, f32::NAN],
        [0.5, 0.0, 2.0, 5.0, 1.0, 7.0],
    );
    let other = [9.0; 6];
    let sets: [&[(&str, &[f32])]; 4] = [
        &[("R", &x), ("G", &y), ("B", &z)],
        &[("half X", &x), ("half Y", &y), ("half Z", &z)],
        &[
            ("position.X", &x),
            ("position.Y", &y),
            ("position.Z", &z),
            ("R", &other),
            ("G", &other),
            ("B", &other),
        ],
        &[
            ("L.P.X", &x),
            ("L.P.Y", &y),
            ("L.P.Z", &z),
            ("L.N.X", &other),
            ("L.N.Y", &other),
            ("L.N.Z", &other),
        ],
    ];
    for channels in sets {
        write_exr(&path, (3, 2), channels);
        let map = read_position_file(&path, LIMIT).unwrap();
        assert_eq!((map.width, map.height), (3, 2));
        assert_eq!(map.points[0], [1.0, 2.0, 0.5]);
        assert_eq!(map.points[2..4], [[0.0, 0.0, 2.0], [3.0, 4.0, 5.0]]);
        for missing in [1, 4, 5] {
            assert!(map.points[missing].iter().all(|c| c.is_nan()), "{:?}", map.points[missing]);
        }
    }
    write_exr(&path, (3, 2), &[("N.X", &x), ("N.Y", &y), ("N.Z", &z)]);
    let refused = read_position_file(&path, LIMIT).unwrap_err();
    assert!(matches!(refused, FormatError::Unsupported { .. }));
    assert!(refused.to_string().contains("(found: N.X, N.Y, N.Z); name them position.X"), "{refused}");
    fs::write(&path, "PNG, perhaps").unwrap();
    assert!(read_position_file(&path, LIMIT).unwrap_err().to_string().contains("is no OpenEXR file"));
}

#[test]
fn depths_are_read_from_named_channels_and_grey_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("d.exr");
    let (near, far) = ([1.5, f32::INFINITY, f32::NAN, -2.0, 0.0, 4.0], [10.0, 20.0, 30.0, 40.0, 50.0, 60.0]);
    write_exr(&path, (2, 3), &[("a.Z", &near), ("half b.Z", &far)]);
    let read = |channel, scale| read_depth_file(&path, channel, scale, LIMIT);
    let depth = read(Some("a.Z"), 1.0).unwrap();
    assert_eq!((depth.width, depth.height), (2, 3));
    assert_eq!(depth.depths.iter().map(|d| d.to_bits()).collect::<Vec<_>>(), near.map(f32::to_bits));
    assert_eq!(read(Some("b.Z"), 0.25).unwrap().depths, [2.5, 5.0, 7.5, 10.0, 12.5, 15.0]);
    let unnamed = read(None, 1.0).unwrap_err().to_string();
    assert!(unnamed.contains("plainly depth; name one of: a.Z, b.Z"), "{unnamed}");
    let missing = read(Some("Z"), 1.0).unwrap_err().to_string();
    assert!(missing.contains("has no channel 'Z'; it has: a.Z, b.Z"), "{missing}");
    // Millimetres of 16 bits; 0 is nothing.
    let path = folder.path().join("d.png");
    let codes: Vec<u8> =
        [0u16, 1, 1000, 65535, 256, 255].iter().flat_map(|code| code.to_be_bytes()).collect();
    let write = |color| {
        let mut encoder = png::Encoder::new(
            fs::File::create(&path).unwrap(),
            if color { 1 } else { 3 },
            if color { 1 } else { 2 },
        );
        encoder.set_color(if color { png::ColorType::Rgb } else { png::ColorType::Grayscale });
        encoder.set_depth(png::BitDepth::Sixteen);
        encoder.write_header().unwrap().write_image_data(&codes[..if color { 6 } else { 12 }]).unwrap();
    };
    write(false);
    let depth = read_depth_file(&path, None, 0.001, LIMIT).unwrap();
    assert_eq!((depth.width, depth.height), (3, 2));
    assert_eq!(depth.depths, [0.0, 0.001, 1.0, 65.535, 0.256, 0.255]);
    assert_eq!(read_depth_file(&path, None, 1.0, LIMIT).unwrap().depths[3], 65535.0);
    let channel = read_depth_file(&path, Some("Z"), 1.0, LIMIT).unwrap_err().to_string();
    assert!(channel.contains("has no channel 'Z'; leave the channel away"), "{channel}");
    write(true);
    let color = read_depth_file(&path, None, 1.0, LIMIT).unwrap_err().to_string();
    assert!(color.contains("depths are one channel"), "{color}");
}

#[test]
fn maps_beyond_the_memory_limit_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("p.exr");
    let values = vec![1.0; 64 * 64];
    write_exr(&path, (64, 64), &[("X", &values), ("Y", &values), ("Z", &values)]);
    // Points and a tile of three channels, thrice.
    let needed = 12 * 64 * 64 + 3 * 12 * 5 * 3;
    assert!(read_position_file(&path, needed).is_ok());
    assert!(matches!(read_position_file(&path, needed - 1), Err(FormatError::TooLarge { .. })));
    let needed = 4 * 64 * 64 + 3 * 12 * 5 * 3;
    assert!(read_depth_file(&path, Some("Z"), 1.0, needed).is_ok());
    assert!(matches!(read_depth_file(&path, Some("Z"), 1.0, needed - 1), Err(FormatError::TooLarge { .. })));
}

#[test]
fn camera_files_of_both_kinds_are_the_same_camera() {
    let folder = tempfile::tempdir().unwrap();
    let json = root().join("testdata/positions/court/camera.json");
    let toml = folder.path().join("camera.txt");
    let text = "kind = \"perspective\"\nwidth = 160\nheight = 120\nfov_x_deg = 60\neye = [0.4, -3.2, 4.4]\n\
        v = \"scene_to_eye\"\nforward = [0.05941759110223066, -0.802137479880114, 0.5941759110223066]\nup = [0, 0, 1]\n";
    fs::write(&toml, text).unwrap();
    let [a, b]: [Camera; 2] = [&json, &toml].map(|path| read_camera_file(path).unwrap());
    let axes = |camera: &Camera| [camera.eye, camera.right, camera.up, camera.forward];
    let near = axes(&a).iter().flatten().zip(axes(&b).iter().flatten()).all(|(a, b)| (a - b).abs() < 1e-12);
    assert!(near && a.projection == b.projection, "{a:?} {b:?}");
    fs::write(&toml, text.replace("[0, 0, 1]", "[0, 0, 1")).unwrap();
    let error = read_camera_file(&toml).unwrap_err().to_string();
    assert!(error.contains("camera.txt: is no camera") && error.contains("at line 8"), "{error}");
    assert!(matches!(read_camera_file(&folder.path().join("no.json")), Err(FormatError::Io { .. })));
}
