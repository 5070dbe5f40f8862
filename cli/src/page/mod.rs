//! `report.html`: one file that shows a bake or a sweep, with everything that it needs inside.
//!
//! The figures are those of the JSON report beside it; what the page has beyond them is the asset itself, small enough for a
//! page, the photographs, and scripts that relight the one beside the other.

mod error_budget;
mod escape;
mod pictures;
mod planes;
mod plot;
mod shrink;
mod ticks;

use crate::budget::Budget;
use crate::failure::Failure;
use crate::options::Machine;
use crate::say::is_dash;
use error_budget::budget_json;
pub(crate) use escape::html;
use pictures::{Likeness, page_pictures};
use planes::page_planes;
use plot::{Cost, Point, plot};
use relight_core::sphere::largest_hole;
use relight_core::{PlaneRole, RelightingMaps};
use relight_fit::{Decomposition, LightWeights};
use relight_formats::{OpenCapture, read_asset, write_whole};
use relight_lights::{Horizon, HorizonRule};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
pub(crate) use ticks::Axis;

/// The page without its contents.
const SKELETON: &str = include_str!("page.html");

const STYLE: &str = include_str!("page.css");

/// In the order in which they run.
const SCRIPTS: [&str; 10] = [
    include_str!("basis.js"),
    include_str!("planes.js"),
    include_str!("webgl.js"),
    include_str!("elements.js"),
    include_str!("state.js"),
    include_str!("summary.js"),
    include_str!("lights.js"),
    include_str!("viewer.js"),
    include_str!("inspector.js"),
    include_str!("start.js"),
];

/// What a page shows.
pub(crate) struct Page<'a> {
    /// Where it is to stand.
    pub(crate) path: &'a Path,
    /// The report beside it.
    pub(crate) report: &'a Value,
    pub(crate) machine: &'a Machine,
    pub(crate) budget: Option<&'a Budget>,
    /// Nothing where no asset is left to show.
    pub(crate) details: Option<Details<'a>>,
}

/// An asset and what it was made of.
pub(crate) struct Details<'a> {
    pub(crate) name: &'a str,
    pub(crate) maps: &'a RelightingMaps,
    /// The pictures that were fitted, and those that were left out to judge by.
    pub(crate) fitted: &'a OpenCapture,
    pub(crate) judges: Option<&'a OpenCapture>,
    /// How much of each fitted light's picture its fit is, 0 to 1, where that is known.
    pub(crate) leverage: Vec<Option<f64>>,
    /// Ratio of the largest to the least singular value of the functions at the lights.
    pub(crate) condition: Option<f64>,
}

/// Where the JSON of a report of `--report path` goes (`-` for standard output), and where its page, if it has one.
///
/// # Errors
/// Exit code 2 for an extension other than .json and .html.
pub(crate) fn report_files(path: &Path) -> Result<(PathBuf, Option<PathBuf>), Failure> {
    if is_dash(path) {
        return Ok((path.to_owned(), None));
    }
    let extension = path.extension().map(|extension| extension.to_string_lossy().to_ascii_lowercase());
    match extension.as_deref() {
        Some("json") => Ok((path.to_owned(), None)),
        Some("html") => Ok((path.with_extension("json"), Some(path.to_owned()))),
        _ => Err(Failure::usage(format!(
            "--report {}: a report is a .json file, or a .html page with the .json beside it",
            path.display()
        ))),
    }
}

/// Writes the page of a bake to `path`; `report` is the JSON beside it.
pub(crate) fn write_bake_page(
    path: &Path,
    report: &Value,
    asset: &Path,
    (fitted, judges): (&OpenCapture, Option<&OpenCapture>),
    budget: Option<&Budget>,
    machine: &Machine,
) -> Result<(), Failure> {
    let maps = read_asset(asset, machine.memory)?;
    let lights = report["lights"].as_array().map(Vec::as_slice).unwrap_or_default();
    let details = Details {
        name: &asset.to_string_lossy(),
        maps: &maps,
        fitted,
        judges,
        leverage: lights.iter().map(|light| light["leverage"].as_f64()).collect(),
        condition: report["condition"].as_f64(),
    };
    Page { path, report, machine, budget, details: Some(details) }.write()
}

