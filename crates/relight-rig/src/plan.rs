//! Which light goes through the rig, which is evaluated at every point, and which not at all.
//!
//! Every part of a rig has its own answer for every light, from its error table: what the rig would get wrong scales with a
//! light's radiance x (its radius / the part's)^2. Errors of lights meet at points of the surface and are seen in a picture, so
//! one number a part for a whole sequence, the strictness, makes up for both: it multiplies all tabulated errors and is
//! the least with which the plan, measured at points of the surface in encoded grey levels, keeps the tolerance in every picture.
//! Weights depend on it, on a light's own distance and on its strength alone, all of which change smoothly, so nothing pops.
//!
//! Source: *Irradiance Rigs*, section 3; the scale and the envelope are MATH.md's (section 1.4).

use crate::errors::Envelope;
use crate::{Light, Pixels, Placement, RigPart, Ringing, Source, cosine_lobe};
use rayon::prelude::*;
use relight_core::vectors::{difference, length};
use relight_core::{CpuLevel, srgb_from_linear};
use std::f64::consts::PI;

/// Width of the transition in radii of the frame, at least: what the rig errs by then changes more slowly than what
/// the light itself does.
const TRANSITION_RADII: f64 = 2.0;

/// Width of the transition against the distance at which it begins, at least.
const TRANSITION_SHARE: f64 = 0.25;

/// Part of the tolerance that is used. Between the points at which errors are measured they are a little larger: by as much again as the
/// largest errors of every other point and of the rest are apart.
const MARGIN: f64 = 0.8;

/// Part of the tolerance that lights left out may take together.
const DROPPED_SHARE: f64 = 0.5;

/// Strictnesses that are tried, as powers of the square root of 2.
const STRICTNESS: std::ops::RangeInclusive<i32> = -12..=40;

/// Errors that are held at once, 24 bytes each: of a part's lights at its points in all pictures that are looked at.
const MOST_ERRORS: usize = 8_000_000;

/// Pictures in which errors are measured, at most.
const MOST_PICTURES: usize = 64;

/// Surface points at which errors are measured, at least and at most.
const FEWEST_POINTS: usize = 64;
const MOST_POINTS: usize = 512;

/// A part of a rig in one picture of a sequence.
#[derive(Clone, Copy, Debug)]
pub struct PlacedPart<'a> {
    /// The part.
    pub part: &'a RigPart,
    /// Where it stands.
    pub placement: Placement,
}

/// What becomes of a light for a part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightPlan {
    /// How much of it is evaluated at every point: 1 all, 0 nothing; between them in transition. The rest goes through
    /// the rig.
    pub analytic: f64,
    /// Whether it is left out.
    pub dropped: bool,
    /// Distance from the frame's middle in its radii; infinite for lights from afar.
    pub distance: f64,
    /// Distance within which all of it is evaluated, in radii.
    pub near: f64,
    /// Distance beyond which all of it goes through the rig, in radii.
    pub far: f64,
}

/// The plan of one picture.
#[derive(Clone, Debug, PartialEq)]
pub struct PicturePlan {
    /// By part, then light.
    pub parts: Vec<Vec<LightPlan>>,
    /// Largest error at points of the surface, in grey levels of an sRGB-encoded picture, where it was measured.
    pub error_grey: Option<f64>,
    /// By part: how far the plan's light rings below 0 at those points, where it was measured.
    pub ringing: Option<Vec<Ringing>>,
}

/// The plan of a sequence.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plan {
    /// By part.
    pub rules: Vec<Rule>,
    /// By picture.
    pub pictures: Vec<PicturePlan>,
}

/// What a part's lights are decided by, in all pictures of a sequence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rule {
    /// What tabulated errors are multiplied by.
    pub strictness: f64,
    /// Error in reflected radiance that a light may have by its table: the tolerance over the strictness.
    pub error: f64,
    /// Reflected radiance that lights left out may have together.
    pub dropped: f64,
}

