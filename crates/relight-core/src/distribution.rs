//! What is known of coefficients before they are quantised: how those of a plane are distributed, by
//! which scale and bias are chosen, and a scatter of blocks, by which formats are.

use crate::CoefficientRange;
use serde::{Deserialize, Serialize};

/// Mantissa bits that buckets tell apart: 32 buckets an octave, each 2 to 3 % wide.
const MANTISSA_BITS: u32 = 5;

/// Bits of an f32 below those that name its bucket.
const SHIFT: u32 = 23 - MANTISSA_BITS;

/// Buckets of one sign, the infinite exponent included.
const BUCKETS_OF_A_SIGN: usize = 1 << (31 - SHIFT);

const BUCKETS: usize = 2 * BUCKETS_OF_A_SIGN;

/// First bucket, of either sign, of what is not finite.
const NOT_FINITE: usize = 0xff << MANTISSA_BITS;

/// How many coefficients of a plane lie where: least and largest exactly, all others in buckets of
/// 32 an octave of either sign, so that a plane of any magnitude is resolved alike.
///
/// A [`CoefficientCounter`] makes it. Buckets that are empty take no memory.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CoefficientDistribution {
    range: CoefficientRange,
    count: u64,
    first_not_finite: Option<u64>,
    /// Those of finite coefficients, rising: the upper bits of the f32, and how many there are.
    buckets: Vec<(u32, u64)>,
}

/// Counts coefficients of a plane for their distribution.
///
/// Takes 128 KiB whatever the picture's size. All of it is integers, least and largest: any order of
/// adding gives the same.
#[derive(Clone, Debug, PartialEq)]
pub struct CoefficientCounter {
    range: CoefficientRange,
    count: u64,
    first_not_finite: Option<usize>,
    /// By the upper bits of the f32: 0 up, then -0 down.
    counts: Box<[u64; BUCKETS]>,
}

/// Coefficients of similar size and the same sign.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bucket {
    /// None is below.
    pub lower: f32,
    /// None is above.
    pub upper: f32,
    /// How many there are, at least 1.
    pub count: u64,
}

/// Coefficients of blocks of 4 x 4 pixels scattered over a picture.
///
/// Blocks lie on the picture's grid of blocks; those over its edge repeat the last column and row.
#[derive(Clone, Debug, PartialEq)]
pub struct CoefficientSample {
    /// How many blocks, at least 1.
    pub blocks: usize,
    /// One a plane in the order of [`Model::roles`](crate::Model::roles): blocks x 16 coefficients,
    /// the rows of a block one after another.
    pub planes: Vec<Vec<f32>>,
}

impl Default for CoefficientCounter {
    fn default() -> Self {
        Self::new()
    }
}

impl CoefficientCounter {
    /// With nothing counted.
    pub fn new() -> Self {
        Self { range: CoefficientRange::EMPTY, count: 0, first_not_finite: None, counts: no_counts() }
    }

    /// Adds the pixels of `row`, channel c of each to `of_channels[c]`.
    ///
    /// `row` holds pixels x c samples with the channels interleaved, c = `of_channels.len()`, of
    /// pixels `first_pixel ..` of the picture.
    ///
    /// # Panics
    /// When `row` is no whole number of pixels, or 24 no multiple of their channels.
    pub fn add_interleaved(of_channels: &mut [Self], row: &[f32], first_pixel: usize) {
        let channels = of_channels.len();
        assert!(row.len().is_multiple_of(channels) && LANES.is_multiple_of(channels), "whole pixels");
        // Three histograms side by side: counting up one waits for its last addition.
        if let [r, g, b] = of_channels {
            for pixel in row.chunks_exact(3) {
                r.counts[bucket_of(pixel[0])] += 1;
                g.counts[bucket_of(pixel[1])] += 1;
                b.counts[bucket_of(pixel[2])] += 1;
            }
        } else {
            for pixel in row.chunks_exact(channels) {
                for (distribution, value) in of_channels.iter_mut().zip(pixel) {
                    distribution.counts[bucket_of(*value)] += 1;
                }
            }
        }
        let ranges = lane_ranges(row);
        for (channel, distribution) in of_channels.iter_mut().enumerate() {
            let lanes = ranges[channel..].iter().step_by(channels);
            distribution.range = lanes.fold(distribution.range, |range, lane| range.union(*lane));
            distribution.count += (row.len() / channels) as u64;
            if distribution.counts_not_finite() > 0 {
                let pixel = row[channel..].iter().step_by(channels).position(|value| !value.is_finite());
                distribution.note_not_finite(pixel.map(|pixel| first_pixel + pixel));
            }
        }
    }

