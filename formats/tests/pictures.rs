//! Every format: round trips at every precision, what is refused and in which words, and damaged
//! bytes.

#![allow(clippy::unwrap_used, reason = "clippy spares tests, not the functions they share")]

#[path = "pictures/encode.rs"]
mod encode;
#[path = "pictures/jpeg.rs"]
mod jpeg;

use encode::*;
use exr::prelude as ex;
use half::f16;
use jpeg_encoder::SamplingFactor;
use relight_core::CpuLevel;
use relight_formats::FormatError;
use relight_formats::picture::{
    DecodedPicture, PictureInfo, SampleType, Samples, decode, decode_bytes, has_picture_extension, probe,
};
use std::path::Path;

const LIMIT: u64 = 64 << 20;
const SIZES: [(usize, usize); 3] = [(1, 1), (1, 5000), (37, 23)];

fn read(bytes: &[u8]) -> Result<DecodedPicture, FormatError> {
    decode_bytes(bytes, Path::new("test"), CpuLevel::detect(), LIMIT)
}

/// Decodes and holds `probe` of the same bytes to the same answer.
fn read_both(bytes: &[u8]) -> DecodedPicture {
    let picture = read(bytes).unwrap();
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), bytes).unwrap();
    assert_eq!(probe(file.path()).unwrap(), picture.info);
    assert_eq!(decode(file.path(), CpuLevel::BASELINE, LIMIT).unwrap(), picture);
    picture
}

fn info(size: (usize, usize), channels: usize, sample_type: SampleType, alpha: bool) -> PictureInfo {
    let (width, height) = size;
    PictureInfo { width, height, channels, sample_type, alpha, color_profile: None, orientation: None }
}

fn check(bytes: &[u8], expected: PictureInfo, samples: Samples) {
    let picture = read_both(bytes);
    assert_eq!(picture.info, expected);
    assert!(picture.samples == samples, "samples of {expected:?} differ");
}

#[track_caller]
fn refusal(bytes: &[u8]) -> FormatError {
    read(bytes).expect_err("must be refused")
}

#[track_caller]
fn assert_words(error: &FormatError, words: &[&str]) {
    let message = error.to_string();
    for word in words {
        assert!(message.contains(word), "'{word}' is missing in: {message}");
    }
}

/// The first `kept` of every `stored` samples.
fn without_alpha<T: Copy>(samples: &[T], stored: usize, kept: usize) -> Vec<T> {
    samples.chunks(stored).flat_map(|pixel| pixel[..kept].to_vec()).collect()
}

#[test]
fn png_of_8_and_16_bits_round_trips_with_and_without_alpha() {
    use png::ColorType::{Grayscale, GrayscaleAlpha, Rgb, Rgba};
    for size in SIZES {
        for (color, stored, kept) in [(Grayscale, 1, 1), (GrayscaleAlpha, 2, 1), (Rgb, 3, 3), (Rgba, 4, 3)] {
            let eight = picture(size.0, size.1, stored, |v| (v % 256) as u8);
            let bytes = Png { gamma: true, ..png_of(size, color, png::BitDepth::Eight) }.encode(&eight);
            let expected = info(size, kept, SampleType::U8, stored != kept);
            check(&bytes, expected, Samples::U8(without_alpha(&eight, stored, kept)));

            let sixteen = picture(size.0, size.1, stored, |v| (v * 257 % 65_536) as u16);
            let big_endian: Vec<u8> = sixteen.iter().flat_map(|v| v.to_be_bytes()).collect();
            let bytes = png_of(size, color, png::BitDepth::Sixteen).encode(&big_endian);
            let expected = info(size, kept, SampleType::U16, stored != kept);
            check(&bytes, expected, Samples::U16(without_alpha(&sixteen, stored, kept)));
        }
    }
}

