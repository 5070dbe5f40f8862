//! Assets through files: round trips, other readers, golden bytes, mangled bytes.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

use half::f16;
use relight_core::CoefficientRange;
use relight_core::basis::Ptm;
use relight_core::relighter::relight;
use relight_core::{
    Basis, CoefficientSpan, CpuLevel, Design, Direction, Family, FitFigures, Layout, LightSet, Model,
    RelightingMaps, Space, Texels,
};
use relight_formats::FormatError;
use relight_formats::asset::{ASSET_FORMATS, AssetFormat, AssetHeader, describe_asset, read_asset};
use relight_texture::Precision;
use std::alloc::{GlobalAlloc, Layout as MemoryLayout, System};
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

const LIMIT: u64 = 64 << 20;
const LAYOUTS: [Layout; 3] = [Layout::Rgb, Layout::Lrgb, Layout::Grey];
const PRECISIONS: [Precision; 3] = [Precision::U8, Precision::F16, Precision::F32];

/// Remembers the largest single request for memory, so that one sized by a damaged header shows.
struct Watched;
static LARGEST: AtomicUsize = AtomicUsize::new(0);
#[global_allocator]
static ALLOCATOR: Watched = Watched;

// SAFETY: all work is the system allocator's.
unsafe impl GlobalAlloc for Watched {
    unsafe fn alloc(&self, layout: MemoryLayout) -> *mut u8 {
        LARGEST.fetch_max(layout.size(), Ordering::Relaxed);
        // SAFETY: as the caller promises.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: MemoryLayout) {
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(pointer, layout) }
    }
}

/// Steele, Lea, Flood, *Fast splittable pseudorandom number generators*.
struct SplitMix(u64);

impl SplitMix {
    fn next(&mut self, below: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % below as u64) as usize
    }
}

/// Planes with a value of their own in every pixel; base colours in 0..1.
struct Lopsided {
    header: AssetHeader,
    planes: Vec<Vec<f32>>,
}

fn lopsided(
    family: &str,
    count: usize,
    layout: Layout,
    size: (usize, usize),
    precision: Precision,
) -> Lopsided {
    let (width, height) = size;
    let light = |i: usize| Direction::new(i as f64 - 20.3, 7.1 - 0.37 * i as f64, 9.0 + i as f64).unwrap();
    let lights = LightSet::from_directions((0..41).map(light).collect());
    let basis = Family::by_name(family).unwrap().build(&Design::new(count, &lights)).unwrap();
    let figures = Some(FitFigures { fit_rmse: 0.012_345_678_9, leave_one_out_rmse: 0.1 / 3.0 });
    let model = Model { basis, layout, space: Space::Encoded, lights: lights.directions(), figures };
    let pixels = width * height;
    let value = |plane: usize, pixel: usize| {
        let unit = ((pixel * 7919 + plane * 104_729) % 100_003) as f32 / 100_003.0;
        let is_base = layout == Layout::Lrgb && plane >= count;
        if is_base { unit } else { (unit - 0.3) * (plane + 1) as f32 / 3.0 }
    };
    let planes = (0..model.plane_count()).map(|p| (0..pixels).map(|x| value(p, x)).collect()).collect();
    Lopsided { header: AssetHeader { width, height, model, precision }, planes }
}

impl Lopsided {
    fn ranges(&self) -> Vec<CoefficientRange> {
        let range = |plane: &Vec<f32>| {
            plane
                .iter()
                .fold(CoefficientRange::EMPTY, |all, &c| all.union(CoefficientRange { min: c, max: c }))
        };
        self.planes.iter().map(range).collect()
    }

    /// The slices of a [`CoefficientSpan`] of pixels `first..end`.
    fn span(&self, first: usize, end: usize) -> (Vec<f32>, Vec<f32>) {
        let functions = self.header.model.basis.count();
        let interleaved = |planes: &[Vec<f32>]| -> Vec<f32> {
            (first..end).flat_map(|x| planes.iter().map(move |plane| plane[x])).collect()
        };
        let channels = if self.header.model.layout == Layout::Rgb { 3 } else { 1 };
        let rows = self.planes[..functions * channels].chunks(channels).flat_map(interleaved).collect();
        (rows, interleaved(&self.planes[functions * channels..]))
    }

