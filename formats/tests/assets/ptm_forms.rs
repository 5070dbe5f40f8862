//! `.ptm` with luminance and chrominance, and with planes in JPEG: another reader, made files, damage.

use crate::lopsided::{LIMIT, Lopsided, PLAIN, lopsided, names_in, replace_in_file};
use jpeg_encoder::{ColorType, Encoder};
use relight_core::relighter::relight;
use relight_core::{CpuLevel, Direction, Layout};
use relight_formats::FormatError;
use relight_formats::asset::{
    AssetFormat, AssetPlan, WriteSettings, describe_asset, read_asset, read_packed,
};
use relight_texture::Precision;
use std::fmt::Write;
use std::fs;
use std::path::Path;
use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;

const LIGHTS: [(f64, f64, f64); 3] = [(0.3, -0.5, 0.8), (-0.7, 0.2, 0.4), (0.0, 0.0, 1.0)];

/// A reader of `.ptm` with planes in JPEG and with luminance, written from FORMATS.md alone: the picture
/// (0..1, top row first) under u, v.
fn picture_of_ptm(bytes: &[u8], u: f64, v: f64) -> Vec<f64> {
    let (mut words, mut at) = (Vec::new(), 0);
    let mut needed = 16;
    while words.len() < needed {
        let length = bytes[at..].iter().position(|&b| b == b'\n').unwrap();
        let line = std::str::from_utf8(&bytes[at..at + length]).unwrap();
        words.extend(line.split_whitespace().map(str::to_owned));
        at += length + 1;
        needed = match words.get(1).map(String::as_str) {
            Some("PTM_FORMAT_LUM") => 16 + 16,
            Some("PTM_FORMAT_JPEG_LRGB") => 16 + 1 + 7 * 9,
            Some("PTM_FORMAT_JPEG_RGB") => 16 + 1 + 7 * 18,
            _ => 16,
        };
    }
    let number = |i: usize| words[i].parse::<f64>().unwrap();
    let (width, height) = (number(2) as usize, number(3) as usize);
    let terms = [u * u, v * v, u * v, u, v, 1.0];
    let sum = |code: &dyn Fn(usize) -> u8| -> f64 {
        (0..6).map(|j| (f64::from(code(j)) - number(10 + j)) * number(4 + j) * terms[j]).sum()
    };
    let from_the_top = |i: usize| (height - 1 - i / 3 / width) * width + i / 3 % width;
    let samples = 0..3 * width * height;
    if words[1] == "PTM_FORMAT_LUM" {
        return samples
            .map(|i| {
                let pixel = &bytes[at + 8 * from_the_top(i)..][..8];
                let columns = [sum(&|j| pixel[j]), f64::from(pixel[6]), f64::from(pixel[7]), 1.0];
                (0..4).map(|k| number(16 + 4 * (i % 3) + k) * columns[k]).sum::<f64>() / 255.0
            })
            .collect();
    }
    let count = if words[1] == "PTM_FORMAT_JPEG_RGB" { 18 } else { 9 };
    let table = |line: usize, plane: usize| number(17 + line * count + plane) as i64;
    let mut stored = Vec::new();
    for plane in 0..count {
        let (size, side_size) = (table(5, plane) as usize, table(6, plane) as usize);
        let grey = DecoderOptions::default().jpeg_set_out_colorspace(ColorSpace::Luma);
        let mut decoder = zune_jpeg::JpegDecoder::new_with_options(ZCursor::new(&bytes[at..at + size]), grey);
        let codes = decoder.decode().unwrap();
        assert_eq!(codes.len(), width * height);
        stored.push((codes, &bytes[at + size..at + size + side_size]));
        at += size + side_size;
    }
    assert_eq!(at, bytes.len(), "bytes after the last plane");
    let mut planes: Vec<Option<Vec<u8>>> = vec![None; count];
    // The plane that is k-th to be decoded.
    for k in 0..count as i64 {
        let plane = (0..count).find(|&plane| table(3, plane) == k).unwrap();
        let (mut codes, side) = stored[plane].clone();
        if table(4, plane) >= 0 {
            let reference = planes[table(4, plane) as usize].as_ref().expect("a reference comes first");
            for (code, &r) in codes.iter_mut().zip(reference) {
                let p = if table(0, plane) == 1 { 255 - i64::from(r) } else { i64::from(r) };
                *code = (i64::from(*code) + p - 128).rem_euclid(256) as u8;
            }
        }
        for record in side.chunks(5) {
            let pixel = record[..4].iter().fold(0, |pixel, &byte| pixel * 256 + usize::from(byte));
            codes[pixel] = record[4];
        }
        planes[plane] = Some(codes);
    }
    let planes: Vec<Vec<u8>> = planes.into_iter().map(Option::unwrap).collect();
    samples
        .map(|i| {
            let (pixel, channel) = (from_the_top(i), i % 3);
            if count == 18 {
                sum(&|j| planes[6 * channel + j][pixel]) / 255.0
            } else {
                sum(&|j| planes[j][pixel]) / 255.0 * f64::from(planes[6 + channel][pixel]) / 255.0
            }
        })
        .collect()
}

