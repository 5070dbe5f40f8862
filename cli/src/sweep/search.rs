//! The choice that a sweep's front would give for a target, without making all of the grid.

use super::axes::Axes;
use super::bench::{Bench, Opened};
use super::outcome::{Judged, Outcome};
use super::report::{Chosen, chosen};
use super::{Choice, carried};
use crate::bake::{BakeFit, FitOptions, Planned, Stages, textures::TextureOptions};
use crate::failure::{Exit, Failure};
use relight_formats::PictureStack;
use std::path::Path;

/// The options that were found, and a sentence that says why.
pub(crate) struct Found {
    pub(crate) fit: FitOptions,
    pub(crate) textures: TextureOptions,
    pub(crate) why: String,
}

/// A choice with its figures as far as they are known.
struct Candidate<'a> {
    choice: &'a Choice,
    planned: Planned<'a>,
    bytes: u64,
    /// The PSNR before storing, which only lowers it; infinite where pictures that are left out judge.
    bound: f64,
    outcome: Option<Outcome>,
}

/// Finds the choice of the usual grid that reaches the targets of `fit` in the fewest bytes of texels; axes that the
/// options pin stay as they are, and gives the decoded pictures with it. What it measures are files at `scratch`, which has the extension of the output.
///
/// # Errors
/// Exit code 1 with the best that can be reached where no choice reaches them.
pub(crate) fn search(
    opened: &Opened<'_>,
    fit: &FitOptions,
    textures: &TextureOptions,
    scratch: &Path,
    stages: &mut Stages,
) -> Result<(Found, PictureStack), Failure> {
    let axes = Axes::free(fit.asked_basis(), fit.asked_count()?, textures);
    let (points, _) = carried(axes.grid()?, opened.fitted);
    let choices: Vec<Choice> =
        points.into_iter().map(|point| Choice::new(point, fit, textures)).collect::<Result<_, _>>()?;
    // What the output's format does not hold is no choice.
    let mut usable: Vec<(&Choice, Planned<'_>)> = Vec::new();
    let mut refused = None;
    for choice in &choices {
        match opened.planned(choice, scratch) {
            Ok(planned) => usable.push((choice, planned)),
            Err(failure) => refused = Some(failure),
        }
    }
    if let (true, Some(failure)) = (usable.is_empty(), refused) {
        return Err(failure);
    }
    let groups: Vec<Vec<&Planned<'_>>> = usable
        .chunk_by(|a, b| a.0.same_fit(b.0))
        .map(|group| group.iter().map(|(_, planned)| planned).collect())
        .collect();
    let decoded = opened.decode(&groups, stages)?;
    let bench = Bench::new(opened, &decoded, None);

    let mut solved: Vec<(&Choice, BakeFit<'_>)> = Vec::new();
    let mut candidates = Vec::new();
    for (choice, planned) in usable {
        if solved.last().is_none_or(|(other, _)| !other.same_fit(choice)) {
            solved.push((choice, bench.solve(&planned, stages)?));
        }
        let bound = match (opened.left_out, solved.last()) {
            (None, Some((_, fit))) => Judged::predicted(fit, 0.0, opened.fitted),
            _ => Judged { psnr: f64::INFINITY, rmse: 0.0, lights: Vec::new() },
        };
        let bound = fit.targets.quality(bound.psnr, bound.rmse);
        let bytes = planned.texel_bytes();
        candidates.push(Candidate { choice, planned, bytes, bound, outcome: None });
    }
    let measure = |candidate: &mut Candidate<'_>, stages: &mut Stages| -> Result<(), Failure> {
        let fit = solved.iter().find(|(choice, _)| choice.same_fit(candidate.choice));
        let Some((_, fit)) = fit.filter(|_| candidate.outcome.is_none()) else { return Ok(()) };
        let planned = std::slice::from_mut(&mut candidate.planned);
        let outcomes = bench.measure_fit(fit, &[&candidate.choice.point], planned, &|_| Ok(()), stages)?;
        candidate.outcome = outcomes.into_iter().next();
        Ok(())
    };
    candidates.sort_by_key(|candidate| candidate.bytes);
    let targets = &fit.targets;
    let budget = targets.budget_bytes.map_or(u64::MAX, |budget| budget.0);
    let least = targets.least();
    // From few bytes to many until one reaches the target: of those of equal size the best counts.
    let within = candidates.iter().take_while(|candidate| candidate.bytes <= budget).count();
    if let Some(least) = least {
        let mut next = 0;
        while next < within {
            let bytes = candidates[next].bytes;
            let end = next + candidates[next..within].iter().take_while(|c| c.bytes == bytes).count();
            for candidate in candidates[next..end].iter_mut().filter(|candidate| candidate.bound >= least) {
                measure(candidate, stages)?;
            }
            let reached = candidates[next..end].iter().filter_map(|c| c.outcome.as_ref());
            if reached.into_iter().any(|outcome| targets.quality(outcome.psnr, outcome.rmse) >= least) {
                break;
            }
            next = end;
        }
    }
    let reached = |candidate: &Candidate<'_>| {
        candidate
            .outcome
            .as_ref()
            .is_some_and(|o| least.is_some_and(|least| targets.quality(o.psnr, o.rmse) >= least))
    };
    if !candidates.iter().any(reached) {
        // The best that there is: from the highest bound down until no other can be better.
        let most = if within > 0 { within } else { candidates.len() };
        let mut order: Vec<usize> = (0..most).collect();
        order.sort_by(|&a, &b| candidates[b].bound.total_cmp(&candidates[a].bound));
        let mut best = f64::NEG_INFINITY;
        for index in order {
            if candidates[index].bound < best {
                break;
            }
            measure(&mut candidates[index], stages)?;
            if let Some(o) = &candidates[index].outcome {
                best = best.max(targets.quality(o.psnr, o.rmse));
            }
        }
    }
    let (measured, outcomes): (Vec<&Choice>, Vec<Outcome>) =
        candidates.into_iter().filter_map(|candidate| Some((candidate.choice, candidate.outcome?))).unzip();
    match chosen(&outcomes, targets) {
        Chosen::Found { index, why } => {
            let Choice { fit, textures, .. } = measured[index];
            Ok((Found { fit: fit.clone(), textures: textures.clone(), why }, decoded.stack))
        }
        Chosen::NotAsked => Err(Failure::usage("no target is given")),
        Chosen::Missed { why } => Err(Failure::new(Exit::CheckFailed, why)),
    }
}
