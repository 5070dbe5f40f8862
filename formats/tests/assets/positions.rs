//! Positions in assets: every container, every precision, and what reads them.

use crate::lopsided::{LIMIT, Lopsided, PLAIN, lopsided, names_in, replace_in_file};
use relight_core::{Layout, NO_SURFACE, PointKind, PositionMap};
use relight_formats::asset::{
    ASSET_FORMATS, AssetFormat, AssetPositions, WriteSettings, describe_asset, read_asset, read_packed,
    read_positions, summarize_asset,
};
use relight_formats::{FormatError, read_position_file};
use relight_texture::{Packing, Precision, TexelFormat};
use std::fs;
use std::path::Path;

const SIZE: (usize, usize) = (23, 37);

/// A point of its own in every pixel of a lopsided box from (-3, 100, 7) to (5, 101, 7.25), sky in
/// a corner and holes here and there.
fn map((width, height): (usize, usize)) -> PositionMap {
    let point = |i: usize| {
        let unit = |step: usize| ((i * step) % 1009) as f32 / 1008.0;
        match i {
            0 => [-3.0, 100.0, 7.0],
            1 => [5.0, 101.0, 7.25],
            2 => [-6e14, 0.0, 8e14],
            _ if i % 13 == 5 => NO_SURFACE,
            _ => [-3.0 + 8.0 * unit(701), 100.0 + unit(37), 7.0 + 0.25 * unit(331)],
        }
    };
    PositionMap { width, height, points: (0..width * height).map(point).collect() }
}

/// Writes `asset` with `map`.
pub(crate) fn write(
    asset: &Lopsided,
    path: &Path,
    packing: &Packing,
    settings: &WriteSettings,
    precision: Precision,
) -> Result<(), FormatError> {
    let format = AssetFormat::by_path(path)?;
    let positions = AssetPositions { map: map((asset.width, asset.height)), precision };
    let header = asset.header(packing.clone());
    let writer = format.create_with_positions(path, header, settings, Some(positions))?;
    asset.fill(&*writer, packing, 3)?;
    writer.finish()?;
    Ok(())
}

/// Fails unless `found` is `expected`, surface points within `allowed` of each axis' edge of the box.
fn assert_near(found: &PositionMap, expected: &PositionMap, allowed: f32) {
    assert_eq!((found.width, found.height), (expected.width, expected.height));
    for (i, (found, expected)) in found.points.iter().zip(&expected.points).enumerate() {
        assert_eq!(PointKind::of(*found), PointKind::of(*expected), "pixel {i}: {found:?} {expected:?}");
        match PointKind::of(*expected) {
            PointKind::Surface => {
                let near = |axis: usize| {
                    let (edge, rounding) = ([8.0, 1.0, 0.25][axis], 1e-7 * expected[axis].abs());
                    let rounding = if allowed == 0.0 { 0.0 } else { rounding };
                    (found[axis] - expected[axis]).abs() <= allowed * edge + rounding
                };
                assert!((0..3).all(near), "pixel {i}: {found:?} {expected:?}");
            }
            // 2^-11 of a radian is what halves know of a direction.
            PointKind::Sky => {
                let near = |axis: usize| (found[axis] - expected[axis]).abs() <= 1e15 / 2048.0;
                assert!((0..3).all(near), "pixel {i}: {found:?} {expected:?}");
            }
            PointKind::Missing => assert!(found.iter().all(|c| c.is_nan())),
        }
    }
}

