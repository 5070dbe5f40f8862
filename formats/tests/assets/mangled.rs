//! Damaged files are errors or results, within the memory limit.

use crate::lopsided::{LIMIT, PLAIN, SplitMix, lopsided, names_in};
use crate::position_files::write_exr;
use crate::positions;
use crate::ptm_forms::{COLUMNS, luminance_file};
use relight_core::{Layout, PositionMap};
use relight_formats::asset::{WriteSettings, describe_asset, read_asset, read_packed, read_positions};
use relight_formats::{
    FormatError, describe, read_camera_file, read_depth_file, read_position_file, write_position_file,
};
use relight_texture::{BlockFormat, Precision, TexelFormat};
use std::alloc::{GlobalAlloc, Layout as MemoryLayout, System};
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

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
    unsafe fn alloc_zeroed(&self, layout: MemoryLayout) -> *mut u8 {
        LARGEST.fetch_max(layout.size(), Ordering::Relaxed);
        // SAFETY: as the caller promises.
        unsafe { System.alloc_zeroed(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: MemoryLayout) {
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(pointer, layout) }
    }
}

/// Writes an asset of nine planes at `path`.
fn write(path: &Path, kind: &str) {
    let (family, count) = if kind == "hsh" { ("hsh", 4) } else { ("ptm", 6) };
    let asset = lopsided(family, count, Layout::Lrgb, (23, 37));
    let block = TexelFormat::Block;
    let (packing, settings) = match kind {
        "plain" | "hsh" => (asset.plain(path, Precision::U8), PLAIN),
        "jpeg" => {
            let settings = WriteSettings { jpeg_quality: Some(80), ..PLAIN };
            (asset.plain(path, Precision::U8), settings)
        }
        "learned" => {
            let asset = lopsided("pca", 4, Layout::Shared, (23, 37));
            return asset.write_plain(path, Precision::U8).map(drop).unwrap();
        }
        "luminance" => return fs::write(path, luminance_file(COLUMNS)).unwrap(),
        "half" => (asset.plain(path, Precision::F16), PLAIN),
        "blocks" => (asset.packing(block(BlockFormat::Bc7), 6), PLAIN),
        "zstd" => (asset.packing(block(BlockFormat::Bc5Signed), 6), WriteSettings { zstd: Some(3), ..PLAIN }),
        "several" => (asset.packing_of_several(&[BlockFormat::Bc1, BlockFormat::Bc6h].map(block), 2), PLAIN),
        "positions" => {
            let precision = if path.ends_with("a.exr") { Precision::F32 } else { Precision::F16 };
            let settings = WriteSettings { zstd: path.ends_with("a.ktx2").then_some(3), ..PLAIN };
            let packing = asset.plain(path, Precision::F16);
            return positions::write(&asset, path, &packing, &settings, precision).unwrap();
        }
        other => panic!("{other}"),
    };
    asset.write(path, &packing, &settings, 1).unwrap();
}

/// Flips bits, sets bytes and cuts, mostly at the beginning, where most of what can go wrong is said.
fn mangle(whole: &[u8], round: usize, random: &mut SplitMix) -> Vec<u8> {
    let mut bytes = whole.to_vec();
    if round.is_multiple_of(5) {
        bytes.truncate(random.next(whole.len()));
    }
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
    bytes
}