/// What samples that we read differ by from those of the reader above, relative where they are beyond 1.
fn differences(path: &Path) -> Vec<f64> {
    let maps = read_asset(path, LIMIT).unwrap();
    let mut differences = Vec::new();
    for (x, y, z) in LIGHTS {
        let light = Direction::new(x, y, z).unwrap();
        let expected = picture_of_ptm(&fs::read(path).unwrap(), light.x(), light.y());
        let picture = relight(&maps, light, CpuLevel::BASELINE);
        assert_eq!(picture.samples.len(), expected.len());
        let pairs = picture.samples.iter().zip(expected);
        differences.extend(pairs.map(|(a, b)| (f64::from(*a) - b).abs() / b.abs().max(1.0)));
    }
    differences
}

fn assert_reads_alike(path: &Path, allowed: f64) {
    for (i, difference) in differences(path).into_iter().enumerate() {
        assert!(difference <= allowed, "sample {i}: {difference}");
    }
}

/// An asset of smooth planes: those of a function alike in the three channels, and every other function
/// like the one before it turned upside down.
fn smooth(layout: Layout, size: (usize, usize)) -> Lopsided {
    let mut asset = lopsided("ptm", 6, layout, size);
    let stride = if layout == Layout::Rgb { 3 } else { 1 };
    for (p, plane) in asset.planes.iter_mut().enumerate() {
        let (function, channel) = (p / stride, p % stride);
        for (i, value) in plane.iter_mut().enumerate() {
            let (x, y) = ((i % size.0) as f32 / 31.0, (i / size.0) as f32 / 23.0);
            let hills = (x * (5.0 - x) - y * y + x * y * 0.7).rem_euclid(8.0) / 8.0;
            let hills = (4.0 * hills * (1.0 - hills)) * 0.8 + 0.02 * x + 0.03 * channel as f32 * y;
            *value = match (p < 6 * stride, function % 2) {
                (false, _) => 0.3 + 0.2 * (function - 6) as f32 - 0.15 * hills,
                (true, 0) => (hills - 0.3) * (function + 1) as f32 / 4.0,
                (true, _) => (0.6 - hills) * function as f32 / 4.0,
            };
        }
    }
    asset
}

fn jpeg(quality: u8) -> WriteSettings {
    WriteSettings { jpeg_quality: Some(quality), ..PLAIN }
}

