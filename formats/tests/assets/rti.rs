//! `.rti`: another reader by the golden values of its functions, headers of the wild, refusals.

use crate::lopsided::{LIMIT, PLAIN, lopsided};
use relight_core::relighter::relight;
use relight_core::{CpuLevel, Direction, Layout};
use relight_formats::FormatError;
use relight_formats::asset::{describe_asset, read_asset};
use relight_texture::Precision;
use serde_json::Value;
use std::fs;
use std::path::Path;

/// A reader of `.rti` written from FORMATS.md alone: the picture (0..1, top row first) where the functions
/// of light are `weights`.
fn picture_of_rti(bytes: &[u8], weights: &[f64]) -> Vec<f64> {
    let (mut lines, mut at) = (Vec::new(), 0);
    while lines.len() < 3 {
        let length = bytes[at..].iter().position(|&b| b == b'\n').unwrap();
        let line = std::str::from_utf8(&bytes[at..at + length]).unwrap();
        if !line.starts_with('#') {
            lines.push(line.split_whitespace().map(|word| word.parse().unwrap()).collect::<Vec<usize>>());
        }
        at += length + 1;
    }
    assert_eq!((lines[0].as_slice(), lines[1][2], lines[2][2]), (&[3][..], 3, 1));
    let (width, height, terms) = (lines[1][0], lines[1][1], lines[2][0]);
    let float = |i: usize| f64::from(f32::from_le_bytes(bytes[at + 4 * i..][..4].try_into().unwrap()));
    let data = &bytes[at + 8 * terms..];
    let sum = |first: usize| -> f64 {
        let value = |k: usize| f64::from(data[first + k]) / 255.0 * float(k) + float(terms + k);
        (0..terms).map(|k| value(k) * weights[k]).sum()
    };
    let of_pixel = |pixel: usize, channel: usize| match lines[2][1] {
        2 => sum(pixel * 3 * terms + channel * terms),
        1 => sum(pixel * (terms + 3)) * f64::from(data[pixel * (terms + 3) + terms + channel]) / 255.0,
        other => panic!("{other}"),
    };
    assert_eq!(data.len(), width * height * if lines[2][1] == 2 { 3 * terms } else { terms + 3 });
    (0..3 * width * height).map(|i| of_pixel(i / 3, i % 3)).collect()
}

/// Directions and the values of the sixteen functions of `.rti` there.
fn golden() -> Vec<(Direction, Vec<f64>)> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../testdata/golden/hsh_hbasis.json");
    let golden: Value = serde_json::from_slice(&fs::read(file).unwrap()).unwrap();
    let numbers = |list: &Value| -> Vec<f64> {
        let number = |v: &Value| v.as_f64().unwrap_or_else(|| v.as_str().unwrap().parse().unwrap());
        list.as_array().unwrap().iter().map(number).collect()
    };
    let case = |case: &Value| {
        let d = numbers(&case["dir"]);
        (Direction::new(d[0], d[1], d[2]).unwrap(), numbers(&case["hsh_rti"]))
    };
    golden["cases"].as_array().unwrap().iter().map(case).collect()
}

fn assert_reads_alike(path: &Path) {
    let maps = read_asset(path, LIMIT).unwrap();
    for (light, weights) in golden() {
        let expected = picture_of_rti(&fs::read(path).unwrap(), &weights);
        let picture = relight(&maps, light, CpuLevel::BASELINE);
        assert_eq!(picture.samples.len(), expected.len());
        for (i, (a, b)) in picture.samples.iter().zip(expected).enumerate() {
            assert!((f64::from(*a) - b).abs() <= 1e-5 * b.abs().max(1.0), "{light:?} {i}: {a} for {b}");
        }
    }
}

#[test]
fn an_independent_reader_of_rti_sees_the_same_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rti");
    for (terms, layout) in [4, 9, 16].into_iter().flat_map(|t| [Layout::Rgb, Layout::Lrgb].map(|l| (t, l))) {
        let asset = lopsided("hsh", terms, layout, (13, 7));
        asset.write_plain(&path, Precision::U8).unwrap();
        let basis_type = if layout == Layout::Rgb { 2 } else { 1 };
        let head = format!("#HSH1.2\n3\n13 7 3\n{terms} {basis_type} 1\n");
        let bytes = fs::read(&path).unwrap();
        assert!(bytes.starts_with(head.as_bytes()), "{}", String::from_utf8_lossy(&bytes[..40]));
        assert_reads_alike(&path);
        // And the picture is that of the coefficients that were written: one function at a time.
        for function in 0..terms {
            let mut weights = vec![0.0; terms];
            weights[function] = 1.0;
            for (i, value) in picture_of_rti(&bytes, &weights).into_iter().enumerate() {
                let (pixel, channel) = (i / 3, i % 3);
                let (expected, steps) = match layout {
                    Layout::Rgb => (asset.planes[3 * function + channel][pixel], 1.0),
                    _ => (asset.planes[function][pixel] * asset.planes[terms + channel][pixel], 2.0),
                };
                // Half a step of the widest range, that of the last function.
                let step = asset.planes.len() as f64 / 3.0 / 255.0 * 0.51 * steps;
                assert!(
                    (value - f64::from(expected)).abs() <= step,
                    "{function} {i}: {value} for {expected}"
                );
            }
        }
    }
}

