//! `.ktx2`: golden bytes from the specification, another reader, documents of version 1.

use crate::lopsided::{LAYOUTS, LIMIT, Lopsided, PLAIN, layer_of, lopsided, replace_in_file};
use relight_core::basis::Ptm;
use relight_core::{Basis, Direction, FitFigures, Layout, Model, Space, Texels};
use relight_formats::asset::{WriteSettings, read_asset, read_packed};
use relight_texture::{BlockFormat, Precision, TexelFormat, full_levels};
use std::fs;

/// A number of the JSON document, or of a list in it.
fn numbers(list: &serde_json::Value) -> Vec<f32> {
    list.as_array().unwrap().iter().map(|value| value.as_f64().unwrap() as f32).collect()
}

#[test]
fn another_reader_finds_layers_and_evaluates_a_pixel_from_the_key() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ktx2");
    for (layout, layers) in [(Layout::Rgb, 6), (Layout::Lrgb, 3), (Layout::Grey, 6), (Layout::Shared, 2)] {
        let asset = lopsided("ptm", 6, layout, (7, 4));
        asset.write_plain(&path, Precision::U8).unwrap();
        let reader = ktx2::Reader::new(fs::read(&path).unwrap()).unwrap();
        let header = reader.header();
        assert_eq!((header.pixel_width, header.pixel_height, header.layer_count), (7, 4, layers));
        assert_eq!(reader.transfer_function(), Some(ktx2::TransferFunction::Linear));
        assert_eq!(reader.writer(), Some(concat!("relight ", env!("CARGO_PKG_VERSION"), "\0")));
        let (_, text) = reader.key_value_data().find(|(key, _)| *key == "relight").unwrap();
        let document: serde_json::Value = serde_json::from_slice(text.strip_suffix(&[0]).unwrap()).unwrap();
        let channels = if layout == Layout::Grey { 1 } else { 4 };
        let level = reader.levels().next().unwrap().data.to_vec();
        assert_eq!(level.len(), layers as usize * 28 * channels);
        let mut found = 0;
        let records = document["arrays"][0]["layers"].as_array().unwrap();
        for (texels, layer) in level.chunks(28 * channels).zip(records) {
            let (scale, bias) = (numbers(&layer["scale"]), numbers(&layer["bias"]));
            for (channel, plane) in layer["planes"].as_array().unwrap().iter().enumerate() {
                let plane = &asset.planes[plane.as_u64().unwrap() as usize];
                found += 1;
                for (texel, c) in texels.chunks(channels).zip(plane) {
                    let back = scale[channel] * (f32::from(texel[channel]) / 255.0) + bias[channel];
                    assert!((back - c).abs() <= 0.51 * scale[channel] / 255.0, "{layout:?}: {back} for {c}");
                }
            }
            let unused = layer["planes"].as_array().unwrap().len()..channels;
            for channel in unused {
                let expected = if channel == 3 { 255 } else { 0 };
                assert!(texels.chunks(channels).all(|texel| texel[channel] == expected));
            }
        }
        assert_eq!(found, asset.planes.len());
    }
}

#[test]
fn another_reader_finds_every_layer_of_every_level_and_the_formats_descriptor() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ktx2");
    for (layout, format) in LAYOUTS.iter().flat_map(|l| BlockFormat::all().map(|f| (*l, f))) {
        let asset = lopsided("ptm", 6, layout, (21, 10));
        let packing = asset.packing(TexelFormat::Block(format), full_levels(21, 10));
        asset.write(&path, &packing, &PLAIN, 1).unwrap();
        let packed = asset.packed(&packing, PLAIN.coding);
        let reader = ktx2::Reader::new(fs::read(&path).unwrap()).unwrap();
        let layers = packing.arrays[0].layers.len();
        assert_eq!((reader.header().layer_count as usize, reader.header().level_count), (layers, 5));
        let canonical = ktx2::dfd::Basic::from_format(reader.header().format.unwrap()).unwrap().0;
        assert_eq!(reader.basic_dfd().unwrap(), &canonical, "{format:?}");
        let mut end = u64::MAX;
        for (level, expected) in reader.levels().zip(&packed.texels[0]) {
            let at = level.data.as_ptr() as u64 - reader.data().as_ptr() as u64;
            assert!(at.is_multiple_of(format.bytes() as u64) && at < end, "smallest first, aligned");
            end = at;
            for layer in 0..layers {
                assert_eq!(layer_of(level.data, layers, layer), layer_of(expected, layers, layer));
            }
        }
    }
}

/// The key/value section of sorted pairs.
fn keys(text: &str) -> Vec<u8> {
    let version = env!("CARGO_PKG_VERSION");
    let mut keys = Vec::new();
    for (key, value) in
        [("KTXorientation", "rd"), ("KTXwriter", &format!("relight {version}")), ("relight", text)]
    {
        let entry = format!("{key}\0{value}\0");
        keys.extend((entry.len() as u32).to_le_bytes());
        keys.extend(entry.bytes());
        keys.resize(keys.len().div_ceil(4) * 4, 0);
    }
    keys
}

