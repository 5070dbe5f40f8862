//! Which pictures are fitted, and which judge the fit.

use crate::failure::Failure;
use crate::holdout::Holdout;
use crate::photograph_options::PhotographOptions;
use crate::{evaluate, notes};
use relight_formats::{OpenCapture, open_capture, place_of};
use std::path::Path;

/// A capture's pictures by what they are for.
pub(crate) struct Division {
    /// Indices of those that are fitted, rising.
    pub(crate) kept: Vec<usize>,
    judges: Judging,
}

enum Judging {
    Nobody,
    /// Indices of pictures of the same capture, in the order of its light file.
    Own(Vec<usize>),
    /// Those of another light file, before anything is made of them.
    Other(Box<OpenCapture>),
}

impl Division {
    /// The pictures of `all` as `holdout` divides them.
    ///
    /// # Errors
    /// Exit code 2 where nothing is left to fit or to judge by, and those of reading another light file.
    pub(crate) fn new(all: &OpenCapture, holdout: Option<&Holdout>) -> Result<Self, Failure> {
        let everything = 0..all.infos.len();
        let (kept, judges, count): (Vec<usize>, _, _) = match holdout {
            None => return Ok(Self { kept: everything.collect(), judges: Judging::Nobody }),
            Some(Holdout::File(path)) => {
                let judge = open_capture(path)?;
                notes::print(&judge.capture.notes);
                let whole = (all.infos[0].width, all.infos[0].height);
                evaluate::check_size(whole, &all.capture.light_file, &judge)?;
                let places: Vec<_> =
                    judge.capture.pictures.iter().filter_map(|path| place_of(path)).collect();
                let is_judge = |path: &Path| place_of(path).is_some_and(|place| places.contains(&place));
                let kept = everything.filter(|&i| !is_judge(&all.capture.pictures[i])).collect();
                let count = judge.infos.len();
                (kept, Judging::Other(Box::new(judge)), count)
            }
            Some(rule) => {
                let listed = rule.indices(all.infos.len());
                let (mut out, kept): (Vec<usize>, _) =
                    everything.partition(|&i| listed.contains(&all.listed[i]));
                out.sort_by_key(|&i| all.listed[i]);
                let count = out.len();
                (kept, Judging::Own(out), count)
            }
        };
        if kept.is_empty() || count == 0 {
            let message = format!(
                "--holdout leaves {} of {} pictures to fit and {count} to judge by; both must be at least 1",
                kept.len(),
                all.infos.len(),
            );
            return Err(Failure::usage(message));
        }
        Ok(Self { kept, judges })
    }

    /// The pictures of or beside `all` that judge, as they are in `all`.
    pub(crate) fn judges_of(&self, all: &OpenCapture) -> Option<OpenCapture> {
        match &self.judges {
            Judging::Nobody => None,
            Judging::Own(out) => Some(all.select(out)),
            Judging::Other(judge) => Some((**judge).clone()),
        }
    }
}

/// The pictures to fit, and those to judge the fit by, all as [`PhotographOptions::apply`] made `all`.
pub(crate) fn split(
    all: &OpenCapture,
    division: &Division,
    photographs: &PhotographOptions,
) -> Result<(OpenCapture, Option<OpenCapture>), Failure> {
    let mut judges = division.judges_of(all);
    if let (Some(judges), Judging::Other(_)) = (&mut judges, &division.judges) {
        photographs.apply_to_judges(judges, all)?;
    }
    Ok((all.select(&division.kept), judges))
}