#[test]
fn positions_come_back_from_every_format_that_holds_them() {
    // More points than are read or written at once, and fewer.
    let large = lopsided("ptm", 6, Layout::Rgb, (150, 131));
    let small = lopsided("ptm", 6, Layout::Rgb, SIZE);
    for format in &ASSET_FORMATS {
        for &precision in format.positions {
            for (split, zstd, levels) in
                [(false, None, 1), (true, None, 6), (false, Some(3), 6), (true, Some(1), 1)]
            {
                if (split || levels > 1) && !format.textures || zstd.is_some() && !format.zstd {
                    continue;
                }
                let asset = if levels == 1 { &large } else { &small };
                let map = map((asset.width, asset.height));
                let folder = tempfile::tempdir().unwrap();
                let path = folder.path().join(format!("a.{}", format.extension));
                let texels = format.plain_format(Layout::Rgb, Precision::F16);
                let packing = asset.packing(texels, levels);
                let settings = WriteSettings { split, zstd, ..PLAIN };
                write(asset, &path, &packing, &settings, precision).unwrap();
                let found = read_positions(&path, LIMIT).unwrap().unwrap();
                let allowed = if precision == Precision::F16 { 0.5 / 4096.0 } else { 0.0 };
                assert_near(&found, &map, allowed);
                // Half a step is needed somewhere: halves are halves.
                let exact = found.points[..2] == map.points[..2] && found.points[6..9] == map.points[6..9];
                assert_eq!(exact, precision == Precision::F32);
                let plan = summarize_asset(&path).unwrap().positions.unwrap();
                assert_eq!(plan.precision, precision);
                let rows = describe_asset(&path).unwrap();
                let row = rows.iter().find(|(name, _)| name == "positions").unwrap();
                assert!(row.1.starts_with(precision.name()), "{row:?}");
            }
        }
    }
}

#[test]
fn planes_are_what_they_are_without_positions_and_are_read_without_them() {
    let asset = lopsided("ptm", 6, Layout::Lrgb, SIZE);
    for (name, precision) in
        [("a.ktx2", Precision::F16), ("a.dds", Precision::F32), ("a.exr", Precision::F32)]
    {
        let [with, without] = [0, 1].map(|_| tempfile::tempdir().unwrap());
        let [path, bare] = [&with, &without].map(|folder| folder.path().join(name));
        let packing = asset.plain(&path, Precision::F16);
        write(&asset, &path, &packing, &PLAIN, precision).unwrap();
        asset.write(&bare, &packing, &PLAIN, 3).unwrap();
        assert!(read_positions(&bare, LIMIT).unwrap().is_none());
        assert!(summarize_asset(&bare).unwrap().positions.is_none());
        let (maps, packed) = (read_asset(&path, LIMIT).unwrap(), read_packed(&path, LIMIT).unwrap());
        assert_eq!(maps, read_asset(&bare, LIMIT).unwrap());
        assert_eq!(packed, read_packed(&bare, LIMIT).unwrap());
        // Nothing but positions is in their file: all else is read without it.
        let Some(file) = names_in(with.path()).into_iter().find(|file| file.contains("_positions")) else {
            assert_eq!(name, "a.exr");
            continue;
        };
        fs::remove_file(with.path().join(&file)).unwrap();
        assert_eq!(read_asset(&path, LIMIT).unwrap(), maps);
        assert_eq!(read_packed(&path, LIMIT).unwrap(), packed);
        let missing = read_positions(&path, LIMIT).unwrap_err().to_string();
        assert!(missing.contains(&file) && missing.contains("is missing beside it"), "{missing}");
    }
}

