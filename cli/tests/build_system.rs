//! The program inside a build: depfiles, outputs that stay as they are, dry runs, make's jobserver.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use scene::{command, made, names_in, outcome, relight, relight_words, snapshot};
use serde_json::json;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// A tool to hold the program to, or a line that says that it is missing.
fn tool(name: &str) -> Option<Command> {
    let found = Command::new(name).arg("--version").output().is_ok_and(|output| output.status.success());
    if !found {
        println!("skipped: no {name} on this machine");
    }
    found.then(|| Command::new(name))
}

fn modified(path: &Path) -> SystemTime {
    fs::metadata(path).unwrap().modified().unwrap()
}

/// Sets a file's time to `seconds` before now.
fn age(path: &Path, seconds: u64) -> SystemTime {
    let time = SystemTime::now() - Duration::from_secs(seconds);
    let time = UNIX_EPOCH + Duration::from_secs(time.duration_since(UNIX_EPOCH).unwrap().as_secs());
    fs::File::options().write(true).open(path).unwrap().set_modified(time).unwrap();
    time
}

/// A capture in `folder` whose pictures have names that Make minds.
fn odd_capture(folder: &Path) -> Vec<String> {
    let lines: Vec<String> = scene::light_lines(8);
    let odd = ["a b.png", "#2.png", "x$y.png", "é (1).png", "p%q.png", "c,d+e@f.png", "~.png", "a[1]'.png"];
    fs::create_dir(folder).unwrap();
    let mut odd_lines = Vec::new();
    for (i, (line, name)) in lines.iter().zip(odd).enumerate() {
        let path = folder.join(name);
        scene::pictures::write_made(&path, scene::light(i, 8), scene::WIDTH, scene::HEIGHT);
        let direction = line.split_once(' ').unwrap().1;
        odd_lines.push(format!("{name} {direction}"));
    }
    scene::write_lines(&folder.join("lights.lp"), &odd_lines);
    odd.iter().map(|name| (*name).to_owned()).collect()
}

#[test]
fn a_depfile_names_all_that_was_read() {
    let folder = made(12);
    let here = folder.path();
    fs::write(here.join("lamps.txt"), ["1\n"; 12].concat()).unwrap();
    let judges: Vec<String> = scene::light_lines(12).into_iter().skip(9).collect();
    scene::write_lines(&here.join("capture/judges.lp"), &judges);
    let job = "input = 'capture'\noutput = 'a.ktx2'\nbasis = 'ptm'\nintensities = 'lamps.txt'\nholdout = 'capture/judges.lp'\n\
               depfile = 'a.json'\ndepfile-format = 'json'\n";
    // A folder with two light files would not tell which.
    let job = job.replace("'capture'", "'capture/lights.lp'");
    fs::write(here.join("job.toml"), job).unwrap();
    relight(here, "bake job.toml").ok();
    let made = scene::json_of(&here.join("a.json"));
    let mut inputs: Vec<String> =
        made["inputs"].as_array().unwrap().iter().map(|v| v.as_str().unwrap().to_owned()).collect();
    inputs.sort();
    let pictures = (0..12).map(|i| format!("capture/{}", scene::name(i)));
    let others = ["capture/judges.lp", "capture/lights.lp", "job.toml", "lamps.txt"].map(str::to_owned);
    let mut expected: Vec<String> = pictures.chain(others).collect();
    expected.sort();
    assert_eq!((&made["target"], inputs), (&json!("a.ktx2"), expected));

    // The target is what the command line calls it, in any other command too.
    relight(here, "convert a.ktx2 -o ./b.exr --depfile - --json").assert_refused(2, &["share"]);
    let said = relight(here, "convert a.ktx2 -o ./b.exr --depfile -").ok();
    assert_eq!(said.stdout, "./b.exr: \\\n  a.ktx2\n");
    fs::write(here.join("s.toml"), "[[light]]\nkind = 'directional'\nto = [0, 0, 1]\n").unwrap();
    relight(here, "render a.ktx2 --light 0,0,1 -o r.png --depfile r.d").ok();
    assert_eq!(fs::read_to_string(here.join("r.d")).unwrap(), "r.png: \\\n  a.ktx2\n");
}