#[test]
fn png_of_few_bits_expands_to_8() {
    use png::{BitDepth, ColorType};
    let size = (5, 2);
    // Bits 10110, 01001; then 2-bit 0 1 2 3 0 | 3 2 1 0 3; then 4-bit 0 5 10 15 1 | 2 3 4 6 7.
    let cases: [(BitDepth, &[u8], [u8; 10]); 3] = [
        (BitDepth::One, &[0b1011_0000, 0b0100_1000], [255, 0, 255, 255, 0, 0, 255, 0, 0, 255]),
        (
            BitDepth::Two,
            &[0b0001_1011, 0, 0b1110_0100, 0b1100_0000],
            [0, 85, 170, 255, 0, 255, 170, 85, 0, 255],
        ),
        (BitDepth::Four, &[0x05, 0xaf, 0x10, 0x23, 0x46, 0x70], [0, 85, 170, 255, 17, 34, 51, 68, 102, 119]),
    ];
    for (depth, packed, expected) in cases {
        let bytes = png_of(size, ColorType::Grayscale, depth).encode(packed);
        check(&bytes, info(size, 1, SampleType::U8, false), Samples::U8(expected.to_vec()));
    }
    let palette = [1, 2, 3, 40, 50, 60, 200, 220, 240];
    let expected = Samples::U8(vec![200, 220, 240, 1, 2, 3, 40, 50, 60, 40, 50, 60, 1, 2, 3, 200, 220, 240]);
    let indices = [2, 0, 1, 1, 0, 2];
    let mut png = Png { palette: Some(&palette), ..png_of((3, 2), ColorType::Indexed, BitDepth::Eight) };
    check(&png.encode(&indices), info((3, 2), 3, SampleType::U8, false), expected.clone());
    png.transparency = Some(&[0, 128]);
    check(&png.encode(&indices), info((3, 2), 3, SampleType::U8, true), expected);
}

#[test]
fn tiff_round_trips_at_every_precision_order_and_layout() {
    for size in SIZES {
        for (stored, kept, photometric, tags) in [
            (1, 1, 1, &[][..]),
            (2, 1, 1, &[(338, 2)][..]),
            (3, 3, 2, &[][..]),
            (4, 3, 2, &[(338, 2)][..]),
            (3, 3, 2, &[(284, 2)][..]),
            (4, 3, 2, &[(284, 2), (338, 1)][..]),
        ] {
            for big_endian in [false, true] {
                let write = |bits: u16, format: u16, samples: Vec<Vec<u8>>| {
                    let mut tags = tags.to_vec();
                    tags.push((339, format));
                    let planar = tags.contains(&(284, 2));
                    let pixels = samples.len() / stored;
                    let data: Vec<u8> = (0..samples.len())
                        .flat_map(|i| {
                            let at = if planar { i % pixels * stored + i / pixels } else { i };
                            let mut bytes = samples[at].clone();
                            if big_endian {
                                bytes.reverse();
                            }
                            bytes
                        })
                        .collect();
                    let bits = vec![bits; stored];
                    Tiff { big_endian, size, bits: &bits, photometric, tags: &tags, data: &data }.encode()
                };
                let expected = |sample_type| info(size, kept, sample_type, stored != kept);

                let u8s = picture(size.0, size.1, stored, |v| (v % 256) as u8);
                let bytes = write(8, 1, u8s.iter().map(|v| vec![*v]).collect());
                check(&bytes, expected(SampleType::U8), Samples::U8(without_alpha(&u8s, stored, kept)));
                let u16s = picture(size.0, size.1, stored, |v| (v * 257 % 65_536) as u16);
                let bytes = write(16, 1, u16s.iter().map(|v| v.to_le_bytes().to_vec()).collect());
                check(&bytes, expected(SampleType::U16), Samples::U16(without_alpha(&u16s, stored, kept)));
                let f16s = picture(size.0, size.1, stored, half_of);
                let bytes = write(16, 3, f16s.iter().map(|v| v.to_le_bytes().to_vec()).collect());
                check(&bytes, expected(SampleType::F16), Samples::F16(without_alpha(&f16s, stored, kept)));
                let f32s = picture(size.0, size.1, stored, float_of);
                let bytes = write(32, 3, f32s.iter().map(|v| v.to_le_bytes().to_vec()).collect());
                check(&bytes, expected(SampleType::F32), Samples::F32(without_alpha(&f32s, stored, kept)));
            }
        }
    }
}

