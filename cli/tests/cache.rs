//! What bakes keep for later ones: fits that are taken up, files that are up to date, and caches that are damaged, full or shared.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use scene::{command, copy_icon72, icon72, json_of, names_in, relight, snapshot};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// A folder with twelve of the real pictures in `set`.
fn here() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    copy_icon72(&folder.path().join("set"), 6);
    folder
}

/// Bytes of an asset that was baked without any cache.
fn plain(here: &Path, options: &str) -> Vec<u8> {
    relight(here, &format!("bake set -o plain.ktx2 {options}")).ok();
    fs::read(here.join("plain.ktx2")).unwrap()
}

fn files_below(folder: &Path) -> Vec<PathBuf> {
    snapshot(folder).into_keys().filter(|path| path.is_file()).collect()
}

#[test]
fn storing_anew_takes_the_fit_up_and_gives_the_same_bytes() {
    let folder = here();
    let here = folder.path();
    let small = "--crop 96x80+150+160";
    for fit in
        ["", "--color lrgb --basis sh -k 4", "--basis pca -k 4 --color ycc", "--basis srbf -k 6 --robust"]
    {
        let options = format!("{small} {fit}");
        let first = relight(here, &format!("bake set -o a.ktx2 --cache kept {options}")).ok();
        assert!(first.stdout.contains("cache: 1 tiles are fitted and kept"), "{}", first.stdout);
        assert_eq!(fs::read(here.join("a.ktx2")).unwrap(), plain(here, &options), "{fit}");
        for storing in ["--block bc4 --mips", "--precision f16", "--block bc1 --quality fast --wrap repeat"] {
            let again = format!("{options} {storing}");
            let run = relight(here, &format!("bake set -o a.ktx2 --cache kept {again}"));
            // Luminance planes and colours go into other blocks.
            if run.code == Some(2) {
                continue;
            }
            assert!(run.stdout.contains("the fit is taken up"), "{again}\n{}\n{}", run.stdout, run.stderr);
            assert!(
                !run.stdout.contains("ranges "),
                "how coefficients are distributed is known: {}",
                run.stdout
            );
            assert_eq!(fs::read(here.join("a.ktx2")).unwrap(), plain(here, &again), "{again}");
        }
    }
    let left: Vec<_> = names_in(here).into_iter().filter(|name| name.starts_with('.')).collect();
    assert!(left.is_empty(), "coefficients of robust fits outside of a cache are gone: {left:?}");
    // Another format, held-out pictures and a report are made of the same kept fit or of one of their own.
    let options = format!("{small} --holdout every:6 --report r.json --cache kept");
    relight(here, &format!("bake set -o b.exr {options}")).ok();
    let before = json_of(&here.join("r.json"));
    fs::remove_file(here.join("b.exr")).unwrap();
    let run = relight(here, &format!("bake set -o b.exr {options}")).ok();
    assert!(run.stdout.contains("the fit is taken up"), "{}", run.stdout);
    let after = json_of(&here.join("r.json"));
    for key in ["lights", "holdout", "storing", "error_budget", "key", "notes", "leave_one_out_rmse", "ridge"]
    {
        assert_eq!(before[key], after[key], "{key}");
    }
    assert_eq!(after["cache"]["tiles_taken"], 1);
}

#[test]
fn a_budget_makes_how_planes_are_stored_part_of_the_fit() {
    let folder = here();
    let here = folder.path();
    let options = "--crop 96x80+150+160 --basis pca --budget-bytes 12K";
    for storing in ["--block bc7", "--block bc1", "--block bc1 --mips", "--block bc7"] {
        let line = format!("{options} {storing}");
        relight(here, &format!("bake set -o a.ktx2 --cache kept {line}")).ok();
        assert_eq!(fs::read(here.join("a.ktx2")).unwrap(), plain(here, &line), "{storing}");
    }
}