#[test]
fn names_that_make_cannot_hold_are_refused_before_the_work() {
    let folder = made(6);
    let here = folder.path();
    let before = names_in(here);
    for (output, reason) in
        [("a=b.ktx2", "'='"), ("a;b.ktx2", "';'"), ("a*b.ktx2", "'*'"), ("a\nb.ktx2", "line break")]
    {
        let words = ["bake", "capture", "-o", output, "--basis", "ptm", "--depfile", "d"];
        relight_words(here, &words).assert_refused(2, &["--depfile d", reason, "--depfile-format json"]);
        assert_eq!(names_in(here), before);
    }
    fs::rename(here.join("capture"), here.join("cap;ture")).unwrap();
    relight(here, "bake cap;ture -o a.ktx2 --basis ptm --depfile d")
        .assert_refused(2, &["'cap;ture/", "';'"]);
    relight(here, "bake cap;ture -o a.ktx2 --basis ptm --depfile d --depfile-format json").ok();
    relight(here, "bake cap;ture -o a.ktx2 --basis ptm --depfile a.ktx2 --depfile-format json")
        .assert_refused(2, &["a.ktx2", "name of its own"]);
    relight(here, "bake cap;ture -o a.ktx2 --basis ptm --depfile no/d --depfile-format json")
        .assert_refused(4, &["no/d"]);
}