#[test]
fn compressed_tiff_round_trips() {
    use tiff::encoder::{Compression, DeflateLevel, colortype};
    let size = (37, 23);
    let u16s = picture(37, 23, 3, |v| (v * 257 % 65_536) as u16);
    let f32s = picture(37, 23, 3, float_of);
    for compression in [
        Compression::Uncompressed,
        Compression::Lzw,
        Compression::Packbits,
        Compression::Deflate(DeflateLevel::Fast),
    ] {
        let bytes = tiff_compressed::<colortype::RGB16>(size, compression, &u16s);
        check(&bytes, info(size, 3, SampleType::U16, false), Samples::U16(u16s.clone()));
        let bytes = tiff_compressed::<colortype::RGB32Float>(size, compression, &f32s);
        check(&bytes, info(size, 3, SampleType::F32, false), Samples::F32(f32s.clone()));
    }
}

#[test]
fn tiff_of_other_kinds_is_refused_in_words() {
    let refuse = |bits: &[u16], photometric, tags: &[(u16, u16)], bytes_per_pixel: usize| {
        let data = vec![7u8; 6 * bytes_per_pixel];
        let error =
            refusal(&Tiff { big_endian: false, size: (3, 2), bits, photometric, tags, data: &data }.encode());
        assert!(matches!(error, FormatError::Unsupported { .. }), "{error}");
        error
    };
    assert_words(&refuse(&[32; 3], 2, &[(339, 1)], 12), &["32-bit unsigned", "convert it to"]);
    assert_words(&refuse(&[16; 3], 2, &[(339, 2)], 6), &["16-bit signed"]);
    assert_words(&refuse(&[64], 1, &[(339, 3)], 8), &["64-bit floating-point"]);
    assert_words(&refuse(&[8; 4], 5, &[(332, 1)], 4), &["CMYK", "RGB"]);
    assert_words(&refuse(&[8; 3], 6, &[], 3), &["YCbCr", "RGB"]);
}

#[test]
fn tiff_orientation_is_reported_and_not_applied() {
    let data = [10, 20, 30, 40, 50, 60];
    let tags = [(274, 6)];
    let bytes = Tiff { big_endian: true, size: (3, 2), bits: &[8], photometric: 1, tags: &tags, data: &data }
        .encode();
    let expected = PictureInfo { orientation: Some(6), ..info((3, 2), 1, SampleType::U8, false) };
    check(&bytes, expected, Samples::U8(data.to_vec()));
}

#[test]
fn exr_keeps_half_and_float_in_every_compression_and_tiling() {
    use ex::{Blocks, Compression, Encoding, FlatSamples, LineOrder};
    let encoding = |compression, blocks, line_order| Encoding { compression, blocks, line_order };
    for size in SIZES {
        for compression in [
            Compression::Uncompressed,
            Compression::RLE,
            Compression::ZIP1,
            Compression::ZIP16,
            Compression::PIZ,
            Compression::PXR24,
        ] {
            for (blocks, order) in [
                (Blocks::ScanLines, LineOrder::Increasing),
                (Blocks::ScanLines, LineOrder::Decreasing),
                (Blocks::Tiles(ex::Vec2(16, 8)), LineOrder::Increasing),
            ] {
                let bytes = exr_half_rgb(size, encoding(compression, blocks, order));
                let expected = Samples::F16(picture(size.0, size.1, 3, half_of));
                check(&bytes, info(size, 3, SampleType::F16, false), expected);
                if compression == Compression::PXR24 {
                    continue; // keeps 24 bits of a float
                }
                // Mixed types read as the wider one; the data window may lie anywhere.
                let channels = vec![
                    ("A", FlatSamples::F16(plane(size, 3, half_of))),
                    ("R", FlatSamples::F32(plane(size, 0, float_of))),
                    ("G", FlatSamples::F16(plane(size, 1, half_of))),
                    ("B", FlatSamples::F32(plane(size, 2, float_of))),
                    ("Z", FlatSamples::U32(plane(size, 4, |v| v as u32))),
                ];
                let bytes = exr(size, channels, encoding(compression, blocks, order), (-11, 6));
                let mut expected = Vec::new();
                for y in 0..size.1 {
                    for x in 0..size.0 {
                        let green = half_of(value(x, y, 1)).to_f32();
                        expected.extend([float_of(value(x, y, 0)), green, float_of(value(x, y, 2))]);
                    }
                }
                check(&bytes, info(size, 3, SampleType::F32, true), Samples::F32(expected));
            }
        }
    }
}

