//! Which format each map gets: the least error for the bits, or the fewest bits for the error.

use crate::TexelFormat;
use std::fmt;

/// A format that a map may have, with what it costs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// How texels lie in memory.
    pub format: TexelFormat,
    /// Bits a pixel, over all layers of the map.
    pub bits: f64,
    /// Mean squared error of the relit picture that it causes: over the map's planes, the sum of the squares
    /// of [`PackReport::plane_relit_rmse`](crate::PackReport::plane_relit_rmse).
    pub error: f64,
}

/// What bounds a choice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Budget {
    /// Bits a pixel of all maps.
    BitsPerPixel(f64),
    /// Mean squared error of the relit picture.
    Error(f64),
}

/// Why no choice was made.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum ChoiceError {
    /// Even the smallest formats take more.
    BitsPerPixel {
        /// What they take.
        needed: f64,
        /// What was allowed.
        asked: f64,
    },
    /// Even the best formats err more.
    Error {
        /// The root mean square that they reach.
        least: f64,
        /// The root mean square that was allowed.
        asked: f64,
    },
    /// A map without a candidate of finite bits and error.
    NoCandidate {
        /// Its index.
        map: usize,
    },
}

impl fmt::Display for ChoiceError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::BitsPerPixel { needed, asked } => {
                write!(f, "{asked} bits a pixel are too few: the smallest formats take {needed}")
            }
            Self::Error { least, asked } => {
                write!(f, "no choice of formats errs as little as {asked}: the best errs by {least}")
            }
            Self::NoCandidate { map } => write!(f, "map {map} has no format to choose from"),
        }
    }
}

impl std::error::Error for ChoiceError {}

/// Parts of a bit that sums of bits are told apart by: candidates take halves, thirds or quarters of
/// a bit at the finest.
const PARTS_OF_A_BIT: f64 = 12.0;

/// Sums that differ by rounding only are equal.
const ROUNDING: f64 = 1e-9;

/// A choice for all maps so far that no other beats in both bits and error.
#[derive(Clone, Copy)]
struct Partial {
    /// Bits in parts, rounded: what equal choices have in common.
    parts: u64,
    bits: f64,
    error: f64,
    /// Index among the choices for the maps before, and the candidate taken for the last map.
    before: usize,
    candidate: usize,
}

/// One index into `maps[i]` for each map: the least total error within
/// [`Budget::BitsPerPixel`], or the fewest bits within [`Budget::Error`].
///
/// Errors of different maps are taken to be independent, so that their squares add up. The choice is
/// the best one: map by map, of all choices that take equally many bits only the one of least error is
/// kept, and there are few sums of bits. Of equal choices the one that names earlier candidates wins.
/// Candidates whose bits or error are not finite are never chosen.
///
/// # Errors
/// [`ChoiceError`] when nothing fits, with what would.
pub fn choose_formats(maps: &[Vec<Candidate>], budget: Budget) -> Result<Vec<usize>, ChoiceError> {
    let mut fronts = vec![vec![Partial { parts: 0, bits: 0.0, error: 0.0, before: 0, candidate: 0 }]];
    for (map, candidates) in maps.iter().enumerate() {
        let front = extended(&fronts[map], candidates);
        if front.is_empty() {
            return Err(ChoiceError::NoCandidate { map });
        }
        fronts.push(front);
    }
    // Bits rise and errors fall along a front.
    let all = &fronts[maps.len()];
    let slack = |limit: f64| limit + ROUNDING * limit.abs();
    let mut chosen = match budget {
        Budget::BitsPerPixel(asked) => {
            let fit = all.iter().rposition(|choice| choice.bits <= slack(asked));
            fit.ok_or(ChoiceError::BitsPerPixel { needed: all[0].bits, asked })?
        }
        Budget::Error(asked) => {
            let fit = all.iter().position(|choice| choice.error <= slack(asked));
            let least = all[all.len() - 1].error.sqrt();
            fit.ok_or(ChoiceError::Error { least, asked: asked.max(0.0).sqrt() })?
        }
    };
    let mut candidates = vec![0; maps.len()];
    for (front, candidate) in fronts[1..].iter().zip(&mut candidates).rev() {
        *candidate = front[chosen].candidate;
        chosen = front[chosen].before;
    }
    Ok(candidates)
}

