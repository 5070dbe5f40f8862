//! Assets of several files: their names, what each says of itself, and what holds them together.

use crate::lopsided::{LIMIT, Lopsided, PLAIN, basis_of, lopsided, names_in, replace_in_file};
use relight_core::{CoefficientSpan, Layout};
use relight_formats::asset::{
    ASSET_FORMATS, AssetFormat, Parts, WriteSettings, describe_asset, read_asset, read_packed,
};
use relight_formats::{FormatError, describe};
use relight_texture::{BlockFormat, Packing, Precision, TexelFormat};
use std::fs;
use std::path::Path;

const SPLIT: WriteSettings = WriteSettings { split: true, ..PLAIN };

/// Six layers.
fn bc7(levels: usize) -> (Lopsided, Packing) {
    let asset = lopsided("ptm", 6, Layout::Rgb, (9, 5));
    let packing = asset.packing(TexelFormat::Block(BlockFormat::Bc7), levels);
    (asset, packing)
}

fn refusal(path: &Path) -> String {
    let refused = read_asset(path, LIMIT).unwrap_err();
    assert!(matches!(refused, FormatError::Invalid { .. } | FormatError::Unsupported { .. }), "{refused:?}");
    assert_eq!(describe(path).unwrap_err().to_string(), refused.to_string());
    refused.to_string()
}

#[test]
fn files_are_those_that_were_announced() {
    let (asset, one) = bc7(1);
    let several = asset.packing_of_several(&[BlockFormat::Bc1, BlockFormat::Bc7].map(TexelFormat::Block), 1);
    let six = |extension: &str| {
        let further = (1..6).map(|number| format!("a.b_{number}.{extension}"));
        std::iter::once(format!("a.b.{extension}")).chain(further).chain(["a.b.json".to_owned()]).collect()
    };
    let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
    let cases = [
        ("a.b.ktx2", &one, false, names(&["a.b.ktx2"])),
        ("a.b.ktx2", &several, false, names(&["a.b.ktx2", "a.b_1.ktx2"])),
        ("a.b.ktx2", &one, true, six("ktx2")),
        ("a.b.dds", &one, false, names(&["a.b.dds", "a.b.json"])),
        ("a.b.dds", &several, false, names(&["a.b.dds", "a.b_1.dds", "a.b.json"])),
        ("a.b.dds", &one, true, six("dds")),
    ];
    for (name, packing, split, mut expected) in cases {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        let announced = AssetFormat::by_path(&path)
            .unwrap()
            .outputs(&path, packing, Parts { split, positions: false })
            .unwrap();
        let announced: Vec<_> =
            announced.iter().map(|path| path.file_name().unwrap().to_str().unwrap().to_owned()).collect();
        assert_eq!(announced, expected);
        asset.write(&path, packing, &WriteSettings { split, ..PLAIN }, 1).unwrap();
        expected.sort();
        assert_eq!(names_in(folder.path()), expected);
    }
}

#[test]
fn split_textures_are_no_arrays_and_say_to_which_asset_they_belong() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ktx2");
    let (asset, packing) = bc7(3);
    asset.write(&path, &packing, &SPLIT, 1).unwrap();
    for (number, name) in ["a.ktx2", "a_1.ktx2", "a_5.ktx2"].into_iter().enumerate() {
        let reader = ktx2::Reader::new(fs::read(folder.path().join(name)).unwrap()).unwrap();
        assert_eq!((reader.header().layer_count, reader.header().level_count), (0, 3), "{name}");
        if number > 0 {
            let words = refusal(&folder.path().join(name));
            let number = &name[2..3];
            assert!(
                words.contains(&format!("is further file {number} of an asset; name 'a.ktx2'")),
                "{words}"
            );
        }
    }
    asset.write(&path.with_extension("dds"), &packing, &SPLIT, 1).unwrap();
    let words = refusal(&folder.path().join("a_3.dds"));
    assert!(
        words.contains("is further file 3 of an asset; name that asset's first file or manifest"),
        "{words}"
    );
    // The manifest is now that of the .dds files, and the .ktx2 files need none.
    assert!(read_asset(&path, LIMIT).is_ok());
}

#[test]
fn companions_that_are_missing_or_of_another_asset_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let (asset, packing) = bc7(2);
    for extension in ["ktx2", "dds"] {
        let at = |name: &str| folder.path().join(name).with_extension(extension);
        asset.write(&at("a"), &packing, &SPLIT, 1).unwrap();
        let (whole, third) = (read_packed(&at("a"), LIMIT).unwrap(), fs::read(at("a_3")).unwrap());

        fs::remove_file(at("a_3")).unwrap();
        let words = refusal(&at("a"));
        assert!(words.contains(&format!("a.{extension}: its file a_3.{extension} is missing")), "{words}");

        let mut other = lopsided("ptm", 6, Layout::Rgb, (9, 5));
        other.planes[17][0] *= 2.0;
        let other_packing = other.packing(TexelFormat::Block(BlockFormat::Bc7), 2);
        other.write(&at("other"), &other_packing, &SPLIT, 1).unwrap();
        fs::copy(at("other_3"), at("a_3")).unwrap();
        let words = refusal(&at("a"));
        assert!(words.contains("a_3.") && words.contains("belongs to another asset"), "{words}");

        // One that has been through another program, which keeps neither key nor mark, is taken.
        fs::write(at("a_3"), &third).unwrap();
        replace_in_file(&at("a_3"), b"relight\0", b"texconv\0");
        assert!(read_packed(&at("a"), LIMIT).unwrap() == whole);
        // Of another size it is not.
        let small = lopsided("ptm", 6, Layout::Rgb, (8, 5));
        small.write(&at("small"), &small.packing(packing.arrays[0].format, 2), &SPLIT, 1).unwrap();
        fs::copy(at("small_3"), at("a_3")).unwrap();
        replace_in_file(&at("a_3"), b"relight\0", b"texconv\0");
        let words = refusal(&at("a"));
        assert!(words.contains("a_3.") && words.contains("8 x 5") && words.contains("9 x 5"), "{words}");
    }
}

