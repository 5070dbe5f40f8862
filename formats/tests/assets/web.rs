//! Web folders: every kind comes back, what others write is read as its description says, and what can't be
//! read is named.

use crate::lopsided::{LIMIT, Lopsided, PLAIN, lopsided, names_in, replace_in_file};
use relight_core::basis::Learned;
use relight_core::relighter::relight;
use relight_core::sphere::Octahedral;
use relight_core::{Basis, CpuLevel, Direction, Layout, Model, RelightingMaps, Space};
use relight_formats::FormatError;
use relight_formats::asset::{
    AssetFormat, AssetPlan, WriteSettings, describe_asset, read_asset, read_packed, summarize_asset,
};
use relight_texture::{Precision, TexelFormat};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

const BEST: WriteSettings = WriteSettings { jpeg_quality: Some(100), ..PLAIN };

/// Learned functions that eight bits and a few nodes hold, each its own.
fn learned(planes: usize, nodes: usize) -> Learned {
    let square = Octahedral { nodes, hemisphere: true };
    let of_node = |node: usize| {
        let [x, y, z] = square.direction(node).components();
        (0..3 * (planes + 1)).map(move |f| {
            let f = f as f64;
            (0.4 + 0.01 * f * x - 0.2 * y + 0.02 * f * z * y) as f32
        })
    };
    let table = (0..square.count()).flat_map(of_node).collect();
    Learned::new("pca".to_owned(), planes, 3, square, table).unwrap()
}

/// Smooth planes: JPEG at its best keeps them to a code or two. Each is its own.
pub(crate) fn smooth(family: &str, count: usize, layout: Layout, size: (usize, usize)) -> Lopsided {
    let mut asset = lopsided(family, count, layout, size);
    if layout == Layout::Shared {
        asset.model.basis = Basis::Learned(learned(count, 17));
    }
    let maps = asset.model.maps() * layout.planes_per_map();
    for (p, plane) in asset.planes.iter_mut().enumerate() {
        for (i, value) in plane.iter_mut().enumerate() {
            let (x, y) = ((i % size.0) as f32 / size.0 as f32, (i / size.0) as f32 / size.1 as f32);
            let bow = x * (1.1 - y) + 0.03 * p as f32 * x * x;
            *value = if p < maps { (bow - 0.3) * (p + 1) as f32 / 5.0 } else { (bow * 0.4).clamp(0.0, 1.0) };
        }
    }
    asset
}

fn relit(maps: &RelightingMaps, light: Direction) -> Vec<f32> {
    relight(maps, light, CpuLevel::detect()).samples
}