#[test]
fn the_files_of_an_asset_are_those_announced_and_belong_together() {
    let asset = lopsided("ptm", 6, Layout::Grey, SIZE);
    let names = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>();
    let cases = [
        ("a.ktx2", false, names(&["a.ktx2", "a_positions.ktx2"])),
        ("a.dds", false, names(&["a.dds", "a_positions.dds", "a.json"])),
        (
            "a.dds",
            true,
            names(&[
                "a.dds",
                "a_1.dds",
                "a_2.dds",
                "a_3.dds",
                "a_4.dds",
                "a_5.dds",
                "a_positions.dds",
                "a.json",
            ]),
        ),
        ("a.exr", false, names(&["a.exr"])),
    ];
    for (name, split, mut expected) in cases {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        let format = AssetFormat::by_path(&path).unwrap();
        let packing = asset.plain(&path, Precision::F16);
        let settings = WriteSettings { split, ..PLAIN };
        let parts = relight_formats::Parts { split, positions: true };
        let announced = format.outputs(&path, &packing, parts).unwrap();
        let announced: Vec<_> =
            announced.iter().map(|path| path.file_name().unwrap().to_str().unwrap()).collect();
        assert_eq!(announced, expected);
        let precision = *format.positions.last().unwrap();
        write(&asset, &path, &packing, &settings, precision).unwrap();
        let bytes = |names: &[String]| -> Vec<Vec<u8>> {
            names.iter().map(|name| fs::read(folder.path().join(name)).unwrap()).collect()
        };
        let summary = summarize_asset(&path).unwrap();
        assert_eq!(summary.files.len(), expected.len());
        let total: usize = bytes(&expected).iter().map(Vec::len).sum();
        assert_eq!(summary.file_bytes, total as u64);
        expected.sort();
        assert_eq!(names_in(folder.path()), expected);
        // Written again over itself, in another order: the same bytes.
        let before = bytes(&expected);
        write(&asset, &path, &packing, &settings, precision).unwrap();
        assert_eq!(bytes(&expected), before);
        if let Some(part) = expected.iter().find(|name| name.contains("_positions")) {
            let alone = describe_asset(&folder.path().join(part)).unwrap_err().to_string();
            assert!(alone.contains("of an asset; name "), "{alone}");
        }
    }
}

#[test]
fn texels_are_what_engines_expect() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ktx2");
    let asset = lopsided("ptm", 6, Layout::Rgb, SIZE);
    write(&asset, &path, &asset.plain(&path, Precision::U8), &PLAIN, Precision::F16).unwrap();
    let bytes = fs::read(folder.path().join("a_positions.ktx2")).unwrap();
    let reader = ktx2_words(&bytes);
    // R16G16B16A16_SFLOAT, no array, one level.
    assert_eq!((reader[0], reader[5], reader[7]), (97, 0, 1));
    assert_eq!((reader[2], reader[3]), (SIZE.0 as u32, SIZE.1 as u32));
    let start = u64::from_le_bytes(bytes[80..88].try_into().unwrap()) as usize;
    let texel = |i: usize| {
        let half = |c: usize| {
            let at = start + 8 * i + 2 * c;
            half::f16::from_le_bytes([bytes[at], bytes[at + 1]]).to_f32()
        };
        [half(0), half(1), half(2), half(3)]
    };
    // The box's middle is (1, 100.5, 7.125), half its longest edge 4.
    assert_eq!(texel(0), [-1.0, -0.125, -0.03125, 1.0]);
    assert_eq!(texel(1), [1.0, 0.125, 0.03125, 1.0]);
    assert_eq!(texel(2), [-49120.0, 0.0, 65504.0, 1.0]);
    assert_eq!(texel(5), [0.0; 4]);
    let text = String::from_utf8_lossy(&fs::read(&path).unwrap()).into_owned();
    let record = "\"positions\":{\"format\":\"f16\",\"files\":[\"a_positions.ktx2\"],\"scale\":[4.0,4.0,4.0],\"bias\":[1.0,100.5,7.125]}";
    assert!(text.contains(record), "{text}");
}

/// The words of a KTX2 header after its magic.
fn ktx2_words(bytes: &[u8]) -> Vec<u32> {
    bytes[12..48].chunks_exact(4).map(|word| u32::from_le_bytes(word.try_into().unwrap())).collect()
}

#[test]
fn an_exr_asset_is_a_position_file_too() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    // Wider than high, with rows that end within a block.
    let asset = lopsided("ptm", 6, Layout::Lrgb, (37, 23));
    write(&asset, &path, &asset.plain(&path, Precision::F16), &PLAIN, Precision::F32).unwrap();
    assert_near(&read_position_file(&path, LIMIT).unwrap(), &map((37, 23)), 0.0);
}

