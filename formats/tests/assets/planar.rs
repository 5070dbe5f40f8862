//! `.exr` and `.ptm`: other readers, headers of the wild, limits of their numbers.

use crate::lopsided::{LIMIT, lopsided};
use half::f16;
use relight_core::relighter::relight;
use relight_core::{CpuLevel, Direction, Layout};
use relight_formats::asset::read_asset;
use relight_texture::Precision;
use std::fs;
use std::path::Path;

#[test]
fn halves_beyond_65504_are_scaled_in_ktx2_and_refused_in_exr() {
    let folder = tempfile::tempdir().unwrap();
    let mut asset = lopsided("hsh", 4, Layout::Grey, (5, 2));
    asset.planes[2][7] = 1e6;
    asset.write_plain(&folder.path().join("a.ktx2"), Precision::F16).unwrap();
    let maps = read_asset(&folder.path().join("a.ktx2"), LIMIT).unwrap();
    assert_eq!((maps.planes[2].scale, maps.coefficient_map().planes[2][7]), (1e6, 1e6));
    let refused = asset.write_plain(&folder.path().join("a.exr"), Precision::F16).unwrap_err().to_string();
    assert!(refused.contains("1000000") && refused.contains("b02_l1m0.Y"), "{refused}");
    assert!(!folder.path().join("a.exr").exists());
}

#[test]
fn another_reader_finds_exr_channels_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    for precision in [Precision::F16, Precision::F32] {
        let asset = lopsided("ptm", 6, Layout::Lrgb, (9, 33));
        asset.write_plain(&path, precision).unwrap();
        let image = exr::prelude::read_first_flat_layer_from_file(&path).unwrap();
        let names = ["b00_uu.Y", "b01_vv.Y", "b02_uv.Y", "b03_u.Y", "b04_v.Y", "b05_1.Y"];
        let names = names.iter().chain(&["base.R", "base.G", "base.B"]);
        let channels = &image.layer_data.channel_data.list;
        assert_eq!(channels.len(), 9);
        for (name, plane) in names.zip(&asset.planes) {
            let channel = channels.iter().find(|channel| channel.name.eq(name)).unwrap();
            let values: Vec<f32> = channel.sample_data.values_as_f32().collect();
            let stored = |c: &f32| match precision {
                Precision::F16 => f16::from_f32(*c).to_f32(),
                _ => *c,
            };
            assert!(values == plane.iter().map(stored).collect::<Vec<_>>(), "{name}");
        }
    }
}

/// A reader of `.ptm` written from FORMATS.md alone: the picture (0..1, top row first) under u, v.
fn picture_of_ptm(bytes: &[u8], u: f64, v: f64) -> Vec<f64> {
    let mut lines = Vec::new();
    let mut at = 0;
    let mut words = 0;
    // Version, format, width, height, 6 scales, 6 biases: 16 words on any number of lines.
    while words < 16 {
        let length = bytes[at..].iter().position(|&b| b == b'\n').unwrap();
        let line = std::str::from_utf8(&bytes[at..at + length]).unwrap();
        words += line.split_whitespace().count();
        lines.extend(line.split_whitespace().map(str::to_owned));
        at += length + 1;
    }
    let number = |i: usize| lines[i].parse::<f64>().unwrap();
    let (width, height) = (number(2) as usize, number(3) as usize);
    let data = &bytes[at..];
    let terms = [u * u, v * v, u * v, u, v, 1.0];
    let sum = |six: &[u8]| {
        (0..6).map(|j| (f64::from(six[j]) - number(10 + j)) * number(4 + j) * terms[j]).sum::<f64>()
    };
    let pixels = width * height;
    let mut picture = Vec::new();
    for row in 0..height {
        for column in 0..width {
            let pixel = (height - 1 - row) * width + column;
            for channel in 0..3 {
                let value = match (lines[0].as_str(), lines[1].as_str()) {
                    (_, "PTM_FORMAT_RGB") => sum(&data[(channel * pixels + pixel) * 6..]),
                    ("PTM_1.2", "PTM_FORMAT_LRGB") => {
                        sum(&data[pixel * 6..]) * f64::from(data[pixels * 6 + pixel * 3 + channel]) / 255.0
                    }
                    ("PTM_1.1", "PTM_FORMAT_LRGB") => {
                        sum(&data[pixel * 9..]) * f64::from(data[pixel * 9 + 6 + channel]) / 255.0
                    }
                    other => panic!("{other:?}"),
                };
                picture.push(value / 255.0);
            }
        }
    }
    picture
}