#[test]
fn planes_in_jpeg_are_taken_off_each_other_and_another_reader_sees_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ptm");
    for (layout, size) in [(Layout::Rgb, (157, 93)), (Layout::Lrgb, (157, 93)), (Layout::Rgb, (3, 1))] {
        let asset = smooth(layout, size);
        let packing = asset.plain(&path, Precision::U8);
        asset.write(&path, &packing, &jpeg(92), 1).unwrap();
        let once = fs::read(&path).unwrap();
        // The other's JPEG decoder rounds otherwise, by a code at one in a hundred pixels of a plane.
        let differences = differences(&path);
        let others = differences.iter().filter(|difference| **difference > 1e-5).count();
        let largest = differences.iter().copied().fold(0.0, f64::max);
        let words = format!("{others} of {} samples differ, by up to {largest}", differences.len());
        assert!(others * 20 < differences.len() && largest < 0.03, "{layout:?} {size:?}: {words}");
        let rows = describe_asset(&path).unwrap();
        let fact = |name: &str| &rows.iter().find(|(row, _)| row == name).unwrap().1;
        let (form, count) =
            if layout == Layout::Rgb { ("PTM_FORMAT_JPEG_RGB", 18) } else { ("PTM_FORMAT_JPEG_LRGB", 9) };
        assert_eq!((fact("form").as_str(), fact("JPEG quality").as_str()), (form, "92"));
        let predicted: usize = fact("planes from others").split(' ').next().unwrap().parse().unwrap();
        if size.0 > 8 {
            assert!(predicted >= count / 4, "{predicted} of {count} planes");
            assert!(once.len() * 4 < size.0 * size.1 * count, "{} bytes", once.len());
        }
        // What is read is what was written, but for JPEG.
        let maps = read_asset(&path, LIMIT).unwrap().coefficient_map();
        for (p, (back, plane)) in maps.planes.iter().zip(&asset.planes).enumerate() {
            let range = asset.range(p).max - asset.range(p).min;
            let square = |(a, b): (&f32, &f32)| f64::from(a - b) * f64::from(a - b);
            let rmse = (back.iter().zip(plane).map(square).sum::<f64>() / plane.len() as f64).sqrt();
            assert!(rmse <= 0.02 * f64::from(range.max(0.5)), "{layout:?} plane {p}: {rmse} of {range}");
        }
        asset.write(&path, &packing, &jpeg(92), 2).unwrap();
        assert!(fs::read(&path).unwrap() == once, "the bytes depend on the order of writing");
        assert_eq!(read_packed(&path, LIMIT).unwrap().packing.arrays[0].layers.len(), count);
    }
}

#[test]
fn what_jpeg_costs_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ptm");
    // Where JPEG keeps nearly everything, it takes off some of the rounding of smooth planes.
    for (layout, quality, above) in [(Layout::Rgb, 60, 0.05), (Layout::Lrgb, 97, 0.25)] {
        let asset = smooth(layout, (131, 77));
        let packing = asset.plain(&path, Precision::U8);
        let report = asset.write(&path, &packing, &jpeg(quality), 3).unwrap();
        let maps = read_asset(&path, LIMIT).unwrap().coefficient_map();
        for (p, (back, plane)) in maps.planes.iter().zip(&asset.planes).enumerate() {
            let square = |(a, b): (&f32, &f32)| f64::from(a - b) * f64::from(a - b);
            let rmse = (back.iter().zip(plane).map(square).sum::<f64>() / plane.len() as f64).sqrt();
            let ratio = report.rmse[p] / rmse;
            assert!((0.97..1.0 + above).contains(&ratio), "plane {p}: {} for {rmse}", report.rmse[p]);
        }
        let plain = asset.write(&path, &packing, &PLAIN, 3).unwrap();
        assert!(report.relit_rmse > 1.2 * plain.relit_rmse, "{} {}", report.relit_rmse, plain.relit_rmse);
    }
}