/// Plans a sequence so that no picture errs by more than `tolerance_grey` levels of an sRGB-encoded picture of a white
/// diffuser, 255 levels from 0 to 1.
///
/// `pictures` have the lights and the placed parts of each; all have the same numbers of them. Errors are measured in
/// 64 of them at most, evenly through the sequence.
pub fn plan(
    pictures: &[(&[Light], Vec<PlacedPart<'_>>)],
    bands: usize,
    tolerance_grey: f64,
    level: CpuLevel,
) -> Plan {
    let Some((lights, parts)) = pictures.first() else { return Plan::default() };
    let each = lights.len().max(1) * parts.len().max(1);
    let looks = (MOST_ERRORS / (FEWEST_POINTS * each)).clamp(2, MOST_PICTURES).min(pictures.len());
    let looked: Vec<usize> =
        (0..looks).map(|look| look * (pictures.len() - 1) / (looks - 1).max(1)).collect();
    let points = (MOST_ERRORS / (each * looks)).clamp(FEWEST_POINTS, MOST_POINTS);
    let mut plan = Plan::default();
    let mut errors = vec![0.0f64; looks];
    let mut ringing = vec![Vec::new(); looks];
    // By part, then picture.
    let mut plans: Vec<Vec<Vec<LightPlan>>> = Vec::new();
    for part in 0..parts.len() {
        let envelope = Envelope::new(&parts[part].part.errors);
        let situations = pictures.iter().map(|(lights, parts)| -> Vec<Situation> {
            lights.iter().map(|light| Situation::new(light, &parts[part], bands)).collect()
        });
        let situations: Vec<_> = situations.collect();
        let measured = looked.iter().map(|&picture| {
            let (lights, parts) = &pictures[picture];
            let seen = Seen { situations: &situations[picture], envelope: envelope.as_ref() };
            Measured::new(seen, &parts[part], lights, bands, points, level)
        });
        let measured: Vec<_> = measured.collect();
        let rule = rule_of(&measured, tolerance_grey);
        for (look, measured) in measured.iter().enumerate() {
            errors[look] = errors[look].max(measured.error(&rule));
            ringing[look].push(measured.ringing(&rule));
        }
        plan.rules.push(rule);
        plans.push(situations.iter().map(|all| decide(all, &rule, envelope.as_ref())).collect());
    }
    for picture in 0..pictures.len() {
        let parts = plans.iter_mut().map(|pictures| std::mem::take(&mut pictures[picture])).collect();
        let look = looked.iter().position(|&look| look == picture);
        plan.pictures.push(PicturePlan {
            parts,
            error_grey: look.map(|look| errors[look]),
            ringing: look.map(|look| std::mem::take(&mut ringing[look])),
        });
    }
    plan
}

/// The least strict rule under which the part errs by no more than [`MARGIN`] of the tolerance in any picture.
fn rule_of(measured: &[Measured<'_>], tolerance_grey: f64) -> Rule {
    let tolerance = tolerance_grey / 255.0;
    // Less is left out where the scene is so dark that it would show.
    let limits = [1.0, 0.25, 1.0 / 16.0, 1.0 / 64.0].map(|share| share * DROPPED_SHARE * tolerance);
    let is_unseen =
        |limit: &f64| measured.iter().all(|m| m.dropped_error(*limit) <= DROPPED_SHARE * tolerance_grey);
    let dropped = limits.into_iter().find(is_unseen).unwrap_or(0.0);
    let rule = |half_steps: f64| {
        let strictness = libm::exp2(0.5 * half_steps);
        Rule { strictness, error: tolerance / strictness, dropped }
    };
    let keeps = |step: f64| {
        let rule = rule(step);
        let errors = measured.par_iter().map(|measured| {
            let [a, b] = measured.errors_of_halves(&rule);
            a.max(b) + (a - b).abs()
        });
        errors.reduce(|| 0.0, f64::max) <= MARGIN * tolerance_grey
    };
    // From strict to lenient, as long as the tolerance is kept: errors of lights cancel here and there, so a lenient value
    // that keeps it below one that does not is luck.
    let kept = STRICTNESS.rev().map(f64::from).take_while(|&step| keeps(step)).last();
    let Some(mut strict) = kept else { return rule(f64::from(*STRICTNESS.end())) };
    let mut lenient = strict - 1.0;
    for _ in 0..4 {
        let middle = 0.5 * (strict + lenient);
        if keeps(middle) { strict = middle } else { lenient = middle }
    }
    rule(strict)
}

/// Where a light stands to a part.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Situation {
    /// From the frame's middle in radii; infinite for lights from afar.
    distance: f64,
    /// Radiance x (radius of the light / of the frame)^2, in the largest channel; for lights from afar, their error.
    strength: f64,
    /// Whether it may reach into the sphere around the part.
    is_within: bool,
    /// A bound on the reflected radiance that it causes.
    effect: f64,
}

impl Situation {
    fn new(light: &Light, placed: &PlacedPart<'_>, bands: usize) -> Self {
        let frame = &placed.part.frame;
        let centre = placed.placement.point(frame.centre);
        let color = light.color.iter().fold(0.0f64, |most, &c| most.max(c));
        let local = |place: [f64; 3], strength: f64, size: f64| {
            let distance = length(difference(place, centre)) / frame.radius;
            (distance, strength, distance <= 1.0 + size)
        };
        let (distance, strength, is_within) = match &light.source {
            Source::Sphere { centre, radius } | Source::Disc { centre, radius, .. } => {
                let size = radius / frame.radius;
                local(*centre, color * size * size, size)
            }
            // Radiant intensity is radiance x pi x radius^2.
            Source::Point { position, nearest } => {
                local(*position, color / (PI * frame.radius * frame.radius), nearest / frame.radius)
            }
            Source::Directional { .. } => (f64::INFINITY, color / PI * truncation(bands), false),
            Source::Probe(probe) => {
                let cut = probe.coefficients.iter().enumerate().skip(bands * bands).map(|(i, values)| {
                    let l = i.isqrt();
                    let lobe = cosine_lobe(l).abs() / PI;
                    let most =
                        values.iter().zip(light.color).fold(0.0f64, |most, (v, c)| most.max((v * c).abs()));
                    lobe * most * ((2 * l + 1) as f64 / (4.0 * PI)).sqrt()
                });
                (f64::INFINITY, cut.sum(), false)
            }
        };
        Self { distance, strength, is_within, effect: light.largest_reflectance(centre, frame.radius) }
    }
}

/// The largest error of a directional light's irradiance in so many bands, for irradiance 1 at normal incidence.
fn truncation(bands: usize) -> f64 {
    let error = |i: i32| {
        let x = 0.01 * f64::from(i);
        let (mut before, mut legendre, mut sum) = (0.0, 1.0, 0.0);
        for l in 0..bands {
            let degree = l as f64;
            sum += cosine_lobe(l) * (2.0 * degree + 1.0) / (4.0 * PI) * legendre;
            let next = ((2.0 * degree + 1.0) * x * legendre - degree * before) / (degree + 1.0);
            (before, legendre) = (legendre, next);
        }
        (sum - x.max(0.0)).abs()
    };
    (-100..=100).map(error).fold(0.0, f64::max)
}

fn decide(situations: &[Situation], rule: &Rule, envelope: Option<&Envelope>) -> Vec<LightPlan> {
    let mut plans: Vec<LightPlan> =
        situations.iter().map(|situation| planned_light(situation, rule, envelope)).collect();
    let mut order: Vec<usize> = (0..situations.len()).collect();
    order.sort_by(|&a, &b| situations[a].effect.total_cmp(&situations[b].effect));
    let mut left_out = 0.0;
    for light in order {
        left_out += situations[light].effect;
        if left_out > rule.dropped && situations[light].effect > 0.0 {
            break;
        }
        plans[light] = LightPlan { analytic: 0.0, dropped: true, ..plans[light] };
    }
    plans
}

fn planned_light(situation: &Situation, rule: &Rule, envelope: Option<&Envelope>) -> LightPlan {
    let &Situation { distance, strength, is_within, .. } = situation;
    if distance.is_infinite() {
        // No distance to change over: over half of the tolerance instead.
        let analytic = (2.0 * strength / rule.error - 1.0).clamp(0.0, 1.0);
        return LightPlan { analytic, dropped: false, distance, near: 0.0, far: 0.0 };
    }
    let near = envelope.map_or(f64::INFINITY, |envelope| envelope.distance(strength, rule.error));
    let far = (near + TRANSITION_RADII).max(near * (1.0 + TRANSITION_SHARE));
    let analytic = match distance {
        _ if is_within || !far.is_finite() => 1.0,
        d => ((far - d) / (far - near)).clamp(0.0, 1.0),
    };
    LightPlan { analytic, dropped: false, distance, near, far }
}

/// Where the lights of a picture stand to a part, and its errors.
#[derive(Clone, Copy)]
struct Seen<'a> {
    situations: &'a [Situation],
    envelope: Option<&'a Envelope>,
}

/// What all lights do at points of a part in one picture.
struct Measured<'a> {
    seen: Seen<'a>,
    /// By surface point: the sum of all lights' reflected radiance.
    exact: Vec<[f64; 3]>,
    /// By light, then surface point: reflected radiance, and what the rig errs by.
    lights: Vec<Vec<([f32; 3], [f32; 3])>>,
}