    /// The distribution of what was counted.
    pub fn distribution(&self) -> CoefficientDistribution {
        let (positive, negative) = self.counts.split_at(BUCKETS_OF_A_SIGN);
        let falling = (0..NOT_FINITE).rev().map(|i| (BUCKETS_OF_A_SIGN + i, negative[i]));
        let rising = (0..NOT_FINITE).map(|i| (i, positive[i]));
        let buckets = falling.chain(rising).filter(|(_, count)| *count > 0);
        CoefficientDistribution {
            range: self.range,
            count: self.count,
            first_not_finite: self.first_not_finite.map(|pixel| pixel as u64),
            buckets: buckets.map(|(index, count)| (index as u32, count)).collect(),
        }
    }

    fn counts_not_finite(&self) -> u64 {
        let (positive, negative) = self.counts.split_at(BUCKETS_OF_A_SIGN);
        positive[NOT_FINITE..].iter().chain(&negative[NOT_FINITE..]).sum()
    }

    fn note_not_finite(&mut self, pixel: Option<usize>) {
        self.first_not_finite = match (self.first_not_finite, pixel) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (a, b) => a.or(b),
        };
    }
}

impl CoefficientDistribution {
    /// Least and largest coefficient, exactly; NaN left out.
    pub fn range(&self) -> CoefficientRange {
        self.range
    }

    /// How many coefficients there are.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The first pixel of the picture whose coefficient is NaN or infinite: such a plane has no
    /// scale and no bias.
    pub fn first_not_finite(&self) -> Option<usize> {
        self.first_not_finite.map(|pixel| pixel as usize)
    }

    /// The finite coefficients, rising; empty buckets are left out.
    pub fn buckets(&self) -> impl Iterator<Item = Bucket> + '_ {
        let edge = |index: u32| f32::from_bits(index << SHIFT).min(f32::MAX);
        self.buckets.iter().map(move |&(index, count)| match index.checked_sub(BUCKETS_OF_A_SIGN as u32) {
            Some(below) => Bucket { lower: -edge(below + 1), upper: -edge(below), count },
            None => Bucket { lower: edge(index), upper: edge(index + 1), count },
        })
    }
}

impl Bucket {
    /// The middle, which stands for its coefficients.
    pub fn middle(self) -> f64 {
        0.5 * (f64::from(self.lower) + f64::from(self.upper))
    }
}

/// On the heap from the start: 128 KiB are much of a thread's stack.
fn no_counts() -> Box<[u64; BUCKETS]> {
    match vec![0; BUCKETS].into_boxed_slice().try_into() {
        Ok(counts) => counts,
        Err(_) => unreachable!("{BUCKETS} counts"),
    }
}

#[inline(always)]
fn bucket_of(value: f32) -> usize {
    (value.to_bits() >> SHIFT) as usize
}

/// A multiple of one, three and four channels and of the SIMD lanes.
const LANES: usize = 24;

