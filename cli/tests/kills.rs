//! `kill -9` at any moment: final files are whole or absent, later runs give the same, and nothing is left behind.
//! `RELIGHT_KILLS` sets how many (200 for a release; 24 otherwise).

#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use scene::{command, copy_icon72, relight, snapshot};
use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;

/// Runs `line` and kills it after `wait`.
fn kill_after(here: &Path, line: &str, wait: Duration) {
    let mut child =
        command(here).args(line.split(' ')).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    std::thread::sleep(wait);
    // It may have ended.
    let _ = child.kill();
    child.wait().unwrap();
}

/// Temporaries below `folder`.
fn strays(folder: &Path) -> Vec<String> {
    let names =
        snapshot(folder).into_keys().map(|path| path.file_name().unwrap().to_str().unwrap().to_owned());
    names.filter(|name| name.contains(".relight-")).collect()
}

#[test]
fn kills_at_any_moment_leave_whole_files_and_no_trace() {
    let kills: u64 = std::env::var("RELIGHT_KILLS").map_or(24, |text| text.parse().unwrap());
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    copy_icon72(&here.join("set"), 6);
    let options = "--basis sh -k 4";
    relight(here, &format!("bake set -o whole.ktx2 {options}")).ok();
    relight(here, &format!("bake set -o whole.web {options}")).ok();
    let whole = fs::read(here.join("whole.ktx2")).unwrap();
    let pages = snapshot(&here.join("whole.web")).into_values().collect::<Vec<_>>();
    relight(here, &format!("plan set --asset a.ktx2 {options} --shards 3 -o plan.json")).ok();
    let lines = [
        format!("bake set -o out/a.ktx2 {options}"),
        format!("bake set -o out/b.ktx2 --cache kept {options}"),
        "bake --plan plan.json --shard 2/3 -o parts".to_owned(),
        "merge --plan plan.json parts -o out/c.ktx2".to_owned(),
        format!("bake set -o out/d.web --cache kept2 {options}"),
    ];
    fs::create_dir(here.join("out")).unwrap();
    let assets = ["out/a.ktx2", "out/b.ktx2", "out/c.ktx2"];
    let check = |run: u64| {
        for asset in assets {
            if let Ok(bytes) = fs::read(here.join(asset)) {
                assert!(bytes == whole, "{asset} after kill {run}");
            }
        }
        if here.join("out/d.web").exists() {
            assert!(snapshot(&here.join("out/d.web")).into_values().eq(pages.iter().cloned()), "kill {run}");
        }
    };
    // How long each takes by itself.
    let spans: Vec<Duration> = lines
        .iter()
        .enumerate()
        .map(|(index, line)| {
            if index == 3 {
                for shard in ["1/3", "3/3"] {
                    relight(here, &format!("bake --plan plan.json --shard {shard} -o parts")).ok();
                }
            }
            let start = std::time::Instant::now();
            relight(here, line).ok();
            start.elapsed()
        })
        .collect();
    check(0);
    let mut state = 1u64;
    for kill in 1..=kills {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let which = (state >> 33) as usize % lines.len();
        let moment = (state >> 40) as f64 / f64::from(1 << 24);
        // From nothing, or from what runs before left.
        if kill % 3 == 0 {
            for path in ["kept", "kept2", "out/d.web"] {
                let _ = fs::remove_dir_all(here.join(path));
            }
            assets.iter().for_each(|asset| drop(fs::remove_file(here.join(asset))));
        }
        if kill % 4 == 0 {
            let _ = fs::remove_file(here.join("parts/tile-009"));
        }
        kill_after(here, &lines[which], spans[which].mul_f64(moment));
        check(kill);
    }
    // Later runs neither fail nor differ, and take away what was left.
    for path in ["kept", "kept2", "out/d.web"] {
        if kills % 2 == 1 {
            let _ = fs::remove_dir_all(here.join(path));
        }
    }
    assets.iter().for_each(|asset| drop(fs::remove_file(here.join(asset))));
    for line in &lines {
        relight(here, line).ok();
    }
    assert!(assets.iter().all(|asset| fs::read(here.join(asset)).unwrap() == whole));
    check(kills + 1);
    assert_eq!(strays(here), Vec::<String>::new());
}
