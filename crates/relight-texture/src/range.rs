//! Which range of coefficients the codes of a format are spread over.
//!
//! An error of a plane reaches the relit picture multiplied by its function of light, whatever the
//! coefficient: the relit error of a plane is the root mean square error of its coefficients times a
//! constant ([`light_energy`](crate::light_energy)). So the range that is best for the coefficients is
//! best for the picture, with one exception: pictures end at black and white, and a coefficient that
//! is wrong by more than that does no more harm ([`error_ceilings`](crate::error_ceilings)).

use crate::{BlockFormat, Precision, Quantizer, TexelDomain, TexelFormat};
use relight_core::{CoefficientDistribution, CoefficientRange};
use std::fmt;

/// How a range is chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum RangeRule {
    /// From the least coefficient to the largest.
    MinMax,
    /// Where the sum of the squared errors is least, of coefficients outside that are clipped and of
    /// those inside that are rounded.
    #[default]
    MinError,
    /// -1 to 1, the same for all planes, whatever they hold.
    ///
    /// Source: the mapping [-1, 1] -> [0, 1] of Wong et al., *Interactive Relighting of Panoramas*.
    Unit,
}

/// A range, and what it does to the coefficients.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RangeChoice {
    /// What spreads codes over the range.
    pub quantizer: Quantizer,
    /// Texels outside the range, those that lie in a bucket of the distribution across its end by the
    /// bucket's middle.
    pub clipped: u64,
    /// Root mean square error of the coefficients that clipping and rounding to the format's steps are
    /// expected to make, no error counting beyond the ceiling.
    ///
    /// For block formats the rounding is that of a block's ends. What sharing them among 16 texels
    /// costs depends on the picture and not on the range.
    pub rmse: f64,
}

/// A plane that has no range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotFinite {
    /// The first pixel, x + y * width, whose coefficient is NaN or infinite.
    pub pixel: usize,
}

impl fmt::Display for NotFinite {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the coefficient of pixel {} is NaN or infinite and can't be quantised", self.pixel)
    }
}

impl std::error::Error for NotFinite {}

/// Clipping must lower the sum of squared errors to this part of what min/max makes: planes that gain
/// nothing to speak of keep their ends.
const WORTHWHILE: f64 = 0.98;

/// Ends tried on each side of a range: more than any plane but one of all magnitudes that there are has.
const MOST_ENDS: usize = 1000;

impl RangeRule {
    /// All rules, in the order in which they are listed to users.
    pub const ALL: [Self; 3] = [Self::MinError, Self::MinMax, Self::Unit];

    /// The name on the command line and in documents.
    pub fn name(self) -> &'static str {
        match self {
            Self::MinMax => "minmax",
            Self::MinError => "min-error",
            Self::Unit => "unit",
        }
    }

    /// The rule of that name.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|rule| rule.name() == name)
    }
}

