//! Every format, layout, texel format and way of storing comes back.

use crate::lopsided::{LAYOUTS, LIMIT, Lopsided, PLAIN, PRECISIONS, basis_of, layer_of, lopsided, names_in};
use relight_core::{Layout, RelightingMaps, Texels};
use relight_formats::asset::{ASSET_FORMATS, AssetPlan, WriteSettings, read_asset, read_packed};
use relight_texture::{BlockFormat, PackedMaps, Precision, TexelFormat, decode_channel, full_levels};
use std::fs;
use std::path::{Path, PathBuf};

fn bits(texels: &Texels) -> Vec<u32> {
    match texels {
        Texels::U8(codes) => codes.iter().map(|&code| u32::from(code)).collect(),
        Texels::F16(halves) => halves.iter().map(|half| u32::from(half.to_bits())).collect(),
        Texels::F32(floats) => floats.iter().map(|float| float.to_bits()).collect(),
    }
}

#[test]
fn every_format_layout_and_precision_comes_back() {
    let folder = tempfile::tempdir().unwrap();
    let mut tried = 0;
    // What is always in JPEG has tests of its own.
    for format in ASSET_FORMATS.iter().filter(|format| !format.folder) {
        let (family, count) = basis_of(format.name);
        for (layout, precision) in LAYOUTS.iter().flat_map(|l| PRECISIONS.map(|p| (*l, p))) {
            for size in [(1, 1), (3, 5), (4097, 1), (257, 130)] {
                let asset = lopsided(family, count, layout, size);
                let path = folder.path().join(format!("asset.{}", format.extension));
                let formats = [format.plain_format(layout, precision)];
                let ((width, height), model) = (size, &asset.model);
                let plan = AssetPlan { width, height, model, formats: &formats, levels: 1 };
                if format.check(&path, &plan, &PLAIN).is_err() {
                    continue;
                }
                tried += 1;
                let packing = asset.packing(formats[0], 1);
                let report = asset.write(&path, &packing, &PLAIN, 1).unwrap();
                let once = fs::read(&path).unwrap();
                let maps = read_asset(&path, LIMIT).unwrap();
                check(&asset, &maps, precision, format.name);
                check_report(&asset, &maps, &report.rmse);
                asset.write(&path, &packing, &PLAIN, 2).unwrap();
                assert!(fs::read(&path).unwrap() == once, "the bytes depend on the order of writing");
            }
        }
    }
    assert_eq!(tried, 4 * (12 + 12 + 8 + 2 + 2));
    assert_eq!(names_in(folder.path()).len(), 6, "temporaries were left behind");
}

/// Codes are those of the quantizer, whatever carried them.
fn check(asset: &Lopsided, maps: &RelightingMaps, precision: Precision, format: &str) {
    // One scale and bias for the three channels, and nothing about lights.
    let of_rti_tools = format == "ptm" || format == "rti";
    let mut expected = asset.model.clone();
    if of_rti_tools {
        (expected.lights, expected.figures) = (Vec::new(), None);
    }
    assert_eq!((maps.width, maps.height, &maps.model), (asset.width, asset.height, &expected));
    assert_eq!(maps.planes.len(), asset.planes.len());
    for (p, (map, plane)) in maps.planes.iter().zip(&asset.planes).enumerate() {
        let words = format!(
            "{format} {:?} {precision:?} {}x{} plane {p}",
            expected.layout, asset.width, asset.height
        );
        if of_rti_tools {
            let mut coefficients = vec![0.0; plane.len()];
            map.coefficients(0, &mut coefficients);
            for (a, b) in coefficients.iter().zip(plane) {
                assert!((a - b).abs() <= 0.51 * map.scale / 255.0, "{words}: {a} for {b}");
            }
            continue;
        }
        let quantizer = precision.quantizer(asset.range(p));
        assert_eq!((map.scale, map.bias), (quantizer.scale, quantizer.bias), "{words}");
        let texels = match precision {
            Precision::U8 => Texels::U8(plane.iter().map(|&c| quantizer.code(c)).collect()),
            Precision::F16 => Texels::F16(plane.iter().map(|&c| quantizer.half(c)).collect()),
            Precision::F32 => Texels::F32(plane.clone()),
        };
        assert!(bits(&map.texels) == bits(&texels), "{words}");
    }
}