#[test]
fn untidy_rti_headers_of_the_wild_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rti");
    let mut body: Vec<u8> = Vec::new();
    for term in 0..4 {
        body.extend((1.5f32 + term as f32).to_le_bytes());
    }
    for term in 0..4 {
        // 0x0a and '#' among the bytes of the first bias.
        body.extend(if term == 0 {
            [0x0a, 0x23, 0x0d, 0x3f]
        } else {
            (-0.25f32 * term as f32).to_le_bytes()
        });
    }
    let pixels = |bytes: usize| (0..6 * bytes).map(|i| (i * 37 % 251) as u8).collect::<Vec<u8>>();
    for (head, pixel_bytes) in [
        ("#HSH1.2\n3\n3 2 3\n4 2 1\n", 12),
        ("#HSH1.2\r\n# made by hand \r\n#\r\n3\r\n3 2 3\r\n4 2 1\r\n", 12),
        ("#HSH1.2\n#a\n#b\n3 \n# between\n3 2 3 \n4 1 1 \n", 7),
    ] {
        let bytes = [head.as_bytes(), &body, &pixels(pixel_bytes)].concat();
        fs::write(&path, &bytes).unwrap();
        assert_reads_alike(&path);
        assert!(describe_asset(&path).unwrap().iter().any(|row| row == &("version".into(), "HSH1.2".into())));
        for length in (0..bytes.len()).step_by(3).chain([bytes.len() - 1]) {
            fs::write(&path, &bytes[..length]).unwrap();
            assert!(read_asset(&path, LIMIT).is_err(), "{length} bytes of {}", bytes.len());
        }
    }
}

#[test]
fn what_is_not_read_of_rti_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rti");
    let refusal = |head: &str, scale: f32| {
        let numbers = [1.0, 1.0, scale, 1.0, 0.0, 0.0, 0.0, 0.0].map(f32::to_le_bytes).concat();
        fs::write(&path, [head.as_bytes(), &numbers, &[7; 12 * 6]].concat()).unwrap();
        read_asset(&path, LIMIT).unwrap_err()
    };
    for (head, words) in [
        ("#HSH1.2\n1\n3 2 3\n6 2 1\n", "holds PTM (kind 1); relight reads hemispherical harmonics (3)"),
        ("#HSH1.2\n2\n3 2 3\n9 2 1\n", "holds spherical harmonics (kind 2)"),
        ("#HSH1.2\n4\n3 2 3\n9 2 1\n", "holds an adaptive basis (kind 4)"),
        ("#HSH1.1\n3\n3 2 3\n4 2 1\n", "is of version #HSH1.1; relight reads #HSH1.2"),
        ("#HSH1.2\n3\n3 2 3\n25 2 1\n", "has 25 terms; relight reads 4, 9 and 16"),
        ("#HSH1.2\n3\n3 2 3\n4 0 1\n", "has basis type 0; relight reads 1 (LRGB) and 2 (RGB)"),
        ("#HSH1.2\n3\n3 2 3\n4 2 4\n", "has elements of 4 bytes; relight reads those of 1"),
    ] {
        let refused = refusal(head, 1.0);
        assert!(matches!(refused, FormatError::Unsupported { .. }), "{refused}");
        assert!(refused.to_string().contains(words), "{refused}");
    }
    for (head, scale, words) in [
        ("#HSH1.2\n5\n3 2 3\n4 2 1\n", 1.0, "its kind '5' in its header is outside 1..4"),
        ("#HSH1.2\n3\n3 2 1\n4 2 1\n", 1.0, "its number of channels '1' in its header is outside 3..3"),
        ("#HSH1.2\n3\n0 2 3\n4 2 1\n", 1.0, "width '0' in its header is outside 1.."),
        ("#HSH1.2\n3\n3 2 3\n4 2 1 ", 1.0, "does not end with a line of terms"),
        ("#HSH1.2\n3\n3 3 3\n4 2 1\n", 1.0, "is cut short: 3 x 3 pixels of 12 bytes in 72 bytes"),
        ("#HSH1.2\n3\n4294967295 4294967295 3\n4 2 1\n", 1.0, "is cut short"),
        ("#HSH1.2\n3\n3 2 3\n4 2 1\n", f32::NAN, "term 2 has scale NaN and bias 0, which must be finite"),
    ] {
        let refused = refusal(head, scale);
        assert!(matches!(refused, FormatError::Invalid { .. }), "{refused}");
        assert!(refused.to_string().contains(words), "{refused}");
    }
    let refusal = |family: &str, count: usize, space| {
        let mut asset = lopsided(family, count, Layout::Rgb, (2, 2));
        asset.model.space = space;
        asset.write_plain(&path, Precision::U8).unwrap_err().to_string()
    };
    let words = refusal("ptm", 6, relight_core::Space::Encoded);
    assert!(words.contains("basis hsh with 4, 9 or 16 functions, not ptm with 6"), "{words}");
    assert!(refusal("hsh", 1, relight_core::Space::Encoded).contains("not hsh with 1"));
    assert!(refusal("hsh", 9, relight_core::Space::Linear).contains("encoded space, not linear"));
    let mut asset = lopsided("hsh", 4, Layout::Lrgb, (2, 2));
    asset.planes[5][1] = 1.5;
    let refused = asset.write(&path, &asset.plain(&path, Precision::U8), &PLAIN, 1).unwrap_err().to_string();
    assert!(refused.contains("base colours 0"), "{refused}");
}