#[test]
fn what_does_not_fit_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let asset = lopsided("ptm", 6, Layout::Rgb, SIZE);
    let refused = |name: &str, map: PositionMap, precision, memory_limit| {
        let path = folder.path().join(name);
        let format = AssetFormat::by_path(&path).unwrap();
        let header = asset.header(asset.plain(&path, *format.precisions.last().unwrap()));
        let settings = WriteSettings { memory_limit, ..PLAIN };
        let positions = Some(AssetPositions { map, precision });
        let error = format.create_with_positions(&path, header, &settings, positions).err().unwrap();
        assert_eq!(names_in(folder.path()), Vec::<String>::new());
        error
    };
    let ptm = refused("a.ptm", map(SIZE), Precision::F32, LIMIT);
    assert!(matches!(ptm, FormatError::Unsupported { .. }));
    assert!(ptm.to_string().contains("ptm holds no positions; write .ktx2, .dds or .exr"), "{ptm}");
    let half = refused("a.exr", map(SIZE), Precision::F16, LIMIT).to_string();
    assert!(half.contains("exr holds positions as f32, not f16"), "{half}");
    let codes = refused("a.dds", map(SIZE), Precision::U8, LIMIT).to_string();
    assert!(codes.contains("dds holds positions as f16 or f32, not u8"), "{codes}");
    for name in ["a.ktx2", "a.exr"] {
        let size = refused(name, map((37, 23)), Precision::F32, LIMIT).to_string();
        assert!(size.contains("positions are 37 x 23 where its pictures are 23 x 37"), "{size}");
    }
    // 18 float planes alone would fit.
    let planes = 23 * 37 * 18 * 4;
    let large = refused("a.exr", map(SIZE), Precision::F32, planes + 12 * 23 * 37 - 1);
    assert!(matches!(large, FormatError::TooLarge { .. }), "{large}");
}

#[test]
fn positions_of_another_asset_or_shape_are_refused() {
    let [folder, other] = [0, 1].map(|_| tempfile::tempdir().unwrap());
    let path = folder.path().join("a.ktx2");
    let asset = lopsided("ptm", 6, Layout::Rgb, SIZE);
    let packing = asset.packing(TexelFormat::Plain { precision: Precision::U8, channels: 4 }, 6);
    write(&asset, &path, &packing, &PLAIN, Precision::F16).unwrap();
    let limit = 12 * 23 * 37;
    assert!(read_positions(&path, limit).is_ok());
    assert!(matches!(read_positions(&path, limit - 1), Err(FormatError::TooLarge { .. })));
    let words = |path: &Path| read_positions(path, LIMIT).unwrap_err().to_string();
    let document = fs::read(&path).unwrap();
    // The first of equal length, then nothing that fits the texels that are there.
    for (what, with, expected) in [
        (
            "\"format\":\"f16\",\"files\"",
            "\"format\":\"f32\",\"files\"",
            "positions of its asset are 1 x 23 x 37 of f32",
        ),
        ("\"format\":\"f16\",\"files\"", "\"format\":\"bc7\",\"files\"", "positions of 'bc7' are neither"),
        ("a_positions.ktx2\"]", "../ositions.ktx2\"]", "is not the name of a file"),
        ("\"bias\":[1.0,100.5,7.125]}", "\"bias\":[1.0,1e050,7.125]}", "number out of range"),
        ("\"bias\":[1.0,100.5,7.125]}", "\"bias\":[1.0,       7.125]}", "damaged"),
    ] {
        replace_in_file(&path, what.as_bytes(), with.as_bytes());
        let error = words(&path);
        assert!(error.contains(expected), "{error}");
        fs::write(&path, &document).unwrap();
    }
    let foreign = other.path().join("a.ktx2");
    let smaller = lopsided("sh", 4, Layout::Rgb, SIZE);
    write(&smaller, &foreign, &smaller.plain(&foreign, Precision::U8), &PLAIN, Precision::F16).unwrap();
    fs::copy(other.path().join("a_positions.ktx2"), folder.path().join("a_positions.ktx2")).unwrap();
    assert!(words(&path).contains("belongs to another asset"));
    fs::copy(&path, folder.path().join("a_positions.ktx2")).unwrap();
    assert!(words(&path).contains("levels where positions of its asset are"));
}