impl<'a> Measured<'a> {
    fn new(
        seen: Seen<'a>,
        placed: &PlacedPart<'_>,
        lights: &[Light],
        bands: usize,
        points: usize,
        level: CpuLevel,
    ) -> Self {
        let surface = &placed.part.surface;
        let mut pixels = Pixels::default();
        for point in surface.iter().step_by(surface.len().div_ceil(points).max(1)) {
            pixels.push(placed, point.position, point.normal);
        }
        // As pictures are drawn, each light alone.
        let of_light = |light: &Light| -> Vec<([f32; 3], [f32; 3])> {
            let light = std::slice::from_ref(light);
            let exact = pixels.by_brute_force(placed, light, level);
            let rig = pixels.by_rig(placed, light, bands, level);
            let of_point = |point: usize| {
                let exact = [0, 1, 2].map(|c| exact[c][point]);
                (exact, [0, 1, 2].map(|c| rig[c][point] - exact[c]))
            };
            (0..pixels.len()).map(of_point).collect()
        };
        let of_lights: Vec<_> = lights.par_iter().map(of_light).collect();
        let exact = (0..pixels.len()).map(|point| {
            let add = |sum: [f64; 3], of_light: &Vec<([f32; 3], [f32; 3])>| {
                [0, 1, 2].map(|c| sum[c] + f64::from(of_light[point].0[c]))
            };
            of_lights.iter().fold([0.0; 3], add)
        });
        Self { seen, exact: exact.collect(), lights: of_lights }
    }