/// The range of a plane in `format` by `rule`, the one for all of the plane's mip levels: those are
/// means, which leave no range.
///
/// Texels of 0..1 get any scale and bias, those of -1..1 a scale only (0 stays 0, and engines that
/// know no bias can read them), halves and floats neither unless the plane leaves the halves, whatever
/// the rule. A constant plane is exact but for [`RangeRule::Unit`], which gives the nearest code.
///
/// `ceiling` is the plane's of [`error_ceilings`](crate::error_ceilings); infinite to count every error
/// in full. It never falls below the width that holds all but a thousandth of the coefficients at each
/// end: where those are far beyond white, planes cancel each other or white is not 1, and where
/// pictures end is not known.
///
/// # Errors
/// [`NotFinite`] when a coefficient is NaN or infinite.
pub fn choose_range(
    distribution: &CoefficientDistribution,
    format: TexelFormat,
    rule: RangeRule,
    ceiling: f64,
) -> Result<RangeChoice, NotFinite> {
    if let Some(pixel) = distribution.first_not_finite() {
        return Err(NotFinite { pixel });
    }
    let range = distribution.range();
    let groups = Groups::of(distribution, ceiling);
    let found = match (format.domain(), rule) {
        (TexelDomain::Half, _) => {
            let quantizer = Precision::F16.quantizer(range);
            return Ok(RangeChoice { quantizer, clipped: 0, rmse: groups.half_rmse(quantizer) });
        }
        (TexelDomain::Float, _) => {
            return Ok(RangeChoice { quantizer: Precision::F32.quantizer(range), clipped: 0, rmse: 0.0 });
        }
        (TexelDomain::Unit | TexelDomain::Signed, RangeRule::Unit) => {
            CoefficientRange { min: -1.0, max: 1.0 }
        }
        _ if range.min >= range.max => {
            let quantizer = Quantizer::of_domain(format.domain(), range);
            return Ok(RangeChoice { quantizer, clipped: 0, rmse: 0.0 });
        }
        (TexelDomain::Unit, RangeRule::MinMax) => range,
        (TexelDomain::Unit, RangeRule::MinError) => groups.least_error(range, steps(format)),
        (TexelDomain::Signed, RangeRule::MinMax) => symmetric(range),
        (TexelDomain::Signed, RangeRule::MinError) => groups.least_symmetric_error(range, steps(format)),
    };
    let (error, clipped) = groups.measure(found, steps(format));
    Ok(RangeChoice {
        quantizer: Quantizer::of_domain(format.domain(), found),
        clipped: clipped as u64,
        rmse: (error / groups.count.max(1.0)).sqrt(),
    })
}

/// The smallest range around 0 that holds `range`.
fn symmetric(range: CoefficientRange) -> CoefficientRange {
    let largest = range.min.abs().max(range.max.abs());
    CoefficientRange { min: -largest, max: largest }
}

/// Equal steps over the range to which a format rounds values that it is free to choose.
///
/// Blocks round their ends: BC4, BC5 and (about, its modes differ) BC7 to 8 bits, BC1 and BC3 to 5 or
/// 6, of which the coarser counts. BC6H has 64 steps from 1/2 to 1 and ever finer ones below.
fn steps(format: TexelFormat) -> f64 {
    match format {
        TexelFormat::Plain { .. } => 255.0,
        TexelFormat::Block(format) => match format {
            BlockFormat::Bc1 | BlockFormat::Bc3 => 31.0,
            BlockFormat::Bc4 | BlockFormat::Bc5 | BlockFormat::Bc7 => 255.0,
            BlockFormat::Bc4Signed | BlockFormat::Bc5Signed => 254.0,
            BlockFormat::Bc6h | BlockFormat::Bc6hSigned => 127.0,
        },
    }
}

/// Coefficients of similar size.
#[derive(Clone, Copy)]
struct Group {
    lower: f64,
    upper: f64,
    count: f64,
}

/// The coefficients of a distribution, rising: the ends themselves, once each, and buckets.
struct Groups {
    groups: Vec<Group>,
    count: f64,
    /// The largest squared error that counts.
    ceiling: f64,
}

/// An end of a range, and the sum of squared errors and the number of the coefficients beyond it.
#[derive(Clone, Copy)]
struct End {
    at: f64,
    error: f64,
    clipped: f64,
}

impl Group {
    /// What stands for the coefficients.
    fn middle(self) -> f64 {
        0.5 * (self.lower + self.upper)
    }

    /// Mean squared distance to the nearest of the multiples of `step` from `first` on, were the
    /// coefficients spread evenly.
    fn rounding(self, first: f64, step: f64) -> f64 {
        let (a, b) = ((self.lower - first) / step, (self.upper - first) / step);
        // From 0 to u in steps: 1/12 for each whole one, and the part of the last.
        let integral = |u: f64| {
            let rest = u - u.round();
            u.round() / 12.0 + rest * rest * rest / 3.0
        };
        let squares = if b - a < 1e-3 {
            let rest = 0.5 * (a + b) - (0.5 * (a + b)).round();
            rest * rest
        } else {
            (integral(b) - integral(a)) / (b - a)
        };
        squares * step * step
    }
}

