//! What an asset's coefficients are computed from: those that an earlier bake or shards kept, or pictures, decoded and fitted.

use super::Stages;
use super::fit::BakeFit;
use super::job::{Ready, job_pictures};
use super::kept::{CacheUse, Facts, KeepError, Keeper};
use super::keys::fit_key_of;
use super::making::{Planned, Samples};
use crate::failure::{Exit, Failure};
use relight_core::{Basis, Stack};
use relight_fit::LevelledStack;
use relight_formats::{Cache, FitFolder, PictureStack, ScratchFolder};
use std::path::Path;

/// What becomes of coefficients on their way.
pub(crate) enum Keeping {
    /// They are kept in a cache and taken from it, where there is one.
    In(Option<Cache>),
    /// They are those of all shards.
    Merged(FitFolder),
}

impl Keeping {
    /// What has the coefficients of `ready`, or gets them.
    pub(super) fn keeper(&self, ready: &Ready<'_>) -> Option<Keeper> {
        let folder = match self {
            Self::In(cache) => cache.as_ref()?.fit(fit_key_of(&ready.job.provenance)),
            Self::Merged(folder) => folder.clone(),
        };
        Some(Keeper::new(folder, ready.fitted.size()))
    }

    /// Whether coefficients of so many bytes may be kept.
    fn has_room_for(&self, bytes: u64) -> bool {
        match self {
            Self::In(cache) => cache.as_ref().is_some_and(|cache| cache.has_room_for(bytes)),
            Self::Merged(_) => true,
        }
    }
}

/// A fit and what its coefficients are computed from.
pub(crate) struct Source<'l> {
    pub(crate) fit: BakeFit<'l>,
    pub(crate) stack: Box<dyn Stack + 'l>,
    /// Bytes of pictures that memory had no room for.
    pub(crate) spilled: u64,
    /// Where coefficients lie that nobody keeps; it is gone with this.
    _scratch: Option<ScratchFolder>,
}

impl<'l> Source<'l> {
    /// Plans an asset by `plan`, which is told functions that are known, and finds what it is made of: what `keeper` has of it, or
    /// pictures (those that are `decoded` or else `ready`'s), whose coefficients `keeper` gets. It is none where it can't take them.
    ///
    /// `surface_bytes` are those of positions that are held meanwhile.
    ///
    /// # Errors
    /// What is wrong with options and pictures; [`Exit::BadInput`] where shards' coefficients are not whole.
    pub(super) fn find<'a>(
        ready: &'l Ready<'_>,
        plan: &dyn Fn(Option<Basis>) -> Result<Planned<'a>, Failure>,
        (keeping, keeper): (&Keeping, &mut Option<Keeper>),
        (decoded, surface_bytes): (Option<PictureStack>, u64),
        notes: &mut Vec<String>,
        stages: &mut Stages,
    ) -> Result<(Planned<'a>, Self), Failure> {
        let facts = keeper.as_mut().and_then(Keeper::facts);
        let basis = facts.as_ref().and_then(Facts::basis);
        let is_known = basis.is_some();
        let mut planned = plan(basis)?;
        if keeper.is_some() && !keeping.has_room_for(planned.float_bytes()) {
            *keeper = None;
            notes.push("the coefficients are more than --cache-size allows and are not kept".to_owned());
        }
        if is_known {
            if let (Some(keeper), Some(facts)) = (keeper.as_mut(), facts)
                && let Some(kept) = stages.time("cache", || Self::kept(keeper, facts, &planned))
            {
                return Ok((planned, kept));
            }
            planned = plan(None)?;
        }
        let output = &ready.job.arguments.output;
        if matches!(keeping, Keeping::Merged(_)) {
            let message = format!("{}: what the shards computed is not whole", output.display());
            return Err(Failure::new(Exit::BadInput, message));
        }
        let source = Self::of_pictures(ready, &planned, decoded, (surface_bytes, output), stages)?;
        let source = match keeper.as_mut() {
            Some(keeper) => source.keep_in(keeper, ready, &planned, notes, stages)?,
            None => source.keep_beside(ready, &planned, stages)?,
        };
        Ok((planned, source))
    }

    fn kept(keeper: &mut Keeper, facts: Facts, planned: &Planned<'_>) -> Option<Self> {
        let (fit, tiles) = keeper.take_up(facts, &planned.model)?;
        Some(Self { fit, stack: Box::new(tiles), spilled: 0, _scratch: None })
    }

    /// Pictures, decoded unless they are already, and the fit to them. What memory has no room for goes beside `output`.
    ///
    /// # Errors
    /// What is wrong with them.
    pub(crate) fn of_pictures(
        ready: &'l Ready<'_>,
        planned: &Planned<'_>,
        decoded: Option<PictureStack>,
        (surface_bytes, output): (u64, &Path),
        stages: &mut Stages,
    ) -> Result<Self, Failure> {
        let Ready { job, fitted, lamps, space, .. } = ready;
        let lamps = lamps.as_ref();
        let pictures = match decoded {
            Some(pictures) => pictures,
            None => job_pictures(planned, fitted, lamps, (surface_bytes, output), &job.machine, stages)?,
        };
        job.stamps.check()?;
        let spilled = pictures.spilled_bytes();
        let stack: Box<dyn Stack + 'l> = match lamps {
            Some(lamps) => {
                let level = job.machine.level;
                Box::new(LevelledStack { stack: pictures, lamps, space: *space, level })
            }
            None => Box::new(pictures),
        };
        let fit = stages.time("solve", || planned.solve(fitted, &Samples::new(&*stack), lamps))?;
        Ok(Self { fit, stack, spilled, _scratch: None })
    }

    /// Computes all coefficients and gives them to `keeper`, to go on from what it has; a note instead where it can't take them.
    fn keep_in(
        self,
        keeper: &mut Keeper,
        ready: &Ready<'_>,
        planned: &Planned<'_>,
        notes: &mut Vec<String>,
        stages: &mut Stages,
    ) -> Result<Self, Failure> {
        let model = planned.model_of(&self.fit);
        let wanted: Vec<usize> = (0..keeper.grid.count()).collect();
        let level = ready.job.machine.level;
        match stages.time("fit", || keeper.fill(&self.fit, &model, &*self.stack, level, &wanted)) {
            Ok(tiles) => Ok(match keeper.reopen(&self.fit, &model, tiles) {
                Some((fit, tiles)) => Self { fit, stack: Box::new(tiles), ..self },
                None => self,
            }),
            Err(KeepError::Folder(error)) => {
                notes.push(format!("the cache is not used: {}", Failure::from(error).words()));
                keeper.counts = CacheUse::default();
                Ok(self)
            }
            Err(KeepError::Work(failure)) => Err(failure),
        }
    }

    /// Computes all coefficients for a folder beside the output where every pixel's fit takes long and would be done twice; where
    /// there is no room it is.
    fn keep_beside(
        self,
        ready: &Ready<'_>,
        planned: &Planned<'_>,
        stages: &mut Stages,
    ) -> Result<Self, Failure> {
        if !planned.fits_slowly_and_twice() {
            return Ok(self);
        }
        let Ok(folder) = ScratchFolder::beside(&planned.output) else { return Ok(self) };
        let fit_folder = FitFolder::new(folder.path().to_owned(), fit_key_of(&ready.job.provenance));
        let mut keeper = Keeper::new(fit_folder, ready.fitted.size());
        let kept = self.keep_in(&mut keeper, ready, planned, &mut Vec::new(), stages)?;
        Ok(Self { _scratch: Some(folder), ..kept })
    }
}