    fn lights(&self, rule: &Rule) -> Vec<LightPlan> {
        decide(self.seen.situations, rule, self.seen.envelope)
    }

    /// The largest error under a rule, in encoded grey levels.
    fn error(&self, rule: &Rule) -> f64 {
        self.errors_of_halves(rule).into_iter().fold(0.0, f64::max)
    }

    /// The same, of every other point and of the rest.
    fn errors_of_halves(&self, rule: &Rule) -> [f64; 2] {
        let plans = self.lights(rule);
        self.largest_errors(|light| shares(&plans[light]))
    }

    /// How far what is drawn under a rule is below 0.
    fn ringing(&self, rule: &Rule) -> Ringing {
        let plans = self.lights(rule);
        let errors = self.errors(|light| shares(&plans[light]));
        Ringing::of(
            self.exact.iter().zip(&errors).map(|(exact, error)| [0, 1, 2].map(|c| exact[c] + error[c])),
        )
    }

    /// What leaving out lights up to a limit does alone.
    fn dropped_error(&self, limit: f64) -> f64 {
        let plans = self.lights(&Rule { strictness: 0.0, error: f64::INFINITY, dropped: limit });
        let errors = self.largest_errors(|light| (if plans[light].dropped { -1.0 } else { 0.0 }, 0.0));
        errors.into_iter().fold(0.0, f64::max)
    }

    /// By point, where each light's reflected radiance and error count as often as `factors` says.
    fn errors(&self, factors: impl Fn(usize) -> (f64, f64)) -> Vec<[f64; 3]> {
        let mut sums = vec![[0.0f64; 3]; self.exact.len()];
        for (light, errors) in self.lights.iter().enumerate() {
            let (whole, rig) = factors(light);
            if (whole, rig) == (0.0, 0.0) {
                continue;
            }
            for (sum, (exact, error)) in sums.iter_mut().zip(errors) {
                *sum = [0, 1, 2].map(|c| sum[c] + whole * f64::from(exact[c]) + rig * f64::from(error[c]));
            }
        }
        sums
    }

    /// The largest of [`Self::errors`] in encoded grey levels, of every other point and of the rest.
    fn largest_errors(&self, factors: impl Fn(usize) -> (f64, f64)) -> [f64; 2] {
        let errors = self.errors(factors);
        let encoded = |linear: f64| f64::from(srgb_from_linear(linear.clamp(0.0, 1.0) as f32));
        let mut largest = [0.0f64; 2];
        for (i, (exact, error)) in self.exact.iter().zip(&errors).enumerate() {
            for c in 0..3 {
                let grey = 255.0 * (encoded(exact[c] + error[c]) - encoded(exact[c])).abs();
                largest[i % 2] = largest[i % 2].max(grey);
            }
        }
        largest
    }
}

/// How often a light's reflected radiance and its error in the rig count.
fn shares(plan: &LightPlan) -> (f64, f64) {
    if plan.dropped { (-1.0, 0.0) } else { (0.0, 1.0 - plan.analytic) }
}