#[cfg(unix)]
#[test]
fn bytes_that_are_no_text_come_through_a_depfile() {
    use std::os::unix::ffi::{OsStrExt, OsStringExt};
    let folder = made(6);
    let here = folder.path();
    let odd = here.join(std::ffi::OsStr::from_bytes(b"o\xffdd"));
    if fs::rename(here.join("capture"), &odd).is_err() {
        println!("skipped: this file system has names of text alone");
        return;
    }
    let target = std::ffi::OsString::from_vec(b"t\xfe.ktx2".to_vec());
    let run = |more: &[&str]| {
        let mut command = command(here);
        command.args(["bake", "--basis", "ptm", "--depfile", "d"]).args(more);
        command.arg(odd.file_name().unwrap()).arg("-o").arg(&target).output().unwrap()
    };
    assert!(run(&[]).status.success());
    let text = fs::read(here.join("d")).unwrap();
    assert!(
        text.starts_with(b"t\xfe.ktx2: \\\n  o\xffdd/p00.png \\\n"),
        "{:?}",
        text.escape_ascii().to_string()
    );
    let refused = run(&["--depfile-format", "json"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("not Unicode"));
}

/// A build file with `rule` for an asset of odd names, and what a changed picture makes of it.
#[test]
fn ninja_reads_our_depfiles_and_restats_our_outputs() {
    let Some(_) = tool("ninja") else { return };
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let names = odd_capture(&here.join("cap ture"));
    let program = env!("CARGO_BIN_EXE_relight");
    let build = format!(
        "rule bake\n  command = '{program}' bake 'cap ture' -o $out --basis ptm --depfile a.d\n  depfile = a.d\n  deps = gcc\n  restat = 1\n\
         rule copy\n  command = cp $in $out && echo copied >> copies\n\
         build out$ #1.ktx2: bake cap$ ture/lights.lp\nbuild copy: copy out$ #1.ktx2\n"
    )
    // The shell sees a name of its own.
    .replace("-o $out", "-o 'out #1.ktx2'")
    .replace("cp $in", "cp 'out #1.ktx2'");
    fs::write(here.join("build.ninja"), build).unwrap();
    let ninja = || {
        let run = Command::new("ninja").current_dir(here).arg("-v").env_remove("MAKEFLAGS").output().unwrap();
        let said = String::from_utf8_lossy(&run.stdout).into_owned();
        assert!(run.status.success(), "{said}");
        said
    };
    let copies = || fs::read_to_string(here.join("copies")).unwrap().lines().count();
    ninja();
    assert_eq!(copies(), 1);
    assert!(ninja().contains("no work to do"), "a second run");
    let stood = modified(&here.join("out #1.ktx2"));
    for name in &names {
        // Touched alone: it is read again, and nothing downstream is made.
        std::thread::sleep(Duration::from_millis(15));
        let path = here.join("cap ture").join(name);
        fs::write(&path, fs::read(&path).unwrap()).unwrap();
        let said = ninja();
        assert!(said.contains(" bake "), "{name} is in no depfile that ninja reads\n{said}");
        assert_eq!((copies(), modified(&here.join("out #1.ktx2"))), (1, stood), "{name}");
        assert!(ninja().contains("no work to do"), "{name}, touched");
    }
    scene::pictures::write_made(
        &here.join("cap ture/#2.png"),
        scene::light(4, 8),
        scene::WIDTH,
        scene::HEIGHT,
    );
    ninja();
    assert_eq!(copies(), 2);
    assert!(modified(&here.join("out #1.ktx2")) > stood);
    assert!(ninja().contains("no work to do"), "the last run");
}

#[test]
fn gnu_make_reads_our_depfiles() {
    let Some(_) = tool("make") else { return };
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let names = odd_capture(&here.join("capture"));
    let program = env!("CARGO_BIN_EXE_relight");
    // An output that stayed as it was is older than what it is made of: a stamp says that it was looked at.
    let makefile = format!(
        "out.stamp: ; {program} bake capture -o out.ktx2 --basis ptm --depfile out.d && sed 's/^out.ktx2:/out.stamp:/' out.d > out.mk && touch $@\n\
         -include out.mk\n"
    );
    fs::write(here.join("Makefile"), makefile).unwrap();
    let make = || {
        let run = Command::new("make")
            .current_dir(here)
            .env_remove("MAKEFLAGS")
            .env_remove("MAKELEVEL")
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&run.stdout).into_owned() + &String::from_utf8_lossy(&run.stderr);
        assert!(run.status.success(), "{said}");
        said
    };
    make();
    assert!(make().contains("up to date"));
    for name in &names {
        age(&here.join("out.stamp"), 100);
        for other in names.iter().filter(|other| *other != name) {
            age(&here.join("capture").join(other), 200);
        }
        age(&here.join("capture/lights.lp"), 200);
        age(&here.join("capture").join(name), 50);
        let said = make();
        assert!(said.contains("bake"), "{name} is in no depfile that make reads\n{said}");
    }
}

#[test]
fn outputs_of_the_same_bytes_keep_their_time() {
    let folder = made(9);
    let here = folder.path();
    for output in ["a.ktx2", "a.dds", "a.exr", "a.ptm", "a.web"] {
        let line = format!("bake capture -o {output} --basis ptm");
        relight(here, &line).ok();
        let file = if output == "a.web" { here.join("a.web/info.json") } else { here.join(output) };
        let time = age(&file, 1000);
        let before = snapshot(here);
        relight(here, &line).ok();
        assert_eq!(modified(&file), time, "{output}");
        assert!(before == snapshot(here), "{output}");
        relight(here, &format!("{line} --ridge 0.5")).ok();
        assert!(before != snapshot(here), "{output}");
        // Of a folder, this file may be one that is made anew with the same bytes.
        assert!(output == "a.web" || modified(&file) > time, "{output}");
    }
    relight(here, "render a.ktx2 --light 0,0,1 -o r.png").ok();
    let time = age(&here.join("r.png"), 1000);
    relight(here, "render a.ktx2 --light 0,0,1 -o r.png").ok();
    assert_eq!(modified(&here.join("r.png")), time);
}