    /// Writes it from three threads in runs of uneven lengths, shuffled by `seed`.
    fn write(&self, path: &Path, seed: u64) -> Result<(), FormatError> {
        let format = AssetFormat::by_path(path)?;
        let ranges = if format.needs_ranges(self.header.precision) { self.ranges() } else { Vec::new() };
        let writer = format.create(path, self.header.clone(), &ranges, LIMIT)?;
        let (mut random, mut runs, mut first) = (SplitMix(seed), Vec::new(), 0);
        let pixels = self.header.width * self.header.height;
        while first < pixels {
            let end = (first + 1 + random.next(pixels / 3 + 2)).min(pixels);
            runs.push((first, end));
            first = end;
        }
        for i in (1..runs.len()).rev() {
            runs.swap(i, random.next(i + 1));
        }
        std::thread::scope(|scope| {
            let write = |runs: Vec<(usize, usize)>| {
                let writer = &writer;
                scope.spawn(move || {
                    runs.iter().try_for_each(|&(first, end)| {
                        let (functions, base_color) = self.span(first, end);
                        let pixels = end - first;
                        let (functions, base_color) = (&functions[..], &base_color[..]);
                        writer.write(&CoefficientSpan { first, pixels, functions, base_color })
                    })
                })
            };
            let threads = runs.chunks(runs.len().div_ceil(3)).map(|runs| write(runs.to_vec()));
            let threads: Vec<_> = threads.collect();
            threads.into_iter().try_for_each(|thread| thread.join().unwrap())
        })?;
        writer.finish()
    }
}

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
    for format in &ASSET_FORMATS {
        let (family, count) = if format.name == "ptm" { ("ptm", 6) } else { ("srbf", 7) };
        for (layout, precision) in LAYOUTS.iter().flat_map(|l| PRECISIONS.map(|p| (*l, p))) {
            for size in [(1, 1), (3, 5), (257, 130)] {
                let asset = lopsided(family, count, layout, size, precision);
                let path = folder.path().join(format!("asset.{}", format.extension));
                if format.check(&path, &asset.header).is_err() {
                    continue;
                }
                tried += 1;
                asset.write(&path, 1).unwrap();
                let once = fs::read(&path).unwrap();
                let maps = read_asset(&path, LIMIT).unwrap();
                check(&asset, &maps, format.name);
                asset.write(&path, 2).unwrap();
                assert!(fs::read(&path).unwrap() == once, "the bytes depend on the order of writing");
            }
        }
    }
    assert_eq!(tried, 3 * (9 + 6 + 2));
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3, "temporaries were left behind");
}

fn check(asset: &Lopsided, maps: &RelightingMaps, format: &str) {
    let AssetHeader { width, height, model, precision } = &asset.header;
    let ptm = format == "ptm";
    let mut expected = model.clone();
    if ptm {
        (expected.lights, expected.figures) = (Vec::new(), None);
    }
    assert_eq!((maps.width, maps.height, &maps.model), (*width, *height, &expected));
    assert_eq!(maps.planes.len(), asset.planes.len());
    for (p, (map, plane)) in maps.planes.iter().zip(&asset.planes).enumerate() {
        let words = format!("{format} {:?} {precision:?} {width}x{height} plane {p}", model.layout);
        if ptm {
            let mut coefficients = vec![0.0; plane.len()];
            map.coefficients(0, &mut coefficients);
            for (a, b) in coefficients.iter().zip(plane) {
                assert!((a - b).abs() <= 0.51 * map.scale / 255.0, "{words}: {a} for {b}");
            }
            continue;
        }
        let quantizer = precision.quantizer(asset.ranges()[p]);
        assert_eq!((map.scale, map.bias), (quantizer.scale, quantizer.bias), "{words}");
        let texels = match precision {
            Precision::U8 => Texels::U8(plane.iter().map(|&c| quantizer.code(c)).collect()),
            Precision::F16 => Texels::F16(plane.iter().map(|&c| quantizer.half(c)).collect()),
            Precision::F32 => Texels::F32(plane.clone()),
        };
        assert!(bits(&map.texels) == bits(&texels), "{words}");
    }
}