#[test]
fn a_first_texture_may_be_renamed_and_a_dds_needs_its_manifest() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (asset, packing) = bc7(1);
    asset.write(&at("a.ktx2"), &packing, &SPLIT, 1).unwrap();
    let whole = read_packed(&at("a.ktx2"), LIMIT).unwrap();
    fs::rename(at("a.ktx2"), at("b.ktx2")).unwrap();
    assert!(read_packed(&at("b.ktx2"), LIMIT).unwrap() == whole);
    // The manifest names the old one.
    let words = refusal(&at("a.json"));
    assert!(words.contains("a.ktx2"), "{words}");

    asset.write(&at("c.dds"), &packing, &PLAIN, 1).unwrap();
    fs::rename(at("c.json"), at("d.json")).unwrap();
    assert!(read_packed(&at("d.json"), LIMIT).unwrap().texels == whole.texels);
    let words = refusal(&at("c.dds"));
    assert!(words.contains("its manifest c.json") && words.contains("missing"), "{words}");
    asset.write(&at("e.dds"), &asset.packing(packing.arrays[0].format, 2), &PLAIN, 1).unwrap();
    fs::rename(at("e.json"), at("c.json")).unwrap();
    let words = refusal(&at("c.dds"));
    assert!(words.contains("belongs to another asset"), "{words}");
}

#[test]
fn a_manifest_leads_to_no_other_folder_and_to_no_file_twice() {
    let folder = tempfile::tempdir().unwrap();
    let inner = folder.path().join("inner");
    fs::create_dir(&inner).unwrap();
    let (asset, packing) = bc7(1);
    asset.write(&folder.path().join("a_1.ktx2"), &packing, &PLAIN, 1).unwrap();
    let path = inner.join("a.ktx2");
    asset.write(&path, &packing, &SPLIT, 1).unwrap();
    let (manifest, texture) = (inner.join("a.json"), fs::read(&path).unwrap());
    let text = fs::read_to_string(&manifest).unwrap();
    let elsewhere = folder.path().join("a_1.ktx2").display().to_string();
    let names =
        ["../a_1.ktx2", &elsewhere, "..", "", "x/a_1.ktx2", "..\\\\a_1.ktx2", "c:a_1.ktx2", "a_1\\u0000"];
    for name in names {
        fs::write(&manifest, text.replace("\"a_1.ktx2\"", &format!("\"{name}\""))).unwrap();
        let words = refusal(&manifest);
        assert!(words.contains("is not the name of a file in its folder"), "{name}: {words}");
    }
    fs::write(&manifest, text.replace("\"a_1.ktx2\"", "\"a_2.ktx2\"")).unwrap();
    let words = refusal(&manifest);
    assert!(words.contains("names file a_2.ktx2 twice"), "{words}");
    // Nor does the document in a texture.
    fs::write(&path, &texture).unwrap();
    replace_in_file(&path, b"a_1.ktx2", b"../a.exr");
    assert!(refusal(&path).contains("is not the name of a file in its folder"));
    // Fewer files than layers.
    fs::write(&manifest, text.replace("        \"a_1.ktx2\",\n", "")).unwrap();
    let words = refusal(&manifest);
    assert!(words.contains("6 layers names 5 files"), "{words}");
    // A format that is no texture.
    let ptm = lopsided("ptm", 6, Layout::Rgb, (9, 5));
    ptm.write_plain(&inner.join("a.ptm"), Precision::U8).unwrap();
    fs::write(&manifest, text.replace("\"a.ktx2\"", "\"a.ptm\"")).unwrap();
    assert!(refusal(&manifest).contains("is no asset"));
}