#[test]
fn what_is_up_to_date_is_left_alone() {
    let folder = here();
    let here = folder.path();
    let line = "bake set -o a.dds --split --cache kept --crop 96x80+150+160";
    relight(here, line).ok();
    let made = snapshot(here);
    let stamp = || fs::metadata(here.join("a.dds")).unwrap().modified().unwrap();
    let before = stamp();
    let is_up_to_date = |run: scene::Outcome| run.ok().stdout == "a.dds: up to date\n";
    assert!(is_up_to_date(relight(here, line)));
    assert_eq!((stamp(), made.keys().len()), (before, snapshot(here).keys().len()));
    // Names, places, times, threads and comments are no contents.
    fs::rename(here.join("set"), here.join("another place")).unwrap();
    let text = fs::read_to_string(here.join("another place/lights.lp")).unwrap();
    fs::write(here.join("another place/lights.lp"), text + "\n\n").unwrap();
    let words: Vec<&str> =
        line.split(' ').map(|word| if word == "set" { "another place" } else { word }).collect();
    assert!(is_up_to_date(scene::relight_words(here, &[&words[..], &["-j", "1"]].concat())));
    fs::rename(here.join("another place"), here.join("set")).unwrap();
    // A part that is gone or another is made again, the same.
    let whole = fs::read(here.join("a_1.dds")).unwrap();
    for spoil in [None, Some(&whole[1..])] {
        fs::remove_file(here.join("a_1.dds")).unwrap();
        if let Some(bytes) = spoil {
            // A damaged texture is no asset's, so that it would not be replaced.
            fs::write(here.join("a.dds"), bytes).unwrap();
        }
        assert!(!is_up_to_date(relight(here, line)));
        assert_eq!(fs::read(here.join("a_1.dds")).unwrap(), whole);
        assert!(is_up_to_date(relight(here, line)));
    }
    // So is what lacks its report.
    let reported = format!("{line} --report r.json");
    assert!(!is_up_to_date(relight(here, &reported)));
    assert!(is_up_to_date(relight(here, &reported)));
    fs::write(here.join("r.json"), "{}").unwrap();
    assert!(!is_up_to_date(relight(here, &reported)));
    // A picture that is another.
    let picture = names_in(&here.join("set")).into_iter().find(|name| name.ends_with("jpg")).unwrap();
    let bytes = fs::read(here.join("set").join(&picture)).unwrap();
    fs::write(here.join("set").join(&picture), [&bytes[..], b"!"].concat()).unwrap();
    assert!(!is_up_to_date(relight(here, line)));
}

#[test]
fn the_order_of_the_light_file_does_not_matter() {
    let folder = here();
    let here = folder.path();
    let options = "--basis srbf -k 6 --exposure auto --white-balance auto:200,200,9 --crop 96x80+150+160";
    let before = plain(here, options);
    let key = relight(here, &format!("key set -o a.ktx2 {options}")).ok().stdout;
    let text = fs::read_to_string(here.join("set/lights.lp")).unwrap();
    let mut lines: Vec<&str> = text.lines().skip(1).collect();
    lines.reverse();
    lines.swap(1, 7);
    fs::write(here.join("set/lights.lp"), format!("{}\n{}\n", lines.len(), lines.join("\n"))).unwrap();
    assert_eq!(plain(here, options), before);
    assert_eq!(relight(here, &format!("key set -o a.ktx2 {options}")).ok().stdout, key);
}

#[test]
fn damaged_files_of_a_cache_cost_time_and_one_note() {
    let folder = here();
    let here = folder.path();
    let options = "--crop 201x197+100+100 --basis sh -k 4";
    let line = format!("bake set -o a.ktx2 --cache kept {options}");
    relight(here, &line).ok();
    let whole = fs::read(here.join("a.ktx2")).unwrap();
    assert_eq!(whole, plain(here, options));
    let kept = files_below(&here.join("kept"));
    assert!(kept.len() >= 8, "facts, five tiles, what was made, a tag: {kept:?}");
    for (index, path) in kept.iter().enumerate() {
        let bytes = fs::read(path).unwrap();
        for at in [0, bytes.len() / 2, bytes.len() - 1] {
            let mut odd = bytes.clone();
            odd[at] ^= 1 << (index % 8);
            fs::write(path, &odd).unwrap();
            fs::remove_file(here.join("a.ktx2")).unwrap();
            let run = relight(here, &line).ok();
            assert_eq!(fs::read(here.join("a.ktx2")).unwrap(), whole, "{} {at}", path.display());
            let notes = run.stderr.lines().filter(|line| line.contains("cache")).count();
            assert!(notes <= 1, "{}\n{}", path.display(), run.stderr);
            let of_fit = path.parent().unwrap().parent().unwrap().ends_with("fits");
            assert_eq!(notes, usize::from(of_fit), "{}\n{}", path.display(), run.stderr);
        }
    }
    // All of them at once.
    for path in &kept {
        let mut odd = fs::read(path).unwrap();
        odd[40] ^= 4;
        fs::write(path, &odd).unwrap();
    }
    fs::remove_file(here.join("a.ktx2")).unwrap();
    let run = relight(here, &line).ok();
    assert_eq!(fs::read(here.join("a.ktx2")).unwrap(), whole);
    assert_eq!(run.stderr.lines().filter(|line| line.contains("cache")).count(), 1, "{}", run.stderr);
}

