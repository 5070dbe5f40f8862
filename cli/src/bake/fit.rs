//! From options and lights to a solved fit, and what is worth saying about it.

use super::fit_options::FitOptions;
use super::kept::KeptFit;
use super::making::Samples;
use crate::failure::{Exit, Failure};
use crate::interrupt;
use relight_core::basis::Learned;
use relight_core::{Basis, Design, FitFigures, Layout};
use relight_fit::{
    LIGHTS_PER_FUNCTION, LearnedFit, LeastSquares, LeaveOneOut, MOST_OFF, Misfit, NearLamps, NearSolutions,
    PixelFit, RobustFit, Sample, WORST_CONDITION, largest_usable, learned_bytes, near_bytes,
    near_least_squares,
};
use relight_formats::OpenCapture;
use relight_texture::TexelFormat;
use serde_json::{Value, json};

/// What to fit.
#[derive(Clone)]
pub(crate) struct Choice {
    kind: Kind,
    notes: Vec<String>,
}

/// How coefficients are to come about.
#[derive(Clone)]
enum Kind {
    /// Of the functions of a basis.
    Functions(Basis),
    /// Planes that are learned.
    Planes {
        /// How many at most.
        most: usize,
        channels: usize,
        /// What continues the pictures between the lights; `None` for what is learned from the pictures alone.
        basis: Option<Basis>,
    },
}

impl Choice {
    /// These functions and no others.
    pub(super) fn of(basis: Basis) -> Self {
        Self { kind: Kind::Functions(basis), notes: Vec::new() }
    }

    /// No more planes than `budget` bytes of texels in all levels hold.
    ///
    /// # Errors
    /// Exit code 2 where formats are yet to be chosen, 5 where not one layer fits.
    pub(super) fn keep_within(
        &mut self,
        budget: u64,
        formats: &[TexelFormat],
        (width, height): (usize, usize),
        levels: usize,
    ) -> Result<(), Failure> {
        let &[format] = formats else {
            return Err(Failure::usage("--budget-bytes needs one format; --block auto has --bits-per-pixel"));
        };
        let layer = format.levels_bytes(width, height, levels);
        let layers = budget / layer.max(1);
        if layers == 0 {
            let message = format!(
                "--budget-bytes {budget}: one layer of {} of {width} x {height} takes {layer} bytes",
                format.name()
            );
            return Err(Failure::new(Exit::OverBudget, message));
        }
        if let Kind::Planes { most, .. } = &mut self.kind {
            *most = (*most as u64).min(layers * format.channels() as u64) as usize;
        }
        Ok(())
    }

    /// The basis that is stored; learned functions are blank as yet: only their number is known.
    pub(super) fn stored(&self) -> Result<Basis, Failure> {
        match &self.kind {
            Kind::Functions(basis) => Ok(basis.clone()),
            Kind::Planes { most, channels, .. } => Ok(Basis::Learned(Learned::blank(*most, *channels)?)),
        }
    }

    /// Bytes that near lamps take beyond those of fitting.
    pub(super) fn near_bytes(&self, capture: &OpenCapture, threads: usize) -> u64 {
        match &self.kind {
            Kind::Functions(basis) => near_bytes(capture.infos.len(), basis.count(), threads),
            Kind::Planes { .. } => 0,
        }
    }

    /// Bytes that [`solve`] takes for the pictures of `capture`, beyond those of fitting.
    pub(super) fn solving_bytes(&self, capture: &OpenCapture) -> u64 {
        match self.kind {
            Kind::Functions(_) => 0,
            Kind::Planes { most, channels, .. } => {
                let (width, height) = capture.size();
                learned_bytes(capture.infos.len(), channels, width * height, most)
            }
        }
    }
}

/// Planes among which --target-psnr and --budget-bytes choose when -k sets no limit.
const MOST_PLANES: usize = 64;

/// How coefficients come about.
pub(crate) enum Solved<'a> {
    Functions(Box<FunctionFit<'a>>, Layout),
    Planes(Box<LearnedFit>),
    /// Coefficients that an earlier bake computed.
    Kept(Box<KeptFit>),
}

/// Ways to coefficients of functions.
pub(crate) enum FunctionFit<'a> {
    /// One matrix for all pixels.
    Plain(LeastSquares),
    /// Following most lights at each pixel.
    Robust(RobustFit),
    /// Under lamps that each pixel sees from elsewhere.
    Near(LeastSquares, NearSolutions<'a>),
}

