//! `relight explain`: by what two bakes differ.

use crate::bake::{Job, Stages, fit_key_of, key_of};
use crate::failure::{Exit, Failure};
use crate::job::{bake_arguments, expand};
use crate::say::{self, say};
use clap::Args;
use relight_core::{PictureRecord, Provenance};
use relight_formats::{Cache, hexadecimal, summarize_asset};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What to compare.
#[derive(Args, Debug)]
pub(crate) struct ExplainArguments {
    /// An asset (.ktx2, .dds, .exr), a report, a plan, a .toml job, what relight key --json printed, or with --cache a key
    #[arg(value_name = "A")]
    old: PathBuf,
    /// The same
    #[arg(value_name = "B")]
    new: PathBuf,
    /// Where keys are looked up
    #[arg(long, value_name = "FOLDER")]
    cache: Option<PathBuf>,
    /// Print the differences as an array
    #[arg(long)]
    json: bool,
    /// End with code 1 where they differ
    #[arg(long)]
    exit_code: bool,
}

/// A component that differs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Difference {
    /// What it is of: `tool`, `fit`, `storing`, `picture`, `light`, `judge`.
    component: &'static str,
    /// Which.
    name: String,
    old: String,
    new: String,
}

impl Difference {
    /// Whether it is one of how coefficients are stored.
    pub(crate) fn is_of_storing(&self) -> bool {
        self.component == "storing"
    }

    /// For people.
    pub(crate) fn words(&self) -> String {
        let Self { component, name, old, new } = self;
        format!("{component} {name}: {old} -> {new}")
    }
}

/// Runs the subcommand.
pub(crate) fn run(arguments: &ExplainArguments) -> Result<(), Failure> {
    let (old, new) = (arguments.provenance(&arguments.old)?, arguments.provenance(&arguments.new)?);
    let differences = differences(&old, &new);
    if arguments.json {
        let record = |difference: &Difference| {
            let Difference { component, name, old, new } = difference;
            json!({ "component": component, "name": name, "old": old, "new": new })
        };
        say::json(&json!(differences.iter().map(record).collect::<Vec<_>>()));
    } else if differences.is_empty() {
        say!("both are of the key {}", hexadecimal(&key_of(&new)));
    } else {
        differences.iter().for_each(|difference| say!("{}", difference.words()));
        say!(
            "{}",
            match fit_key_of(&old) == fit_key_of(&new) {
                true => "the fit is the same: a cache has its coefficients",
                false => "the fit is another one",
            }
        );
    }
    match arguments.exit_code && !differences.is_empty() {
        true => {
            Err(Failure::new(Exit::CheckFailed, format!("components that differ: {}", differences.len())))
        }
        false => Ok(()),
    }
}

impl ExplainArguments {
    fn provenance(&self, of: &Path) -> Result<Provenance, Failure> {
        let refused = |problem: String| Failure::new(Exit::BadInput, format!("{}: {problem}", of.display()));
        if let (Some(text), false) = (of.to_str(), of.exists()) {
            let key = key_from(text).ok_or_else(|| {
                let problem = "there is no such file, and it is no key of 64 hexadecimal digits";
                Failure::new(Exit::InputOutput, format!("{text}: {problem}"))
            })?;
            let Some(folder) = &self.cache else {
                return Err(Failure::usage(format!(
                    "{text}: keys are looked up in --cache FOLDER; give that too"
                )));
            };
            let made = Cache::open(folder, u64::MAX)?.made(&key);
            return made
                .and_then(|made| serde_json::from_str(&made.provenance).ok())
                .ok_or_else(|| refused(format!("{} knows nothing of this key", folder.display())));
        }
        let extension = of.extension().unwrap_or_default().to_ascii_lowercase();
        if extension == "toml" {
            return provenance_of_job(of);
        }
        if extension == "json" {
            let text = relight_formats::read_text(of)?;
            let report: Value =
                serde_json::from_str(&text).map_err(|error| refused(format!("is no JSON: {error}")))?;
            if let Some(provenance) = report.get("provenance") {
                return serde_json::from_value(provenance.clone())
                    .map_err(|error| refused(format!("its provenance is damaged: {error}")));
            }
        }
        let provenance = summarize_asset(of)?.header.model.provenance;
        provenance.map(|provenance| *provenance).ok_or_else(|| {
            refused(
                "does not say what it was made of (.ktx2, .dds and .exr that bake wrote do); give its report or its job"
                    .to_owned(),
            )
        })
    }
}

fn provenance_of_job(job: &Path) -> Result<Provenance, Failure> {
    let words = ["relight", "bake"].into_iter().map(Into::into).chain([job.as_os_str().to_owned()]);
    let call = expand(words.collect())?.remove(0);
    let arguments = bake_arguments(call.arguments?.into_iter().skip(2))?;
    Ok(Job::open_for_others(&arguments, &mut Stages::default())?.provenance)
}

/// The bytes of 64 hexadecimal digits.
pub(crate) fn key_from(text: &str) -> Option<[u8; 32]> {
    let digits = text.is_ascii().then_some(text)?;
    let mut key = [0; 32];
    for (i, byte) in key.iter_mut().enumerate() {
        *byte = u8::from_str_radix(digits.get(2 * i..2 * i + 2)?, 16).ok()?;
    }
    (digits.len() == 64).then_some(key)
}

/// By what `new` differs from `old`.
pub(crate) fn differences(old: &Provenance, new: &Provenance) -> Vec<Difference> {
    let mut found = Vec::new();
    if old.abi != new.abi {
        let (old, new) = (old.abi.to_string(), new.abi.to_string());
        found.push(Difference { component: "tool", name: "ABI number".to_owned(), old, new });
    }
    compare_settings("fit", &old.fit, &new.fit, &mut found);
    compare_settings("storing", &old.storing, &new.storing, &mut found);
    compare_pictures("picture", &old.pictures, &new.pictures, &mut found);
    compare_pictures("judge", &old.judges, &new.judges, &mut found);
    found
}

