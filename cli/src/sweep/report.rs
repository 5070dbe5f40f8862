//! What a sweep found: the fronts, the choice that the targets take, report.json and a table.

use super::front::{best_within, cheapest, front};
use super::outcome::Outcome;
use crate::bake::{Stages, TargetOptions};
use crate::failure::{Exit, Failure};
use crate::say::say;
use serde_json::{Value, json};
use std::path::Path;

/// Which choices no other one beats, by what they cost: bytes of texels, nanoseconds of relighting a pixel, and seconds
/// of baking.
pub(crate) struct Fronts {
    pub(crate) bytes: Vec<bool>,
    pub(crate) time: Vec<bool>,
    pub(crate) bake: Vec<bool>,
}

impl Fronts {
    pub(crate) fn of(outcomes: &[Outcome]) -> Self {
        let by = |cost: &dyn Fn(&Outcome) -> f64| {
            front(&outcomes.iter().map(|outcome| (cost(outcome), outcome.psnr)).collect::<Vec<_>>())
        };
        Self {
            bytes: by(&|outcome| outcome.texel_bytes as f64),
            time: by(&|outcome| outcome.times.directional_ns),
            bake: by(&|outcome| outcome.times.bake_seconds()),
        }
    }

    /// Whether a choice is on the front of bytes or of relighting time.
    pub(crate) fn has(&self, index: usize) -> bool {
        self.bytes[index] || self.time[index]
    }
}

/// The choice that the targets take, and why, or that none reaches them.
pub(crate) enum Chosen {
    /// There are no targets.
    NotAsked,
    Found {
        index: usize,
        why: String,
    },
    Missed {
        why: String,
    },
}

/// Decides by bytes of texels.
pub(crate) fn chosen(outcomes: &[Outcome], targets: &TargetOptions) -> Chosen {
    if !targets.any() {
        return Chosen::NotAsked;
    }
    let budget = targets.budget_bytes.map_or(f64::INFINITY, |budget| budget.0 as f64);
    let points: Vec<(f64, f64)> =
        outcomes.iter().map(|o| (o.texel_bytes as f64, targets.quality(o.psnr, o.rmse))).collect();
    let least = targets.least();
    let found = match least {
        Some(least) => cheapest(&points, least).filter(|&index| points[index].0 <= budget),
        None => best_within(&points, budget),
    };
    let of = |index: usize| {
        let outcome = &outcomes[index];
        format!(
            "{} reaches {:.2} dB (RMSE {:.4}) in {} bytes of texels",
            outcome.name, outcome.psnr, outcome.rmse, outcome.texel_bytes
        )
    };
    match found {
        Some(index) => {
            let why = if least.is_some() { "the fewest bytes that reach" } else { "the best within" };
            Chosen::Found { index, why: format!("{}: {why} the target", of(index)) }
        }
        None => {
            let smallest = (0..points.len()).min_by(|a, b| points[*a].0.total_cmp(&points[*b].0));
            let best = match (best_within(&points, budget), smallest) {
                (Some(best), _) => format!("the best, {}", of(best)),
                (None, Some(smallest)) => format!("the smallest, {}", of(smallest)),
                (None, None) => "there is no choice at all".to_owned(),
            };
            Chosen::Missed { why: format!("no choice reaches {}; {best}", targets.words()) }
        }
    }
}

/// Everything that a sweep tells.
pub(crate) struct Summary<'a> {
    pub(crate) input: &'a Path,
    pub(crate) size: (usize, usize),
    pub(crate) pictures: usize,
    /// Pictures left out to judge by.
    pub(crate) judged: Option<usize>,
    pub(crate) outcomes: &'a [Outcome],
    pub(crate) fronts: &'a Fronts,
    pub(crate) chosen: Chosen,
    pub(crate) stages: &'a Stages,
    /// Choices that this run measured; the others are of an earlier one.
    pub(crate) measured: usize,
    pub(crate) skipped: &'a [String],
}