#[test]
fn every_kind_of_folder_comes_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.web");
    for (family, count, layout) in [
        ("ptm", 6, Layout::Rgb),
        ("ptm", 6, Layout::Lrgb),
        ("hsh", 4, Layout::Rgb),
        ("hsh", 9, Layout::Lrgb),
        ("hsh", 16, Layout::Rgb),
        ("sh", 16, Layout::Rgb),
        ("pca", 7, Layout::Shared),
    ] {
        let asset = smooth(family, count, layout, (43, 29));
        let packing = asset.plain(&path, Precision::U8);
        asset.write(&path, &packing, &BEST, 1).unwrap();
        let files: Vec<_> = names_in(&path);
        let once: Vec<_> = files.iter().map(|file| fs::read(path.join(file)).unwrap()).collect();
        let report = asset.write(&path, &packing, &BEST, 2).unwrap();
        let twice: Vec<_> = files.iter().map(|file| fs::read(path.join(file)).unwrap()).collect();
        assert!(once == twice, "the bytes depend on the order of writing");
        let maps = read_asset(&path, LIMIT).unwrap();
        let words = format!("{family} {count} {layout:?}");
        assert_eq!((maps.width, maps.height, maps.model.layout), (43, 29, layout), "{words}");
        assert_eq!(maps.planes.len(), if family == "pca" { 9 } else { asset.planes.len() }, "{words}");
        for (found, expected) in maps.model.lights.iter().zip(&asset.model.lights) {
            assert!(found.angle_to(*expected) < 3e-6, "{words}");
        }
        assert_eq!(maps.model.lights.len(), asset.model.lights.len());
        if family != "pca" {
            assert_eq!(maps.model.basis, asset.model.basis, "{words}");
        }
        for (p, (map, plane)) in maps.planes.iter().zip(&asset.planes).enumerate() {
            let mut back = vec![0.0; plane.len()];
            map.coefficients(0, &mut back);
            let (mut square, mut worst) = (0.0, 0.0f32);
            for (a, b) in back.iter().zip(plane) {
                square += f64::from(a - b).powi(2);
                worst = worst.max((a - b).abs());
            }
            assert!(worst < 5.0 * map.scale / 255.0, "{words} plane {p}: {worst} of {}", map.scale);
            // What storing is said to cost: rounding and JPEG add up as squares, roughly.
            let (found, said) = ((square / plane.len() as f64).sqrt(), report.rmse[p]);
            assert!((0.6..1.4).contains(&(said / found)), "{words} plane {p}: {said} for {found}");
        }
        let header = asset.header(packing);
        let exact = RelightingMaps { model: header.model.clone(), ..exact(&asset) };
        for light in [[0.3, -0.2, 0.9], [-0.5, 0.6, 0.6], [0.0, 0.0, 1.0]] {
            let light = Direction::new(light[0], light[1], light[2]).unwrap();
            let pairs: Vec<_> = relit(&maps, light).into_iter().zip(relit(&exact, light)).collect();
            let square: f64 = pairs.iter().map(|(a, b)| f64::from(a - b).powi(2)).sum();
            let rmse = (square / pairs.len() as f64).sqrt();
            assert!(rmse < 4.0 * report.relit_rmse, "{words}: {rmse}, said {}", report.relit_rmse);
            assert!(report.relit_rmse < 0.05, "{words}: {}", report.relit_rmse);
        }
        let packed = read_packed(&path, LIMIT).unwrap();
        assert_eq!(packed.texels[0][0].len(), maps.planes.len() * 43 * 29);
        let summary = summarize_asset(&path.join("info.json")).unwrap();
        assert_eq!(summary.files.len(), 1 + maps.planes.len().div_ceil(3));
        assert_eq!(summary.file_bytes, once.iter().map(|bytes| bytes.len() as u64).sum::<u64>());
        // Browsers convert planes with a profile.
        assert!(once.iter().all(|bytes| !bytes.windows(11).any(|w| w == b"ICC_PROFILE")));
        fs::remove_dir_all(&path).unwrap();
    }
    assert_eq!(names_in(folder.path()).len(), 0, "temporaries were left behind");
}

/// The asset in floats.
fn exact(asset: &Lopsided) -> RelightingMaps {
    let planes = asset.planes.iter().map(|plane| relight_core::RelightingMap {
        scale: 1.0,
        bias: 0.0,
        texels: relight_core::Texels::F32(plane.clone()),
    });
    let (width, height, model) = (asset.width, asset.height, asset.model.clone());
    RelightingMaps { width, height, model, planes: planes.collect() }
}

/// A folder as another program may write it: one colour a plane, so that JPEG keeps it.
fn write_folder(path: &Path, info: &Value, codes: &[u8]) {
    fs::create_dir_all(path).unwrap();
    fs::write(path.join("info.json"), format!("{info:#}")).unwrap();
    let size = |key: &str| info[key].as_u64().unwrap() as u16;
    for (file, codes) in codes.chunks(3).enumerate() {
        let mut bytes = Vec::new();
        let encoder = jpeg_encoder::Encoder::new(&mut bytes, 100);
        let samples = codes.repeat(usize::from(size("width")) * usize::from(size("height")));
        encoder.encode(&samples, size("width"), size("height"), jpeg_encoder::ColorType::Rgb).unwrap();
        fs::write(path.join(format!("plane_{file}.jpg")), bytes).unwrap();
    }
}