#[test]
fn planes_in_jpeg_are_held_within_the_memory_limit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ptm");
    let asset = smooth(Layout::Rgb, (100, 90));
    let (ptm, model) = (AssetFormat::by_name("ptm").unwrap(), &asset.model);
    let packing = asset.plain(&path, Precision::U8);
    let formats: Vec<_> = packing.formats().collect();
    let plan = AssetPlan { width: 100, height: 90, model, formats: &formats, levels: 1 };
    assert_eq!(ptm.held_bytes(&plan, &PLAIN), 0);
    let held = ptm.held_bytes(&plan, &jpeg(90));
    assert!((18 * 9000..60 * 9000).contains(&held), "{held}");
    let settings = WriteSettings { memory_limit: held - 1, ..jpeg(90) };
    let refused = asset.write(&path, &packing, &settings, 1).unwrap_err();
    assert!(matches!(refused, FormatError::TooLarge { needed, .. } if needed == held), "{refused}");
    assert_eq!(names_in(folder.path()).len(), 0);
    asset.write(&path, &packing, &WriteSettings { memory_limit: held, ..jpeg(90) }, 1).unwrap();
    // Reading holds the planes.
    let refused = read_asset(&path, 18 * 9000 - 1).unwrap_err();
    assert!(matches!(refused, FormatError::TooLarge { .. }), "{refused}");
    let check = |name: &str, width: usize, settings: &WriteSettings| {
        let plan = AssetPlan { width, ..plan };
        AssetFormat::by_name(name).unwrap().check(&path, &plan, settings).unwrap_err().to_string()
    };
    assert!(check("ktx2", 100, &jpeg(90)).contains("ktx2 holds no planes in JPEG; write .ptm"));
    assert!(check("ptm", 100, &jpeg(0)).contains("JPEG quality 0 is outside 1..100"));
    assert!(check("ptm", 65_536, &jpeg(1)).contains("65536 x 90 is outside 1..65535 of JPEG"));
}

#[test]
fn black_pixels_of_lrgb_stay_black() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ptm");
    let mut asset = smooth(Layout::Lrgb, (32, 24));
    for pixel in 0..16 * 32 {
        (6..9).for_each(|channel| asset.planes[channel][pixel] = 0.0);
    }
    let packing = asset.plain(&path, Precision::U8);
    for settings in [PLAIN, jpeg(90)] {
        asset.write(&path, &packing, &settings, 1).unwrap();
        let light = Direction::new(0.3, 0.2, 0.9).unwrap();
        let picture = relight(&read_asset(&path, LIMIT).unwrap(), light, CpuLevel::BASELINE);
        assert!(picture.samples[..3 * 16 * 32].iter().all(|&sample| sample == 0.0));
        assert!(picture.samples[3 * 16 * 32..].iter().all(|&sample| sample != 0.0 && sample.is_finite()));
    }
}

/// A JPEG of codes.
fn jpeg_of(codes: &[u8], (width, height): (usize, usize), color: ColorType) -> Vec<u8> {
    let mut bytes = Vec::new();
    Encoder::new(&mut bytes, 100).encode(codes, width as u16, height as u16, color).unwrap();
    bytes
}

/// Files of planes that nobody's writer makes.
struct Made {
    size: (usize, usize),
    transforms: [i64; 9],
    motion: [i64; 9],
    order: [i64; 9],
    references: [i64; 9],
    planes: Vec<Vec<u8>>,
    sides: Vec<Vec<u8>>,
}

impl Made {
    /// Planes with a slope of their own, referring forwards and backwards, with side information.
    fn new() -> Self {
        let size = (13, 7);
        let codes = |plane: usize| -> Vec<u8> {
            (0..91).map(|i| ((i % 13) * 9 + (i / 13) * (plane + 3) + 11 * plane) as u8).collect()
        };
        let mut sides = vec![Vec::new(); 9];
        sides[0] = vec![0, 0, 0, 0, 200, 0, 0, 0, 90, 3];
        sides[4] = vec![0, 0, 0, 13, 255];
        Self {
            size,
            transforms: [0, 1, 0, 2, 1, 0, 0, 1, 0],
            motion: [0; 9],
            order: [8, 1, 0, 3, 4, 5, 6, 7, 2],
            references: [8, 2, -1, 1, 2, -1, -1, 6, 4],
            planes: (0..9).map(|plane| jpeg_of(&codes(plane), size, ColorType::Luma)).collect(),
            sides,
        }
    }

