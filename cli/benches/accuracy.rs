//! What each basis reaches on real and rendered captures, as the Markdown table of docs/accuracy.md.
//!
//! `make accuracy` runs it. Captures of `../shared/data` that are missing are left out.

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Name, folder to fit, and what judges it.
const SETS: [(&str, &str, &str); 6] = [
    ("icon72, every:6 left out", "testdata/icon72", "every:6"),
    ("relief256 -> test", "../shared/data/relief256", "../shared/data/relief256_test/lights.lp"),
    ("synthrti dome -> test", "../shared/data/synthrti/dome", "../shared/data/synthrti/test/lights.lp"),
    ("court (linear) -> test", "../shared/data/court/train", "../shared/data/court/test/lights.lp"),
    ("house (linear) -> test", "../shared/data/house/train", "../shared/data/house/test/lights.lp"),
    ("caustics (linear) -> test", "../shared/data/caustics/train", "../shared/data/caustics/test/lights.lp"),
];

const BASES: [&str; 12] = [
    "ptm -k 6",
    "ptm -k 10",
    "ptm -k 15",
    "sh -k 9",
    "sh -k 16",
    "sh -k 25",
    "hsh -k 4",
    "hsh -k 9",
    "hsh -k 16",
    "srbf -k 16",
    "srbf -k 25",
    "srbf -k 36",
];

fn main() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let sets: Vec<_> = SETS.into_iter().filter(|(_, folder, _)| root.join(folder).exists()).collect();
    print!("| basis |");
    sets.iter().for_each(|(name, ..)| print!(" {name} |"));
    println!("\n|---|{}", "---|".repeat(sets.len()));
    for basis in BASES {
        print!("| {basis} |");
        for (_, folder, judge) in &sets {
            let judge = if judge.contains('/') { root.join(judge) } else { PathBuf::from(judge) };
            let figures: Vec<String> = ["f32", "u8"]
                .iter()
                .map(|precision| held_out(&root.join(folder), &judge, basis, precision))
                .collect();
            print!(" {} / {} |", figures[0], figures[1]);
        }
        println!();
    }
}

/// Mean PSNR on held-out pictures, dB on encoded values.
fn held_out(set: &Path, judge: &Path, basis: &str, precision: &str) -> String {
    let folder = std::env::temp_dir();
    let (asset, report) = (folder.join("relight-accuracy.ktx2"), folder.join("relight-accuracy.json"));
    let status = Command::new(env!("CARGO_BIN_EXE_relight"))
        .args(["bake", "--basis"])
        .args(basis.split(' '))
        .args(["--precision", precision, "--holdout"])
        .arg(judge)
        .arg("-o")
        .arg(&asset)
        .arg("--report")
        .arg(&report)
        .arg(set)
        .output();
    assert!(status.expect("relight runs").status.success());
    let report: Value =
        serde_json::from_str(&std::fs::read_to_string(&report).expect("a report")).expect("JSON");
    let mean = &report["holdout"]["mean"];
    let psnr = mean.get("psnr_encoded").or(mean.get("psnr")).and_then(Value::as_f64);
    psnr.map_or("-".to_owned(), |psnr| format!("{psnr:.2}"))
}