fn words(bytes: &mut Vec<u8>, words: &[u32]) {
    bytes.extend(words.iter().flat_map(|word| word.to_le_bytes()));
}

const LAYERS: &str = concat!(
    r#"[{"planes":[0,1,2,3],"scale":[1.0,1.0,1.0,1.0],"bias":[0.0,0.0,0.0,0.0]},"#,
    r#"{"planes":[4,5],"scale":[1.0,1.0],"bias":[0.0,0.0]},"#,
    r#"{"planes":[6,7,8],"scale":[1.0,1.0,1.0],"bias":[0.0,0.0,0.0]}]"#
);

/// One pixel of LRGB in floats, as the specification has it, with a document of `version`.
fn golden_float_file(version: u32) -> Vec<u8> {
    let layers = match version {
        1 => format!(r#""layers":{LAYERS}"#),
        _ => format!(r#""wrap":"mirror","levels":1,"arrays":[{{"format":"f32","layers":{LAYERS}}}]"#),
    };
    let text = format!(
        concat!(
            r#"{{"version":{},"basis":{{"family":"ptm","degree":2}},"layout":"lrgb","space":"encoded","#,
            r#""lights":[[0.0,0.0,1.0],[0.6,0.0,0.8]],"#,
            r#""error":{{"fit_rmse":0.25,"leave_one_out_rmse":null}},{}}}"#
        ),
        version, layers
    );
    let keys = keys(&text);
    let texels = (104 + 92 + keys.len()).div_ceil(16) * 16;
    let mut expected = b"\xabKTX 20\xbb\r\n\x1a\n".to_vec();
    // vkFormat R32G32B32A32_SFLOAT, typeSize, width, height, depth, layers, faces, levels, scheme.
    words(&mut expected, &[109, 4, 1, 1, 0, 3, 1, 1, 0]);
    words(&mut expected, &[104, 92, 196, keys.len() as u32, 0, 0, 0, 0]);
    words(&mut expected, &[texels as u32, 0, 48, 0, 48, 0]);
    // Descriptor: total size; vendor and type; version 2 and block size 88; model RGBSDA, BT.709,
    // linear, straight alpha; 1x1x1x1 texels; 16 bytes in plane 0; then a sample a channel: bit
    // offset, length - 1, float and signed with the channel's id; position; -1; 1.
    words(&mut expected, &[92, 0, 2 | 88 << 16, 0x00_01_01_01, 0, 16, 0]);
    for (i, id) in [0u32, 1, 2, 15].into_iter().enumerate() {
        words(&mut expected, &[(32 * i as u32) | 31 << 16 | (0xc0 | id) << 24, 0, 0xbf80_0000, 0x3f80_0000]);
    }
    expected.extend(keys);
    expected.resize(texels, 0);
    let layers = [[0.5f32, 1.5, 2.5, 3.5], [4.5, 5.5, 0.0, 1.0], [6.5, 7.5, 8.5, 1.0]];
    expected.extend(layers.iter().flatten().flat_map(|value| value.to_le_bytes()));
    expected
}

/// What [`golden_float_file`] holds.
fn golden_asset() -> Lopsided {
    let basis = Basis::Ptm(Ptm::with_count(6).unwrap());
    let lights = vec![Direction::OUT, Direction::try_from([0.6, 0.0, 0.8]).unwrap()];
    let figures = Some(FitFigures { fit_rmse: 0.25, leave_one_out_rmse: f64::INFINITY });
    let model =
        Model { basis, layout: Layout::Lrgb, space: Space::Encoded, lights, figures, provenance: None };
    let planes = (0..9).map(|p| vec![p as f32 + 0.5]).collect();
    Lopsided { width: 1, height: 1, model, planes }
}

#[track_caller]
fn assert_same(written: &[u8], expected: &[u8]) {
    let first = written.iter().zip(expected).position(|(a, b)| a != b);
    assert_eq!((first, written.len()), (None, expected.len()));
}

#[test]
fn bytes_are_those_of_the_specification() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ktx2");
    golden_asset().write_plain(&path, Precision::F32).unwrap();
    assert_same(&fs::read(&path).unwrap(), &golden_float_file(2));
}

#[test]
fn documents_of_version_1_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ktx2");
    fs::write(&path, golden_float_file(1)).unwrap();
    let maps = read_asset(&path, LIMIT).unwrap();
    let expected = golden_asset();
    assert_eq!(maps.model.lights, expected.model.lights);
    for (map, plane) in maps.planes.iter().zip(&expected.planes) {
        assert_eq!((map.scale, map.bias, &map.texels), (1.0, 0.0, &Texels::F32(plane.clone())));
    }
    let packed = read_packed(&path, LIMIT).unwrap();
    let first = &packed.packing.arrays[0].layers;
    assert_eq!((packed.packing.levels, first.len(), &first[1].planes[..]), (1, 3, &[4, 5][..]));
    replace_in_file(&path, b"\"version\":1", b"\"version\":3");
    let refused = read_asset(&path, LIMIT).unwrap_err().to_string();
    assert!(refused.contains("version 3; this relight reads versions 1 to 2"), "{refused}");
}