/// Two planes of weights at two lights and what fills up a file.
fn rbf() -> Value {
    json!({
        "width": 9, "height": 5, "format": "jpg", "type": "rbf", "colorspace": "mrgb", "nplanes": 3,
        "quality": 95, "lights": [0.8, 0.0, 0.6, -0.6, 0.0, 0.8], "sigma": 0.3,
        "basis": [51, 102, 153, 25, 50, 75,  191, 127, 63, 127, 127, 159,  127, 255, 127, 0, 127, 127,  127, 127, 127, 127, 127, 127],
        "materials": [{ "range": [64, 128, 1], "scale": [0.5, 2.0, 1.0], "bias": [0.2, 0.5, 0.0] }],
        "anything else": { "is": "ignored" },
    })
}

#[test]
fn folders_of_others_are_read_as_described() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("theirs");
    let codes = [180, 90, 100];
    write_folder(&path, &rbf(), &codes);
    let value = |plane: usize| {
        let material = &rbf()["materials"][0];
        let number = |key: &str| material[key][plane].as_f64().unwrap();
        (f64::from(codes[plane]) / 255.0 - number("bias")) * number("scale")
    };
    let maps = read_asset(&path, LIMIT).unwrap();
    // At the first light: its mean, and its weights 1, 0, -1 of the first plane, 0, 1, 0 of the second.
    let at_light = relit(&maps, Direction::new(0.8, 0.0, 0.6).unwrap());
    let expected = [0.2 + value(0), 0.4 + value(1), 0.6 - value(0)];
    for (found, expected) in at_light.iter().zip(expected.into_iter().cycle()) {
        assert!((f64::from(*found) - expected).abs() < 0.02, "{found} for {expected}");
    }
    // A grid of 3 x 3 whose columns are x + y and whose rows are y - x: +x is the last of the first row.
    let mut info = rbf();
    let mut basis = vec![0; 27];
    basis.extend(vec![127; 81]);
    let (first, nodes) = (27, [2, 8, 6, 0, 4]);
    for (i, node) in nodes.into_iter().enumerate() {
        basis[3 * node] = 10 * (i + 1);
        basis[first + 3 * node + 1] = 127 + 8 * (i + 1);
    }
    info["type"] = json!("bilinear");
    info["resolution"] = json!(3);
    info["basis"] = json!(basis);
    write_folder(&path, &info, &codes);
    let maps = read_asset(&path.join("info.json"), LIMIT).unwrap();
    let lights = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]];
    for (i, [x, y, z]) in lights.into_iter().enumerate() {
        let pixel = relit(&maps, Direction::new(x, y, z).unwrap());
        let weight = 8.0 * (i + 1) as f64 / 64.0;
        for (found, expected) in pixel.iter().zip([10.0 * (i + 1) as f64 / 255.0, weight * value(0), 0.0]) {
            assert!((f64::from(*found) - expected).abs() < 0.005, "light {i}: {found} for {expected}");
        }
    }
    // Spherical harmonics without the phase: that of x is positive.
    let number = |plane: usize| if plane / 3 == 3 { 1.0 } else { 0.0 };
    let scale: Vec<f64> = (0..12).map(number).collect();
    let info = json!({
        "width": 9, "height": 5, "format": "jpg", "type": "sh", "colorspace": "rgb", "nplanes": 12,
        "materials": [{ "scale": scale, "bias": vec![0.0; 12] }],
    });
    fs::remove_dir_all(&path).unwrap();
    write_folder(&path, &info, &[0, 0, 0, 0, 0, 0, 0, 0, 0, 40, 140, 240]);
    let pixel = relit(&read_asset(&path, LIMIT).unwrap(), Direction::new(1.0, 0.0, 0.0).unwrap());
    for (found, code) in pixel.iter().zip([40.0, 140.0, 240.0]) {
        let expected = 0.488_602_511_902_919_9 * code / 255.0;
        assert!((f64::from(*found) - expected).abs() < 0.01, "{found} for {expected}");
    }
    let rows = describe_asset(&path).unwrap();
    assert!(rows.contains(&("type".to_owned(), "sh".to_owned())), "{rows:?}");
}