impl FunctionFit<'_> {
    /// The fit that it is, or begins with.
    pub(super) fn least_squares(&self) -> &LeastSquares {
        match self {
            Self::Plain(fit) | Self::Near(fit, _) => fit,
            Self::Robust(fit) => fit.least_squares(),
        }
    }

    /// What sets it apart, in words.
    fn words(&self) -> &'static str {
        match self {
            Self::Plain(_) => "",
            Self::Robust(_) => ", robust",
            Self::Near(..) => " under near lamps",
        }
    }
}

/// A solved fit.
pub(crate) struct BakeFit<'a> {
    pub(crate) solved: Solved<'a>,
    /// What the user should know: lowered orders, deficient lights.
    pub(crate) notes: Vec<String>,
    pub(super) misfits: Vec<Misfit>,
}

impl Solved<'_> {
    pub(super) fn pixel_fit(&self) -> PixelFit<'_> {
        match self {
            Self::Functions(fit, layout) => match &**fit {
                FunctionFit::Plain(fit) => (fit, *layout).into(),
                FunctionFit::Robust(fit) => PixelFit::Robust(fit, *layout),
                FunctionFit::Near(fit, solutions) => PixelFit::Near(fit, solutions, *layout),
            },
            Self::Planes(fit) => (&**fit).into(),
            Self::Kept(fit) => (&fit.planes).into(),
        }
    }

    pub(crate) fn basis(&self) -> Basis {
        match self {
            Self::Functions(fit, _) => fit.least_squares().basis.clone(),
            Self::Planes(fit) => Basis::Learned(fit.basis.clone()),
            Self::Kept(fit) => fit.planes.basis.clone(),
        }
    }

    pub(crate) fn figures(&self) -> FitFigures {
        match self {
            Self::Functions(fit, _) => fit.least_squares().figures,
            Self::Planes(fit) => fit.figures,
            Self::Kept(fit) => fit.figures,
        }
    }

    pub(crate) fn leave_one_out(&self) -> &LeaveOneOut {
        match self {
            Self::Functions(fit, _) => &fit.least_squares().leave_one_out,
            Self::Planes(fit) => &fit.leave_one_out,
            Self::Kept(fit) => &fit.leave_one_out,
        }
    }

    /// How much each light counts.
    pub(super) fn weights(&self) -> Vec<f64> {
        match self {
            Self::Functions(fit, _) => fit.least_squares().decomposition.weights.clone(),
            Self::Planes(fit) => vec![1.0; fit.leave_one_out.fit.len()],
            Self::Kept(fit) => fit.weights.clone(),
        }
    }

    /// How it was solved, for reports: an object.
    pub(super) fn solution(&self) -> Value {
        match self {
            Self::Functions(fit, _) => {
                let solved = fit.least_squares();
                let mut solution = json!({
                    "ridge": solved.ridge,
                    "rank": solved.decomposition.rank(),
                    "condition": finite(solved.decomposition.condition()),
                    "singular_values": solved.decomposition.singular_values,
                });
                if let FunctionFit::Near(_, solutions) = &**fit {
                    solution["near"] = json!({ "nodes": solutions.nodes(), "off": solutions.off });
                }
                solution
            }
            Self::Planes(fit) => json!({ "smoothing": fit.smoothing, "energy": fit.energy }),
            Self::Kept(fit) => fit.solution.clone(),
        }
    }

    /// What is fitted, in words.
    pub(crate) fn words(&self) -> String {
        match self {
            Self::Functions(fit, _) => {
                let basis = &fit.least_squares().basis;
                format!("{} with {} functions{}", basis.family().name, basis.count(), fit.words())
            }
            Self::Planes(fit) if fit.smoothing.is_some() => format!("pca with {} planes", fit.basis.planes()),
            Self::Planes(fit) => format!("{} in {} planes", fit.basis.origin(), fit.basis.planes()),
            Self::Kept(fit) => fit.words.clone(),
        }
    }
}