#[test]
fn a_dry_run_says_what_it_would_read_and_write_and_writes_nothing() {
    let folder = made(9);
    let here = folder.path();
    for (line, outputs) in [
        (
            "bake capture -o a.ktx2 --basis ptm --depfile a.d --report a.html",
            &["a.d", "a.html", "a.json", "a.ktx2"][..],
        ),
        ("bake capture -o a.ktx2 --basis hsh -k 4 --split --precision u8", &[]),
        ("bake capture -o a.dds --basis ptm --color lrgb --precision f16 --split", &[]),
        ("bake capture -o a.ptm --basis ptm", &["a.ptm"]),
        ("bake capture -o b.ktx2 --basis ptm --exposure auto --white-balance auto:9,9,3", &["b.ktx2"]),
    ] {
        let before = snapshot(here);
        let said = relight(here, &format!("{line} --dry-run")).ok();
        assert!(before == snapshot(here), "{line}");
        let of = |word: &str| {
            let mut names: Vec<String> =
                said.stdout.lines().filter_map(|line| Some(line.strip_prefix(word)?.to_owned())).collect();
            names.sort();
            names
        };
        let mut read: Vec<String> = (0..9).map(|i| format!("capture/{}", scene::name(i))).collect();
        read.insert(0, "capture/lights.lp".to_owned());
        assert_eq!(of("read "), read, "{line}");
        assert_eq!(said.stdout.lines().count(), read.len() + of("write ").len(), "{line}\n{}", said.stdout);
        if line.contains("auto") {
            assert_eq!(of("write "), outputs);
            continue;
        }
        // What it announced is what is written.
        relight(here, line).ok();
        let mut written: Vec<String> =
            names_in(here).into_iter().filter(|name| !before.contains_key(&here.join(name))).collect();
        written.sort();
        assert_eq!(of("write "), written, "{line}");
        if !outputs.is_empty() {
            assert_eq!(written, outputs, "{line}");
        }
        written.iter().for_each(|name| fs::remove_file(here.join(name)).unwrap());
    }
    // Heat maps of the steps that there are, and up to date with them.
    for (options, maps) in [
        (
            "--block bc7 --quality fast --holdout every:3",
            &["block-coding", "fit", "held-out", "quantisation"][..],
        ),
        ("--precision f32", &["fit"]),
    ] {
        let line = format!("bake capture -o h.ktx2 --basis ptm --report h.json --heatmaps hm {options}");
        let said = relight(here, &format!("{line} --dry-run")).ok().stdout;
        let maps: Vec<String> = maps.iter().map(|name| format!("heatmap-{name}.png")).collect();
        let mut announced: Vec<&str> =
            said.lines().filter_map(|line| line.strip_prefix("write hm/")).collect();
        announced.sort_unstable();
        assert_eq!(announced, maps, "{options}");
        relight(here, &format!("{line} --cache kept")).ok();
        assert_eq!(names_in(&here.join("hm")), maps, "{options}");
        assert!(
            relight(here, &format!("{line} --cache kept")).ok().stdout.contains("up to date"),
            "{options}"
        );
        // One of them is missed as the asset would be.
        fs::remove_file(here.join("hm/heatmap-fit.png")).unwrap();
        relight(here, &format!("{line} --cache kept")).ok();
        assert_eq!(names_in(&here.join("hm")), maps, "{options}");
        ["hm", "kept"].iter().for_each(|name| fs::remove_dir_all(here.join(name)).unwrap());
        ["h.ktx2", "h.json"].iter().for_each(|name| fs::remove_file(here.join(name)).unwrap());
    }
    for (line, code) in [
        ("bake capture -o a.ktx2 --basis ptm --precision u8 --block bc7", 2),
        ("bake none -o a.ktx2", 4),
        ("bake capture -o a.xyz", 2),
        ("bake capture -o capture/p00.png", 2),
        ("bake capture -o none/a.ktx2", 4),
    ] {
        let dry = relight(here, &format!("{line} --dry-run"));
        assert_eq!((dry.code, relight(here, line).code), (Some(code), Some(code)), "{line}\n{}", dry.stderr);
    }
    relight(here, "bake capture -o a.ktx2 --basis ptm").ok();
    let said = relight(here, "render a.ktx2 --light 0,0,1 -o r.png --dry-run").ok().stdout;
    assert_eq!(said, "read a.ktx2\nwrite r.png\n");
    let said = relight(here, "convert a.ktx2 -o c.exr --depfile c.d --dry-run").ok().stdout;
    assert_eq!(said, "read a.ktx2\nwrite c.exr\nwrite c.d\n");
    assert_eq!(names_in(here), ["a.ktx2", "capture"]);
}

