//! Web folders in tiles: laid out as the Deep Zoom format says, read back, and refused where they are damaged.

use crate::lopsided::{LIMIT, PLAIN, names_in};
use crate::web::smooth;
use relight_core::{CpuLevel, Layout, RelightingMaps, Texels};
use relight_formats::asset::{WriteSettings, read_asset, summarize_asset};
use relight_formats::{FormatError, Samples, decode};
use relight_texture::Precision;
use std::fs;
use std::path::Path;

const TILED: WriteSettings = WriteSettings { jpeg_quality: Some(100), deepzoom: true, ..PLAIN };
const SIZE: (usize, usize) = (530, 301);

fn codes(maps: &RelightingMaps) -> Vec<&[u8]> {
    let texels = maps.planes.iter().map(|plane| &plane.texels);
    texels.map(|texels| if let Texels::U8(codes) = texels { &codes[..] } else { panic!("codes") }).collect()
}

/// Width, height and R, G, B of a tile, by the decoder of pictures.
fn tile(folder: &Path, level: usize, column: usize, row: usize) -> (usize, usize, Vec<u8>) {
    let path = folder.join(format!("plane_0_files/{level}/{column}_{row}.jpg"));
    let picture = decode(&path, CpuLevel::BASELINE, LIMIT).unwrap();
    let Samples::U8(samples) = picture.samples else { panic!("8 bits") };
    (picture.info.width, picture.info.height, samples)
}

#[test]
fn tiles_make_the_plane_and_levels_halve() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.web");
    let asset = smooth("pca", 4, Layout::Shared, SIZE);
    asset.write(&path, &asset.plain(&path, Precision::U8), &TILED, 1).unwrap();
    assert_eq!(
        names_in(&path),
        ["info.json", "plane_0.dzi", "plane_0_files", "plane_1.dzi", "plane_1_files"]
    );
    let xml = fs::read_to_string(path.join("plane_1.dzi")).unwrap();
    for word in ["Format=\"jpg\"", "Overlap=\"1\"", "TileSize=\"254\"", "Width=\"530\"", "Height=\"301\""] {
        assert!(xml.contains(word), "no {word} in {xml}");
    }
    // 3 x 2 tiles, each put where its own 254 x 254 pixels belong: to the right of and below the overlap.
    let maps = read_asset(&path, LIMIT).unwrap();
    let (width, height) = SIZE;
    let mut plane = vec![[0u8; 3]; width * height];
    for (column, across) in [(0, 255), (1, 256), (2, 23)] {
        for (row, down) in [(0, 255), (1, 48)] {
            let (w, h, samples) = tile(&path, 10, column, row);
            assert_eq!((w, h), (across, down), "tile {column}, {row}");
            for y in usize::from(row > 0)..h {
                for x in usize::from(column > 0)..w {
                    let at = |index: usize, own: usize| (index * 254).saturating_sub(1) + own;
                    let pixel = &mut plane[at(row, y) * width + at(column, x)];
                    pixel.copy_from_slice(&samples[3 * (y * w + x)..][..3]);
                }
            }
        }
    }
    for (p, plane_of_asset) in asset.planes.iter().take(3).enumerate() {
        let map = &maps.planes[p];
        for (x, (pixel, value)) in plane.iter().zip(plane_of_asset).enumerate() {
            let seen = map.scale * (f32::from(pixel[p]) / 255.0) + map.bias;
            assert!(
                (seen - value).abs() < 4.0 * map.scale / 255.0,
                "plane {p}, pixel {x}: {seen} for {value}"
            );
            assert!(pixel[p].abs_diff(codes(&maps)[p][x]) < 4, "plane {p}, pixel {x}: the reader differs");
        }
    }
    // Every level is half of the finer one, down to a pixel; smooth planes stay what they are.
    let mut size = SIZE;
    for level in (0..10).rev() {
        size = (size.0.div_ceil(2), size.1.div_ceil(2));
        let files = names_in(&path.join(format!("plane_0_files/{level}")));
        assert_eq!(files.len(), size.0.div_ceil(254) * size.1.div_ceil(254), "level {level}");
        let (w, h, samples) = tile(&path, level, 0, 0);
        assert_eq!((w, h), (size.0.min(255), size.1.min(255)), "level {level}");
        let (x, y) = (w / 2, h / 2);
        let finer = 1 << (10 - level);
        let at = (y * finer + finer / 2).min(height - 1) * width + (x * finer + finer / 2).min(width - 1);
        for channel in 0..3 {
            let [a, b] = [samples[3 * (y * w + x) + channel], plane[at][channel]];
            assert!(a.abs_diff(b) < if level > 5 { 5 } else { 60 }, "level {level}: {a} for {b}");
        }
    }
    assert_eq!(size, (1, 1));
}

