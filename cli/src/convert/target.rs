//! What an asset becomes: the functions, layout and space that are asked for, or those nearest to its own that
//! the output holds; and the way there.

use super::ConvertArguments;
use crate::bake::Color;
use crate::failure::Failure;
use crate::function_options::family_of_name;
use crate::interrupt;
use crate::options::Machine;
use relight_core::basis::{FAMILIES, Learned};
use relight_core::sphere::{Cap, fibonacci_in};
use relight_core::{Basis, Design, LightSet};
use relight_core::{Family, Layout, Model, RelightingMaps, Space, Stack};
use relight_fit::{
    ChannelSample, FitError, LearnedDesign, LearnedFit, LeastSquares, LightWeights, PixelFit, PlaneStack,
    Refit, RelitStack, Ridge, Sample,
};
use relight_formats::FormatError;

/// Lights under which pictures are made for functions to be fitted to: 9 degrees apart on half the sphere.
const PICTURES: usize = 256;

/// The same for planes to be learned from, whose moments grow with the square of the pictures.
const PICTURES_TO_LEARN_FROM: usize = 128;

/// What an asset becomes.
pub(super) struct Target {
    /// The functions that are fitted; `None` where planes are learned from pictures alone.
    basis: Option<Basis>,
    /// Planes at most, where they are learned.
    planes: Option<usize>,
    pub(super) layout: Layout,
    space: Space,
}

impl Target {
    /// The model as it will be stored; learned functions are blank as yet.
    pub(super) fn model(&self, from: &Model) -> Result<Model, Failure> {
        let basis = match (&self.basis, self.planes) {
            (Some(basis), None) => basis.clone(),
            (_, planes) => Basis::Learned(Learned::blank(planes.unwrap_or(1), from.channels())?),
        };
        let kept = basis == from.basis && self.space == from.space;
        Ok(Model {
            basis,
            layout: self.layout,
            space: self.space,
            lights: from.lights.clone(),
            figures: from.figures.filter(|_| kept),
        })
    }
}

/// The first of what `arguments` leave open, nearest to `from` first, that `check` lets pass.
///
/// # Errors
/// Exit code 2 for options that can't be met; what `check` says of the first where none passes.
pub(super) fn choose(
    arguments: &ConvertArguments,
    from: &Model,
    check: impl Fn(&Model) -> Result<(), FormatError>,
) -> Result<Target, Failure> {
    let learned = |layout: Layout| layout == Layout::Shared;
    let mut refused = None;
    for (basis, planes) in bases(arguments, from)? {
        let shared = planes.is_some() || basis == Some(from.basis.clone()) && learned(from.layout);
        for space in [from.space, other(from.space)] {
            for layout in layouts(arguments.color, from, shared)? {
                let target = Target { basis: basis.clone(), planes, layout, space };
                match check(&target.model(from)?) {
                    Ok(()) => return Ok(target),
                    Err(error) => refused = refused.or(Some(error)),
                }
            }
        }
    }
    Err(match refused {
        Some(error) => Failure::of_output(error),
        None => Failure::usage("no basis is left to convert to; give --basis"),
    })
}

fn other(space: Space) -> Space {
    match space {
        Space::Encoded => Space::Linear,
        Space::Linear => Space::Encoded,
    }
}

/// Functions, none where pictures alone would tell; and planes at most, where they are learned.
type Candidate = (Option<Basis>, Option<usize>);

/// Functions and planes: what is asked for, or else what there is and then all
/// others by their number of functions.
fn bases(arguments: &ConvertArguments, from: &Model) -> Result<Vec<Candidate>, Failure> {
    let lights = lights_of(from);
    let functions = &arguments.functions;
    let asked = match &arguments.basis {
        Some(name) => Some(family_of_name(name)?),
        None => None,
    };
    let family = asked.unwrap_or(from.basis.family());
    let srbf = functions.srbf(family.name)?;
    let count = functions.asked_count(family)?;
    let build = |family: &Family, count| family.build(&Design { count, lights: &lights, srbf });
    if family.learned && arguments.planes.is_some() {
        return Err(Failure::usage("--planes is for ptm, sh, hsh and srbf; pca has -k"));
    }
    if asked.is_none() && count.is_none() {
        let kept = (Some(from.basis.clone()), arguments.planes);
        let others = if arguments.planes.is_some() { Vec::new() } else { by_count(from.maps()) };
        let others = others.into_iter().map(|(family, count)| Ok((Some(build(family, count)?), None)));
        return std::iter::once(Ok(kept)).chain(others).collect();
    }
    if family.learned {
        let planes = count.unwrap_or(family.default_count);
        return Ok(vec![if from.layout == Layout::Shared && from.maps() == planes {
            (Some(from.basis.clone()), None)
        } else {
            (None, Some(planes))
        }]);
    }
    let same_family = family.name == from.basis.family().name;
    let usual = if same_family { from.basis.count() } else { family.default_count };
    let kept = same_family && usual == count.unwrap_or(usual) && !functions.shapes_srbf();
    let basis = if kept { from.basis.clone() } else { build(family, count.unwrap_or(usual))? };
    Ok(vec![(Some(basis), arguments.planes)])
}

/// The families whose sizes are steps of an order or degree, all of them: those of at least `count` functions
/// rising, then the others falling.
fn by_count(count: usize) -> Vec<(&'static Family, usize)> {
    let sized = FAMILIES.iter().filter(|family| family.size.is_some());
    let mut all: Vec<_> = sized
        .flat_map(|family| family.counts_up_to(usize::MAX).into_iter().map(move |k| (family, k)))
        .collect();
    all.sort_by_key(|&(_, k)| if k >= count { (0, k) } else { (1, usize::MAX - k) });
    all
}