    fn bytes(&self) -> Vec<u8> {
        let (width, height) = self.size;
        let mut head = format!(
            "PTM_1.2\r\nPTM_FORMAT_JPEG_LRGB\r\n{width} {height} \r\n0.5 1.25 1e-1 2.0 1 0.75 \r\n\
             -107 300 128 0 255 12 \r\n90\r\n"
        );
        let sizes = |files: &[Vec<u8>]| -> Vec<i64> { files.iter().map(|file| file.len() as i64).collect() };
        let (motion, lines) = (self.motion, [sizes(&self.planes), sizes(&self.sides)]);
        let tables = [self.transforms, motion, motion, self.order, self.references];
        for line in tables.iter().map(|line| &line[..]).chain(lines.iter().map(|line| &line[..])) {
            line.iter().for_each(|number| write!(head, "{number} ").unwrap());
            head.push_str("\r\n");
        }
        let files =
            self.planes.iter().zip(&self.sides).flat_map(|(plane, side)| [&plane[..], &side[..]].concat());
        head.into_bytes().into_iter().chain(files).collect()
    }
}

#[test]
fn references_of_any_order_inversion_and_side_information_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ptm");
    let made = Made { order: [4, 1, 0, 5, 2, 6, 7, 8, 3], ..Made::new() };
    fs::write(&path, made.bytes()).unwrap();
    assert_reads_alike(&path, 1e-5);
    // Side information counts along the rows of the JPEG, which begin at the bottom: codes as they are.
    let maps = read_asset(&path, LIMIT).unwrap();
    let code = |plane: usize, x: usize, y: usize| match &maps.planes[plane].texels {
        relight_core::Texels::U8(codes) => codes[y * 13 + x],
        _ => panic!("bytes"),
    };
    assert_eq!((code(0, 0, 6), code(0, 12, 0), code(4, 0, 5)), (200, 3, 255));
    // The order of planes follows from their references; a file that says nothing sensible of it is read.
    fs::write(&path, Made { order: [77; 9], ..Made::new() }.bytes()).unwrap();
    assert_eq!(read_asset(&path, LIMIT).unwrap(), maps);
}

#[test]
fn contradictions_in_planes_of_jpeg_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ptm");
    let refusal = |made: &Made| {
        fs::write(&path, made.bytes()).unwrap();
        read_asset(&path, LIMIT).unwrap_err().to_string()
    };
    let mut made = Made::new();
    made.sides[4] = vec![0, 0, 0, 91, 1];
    assert!(refusal(&made).contains("side information of plane 4 names pixel 91, outside 0..90"));
    made.sides[4] = vec![0x80, 0, 0, 0, 1];
    assert!(refusal(&made).contains("names pixel 2147483648, outside"));
    made.sides[4] = vec![0, 0, 0, 1];
    assert!(refusal(&made).contains("side information of 4 bytes is no whole number of 5 bytes"));
    let circle = Made { references: [8, 2, -1, 1, 0, -1, -1, 6, 4], ..Made::new() };
    assert!(refusal(&circle).contains("plane 0 was taken off planes that were taken off it in turn"));
    let itself = Made { references: [-1, 1, -1, -1, -1, -1, -1, -1, -1], ..Made::new() };
    assert!(refusal(&itself).contains("plane 1 was taken off"));
    let beyond = Made { references: [9, 2, -1, 1, 2, -1, -1, 6, 4], ..Made::new() };
    assert!(refusal(&beyond).contains("a reference '9' in its header is outside -1..8"));
    let moved = Made { motion: [0, 0, 0, -3, 0, 0, 0, 0, 0], ..Made::new() };
    assert!(refusal(&moved).contains("motion compensation of plane 3"));
    // A plane wider than the picture, one with three channels, one that is none, one that is cut short.
    let mut made = Made::new();
    made.planes[5] = jpeg_of(&[9; 14 * 7], (14, 7), ColorType::Luma);
    let refused = refusal(&made);
    assert!(
        refused.contains("plane 5: its JPEG has 14 x 7 pixels of 1 channels where 13 x 7 of 1"),
        "{refused}"
    );
    made.planes[5] = jpeg_of(&[9; 13 * 7 * 3], (13, 7), ColorType::Rgb);
    assert!(refusal(&made).contains("13 x 7 pixels of 3 channels"));
    made.planes[5] = b"GIF89a".to_vec();
    assert!(refusal(&made).contains("plane 5: is no JPEG"));
    let mut made = Made::new();
    let length = made.planes[7].len();
    made.planes[7].truncate(length - 20);
    assert!(refusal(&made).contains("plane 7: truncated or damaged JPEG"));
    let whole = Made::new().bytes();
    for length in (0..whole.len()).step_by(7).chain([whole.len() - 1]) {
        fs::write(&path, &whole[..length]).unwrap();
        assert!(read_asset(&path, LIMIT).is_err(), "{length} bytes of {}", whole.len());
    }
}