/// The basis that the options name; its default size is lowered to what the lights carry.
pub(super) fn choose_basis(arguments: &FitOptions, capture: &OpenCapture) -> Result<Choice, Failure> {
    let family = arguments.family()?;
    let lights = &capture.capture.lights;
    let srbf = arguments.srbf()?;
    let channels = if capture.is_grey() { 1 } else { 3 };
    if family.learned {
        let most = if arguments.targets.any() { MOST_PLANES } else { family.default_count };
        let most = arguments.asked_count()?.unwrap_or(most);
        return Ok(Choice { kind: Kind::Planes { most, channels, basis: None }, notes: Vec::new() });
    }
    let kind = |basis| match arguments.planes {
        Some(most) => Kind::Planes { most, channels, basis: Some(basis) },
        None => Kind::Functions(basis),
    };
    let build = |count| family.build(&Design { count, lights, srbf });
    if let Some(count) = arguments.asked_count()? {
        return Ok(Choice { kind: kind(build(count)?), notes: Vec::new() });
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
    Ok(Choice { kind: kind(basis), notes })
}

/// Solves the fit and examines it; under near `lamps`, the samples are of pictures without their fall-off.
pub(super) fn solve<'a>(
    arguments: &FitOptions,
    choice: &Choice,
    capture: &OpenCapture,
    layout: Layout,
    samples: &Samples<'_>,
    lamps: Option<&'a NearLamps>,
) -> Result<BakeFit<'a>, Failure> {
    let directions = capture.capture.lights.directions();
    let Choice { kind, mut notes } = choice.clone();
    let least_squares = |basis: Basis, sample: &Sample, notes: &mut Vec<String>| -> Result<_, Failure> {
        let fit = LeastSquares::new(basis, &directions, arguments.weighting(), arguments.ridge, sample)?;
        notes.extend(deficiency(arguments, capture, &fit)?);
        Ok(fit)
    };
    let (solved, misfits) = match kind {
        Kind::Functions(basis) => {
            let sample = samples.pictures()?;
            let misfits = samples.misfits(capture, sample)?;
            let fit = match lamps {
                None => {
                    let fit = least_squares(basis, sample, &mut notes)?;
                    match arguments.is_robust() {
                        true => {
                            notes.push(
                                "errors of the fit and of prediction are those of plain least squares: --robust departs from \
                                 shadows and highlights on purpose"
                                    .to_owned(),
                            );
                            FunctionFit::Robust(RobustFit::new(fit))
                        }
                        false => FunctionFit::Plain(fit),
                    }
                }
                Some(lamps) => {
                    let (weighting, ridge) = (arguments.weighting(), arguments.ridge);
                    let fit = near_least_squares(basis, lamps, weighting, ridge, samples.stack())?;
                    notes.extend(deficiency(arguments, capture, &fit)?);
                    let check = || Ok::<(), Failure>(interrupt::check()?);
                    let solutions = NearSolutions::new(&fit, lamps, check)?;
                    if solutions.off > MOST_OFF {
                        notes.push(format!(
                            "a lamp is so near that {} nodes are too few: between them relit pictures may be off by up to {:.3}",
                            solutions.nodes(),
                            solutions.off
                        ));
                    }
                    FunctionFit::Near(fit, solutions)
                }
            };
            (Solved::Functions(Box::new(fit), layout), misfits)
        }
        Kind::Planes { most, basis, .. } => {
            let sample = samples.channels()?;
            let design = arguments.learned_design(most);
            let fit = match basis {
                None => LearnedFit::new(&directions, design, sample)?,
                Some(basis) => {
                    let fit = least_squares(basis, &sample.of_pictures, &mut notes)?;
                    LearnedFit::factored(&fit, &directions, design, sample)?
                }
            };
            let found = fit.basis.planes();
            if found < most && !arguments.targets.any() {
                notes.push(format!("the pictures have no more than {found} planes of the {most} asked for"));
            }
            (Solved::Planes(Box::new(fit)), samples.misfits(capture, &sample.of_pictures)?)
        }
    };
    Ok(BakeFit { solved, notes, misfits: misfits.to_vec() })
}

impl BakeFit<'_> {
    /// What is odd about pictures of `capture`, which it is a fit of.
    pub(super) fn misfit_notes(&self, capture: &OpenCapture) -> Vec<String> {
        let name = |light: usize| &capture.capture.lights.lights[light].name;
        let words = |misfit: &Misfit| match misfit.better {
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
        };
        self.misfits.iter().map(words).collect()
    }
}

/// JSON has no infinity: `null` stands for it.
pub(super) fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

/// A sentence when the lights leave functions undetermined or nearly so.
fn deficiency(
    arguments: &FitOptions,
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