#[test]
fn files_that_are_no_part_of_an_asset_are_not_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (asset, packing) = bc7(1);
    asset.write(&at("a_1.ktx2"), &packing, &PLAIN, 1).unwrap();
    let before = fs::read(at("a_1.ktx2")).unwrap();
    let words = asset.write(&at("a.ktx2"), &packing, &SPLIT, 1).unwrap_err().to_string();
    assert!(words.contains("a_1.ktx2: would be replaced by a file of asset"), "{words}");
    fs::write(at("b.json"), "{\"report\": 1}").unwrap();
    let words = asset.write(&at("b.dds"), &packing, &PLAIN, 1).unwrap_err().to_string();
    assert!(words.contains("b.json: would be replaced"), "{words}");
    assert_eq!(names_in(folder.path()), ["a_1.ktx2", "b.json"]);
    assert_eq!(fs::read(at("a_1.ktx2")).unwrap(), before);
    // A file of an asset is.
    asset.write(&at("c.ktx2"), &packing, &SPLIT, 1).unwrap();
    asset.write(&at("c.ktx2"), &packing, &SPLIT, 1).unwrap();
}

#[test]
fn a_map_with_missing_pixels_is_not_finished() {
    let folder = tempfile::tempdir().unwrap();
    for format in &ASSET_FORMATS {
        let (family, count) = basis_of(format.name);
        let asset = lopsided(family, count, Layout::Rgb, (4, 3));
        let path = folder.path().join("a").with_extension(format.extension);
        let packing = asset.plain(&path, format.precisions[0]);
        let settings = WriteSettings { split: format.textures, ..PLAIN };
        let writer = format.create(&path, asset.header(packing), &settings).unwrap();
        let (functions, base_color) = asset.span(0, 11);
        let (functions, base_color) = (&functions[..], &base_color[..]);
        writer.write(&CoefficientSpan { first: 0, pixels: 11, maps: functions, base_color }).unwrap();
        assert!(matches!(writer.finish(), Err(FormatError::Invalid { .. })), "{}", format.name);
    }
    assert_eq!(names_in(folder.path()).len(), 0);
}

#[test]
fn a_file_that_cannot_be_replaced_leaves_none_of_the_new_ones() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dds");
    let (asset, packing) = bc7(1);
    let format = AssetFormat::by_name("dds").unwrap();
    let writer = format.create(&path, asset.header(packing), &SPLIT).unwrap();
    let (functions, base_color) = asset.span(0, 45);
    let (functions, base_color) = (&functions[..], &base_color[..]);
    writer.write(&CoefficientSpan { first: 0, pixels: 45, maps: functions, base_color }).unwrap();
    fs::create_dir(&path).unwrap();
    assert!(matches!(writer.finish(), Err(FormatError::Io { .. })));
    assert_eq!(names_in(folder.path()), ["a.dds"]);
}

#[test]
fn info_shows_the_header() {
    let folder = tempfile::tempdir().unwrap();
    let rgb = lopsided("sh", 9, Layout::Rgb, (6, 5));
    for (name, detail) in
        [("a.ktx2", "R16G16B16A16_SFLOAT (VkFormat 97)"), ("a.exr", "zip block compression")]
    {
        let path = folder.path().join(name);
        rgb.write_plain(&path, Precision::F16).unwrap();
        let rows = describe_asset(&path).unwrap();
        let has = |name: &str, value: &str| rows.iter().any(|row| row.0 == name && row.1 == value);
        assert!(has("size", "6 x 5") && has("basis", "sh, 9 functions") && has("lights", "41"), "{rows:?}");
        assert!(rows.iter().any(|row| row.1 == detail), "{rows:?}");
    }
    let path = folder.path().join("a.ptm");
    let lrgb = lopsided("ptm", 6, Layout::Lrgb, (6, 5));
    lrgb.write_plain(&path, Precision::U8).unwrap();
    let rows = describe_asset(&path).unwrap();
    assert!(rows.contains(&("version".to_owned(), "PTM_1.2".to_owned())), "{rows:?}");

    let path = folder.path().join("b.ktx2");
    let packing = lrgb.packing_of_several(&[BlockFormat::Bc5, BlockFormat::Bc7].map(TexelFormat::Block), 3);
    lrgb.write(&path, &packing, &WriteSettings { zstd: Some(1), ..PLAIN }, 1).unwrap();
    let rows = describe_asset(&path).unwrap();
    let bytes: u64 =
        ["b.ktx2", "b_1.ktx2"].map(|name| fs::metadata(folder.path().join(name)).unwrap().len()).iter().sum();
    let first = &packing.arrays[0].layers[0];
    let (scale, bias) = (first.quantizers[0].scale, first.quantizers[0].bias);
    let expected = [
        ("texels", "bc5 + bc7".to_owned()),
        ("files", "b.ktx2 b_1.ktx2".to_owned()),
        ("file bytes", bytes.to_string()),
        // 5 layers of 4 + 1 + 1 blocks of 16 bytes over 30 pixels.
        ("GPU bytes a pixel", "16".to_owned()),
        ("texel format", "BC5_UNORM_BLOCK (VkFormat 141), BC7_UNORM_BLOCK (VkFormat 145)".to_owned()),
        ("layers", "3 + 2".to_owned()),
        ("levels", "3".to_owned()),
        ("wrap", "repeat".to_owned()),
        ("supercompression", "zstandard".to_owned()),
        ("layer 0.0", format!("base.B, scale {scale}, bias {bias}")),
    ];
    for (name, value) in expected {
        let found = rows.iter().find(|row| row.0 == name).map(|row| row.1.as_str());
        assert_eq!(found, Some(value.as_str()), "{name}");
    }
}