#[test]
fn lossy_exr_is_close() {
    let size = (37, 23);
    for compression in [ex::Compression::B44, ex::Compression::B44A] {
        let encoding = ex::Encoding { compression, ..ex::Encoding::UNCOMPRESSED };
        let smooth: Vec<f16> = (0..37 * 23).map(|i| f16::from_f32(1.0 + (i % 37) as f32 / 37.0)).collect();
        let doubled = smooth.iter().map(|v| f16::from_f32(v.to_f32() * 2.0)).collect();
        let flat = |v: f32| ex::FlatSamples::F16(vec![f16::from_f32(v); 37 * 23]);
        let channels = vec![
            ("R", ex::FlatSamples::F16(smooth)),
            ("G", flat(0.25)),
            ("B", ex::FlatSamples::F16(doubled)),
        ];
        let picture = read_both(&exr(size, channels, encoding, (0, 0)));
        let Samples::F16(samples) = picture.samples else { panic!("halves must stay halves") };
        for (i, pixel) in samples.chunks(3).enumerate() {
            let red = 1.0 + (i % 37) as f32 / 37.0;
            for (found, expected) in pixel.iter().zip([red, 0.25, 2.0 * red]) {
                let found = found.to_f32();
                assert!(
                    (found - expected).abs() < 0.05 * expected,
                    "{compression:?} {i}: {found} for {expected}"
                );
            }
        }
    }
}

#[test]
fn exr_layers_are_found_by_their_channels() {
    let size = (5, 3);
    let half = |channel| ex::FlatSamples::F16(plane(size, channel, half_of));
    let grey = exr(size, vec![("Y", half(1)), ("A", half(0))], ex::Encoding::SMALL_LOSSLESS, (0, 0));
    check(
        &grey,
        info(size, 1, SampleType::F16, true),
        Samples::F16(picture(5, 3, 2, half_of)[1..].iter().step_by(2).copied().collect()),
    );
    let named = vec![
        ("albedo.X", half(7)),
        ("beauty.R", half(0)),
        ("beauty.G", half(1)),
        ("beauty.B", half(2)),
        ("A", half(6)),
    ];
    let named = exr(size, named, ex::Encoding::SMALL_LOSSLESS, (0, 0));
    check(&named, info(size, 3, SampleType::F16, false), Samples::F16(picture(5, 3, 3, half_of)));
    let depth = exr(size, vec![("Z", half(0))], ex::Encoding::UNCOMPRESSED, (0, 0));
    let dwa = ex::Encoding { compression: ex::Compression::DWAA(None), ..ex::Encoding::UNCOMPRESSED };
    assert_words(&refusal(&exr_half_rgb(size, dwa)), &["DWA", "save it with ZIP or PIZ"]);
    assert_words(&refusal(&depth), &["R, G and B", "found: Z", "save the picture as RGB"]);
    let integers = |channel| ex::FlatSamples::U32(plane(size, channel, |v| v as u32));
    let integers = vec![("R", half(0)), ("G", integers(1)), ("B", half(2))];
    assert_words(
        &refusal(&exr(size, integers, ex::Encoding::UNCOMPRESSED, (0, 0))),
        &["channel G", "32-bit integers"],
    );
}

