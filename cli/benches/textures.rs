//! What block formats cost: bytes, relit error on lights that were left out, and encoding time, as the
//! Markdown tables of docs/accuracy.md.
//!
//! `make accuracy` runs it. It wants `../shared/data/relief1024`, and takes `testdata/icon72` where that is
//! missing. Encoding speed is the CPU time of a bake less that of one without blocks.

use nix::sys::resource::{UsageWho, getrusage};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;

const BASES: [&str; 2] = ["ptm -k 6", "srbf -k 25"];

/// Formats, and the qualities that are tried of each.
const FORMATS: [(&str, &[&str]); 6] = [
    ("none", &["normal"]),
    ("bc1", &["fast", "normal", "high"]),
    ("bc4", &["fast", "normal", "high"]),
    ("bc5", &["fast", "normal", "high"]),
    ("bc6h", &["fast", "normal"]),
    ("bc7", &["fast", "normal", "high"]),
];

/// Sets on which losses are bounded, with what judges them.
const LOSSES: [(&str, &str, &str); 2] = [
    ("icon72, every:6 left out", "testdata/icon72", "every:6"),
    ("relief256 -> test", "../shared/data/relief256", "../shared/data/relief256_test/lights.lp"),
];

struct Baked {
    psnr: f64,
    relit_cost: f64,
    bits: f64,
    megapixels: f64,
    cpu_seconds: f64,
}

fn main() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let large = root.join("../shared/data/relief1024");
    let set = if large.exists() { large } else { root.join("testdata/icon72") };
    println!(
        "{}, every:5 left out\n",
        set.file_name().map_or_else(String::new, |n| n.to_string_lossy().into())
    );
    println!(
        "| basis | format | quality | bytes a pixel | PSNR of unseen lights | cost of storing, rms | encoding MPix/s |"
    );
    println!("|---|---|---|---|---|---|---|");
    for basis in BASES {
        let plain = bake(&set, basis, &["--precision", "f32"], "every:5");
        println!("| {basis} | f32 | - | {:.1} | {:.2} | - | - |", plain.bits / 8.0, plain.psnr);
        let mut without = None;
        for (format, qualities) in FORMATS {
            // The small basis tells qualities apart in a quarter of the time.
            for quality in qualities.iter().filter(|&&quality| quality == "normal" || basis == BASES[0]) {
                let baked = bake(&set, basis, &["--block", format, "--quality", quality], "every:5");
                let before = *without.get_or_insert(baked.cpu_seconds);
                let seconds = baked.cpu_seconds - before;
                let speed =
                    if seconds > 0.0 { format!("{:.2}", baked.megapixels / seconds) } else { "-".to_owned() };
                let name = if format == "none" { "u8" } else { format };
                println!(
                    "| {basis} | {name} | {} | {:.1} | {:.2} | {:.5} | {speed} |",
                    if format == "none" { "-" } else { quality },
                    baked.bits / 8.0,
                    baked.psnr,
                    baked.relit_cost,
                );
            }
        }
    }
    println!("\nLoss in dB against float on unseen lights\n");
    println!(
        "| set | basis | u8 | bc1 | bc4 | bc5 | bc6h | bc7 | auto |\n|---|---|---|---|---|---|---|---|---|"
    );
    for (name, folder, judge) in LOSSES.into_iter().filter(|(_, folder, _)| root.join(folder).exists()) {
        let judge = if judge.contains('/') { root.join(judge) } else { PathBuf::from(judge) };
        let judge = judge.to_string_lossy();
        for basis in BASES {
            let psnr = |options: &[&str]| bake(&root.join(folder), basis, options, &judge).psnr;
            let float = psnr(&["--precision", "f32"]);
            print!("| {name} | {basis} |");
            for format in ["none", "bc1", "bc4", "bc5", "bc6h", "bc7", "auto"] {
                print!(" {:.2} |", float - psnr(&["--block", format]));
            }
            println!();
        }
    }
}

/// CPU seconds (user and system) of this process' children so far.
fn cpu_seconds() -> f64 {
    let usage = getrusage(UsageWho::RUSAGE_CHILDREN).expect("rusage");
    let seconds = |time: nix::sys::time::TimeVal| time.tv_sec() as f64 + time.tv_usec() as f64 * 1e-6;
    seconds(usage.user_time()) + seconds(usage.system_time())
}

fn bake(set: &Path, basis: &str, options: &[&str], judge: &str) -> Baked {
    let folder = std::env::temp_dir();
    let (asset, report) = (folder.join("relight-textures.ktx2"), folder.join("relight-textures.json"));
    let before = cpu_seconds();
    let status = Command::new(env!("CARGO_BIN_EXE_relight"))
        .args(["bake", "--basis"])
        .args(basis.split(' '))
        .args(options)
        .args(["--holdout", judge, "-o"])
        .arg(&asset)
        .arg("--report")
        .arg(&report)
        .arg(set)
        .output();
    assert!(status.expect("relight runs").status.success());
    let cpu_seconds = cpu_seconds() - before;
    let report: Value =
        serde_json::from_str(&std::fs::read_to_string(&report).expect("a report")).expect("JSON");
    let number = |value: &Value| value.as_f64().unwrap_or(f64::NAN);
    let mean = &report["holdout"]["mean"];
    let pixels = number(&report["width"]) * number(&report["height"]);
    Baked {
        psnr: mean.get("psnr_encoded").or(mean.get("psnr")).map_or(f64::NAN, number),
        relit_cost: number(&report["storing"]["relit_rmse"]),
        bits: number(&report["storing"]["bits_per_pixel"]),
        megapixels: number(&report["storing"]["layers"]) * pixels * 1e-6,
        cpu_seconds,
    }
}
