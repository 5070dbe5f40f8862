//! Ways to speak with the program: response files, standard streams, lines of JSON, several jobs, completions, pages.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

mod scene;

use scene::{command, made, names_in, outcome, relight, relight_words, schema};
use serde_json::Value;
use std::fs;
use std::io::{ErrorKind, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// Writes `bytes` to a program's standard input. One that refuses its options ends without having read them.
fn feed(child: &mut Child, bytes: &[u8]) {
    if let Err(e) = child.stdin.take().unwrap().write_all(bytes) {
        assert_eq!(e.kind(), ErrorKind::BrokenPipe, "{e}");
    }
}

/// Runs the program with `text` on standard input, and gives its bytes.
fn relight_fed(here: &Path, line: &str, text: &str) -> std::process::Output {
    let mut child = command(here)
        .args(line.split(' '))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    feed(&mut child, text.as_bytes());
    child.wait_with_output().unwrap()
}

#[test]
fn response_files_stand_for_their_words() {
    let folder = made(9);
    let here = folder.path();
    fs::rename(here.join("capture"), here.join("cap ture")).unwrap();
    fs::write(here.join("all.rsp"), "'cap ture' -o \"a b.ktx2\"\n@more.rsp --depfile @@d\n").unwrap();
    fs::write(here.join("more.rsp"), "--basis\tptm\n--ridge=0.5").unwrap();
    relight(here, "bake @all.rsp").ok();
    assert_eq!(names_in(here), ["@d", "a b.ktx2", "all.rsp", "cap ture", "more.rsp"]);
    let plain = ["bake", "cap ture", "-o", "c.ktx2", "--basis", "ptm", "--ridge", "0.5"];
    relight_words(here, &plain).ok();
    assert!(fs::read(here.join("a b.ktx2")).unwrap() == fs::read(here.join("c.ktx2")).unwrap());
    // The subcommand itself, and a job file within.
    fs::write(here.join("job.toml"), "input = 'cap ture'\noutput = 'd.ktx2'\nbasis = 'ptm'").unwrap();
    fs::write(here.join("job.rsp"), "--log-format text bake job.toml").unwrap();
    relight(here, "@job.rsp").ok();

    let write = |name: &str, text: &str| fs::write(here.join(name), text).unwrap();
    write("open.rsp", "bake\n'cap ture\n-o x");
    relight(here, "@open.rsp").assert_refused(2, &["open.rsp: line 2", "quote"]);
    write("lost.rsp", "bake\n\n@none.rsp");
    relight(here, "@lost.rsp").assert_refused(4, &["lost.rsp: line 3", "none.rsp"]);
    relight(here, "bake @").assert_refused(2, &["names no file"]);
    relight(here, "@none.rsp").assert_refused(4, &["none.rsp"]);
    write("self.rsp", "bake\n@./self.rsp");
    relight(here, "@self.rsp").assert_refused(2, &["self.rsp: line 2", "can't hold itself"]);
    write("ping.rsp", "@pong.rsp");
    write("pong.rsp", "bake @ping.rsp");
    relight(here, "@ping.rsp").assert_refused(2, &["pong.rsp: line 1", "can't hold itself"]);
    for depth in 1..=11 {
        let next = if depth == 11 { "--version".to_owned() } else { format!("@{}.rsp", depth + 1) };
        write(&format!("{depth}.rsp"), &next);
    }
    relight(here, "@2.rsp").ok();
    relight(here, "@1.rsp").assert_refused(2, &["10.rsp: line 1", "deeper than 10"]);
    // The same file twice is no cycle; a bomb of files ends.
    write("twice.rsp", "@more.rsp @more.rsp");
    relight_words(here, &["bake", "cap ture", "-o", "e.ktx2", "@twice.rsp"]).ok();
    write("z0.rsp", &"x ".repeat(1 << 10));
    for level in 1..9 {
        write(&format!("z{level}.rsp"), &format!("@z{}.rsp ", level - 1).repeat(64));
    }
    relight(here, "bake @z8.rsp").assert_refused(2, &["1048576"]);
}

#[test]
fn a_dash_is_standard_input_or_output_where_one_file_goes() {
    let folder = made(9);
    let here = folder.path();
    let job = "input = 'capture'\nbasis = 'ptm'\nreport = '-'\n";
    let ran = relight_fed(here, "bake - -o a.ktx2", job);
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    let report: Value = serde_json::from_slice(&ran.stdout).unwrap();
    schema::check("bake", &report);
    // What people read went to the other stream.
    assert!(String::from_utf8_lossy(&ran.stderr).contains("a.ktx2: 24 x 16"));
    relight(here, "bake capture -o b.ktx2 --basis ptm").ok();
    assert!(fs::read(here.join("a.ktx2")).unwrap() == fs::read(here.join("b.ktx2")).unwrap());
    let refused = relight_fed(here, "bake - -o a.ktx2", "inputt = 'capture'");
    let words = String::from_utf8(refused.stderr).unwrap();
    assert!(words.starts_with("relight: error: standard input: unknown key 'inputt'"), "{words}");

    for (file, depth) in [("r.png", "8"), ("s.png", "16"), ("r.exr", "half"), ("s.exr", "float")] {
        relight(here, &format!("render a.ktx2 --light 0,0.3,1 -o {file} --depth {depth}")).ok();
        let piped = relight_fed(here, &format!("render a.ktx2 --light 0,0.3,1 -o - --depth {depth}"), "");
        assert!(piped.stdout == fs::read(here.join(file)).unwrap(), "{depth}");
    }
    let explained = relight_fed(here, "render a.ktx2 --light 0,0.3,1 -o - --explain", "");
    assert!(explained.stdout == fs::read(here.join("r.png")).unwrap() && !explained.stderr.is_empty());
    let shader = relight(here, "shader a.ktx2").ok().stdout;
    assert_eq!(relight(here, "shader a.ktx2 -o -").ok().stdout, shader);

    let before = names_in(here);
    for (line, option) in [
        ("bake capture -o - --basis ptm", "--output -"),
        ("bake -o - -", "--output -"),
        ("bake - -o -", "--output -"),
        ("bake capture -o c.ktx2 --basis ptm --report - --depfile -", "share standard output"),
        ("render - --light 0,0,1 -o x.png", "ASSET -"),
        ("render a.ktx2 --lights capture/lights.lp -o -", "one picture"),
        ("convert a.ktx2 -o -", "--output -"),
        ("info -", "FILE -"),
        ("normals capture -o -", "--output -"),
        ("bake capture -o c.ktx2 --heatmaps - --report r.json", "--heatmaps -"),
    ] {
        let ran = relight_fed(here, line, job);
        let ran = outcome(line.to_owned(), ran);
        ran.assert_refused(2, &[option]);
        assert_eq!(names_in(here), before, "{line}");
    }
}

/// The objects on standard error, each held to the schema.
fn lines_of(ran: &scene::Outcome) -> Vec<Value> {
    let lines = ran.stderr.lines().map(|line| {
        let object: Value =
            serde_json::from_str(line).unwrap_or_else(|e| panic!("relight {}: {e}: {line}", ran.line));
        schema::check("log", &object);
        object
    });
    lines.collect()
}

fn messages(lines: &[Value], level: &str) -> Vec<String> {
    let of = lines.iter().filter(|line| line["level"] == level);
    of.map(|line| line["message"].as_str().unwrap().to_owned()).collect()
}

#[test]
fn everything_said_is_a_json_object_a_line() {
    let folder = made(12);
    let here = folder.path();
    // A picture under another's name gives a note.
    let swapped = [("p03.png", "t"), ("p09.png", "p03.png"), ("t", "p09.png")];
    swapped
        .iter()
        .for_each(|(a, b)| fs::rename(here.join("capture").join(a), here.join("capture").join(b)).unwrap());
    let plain = relight(here, "bake capture -o a.ktx2 --basis ptm").ok();
    assert!(!plain.stderr.is_empty());
    let mut all = String::new();
    for line in [
        "--log-format json bake capture -o a.ktx2 --basis ptm",
        "bake --log-format=json capture -o a.ktx2 --basis ptm",
    ] {
        let ran = relight(here, line).ok();
        assert_eq!(ran.stdout, "");
        let lines = lines_of(&ran);
        let notes: Vec<String> = plain
            .stderr
            .lines()
            .map(|line| line.strip_prefix("relight: note: ").unwrap().to_owned())
            .collect();
        assert_eq!(messages(&lines, "note"), notes);
        // All lines but that of times.
        let said: Vec<&str> = plain.stdout.lines().collect();
        let results = messages(&lines, "result");
        assert_eq!(results[..results.len() - 1], said[..said.len() - 1]);
        assert_eq!(messages(&lines, "progress"), ["decoding", "fitting"]);
        all += &ran.stderr;
    }
    for (line, code, name) in [
        ("bake none -o a.ktx2 --log-format json", 4, "input/output"),
        ("--log-format json bake capture -o a.xyz", 2, "usage"),
        ("bakery --log-format json", 2, "usage"),
        ("--log-format json", 2, "usage"),
        ("info capture/p00.pn --log-format=json", 4, "input/output"),
        ("--log-format json @none.rsp", 4, "input/output"),
    ] {
        let ran = relight(here, line);
        assert_eq!((ran.code, ran.stdout.as_str()), (Some(code), ""), "{line}");
        let lines = lines_of(&ran);
        let [error] = &lines[..] else { panic!("{line}\n{}", ran.stderr) };
        assert_eq!((&error["code"], &error["name"]), (&code.into(), &name.into()), "{line}");
        all += &ran.stderr;
    }
    let info = relight(here, "info a.ktx2 --log-format json").ok();
    assert_eq!(
        messages(&lines_of(&info), "result"),
        relight(here, "info a.ktx2").ok().stdout.lines().collect::<Vec<_>>()
    );
    // What is made for programs anyway stays where it was.
    let product = relight(here, "info a.ktx2 --json --log-format json").ok();
    assert_eq!(
        (product.stdout, product.stderr),
        (relight(here, "info a.ktx2 --json").ok().stdout, String::new())
    );
    relight(here, "info a.ktx2 --log-format xml").assert_refused(2, &["'xml'", "text, json"]);

    // A validator that others wrote agrees.
    all += &info.stderr;
    fs::write(here.join("lines"), all).unwrap();
    let script = "import json, sys, jsonschema\n\
        s = json.load(open(sys.argv[1])); jsonschema.Draft202012Validator.check_schema(s)\n\
        v = jsonschema.Draft202012Validator(s)\n\
        for line in open('lines'): v.validate(json.loads(line))\n\
        assert not v.is_valid({'level': 'shout', 'message': ''}) and not v.is_valid({'level': 'note'})";
    let schema = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/schema/log.schema.json");
    if !Command::new("python3")
        .args(["-c", "import jsonschema"])
        .output()
        .is_ok_and(|ran| ran.status.success())
    {
        println!("skipped: no python3 with jsonschema on this machine");
        return;
    }
    let ran = Command::new("python3").current_dir(here).args(["-c", script]).arg(schema).output().unwrap();
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
}

#[test]
fn several_jobs_each_have_a_result_and_one_failure_stops_no_other() {
    let folder = made(9);
    let here = folder.path();
    let write = |name: &str, text: &str| fs::write(here.join(name), text).unwrap();
    write("a.toml", "input = 'capture'\noutput = 'a.ktx2'\nbasis = 'ptm'\ndepfile = 'a.d'\nridge = 0.5\n");
    write("b.toml", "input = 'none'\noutput = 'b.ktx2'\nbasis = 'ptm'\n");
    write("c.toml", "inputt = 'capture'\noutput = 'c.ktx2'\n");
    write("d.toml", "input = 'capture'\noutput = 'd.ktx2'\nbasis = 'ptm'\n");
    let ran = relight(here, "bake a.toml --precision f16 b.toml c.toml -j 2 d.toml");
    assert_eq!(ran.code, Some(4), "{}", ran.stderr);
    let results: Vec<&str> = ran.stdout.lines().filter(|line| line.contains(".toml: ")).collect();
    assert_eq!(
        results,
        [
            "a.toml: done",
            "b.toml: error: input/output, exit code 4",
            "c.toml: error: usage, exit code 2",
            "d.toml: done"
        ]
    );
    let errors: Vec<&str> = ran.stderr.lines().collect();
    let [b, c] = errors[..] else { panic!("{}", ran.stderr) };
    assert!(b.starts_with("relight: error: b.toml: cannot ") && b.contains("none"), "{b}");
    assert!(c.starts_with("relight: error: c.toml: unknown key 'inputt'"), "{c}");
    // Options are for all of them, and the job file is an input.
    let flags = "bake capture -o e.ktx2 --basis ptm --precision f16 --ridge";
    relight(here, &format!("{flags} 0.5")).ok();
    let bytes = |name: &str| fs::read(here.join(name)).unwrap();
    assert!(bytes("a.ktx2") == bytes("e.ktx2"));
    relight(here, "bake capture -o e.ktx2 --basis ptm --precision f16").ok();
    assert!(bytes("d.ktx2") == bytes("e.ktx2"));
    // Two of one asset, in whatever words.
    fs::create_dir(here.join("jobs")).unwrap();
    write("jobs/f.toml", "input = '../capture'\noutput = '../a.ktx2'\nbasis = 'hsh'\n");
    let before = bytes("a.ktx2");
    let words = ["a.toml and jobs/f.toml both write", "a.ktx2", "its own output"];
    relight(here, "bake a.toml d.toml jobs/f.toml").assert_refused(2, &words);
    // Whatever flag names it.
    for (key, file) in
        [("depfile", "a.ktx2"), ("depfile", "a.d"), ("heatmaps", "a.d"), ("report", "a.d.html")]
    {
        write("g.toml", &format!("input = 'capture'\noutput = 'g.ktx2'\n{key} = '{file}'\n"));
        write("h.toml", "input = 'capture'\noutput = 'a.d.json'\n");
        let other = if key == "report" { "h.toml" } else { "a.toml" };
        let words = [&format!("{other} and g.toml both write"), &format!("its own {key}")];
        relight(here, &format!("bake {other} g.toml")).assert_refused(2, &words.map(String::as_str));
    }
    assert!(bytes("a.ktx2") == before);
    assert!(fs::read_to_string(here.join("a.d")).unwrap().ends_with(" \\\n  a.toml\n"));

    let ran = relight(here, "bake b.toml d.toml --log-format json");
    let lines = lines_of(&ran);
    let of_d = lines.iter().filter(|line| line["job"] == "d.toml").count();
    assert!(of_d > 2 && lines.iter().all(|line| line["job"].is_string()), "{}", ran.stderr);
    assert_eq!(messages(&lines, "result").last().unwrap(), "d.toml: done");

    relight(here, "bake a.toml d.toml -o x.ktx2").assert_refused(2, &["-o names one file", "'output'"]);
    relight(here, "bake a.toml d.toml --report=x.json").assert_refused(2, &["--report names one file"]);
    relight(here, "bake a.toml d.toml --depfile -").assert_refused(2, &["--depfile names one file"]);
    relight(here, "bake a.toml capture").assert_refused(2, &["unexpected argument"]);
    relight(here, "bake - -").assert_refused(2, &["one job"]);
    // One job says no more than it did.
    assert!(!relight(here, "bake d.toml").ok().stdout.contains("done"));
}

#[test]
fn completions_are_scripts_of_their_shells() {
    let here = Path::new(".");
    for (shell, mark) in [
        ("bash", "complete -F"),
        ("zsh", "#compdef relight"),
        ("fish", "complete -c relight"),
        ("powershell", "Register-"),
        ("elvish", "edit:"),
    ] {
        let script = relight(here, &format!("completions {shell}")).ok().stdout;
        for word in [mark, "bake", "depfile-format", "log-format", "completions"] {
            assert!(script.contains(word), "{shell}: no {word}");
        }
        assert!(!script.contains("job-file"), "{shell}");
        let Ok(mut check) =
            Command::new(shell).arg("-n").stdin(Stdio::piped()).stderr(Stdio::piped()).spawn()
        else {
            println!("skipped: no {shell} on this machine");
            continue;
        };
        feed(&mut check, script.as_bytes());
        let checked = check.wait_with_output().unwrap();
        assert!(
            checked.status.success() && checked.stderr.is_empty(),
            "{}",
            String::from_utf8_lossy(&checked.stderr)
        );
    }
    relight(here, "completions tcsh").assert_refused(2, &["'tcsh'", "bash"]);
}

#[test]
fn every_subcommand_has_a_manual_page() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    relight(here, "man --output pages/man1").ok();
    let pages = here.join("pages/man1");
    let names = names_in(&pages);
    let read = |name: &str| fs::read_to_string(pages.join(name)).unwrap();
    let help = relight(here, "--help").ok().stdout;
    let commands = help.split("Commands:").nth(1).unwrap().split("Options:").next().unwrap();
    let mut commands: Vec<String> = commands
        .lines()
        .filter(|line| line.starts_with("  ") && !line.starts_with("   "))
        .filter_map(|line| line.split_whitespace().next())
        .filter(|name| *name != "help")
        .map(|name| format!("relight-{name}.1"))
        .collect();
    commands.extend(["relight.1", "relight-rig-bake.1", "relight-rig-render.1"].map(str::to_owned));
    for name in &commands {
        assert!(names.contains(name), "no {name} among {names:?}");
    }
    assert!(
        read("relight-bake.1").contains(r"\-\-depfile\-format") && read("relight-bake.1").contains("log")
    );
    assert!(!read("relight-bake.1").contains(r"job\-file"));
    assert!(read("relight.1").contains("130 interrupted"));
    assert_eq!(relight(here, "man").ok().stdout, read("relight.1"));
    let Ok(_) = Command::new("groff").arg("--version").output() else {
        println!("skipped: no groff on this machine");
        return;
    };
    for name in &names {
        let checked = Command::new("groff")
            .args(["-man", "-ww", "-Tutf8", "-z"])
            .arg(pages.join(name))
            .output()
            .unwrap();
        assert!(
            checked.status.success() && checked.stderr.is_empty(),
            "{name}: {}",
            String::from_utf8_lossy(&checked.stderr)
        );
    }
}