#[test]
fn exr_block_in_place_of_another_is_refused() {
    let mut bytes = exr_half_rgb((5, 4), ex::Encoding::UNCOMPRESSED);
    // The table of blocks, one a row: its first entry points right behind it.
    let entry = |bytes: &[u8], at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
    let table = (0..bytes.len() - 8).find(|&at| entry(&bytes, at) == at as u64 + 4 * 8).unwrap();
    bytes.copy_within(table..table + 8, table + 16);
    assert_words(&refusal(&bytes), &["table of blocks", "copy it again"]);
}

#[test]
fn nan_and_infinity_are_named_with_their_place() {
    let size = (5, 4);
    let mut green = plane(size, 1, half_of);
    green[5 * 2 + 3] = f16::NAN;
    let half = |channel| ex::FlatSamples::F16(plane(size, channel, half_of));
    let channels = vec![("R", half(0)), ("G", ex::FlatSamples::F16(green)), ("B", half(2))];
    let error = refusal(&exr(size, channels, ex::Encoding::UNCOMPRESSED, (0, 0)));
    assert!(matches!(error, FormatError::Invalid { .. }));
    assert_words(&error, &["x 3, y 2", "G = NaN", "finite"]);
    let mut grey = plane(size, 0, float_of);
    grey[5 * 3 + 1] = f32::NEG_INFINITY;
    let error =
        refusal(&exr(size, vec![("Y", ex::FlatSamples::F32(grey))], ex::Encoding::UNCOMPRESSED, (0, 0)));
    assert_words(&error, &["x 1, y 3", "Y = -inf"]);
}

#[test]
fn radiance_values_are_exact() {
    for size in [(1, 1), (1, 500), (300, 3)] {
        let rgbe: Vec<u8> = picture(size.0, size.1, 4, |v| (v % 251) as u8)
            .chunks(4)
            // Not a marker of runs: those begin with 1 1 1 or 2 2.
            .flat_map(|p| [p[0] | 128, p[1], p[2], 120 + p[3] % 20])
            .collect();
        // Ward, Real Pixels: value = mantissa / 256 * 2^(exponent - 128).
        let expected: Vec<f32> = rgbe
            .chunks(4)
            .flat_map(|p| [p[0], p[1], p[2]].map(|m| f32::from(m) / 256.0 * 2f32.powi(i32::from(p[3]) - 128)))
            .collect();
        for (signature, runs) in [("#?RADIANCE", size.0 >= 8), ("#?RADIANCE", false), ("#?RGBE", false)] {
            let bytes = radiance(size, signature, &rgbe, runs);
            check(&bytes, info(size, 3, SampleType::F32, false), Samples::F32(expected.clone()));
        }
    }
    let xyz = b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n\x80\x80\x80\x80";
    assert_words(&refusal(xyz), &["not read", "convert it to RGB"]);
}

/// Where the baseline frame header of `bytes` starts.
fn frame_header(bytes: &[u8]) -> usize {
    bytes.windows(3).position(|w| w == [0xff, 0xc0, 0]).unwrap()
}

#[test]
fn memory_is_bounded_before_it_is_allocated() {
    let mut jpeg = jpeg_of(8, 8).encode(&gradient(8, 8, 3));
    let frame = frame_header(&jpeg);
    jpeg[frame + 5..frame + 9].copy_from_slice(&[0xff; 4]);
    let size = (1 << 20, 1 << 20);
    let mut png = png_of((3, 2), png::ColorType::Rgb, png::BitDepth::Sixteen).encode(&[9; 36]);
    png[16..24].copy_from_slice(&[0, 16, 0, 0, 0, 16, 0, 0]);
    let checksum = png_checksum(&png[12..29]).to_be_bytes();
    png[29..33].copy_from_slice(&checksum);
    let tiff =
        Tiff { big_endian: false, size, bits: &[32; 3], photometric: 2, tags: &[(339, 3)], data: &[0; 12] };
    let radiance = radiance(size, "#?RADIANCE", &[], false);
    for bytes in [jpeg, png, tiff.encode(), radiance] {
        let error = refusal(&bytes);
        assert!(matches!(error, FormatError::TooLarge { limit: LIMIT, .. }), "{error}");
    }
    // A real picture against a limit one byte below what its samples alone take.
    let bytes = exr_half_rgb((40, 30), ex::Encoding::FAST_LOSSLESS);
    let samples = 40 * 30 * 3 * 2;
    let error = decode_bytes(&bytes, Path::new("test"), CpuLevel::BASELINE, samples - 1).unwrap_err();
    assert!(matches!(error, FormatError::TooLarge { needed, .. } if needed >= samples), "{error}");
}