#[test]
fn a_fit_whose_tile_is_damaged_is_chosen_and_solved_anew() {
    let folder = here();
    let here = folder.path();
    // Planes that were learned can't be solved for again; of the usual functions there are fewer under so few lights, which is said.
    for options in ["--basis pca -k 3", "--basis sh"] {
        let line = format!("bake set -o a.ktx2 --cache kept --crop 96x80+150+160 {options}");
        let first = relight(here, &line).ok();
        let whole = fs::read(here.join("a.ktx2")).unwrap();
        let tile =
            files_below(&here.join("kept")).into_iter().find(|path| path.ends_with("tile-000")).unwrap();
        let mut odd = fs::read(&tile).unwrap();
        odd[500] ^= 1;
        fs::write(&tile, odd).unwrap();
        fs::remove_file(here.join("a.ktx2")).unwrap();
        let again = relight(here, &line).ok();
        assert!(again.stdout.contains("1 tiles are fitted"), "{}", again.stdout);
        assert_eq!(fs::read(here.join("a.ktx2")).unwrap(), whole, "{options}");
        let notes = |words: &str| words.lines().filter(|line| !line.contains("cache")).count();
        assert_eq!(notes(&again.stderr), notes(&first.stderr), "{}\n{}", first.stderr, again.stderr);
        fs::remove_dir_all(here.join("kept")).unwrap();
    }
}

#[test]
fn two_processes_fill_one_cache() {
    let folder = here();
    let here = folder.path();
    let options = ["--basis sh -k 4", "--basis sh -k 4 --block bc1 --quality fast", "--basis ptm"];
    let whole = options.map(|options| plain(here, options));
    for round in 0..3 {
        let cache = format!("kept{round}");
        let start = |index: usize| {
            let line = format!("bake set -o {round}-{index}.ktx2 --cache {cache} {}", options[index / 2]);
            command(here).args(line.split(' ')).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
        };
        let running: Vec<_> = (0..6).map(start).collect();
        for (index, child) in running.into_iter().enumerate() {
            let ended = child.wait_with_output().unwrap();
            let words = String::from_utf8(ended.stderr).unwrap();
            assert!(ended.status.success() && !words.contains("cache"), "{words}");
            let made = fs::read(here.join(format!("{round}-{index}.ktx2"))).unwrap();
            assert_eq!(made, whole[index / 2], "{round} {index}");
        }
    }
}

#[test]
fn a_cache_that_is_too_small_or_nowhere_is_done_without() {
    let folder = here();
    let here = folder.path();
    let options = "--basis sh -k 4 --crop 96x80+150+160";
    let whole = plain(here, options);
    let run = relight(here, &format!("bake set -o a.ktx2 --cache kept --cache-size 10K {options}")).ok();
    assert!(run.stderr.contains("more than --cache-size allows"), "{}", run.stderr);
    assert_eq!(fs::read(here.join("a.ktx2")).unwrap(), whole);
    // Three fits of 92 K each in the room of two.
    for k in [1, 4, 9] {
        let line = format!(
            "bake set -o b.ktx2 --cache kept --cache-size 1200K --basis sh -k {k} --crop 96x80+150+160"
        );
        relight(here, &line).ok();
    }
    assert!(names_in(&here.join("kept/fits")).len() < 3);
    fs::write(here.join("file"), "").unwrap();
    let run = relight(here, &format!("bake set -o c.ktx2 --cache file {options}")).ok();
    assert!(run.stderr.contains("the cache is not used"), "{}", run.stderr);
    assert_eq!(fs::read(here.join("c.ktx2")).unwrap(), whole);
}