impl Groups {
    fn of(distribution: &CoefficientDistribution, ceiling: f64) -> Self {
        let CoefficientRange { min, max } = distribution.range();
        let (min, max) = (f64::from(min), f64::from(max));
        let mut groups: Vec<Group> = distribution
            .buckets()
            .map(|bucket| Group {
                lower: f64::from(bucket.lower).max(min),
                upper: f64::from(bucket.upper).min(max),
                count: bucket.count as f64,
            })
            .collect();
        // The ends' buckets give them one coefficient each.
        if let [first, ..] = &mut groups[..] {
            first.count -= 1.0;
            groups.insert(0, Group { lower: min, upper: min, count: 1.0 });
        }
        if let [_, .., last] = &mut groups[..]
            && last.count > 0.0
        {
            last.count -= 1.0;
            groups.push(Group { lower: max, upper: max, count: 1.0 });
        }
        groups.retain(|group| group.count > 0.0);
        let mut groups = Self { groups, count: distribution.count() as f64, ceiling: f64::INFINITY };
        let ceiling = ceiling.max(groups.central_width());
        groups.ceiling = ceiling * ceiling;
        groups
    }

    /// The width that holds all coefficients but a thousandth, and at least one, at each end.
    fn central_width(&self) -> f64 {
        fn inner<'a>(groups: impl Iterator<Item = &'a Group>, mut outside: f64) -> f64 {
            let mut value = 0.0;
            for group in groups {
                value = group.middle();
                outside -= group.count;
                if outside < 0.0 {
                    break;
                }
            }
            value
        }
        let outside = (self.count / 1000.0).floor().max(1.0);
        (inner(self.groups.iter().rev(), outside) - inner(self.groups.iter(), outside)).max(0.0)
    }

    /// The sum of squared errors that `range` makes, and how many coefficients it clips.
    fn measure(&self, range: CoefficientRange, steps: f64) -> (f64, f64) {
        let (min, max) = (f64::from(range.min), f64::from(range.max));
        let step = (max - min) / steps;
        self.groups.iter().fold((0.0, 0.0), |(error, clipped), group| {
            let beyond = (min - group.middle()).max(group.middle() - max);
            let (square, outside) = match beyond > 0.0 {
                true => (beyond * beyond, group.count),
                false => (group.rounding(min, step), 0.0),
            };
            (error + group.count * square.min(self.ceiling), clipped + outside)
        })
    }

    /// Squared error of rounding within a range of `width` many of whose steps are in use: a step's
    /// square / 12.
    fn even_rounding(&self, width: f64, steps: f64) -> f64 {
        let step = width / steps;
        (step * step / 12.0).min(self.ceiling)
    }

    /// `range`, or `whole` where that is about as good: the search takes coefficients to lie anywhere
    /// between codes, which those that are all at one end of the range don't.
    fn if_worthwhile(
        &self,
        range: CoefficientRange,
        whole: CoefficientRange,
        steps: f64,
    ) -> CoefficientRange {
        let of_whole = self.measure(whole, steps).0;
        if self.measure(range, steps).0 < WORTHWHILE * of_whole { range } else { whole }
    }

    /// `range`, widened by up to a step so that 0 is a code where that is worth it: a black background
    /// is 0 in all planes, and the errors of all would add up.
    fn with_exact_zero(&self, range: CoefficientRange, steps: f64) -> CoefficientRange {
        let (min, max) = (f64::from(range.min), f64::from(range.max));
        let below = (-min / (max - min) * steps).round();
        if !(1.0..steps).contains(&below) {
            return range;
        }
        let step = (-min / below).max(max / (steps - below));
        let widened = CoefficientRange { min: (-below * step) as f32, max: ((steps - below) * step) as f32 };
        if widened.min.is_finite() && widened.max.is_finite() {
            self.if_worthwhile(widened, range, steps)
        } else {
            range
        }
    }

    /// The range of least error, `whole` where no other is worth it.
    fn least_error(&self, whole: CoefficientRange, steps: f64) -> CoefficientRange {
        let (min, max) = (f64::from(whole.min), f64::from(whole.max));
        let most = self.count * self.even_rounding(max - min, steps);
        let falling: Vec<Group> = self.groups.iter().rev().copied().collect();
        let mirror = |group: &Group| Group { lower: -group.upper, upper: -group.lower, ..*group };
        let mirrored: Vec<Group> = self.groups.iter().map(mirror).collect();
        let upper = self.ends(&falling, min, max, most);
        let lower = self.ends(&mirrored, -max, -min, most);
        let mut best = (most, whole);
        for (low, high) in lower.iter().flat_map(|low| upper.iter().map(move |high| (low, high))) {
            let (min, max) = (-low.at, high.at);
            if min < max {
                let inside = self.count - low.clipped - high.clipped;
                let error = low.error + high.error + inside * self.even_rounding(max - min, steps);
                if error < best.0 {
                    best = (error, CoefficientRange { min: min as f32, max: max as f32 });
                }
            }
        }
        self.with_exact_zero(self.if_worthwhile(best.1, whole, steps), steps)
    }

    /// As [`Self::least_error`], of the ranges around 0.
    fn least_symmetric_error(&self, whole: CoefficientRange, steps: f64) -> CoefficientRange {
        let whole = symmetric(whole);
        let max = f64::from(whole.max);
        let most = self.count * self.even_rounding(2.0 * max, steps);
        let fold = |group: &Group| match group.lower < 0.0 {
            true => Group { lower: -group.upper, upper: -group.lower, ..*group },
            false => *group,
        };
        let mut falling: Vec<Group> = self.groups.iter().map(fold).collect();
        falling.sort_by(|a, b| b.middle().total_cmp(&a.middle()));
        let mut best = (most, whole);
        for end in self.ends(&falling, 0.0, max, most) {
            let inside = self.count - end.clipped;
            let error = end.error + inside * self.even_rounding(2.0 * end.at, steps);
            if error < best.0 {
                best = (error, CoefficientRange { min: -end.at as f32, max: end.at as f32 });
            }
        }
        self.if_worthwhile(best.1, whole, steps)
    }

    /// Where the upper end of a range may lie, from `max` down to where what is clipped alone errs by
    /// `most`: at the ends of groups, and between them where the width above `min` falls by an eighth
    /// of an octave.
    ///
    /// `falling` are the groups from the largest down.
    fn ends(&self, falling: &[Group], min: f64, max: f64, most: f64) -> Vec<End> {
        /// 2^(-1/8).
        const FACTOR: f64 = 0.917_004_043_204_671_2;
        let widths = std::iter::successors(Some(max - min), |width| Some(width * FACTOR)).take(400);
        let edges = falling.iter().flat_map(|group| [group.lower, group.upper]);
        let mut places: Vec<f64> = edges.chain(widths.map(|width| min + width)).collect();
        places.retain(|at| *at > min && *at < max);
        places.sort_by(|a, b| b.total_cmp(a));
        places.dedup();
        let places = std::iter::once(max).chain(places);
        let ends: Vec<End> =
            ends_at(falling, places, self.ceiling).take_while(|end| end.error < most).collect();
        let stride = ends.len().div_ceil(MOST_ENDS).max(1);
        ends.into_iter().step_by(stride).collect()
    }

    /// Root mean square error of rounding to halves after division by the scale.
    fn half_rmse(&self, quantizer: Quantizer) -> f64 {
        let scale = f64::from(quantizer.scale);
        let squares = self.groups.iter().map(|group| {
            let step = half_step(group.middle() / scale) * scale;
            group.count * step * step / 12.0
        });
        (squares.sum::<f64>() / self.count.max(1.0)).sqrt()
    }
}