#[test]
fn halves_beyond_65504_are_scaled_in_ktx2_and_refused_in_exr() {
    let folder = tempfile::tempdir().unwrap();
    let mut asset = lopsided("hsh", 4, Layout::Grey, (5, 2), Precision::F16);
    asset.planes[2][7] = 1e6;
    asset.write(&folder.path().join("a.ktx2"), 1).unwrap();
    let maps = read_asset(&folder.path().join("a.ktx2"), LIMIT).unwrap();
    assert_eq!((maps.planes[2].scale, maps.coefficient_map().planes[2][7]), (1e6, 1e6));
    let refused = asset.write(&folder.path().join("a.exr"), 1).unwrap_err().to_string();
    assert!(refused.contains("1000000") && refused.contains("b02_l1m0.Y"), "{refused}");
    assert!(!folder.path().join("a.exr").exists());
}

#[test]
fn refusals_say_what_is_held_instead() {
    let folder = tempfile::tempdir().unwrap();
    let refusal = |name: &str, family: &str, count, precision, space| {
        let mut asset = lopsided(family, count, Layout::Rgb, (2, 2), precision);
        asset.header.model.space = space;
        asset.write(&folder.path().join(name), 1).unwrap_err().to_string()
    };
    let words = refusal("a.tiff", "ptm", 6, Precision::U8, Space::Encoded);
    assert!(words.ends_with("use .ktx2, .exr, .ptm"), "{words}");
    let words = refusal("a.ptm", "sh", 9, Precision::U8, Space::Encoded);
    assert!(words.contains("basis ptm with 6 functions, not sh with 9"), "{words}");
    let words = refusal("a.ptm", "ptm", 10, Precision::U8, Space::Encoded);
    assert!(words.contains("not ptm with 10"), "{words}");
    let words = refusal("a.PTM", "ptm", 6, Precision::U8, Space::Linear);
    assert!(words.contains("not linear"), "{words}");
    let words = refusal("a.exr", "ptm", 6, Precision::U8, Space::Encoded);
    assert!(words.contains("precision f16 or f32, not u8"), "{words}");
    let asset = lopsided("sh", 9, Layout::Rgb, (64, 64), Precision::F32);
    let exr = AssetFormat::by_name("exr").unwrap();
    let refused = exr.create(&folder.path().join("a.exr"), asset.header.clone(), &[], 1000).err().unwrap();
    assert!(matches!(refused, FormatError::TooLarge { needed: 442_368, limit: 1000, .. }), "{refused}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);

    let path = folder.path().join("a.ktx2");
    asset.write(&path, 1).unwrap();
    let refused = read_asset(&path, 1 << 16).unwrap_err();
    assert!(matches!(refused, FormatError::TooLarge { .. }), "{refused}");
    let bytes = fs::read(&path).unwrap();
    let at = bytes.windows(8).position(|window| window == b"relight\0").unwrap();
    let mut other = bytes.clone();
    other[at] = b'x';
    fs::write(&path, other).unwrap();
    let refused = read_asset(&path, LIMIT).unwrap_err().to_string();
    assert!(refused.contains("no key 'relight'"), "{refused}");
    let at = bytes.windows(10).position(|window| window == b"[3,4,5],\"s").unwrap();
    for (digit, plane) in [(1, b'0'), (3, b'9'), (5, b'4')] {
        let mut out_of_turn = bytes.clone();
        out_of_turn[at + digit] = plane;
        fs::write(&path, out_of_turn).unwrap();
        let refused = read_asset(&path, LIMIT).unwrap_err().to_string();
        assert!(refused.contains("out of turn"), "{refused}");
    }
    let mut zstd = bytes.clone();
    zstd[44] = 2;
    fs::write(&path, zstd).unwrap();
    let refused = read_asset(&path, LIMIT).unwrap_err().to_string();
    assert!(refused.contains("Zstandard"), "{refused}");
    fs::write(&path, "PTM_1.2\nPTM_FORMAT_JPEG_LRGB\n8\n8\n").unwrap();
    let refused = read_asset(&path, LIMIT).unwrap_err().to_string();
    assert!(refused.contains("PTM_FORMAT_JPEG_LRGB"), "{refused}");
    fs::write(&path, "GIF89a").unwrap();
    let refused = read_asset(&path, LIMIT).unwrap_err().to_string();
    assert!(refused.contains(".ktx2, .exr, .ptm"), "{refused}");
}

#[test]
fn a_map_with_missing_pixels_is_not_finished() {
    let folder = tempfile::tempdir().unwrap();
    for format in &ASSET_FORMATS {
        let precision = format.precisions[0];
        let asset = lopsided("ptm", 6, Layout::Rgb, (4, 3), precision);
        let path = folder.path().join(format!("a.{}", format.extension));
        let writer = format.create(&path, asset.header.clone(), &asset.ranges(), LIMIT).unwrap();
        let (functions, base_color) = asset.span(0, 11);
        let (functions, base_color) = (&functions[..], &base_color[..]);
        writer.write(&CoefficientSpan { first: 0, pixels: 11, functions, base_color }).unwrap();
        assert!(matches!(writer.finish(), Err(FormatError::Invalid { .. })), "{}", format.name);
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

/// A number of the JSON document, or of a list in it.
fn numbers(list: &serde_json::Value) -> Vec<f32> {
    list.as_array().unwrap().iter().map(|value| value.as_f64().unwrap() as f32).collect()
}

#[test]
fn another_reader_finds_ktx2_layers_and_evaluates_a_pixel_from_the_key() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ktx2");
    for (layout, layers) in [(Layout::Rgb, 6), (Layout::Lrgb, 3), (Layout::Grey, 6)] {
        let asset = lopsided("ptm", 6, layout, (7, 4), Precision::U8);
        asset.write(&path, 1).unwrap();
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
        for (texels, layer) in level.chunks(28 * channels).zip(document["layers"].as_array().unwrap()) {
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
fn ktx2_bytes_are_those_of_the_specification() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ktx2");
    let basis = Basis::Ptm(Ptm::with_count(6).unwrap());
    let lights = vec![Direction::OUT, Direction::try_from([0.6, 0.0, 0.8]).unwrap()];
    let figures = Some(FitFigures { fit_rmse: 0.25, leave_one_out_rmse: f64::INFINITY });
    let model = Model { basis, layout: Layout::Lrgb, space: Space::Encoded, lights, figures };
    let header = AssetHeader { width: 1, height: 1, model, precision: Precision::F32 };
    let planes = (0..9).map(|p| vec![p as f32 + 0.5]).collect();
    Lopsided { header, planes }.write(&path, 1).unwrap();

    let version = env!("CARGO_PKG_VERSION");
    let one = |planes: &str, ones: &str, zeros: &str| {
        format!(r#"{{"planes":[{planes}],"scale":[{ones}],"bias":[{zeros}]}}"#)
    };
    let text = format!(
        concat!(
            r#"{{"version":1,"basis":{{"family":"ptm","degree":2}},"layout":"lrgb","space":"encoded","#,
            r#""lights":[[0.0,0.0,1.0],[0.6,0.0,0.8]],"#,
            r#""error":{{"fit_rmse":0.25,"leave_one_out_rmse":null}},"layers":[{},{},{}]}}"#
        ),
        one("0,1,2,3", "1.0,1.0,1.0,1.0", "0.0,0.0,0.0,0.0"),
        one("4,5", "1.0,1.0", "0.0,0.0"),
        one("6,7,8", "1.0,1.0,1.0", "0.0,0.0,0.0"),
    );
    let mut keys = Vec::new();
    for (key, value) in
        [("KTXorientation", "rd"), ("KTXwriter", &format!("relight {version}")), ("relight", &text)]
    {
        let entry = format!("{key}\0{value}\0");
        keys.extend((entry.len() as u32).to_le_bytes());
        keys.extend(entry.bytes());
        keys.resize(keys.len().div_ceil(4) * 4, 0);
    }
    let texels = 104 + 92 + keys.len();
    let texels = texels.div_ceil(16) * 16;

    let mut expected = b"\xabKTX 20\xbb\r\n\x1a\n".to_vec();
    let words = |bytes: &mut Vec<u8>, words: &[u32]| bytes.extend(words.iter().flat_map(|w| w.to_le_bytes()));
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
    let written = fs::read(&path).unwrap();
    let first = written.iter().zip(&expected).position(|(a, b)| a != b);
    assert_eq!((first, written.len()), (None, expected.len()));
}

#[test]
fn another_reader_finds_exr_channels_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    for precision in [Precision::F16, Precision::F32] {
        let asset = lopsided("ptm", 6, Layout::Lrgb, (9, 33), precision);
        asset.write(&path, 1).unwrap();
        let image = exr::prelude::read_first_flat_layer_from_file(&path).unwrap();
        let names = ["b00_uu.Y", "b01_vv.Y", "b02_uv.Y", "b03_u.Y", "b04_v.Y", "b05_1.Y"];
        let names = names.iter().chain(&["base.R", "base.G", "base.B"]);
        let channels = &image.layer_data.channel_data.list;
        assert_eq!(channels.len(), 9);
        for (name, plane) in names.zip(&asset.planes) {
            let channel = channels.iter().find(|channel| channel.name.eq(name)).unwrap();
            let values: Vec<f32> = channel.sample_data.values_as_f32().collect();
            let stored = |c: &f32| match precision {
                Precision::F16 => f16::from_f32(*c).to_f32(),
                _ => *c,
            };
            assert!(values == plane.iter().map(stored).collect::<Vec<_>>(), "{name}");
        }
    }
}

/// A reader of `.ptm` written from FORMATS.md alone: the picture (0..1, top row first) under u, v.
fn picture_of_ptm(bytes: &[u8], u: f64, v: f64) -> Vec<f64> {
    let mut lines = Vec::new();
    let mut at = 0;
    let mut words = 0;
    // Version, format, width, height, 6 scales, 6 biases: 16 words on any number of lines.
    while words < 16 {
        let length = bytes[at..].iter().position(|&b| b == b'\n').unwrap();
        let line = std::str::from_utf8(&bytes[at..at + length]).unwrap();
        words += line.split_whitespace().count();
        lines.extend(line.split_whitespace().map(str::to_owned));
        at += length + 1;
    }
    let number = |i: usize| lines[i].parse::<f64>().unwrap();
    let (width, height) = (number(2) as usize, number(3) as usize);
    let data = &bytes[at..];
    let terms = [u * u, v * v, u * v, u, v, 1.0];
    let sum = |six: &[u8]| {
        (0..6).map(|j| (f64::from(six[j]) - number(10 + j)) * number(4 + j) * terms[j]).sum::<f64>()
    };
    let pixels = width * height;
    let mut picture = Vec::new();
    for row in 0..height {
        for column in 0..width {
            let pixel = (height - 1 - row) * width + column;
            for channel in 0..3 {
                let value = match (lines[0].as_str(), lines[1].as_str()) {
                    (_, "PTM_FORMAT_RGB") => sum(&data[(channel * pixels + pixel) * 6..]),
                    ("PTM_1.2", "PTM_FORMAT_LRGB") => {
                        sum(&data[pixel * 6..]) * f64::from(data[pixels * 6 + pixel * 3 + channel]) / 255.0
                    }
                    ("PTM_1.1", "PTM_FORMAT_LRGB") => {
                        sum(&data[pixel * 9..]) * f64::from(data[pixel * 9 + 6 + channel]) / 255.0
                    }
                    other => panic!("{other:?}"),
                };
                picture.push(value / 255.0);
            }
        }
    }
    picture
}

fn assert_reads_alike(path: &Path) {
    let maps = read_asset(path, LIMIT).unwrap();
    for light in [(0.3, -0.5, 0.8), (-0.7, 0.2, 0.4), (0.0, 0.0, 1.0)] {
        let light = Direction::new(light.0, light.1, light.2).unwrap();
        let expected = picture_of_ptm(&fs::read(path).unwrap(), light.x(), light.y());
        let picture = relight(&maps, light, CpuLevel::BASELINE);
        assert_eq!(picture.samples.len(), expected.len());
        for (i, (a, b)) in picture.samples.iter().zip(expected).enumerate() {
            assert!((f64::from(*a) - b).abs() <= 1e-5 * b.abs().max(1.0), "sample {i}: {a} for {b}");
        }
    }
}

#[test]
fn an_independent_reader_of_ptm_sees_the_same_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ptm");
    for layout in [Layout::Rgb, Layout::Lrgb] {
        let asset = lopsided("ptm", 6, layout, (13, 7), Precision::U8);
        asset.write(&path, 3).unwrap();
        let head = String::from_utf8_lossy(&fs::read(&path).unwrap()[..40]).into_owned();
        let word = if layout == Layout::Rgb { "RGB" } else { "LRGB" };
        assert!(head.starts_with(&format!("PTM_1.2\nPTM_FORMAT_{word}\n13\n7\n")), "{head}");
        assert_reads_alike(&path);
        // And the picture is that of the coefficients that were written.
        let planes = &asset.planes;
        let written = picture_of_ptm(&fs::read(&path).unwrap(), 0.0, 0.0);
        for (i, value) in written.iter().enumerate() {
            let (x, c) = (i / 3, i % 3);
            let expected = match layout {
                Layout::Rgb => planes[15 + c][x],
                _ => planes[5][x] * planes[6 + c][x],
            };
            assert!((value - f64::from(expected)).abs() < 0.03, "{layout:?} {i}: {value} for {expected}");
        }
    }
}

#[test]
fn untidy_ptm_headers_of_the_wild_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ptm");
    let heads = [
        "PTM_1.1\r\nPTM_FORMAT_RGB\r\n4 3\r\n0.5 1.25 1e-1 2.0 1 0.75 \r\n-107 300 128 0 255 12 \r\n",
        "PTM_1.1\nPTM_FORMAT_LRGB\n4 3\n0.5 1.25 0.1 2 1 0.75\n-107 300 128 0 255 12\n",
        "PTM_1.2 \nPTM_FORMAT_LRGB \n4\t\n3\n0.5 1.25 0.1\n2 1 0.75\n-107 300 128\n0 255 12\n",
    ];
    for head in heads {
        let mut bytes = head.as_bytes().to_vec();
        let pixel_bytes = if head.contains("LRGB") { 9 } else { 18 };
        // Blanks and line ends among the first bytes: they are pixels.
        bytes.extend(b" \n\r\t".iter().copied());
        bytes.extend((4..12 * pixel_bytes).map(|i: u32| (i * 37 % 251) as u8));
        fs::write(&path, &bytes).unwrap();
        assert_reads_alike(&path);
        fs::write(&path, &bytes[..bytes.len() - 1]).unwrap();
        let refused = read_asset(&path, LIMIT).unwrap_err().to_string();
        assert!(refused.contains("cut short"), "{refused}");
    }
}

#[test]
fn info_shows_the_header() {
    let folder = tempfile::tempdir().unwrap();
    for (name, detail) in
        [("a.ktx2", "R16G16B16A16_SFLOAT (VkFormat 97)"), ("a.exr", "zip block compression")]
    {
        let path = folder.path().join(name);
        lopsided("sh", 9, Layout::Rgb, (6, 5), Precision::F16).write(&path, 1).unwrap();
        let rows = describe_asset(&path).unwrap();
        let has = |name: &str, value: &str| rows.iter().any(|row| row.0 == name && row.1 == value);
        assert!(has("size", "6 x 5") && has("basis", "sh, 9 functions") && has("lights", "41"), "{rows:?}");
        assert!(rows.iter().any(|row| row.1 == detail), "{rows:?}");
    }
    let path = folder.path().join("a.ptm");
    lopsided("ptm", 6, Layout::Lrgb, (6, 5), Precision::U8).write(&path, 1).unwrap();
    let rows = describe_asset(&path).unwrap();
    assert!(rows.contains(&("version".to_owned(), "PTM_1.2".to_owned())), "{rows:?}");
}

#[test]
fn mangled_assets_are_errors_or_results_within_the_memory_limit() {
    let folder = tempfile::tempdir().unwrap();
    let (path, mangled) = (folder.path().join("whole"), folder.path().join("mangled"));
    for format in &ASSET_FORMATS {
        let named = path.with_extension(format.extension);
        let precision = format.precisions[0];
        lopsided("ptm", 6, Layout::Lrgb, (23, 37), precision).write(&named, 1).unwrap();
        let whole = fs::read(&named).unwrap();
        let (mut random, mut results) = (SplitMix(7), 0);
        for round in 0..500 {
            let mut bytes = whole.clone();
            if round % 5 == 0 {
                bytes.truncate(random.next(whole.len()));
            }
            // Half of the damage goes to the header, where most of what can go wrong is said.
            for _ in 0..1 + random.next(4) {
                let reach = if random.next(2) == 0 { 600.min(bytes.len()) } else { bytes.len() };
                if reach > 0 {
                    let at = random.next(reach);
                    bytes[at] = match random.next(3) {
                        0 => 0xff,
                        1 => 0,
                        _ => bytes[at] ^ (1 << random.next(8)),
                    };
                }
            }
            fs::write(&mangled, &bytes).unwrap();
            let _ = describe_asset(&mangled);
            if let Ok(maps) = read_asset(&mangled, LIMIT) {
                results += 1;
                assert!(maps.planes.iter().all(|plane| plane.texels.len() == maps.width * maps.height));
            }
        }
        assert!((20..480).contains(&results), "{}: {results} of 500 were read", format.name);
    }
    let largest = LARGEST.load(Ordering::Relaxed) as u64;
    assert!(largest <= LIMIT, "{largest} bytes were asked for at once");
}