#[test]
fn bytes_of_bc7_in_three_levels_are_those_of_the_specification() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ktx2");
    let asset = lopsided("ptm", 6, Layout::Grey, (5, 6));
    let packing = asset.packing(TexelFormat::Block(BlockFormat::Bc7), 3);
    asset.write(&path, &packing, &PLAIN, 1).unwrap();
    let written = fs::read(&path).unwrap();

    // Two layers of three planes. Levels of 5x6, 2x3 and 1x1 texels: 4, 1 and 1 blocks of 16 bytes.
    let descriptor = 80 + 3 * 24;
    let text_at = written.windows(8).position(|window| window == b"relight\0").unwrap() + 8;
    let text_length = written[text_at..].iter().position(|&byte| byte == 0).unwrap();
    let keys = keys(std::str::from_utf8(&written[text_at..text_at + text_length]).unwrap());
    let level_2 = (descriptor + 44 + keys.len()).div_ceil(16) * 16;
    let (level_1, level_0) = (level_2 + 32, level_2 + 64);
    let mut expected = b"\xabKTX 20\xbb\r\n\x1a\n".to_vec();
    // VK_FORMAT_BC7_UNORM_BLOCK, type size 1 of blocks.
    words(&mut expected, &[145, 1, 5, 6, 0, 2, 1, 3, 0]);
    words(&mut expected, &[descriptor as u32, 44, descriptor as u32 + 44, keys.len() as u32, 0, 0, 0, 0]);
    for (at, bytes) in [(level_0, 128), (level_1, 32), (level_2, 32)] {
        words(&mut expected, &[at as u32, 0, bytes, 0, bytes, 0]);
    }
    // Model BC7 134, BT.709, linear, straight alpha; 4x4x1x1 texels; 16 bytes; one sample of 128
    // bits, 0 to 2^32 - 1.
    words(&mut expected, &[44, 0, 2 | 40 << 16, 134 | 1 << 8 | 1 << 16, 3 | 3 << 8, 16, 0]);
    words(&mut expected, &[127 << 16, 0, 0, u32::MAX]);
    expected.extend(keys);
    expected.resize(level_2, 0);
    let packed = asset.packed(&packing, PLAIN.coding);
    for level in packed.texels[0].iter().rev() {
        expected.extend(level);
    }
    assert_same(&written, &expected);
}

#[test]
fn levels_of_texels_narrower_than_four_bytes_begin_at_multiples_of_four() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ktx2");
    let asset = lopsided("ptm", 6, Layout::Grey, (3, 5));
    let packing = asset.packing(TexelFormat::Plain { precision: Precision::U8, channels: 1 }, 3);
    asset.write(&path, &packing, &PLAIN, 1).unwrap();
    let written = fs::read(&path).unwrap();
    let word = |at: usize| u64::from_le_bytes(written[at..at + 8].try_into().unwrap());
    let levels: Vec<(u64, u64)> =
        (0..3).map(|level| (word(80 + 24 * level), word(88 + 24 * level))).collect();
    // Six layers of 1x1, 1x2 and 3x5 texels.
    let start = levels[2].0;
    assert!(start.is_multiple_of(4));
    assert_eq!(levels, [(start + 8 + 12, 90), (start + 8, 12), (start, 6)]);
    assert_eq!(written.len() as u64, start + 20 + 90);
}

#[test]
fn a_level_of_zstandard_is_what_another_decoder_decodes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ktx2");
    // More than a piece, so that the stream is fed several times.
    let asset = lopsided("ptm", 6, Layout::Rgb, (257, 260));
    let packing = asset.packing(TexelFormat::Plain { precision: Precision::F32, channels: 4 }, 4);
    asset.write(&path, &packing, &WriteSettings { zstd: Some(5), ..PLAIN }, 1).unwrap();
    let reader = ktx2::Reader::new(fs::read(&path).unwrap()).unwrap();
    assert_eq!(reader.header().supercompression_scheme, Some(ktx2::SupercompressionScheme::Zstandard));
    let packed = asset.packed(&packing, PLAIN.coding);
    let mut end = u64::MAX;
    for (level, expected) in reader.levels().zip(&packed.texels[0]) {
        assert!(level.data.len() < expected.len());
        let at = level.data.as_ptr() as u64 - reader.data().as_ptr() as u64;
        assert!(at < end, "smallest first");
        end = at;
        assert!(zstd::bulk::decompress(level.data, expected.len()).unwrap() == *expected);
    }
}