/// Of the groups beyond an end those that err by less than the ceiling: their counts, and these times the distance from the end and
/// its square.
///
/// As an end falls distances grow, so that all is added and nothing lost; from sums about a fixed place little would be left where an
/// outlier is 1e12 times as far away as the rest.
#[derive(Clone, Copy, Default)]
struct Clipped {
    count: f64,
    distance: f64,
    square: f64,
}

impl Clipped {
    /// Moves the end down by `by`.
    fn lower(&mut self, by: f64) {
        self.square += by * (2.0 * self.distance + by * self.count);
        self.distance += by * self.count;
    }

    /// Takes `count` at `distance` in, or out where it is negative.
    fn add(&mut self, count: f64, distance: f64) {
        self.count += count;
        self.distance += count * distance;
        self.square += count * distance * distance;
    }
}

/// The ends at `places`, which fall, of a range that clips `falling`, groups from the largest down; no squared error counts more than
/// `ceiling`.
fn ends_at(falling: &[Group], places: impl Iterator<Item = f64>, ceiling: f64) -> impl Iterator<Item = End> {
    let mut near = Clipped::default();
    let mut last = f64::NAN;
    // Groups that are clipped; those of them that err by more than counts, and their coefficients.
    let (mut clipped, mut far, mut far_count) = (0, 0, 0.0);
    places.map(move |at| {
        if clipped > far {
            near.lower(last - at);
        }
        last = at;
        let distance = |group: &Group| group.middle() - at;
        while let Some(group) = falling.get(clipped).filter(|group| distance(group) > 0.0) {
            near.add(group.count, distance(group));
            clipped += 1;
        }
        while let Some(group) = falling[far..clipped].first()
            && distance(group) * distance(group) > ceiling
        {
            near.add(-group.count, distance(group));
            far_count += group.count;
            far += 1;
        }
        if far == clipped {
            near = Clipped::default();
        }
        let beyond = if far > 0 { ceiling * far_count } else { 0.0 };
        End { at, error: near.square.max(0.0) + beyond, clipped: near.count + far_count }
    })
}