fn compare_settings(
    component: &'static str,
    old: &BTreeMap<String, String>,
    new: &BTreeMap<String, String>,
    found: &mut Vec<Difference>,
) {
    let mut names: Vec<&String> = old.keys().chain(new.keys()).collect();
    names.sort();
    names.dedup();
    let value = |settings: &BTreeMap<String, String>, name: &String| {
        settings.get(name).cloned().unwrap_or("none".to_owned())
    };
    let pairs = names.into_iter().map(|name| (name, value(old, name), value(new, name)));
    found.extend(pairs.filter(|(_, old, new)| old != new).map(|(name, old, new)| Difference {
        component,
        name: name.clone(),
        old,
        new,
    }));
}

/// Pictures are told by their contents first, then by their lights.
fn compare_pictures(
    component: &'static str,
    old: &[PictureRecord],
    new: &[PictureRecord],
    found: &mut Vec<Difference>,
) {
    let mut gone: Vec<&PictureRecord> = old.iter().collect();
    let mut come: Vec<&PictureRecord> = new.iter().collect();
    pair(&mut gone, &mut come, |a, b| a == b);
    for (old, new) in pair(&mut gone, &mut come, |a, b| a.content == b.content) {
        let name = format!("of {component} {}", old.content);
        if old.light != new.light {
            let (old, new) = (vector(old.light), vector(new.light));
            found.push(Difference { component: "light", name: name.clone(), old, new });
        }
        for (what, old, new) in [("intensity", old.intensity, new.intensity), ("lamp", old.lamp, new.lamp)] {
            if old != new {
                let word = |value: Option<[f64; 3]>| value.map_or("none".to_owned(), vector);
                found.push(Difference {
                    component: what,
                    name: name.clone(),
                    old: word(old),
                    new: word(new),
                });
            }
        }
    }
    for (old, new) in pair(&mut gone, &mut come, |a, b| a.light == b.light) {
        let name = format!("under the light {}", vector(old.light));
        found.push(Difference { component, name, old: old.content.clone(), new: new.content.clone() });
    }
    let name = |record: &PictureRecord| format!("under the light {}", vector(record.light));
    let none = || "none".to_owned();
    found.extend(gone.into_iter().map(|record| Difference {
        component,
        name: name(record),
        old: record.content.clone(),
        new: none(),
    }));
    found.extend(come.into_iter().map(|record| Difference {
        component,
        name: name(record),
        old: none(),
        new: record.content.clone(),
    }));
}

/// Takes out the pairs that are alike.
fn pair<'a>(
    gone: &mut Vec<&'a PictureRecord>,
    come: &mut Vec<&'a PictureRecord>,
    alike: impl Fn(&PictureRecord, &PictureRecord) -> bool,
) -> Vec<(&'a PictureRecord, &'a PictureRecord)> {
    let mut pairs = Vec::new();
    gone.retain(|old| match come.iter().position(|new| alike(old, new)) {
        Some(at) => {
            pairs.push((*old, come.remove(at)));
            false
        }
        None => true,
    });
    pairs
}

fn vector([x, y, z]: [f64; 3]) -> String {
    format!("({x:.4}, {y:.4}, {z:.4})")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(content: &str, light: [f64; 3]) -> PictureRecord {
        PictureRecord { content: content.to_owned(), light, intensity: None, lamp: None }
    }

    fn told(old: &Provenance, new: &Provenance) -> Vec<String> {
        differences(old, new).iter().map(Difference::words).collect()
    }

    #[test]
    fn each_component_is_named_with_its_values() {
        let base = Provenance {
            abi: 1,
            pictures: vec![record("aa", [1.0, 0.0, 0.0]), record("bb", [0.0, 1.0, 0.0])],
            ..Provenance::default()
        };
        assert!(told(&base, &base).is_empty());
        assert_eq!(told(&base, &Provenance { abi: 2, ..base.clone() }), ["tool ABI number: 1 -> 2"]);
        let mut other = base.clone();
        other.fit.insert("basis".to_owned(), "sh".to_owned());
        assert_eq!(told(&base, &other), ["fit basis: none -> sh"]);
        let mut other = base.clone();
        other.pictures[1].content = "cc".to_owned();
        assert_eq!(told(&base, &other), ["picture under the light (0.0000, 1.0000, 0.0000): bb -> cc"]);
        let mut other = base.clone();
        other.pictures[0].light = [0.0, 0.0, 1.0];
        let expected = "light of picture aa: (1.0000, 0.0000, 0.0000) -> (0.0000, 0.0000, 1.0000)";
        assert_eq!(told(&base, &other), [expected]);
        let mut other = base.clone();
        other.pictures.remove(0);
        assert_eq!(told(&base, &other), ["picture under the light (1.0000, 0.0000, 0.0000): aa -> none"]);
        // Two lights change places: contents stay.
        let mut other = base.clone();
        other.pictures[0].light = base.pictures[1].light;
        other.pictures[1].light = base.pictures[0].light;
        assert_eq!(told(&base, &other).len(), 2);
    }

    #[test]
    fn keys_are_64_digits() {
        assert_eq!(key_from(&"0a".repeat(32)), Some([10; 32]));
        for text in ["", "0a", &"0a".repeat(33), &"0g".repeat(32), &"é".repeat(32)] {
            assert_eq!(key_from(text), None, "{text}");
        }
    }
}