#[test]
fn descriptions_that_contradict_themselves_are_refused_in_a_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("theirs");
    write_folder(&path, &rbf(), &[180, 90, 100]);
    let info = path.join("info.json");
    let refused = |change: &dyn Fn(&mut Value), words: &str| {
        let mut changed = rbf();
        change(&mut changed);
        fs::write(&info, changed.to_string()).unwrap();
        let error = read_asset(&path, LIMIT).unwrap_err().to_string();
        assert!(error.contains(words) && error.contains("theirs"), "'{words}' is not in: {error}");
        assert!(!error.contains('\n') && !error.contains(". "), "{error}");
        // Sizes of planes show when they are read.
        assert!(describe_asset(&path).is_err() || words.contains("channels"));
    };
    let material =
        |key: &'static str, value: Value| move |info: &mut Value| info["materials"][0][key] = value.clone();
    let set = |key: &'static str, value: Value| move |info: &mut Value| info[key] = value.clone();
    refused(&material("scale", json!([1, 2])), "has 2 scales for 3 planes");
    refused(&material("bias", json!([1, 2, 3, 4])), "has 4 biases for 3 planes");
    refused(&material("range", json!([])), "has 0 ranges for 3 planes");
    refused(&material("scale", json!([1.0, 1e300, 1.0])), "scale 1e300 and bias 5e-1 of plane 1");
    refused(&material("scale", json!([1.0, null, 1.0])), "invalid type: null");
    refused(&material("range", json!([0.0, 1.0, 1.0])), "beyond those of halves");
    refused(&set("basis", json!([1, 2, 3])), "has 3 numbers in basis where 3 planes");
    refused(&set("lights", json!([0, 0, 1, 0])), "has 4 numbers of lights");
    refused(&set("lights", json!([0, 0, 0, 0, 0, 1])), "light 0 (0, 0, 0)");
    refused(&set("lights", json!([])), "has type rbf and no lights");
    refused(&set("sigma", json!(0.0)), "needs a sigma within 1e-4..1e4, has 0e0");
    refused(&set("sigma", Value::Null), "has none");
    refused(&set("type", json!("bilinear")), "needs a resolution within 2..256, has none");
    refused(&set("type", json!("dmd")), "type 'dmd'; relight reads ptm, hsh, sh, rbf and bilinear");
    refused(&set("type", json!("ptm")), "type ptm in colour space mrgb");
    refused(&set("colorspace", json!("mycc")), "'mycc'; relight reads rgb, lrgb and mrgb");
    refused(&set("nplanes", json!(100_000_000_000u64)), "outside 1..363");
    refused(&set("nplanes", Value::Null), "has no number of planes");
    refused(&set("width", json!(0)), "width 0 and height 5 must be within 1..65535");
    refused(&set("height", json!(-5)), "invalid value");
    refused(&set("width", json!(10)), "9 x 5 pixels of 3 channels where 10 x 5 of 3 are needed");
    refused(&set("materials", json!([])), "has 0 materials");
    refused(&set("format", json!("png")), "planes of format 'png'");
    fs::write(&info, rbf().to_string().replace("0.3", "nan")).unwrap();
    let error = read_asset(&path, LIMIT).unwrap_err().to_string();
    assert!(error.contains("does not describe a web folder: expected"), "{error}");
    fs::write(&info, rbf().to_string()).unwrap();
    let needed = read_asset(&path, 1000).unwrap_err();
    assert!(matches!(needed, FormatError::TooLarge { .. }), "{needed}");
    fs::rename(path.join("plane_0.jpg"), path.join("plane_0.tzi")).unwrap();
    let error = read_asset(&path, LIMIT).unwrap_err().to_string();
    assert!(error.contains("plane_0.tzi: holds tiles"), "{error}");
    fs::remove_file(path.join("plane_0.tzi")).unwrap();
    let error = read_asset(&path, LIMIT).unwrap_err().to_string();
    assert!(error.contains("plane_0.jpg: is missing"), "{error}");
    fs::remove_file(&info).unwrap();
    let error = read_asset(&path, LIMIT).unwrap_err().to_string();
    assert!(error.contains("is a folder without info.json"), "{error}");
}