#[test]
fn mangled_assets_are_errors_or_results_within_the_memory_limit() {
    let kinds = [
        ("a.ptm", "plain"),
        ("a.ptm", "jpeg"),
        ("a.ptm", "luminance"),
        ("a.rti", "hsh"),
        ("a.web", "plain"),
        ("a.web", "learned"),
        ("a.exr", "half"),
        ("a.ktx2", "plain"),
        ("a.ktx2", "blocks"),
        ("a.ktx2", "zstd"),
        ("a.ktx2", "several"),
        ("a.dds", "blocks"),
        ("a.dds", "several"),
        ("a.exr", "positions"),
        ("a.ktx2", "positions"),
        ("a.dds", "positions"),
    ];
    for (name, kind) in kinds {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        write(&path, kind);
        let around = if path.is_dir() { &path } else { folder.path() };
        for damaged in names_in(around) {
            // Planes are read whatever happens to positions.
            let of_positions = damaged.contains("_positions");
            let damaged = around.join(damaged);
            let whole = fs::read(&damaged).unwrap();
            let (mut random, mut results) = (SplitMix(7), 0);
            let rounds = 300;
            for round in 0..rounds {
                fs::write(&damaged, mangle(&whole, round, &mut random)).unwrap();
                let _ = describe_asset(&path);
                let _ = describe(&damaged);
                if let Ok(maps) = read_asset(&path, LIMIT) {
                    results += usize::from(!of_positions);
                    assert!(maps.planes.iter().all(|plane| plane.texels.len() == maps.width * maps.height));
                }
                if let Ok(Some(map)) = read_positions(&path, LIMIT) {
                    results += usize::from(of_positions);
                    assert_eq!(map.points.len(), map.width * map.height);
                }
                if let Ok(packed) = read_packed(&path, LIMIT) {
                    assert_eq!(packed.texels.len(), packed.packing.arrays.len());
                    assert!(packed.texels.iter().all(|levels| levels.len() == packed.packing.levels));
                }
            }
            fs::write(&damaged, whole).unwrap();
            let words = format!("{name} {kind} {}: {results} of {rounds} were read", damaged.display());
            assert!((rounds / 50..rounds - 10).contains(&results), "{words}");
        }
    }
    let largest = LARGEST.load(Ordering::Relaxed) as u64;
    assert!(largest <= LIMIT, "{largest} bytes were asked for at once");
}

#[test]
fn mangled_cameras_depths_and_positions_are_errors_or_results_within_the_memory_limit() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let values: Vec<f32> = (0..23 * 37).map(|i| i as f32 * 0.37).collect();
    write_exr(&path("depth.exr"), (23, 37), &[("R", &values), ("half Z", &values)]);
    let points = values.iter().map(|&v| [v, -v, 1.0]).collect();
    write_position_file(&path("p.exr"), &PositionMap { width: 23, height: 37, points }).unwrap();
    let camera = Path::new(env!("CARGO_MANIFEST_DIR")).join("../testdata/positions/court/camera.json");
    fs::write(path("camera.json"), fs::read(camera).unwrap()).unwrap();
    let toml = "kind = 'ortho'\nwidth = 3\nheight = 2\nwidth_units = 5\neye = [1, 2, 3]\nup = [0, 0.6, 0.8]\n\
        forward = [0, 0.8, -0.6]\nv = 'eye_to_scene'\n";
    // A comment, in which some damage is harmless.
    fs::write(path("camera.toml"), format!("{toml}# {}", "by hand ".repeat(60))).unwrap();
    for name in ["depth.exr", "p.exr", "camera.json", "camera.toml"] {
        let whole = fs::read(path(name)).unwrap();
        let (mut random, mut results, rounds) = (SplitMix(11), 0, 400);
        for round in 0..rounds {
            fs::write(path(name), mangle(&whole, round, &mut random)).unwrap();
            let depth = read_depth_file(&path(name), None, 1.0, LIMIT);
            let map = read_position_file(&path(name), LIMIT);
            let camera = read_camera_file(&path(name));
            let _ = describe(&path(name));
            if let Ok(depth) = &depth {
                assert_eq!(depth.depths.len(), depth.width * depth.height);
            }
            if let Ok(map) = &map {
                assert_eq!(map.points.len(), map.width * map.height);
            }
            if let Ok(camera) = &camera {
                let numbers = [camera.right, camera.up, camera.forward, camera.eye];
                assert!(numbers.iter().flatten().all(|c| c.is_finite()), "{camera:?}");
            }
            results += usize::from(depth.is_ok() || map.is_ok() || camera.is_ok());
        }
        // Text hardly survives anything.
        assert!((1..rounds - 10).contains(&results), "{name}: {results} of {rounds} were read");
    }
    let largest = LARGEST.load(Ordering::Relaxed) as u64;
    assert!(largest <= LIMIT, "{largest} bytes were asked for at once");
}

