//! Bakes that are spread over processes: the merged bytes are those of one.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use scene::{command, copy_icon72, json_of, names_in, relight, relight_words};
use std::fs;
use std::path::Path;
use std::process::{Child, Stdio};

/// A folder with twelve of the real pictures in `set`: 20 tiles.
fn here() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    copy_icon72(&folder.path().join("set"), 6);
    folder
}

/// Numbers that seem random: x -> 6364136223846793005 x + 1442695040888963407 (Knuth's MMIX).
struct Random(u64);

impl Random {
    fn below(&mut self, end: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % end
    }
}

fn start(here: &Path, line: &str) -> Child {
    command(here).args(line.split(' ')).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

/// Makes the parts of all shards in a random order, two processes at a time, of which some are killed and made again.
fn make_parts(here: &Path, plan: &str, parts: &str, shards: usize, random: &mut Random) {
    let mut left: Vec<usize> = (1..=shards).collect();
    for at in (1..left.len()).rev() {
        left.swap(at, random.below(at + 1));
    }
    while !left.is_empty() {
        let batch: Vec<usize> = left.iter().copied().take(2).collect();
        // A competitor makes the first of them too.
        let of = batch.iter().chain(&batch[..1]);
        let lines = of.map(|shard| format!("bake --plan {plan} --shard {shard}/{shards} -o {parts} -j 1"));
        let mut running: Vec<Child> = lines.map(|line| start(here, &line)).collect();
        let victim = random.below(8);
        if let Some(child) = running.get_mut(victim) {
            std::thread::sleep(std::time::Duration::from_millis(random.below(60) as u64));
            child.kill().unwrap();
        }
        let ended: Vec<bool> = running.iter_mut().map(|child| child.wait().unwrap().success()).collect();
        left.retain(|shard| match batch.iter().position(|made| made == shard) {
            Some(at) => !(ended[at] || at == 0 && ended[batch.len()]),
            None => true,
        });
    }
}

#[test]
fn shards_of_any_number_make_the_bytes_of_one_process() {
    let folder = here();
    let here = folder.path();
    let mut random = Random(8);
    let cases = [
        ("--basis ptm", "", &[1, 2, 7, 16][..]),
        ("--basis ptm", "--block bc7 --quality fast", &[7]),
        ("--basis srbf -k 6", "", &[7, 16]),
        ("--basis srbf -k 6", "--block bc7 --quality fast", &[2]),
        ("--basis pca -k 4", "--mips", &[2, 7]),
        ("--basis pca -k 4", "--block bc7 --quality fast", &[16]),
        ("--basis sh -k 4 --color lrgb", "--holdout every:5", &[3]),
        ("--basis ptm --exposure auto", "--precision f16", &[2]),
    ];
    for (case, (fit, storing, numbers)) in cases.into_iter().enumerate() {
        relight(here, &format!("bake set -o whole.ktx2 {fit} {storing}")).ok();
        let whole = fs::read(here.join("whole.ktx2")).unwrap();
        for &shards in numbers {
            let [plan, parts, out] =
                ["plan.json", "parts", "m.ktx2"].map(|name| format!("{case}-{shards}-{name}"));
            let line = format!("plan set --asset any.ktx2 {fit} {storing} --shards {shards} -o {plan}");
            relight(here, &line).ok();
            make_parts(here, &plan, &parts, shards, &mut random);
            let merge = relight(here, &format!("merge --plan {plan} {parts} -o {out}")).ok();
            assert!(merge.stdout.contains("no picture was decoded"), "{}", merge.stdout);
            assert_eq!(fs::read(here.join(&out)).unwrap(), whole, "{fit} {storing} in {shards}");
            let hidden =
                names_in(&here.join(&parts)).into_iter().filter(|name| name.starts_with('.')).count();
            assert_eq!(hidden, 0, "{:?}", names_in(&here.join(&parts)));
        }
    }
}

#[test]
fn what_is_missing_or_foreign_is_named_with_its_remedy() {
    let folder = here();
    let here = folder.path();
    relight(here, "plan set --asset a.ktx2 --basis ptm --shards 4 -o plan.json").ok();
    let shard = |line: &str| relight(here, &format!("bake --plan plan.json -o parts {line}"));
    fs::create_dir(here.join("parts")).unwrap();
    let merge = || relight(here, "merge --plan plan.json parts -o a.ktx2");
    let all = merge();
    assert_eq!(all.code, Some(3));
    assert_eq!(
        all.stderr.lines().filter(|line| line.starts_with("relight bake --plan plan.json --shard ")).count(),
        4
    );
    for shard_of in ["2/4", "4/4"] {
        shard(&format!("--shard {shard_of}")).ok();
    }
    let some = merge();
    let commands: Vec<&str> = some.stderr.lines().skip(1).collect();
    let expected = ["1/4", "3/4"].map(|of| format!("relight bake --plan plan.json --shard {of} -o parts"));
    assert_eq!(commands, expected, "{}", some.stderr);
    for command in commands {
        relight(here, command.strip_prefix("relight ").unwrap()).ok();
    }
    // Already there.
    assert!(shard("--shard 1/4").ok().stdout.contains("are there already"));
    // A part that is damaged within is found out by the merge.
    let path = here.join("parts/tile-007");
    let whole = fs::read(&path).unwrap();
    let mut odd = whole.clone();
    odd[5000] ^= 1;
    fs::write(&path, odd).unwrap();
    let damaged = merge();
    assert_eq!(damaged.code, Some(3));
    assert!(damaged.stderr.contains("--shard 2/4"), "{}", damaged.stderr);
    fs::write(&path, whole).unwrap();
    // Parts of another fit, and files that are none.
    relight(here, "plan set --asset a.ktx2 --basis sh -k 4 --shards 4 -o other.json").ok();
    relight(here, "bake --plan other.json --shard 1/4 -o others").ok();
    fs::copy(here.join("others/tile-000"), here.join("parts/tile-100")).unwrap();
    fs::write(here.join("parts/notes.txt"), "mine").unwrap();
    merge().assert_refused(3, &["parts: notes.txt, tile-100 are no parts of this plan"]);
    fs::remove_file(here.join("parts/tile-100")).unwrap();
    fs::remove_file(here.join("parts/notes.txt")).unwrap();
    // Another format than planned, another input.
    relight(here, "merge --plan plan.json parts -o a.exr")
        .assert_refused(3, &["not stored as was planned", "storing format: ktx2 -> exr"]);
    // What all shards share: one makes it again.
    let facts = fs::read(here.join("parts/facts")).unwrap();
    for odd in [None, Some(facts.len() / 2)] {
        match odd {
            None => fs::remove_file(here.join("parts/facts")).unwrap(),
            Some(at) => {
                let mut odd = facts.clone();
                odd[at] ^= 1;
                fs::write(here.join("parts/facts"), odd).unwrap();
            }
        }
        let said = merge().stderr;
        let commands: Vec<&str> = said.lines().skip(1).collect();
        assert!(said.contains("the file 'facts'") && commands.len() == 1, "{said}");
        relight(here, commands[0].strip_prefix("relight ").unwrap()).ok();
        assert_eq!(fs::read(here.join("parts/facts")).unwrap(), facts);
    }
    // What a killed shard left goes with the merge, where no shard came after it.
    let stray = here.join("parts/.tile-007.relight-ABC123.tmp");
    fs::write(&stray, "half").unwrap();
    merge().ok();
    assert!(!stray.exists());
    let picture = names_in(&here.join("set")).into_iter().find(|name| name.ends_with("jpg")).unwrap();
    let bytes = fs::read(here.join("set").join(&picture)).unwrap();
    fs::write(here.join("set").join(&picture), [&bytes[..], b"!"].concat()).unwrap();
    merge().assert_refused(3, &["not those that were planned", "picture under the light"]);
    shard("--shard 1/4").assert_refused(3, &["not those that were planned"]);
    // Plans that are none.
    fs::write(here.join("plan.json"), "{}").unwrap();
    shard("--shard 1/4").assert_refused(3, &["plan.json: is no plan"]);
    shard("--shard 5/4").assert_refused(2, &["write K/N"]);
    relight(here, "plan set --asset a.ktx2 --target-psnr 20 --shards 4 -o p.json")
        .assert_refused(2, &["targets"]);
}

#[cfg(unix)]
#[test]
fn names_that_a_plan_cannot_hold_are_refused() {
    use std::os::unix::ffi::OsStrExt;
    let folder = here();
    let here = folder.path();
    let odd = std::ffi::OsStr::from_bytes(b"gains\xff.txt");
    let line = "plan set --asset a.ktx2 --basis ptm -o plan.json --intensities";
    let output = command(here).args(line.split(' ')).arg(odd).output().unwrap();
    let words = ["--intensities", "is no UTF-8, which a plan can't hold"];
    scene::outcome(line.to_owned(), output).assert_refused(2, &words);
}

#[test]
fn engines_say_which_shard_it_is() {
    let folder = here();
    let here = folder.path();
    relight(here, "plan set --asset a.ktx2 --crop 200x200+100+100 --shards 2 -o plan.json").ok();
    let line = "bake --plan plan.json --shard auto -o parts";
    let run = |name: &str, value: &str| {
        let output = command(here).args(line.split(' ')).env(name, value).output().unwrap();
        scene::outcome(line.to_owned(), output)
    };
    assert!(run("HQ_TASK_ID", "2").ok().stdout.contains("shard 2/2"));
    assert!(run("JOB_COMPLETION_INDEX", "0").ok().stdout.contains("shard 1/2"));
    run("AWS_BATCH_JOB_ARRAY_INDEX", "2").assert_refused(2, &["AWS_BATCH_JOB_ARRAY_INDEX is 2", "2 shards"]);
    run("NOTHING", "").assert_refused(2, &["SLURM_ARRAY_TASK_ID", "--shard K/N"]);
    relight(here, "merge --plan plan.json parts -o a.ktx2").ok();
}

#[test]
fn a_plan_says_what_will_be_taken() {
    let folder = here();
    let here = folder.path();
    fs::create_dir(here.join("jobs")).unwrap();
    fs::write(
        here.join("jobs/a job.toml"),
        "input = '../set'\noutput = 'x y.ktx2'\nbasis = 'srbf'\nk = 6\nmips = true\n",
    )
    .unwrap();
    let words = [
        "plan",
        "jobs/a job.toml",
        "--shards",
        "3",
        "-o",
        "plan.json",
        "--block",
        "bc1",
        "--format",
        "lines",
    ];
    relight_words(here, &words).ok();
    let plan = json_of(&here.join("plan.json"));
    let expected = [("tiles", 20), ("tile_pixels", 8192), ("pictures", 12), ("width", 402), ("height", 395)];
    for (key, value) in expected {
        assert_eq!(plan[key], value, "{key}");
    }
    assert_eq!(plan["job"]["block"], "bc1");
    let key = relight_words(here, &["key", "jobs/a job.toml", "--block", "bc1"]).ok().stdout;
    assert_eq!(plan["key"].as_str(), Some(key.trim()));
    let shards = plan["shards"].as_array().unwrap();
    let sum = |key: &str| shards.iter().map(|shard| shard[key].as_u64().unwrap()).sum::<u64>();
    assert_eq!((sum("pixels"), sum("bytes")), (402 * 395, 402 * 395 * 18 * 4));
    let bytes: u64 = names_in(&here.join("set"))
        .iter()
        .filter(|name| name.ends_with("jpg"))
        .map(|name| fs::metadata(here.join("set").join(name)).unwrap().len())
        .sum();
    assert_eq!(plan["input_bytes"].as_u64(), Some(bytes));
    // Each line of the shell's file is a command that runs from anywhere.
    let lines = fs::read_to_string(here.join("plan.sh")).unwrap();
    assert_eq!(lines.lines().count(), 4);
    let program = Path::new(env!("CARGO_BIN_EXE_relight")).parent().unwrap();
    let path = format!("{}:{}", program.display(), std::env::var("PATH").unwrap_or_default());
    if cfg!(unix) {
        let ran = std::process::Command::new("sh")
            .args(["-ec", &lines])
            .current_dir("/")
            .env("PATH", path)
            .output()
            .unwrap();
        assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
        assert!(here.join("jobs/x y.ktx2").is_file());
    }
}
