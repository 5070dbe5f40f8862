//! What a format can't hold, and files that are none of ours.

use crate::lopsided::{LIMIT, PLAIN, lopsided, names_in};
use relight_core::{Layout, Space};
use relight_formats::FormatError;
use relight_formats::asset::{AssetFormat, AssetPlan, WriteSettings, read_asset};
use relight_texture::{BlockFormat, Precision, Quantizer, TexelFormat};
use std::fs;
use std::path::Path;

#[test]
fn refusals_say_what_is_held_instead() {
    let folder = tempfile::tempdir().unwrap();
    let refusal = |name: &str, family: &str, count, precision, space| {
        let mut asset = lopsided(family, count, Layout::Rgb, (2, 2));
        asset.model.space = space;
        asset.write_plain(&folder.path().join(name), precision).unwrap_err().to_string()
    };
    let words = refusal("a.tiff", "ptm", 6, Precision::U8, Space::Encoded);
    assert!(words.ends_with("use .ktx2, .dds, .exr, .ptm, .rti, .web"), "{words}");
    let words = refusal("a.ptm", "sh", 9, Precision::U8, Space::Encoded);
    assert!(words.contains("basis ptm with 6 functions, not sh with 9"), "{words}");
    let words = refusal("a.ptm", "ptm", 10, Precision::U8, Space::Encoded);
    assert!(words.contains("not ptm with 10"), "{words}");
    let words = refusal("a.PTM", "ptm", 6, Precision::U8, Space::Linear);
    assert!(words.contains("not linear"), "{words}");
    let words = refusal("a.exr", "ptm", 6, Precision::U8, Space::Encoded);
    assert!(words.contains("precision f16 or f32, not u8"), "{words}");
    let asset = lopsided("sh", 9, Layout::Rgb, (64, 64));
    let path = folder.path().join("a.exr");
    let (exr, packing) = (AssetFormat::by_name("exr").unwrap(), asset.plain(&path, Precision::F32));
    let settings = WriteSettings { memory_limit: 1000, ..PLAIN };
    let refused = exr.create(&path, asset.header(packing.clone()), &settings).err().unwrap();
    assert!(matches!(refused, FormatError::TooLarge { needed: 442_368, limit: 1000, .. }), "{refused}");
    let mut packing = packing;
    packing.arrays[0].layers[3].quantizers[0] = Quantizer { scale: f32::INFINITY, bias: 0.0 };
    let refused = asset.write(&folder.path().join("a.dds"), &packing, &PLAIN, 1).unwrap_err().to_string();
    assert!(refused.contains("plane b01_l1mn1.R are not finite; raise the ridge"), "{refused}");
    assert_eq!(names_in(folder.path()).len(), 0);
}

#[test]
fn a_plan_is_refused_before_any_picture_is_read() {
    let asset = lopsided("ptm", 6, Layout::Rgb, (8, 5));
    let model = &asset.model;
    let plain = TexelFormat::Plain { precision: Precision::U8, channels: 1 };
    let bc7 = TexelFormat::Block(BlockFormat::Bc7);
    let refusal = |name: &str, format: TexelFormat, levels: usize, settings: &WriteSettings| {
        let formats = [format];
        let plan = AssetPlan { width: 8, height: 5, model, formats: &formats, levels };
        AssetFormat::by_name(name)
            .unwrap()
            .check(Path::new("a"), &plan, settings)
            .err()
            .map(|e| e.to_string())
    };
    let zstd = |level| WriteSettings { zstd: Some(level), ..PLAIN };
    let split = WriteSettings { split: true, ..PLAIN };
    let cases = [
        ("ptm", bc7, 1, PLAIN, "ptm holds no blocks such as bc7; write .ktx2 or .dds"),
        ("ptm", plain, 2, PLAIN, "ptm holds no mip levels"),
        ("ptm", plain, 1, split, "ptm holds all maps in one file"),
        ("dds", bc7, 1, zstd(3), "dds knows no Zstandard; write .ktx2"),
        ("ktx2", bc7, 1, zstd(20), "Zstandard's level 20 is outside 1..19"),
        ("ktx2", bc7, 5, PLAIN, "5 mip levels are outside 1..4 of 8 x 5 pixels"),
        ("ktx2", bc7, 0, PLAIN, "0 mip levels are outside 1..4"),
    ];
    for (name, format, levels, settings, words) in cases {
        let refused = refusal(name, format, levels, &settings).unwrap_or_default();
        assert!(refused.contains(words), "{refused:?} for {words:?}");
    }
    assert_eq!(refusal("ktx2", bc7, 4, &WriteSettings { split: true, ..zstd(19) }), None);
    assert_eq!(refusal("dds", bc7, 4, &split), None);
}

