//! Which pictures are left out of a fit to judge it.

use relight_core::SplitMix64;
use std::path::PathBuf;
use std::str::FromStr;

/// `every:N`, `random:N[:seed]` or a light file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Holdout {
    /// Pictures floor(N/2), floor(N/2) + N, ... from 0, in the order of the light file.
    Every(usize),
    /// N pictures drawn without replacement.
    Random { count: usize, seed: u64 },
    /// The pictures of a light file, in the capture or not.
    File(PathBuf),
}

impl FromStr for Holdout {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let forms = "write every:N (N from 2), random:N, random:N:SEED or the name of a .lp file";
        let number = |text: &str, least: usize| {
            let number = text.parse::<usize>().ok().filter(|&n| n >= least);
            number.ok_or_else(|| format!("'{text}' is not a number from {least}; {forms}"))
        };
        let parts: Vec<_> = text.split(':').collect();
        match parts[..] {
            ["every", n] => Ok(Self::Every(number(n, 2)?)),
            ["random", n] => Ok(Self::Random { count: number(n, 1)?, seed: 1 }),
            ["random", n, seed] => {
                let seed = seed.parse().map_err(|_| format!("seed '{seed}' is not a number; {forms}"))?;
                Ok(Self::Random { count: number(n, 1)?, seed })
            }
            _ if text.to_ascii_lowercase().ends_with(".lp") => Ok(Self::File(text.into())),
            _ => Err(format!("'{text}' names no hold-out; {forms}")),
        }
    }
}

impl Holdout {
    /// Indices of the pictures left out of `count`, rising; empty for a file.
    pub(crate) fn indices(&self, count: usize) -> Vec<usize> {
        match *self {
            Self::Every(n) => (n / 2..count).step_by(n).collect(),
            Self::Random { count: drawn, seed } => {
                let mut order: Vec<usize> = (0..count).collect();
                let mut random = SplitMix64::new(seed);
                for i in 0..drawn.min(count) {
                    let rest = (count - i) as u64;
                    order.swap(i, i + (random.bits() % rest) as usize);
                }
                order.truncate(drawn.min(count));
                order.sort_unstable();
                order
            }
            Self::File(_) => Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_sixth_starts_in_the_middle() {
        assert_eq!("every:6".parse::<Holdout>().unwrap().indices(20), vec![3, 9, 15]);
        assert_eq!("every:5".parse::<Holdout>().unwrap().indices(8), vec![2, 7]);
    }

    #[test]
    fn random_draws_are_repeatable_distinct_and_differ_by_seed() {
        let draw = |text: &str| text.parse::<Holdout>().unwrap().indices(50);
        let first = draw("random:10");
        assert_eq!(first, draw("random:10:1"));
        assert_ne!(first, draw("random:10:2"));
        assert_eq!(first.len(), 10);
        assert!(first.windows(2).all(|w| w[0] < w[1]) && first[9] < 50);
        assert_eq!(draw("random:80").len(), 50);
    }

    #[test]
    fn what_is_no_holdout_is_refused() {
        for text in ["every:1", "every:x", "every", "random:0", "random:3:x", "lights.txt", ""] {
            assert!(text.parse::<Holdout>().is_err(), "{text}");
        }
        assert_eq!("a/b c.LP".parse(), Ok(Holdout::File("a/b c.LP".into())));
    }
}