/// Range of the samples i, i + 24, i + 48 .. for each i below 24; NaN left out.
fn lane_ranges(row: &[f32]) -> [CoefficientRange; LANES] {
    let (mut min, mut max) = ([f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]);
    let chunks = row.chunks_exact(LANES);
    for (lane, value) in chunks.remainder().iter().enumerate() {
        (min[lane], max[lane]) = (min[lane].min(*value), max[lane].max(*value));
    }
    for chunk in chunks {
        for lane in 0..LANES {
            // Comparisons, not f32::min: those compile to one instruction a vector.
            min[lane] = if chunk[lane] < min[lane] { chunk[lane] } else { min[lane] };
            max[lane] = if chunk[lane] > max[lane] { chunk[lane] } else { max[lane] };
        }
    }
    std::array::from_fn(|lane| CoefficientRange { min: min[lane], max: max[lane] })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lopsided coefficients from -2^-40 to 2^40, a value of its own in every channel and pixel.
    fn rows(channels: usize, pixels: usize) -> Vec<f32> {
        let value = |i: usize| {
            let bits = (i as u32 + 1).wrapping_mul(0x9e37_79b9);
            let magnitude = f32::from_bits(((bits >> 26) + 100) << 23 | (bits & 0x007f_ffff));
            if i.is_multiple_of(3) { -magnitude } else { magnitude }
        };
        (0..channels * pixels).map(value).collect()
    }

    #[test]
    fn every_coefficient_is_in_its_bucket_and_the_ends_are_exact() {
        for channels in [1, 3, 4] {
            let row = rows(channels, 1001);
            let mut counters = vec![CoefficientCounter::new(); channels];
            CoefficientCounter::add_interleaved(&mut counters, &row, 0);
            for (channel, counter) in counters.iter().enumerate() {
                let distribution = counter.distribution();
                let mut values: Vec<f32> = row[channel..].iter().step_by(channels).copied().collect();
                values.sort_by(f32::total_cmp);
                let range = distribution.range();
                assert_eq!((range.min, range.max), (values[0], values[1000]), "{channels} {channel}");
                assert_eq!(distribution.count(), 1001);
                // Buckets rise and take the sorted values one after another.
                let mut rest = &values[..];
                for bucket in distribution.buckets() {
                    let (own, others) = rest.split_at(bucket.count as usize);
                    assert!(own.iter().all(|v| (bucket.lower..=bucket.upper).contains(v)), "{bucket:?}");
                    assert!(bucket.upper - bucket.lower <= own[0].abs() / 32.0, "{bucket:?}");
                    rest = others;
                }
                assert!(rest.is_empty());
            }
        }
    }

    #[test]
    fn zeros_of_both_signs_and_denormals_are_near_zero_and_the_largest_float_is_finite() {
        let mut one = [CoefficientCounter::new()];
        let row = [0.0, -0.0, 1e-45, -1e-45, f32::MAX, f32::MIN];
        CoefficientCounter::add_interleaved(&mut one, &row, 0);
        let distribution = one[0].distribution();
        let buckets: Vec<Bucket> = distribution.buckets().collect();
        let counts: Vec<u64> = buckets.iter().map(|bucket| bucket.count).collect();
        assert_eq!(counts, [1, 2, 2, 1]);
        assert!(buckets[1].lower > -1e-38 && buckets[2].upper < 1e-38, "{buckets:?}");
        assert_eq!((buckets[0].lower, buckets[3].upper), (f32::MIN, f32::MAX));
        assert_eq!(distribution.first_not_finite(), None);
    }

    #[test]
    fn spans_in_any_order_give_the_same() {
        let mut row = rows(3, 500);
        row[3 * 77 + 1] = f32::NAN;
        row[3 * 400 + 1] = f32::INFINITY;
        let of = |spans: &[(usize, usize)]| {
            let mut counters = vec![CoefficientCounter::new(); 3];
            for &(first, end) in spans {
                CoefficientCounter::add_interleaved(&mut counters, &row[3 * first..3 * end], first);
            }
            counters
        };
        let whole = of(&[(0, 500)]);
        assert!(whole == of(&[(410, 500), (78, 410), (0, 7), (7, 78)]));
        assert_eq!(whole.iter().map(|counter| counter.distribution().count()).sum::<u64>(), 1500);
    }

    #[test]
    fn a_coefficient_that_is_no_number_is_named_by_its_pixel() {
        for bad in [f32::NAN, -f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for pixel in [0, 24, 76, 99] {
                let mut row = rows(3, 100);
                row[3 * pixel + 2] = bad;
                row[3 * 99 + 2] = bad;
                let mut counters = vec![CoefficientCounter::new(); 3];
                CoefficientCounter::add_interleaved(&mut counters, &row, 5000);
                let distributions: Vec<_> = counters.iter().map(CoefficientCounter::distribution).collect();
                let found = distributions.iter().map(CoefficientDistribution::first_not_finite);
                assert_eq!(found.collect::<Vec<_>>(), [None, None, Some(5000 + pixel)]);
                let finite: u64 = distributions[2].buckets().map(|bucket| bucket.count).sum();
                assert_eq!(finite, if pixel == 99 { 99 } else { 98 });
            }
        }
    }
}
