//! Writes the generated part of docs/accuracy.md from `testdata/`: what each choice costs, and where the error of
//! some of them comes from.
//!
//! `make report` runs it.

use serde_json::Value;
use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

const BEGIN: &str = "<!-- Written by `make report` up to the end mark. -->\n";
const END: &str = "<!-- The end of what `make report` writes. -->\n";

/// Assets whose error is taken apart.
const ASSETS: [(&str, &str); 5] = [
    ("ptm.ktx2", "--basis ptm -k 6"),
    ("srbf.dds", "--basis srbf -k 25 --block bc7"),
    ("sh.ktx2", "--basis sh -k 9 --block bc1"),
    ("pca.ktx2", "--basis pca -k 27"),
    ("hsh.exr", "--basis hsh -k 16"),
];

const SET: &str = "testdata/icon72";

fn main() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut text = String::from(BEGIN);
    choices(&root, folder.path(), &mut text);
    budgets(&root, folder.path(), &mut text);
    text.push_str(END);

    let path = root.join("docs/accuracy.md");
    let before = std::fs::read_to_string(&path).expect("docs/accuracy.md");
    let (head, rest) = before.split_once(BEGIN).expect("the mark where the generated part begins");
    let (_, tail) = rest.split_once(END).expect("the mark where the generated part ends");
    std::fs::write(&path, format!("{head}{text}{tail}")).expect("docs/accuracy.md can be written");
    println!("docs/accuracy.md is written");
}

fn relight(root: &Path, arguments: &[&str]) {
    let status = Command::new(env!("CARGO_BIN_EXE_relight")).args(arguments).current_dir(root).status();
    assert!(status.is_ok_and(|status| status.success()), "relight {} failed", arguments.join(" "));
}

fn json(path: &Path) -> Value {
    let text = std::fs::read_to_string(path).expect("a report");
    serde_json::from_str(&text).expect("a report in JSON")
}

/// The processor and how many of its cores there are.
fn machine() -> String {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let about = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = about.lines().find_map(|line| line.strip_prefix("model name")?.split_once(": "));
    format!("{cores} cores of {}", model.map_or("a machine that doesn't say its name", |(_, name)| name))
}

fn date() -> String {
    let output = Command::new("date").args(["-u", "+%F"]).output();
    output.map_or("an unknown day".to_owned(), |output| {
        String::from_utf8_lossy(&output.stdout).trim().to_owned()
    })
}

fn choices(root: &Path, folder: &Path, text: &mut String) {
    let out = folder.join("sweep");
    relight(root, &["sweep", SET, "-o", &out.to_string_lossy()]);
    let report = json(&out.join("report.json"));
    let number = |value: &Value| value.as_f64().unwrap_or(f64::NAN);
    let of = |choice: &Value, key: &str| number(&choice[key]);
    let choices = report["choices"].as_array().expect("choices");
    let adapter = choices.iter().find_map(|choice| choice["gpu"]["adapter"].as_str());
    let _ = write!(
        text,
        "## What each choice costs\n\n`make report` on {}, {}: `relight sweep {SET} -o FOLDER`, {} pictures of {} x {}, all {} choices of the usual grid.\n\
         PSNR and RMSE of predicting each light from the others, storing included. Fronts: b, no choice of as few bytes of texels is better;\n\
         t, none that relights as fast (directional, CPU); s, none that bakes as fast. CPU: one thread. GPU: {}.\n\n\
         | choice | dB | RMSE | bytes a pixel: GPU, disk | bake s | relight, ns a pixel: directional, point, GPU | fronts |\n|---|---|---|---|---|---|---|\n",
        machine(),
        date(),
        report["pictures"],
        report["width"],
        report["height"],
        choices.len(),
        adapter.unwrap_or("none here"),
    );
    for choice in choices {
        let fronts = [("bytes", "b"), ("time", "t"), ("bake", "s")];
        let marks: Vec<&str> = fronts
            .iter()
            .filter(|(front, _)| choice["front"][*front] == true)
            .map(|(_, mark)| *mark)
            .collect();
        let gpu = choice["gpu"]["ns"].as_f64().map_or("-".to_owned(), |ns| format!("{ns:.0}"));
        let _ = writeln!(
            text,
            "| {} | {:.2} | {:.4} | {:.1}, {:.1} | {:.2} | {:.0}, {:.0}, {gpu} | {} |",
            choice["name"].as_str().unwrap_or_default(),
            of(choice, "psnr"),
            of(choice, "rmse"),
            of(choice, "gpu_bytes_per_pixel"),
            of(choice, "disk_bytes_per_pixel"),
            of(choice, "bake_seconds"),
            of(choice, "directional_ns"),
            of(choice, "point_ns"),
            marks.join(" "),
        );
    }
    let dearest = choices.iter().map(|choice| of(choice, "bake_seconds")).fold(0.0, f64::max);
    let (all, alone) = (number(&report["seconds"]), number(&report["seconds_alone"]));
    let _ = writeln!(
        text,
        "\nThe whole sweep took {all:.1} s, measuring included; the choices one by one {alone:.1} s, the dearest of them {dearest:.1} s.\n"
    );
}

fn budgets(root: &Path, folder: &Path, text: &mut String) {
    let _ = write!(
        text,
        "## Where the error comes from\n\n`make report`, the same machine and day: `relight bake {SET} -o ASSET OPTIONS --holdout every:6 --report REPORT.json`. Mean squared error that\n\
         each stage adds, and their sum, which is what `relight evaluate` finds on the file; as a root, and the seconds of the bake beside it.\n\n\
         | asset | fit | held-out | quantisation | block coding | sum | RMSE | GPU against CPU, largest | bake s |\n|---|---|---|---|---|---|---|---|---|\n",
    );
    for (name, options) in ASSETS {
        let (asset, report) = (folder.join(name), folder.join("report.json"));
        let (output, written) = (asset.to_string_lossy(), report.to_string_lossy());
        let mut arguments = vec!["bake", SET, "-o", &output, "--holdout", "every:6", "--report", &written];
        arguments.extend(options.split(' '));
        relight(root, &arguments);
        let report = json(&report);
        let budget = &report["error_budget"];
        let stages = budget["stages"].as_array().expect("stages");
        let stage = |name: &str| {
            let found = stages.iter().find(|stage| stage["name"] == name);
            found
                .and_then(|stage| stage["adds_mse"].as_f64())
                .map_or("-".to_owned(), |mse| format!("{mse:.2e}"))
        };
        let number = |value: &Value| value.as_f64().map_or("-".to_owned(), |v| format!("{v:.2e}"));
        let seconds = report["seconds"].as_object().into_iter().flatten().filter_map(|(stage, seconds)| {
            let own = !["hold-out", "error budget"].contains(&stage.as_str());
            seconds.as_f64().filter(|_| own)
        });
        let _ = writeln!(
            text,
            "| {} {} | {} | {} | {} | {} | {} | {:.4} | {} | {:.2} |",
            name,
            options,
            stage("fit"),
            stage("held-out"),
            stage("quantisation"),
            stage("block coding"),
            number(&budget["total_mse"]),
            budget["total_rmse"].as_f64().unwrap_or(f64::NAN),
            number(&budget["gpu"]["max"]),
            seconds.sum::<f64>(),
        );
    }
    text.push('\n');
}
