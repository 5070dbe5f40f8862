//! What an asset becomes: the functions, layout and space that are asked for, or those nearest to its own that
//! the output holds; and the way there.

use super::ConvertArguments;
use crate::bake::Color;
use crate::failure::Failure;
use crate::function_options::family_of_name;
use crate::options::Machine;
use relight_core::basis::{FAMILIES, Learned};
use relight_core::sphere::fibonacci_in;
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

/// The functions of light that an asset gets.
#[derive(Clone)]
enum Functions {
    /// These.
    Of(Basis),
    /// Those of so many planes at most that carry most of what these functions make.
    Factored(Basis, usize),
    /// Those of so many planes at most that are learned from pictures.
    Learned(usize),
}

/// What an asset becomes.
pub(super) struct Target {
    functions: Functions,
    pub(super) layout: Layout,
    space: Space,
}

impl Target {
    /// The model as it will be stored; learned functions are blank as yet.
    pub(super) fn model(&self, from: &Model) -> Result<Model, Failure> {
        let basis = match &self.functions {
            Functions::Of(basis) => basis.clone(),
            Functions::Factored(_, planes) | Functions::Learned(planes) => {
                Basis::Learned(Learned::blank(*planes, from.channels())?)
            }
        };
        let kept = basis == from.basis && self.space == from.space;
        Ok(Model {
            basis,
            layout: self.layout,
            space: self.space,
            lights: from.lights.clone(),
            figures: from.figures.filter(|_| kept),
            provenance: from.provenance.clone().filter(|_| kept),
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
    let mut refused = None;
    for functions in functions_of(arguments, from)? {
        let shared = !matches!(&functions, Functions::Of(basis) if !basis.family().learned);
        for space in [from.space, other(from.space)] {
            let functions = match &functions {
                // In the other space they are others.
                Functions::Of(Basis::Learned(_)) if space != from.space => Functions::Learned(from.maps()),
                functions => functions.clone(),
            };
            for layout in layouts(arguments.color, from, shared)? {
                let target = Target { functions: functions.clone(), layout, space };
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

/// Functions: what is asked for, or else what there is and then all
/// others by their number of functions.
fn functions_of(arguments: &ConvertArguments, from: &Model) -> Result<Vec<Functions>, Failure> {
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
    let kept = || match (&from.basis, arguments.planes) {
        (basis, None) => Functions::Of(basis.clone()),
        (Basis::Learned(_), Some(planes)) => Functions::Learned(planes),
        (basis, Some(planes)) => Functions::Factored(basis.clone(), planes),
    };
    if asked.is_none() && count.is_none() {
        let others = if arguments.planes.is_some() { Vec::new() } else { by_count(from.maps()) };
        let others = others.into_iter().map(|(family, count)| Ok(Functions::Of(build(family, count)?)));
        return std::iter::once(Ok(kept())).chain(others).collect();
    }
    let same_family = family.name == from.basis.family().name;
    let own = if same_family { from.maps() } else { family.default_count };
    let count = count.unwrap_or(own);
    Ok(vec![if same_family && count == own && !functions.shapes_srbf() {
        kept()
    } else if family.learned {
        Functions::Learned(count)
    } else {
        let basis = build(family, count)?;
        arguments.planes.map_or(Functions::Of(basis.clone()), |planes| Functions::Factored(basis, planes))
    }])
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
    let Target { functions, layout, space } = target;
    if let Functions::Of(basis) = functions
        && *space == maps.model.space
    {
        let domain = Refit::domain(&maps.model, basis);
        match Refit::new(&maps.model, basis.clone(), *layout, domain, ridge) {
            Ok(refit) => return Ok((Way::Planes(refit), Box::new(PlaneStack(maps)))),
            Err(FitError::Layouts { .. }) => {}
            Err(error) => return Err(error.into()),
        }
    }
    let (basis, pictures) = match functions {
        Functions::Of(basis) => (basis, PICTURES),
        Functions::Factored(basis, _) => (basis, PICTURES_TO_LEARN_FROM),
        Functions::Learned(_) => (&maps.model.basis, PICTURES_TO_LEARN_FROM),
    };
    let lights = fibonacci_in(Refit::domain(&maps.model, basis), pictures);
    let stack = RelitStack::new(maps, &lights, *space, machine.level);
    let least_squares = |basis: &Basis, sample: &Sample| {
        LeastSquares::new(basis.clone(), &lights, LightWeights::Uniform, Ridge::Fixed(ridge), sample)
    };
    let opponent = arguments.color == Some(Color::Ycc);
    let design = |planes| LearnedDesign { planes, opponent, target_psnr: None };
    let sample = || ChannelSample::of(&stack).map_err(FitError::from);
    let way = match functions {
        Functions::Of(basis) => {
            let sample = Sample::of(&stack).map_err(FitError::from)?;
            Way::Functions(least_squares(basis, &sample)?, *layout)
        }
        Functions::Factored(basis, planes) => {
            let sample = sample()?;
            let fit = least_squares(basis, &sample.of_pictures)?;
            Way::Learned(LearnedFit::factored(&fit, &lights, design(*planes), &sample)?)
        }
        Functions::Learned(planes) => Way::Learned(LearnedFit::new(&lights, design(*planes), &sample()?)?),
    };
    Ok((way, Box::new(stack)))
}