#[cfg(unix)]
#[test]
fn the_next_run_removes_what_a_killed_one_left() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    scene::copy_icon72(&here.join("capture"), 2);
    fs::create_dir(here.join("out")).unwrap();
    for (output, line) in [
        ("a.ktx2", "bake ../capture -o a.ktx2 --basis srbf -k 36 -j 1 --report a.json"),
        ("b.web", "bake ../capture -o b.web --basis ptm -j 1"),
    ] {
        let out = here.join("out");
        let strays = || -> Vec<PathBuf> {
            let all = names_in(&out).into_iter().filter(|name| name.contains(".relight-"));
            all.map(|name| out.join(name)).collect()
        };
        // A run that is stopped while it writes, so that nothing races with it. One that was faster is let go.
        let (mut child, held) = loop {
            let mut child =
                command(&out).args(line.split(' ')).stdout(std::process::Stdio::null()).spawn().unwrap();
            let mut before = Vec::new();
            // Not the short-lived ones by which it finds out where it may write.
            while child.try_wait().unwrap().is_none() && (before.is_empty() || strays() != before) {
                before = strays();
                std::thread::sleep(Duration::from_millis(30));
            }
            Command::new("kill").args(["-STOP", &child.id().to_string()]).status().unwrap();
            std::thread::sleep(Duration::from_millis(30));
            let held = strays();
            if !held.is_empty() && !out.join(output).exists() {
                break (child, held);
            }
            child.kill().unwrap();
            child.wait().unwrap();
            relight(&out, line).ok();
            fs::remove_dir_all(&out).unwrap();
            fs::create_dir(&out).unwrap();
        };
        // While it lives, another run to the same output leaves what it has alone.
        relight(&out, &format!("bake ../capture -o {output} --basis ptm -k 99")).assert_refused(2, &[]);
        assert!(held.iter().all(|path| path.exists()));
        child.kill().unwrap();
        child.wait().unwrap();
        assert!(!out.join(output).exists());
        assert!(!strays().is_empty());
        relight(&out, line).ok();
        assert_eq!(strays(), Vec::<PathBuf>::new());
        assert!(out.join(output).exists());
    }
}

/// Threads under GNU make's jobserver.
#[cfg(unix)]
mod jobserver_of_make {
    use super::*;
    use jobserver::Client;
    use std::process::{Child, Stdio};

    /// Tokens that nobody holds.
    fn free(server: &Client) -> usize {
        server.available().unwrap()
    }

    /// A long bake under `server`; what it says is thrown away.
    fn start(server: &Client, here: &Path, more: &[&str]) -> Child {
        let mut command = command(here);
        server.configure_make(&mut command);
        command
            .args(["bake", "capture", "-o", "a.ktx2", "--basis", "srbf", "-k", "64", "--block", "bc7"])
            .args(more);
        command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
    }

    /// The least number of free tokens until `child` has written for a while: a temporary stands for six looks, other than those by
    /// which it finds out where it may write.
    fn least_free(server: &Client, child: &mut Child, here: &Path) -> usize {
        let temporary = || names_in(here).into_iter().find(|name| name.starts_with(".a.ktx2"));
        let mut least = free(server);
        let (mut last, mut looks) = (None, 0);
        while looks < 6 {
            assert!(child.try_wait().unwrap().is_none(), "it ended before it wrote");
            least = least.min(free(server));
            std::thread::sleep(Duration::from_millis(5));
            let now = temporary();
            looks = if now.is_some() && now == last { looks + 1 } else { 0 };
            last = now;
        }
        least.min(free(server))
    }