/// The layouts to try.
fn layouts(color: Option<Color>, from: &Model, shared: bool) -> Result<Vec<Layout>, Failure> {
    let grey = from.channels() == 1;
    let plain = if grey { Layout::Grey } else { Layout::Rgb };
    Ok(match (color, shared) {
        (Some(Color::Lrgb), true) => {
            return Err(Failure::usage(
                "--color lrgb is not for learned planes; use rgb, or another --basis",
            ));
        }
        (_, true) => vec![Layout::Shared],
        (Some(Color::Ycc), false) => {
            return Err(Failure::usage("--color ycc belongs to --basis pca and --planes; use rgb or lrgb"));
        }
        (Some(Color::Lrgb), false) if grey => return Err(FitError::GreyHasNoColor.into()),
        (Some(Color::Lrgb), false) => vec![Layout::Lrgb],
        (Some(Color::Rgb), false) => vec![plain, Layout::Rgb],
        (None, false) if from.layout == Layout::Shared => vec![plain, Layout::Rgb],
        (None, false) => vec![from.layout, Layout::Rgb],
    })
}

/// The lights of `model`, or as many as are made where they are not known.
fn lights_of(model: &Model) -> LightSet {
    LightSet::from_directions(match model.lights.is_empty() {
        true => fibonacci_in(Refit::domain(model, &model.basis), PICTURES),
        false => model.lights.clone(),
    })
}

/// How planes become those of the target.
pub(super) enum Way {
    /// By sums of planes.
    Planes(Refit),
    /// By fitting pictures of the asset.
    Functions(LeastSquares, Layout),
    /// By learning from them.
    Learned(LearnedFit),
}

impl Way {
    pub(super) fn pixel_fit(&self) -> PixelFit<'_> {
        match self {
            Self::Planes(refit) => refit.into(),
            Self::Functions(fit, layout) => (fit, *layout).into(),
            Self::Learned(fit) => fit.into(),
        }
    }

    pub(super) fn basis(&self) -> Basis {
        match self {
            Self::Planes(refit) => refit.basis.clone(),
            Self::Functions(fit, _) => fit.basis.clone(),
            Self::Learned(fit) => Basis::Learned(fit.basis.clone()),
        }
    }

    /// What was done, in words.
    pub(super) fn words(&self, from: &Model) -> &'static str {
        match self {
            Self::Planes(refit) if refit.keeps_planes(from) => "planes kept",
            Self::Planes(refit) if refit.basis == from.basis => "planes multiplied out",
            Self::Planes(_) => "functions refitted",
            Self::Functions(..) => "fitted to its pictures",
            Self::Learned(_) => "learned from its pictures",
        }
    }

    /// How far the new functions are from being undetermined, where there are some.
    pub(super) fn condition(&self) -> f64 {
        match self {
            Self::Planes(refit) => refit.condition,
            Self::Functions(fit, _) => fit.decomposition.condition(),
            Self::Learned(_) => 1.0,
        }
    }
}

/// The way from `maps` to `target`, and what it reads.
pub(super) fn way<'a>(
    arguments: &ConvertArguments,
    maps: &'a RelightingMaps,
    target: &Target,
    ridge: f64,
    machine: &Machine,
) -> Result<(Way, Box<dyn Stack + 'a>), Failure> {
    let Target { basis, planes, layout, space } = target;
    if let (Some(basis), None) = (basis, planes)
        && *space == maps.model.space
    {
        let domain = Refit::domain(&maps.model, basis);
        match Refit::new(&maps.model, basis.clone(), *layout, domain, ridge) {
            Ok(refit) => return Ok((Way::Planes(refit), Box::new(PlaneStack(maps)))),
            Err(FitError::Layouts { .. }) => {}
            Err(error) => return Err(error.into()),
        }
    }
    let domain: Cap = Refit::domain(&maps.model, basis.as_ref().unwrap_or(&maps.model.basis));
    let lights = fibonacci_in(domain, if planes.is_some() { PICTURES_TO_LEARN_FROM } else { PICTURES });
    let stack = RelitStack::new(maps, &lights, *space, machine.level);
    let functions = |basis: &Basis, sample: &Sample| {
        LeastSquares::new(basis.clone(), &lights, LightWeights::Uniform, Ridge::Fixed(ridge), sample)
    };
    let way = match planes {
        None => {
            let basis = basis.as_ref().unwrap_or(&maps.model.basis);
            if matches!(basis, Basis::Learned(_)) {
                let message =
                    "learned planes are not taken to another space; bake the pictures in that space";
                return Err(Failure::usage(message));
            }
            let sample = Sample::of(&stack).map_err(FitError::from)?;
            Way::Functions(functions(basis, &sample)?, *layout)
        }
        Some(planes) => {
            let sample = ChannelSample::of(&stack).map_err(FitError::from)?;
            interrupt::check()?;
            let opponent = arguments.color == Some(Color::Ycc);
            let design = LearnedDesign { planes: *planes, opponent, target_psnr: None };
            Way::Learned(match basis {
                Some(basis) if !matches!(basis, Basis::Learned(_)) => {
                    LearnedFit::factored(&functions(basis, &sample.of_pictures)?, &lights, design, &sample)?
                }
                _ => LearnedFit::new(&lights, design, &sample)?,
            })
        }
    };
    Ok((way, Box::new(stack)))
}