/// Writes `report.html` of a sweep into its `folder`; `report` is report.json there.
pub(crate) fn write_sweep_page(
    folder: &Path,
    report: &Value,
    (fitted, judges): (&OpenCapture, Option<&OpenCapture>),
    weighting: LightWeights,
    machine: &Machine,
) -> Result<(), Failure> {
    let path = folder.join("report.html");
    let name = shown_choice(report).and_then(|choice| choice["name"].as_str()).unwrap_or_default();
    let asset = folder.join("assets").join(format!("{name}.ktx2"));
    let maps = match asset.is_file() {
        true => Some(read_asset(&asset, machine.memory)?),
        false => None,
    };
    let details = match &maps {
        Some(maps) => {
            let (leverage, condition) = determination(maps, weighting)?;
            Some(Details { name, maps, fitted, judges, leverage, condition })
        }
        None => None,
    };
    Page { path: &path, report, machine, budget: None, details }.write()
}

/// The choice that a sweep's page shows in full: the one that the targets take, or else the best of the front of bytes.
fn shown_choice(report: &Value) -> Option<&Value> {
    let choices = report["choices"].as_array()?;
    if let Some(chosen) = report["chosen"].as_str() {
        return choices.iter().find(|choice| choice["name"] == chosen);
    }
    let psnr = |choice: &Value| choice["psnr"].as_f64().unwrap_or(f64::NEG_INFINITY);
    choices
        .iter()
        .filter(|choice| choice["front"]["bytes"] == true)
        .max_by(|a, b| psnr(a).total_cmp(&psnr(b)))
}

/// Leverages and condition number that functions of light have at an asset's lights, with the family's own ridge; those of
/// learned planes are a matter of pictures and stay unknown.
fn determination(
    maps: &RelightingMaps,
    weighting: LightWeights,
) -> Result<(Vec<Option<f64>>, Option<f64>), Failure> {
    let model = &maps.model;
    let family = model.basis.family();
    if family.learned || model.lights.is_empty() {
        return Ok((vec![None; model.lights.len()], None));
    }
    let decomposition = Decomposition::new(&model.basis, &model.lights, weighting)?;
    let hat = decomposition.hat(&decomposition.solution(family.ridge));
    let leverage = hat.into_iter().step_by(model.lights.len() + 1).map(Some).collect();
    Ok((leverage, Some(decomposition.condition()).filter(|condition| condition.is_finite())))
}