/// CRC-32 as PNG uses it, bit by bit.
fn png_checksum(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |crc, byte| {
        (0..8).fold(
            crc ^ u32::from(*byte),
            |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 },
        )
    })
}

#[test]
fn pictures_without_pixels_are_invalid() {
    let mut jpeg = jpeg_of(8, 8).encode(&gradient(8, 8, 3));
    let frame = frame_header(&jpeg);
    jpeg[frame + 5..frame + 7].copy_from_slice(&[0, 0]);
    let radiance = radiance((0, 4), "#?RADIANCE", &[0], false);
    for bytes in [&jpeg[..], &radiance[..]] {
        let error = refusal(bytes);
        assert!(matches!(error, FormatError::Invalid { .. }), "{error}");
        assert_words(&error, &["at least 1 x 1"]);
    }
}

#[test]
fn what_is_no_picture_is_named_by_its_bytes() {
    assert_words(
        &refusal(b"GIF89a......"),
        &["47 49 46 38", "JPEG, PNG, TIFF, OpenEXR, Radiance HDR", "convert"],
    );
    assert_words(&refusal(b""), &["empty"]);
    let missing = probe(Path::new("/nonexistent/picture.jpg")).unwrap_err();
    assert!(matches!(missing, FormatError::Io { action: "open", .. }));
}

#[test]
fn the_name_of_a_file_does_not_tell_its_format() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("picture.jpg");
    let samples = picture(6, 4, 3, |v| (v % 256) as u8);
    std::fs::write(&path, png_of((6, 4), png::ColorType::Rgb, png::BitDepth::Eight).encode(&samples))
        .unwrap();
    assert_eq!(decode(&path, CpuLevel::BASELINE, LIMIT).unwrap().samples, Samples::U8(samples));
}

/// One valid file of every format and notable layout.
fn valid_files() -> Vec<(&'static str, Vec<u8>)> {
    use png::{BitDepth, ColorType};
    use tiff::encoder::{Compression, DeflateLevel, colortype};
    let size = (37, 23);
    let rgb = gradient(37, 23, 3);
    let u16s = picture(37, 23, 3, |v| (v * 257 % 65_536) as u16);
    let rgbe = picture(37, 23, 4, |v| (v % 251) as u8 | 64);
    let mut files = vec![
        ("jpeg", jpeg_of(37, 23).encode(&rgb)),
        (
            "jpeg 4:2:0",
            Jpeg { sampling: SamplingFactor::R_4_2_0, restart: 2, ..jpeg_of(37, 23) }.encode(&rgb),
        ),
        (
            "progressive jpeg",
            Jpeg { progressive: true, exif_orientation: Some(6), ..jpeg_of(37, 23) }.encode(&rgb),
        ),
        ("png", png_of(size, ColorType::Rgb, BitDepth::Eight).encode(&rgb)),
        ("16-bit png", png_of(size, ColorType::Rgb, BitDepth::Sixteen).encode(bytemuck::cast_slice(&u16s))),
        ("tiff", tiff_compressed::<colortype::RGB16>(size, Compression::Uncompressed, &u16s)),
        ("lzw tiff", tiff_compressed::<colortype::RGB16>(size, Compression::Lzw, &u16s)),
        (
            "deflate tiff",
            tiff_compressed::<colortype::RGB8>(size, Compression::Deflate(DeflateLevel::Fast), &rgb),
        ),
        ("hdr", radiance(size, "#?RADIANCE", &rgbe, true)),
        ("old hdr", radiance(size, "#?RGBE", &rgbe, false)),
    ];
    use ex::Compression::{B44, PIZ, PXR24, RLE, Uncompressed, ZIP16};
    for compression in [Uncompressed, RLE, ZIP16, PIZ, PXR24, B44] {
        let encoding = ex::Encoding { compression, ..ex::Encoding::UNCOMPRESSED };
        files.push(("exr", exr_half_rgb(size, encoding)));
        files.push((
            "tiled exr",
            exr_half_rgb(size, ex::Encoding { blocks: ex::Blocks::Tiles(ex::Vec2(16, 8)), ..encoding }),
        ));
    }
    files
}