/// A KTX2 file with `bytes` at `at`, read.
fn patched(path: &Path, patches: &[(usize, &[u8])]) -> FormatError {
    let whole = fs::read(path).unwrap();
    let mut bytes = whole.clone();
    for (at, patch) in patches {
        bytes[*at..at + patch.len()].copy_from_slice(patch);
    }
    fs::write(path, bytes).unwrap();
    let refused = read_asset(path, LIMIT).unwrap_err();
    assert!(read_packed(path, LIMIT).is_err());
    fs::write(path, whole).unwrap();
    refused
}

#[test]
fn headers_that_claim_too_much_are_refused_before_memory_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ktx2");
    write(&path, "zstd");
    // 2^20 x 2^19 texels, levels to match: what decompression promises is not believed.
    let (width, height) = (1u32 << 20, 1u32 << 19);
    let mut patches: Vec<(usize, Vec<u8>)> =
        vec![(20, width.to_le_bytes().to_vec()), (24, height.to_le_bytes().to_vec())];
    for level in 0..6u32 {
        let blocks = u64::from(width >> level).div_ceil(4) * u64::from(height >> level).div_ceil(4);
        let layers = u64::from(u32::from_le_bytes(fs::read(&path).unwrap()[32..36].try_into().unwrap()));
        patches.push((80 + 24 * level as usize + 16, (blocks * 16 * layers).to_le_bytes().to_vec()));
    }
    let patches: Vec<(usize, &[u8])> = patches.iter().map(|(at, bytes)| (*at, &bytes[..])).collect();
    let refused = patched(&path, &patches);
    assert!(matches!(refused, FormatError::TooLarge { .. }), "{refused}");
    // One level too few bytes, too many levels, a scheme that nobody knows, BasisLZ.
    let refused = patched(&path, &[(96, &1u64.to_le_bytes())]).to_string();
    assert!(refused.contains("has 1 bytes of texels in level 0"), "{refused}");
    let refused = patched(&path, &[(40, &[7])]).to_string();
    assert!(refused.contains("has 7 mip levels; 23 x 37 texels have 6 at most"), "{refused}");
    let refused = patched(&path, &[(44, &[77])]).to_string();
    assert!(refused.contains("(77); relight reads Zstandard and none"), "{refused}");
    let refused = patched(&path, &[(44, &[1])]).to_string();
    assert!(refused.contains("BasisLZ"), "{refused}");
    // A level beyond the end of the file.
    let refused = patched(&path, &[(85, &[1])]).to_string();
    assert!(refused.contains("is cut short: level 0"), "{refused}");
}

#[test]
fn a_compressed_level_that_is_longer_or_shorter_than_it_claims_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ktx2");
    write(&path, "zstd");
    let bytes = fs::read(&path).unwrap();
    let word = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
    // Level 0 stands last: replace it by frames of other lengths.
    let (offset, uncompressed) = (word(80) as usize, word(96) as usize);
    for (length, words) in [(uncompressed - 1, "cut short"), (uncompressed + 1, "holds more than its")] {
        let frame = zstd::bulk::compress(&vec![3; length], 3).unwrap();
        let mut other = bytes[..offset].to_vec();
        other[88..96].copy_from_slice(&(frame.len() as u64).to_le_bytes());
        other.extend(frame);
        fs::write(&path, other).unwrap();
        let refused = read_asset(&path, LIMIT).unwrap_err().to_string();
        assert!(refused.contains(words), "{refused}");
        assert_eq!(read_packed(&path, LIMIT).unwrap_err().to_string(), refused);
    }
}

#[test]
fn every_truncation_of_a_texture_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.ktx2", "a.dds"] {
        let path = folder.path().join(name);
        write(&path, "blocks");
        let whole = fs::read(&path).unwrap();
        for length in (0..200).chain((200..whole.len()).step_by(61)).chain([whole.len() - 1]) {
            fs::write(&path, &whole[..length]).unwrap();
            assert!(read_asset(&path, LIMIT).is_err(), "{name} of {length} bytes");
        }
    }
}
