//! `.dds`: golden bytes of the header, and what DirectXTex makes of our files.

use crate::lopsided::{LIMIT, PLAIN, layer_of, lopsided};
use directxtex::{DDS_FLAGS, DXGI_FORMAT, ScratchImage, TexMetadata};
use relight_core::Layout;
use relight_formats::asset::{WriteSettings, read_packed};
use relight_texture::{BlockFormat, Precision, TexelFormat, decode_blocks, full_levels, level_size};
use std::fs;
use std::path::Path;

fn load(path: &Path) -> (ScratchImage, TexMetadata) {
    let mut metadata = TexMetadata::default();
    let bytes = fs::read(path).unwrap();
    let image = ScratchImage::load_dds(&bytes, DDS_FLAGS::DDS_FLAGS_NONE, Some(&mut metadata), None).unwrap();
    (image, metadata)
}

fn formats() -> Vec<(TexelFormat, DXGI_FORMAT)> {
    let plain = |precision, channels| TexelFormat::Plain { precision, channels };
    let block = TexelFormat::Block;
    vec![
        (plain(Precision::U8, 1), DXGI_FORMAT::DXGI_FORMAT_R8_UNORM),
        (plain(Precision::U8, 4), DXGI_FORMAT::DXGI_FORMAT_R8G8B8A8_UNORM),
        (plain(Precision::F16, 1), DXGI_FORMAT::DXGI_FORMAT_R16_FLOAT),
        (plain(Precision::F16, 4), DXGI_FORMAT::DXGI_FORMAT_R16G16B16A16_FLOAT),
        (plain(Precision::F32, 1), DXGI_FORMAT::DXGI_FORMAT_R32_FLOAT),
        (plain(Precision::F32, 4), DXGI_FORMAT::DXGI_FORMAT_R32G32B32A32_FLOAT),
        (block(BlockFormat::Bc1), DXGI_FORMAT::DXGI_FORMAT_BC1_UNORM),
        (block(BlockFormat::Bc3), DXGI_FORMAT::DXGI_FORMAT_BC3_UNORM),
        (block(BlockFormat::Bc4), DXGI_FORMAT::DXGI_FORMAT_BC4_UNORM),
        (block(BlockFormat::Bc4Signed), DXGI_FORMAT::DXGI_FORMAT_BC4_SNORM),
        (block(BlockFormat::Bc5), DXGI_FORMAT::DXGI_FORMAT_BC5_UNORM),
        (block(BlockFormat::Bc5Signed), DXGI_FORMAT::DXGI_FORMAT_BC5_SNORM),
        (block(BlockFormat::Bc6h), DXGI_FORMAT::DXGI_FORMAT_BC6H_UF16),
        (block(BlockFormat::Bc6hSigned), DXGI_FORMAT::DXGI_FORMAT_BC6H_SF16),
        (block(BlockFormat::Bc7), DXGI_FORMAT::DXGI_FORMAT_BC7_UNORM),
    ]
}

#[test]
fn directxtex_finds_every_layer_of_every_level_and_decodes_a_texel_as_we_do() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dds");
    let (width, height) = (21, 10);
    for (format, dxgi) in formats() {
        let asset = lopsided("ptm", 6, Layout::Lrgb, (width, height));
        let packing = asset.packing(format, full_levels(width, height));
        asset.write(&path, &packing, &PLAIN, 1).unwrap();
        let packed = asset.packed(&packing, PLAIN.coding);
        let layers = packing.arrays[0].layers.len();
        // The old pixel format says "see below" and nothing else, or readers stop there.
        let old_format = [&[32, 0, 0, 0, 4, 0, 0, 0][..], b"DX10", &[0; 20]].concat();
        assert_eq!(fs::read(&path).unwrap()[76..108], old_format);
        let (image, metadata) = load(&path);
        assert_eq!((metadata.width, metadata.height, metadata.depth), (width, height, 1));
        assert_eq!((metadata.array_size, metadata.mip_levels, metadata.format), (layers, 5, dxgi));
        let float = DXGI_FORMAT::DXGI_FORMAT_R32G32B32A32_FLOAT;
        let decoded = matches!(format, TexelFormat::Block(_)).then(|| image.decompress(float).unwrap());
        for (level, layer) in (0..5).flat_map(|level| (0..layers).map(move |layer| (level, layer))) {
            let found = image.image(level, layer, 0).unwrap();
            let start = found.pixels as usize - image.pixels().as_ptr() as usize;
            let expected = layer_of(&packed.texels[0][level], layers, layer);
            let size = (level_size(width, level), level_size(height, level));
            assert_eq!((found.width, found.height, found.slice_pitch), (size.0, size.1, expected.len()));
            assert_eq!(&image.pixels()[start..start + expected.len()], expected, "{dxgi:?} {level} {layer}");
            let (TexelFormat::Block(block), Some(decoded)) = (format, &decoded) else { continue };
            let theirs = decoded.image(level, layer, 0).unwrap();
            let start = theirs.pixels as usize - decoded.pixels().as_ptr() as usize;
            let texel = &decoded.pixels()[start..start + 4 * block.channels()];
            let mut ours = vec![0.0; size.0 * size.1 * block.channels()];
            decode_blocks(block, expected, size.0, &mut ours);
            for (theirs, ours) in texel.chunks(4).zip(&ours) {
                let theirs = f32::from_le_bytes(theirs.try_into().unwrap());
                // Theirs interpolates in floats where ours rounds to codes.
                assert!((theirs - ours).abs() <= 0.5 / 255.0, "{dxgi:?} {level} {layer}: {ours}, {theirs}");
            }
        }
    }
}