#[test]
fn half_a_file_is_refused() {
    for (name, bytes) in valid_files() {
        let error = refusal(&bytes[..bytes.len() / 2]);
        assert!(matches!(error, FormatError::Invalid { .. }), "{name}: {error}");
        assert_words(&error, &["damaged", "copy"]);
    }
}

/// Steele and Vigna's SplitMix64: enough for choosing bytes.
struct Random(u64);

impl Random {
    fn below(&mut self, bound: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ z >> 31) % bound as u64) as usize
    }
}

#[test]
fn mangled_bytes_give_an_error_or_a_result() {
    let rounds = std::env::var("RELIGHT_MANGLE_ROUNDS").map_or(300, |rounds| rounds.parse().unwrap());
    for (index, (name, valid)) in valid_files().into_iter().enumerate() {
        let mut random = Random(index as u64);
        for round in 0..rounds {
            let mut bytes = valid.clone();
            if round % 3 == 0 {
                bytes.truncate(random.below(bytes.len()));
            }
            for _ in 0..random.below(6) {
                // Every other change hits the header, where it matters most.
                let end = if random.below(2) == 0 { bytes.len().min(400) } else { bytes.len() };
                if end > 0 {
                    let at = random.below(end);
                    bytes[at] = if random.below(2) == 0 {
                        bytes[at] ^ 1 << random.below(8)
                    } else {
                        random.below(256) as u8
                    };
                }
            }
            if let Ok(picture) = read(&bytes) {
                let PictureInfo { width, height, channels, .. } = picture.info;
                assert_eq!(picture.samples.len(), width * height * channels, "{name}, round {round}");
            }
        }
    }
}

#[test]
fn a_panic_of_a_decoder_is_an_error_of_the_file() {
    // Old-style runs of length 0 multiply the HDR decoder's run length by 256 each: the ninth
    // overflows where overflow is checked.
    let mut rgbe = vec![9, 9, 9, 128];
    rgbe.extend([1, 1, 1, 0].repeat(9));
    let bytes = radiance((10, 1), "#?RADIANCE", &rgbe, false);
    assert_words(&refusal(&bytes), &["damaged", "copy"]);
}

#[test]
fn real_pictures_decode_as_their_headers_say() {
    let data = Path::new("/work/shared/data");
    for (set, sample_type) in [
        ("icon72", SampleType::U8),
        ("buddha12", SampleType::U8),
        ("lion64", SampleType::U8),
        ("peer_web_ptm", SampleType::U8),
        ("relief1024_test", SampleType::U8),
        ("court/test", SampleType::F16),
        ("caustics/test", SampleType::F16),
    ] {
        let Ok(folder) = std::fs::read_dir(data.join(set)) else {
            println!("skipped: {} is absent", data.join(set).display());
            continue;
        };
        for path in folder.map(|entry| entry.unwrap().path()).filter(|path| has_picture_extension(path)) {
            let picture = decode(&path, CpuLevel::detect(), LIMIT).unwrap();
            assert_eq!(probe(&path).unwrap(), picture.info);
            assert_eq!(
                (picture.info.channels, picture.info.sample_type),
                (3, sample_type),
                "{}",
                path.display()
            );
            assert!(picture == decode(&path, CpuLevel::BASELINE, LIMIT).unwrap(), "{}", path.display());
        }
    }
}