/// What storing is said to have cost is the difference between what went in and what comes out.
fn check_report(asset: &Lopsided, maps: &RelightingMaps, rmse: &[f64]) {
    assert_eq!(rmse.len(), asset.planes.len());
    for ((map, plane), rmse) in maps.planes.iter().zip(&asset.planes).zip(rmse) {
        let mut back = vec![0.0; plane.len()];
        map.coefficients(0, &mut back);
        let squares: f64 = back.iter().zip(plane).map(|(a, b)| f64::from(a - b).powi(2)).sum();
        let expected = (squares / plane.len() as f64).sqrt();
        assert!((rmse - expected).abs() <= 1e-6 * expected, "{rmse} for {expected}");
    }
}

/// Plain and block formats of one channel and of several.
fn texel_formats() -> Vec<TexelFormat> {
    let plain = |precision, channels| TexelFormat::Plain { precision, channels };
    let plain = [plain(Precision::U8, 4), plain(Precision::F16, 1), plain(Precision::F32, 4)];
    plain.into_iter().chain(BlockFormat::all().map(TexelFormat::Block)).collect()
}

/// The maps that level 0 of `packed` holds.
fn decoded(packed: &PackedMaps) -> Vec<(usize, (f32, f32), Texels)> {
    let (width, height) = (packed.width, packed.height);
    let mut planes = Vec::new();
    for (plan, levels) in packed.packing.arrays.iter().zip(&packed.texels) {
        for (index, layer) in plan.layers.iter().enumerate() {
            let bytes = layer_of(&levels[0], plan.layers.len(), index);
            for (channel, (&plane, q)) in layer.planes.iter().zip(&layer.quantizers).enumerate() {
                let texels = match plan.format {
                    TexelFormat::Block(format) => decode_channel(format, bytes, width, height, channel),
                    TexelFormat::Plain { precision, channels } => {
                        let size = precision.bytes();
                        let texels = bytes.chunks(channels * size).map(|t| &t[channel * size..][..size]);
                        match precision {
                            Precision::U8 => Texels::U8(texels.map(|t| t[0]).collect()),
                            Precision::F16 => {
                                Texels::F16(texels.map(|t| half::f16::from_le_bytes([t[0], t[1]])).collect())
                            }
                            Precision::F32 => Texels::F32(
                                texels.map(|t| f32::from_le_bytes(t.try_into().unwrap())).collect(),
                            ),
                        }
                    }
                };
                planes.push((plane, (q.scale, q.bias), texels));
            }
        }
    }
    planes.sort_by_key(|(plane, ..)| *plane);
    planes
}

/// All files beside `path`, itself included.
fn files_beside(path: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let folder = path.parent().unwrap();
    let files = names_in(folder).into_iter().map(|name| folder.join(name));
    files.map(|file| (file.clone(), fs::read(file).unwrap())).collect()
}

/// Writes it as `extension`, reads it packed, which is to be `expected`, and as maps, by its first
/// file and by its manifest, and writes it again in another order; gives the number of files.
fn trip(asset: &Lopsided, extension: &str, expected: &PackedMaps, settings: &WriteSettings) -> usize {
    let packing = &expected.packing;
    let words = format!(
        "{extension} {:?} {}x{} {:?} levels {} zstd {:?} split {}",
        asset.model.layout,
        asset.width,
        asset.height,
        packing.formats().map(TexelFormat::name).collect::<Vec<_>>(),
        packing.levels,
        settings.zstd,
        settings.split
    );
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(format!("relief.of.a.coin.{extension}"));
    asset.write(&path, packing, settings, 5).unwrap();
    let packed = read_packed(&path, LIMIT).unwrap();
    assert!(packed == *expected, "{words}");
    let maps = read_asset(&path, LIMIT).unwrap();
    let decoded = decoded(expected);
    assert_eq!(maps.planes.len(), decoded.len());
    for (map, (plane, scale_bias, texels)) in maps.planes.iter().zip(decoded) {
        assert_eq!((map.scale, map.bias), scale_bias, "{words} plane {plane}");
        assert!(bits(&map.texels) == bits(&texels), "{words} plane {plane}");
    }
    let files = files_beside(&path);
    for (manifest, _) in files.iter().filter(|(path, _)| path.extension().unwrap() == "json") {
        assert!(read_packed(manifest, LIMIT).unwrap() == packed, "{words} by its manifest");
    }
    asset.write(&path, packing, settings, 6).unwrap();
    assert!(files_beside(&path) == files, "{words}: bytes differ the second time");
    files.len()
}