fn assert_reads_alike(path: &Path) {
    let maps = read_asset(path, LIMIT).unwrap();
    for light in [(0.3, -0.5, 0.8), (-0.7, 0.2, 0.4), (0.0, 0.0, 1.0)] {
        let light = Direction::new(light.0, light.1, light.2).unwrap();
        let expected = picture_of_ptm(&fs::read(path).unwrap(), light.x(), light.y());
        let picture = relight(&maps, light, CpuLevel::BASELINE);
        assert_eq!(picture.samples.len(), expected.len());
        for (i, (a, b)) in picture.samples.iter().zip(expected).enumerate() {
            assert!((f64::from(*a) - b).abs() <= 1e-5 * b.abs().max(1.0), "sample {i}: {a} for {b}");
        }
    }
}

#[test]
fn an_independent_reader_of_ptm_sees_the_same_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ptm");
    for layout in [Layout::Rgb, Layout::Lrgb] {
        let asset = lopsided("ptm", 6, layout, (13, 7));
        asset.write_plain(&path, Precision::U8).unwrap();
        let head = String::from_utf8_lossy(&fs::read(&path).unwrap()[..40]).into_owned();
        let word = if layout == Layout::Rgb { "RGB" } else { "LRGB" };
        assert!(head.starts_with(&format!("PTM_1.2\nPTM_FORMAT_{word}\n13\n7\n")), "{head}");
        assert_reads_alike(&path);
        // And the picture is that of the coefficients that were written.
        let planes = &asset.planes;
        let written = picture_of_ptm(&fs::read(&path).unwrap(), 0.0, 0.0);
        for (i, value) in written.iter().enumerate() {
            let (x, c) = (i / 3, i % 3);
            let expected = match layout {
                Layout::Rgb => planes[15 + c][x],
                _ => planes[5][x] * planes[6 + c][x],
            };
            assert!((value - f64::from(expected)).abs() < 0.03, "{layout:?} {i}: {value} for {expected}");
        }
    }
}

#[test]
fn untidy_ptm_headers_of_the_wild_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ptm");
    let heads = [
        "PTM_1.1\r\nPTM_FORMAT_RGB\r\n4 3\r\n0.5 1.25 1e-1 2.0 1 0.75 \r\n-107 300 128 0 255 12 \r\n",
        "PTM_1.1\nPTM_FORMAT_LRGB\n4 3\n0.5 1.25 0.1 2 1 0.75\n-107 300 128 0 255 12\n",
        "PTM_1.2 \nPTM_FORMAT_LRGB \n4\t\n3\n0.5 1.25 0.1\n2 1 0.75\n-107 300 128\n0 255 12\n",
    ];
    for head in heads {
        let mut bytes = head.as_bytes().to_vec();
        let pixel_bytes = if head.contains("LRGB") { 9 } else { 18 };
        // Blanks and line ends among the first bytes: they are pixels.
        bytes.extend(b" \n\r\t".iter().copied());
        bytes.extend((4..12 * pixel_bytes).map(|i: u32| (i * 37 % 251) as u8));
        fs::write(&path, &bytes).unwrap();
        assert_reads_alike(&path);
        fs::write(&path, &bytes[..bytes.len() - 1]).unwrap();
        let refused = read_asset(&path, LIMIT).unwrap_err().to_string();
        assert!(refused.contains("cut short"), "{refused}");
    }
}