#[cfg(target_os = "linux")]
#[test]
fn a_cache_on_a_full_disk_is_done_without() {
    let folder = here();
    let here = folder.path();
    let disk = here.join("disk");
    fs::create_dir(&disk).unwrap();
    let mount = |size: &str| {
        let arguments = ["-t", "tmpfs", "-o", size, "tmpfs"];
        Command::new("mount")
            .args(arguments)
            .arg(&disk)
            .stderr(Stdio::null())
            .status()
            .is_ok_and(|ran| ran.success())
    };
    let whole = plain(here, "--basis sh -k 4");
    for (size, full) in [("size=300k", "fit"), ("size=4k", "everything"), ("size=8m", "nothing")] {
        if !mount(size) {
            println!("skipped: a tmpfs can't be mounted here");
            return;
        }
        let run = relight(here, "bake set -o a.ktx2 --cache disk --basis sh -k 4");
        let unmounted = Command::new("umount").arg(&disk).status().unwrap();
        assert!(unmounted.success());
        let run = run.ok();
        let notes = run.stderr.lines().filter(|line| line.contains("cache")).count();
        assert_eq!(notes, usize::from(full != "nothing"), "{size}\n{}", run.stderr);
        assert_eq!(fs::read(here.join("a.ktx2")).unwrap(), whole, "{size}");
    }
}

#[cfg(unix)]
#[test]
fn tiles_outlive_a_kill_and_are_taken_up() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    std::os::unix::fs::symlink(icon72(), here.join("set")).unwrap();
    // Robust fits take their time.
    let options = "--basis sh -k 9 --robust";
    let line = format!("bake set -o a.ktx2 --cache kept -j 1 {options}");
    let mut child =
        command(here).args(line.split(' ')).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    // Names alone, of what may be renamed at this moment.
    let entries = |folder: &Path| fs::read_dir(folder).into_iter().flatten().flatten();
    let tiles = || {
        let files = entries(&here.join("kept/fits")).flat_map(|fit| entries(&fit.path()));
        files.filter(|file| file.file_name().to_string_lossy().starts_with("tile-")).count()
    };
    while tiles() < 3 {
        assert!(child.try_wait().unwrap().is_none(), "it ended before it was killed");
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let run = relight(here, &line).ok();
    assert!(run.stdout.contains("tiles are taken up from an earlier run"), "{}", run.stdout);
    let hidden = files_below(here)
        .into_iter()
        .filter(|path| path.file_name().unwrap().to_str().unwrap().starts_with('.'));
    assert_eq!(hidden.count(), 0);
    assert_eq!(fs::read(here.join("a.ktx2")).unwrap(), plain(here, options));
}

#[test]
fn what_a_search_or_an_estimate_looks_at_is_in_the_key() {
    let folder = here();
    let here = folder.path();
    let key = |options: &str| relight(here, &format!("key set -o a.ktx2 {options}")).ok().stdout.clone();
    // What is given is not searched for.
    let target = "--target-psnr 24";
    let searches = [target, "--target-psnr 24 --basis ptm", "--target-psnr 24 --precision u8"].map(key);
    assert!(searches[0] != searches[1] && searches[0] != searches[2] && searches[1] != searches[2]);
    assert_eq!(key("--basis ptm --precision u8"), key(""), "without a target these are what is taken anyway");

    // Exposure is estimated from pictures that judge, too, under their lights in the capture.
    let lights = fs::read_to_string(here.join("set/lights.lp")).unwrap();
    let mut lines: Vec<&str> = lights.lines().skip(1).collect();
    fs::write(here.join("judges.lp"), format!("1\nset/{}\n", lines[2])).unwrap();
    let estimated = "--exposure auto --holdout judges.lp";
    let before = [estimated, "--holdout judges.lp"].map(key);
    let name = lines[2].split(' ').next().unwrap();
    let moved = format!("{name} 0.1 0.2 0.9");
    lines[2] = &moved;
    fs::write(here.join("set/lights.lp"), format!("{}\n{}\n", lines.len(), lines.join("\n"))).unwrap();
    assert_ne!(key(estimated), before[0]);
    assert_eq!(key("--holdout judges.lp"), before[1], "nothing looks at it");

    // A patch is averaged over pictures that judge, too, divided by their intensities.
    let judges = "--holdout judges.lp --intensities i.txt";
    let patch = format!("--white-balance auto:200,200,30 {judges}");
    let [mut keys, mut unlooked] = [Vec::new(), Vec::new()];
    for intensity in ["1", "30"] {
        let of = |line: &&str| {
            let other = line.split(' ').next().unwrap();
            format!("{other} {}\n", if other == name { intensity } else { "1" })
        };
        fs::write(here.join("i.txt"), lines.iter().map(of).collect::<String>()).unwrap();
        keys.push(key(&patch));
        unlooked.push(key(judges));
    }
    assert_ne!(keys[0], keys[1]);
    assert_eq!(unlooked[0], unlooked[1]);
}
