//! From options and lights to a solved fit, and what is worth saying about it.

use super::BakeArguments;
use crate::failure::Failure;
use crate::interrupt;
use relight_core::basis::Learned;
use relight_core::{Basis, Design, FitFigures, Layout, Stack};
use relight_fit::{
    ChannelSample, FitError, LIGHTS_PER_FUNCTION, LearnedDesign, LearnedFit, LeastSquares, LeaveOneOut,
    Misfit, PixelFit, Sample, WORST_CONDITION, largest_usable, misfits,
};
use relight_formats::OpenCapture;

/// The basis to fit.
pub(super) struct Choice {
    /// Learned functions are blank as yet: only their number is known.
    pub(super) basis: Basis,
    notes: Vec<String>,
}

/// How coefficients come about.
pub(super) enum Solved {
    Functions(LeastSquares, Layout),
    Planes(LearnedFit),
}

/// A solved fit.
pub(super) struct BakeFit {
    pub(super) solved: Solved,
    /// What the user should know: lowered orders, deficient lights, pictures that don't fit.
    pub(super) notes: Vec<String>,
    pub(super) misfits: Vec<Misfit>,
}

impl Solved {
    pub(super) fn pixel_fit(&self) -> PixelFit<'_> {
        match self {
            Self::Functions(fit, layout) => (fit, *layout).into(),
            Self::Planes(fit) => fit.into(),
        }
    }

    pub(super) fn basis(&self) -> Basis {
        match self {
            Self::Functions(fit, _) => fit.basis.clone(),
            Self::Planes(fit) => Basis::Learned(fit.basis.clone()),
        }
    }

    pub(super) fn figures(&self) -> FitFigures {
        match self {
            Self::Functions(fit, _) => fit.figures,
            Self::Planes(fit) => fit.figures,
        }
    }

    pub(super) fn leave_one_out(&self) -> &LeaveOneOut {
        match self {
            Self::Functions(fit, _) => &fit.leave_one_out,
            Self::Planes(fit) => &fit.leave_one_out,
        }
    }

    /// What is fitted, in words.
    pub(super) fn words(&self) -> String {
        match self {
            Self::Functions(fit, _) => {
                format!("{} with {} functions", fit.basis.family().name, fit.basis.count())
            }
            Self::Planes(fit) => format!("{} with {} planes", fit.basis.origin(), fit.basis.planes()),
        }
    }
}

/// The basis that the options name; its default size is lowered to what the lights carry.
pub(super) fn choose_basis(arguments: &BakeArguments, capture: &OpenCapture) -> Result<Choice, Failure> {
    let family = arguments.family()?;
    let lights = &capture.capture.lights;
    let srbf = arguments.srbf()?;
    if family.learned {
        let channels = if capture.is_grey() { 1 } else { 3 };
        let planes = arguments.asked_count()?.unwrap_or(family.default_count);
        let basis = Basis::Learned(Learned::blank(planes, channels)?);
        return Ok(Choice { basis, notes: Vec::new() });
    }
    let build = |count| family.build(&Design { count, lights, srbf });
    if let Some(count) = arguments.asked_count()? {
        return Ok(Choice { basis: build(count)?, notes: Vec::new() });
    }
    let smallest = family.counts_up_to(family.default_count).first().copied().unwrap_or(family.default_count);
    let usable = largest_usable(family, lights, srbf, family.default_count)?;
    let basis = match usable {
        Some(usable) => usable.basis,
        None => build(smallest)?,
    };
    let mut notes = Vec::new();
    if basis.count() < family.default_count {
        notes.push(format!(
            "{} lights do not carry the usual {} functions of {}; {} are fitted (-k sets another number)",
            lights.len(),
            family.default_count,
            family.name,
            basis.count()
        ));
    }
    Ok(Choice { basis, notes })
}

/// Solves the fit and examines it.
pub(super) fn solve(
    arguments: &BakeArguments,
    choice: Choice,
    capture: &OpenCapture,
    layout: Layout,
    stack: &dyn Stack,
) -> Result<BakeFit, Failure> {
    let directions = capture.capture.lights.directions();
    let Choice { basis, mut notes } = choice;
    let (solved, misfits) = match basis {
        Basis::Learned(blank) => {
            let sample = ChannelSample::of(stack).map_err(FitError::from)?;
            interrupt::check()?;
            let design = LearnedDesign { planes: blank.planes(), opponent: arguments.opponent() };
            let fit = LearnedFit::new(&directions, design, &sample)?;
            let (found, asked) = (fit.basis.planes(), blank.planes());
            if found < asked {
                notes.push(format!(
                    "{} pictures of {} channels have no more than {found} planes of the {asked} asked for",
                    directions.len(),
                    sample.channels
                ));
            }
            (Solved::Planes(fit), misfits(&capture.capture.lights, &sample.of_pictures)?)
        }
        basis => {
            let sample = Sample::of(stack).map_err(FitError::from)?;
            interrupt::check()?;
            let fit = LeastSquares::new(basis, &directions, arguments.weighting(), arguments.ridge, &sample)?;
            notes.extend(deficiency(arguments, capture, &fit)?);
            (Solved::Functions(fit, layout), misfits(&capture.capture.lights, &sample)?)
        }
    };
    let name = |light: usize| &capture.capture.lights.lights[light].name;
    notes.extend(misfits.iter().map(|misfit| match misfit.better {
        Some(other) => format!(
            "picture {} fits the light of {} better than its own: check whether its name is swapped",
            name(misfit.light),
            name(other)
        ),
        None => format!(
            "picture {} is {:.1} times harder to predict than those around it: check its light",
            name(misfit.light),
            misfit.rmse / misfit.expected
        ),
    }));
    Ok(BakeFit { solved, notes, misfits })
}

/// A sentence when the lights leave functions undetermined or nearly so.
fn deficiency(
    arguments: &BakeArguments,
    capture: &OpenCapture,
    fit: &LeastSquares,
) -> Result<Option<String>, Failure> {
    let lights = &capture.capture.lights;
    let decomposition = &fit.decomposition;
    let (rank, functions) = (decomposition.rank(), decomposition.functions);
    let problem = if rank < functions {
        format!(
            "{} lights determine {rank} of the {functions} functions; the least-norm solution is taken",
            lights.len()
        )
    } else if (lights.len() as f64) < LIGHTS_PER_FUNCTION * functions as f64 {
        format!("{} lights for {functions} functions leave little to tell noise from shape", lights.len())
    } else if decomposition.condition() > WORST_CONDITION {
        format!(
            "the lights determine the {functions} functions poorly (condition {:.1e})",
            decomposition.condition()
        )
    } else {
        return Ok(None);
    };
    let family = fit.basis.family();
    let advice = match largest_usable(family, lights, arguments.srbf()?, functions)? {
        Some(usable) => {
            format!("the largest {} that these lights carry is -k {}", family.name, usable.basis.count())
        }
        None => format!("these lights carry no {} at all", family.name),
    };
    Ok(Some(format!("{problem}; {advice}")))
}