/// A LUM file of 5 x 3 pixels.
pub(crate) fn luminance_file(matrix: &str) -> Vec<u8> {
    let head =
        format!("PTM_1.2\nPTM_FORMAT_LUM\n5\n3\n0.5 1.25 1e-1 2.0 1 0.75\n-107 300 128 0 255 12\n{matrix}\n");
    head.into_bytes().into_iter().chain((0..15 * 8).map(|i: u32| (i * 37 % 251) as u8)).collect()
}

/// Y, Cr and Cb as JFIF has them, in columns.
pub(crate) const COLUMNS: &str =
    "1 1.402 0 -179.456\n1 -0.714136 -0.344136 135.458816\n1 0 1.772 -226.816\n0 0 0 1";

#[test]
fn luminance_and_chrominance_become_rgb_as_the_matrix_says() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ptm");
    fs::write(&path, luminance_file(COLUMNS)).unwrap();
    // An eighth of an 8-bit step: the constants are halves, 11 bits of what is at most 2.
    assert_reads_alike(&path, 1.0 / 255.0 / 8.0);
    let maps = read_asset(&path, LIMIT).unwrap();
    assert_eq!((maps.model.layout, maps.planes.len()), (Layout::Rgb, 18));
    assert_eq!(read_packed(&path, LIMIT).unwrap().texels[0][0].len(), 2 * 18 * 15);
    // The same in rows.
    let rows = "1 1 1 0\n1.402 -0.714136 0 0\n0 -0.344136 1.772 0\n-179.456 135.458816 -226.816 1";
    fs::write(&path, luminance_file(rows)).unwrap();
    assert_eq!(read_asset(&path, LIMIT).unwrap(), maps);
    let refusal = |matrix: &str| {
        fs::write(&path, luminance_file(matrix)).unwrap();
        read_asset(&path, LIMIT).unwrap_err().to_string()
    };
    assert!(refusal(&"1 ".repeat(16)).contains("ends with neither a row nor a column of 0 0 0 1"));
    let huge = COLUMNS.replace("1 -0.7", "1e42 -0.7");
    assert!(refusal(&huge).contains("exceeds 3.4e38"));
    assert!(refusal("1 2 3 4").contains("its header"));
    // Beyond what halves hold, a scale helps.
    let large = COLUMNS.replace("1.402", "1e7");
    fs::write(&path, luminance_file(&large)).unwrap();
    let maps = read_asset(&path, LIMIT).unwrap();
    assert!(maps.coefficient_map().planes[15].iter().any(|&c| c > 1e6 && c.is_finite()));
}

#[test]
fn forms_that_are_not_read_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ptm");
    let head = |form: &str| format!("PTM_1.2\n{form}\n5\n3\n1 1 1 1 1 1\n0 0 0 0 0 0\n");
    for form in
        ["PTM_FORMAT_PTM_LUT", "PTM_FORMAT_PTM_C_LUT", "PTM_FORMAT_JPEGLS_RGB", "PTM_FORMAT_JPEGLS_LRGB"]
    {
        fs::write(&path, head(form)).unwrap();
        let refused = read_asset(&path, LIMIT).unwrap_err();
        assert!(matches!(refused, FormatError::Unsupported { .. }));
        assert!(refused.to_string().contains(&format!("holds {form}; relight reads")), "{refused}");
    }
    fs::write(&path, head("PTM_FORMAT_LRGB2")).unwrap();
    let refused = read_asset(&path, LIMIT).unwrap_err().to_string();
    assert!(refused.contains("'PTM_FORMAT_LRGB2', which is no format of PTM files"), "{refused}");
    replace_in_file(&path, b"PTM_1.2", b"PTM_1.9");
    assert!(read_asset(&path, LIMIT).unwrap_err().to_string().contains("version PTM_1.9"));
}