    #[test]
    fn free_tokens_are_taken_and_all_go_back_however_it_ends() {
        let folder = tempfile::tempdir().unwrap();
        let here = folder.path();
        scene::copy_icon72(&here.join("capture"), 1);
        let others = std::thread::available_parallelism().unwrap().get() - 1;
        for (tokens, more) in [(0, &[][..]), (1, &[]), (50, &[]), (50, &["-j", "2"])] {
            let server = Client::new(tokens).unwrap();
            let mut child = start(&server, here, more);
            let taken = if more.is_empty() { tokens.min(others) } else { 0 };
            assert_eq!(least_free(&server, &mut child, here), tokens - taken, "of {tokens}, {more:?}");
            // Ctrl-C gives them back.
            Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
            assert_eq!(child.wait().unwrap().code(), Some(130));
            assert_eq!(free(&server), tokens);
        }
        // So does an end, good or bad.
        for (line, code) in [("bake capture -o b.ktx2 --basis ptm", 0), ("bake none -o b.ktx2", 4)] {
            let server = Client::new(3).unwrap();
            let mut command = command(here);
            server.configure_make(&mut command);
            let ran = outcome(line.to_owned(), command.args(line.split(' ')).output().unwrap());
            assert_eq!((ran.code, free(&server)), (Some(code), 3), "{line}\n{}", ran.stderr);
            assert!(!ran.stderr.contains("jobserver"), "{}", ran.stderr);
        }
    }

    #[test]
    fn a_jobserver_out_of_reach_leaves_one_thread_and_a_note() {
        let folder = made(6);
        let here = folder.path();
        for (flags, is_noted) in [
            (" -j4 --jobserver-auth=193,194", true),
            (" -j4 --jobserver-auth=-2,-2", true),
            (" -j4 --jobserver-auth=fifo:/no/fifo", true),
            (" -j4 --jobserver-auth=0,1", true),
            ("k", false),
            ("", false),
        ] {
            let mut command = command(here);
            command.env("MAKEFLAGS", flags).args("bake capture -o a.ktx2 --basis ptm".split(' '));
            let ran = outcome(flags.to_owned(), command.output().unwrap()).ok();
            assert_eq!(ran.stderr.contains("begin the recipe with +"), is_noted, "{flags}: {}", ran.stderr);
            let ran = outcome(flags.to_owned(), command.args(["-j", "2"]).output().unwrap()).ok();
            assert!(!ran.stderr.contains("jobserver"), "{flags}: {}", ran.stderr);
        }
    }

    #[test]
    fn gnu_make_lends_threads_to_recipes_that_ask() {
        let Some(_) = tool("make") else { return };
        let folder = made(6);
        let here = folder.path();
        let program = env!("CARGO_BIN_EXE_relight");
        let bake = |i: usize| format!("{program} bake capture -o {i}.ktx2 --basis ptm");
        let makefile = format!("all: 1 2 3\n1: ; +{}\n2: ; +{}\n3: ; {}\n", bake(1), bake(2), bake(3));
        fs::write(here.join("Makefile"), makefile).unwrap();
        let mut make = Command::new("make");
        make.current_dir(here).args(["-j2", "-O"]).env_remove("MAKEFLAGS").env_remove("MAKELEVEL");
        let ran = make.env_remove("CARGO_MAKEFLAGS").output().unwrap();
        let said = String::from_utf8_lossy(&ran.stderr).into_owned();
        assert!(ran.status.success(), "{said}");
        // The third says that it has no access; make would say so if a token was lost or one too many came back.
        assert!(said.matches("jobserver").count() <= 1, "{said}");
        assert!(!said.contains("make: ***") && !said.contains("INTERNAL"), "{said}");
        assert_eq!(names_in(here), ["1.ktx2", "2.ktx2", "3.ktx2", "Makefile", "capture"]);
    }
}
