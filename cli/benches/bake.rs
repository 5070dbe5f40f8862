//! Time and memory of whole bakes beside `djpeg` decoding the same pictures, and of each stage.
//!
//! `make bench` runs it. It wants `../shared/data/relief1024` (50 JPEGs of 1 MP) and takes
//! `testdata/icon72` where that is missing; with `RELIGHT_BENCH_SET=FOLDER` any other. CPU seconds are
//! medians of `ROUNDS` runs that alternate between the commands, so that other work on the machine
//! touches all of them.

use nix::sys::resource::{UsageWho, getrusage};
use relight_core::weighted_sums::{Rows, weighted_sums};
use relight_core::{CpuLevel, Design, Family, Layout, Model, Space, Stack};
use relight_fit::{
    FitError, LeastSquares, LightWeights, Ridge, SPAN, Sample, coefficient_distributions, for_each_span,
};
use relight_formats::{
    AssetFormat, AssetHeader, FormatError, OutputFile, PictureStack, StackSettings, WriteSettings,
    open_capture,
};
use relight_texture::{
    ArrayPlan, Coding, LayerPlan, Packing, Precision, RangeRule, Wrap, choose_range, error_ceilings,
    planes_of_layers,
};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::AtomicBool;

const ROUNDS: usize = 5;

fn main() {
    let set = set();
    println!("set: {}", set.display());
    whole_programs(&set);
    for (family, count) in [("ptm", 6), ("srbf", 25)] {
        stages(&set, family, count);
    }
    kernel();
}

fn set() -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let asked = std::env::var_os("RELIGHT_BENCH_SET").map(PathBuf::from);
    asked.unwrap_or_else(|| {
        let large = root.join("../shared/data/relief1024");
        if large.exists() { large } else { root.join("testdata/icon72") }
    })
}

/// CPU seconds (user and system) of this process' threads or of its children so far.
fn cpu_seconds(who: UsageWho) -> f64 {
    let usage = getrusage(who).expect("rusage");
    let seconds = |time: nix::sys::time::TimeVal| time.tv_sec() as f64 + time.tv_usec() as f64 * 1e-6;
    seconds(usage.user_time()) + seconds(usage.system_time())
}