#[test]
fn split_files_are_single_textures_for_directxtex() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dds");
    let asset = lopsided("ptm", 6, Layout::Rgb, (9, 5));
    let packing = asset.packing(TexelFormat::Block(BlockFormat::Bc1), 4);
    asset.write(&path, &packing, &WriteSettings { split: true, ..PLAIN }, 1).unwrap();
    let packed = read_packed(&path, LIMIT).unwrap();
    for layer in 0..6 {
        let name = if layer == 0 { "a.dds".to_owned() } else { format!("a_{layer}.dds") };
        let (image, metadata) = load(&folder.path().join(name));
        assert_eq!((metadata.array_size, metadata.mip_levels), (1, 4));
        let levels = packed.texels[0].iter();
        let expected: Vec<u8> = levels.flat_map(|level| layer_of(level, 6, layer).to_vec()).collect();
        assert_eq!(image.pixels(), expected);
    }
}

#[test]
fn bytes_of_bc7_in_three_levels_are_those_of_microsofts_guide() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dds");
    let asset = lopsided("ptm", 6, Layout::Grey, (5, 6));
    let packing = asset.packing(TexelFormat::Block(BlockFormat::Bc7), 3);
    asset.write(&path, &packing, &PLAIN, 1).unwrap();
    let written = fs::read(&path).unwrap();
    let manifest = fs::read_to_string(path.with_extension("json")).unwrap();
    let id = manifest.split("\"id\": \"").nth(1).unwrap()[..16].to_owned();
    let id = u64::from_str_radix(&id, 16).unwrap();

    let mut expected = b"DDS ".to_vec();
    let mut words = |words: &[u32]| expected.extend(words.iter().flat_map(|word| word.to_le_bytes()));
    // Size; caps, height, width, pixel format, mip count, linear size; height, width, bytes of the
    // first level of a layer; depth; levels.
    words(&[124, 0x1 | 0x2 | 0x4 | 0x1000 | 0x2_0000 | 0x8_0000, 6, 5, 64, 0, 3]);
    // Reserved: our mark, the number of the file, the asset's id.
    words(&[u32::from_le_bytes(*b"reli"), u32::from_le_bytes(*b"ght\0"), 0, id as u32, (id >> 32) as u32]);
    words(&[0; 6]);
    // Pixel format: size, four characters.
    words(&[32, 0x4, u32::from_le_bytes(*b"DX10"), 0, 0, 0, 0, 0]);
    // Caps: complex, texture, mip map.
    words(&[0x8 | 0x1000 | 0x40_0000, 0, 0, 0, 0]);
    // DXGI_FORMAT_BC7_UNORM, 2D texture, no cube, layers, alpha that is a channel of its own.
    words(&[98, 3, 0, 2, 4]);
    let packed = asset.packed(&packing, PLAIN.coding);
    for layer in 0..2 {
        for level in &packed.texels[0] {
            expected.extend(layer_of(level, 2, layer));
        }
    }
    let first = written.iter().zip(&expected).position(|(a, b)| a != b);
    assert_eq!((first, written.len()), (None, expected.len()));
}