#[test]
fn what_a_folder_cannot_hold_is_refused_and_what_stands_there_stays() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.web");
    let refusal = |change: &dyn Fn(&mut Model), family: &str, count: usize, layout: Layout| {
        let mut asset = lopsided(family, count, layout, (4, 4));
        change(&mut asset.model);
        asset.write_plain(&path, Precision::U8).unwrap_err().to_string()
    };
    let below = |model: &mut Model| model.lights.push(Direction::new(0.8, 0.0, -0.6).unwrap());
    for (words, error) in [
        ("not srbf with 7", refusal(&|_| (), "srbf", 7, Layout::Rgb)),
        ("not ptm with 10", refusal(&|_| (), "ptm", 10, Layout::Rgb)),
        ("not linear", refusal(&|model| model.space = Space::Linear, "ptm", 6, Layout::Rgb)),
        ("three to a file, not 4", refusal(&|_| (), "hsh", 4, Layout::Lrgb)),
        ("layout rgb or lrgb or shared, not grey", refusal(&|_| (), "ptm", 6, Layout::Grey)),
        ("not from below it (z = -0.600)", refusal(&below, "pca", 3, Layout::Shared)),
    ] {
        assert!(error.contains(words), "'{words}' is not in: {error}");
    }
    let asset = smooth("pca", 4, Layout::Shared, (40, 30));
    let packing = asset.plain(&path, Precision::U8);
    let web = AssetFormat::by_name("web").unwrap();
    let formats = [TexelFormat::Plain { precision: Precision::U8, channels: 1 }];
    let plan = AssetPlan { width: 40, height: 30, model: &asset.model, formats: &formats, levels: 1 };
    let held = web.held_bytes(&plan, &PLAIN);
    assert!(held >= 6 * 40 * 30, "{held}");
    let settings = WriteSettings { memory_limit: held - 1, ..PLAIN };
    let error = asset.write(&path, &packing, &settings, 1).unwrap_err();
    assert!(matches!(error, FormatError::TooLarge { .. }), "{error}");
    assert_eq!(names_in(folder.path()).len(), 0);
    asset.write(&path, &packing, &WriteSettings { memory_limit: held, ..PLAIN }, 1).unwrap();
    web.check_writable(&path).unwrap();
    fs::write(path.join("index.html"), "mine").unwrap();
    let before = names_in(&path);
    assert!(web.check_writable(&path).is_err());
    let error = asset.write(&path, &packing, &PLAIN, 1).unwrap_err().to_string();
    assert!(error.contains("holds index.html"), "{error}");
    assert_eq!((names_in(&path), names_in(folder.path()).len()), (before, 1));
    // Its description moved elsewhere is one without planes.
    let alone = folder.path().join("info.json");
    fs::copy(path.join("info.json"), &alone).unwrap();
    let error = read_asset(&alone, LIMIT).unwrap_err().to_string();
    assert!(error.contains("plane_0.jpg: is missing, though info.json has 6 planes"), "{error}");
    replace_in_file(&path.join("info.json"), b"\"jpg\"", b"\"gif\"");
    assert!(read_asset(&path, LIMIT).unwrap_err().to_string().contains("'gif'"));
}