fn whole_programs(set: &Path) {
    let pictures = open_capture(set).expect("a capture").capture.pictures;
    let out = std::env::temp_dir().join("relight-bench.ktx2");
    let bake = |options: &[&str]| {
        let status = Command::new(env!("CARGO_BIN_EXE_relight"))
            .arg("bake")
            .arg(set)
            .arg("-o")
            .arg(&out)
            .args(options)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status();
        assert!(status.expect("relight runs").success());
    };
    let djpeg = || {
        pictures.iter().all(|path| {
            let decoded = Command::new("djpeg").args(["-outfile", "/dev/null"]).arg(path).status();
            decoded.is_ok_and(|status| status.success())
        })
    };
    let programs: [(&str, &[&str]); 2] =
        [("ptm 6, u8", &[]), ("srbf 25, u8", &["--basis", "srbf", "-k", "25"])];
    let mut times = vec![Vec::new(); programs.len() + 1];
    for _ in 0..ROUNDS {
        let before = cpu_seconds(UsageWho::RUSAGE_CHILDREN);
        if djpeg() {
            times[programs.len()].push(cpu_seconds(UsageWho::RUSAGE_CHILDREN) - before);
        }
        for ((_, options), times) in programs.iter().zip(&mut times) {
            let before = cpu_seconds(UsageWho::RUSAGE_CHILDREN);
            bake(options);
            times.push(cpu_seconds(UsageWho::RUSAGE_CHILDREN) - before);
        }
    }
    let decode = times.pop().filter(|times| times.len() == ROUNDS).map(median);
    match decode {
        Some(seconds) => println!("djpeg          {seconds:6.2} CPU s"),
        None => println!("djpeg is missing or can't read the set; no ratio (Debian: libjpeg-turbo-progs)"),
    }
    for ((name, _), times) in programs.iter().zip(times) {
        let seconds = median(times);
        let ratio = decode.map_or(String::new(), |decode| format!("  {:.2} times djpeg", seconds / decode));
        println!("{name:<14} {seconds:6.2} CPU s{ratio}");
    }
    let peak = getrusage(UsageWho::RUSAGE_CHILDREN).expect("rusage").max_rss();
    println!("peak memory of the largest of them: {} MiB", peak / 1024);
    // Left-over output is not worth failing for.
    let _ = std::fs::remove_file(out);
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// CPU seconds of each stage, by running ever more of them.
fn stages(set: &Path, family: &str, count: usize) {
    let capture = open_capture(set).expect("a capture");
    let level = CpuLevel::detect();
    let cancel = AtomicBool::new(false);
    let folder = std::env::temp_dir();
    let settings = StackSettings {
        space: Space::Encoded,
        memory: 8 << 30,
        kept_back: 0,
        threads: rayon::current_num_threads(),
        spill_folder: &folder,
        level,
        cancel: &cancel,
        progress: &|_| {},
    };
    let (decode, stack) = timed(|| PictureStack::load(&capture, &settings).expect("pictures"));
    let directions = capture.capture.lights.directions();
    let design = Design::new(count, &capture.capture.lights);
    let basis = Family::by_name(family).expect("a family").build(&design).expect("a basis");
    let (solve, fit) = timed(|| {
        let sample = Sample::of(&stack).expect("samples");
        LeastSquares::new(basis, &directions, LightWeights::Voronoi, Ridge::Auto, &sample).expect("a fit")
    });
    let (rebin, ()) = timed(|| rebin_only(&stack));
    let layout = if stack.channels() == 3 { Layout::Rgb } else { Layout::Grey };
    let (once, ()) = timed(|| {
        for_each_span(&stack, (&fit, layout), level, SPAN, |_| Ok::<(), FitError>(())).expect("a fit")
    });
    let (ranged, distributions) = timed(|| {
        coefficient_distributions(&stack, (&fit, layout), level, || Ok::<(), FitError>(())).expect("ranges")
    });
    let path = folder.join("relight-bench-stages.ktx2");
    let model = Model {
        basis: fit.basis.clone(),
        layout,
        space: Space::Encoded,
        lights: directions,
        figures: None,
        provenance: None,
    };
    let format = AssetFormat::by_path(&path).expect("ktx2");
    let texels = format.plain_format(layout, Precision::U8);
    let (chosen, quantizers) = timed(|| {
        let choose = |(distribution, ceiling)| {
            choose_range(distribution, texels, RangeRule::MinError, ceiling).expect("a range").quantizer
        };
        distributions.iter().zip(error_ceilings(&model)).map(choose).collect::<Vec<_>>()
    });
    let layers = planes_of_layers(&model, texels)
        .into_iter()
        .map(|planes| LayerPlan { quantizers: planes.iter().map(|&p| quantizers[p]).collect(), planes })
        .collect();
    let packing =
        Packing { arrays: vec![ArrayPlan { format: texels, layers }], levels: 1, wrap: Wrap::Clamp };
    let header = AssetHeader { width: stack.width(), height: stack.height(), model, packing };
    let settings = WriteSettings {
        coding: Coding::default(),
        zstd: None,
        split: false,
        jpeg_quality: None,
        deepzoom: false,
        memory_limit: 1 << 30,
    };
    let (written, ()) = timed(|| {
        let writer = format.create(&path, header, &settings).expect("a writer");
        for_each_span(&stack, (&fit, layout), level, SPAN, |span| {
            writer.write(span).map_err(|_| FitError::NoLights)
        })
        .expect("a fit");
        writer.finish().expect("a file");
    });
    let size = std::fs::metadata(&path).map_or(0, |metadata| metadata.len());
    let (bytes_only, ()) = timed(|| write_bytes(&path, size).expect("a file"));
    let _ = std::fs::remove_file(path);
    println!("{family} {count}, CPU s by stage:");
    println!(
        "  decode {decode:.3}, sample and solve {solve:.3}, rebin {rebin:.3} a pass, fit {:.3} a pass,",
        once - rebin
    );
    println!(
        "  distributions {:.3}, choose ranges {chosen:.3}, quantise {:.3}, write {bytes_only:.3} ({} MB)",
        ranged - once,
        written - once - bytes_only,
        size / 1_000_000
    );
}

/// Runs `work` and gives the CPU seconds of this process for it.
fn timed<T>(work: impl FnOnce() -> T) -> (f64, T) {
    let before = cpu_seconds(UsageWho::RUSAGE_SELF);
    let result = work();
    (cpu_seconds(UsageWho::RUSAGE_SELF) - before, result)
}

/// Gathers every tile and does nothing with it.
fn rebin_only(stack: &PictureStack) {
    let total = stack.pixels() * stack.channels();
    let tile = 640;
    let mut rows = vec![0.0f32; stack.lights() * tile];
    for first in (0..total).step_by(tile) {
        let width = tile.min(total - first);
        let source = stack.rows(first..first + width).expect("rows");
        for (light, row) in rows.chunks_exact_mut(tile).enumerate() {
            source.copy(light, 0, &mut row[..width]);
        }
        std::hint::black_box(&rows);
    }
}

/// Writes as many bytes as an asset has, in pieces of a span's layer.
fn write_bytes(path: &Path, size: u64) -> Result<(), FormatError> {
    let file = OutputFile::create(path)?;
    let piece = vec![7u8; 32 << 10];
    for at in (0..size).step_by(piece.len()) {
        file.write_at(at, &piece[..piece.len().min((size - at) as usize)])?;
    }
    file.finish()
}

/// Speed of the product k = 25, N = 50 on tiles in the cache.
fn kernel() {
    let (rows, terms, width) = (25, 50, 960);
    let matrix: Vec<f32> = (0..rows * terms).map(|i| (i % 17) as f32 * 0.1).collect();
    let input = vec![0.5f32; terms * width];
    let mut output = vec![0.0f32; rows * width];
    for level in CpuLevel::available() {
        let repeats = 400;
        let (seconds, ()) = timed(|| {
            for _ in 0..repeats {
                let into = Rows { samples: &mut output[..], stride: width };
                weighted_sums(
                    level,
                    &matrix,
                    terms,
                    Rows { samples: &input[..], stride: width },
                    into,
                    width,
                );
                std::hint::black_box(&output);
            }
        });
        let flops = 2.0 * (rows * terms * width * repeats) as f64;
        println!("product 25 x 50, {:>8}: {:5.1} GFLOP/s", level.name(), flops / seconds * 1e-9);
    }
}