#[test]
fn folders_in_tiles_are_read_as_whole_ones_and_replace_one_another() {
    let folder = tempfile::tempdir().unwrap();
    let [whole, tiled] = ["whole.web", "tiled.web"].map(|name| folder.path().join(name));
    for (family, count, layout) in
        [("ptm", 6, Layout::Rgb), ("sh", 9, Layout::Lrgb), ("pca", 5, Layout::Shared)]
    {
        let asset = smooth(family, count, layout, SIZE);
        let packing = asset.plain(&whole, Precision::U8);
        let deepzoom = |deepzoom| WriteSettings { deepzoom, ..TILED };
        asset.write(&whole, &packing, &deepzoom(false), 1).unwrap();
        let report = asset.write(&tiled, &packing, &TILED, 2).unwrap();
        let [a, b] = [&whole, &tiled].map(|path| read_asset(path, LIMIT).unwrap());
        assert_eq!(a.model, b.model, "{family}");
        for (p, (a, b)) in codes(&a).into_iter().zip(codes(&b)).enumerate() {
            let worst = a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).max();
            assert!(worst < Some(8), "{family} plane {p}: {worst:?}");
        }
        assert!(report.relit_rmse < 0.03, "{family}: {}", report.relit_rmse);
        let summary = summarize_asset(&tiled).unwrap();
        assert!(summary.files[1].ends_with("plane_0.dzi"), "{:?}", summary.files);
        let below =
            |path: &Path| -> u64 { walk(path).iter().map(|file| fs::metadata(file).unwrap().len()).sum() };
        assert_eq!(summary.file_bytes, below(&tiled), "{family}");
        // One takes the other's place, and leaves nothing of it.
        asset.write(&tiled, &packing, &deepzoom(false), 1).unwrap();
        assert!(names_in(&tiled) == names_in(&whole));
        asset.write(&tiled, &packing, &TILED, 1).unwrap();
        assert!(!tiled.join("plane_0.jpg").exists());
    }
    let asset = smooth("ptm", 6, Layout::Rgb, (9, 9));
    let packing = asset.plain(&tiled, Precision::U8);
    fs::write(tiled.join("plane_0_files/3/mine.jpg"), "mine").unwrap();
    let error = asset.write(&tiled, &packing, &TILED, 1).unwrap_err().to_string();
    assert!(error.contains("holds plane_0_files/3/mine.jpg, which is no part of an asset"), "{error}");
    assert_eq!(fs::read(tiled.join("plane_0_files/3/mine.jpg")).unwrap(), b"mine");
    let ktx2 = folder.path().join("a.ktx2");
    let settings = WriteSettings { jpeg_quality: None, ..TILED };
    let error = asset.write(&ktx2, &asset.plain(&ktx2, Precision::U8), &settings, 1).unwrap_err().to_string();
    assert!(error.contains("ktx2 holds no tiles of Deep Zoom; write .web"), "{error}");
}

/// All files below `folder`.
fn walk(folder: &Path) -> Vec<std::path::PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries.flat_map(|path| if path.is_dir() { walk(&path) } else { vec![path] }).collect()
}

#[test]
fn damaged_tiles_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.web");
    let asset = smooth("pca", 3, Layout::Shared, (300, 20));
    asset.write(&path, &asset.plain(&path, Precision::U8), &TILED, 1).unwrap();
    let dzi = path.join("plane_0.dzi");
    let xml = fs::read_to_string(&dzi).unwrap();
    let refused = |from: &str, to: &str, words: &str| {
        fs::write(&dzi, xml.replace(from, to)).unwrap();
        let error = read_asset(&path, LIMIT).unwrap_err().to_string();
        assert!(error.contains(words), "'{words}' is not in: {error}");
        // Says something or refuses, and never asks for more memory than a line.
        let _ = summarize_asset(&path);
        fs::write(&dzi, &xml).unwrap();
    };
    refused("254", "0", "needs TileSize within 16..65535, has '0'");
    refused("254", "100", "0_0.jpg");
    refused("\"1\"", "\"128\"", "needs Overlap within 0..127, has '128'");
    refused("Overlap", "Underlap", "needs Overlap within 0..127, has 'none'");
    refused("\"300\"", "\"301\"", "has tiles of 301 x 20 pixels where 300 x 20 are needed");
    refused("\"300\"", "\"99999999999\"", "needs Width within 1..65535");
    refused("jpg", "png", "has tiles of Format 'png'; relight reads jpg");
    let tile = path.join("plane_0_files/9/1_0.jpg");
    let jpeg = fs::read(&tile).unwrap();
    fs::write(&tile, &jpeg[..jpeg.len() / 2]).unwrap();
    assert!(read_asset(&path, LIMIT).is_err());
    fs::remove_file(&tile).unwrap();
    let error = read_asset(&path, LIMIT).unwrap_err();
    assert!(matches!(error, FormatError::Io { .. }) && error.to_string().contains("1_0.jpg"), "{error}");
    fs::write(&tile, &jpeg).unwrap();
    assert!(matches!(read_asset(&path, 30_000).unwrap_err(), FormatError::TooLarge { .. }));
    read_asset(&path, LIMIT).unwrap();
}