impl Page<'_> {
    fn write(&self) -> Result<(), Failure> {
        let text = self.html()?;
        Ok(write_whole(self.path, text.as_bytes())?)
    }

    /// The whole page.
    fn html(&self) -> Result<String, Failure> {
        let shown = shown_choice(self.report).map(|choice| &choice["name"]);
        let data = json!({
            "report": self.report,
            "shown": shown,
            "command": command(),
            "machine": format!(
                "{} {}, {} threads, {} instructions, {} MiB of memory to stay within",
                std::env::consts::OS,
                std::env::consts::ARCH,
                self.machine.threads,
                self.machine.level.name(),
                self.machine.memory >> 20
            ),
            "budget": self.budget.map(|budget| budget_json(budget, self.path)).transpose()?,
            "details": self.details.as_ref().map(|details| self.details_json(details)).transpose()?,
        });
        let subject = self.report["output"].as_str().or(self.report["input"].as_str()).unwrap_or_default();
        let kind = if self.report["kind"] == "sweep" { "sweep" } else { "bake" };
        let title = escape::html(&format!("{kind} of {subject}"));
        let parts = [
            ("{title}", title),
            ("{style}", STYLE.to_owned()),
            ("{plots}", plots(self.report)),
            ("{data}", escape::json(&data)),
            ("{script}", format!("'use strict';\n{}", SCRIPTS.join("\n"))),
        ];
        let mut page = String::new();
        let mut rest = SKELETON;
        for (place, part) in &parts {
            // What a part holds is never looked through for further places.
            if let Some((before, after)) = rest.split_once(place) {
                page.push_str(before);
                page.push_str(part);
                rest = after;
            }
        }
        page.push_str(rest);
        Ok(page)
    }

    fn details_json(&self, details: &Details<'_>) -> Result<Value, Failure> {
        let Details { name, maps, fitted, judges, leverage, condition } = details;
        let model = &maps.model;
        let planes = page_planes(maps, self.path)?;
        let likeness = Likeness { space: model.space, factor: planes.factor, page: self.path };
        let captures: Vec<&OpenCapture> = std::iter::once(*fitted).chain(*judges).collect();
        let pictures = page_pictures(&captures, likeness, self.machine)?;
        let of_capture = |(capture, fitted): (&&OpenCapture, bool)| {
            let light = move |light: &relight_core::Light| json!({ "name": light.name, "direction": light.direction, "fitted": fitted });
            capture.capture.lights.lights.iter().map(light).collect::<Vec<_>>()
        };
        let mut lights: Vec<Value> = captures.iter().zip([true, false]).flat_map(of_capture).collect();
        for (light, leverage) in lights.iter_mut().zip(leverage) {
            light["leverage"] = json!(leverage);
        }
        let roles: Vec<Value> = model
            .roles()
            .into_iter()
            .map(|role| match role {
                PlaneRole::Coefficient { functions } => json!({ "functions": functions }),
                PlaneRole::BaseColor { channel } => json!({ "base": channel }),
            })
            .collect();
        let horizon = Horizon::of(model, HorizonRule::Fade).cap;
        let hole = largest_hole(&fitted.capture.lights.directions());
        Ok(json!({
            "name": name,
            "width": planes.size.0,
            "height": planes.size.1,
            "whole": [maps.width, maps.height],
            "factor": planes.factor,
            "basis": model.basis,
            "space": model.space,
            "channels": model.channels(),
            "roles": roles,
            "mean": model.mean_functions(),
            "bias": planes.bias,
            "runs": planes.runs.iter().map(|run| json!([run.plane, run.gain])).collect::<Vec<_>>(),
            "images": planes.images,
            "horizon": { "axis": horizon.axis, "radius": horizon.radius },
            "gap": hole.map(|hole| json!({ "centre": hole.centre, "degrees": hole.radius.to_degrees() })),
            "condition": condition,
            "lights": lights,
            "pictures": {
                "every": pictures.every,
                "quality": pictures::QUALITY,
                "list": pictures.list.iter().map(|(light, uri)| json!([light, uri])).collect::<Vec<_>>(),
            },
        }))
    }
}

/// The command line of this run, as a shell would take it.
fn command() -> String {
    let plain = |word: &str| {
        !word.is_empty() && word.chars().all(|c| c.is_ascii_alphanumeric() || "-_./:=,+%@".contains(c))
    };
    let words = std::env::args_os().skip(1).map(|word| {
        let word = word.to_string_lossy().into_owned();
        if plain(&word) { word } else { format!("'{}'", word.replace('\'', "'\\''")) }
    });
    std::iter::once("relight".to_owned()).chain(words).collect::<Vec<_>>().join(" ")
}

/// The plots of a sweep; nothing of a bake.
fn plots(report: &Value) -> String {
    let choices = report["choices"].as_array().map(Vec::as_slice).unwrap_or_default();
    if choices.is_empty() {
        return String::new();
    }
    let shown = shown_choice(report);
    let axes = [
        (
            "gpu_bytes_per_pixel",
            "bytes",
            Cost { title: "What bytes buy", label: "bytes of texels a pixel", unit: "bytes a pixel" },
        ),
        (
            "directional_ns",
            "time",
            Cost {
                title: "What relighting time buys",
                label: "ns a pixel, one thread, directional light",
                unit: "ns a pixel",
            },
        ),
        (
            "bake_seconds",
            "bake",
            Cost { title: "What baking time buys", label: "seconds of one bake alone", unit: "s" },
        ),
    ];
    let plots = axes.map(|(key, front, cost)| {
        let points: Vec<Point> = choices
            .iter()
            .filter_map(|choice| {
                Some(Point {
                    name: choice["name"].as_str()?.to_owned(),
                    cost: choice[key].as_f64()?,
                    psnr: choice["psnr"].as_f64()?,
                    front: choice["front"][front] == true,
                    chosen: shown.is_some_and(|shown| shown["name"] == choice["name"]),
                })
            })
            .collect();
        plot(cost, &points)
    });
    plots.concat()
}