/// Distance of the halves about `value`: 2^-10 of its octave, 2^-24 among the denormals.
fn half_step(value: f64) -> f64 {
    let exponent = (value.to_bits() >> 52 & 0x7ff) as i64 - 1023;
    f64::from_bits(((exponent.clamp(-14, 15) - 10 + 1023) as u64) << 52)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_of_what_is_clipped_are_those_of_each_coefficient_for_outliers_of_any_size() {
        for (outlier, ceiling) in
            [(2.0, f64::INFINITY), (1e4, 0.25), (1e12, 1.0), (1e30, 1e-3), (1e12, f64::INFINITY)]
        {
            let group = |middle: f64, count: f64| Group { lower: middle, upper: middle, count };
            let rest = (0..300).map(|i| group(1.0 - 0.01 * f64::from(i), f64::from(i * 7919 % 1000 + 1)));
            let falling: Vec<Group> =
                [group(outlier, 1.0), group(outlier * 0.9, 3.0)].into_iter().chain(rest).collect();
            let places: Vec<f64> =
                falling.iter().flat_map(|group| [group.lower + 1e-9, group.lower - 0.003]).collect();
            for end in ends_at(&falling, places.iter().copied(), ceiling) {
                let beyond = falling.iter().filter(|group| group.middle() > end.at);
                let (mut error, mut clipped) = (0.0, 0.0);
                for group in beyond {
                    error += group.count * (group.middle() - end.at).powi(2).min(ceiling);
                    clipped += group.count;
                }
                assert_eq!(end.clipped, clipped, "{outlier} at {}", end.at);
                assert!(
                    (end.error - error).abs() <= 1e-9 * error,
                    "{outlier} at {}: {} for {error}",
                    end.at,
                    end.error
                );
            }
        }
    }
}
