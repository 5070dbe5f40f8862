//! JPEG: what decodes, at which CPU level, and what is refused.

use crate::encode::*;
use crate::{LIMIT, assert_words, frame_header, info, read, read_both, refusal};
use jpeg_encoder::{ColorType as JpegColor, SamplingFactor};
use relight_core::CpuLevel;
use relight_formats::FormatError;
use relight_formats::picture::{SampleType, Samples, decode_bytes, probe};
use std::path::Path;

#[test]
fn jpeg_is_close_and_the_same_bytes_at_every_cpu_level() {
    let factors =
        [SamplingFactor::R_4_4_4, SamplingFactor::R_4_2_0, SamplingFactor::R_4_2_2, SamplingFactor::R_4_4_0];
    for size in [(1, 1), (1, 5000), (37, 23), (317, 211)] {
        for (color, channels) in [(JpegColor::Rgb, 3), (JpegColor::Luma, 1)] {
            for sampling in factors {
                for (progressive, restart) in [(false, 0), (true, 0), (false, 3)] {
                    let original = gradient(size.0, size.1, channels);
                    let jpeg = Jpeg { color, sampling, progressive, restart, ..jpeg_of(size.0, size.1) };
                    let bytes = jpeg.encode(&original);
                    let picture = read_both(&bytes);
                    assert_eq!(picture.info, info(size, channels, SampleType::U8, false));
                    let Samples::U8(samples) = &picture.samples else { panic!("8 bits") };
                    let worst = samples.iter().zip(&original).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
                    assert_eq!(samples.len(), original.len());
                    assert!(worst <= 8, "{size:?} {color:?} {sampling:?} {progressive}: off by {worst}");
                    for level in CpuLevel::available() {
                        let again = decode_bytes(&bytes, Path::new("test"), level, LIMIT).unwrap();
                        assert!(
                            again == picture,
                            "{} differs: {size:?} {sampling:?} {progressive}",
                            level.name()
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn jpeg_header_tells_orientation_and_profile() {
    let samples = gradient(16, 8, 3);
    for (description, version_4, expected) in [
        ("Adobe RGB (1998)", false, Some("Adobe RGB (1998)")),
        ("Display P3", true, Some("Display P3")),
        ("sRGB IEC61966-2.1", false, None),
        ("sRGB built-in", true, None),
        ("", false, Some("unnamed ICC profile")),
    ] {
        let profile = Some(icc_profile(description, version_4));
        let picture = read_both(&Jpeg { profile, ..jpeg_of(16, 8) }.encode(&samples));
        assert_eq!(picture.info.color_profile.as_deref(), expected);
    }
    for (orientation, expected) in [(1, None), (6, Some(6)), (3, Some(3))] {
        let picture =
            read_both(&Jpeg { exif_orientation: Some(orientation), ..jpeg_of(16, 8) }.encode(&samples));
        assert_eq!(picture.info.orientation, expected);
        assert_eq!((picture.info.width, picture.info.height), (16, 8));
    }
}

#[test]
fn truncated_jpeg_is_refused_wherever_it_is_cut() {
    let samples = gradient(317, 211, 3);
    let thumbnail = Jpeg { exif_orientation: Some(6), ..jpeg_of(317, 211) };
    for jpeg in [
        jpeg_of(317, 211),
        Jpeg { sampling: SamplingFactor::R_4_2_0, ..jpeg_of(317, 211) },
        Jpeg { progressive: true, ..jpeg_of(317, 211) },
        Jpeg { restart: 4, ..jpeg_of(317, 211) },
        thumbnail,
    ] {
        let bytes = jpeg.encode(&samples);
        let length = bytes.len();
        for cut in [length / 2, length - 100, length - 20, length - 2, length - 1, 30, 4] {
            let error = refusal(&bytes[..cut]);
            assert!(matches!(error, FormatError::Invalid { .. }), "{error}");
            assert_words(&error, &["truncated or damaged JPEG", "copy it again"]);
            // Blocks that a failing card filled with zeros.
            let mut zeroed = bytes[..cut].to_vec();
            zeroed.resize(length, 0);
            refusal(&zeroed);
        }
        // What follows the end is none of our business.
        let mut padded = bytes.clone();
        padded.extend([0; 300]);
        assert_eq!(read(&padded).unwrap(), read(&bytes).unwrap());
    }
}

#[test]
fn probing_a_jpeg_needs_its_header_only() {
    let bytes = jpeg_of(317, 211).encode(&gradient(317, 211, 3));
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), &bytes[..bytes.len() / 2]).unwrap();
    assert_eq!(probe(file.path()).unwrap(), info((317, 211), 3, SampleType::U8, false));
}

#[test]
fn jpeg_of_other_kinds_is_refused_in_words() {
    for color in [JpegColor::Cmyk, JpegColor::CmykAsYcck] {
        let bytes = Jpeg { color, ..jpeg_of(8, 8) }.encode(&[90; 8 * 8 * 4]);
        let error = refusal(&bytes);
        assert!(matches!(error, FormatError::Unsupported { .. }));
        assert_words(&error, &["CMYK", "convert it to RGB"]);
    }
    let bytes = jpeg_of(8, 8).encode(&gradient(8, 8, 3));
    let frame = frame_header(&bytes);
    for (marker, words) in [(0xc3, "lossless"), (0xc9, "arithmetic"), (0xc5, "hierarchical")] {
        let mut other = bytes.clone();
        other[frame + 1] = marker;
        assert_words(&refusal(&other), &[words]);
    }
    let mut deep = bytes;
    deep[frame + 4] = 12;
    assert_words(&refusal(&deep), &["12 bits", "8"]);
}

#[test]
fn jpeg_with_lost_data_is_refused_even_when_it_ends_well() {
    let samples = gradient(317, 211, 3);
    let plain = || jpeg_of(317, 211);
    for jpeg in [
        plain(),
        Jpeg { sampling: SamplingFactor::R_4_2_0, ..plain() },
        Jpeg { restart: 4, ..plain() },
        Jpeg { progressive: true, ..plain() },
    ] {
        let bytes = jpeg.encode(&samples);
        let (middle, length) = (bytes.len() / 2, bytes.len());
        // Broken off, and ended by a repair tool; the last also within the last row of blocks.
        for cut in [middle, length - 300, length - 20] {
            let ended = [&bytes[..cut], &[0xff, 0xd9]].concat();
            assert_words(&refusal(&ended), &["truncated or damaged JPEG"]);
        }
        if !jpeg.progressive {
            let mut sector_of_zeros = bytes.clone();
            sector_of_zeros[middle..middle + 512].fill(0);
            refusal(&sector_of_zeros);
            let mut sector_lost = bytes;
            sector_lost.drain(middle..middle + 512);
            refusal(&sector_lost);
        }
    }
}