impl Summary<'_> {
    /// Seconds of this run, and of baking each choice alone.
    fn seconds(&self) -> (f64, f64) {
        let alone = self.outcomes.iter().map(|outcome| outcome.times.bake_seconds()).sum();
        (self.stages.0.iter().map(|(_, seconds)| seconds).sum(), alone)
    }

    /// The report as JSON; docs/schema/sweep.schema.json says what it has.
    pub(crate) fn json(&self) -> Value {
        let pixels = (self.size.0 * self.size.1) as f64;
        let choice = |(index, outcome): (usize, &Outcome)| {
            let mut choice = serde_json::to_value(outcome).unwrap_or_default();
            choice["gpu_bytes_per_pixel"] = json!(outcome.texel_bytes as f64 / pixels);
            choice["disk_bytes_per_pixel"] = json!(outcome.file_bytes as f64 / pixels);
            choice["bake_seconds"] = json!(outcome.times.bake_seconds());
            choice["front"] = json!({
                "bytes": self.fronts.bytes[index],
                "time": self.fronts.time[index],
                "bake": self.fronts.bake[index],
            });
            choice
        };
        let (own, alone) = self.seconds();
        let (chosen, why) = match &self.chosen {
            Chosen::NotAsked => (None, None),
            Chosen::Found { index, why } => (Some(&self.outcomes[*index].name), Some(why)),
            Chosen::Missed { why } => (None, Some(why)),
        };
        let stages: Vec<Value> = self
            .stages
            .summed()
            .into_iter()
            .map(|(name, seconds)| json!({ "stage": name, "seconds": seconds }))
            .collect();
        json!({
            "relight": env!("CARGO_PKG_VERSION"),
            "kind": "sweep",
            "input": self.input.to_string_lossy(),
            "width": self.size.0,
            "height": self.size.1,
            "pictures": self.pictures,
            "judged_by": match self.judged { Some(_) => "left-out pictures", None => "leave-one-out" },
            "judges": self.judged,
            "choices": self.outcomes.iter().enumerate().map(choice).collect::<Vec<_>>(),
            "chosen": chosen,
            "why": why,
            "notes": self.skipped,
            "measured": self.measured,
            "seconds": own,
            "seconds_alone": alone,
            "stages": stages,
        })
    }

    /// Prints a table, or only where the report is where lines of JSON went before.
    pub(crate) fn print(&self, folder: &Path, json: bool) {
        if json {
            return;
        }
        say!("front  choice              dB     RMSE  bytes/px  on disk  bake s  ns/px  point ns  GPU ns");
        let pixels = (self.size.0 * self.size.1) as f64;
        for (index, o) in self.outcomes.iter().enumerate() {
            let mark = |is: &[bool], mark: char| if is[index] { mark } else { '-' };
            say!(
                "{}{}{}    {:<16} {:6.2}  {:.4}  {:8.2} {:8.2}  {:6.2} {:6.1}  {:8.1}  {:>6}",
                mark(&self.fronts.bytes, 'b'),
                mark(&self.fronts.time, 't'),
                mark(&self.fronts.bake, 's'),
                o.name,
                o.psnr,
                o.rmse,
                o.texel_bytes as f64 / pixels,
                o.file_bytes as f64 / pixels,
                o.times.bake_seconds(),
                o.times.directional_ns,
                o.times.point_ns,
                o.times.gpu.as_ref().map_or("-".to_owned(), |gpu| format!("{:.1}", gpu.ns)),
            );
        }
        say!("fronts: b fewest bytes of texels, t least time to relight a pixel, s fewest seconds to bake");
        let (own, alone) = self.seconds();
        let judged = match self.judged {
            Some(pictures) => format!("{pictures} pictures left out"),
            None => "predicting each light from the others, and storing".to_owned(),
        };
        say!("judged by {judged}; {own:.1} s for {} choices, {alone:.1} s one by one", self.measured);
        if let Chosen::Found { why, .. } = &self.chosen {
            say!("{why}");
        }
        say!("{}", folder.join("report.json").display());
    }

    /// Fails where no choice reaches the targets.
    pub(crate) fn check(&self) -> Result<(), Failure> {
        match &self.chosen {
            Chosen::Missed { why } => Err(Failure::new(Exit::CheckFailed, why.clone())),
            Chosen::NotAsked | Chosen::Found { .. } => Ok(()),
        }
    }
}