#[test]
fn ranges_are_needed_where_a_scale_and_bias_are_stored() {
    let format = |name: &str| AssetFormat::by_name(name).unwrap();
    let plain = |precision| TexelFormat::Plain { precision, channels: 1 };
    assert!(
        format("ktx2").needs_ranges(plain(Precision::F16))
            && !format("ktx2").needs_ranges(plain(Precision::F32))
    );
    assert!(format("dds").needs_ranges(TexelFormat::Block(BlockFormat::Bc6h)));
    assert!(
        !format("exr").needs_ranges(plain(Precision::F16))
            && format("ptm").needs_ranges(plain(Precision::U8))
    );
}

#[test]
fn a_header_beyond_what_dds_counts_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut asset = lopsided("ptm", 6, Layout::Grey, (2, 2));
    let packing = asset.packing(TexelFormat::Plain { precision: Precision::F32, channels: 4 }, 1);
    asset.planes.clear();
    // 4 GiB a layer.
    (asset.width, asset.height) = (1 << 14, 1 << 14);
    let path = folder.path().join("a.dds");
    let refused =
        AssetFormat::by_name("dds").unwrap().create(&path, asset.header(packing), &PLAIN).err().unwrap();
    assert!(refused.to_string().contains("exceed what DDS can count; write .ktx2"), "{refused}");
    assert_eq!(names_in(folder.path()).len(), 0);
}

#[test]
fn files_that_are_none_of_ours_are_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ktx2");
    let asset = lopsided("sh", 9, Layout::Rgb, (64, 64));
    asset.write_plain(&path, Precision::F32).unwrap();
    let refused = read_asset(&path, 1 << 16).unwrap_err();
    assert!(matches!(refused, FormatError::TooLarge { needed: 442_368, .. }), "{refused}");
    let bytes = fs::read(&path).unwrap();
    let refusal = |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        read_asset(&path, LIMIT).unwrap_err().to_string()
    };
    let at = bytes.windows(8).position(|window| window == b"relight\0").unwrap();
    let mut other = bytes.clone();
    other[at] = b'x';
    let refused = refusal(&other);
    assert!(refused.contains("no key 'relight'"), "{refused}");
    let at = bytes.windows(10).position(|window| window == b"[3,4,5],\"s").unwrap();
    for (digit, plane) in [(1, b'0'), (3, b'9'), (5, b'4')] {
        let mut out_of_turn = bytes.clone();
        out_of_turn[at + digit] = plane;
        let refused = refusal(&out_of_turn);
        assert!(refused.contains("out of turn"), "{refused}");
    }
    // R8G8B8A8_SRGB.
    let mut srgb = bytes.clone();
    srgb[12] = 43;
    let refused = refusal(&srgb);
    assert!(refused.contains("R8G8B8A8_SRGB; relight reads R8_UNORM"), "{refused}");
    // The document says f32 where the header says R16G16B16A16_SFLOAT and the sizes fit.
    let at = bytes.windows(3).position(|window| window == b"f32").unwrap();
    let mut half = bytes.clone();
    half[at + 1..at + 3].copy_from_slice(b"16");
    let refused = refusal(&half);
    assert!(refused.contains("has texels of f32 where its metadata say f16"), "{refused}");
    let refused = refusal(b"PTM_1.2\nPTM_FORMAT_PTM_LUT\n8\n8\n");
    assert!(refused.contains("holds PTM_FORMAT_PTM_LUT; relight reads"), "{refused}");
    let refused = refusal(b"GIF89a");
    assert!(refused.contains(".ktx2, .dds, .exr, .ptm"), "{refused}");
    let refused = refusal(b"{\"version\":2}");
    assert!(refused.contains("metadata 'relight' are damaged"), "{refused}");

    let dds = folder.path().join("a.dds");
    asset.write_plain(&dds, Precision::U8).unwrap();
    let bytes = fs::read(&dds).unwrap();
    let refusal = |at: usize, patch: &[u8]| {
        let mut bytes = bytes.clone();
        bytes[at..at + patch.len()].copy_from_slice(patch);
        fs::write(&dds, bytes).unwrap();
        read_asset(&dds, LIMIT).unwrap_err().to_string()
    };
    let refused = refusal(84, b"DXT5");
    assert!(refused.contains("without the DX10 header"), "{refused}");
    // R8G8B8A8_UNORM_SRGB.
    let refused = refusal(128, &[29]);
    assert!(refused.contains("R8G8B8A8_UNorm_sRGB; relight reads"), "{refused}");
    // A volume; a cube; a mark of another program.
    assert!(refusal(132, &[4]).contains("is no array of 2D pictures"));
    assert!(refusal(136, &[4]).contains("is no array of 2D pictures"));
    assert!(refusal(32, b"GIMP").contains("no mark of ours"));
    // Five layers where the manifest lists nine.
    let refused = refusal(140, &[5]);
    assert!(refused.contains("has 5 layers in array 0 where its metadata list 9"), "{refused}");
}