#[test]
fn every_texel_format_comes_back_from_every_container_with_levels_split_and_compressed() {
    let pictures =
        [(Layout::Rgb, (23, 9)), (Layout::Lrgb, (3, 5)), (Layout::Grey, (1, 1)), (Layout::Grey, (4097, 1))];
    for (format, (layout, size)) in texel_formats().into_iter().flat_map(|f| pictures.map(|p| (f, p))) {
        let asset = lopsided("ptm", 6, layout, size);
        for levels in [1, full_levels(size.0, size.1)] {
            let expected = asset.packed(&asset.packing(format, levels), PLAIN.coding);
            let layers = expected.packing.layers();
            for (split, zstd) in [(false, None), (true, None), (false, Some(3)), (true, Some(3))] {
                let textures = if split { layers } else { 1 };
                let settings = WriteSettings { split, zstd, ..PLAIN };
                assert_eq!(trip(&asset, "ktx2", &expected, &settings), textures + usize::from(split));
                if zstd.is_none() {
                    assert_eq!(trip(&asset, "dds", &expected, &settings), textures + 1);
                }
            }
        }
    }
}

#[test]
fn arrays_of_several_formats_come_back_from_files_of_their_own() {
    let block = TexelFormat::Block;
    let plain = TexelFormat::Plain { precision: Precision::U8, channels: 4 };
    let formats = [block(BlockFormat::Bc1), block(BlockFormat::Bc7), plain];
    for layout in LAYOUTS {
        let asset = lopsided("srbf", 10, layout, (13, 22));
        let expected = asset.packed(&asset.packing_of_several(&formats, 3), PLAIN.coding);
        let settings = |split, zstd| WriteSettings { split, zstd, ..PLAIN };
        let layers = expected.packing.layers();
        assert_eq!(trip(&asset, "ktx2", &expected, &settings(false, None)), 3);
        assert_eq!(trip(&asset, "ktx2", &expected, &settings(false, Some(19))), 3);
        assert_eq!(trip(&asset, "ktx2", &expected, &settings(true, None)), layers + 1);
        assert_eq!(trip(&asset, "dds", &expected, &settings(false, None)), 3 + 1);
        assert_eq!(trip(&asset, "dds", &expected, &settings(true, None)), layers + 1);
    }
}

#[test]
fn planes_one_by_one_are_packed_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    for (name, (family, count), precision) in [
        ("a.exr", ("ptm", 6), Precision::F16),
        ("a.exr", ("srbf", 6), Precision::F32),
        ("a.ptm", ("ptm", 6), Precision::U8),
        ("a.rti", ("hsh", 4), Precision::U8),
    ] {
        let path = folder.path().join(name);
        let asset = lopsided(family, count, Layout::Lrgb, (13, 5));
        asset.write_plain(&path, precision).unwrap();
        let (packed, maps) = (read_packed(&path, LIMIT).unwrap(), read_asset(&path, LIMIT).unwrap());
        assert_eq!(packed.packing.levels, 1);
        let decoded = decoded(&packed);
        assert_eq!(decoded.len(), count + 3);
        for (map, (plane, scale_bias, texels)) in maps.planes.iter().zip(decoded) {
            assert_eq!((map.scale, map.bias), scale_bias, "{name} plane {plane}");
            assert!(bits(&map.texels) == bits(&texels), "{name} plane {plane}");
        }
    }
}