/// Every choice of `front` with every candidate, without those that another beats.
fn extended(front: &[Partial], candidates: &[Candidate]) -> Vec<Partial> {
    let usable = |c: &&Candidate| c.bits.is_finite() && c.error.is_finite() && c.bits >= 0.0;
    let mut all: Vec<Partial> = Vec::with_capacity(front.len() * candidates.len());
    for (index, candidate) in candidates.iter().enumerate().filter(|(_, c)| usable(c)) {
        all.extend(front.iter().enumerate().map(|(before, choice)| Partial {
            parts: choice.parts.saturating_add((candidate.bits * PARTS_OF_A_BIT).round() as u64),
            bits: choice.bits + candidate.bits,
            error: choice.error + candidate.error,
            before,
            candidate: index,
        }));
    }
    // Stable: of equal ones the first stays first.
    all.sort_by(|a, b| a.parts.cmp(&b.parts).then(a.error.total_cmp(&b.error)));
    let mut least = f64::INFINITY;
    all.retain(|choice| {
        let better = choice.error < least;
        least = least.min(choice.error);
        better
    });
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BlockFormat, Precision, TexelFormat};

    fn candidate(bits: f64, error: f64) -> Candidate {
        let format = TexelFormat::Plain { precision: Precision::U8, channels: 4 };
        Candidate { format, bits, error }
    }

    /// Numbers below 1, the same each time.
    fn random(seed: u64) -> impl FnMut() -> f64 {
        let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) + 1;
        move || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) as f64 / (1u64 << 53) as f64
        }
    }

    fn sums(maps: &[Vec<Candidate>], choice: &[usize]) -> (f64, f64) {
        let chosen = maps.iter().zip(choice).map(|(map, &index)| map[index]);
        chosen.fold((0.0, 0.0), |(bits, error), c| (bits + c.bits, error + c.error))
    }

    /// Every choice there is.
    fn every_choice(maps: &[Vec<Candidate>]) -> Vec<Vec<usize>> {
        maps.iter().fold(vec![Vec::new()], |choices, map| {
            let longer = |choice: &Vec<usize>| {
                (0..map.len()).map(|index| [&choice[..], &[index]].concat()).collect::<Vec<_>>()
            };
            choices.iter().flat_map(longer).collect()
        })
    }

    #[test]
    fn no_other_choice_is_better() {
        for seed in 0..60 {
            let mut next = random(seed);
            let maps: Vec<Vec<Candidate>> = (0..1 + seed as usize % 6)
                .map(|_| {
                    let bits = [4.0, 8.0, 8.0 / 3.0, 12.5, 32.0];
                    let count = 1 + (next() * 5.0) as usize;
                    bits[..count].iter().map(|bits| candidate(*bits, next() * 1e-3 / bits)).collect()
                })
                .collect();
            let all: Vec<(f64, f64)> = every_choice(&maps).iter().map(|choice| sums(&maps, choice)).collect();
            for _ in 0..20 {
                let (bits, error) = all[(next() * all.len() as f64) as usize];
                let found = sums(&maps, &choose_formats(&maps, Budget::BitsPerPixel(bits)).unwrap());
                let within = all.iter().filter(|sums| sums.0 <= bits + 1e-9);
                let best = within.map(|sums| sums.1).fold(f64::INFINITY, f64::min);
                assert!(found.0 <= bits + 1e-9 && found.1 <= best + 1e-15, "{found:?} {bits} {best}");
                let found = sums(&maps, &choose_formats(&maps, Budget::Error(error)).unwrap());
                let within = all.iter().filter(|sums| sums.1 <= error * (1.0 + 1e-12));
                let best = within.map(|sums| sums.0).fold(f64::INFINITY, f64::min);
                assert!(
                    found.1 <= error * (1.0 + 1e-9) && found.0 <= best + 1e-9,
                    "{found:?} {error} {best}"
                );
            }
        }
    }

    #[test]
    fn bits_go_to_the_maps_whose_error_shows() {
        // BC1 or BC7; the second map's error matters a hundred times as much.
        let format = |format| TexelFormat::Block(format);
        let map = |weight: f64| {
            vec![
                Candidate { format: format(BlockFormat::Bc1), bits: 4.0, error: weight * 1e-4 },
                Candidate { format: format(BlockFormat::Bc7), bits: 8.0, error: weight * 1e-5 },
            ]
        };
        let maps = [map(1.0), map(100.0), map(2.0)];
        assert_eq!(choose_formats(&maps, Budget::BitsPerPixel(12.0)), Ok(vec![0, 0, 0]));
        assert_eq!(choose_formats(&maps, Budget::BitsPerPixel(19.9)), Ok(vec![0, 1, 0]));
        assert_eq!(choose_formats(&maps, Budget::BitsPerPixel(20.0)), Ok(vec![0, 1, 1]));
        assert_eq!(choose_formats(&maps, Budget::BitsPerPixel(f64::INFINITY)), Ok(vec![1, 1, 1]));
        let needed = choose_formats(&maps, Budget::BitsPerPixel(11.0));
        assert_eq!(needed, Err(ChoiceError::BitsPerPixel { needed: 12.0, asked: 11.0 }));
        let refused = choose_formats(&maps, Budget::Error(1e-6)).unwrap_err();
        let least = ((1.0 + 100.0 + 2.0) * 1e-5f64).sqrt();
        assert!(matches!(refused, ChoiceError::Error { least: l, .. } if (l - least).abs() < 1e-12));
    }

    #[test]
    fn equal_candidates_are_taken_in_order_and_unusable_ones_never() {
        let map = vec![candidate(8.0, f64::NAN), candidate(8.0, 1e-5), candidate(8.0, 1e-5)];
        let maps = [map.clone(), map];
        assert_eq!(choose_formats(&maps, Budget::BitsPerPixel(16.0)), Ok(vec![1, 1]));
        let none = [vec![candidate(4.0, 1.0)], vec![candidate(f64::INFINITY, 0.0)], Vec::new()];
        assert_eq!(choose_formats(&none, Budget::Error(9.0)), Err(ChoiceError::NoCandidate { map: 1 }));
        assert_eq!(choose_formats(&[], Budget::BitsPerPixel(0.0)), Ok(Vec::new()));
    }

    #[test]
    fn the_largest_basis_is_chosen_for_at_once() {
        let mut next = random(7);
        let maps: Vec<Vec<Candidate>> = (0..131)
            .map(|_| {
                let scale = next();
                let bits = [4.0, 8.0, 16.0, 32.0, 64.0];
                bits.iter().map(|bits| candidate(*bits, scale * next() / bits)).collect()
            })
            .collect();
        let choice = choose_formats(&maps, Budget::BitsPerPixel(131.0 * 9.0)).unwrap();
        let (bits, error) = sums(&maps, &choice);
        // No exchange between any two maps lowers the error.
        assert!(bits <= 131.0 * 9.0);
        for (i, j) in (0..131).flat_map(|i| (0..i).map(move |j| (i, j))) {
            for (a, b) in (0..5).flat_map(|a| (0..5).map(move |b| (a, b))) {
                let mut other = choice.clone();
                (other[i], other[j]) = (a, b);
                let change = |m: usize| (maps[m][other[m]], maps[m][choice[m]]);
                let (x, y) = (change(i), change(j));
                let more = x.0.bits - x.1.bits + y.0.bits - y.1.bits;
                let gain = x.1.error - x.0.error + y.1.error - y.0.error;
                assert!(bits + more > 131.0 * 9.0 || gain < 1e-12 * error, "{i} {j} {a} {b}");
            }
        }
    }
}
