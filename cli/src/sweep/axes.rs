//! The grid of choices: which families, how many functions, how stored.

use crate::bake::textures::TextureOptions;
use crate::failure::Failure;
use relight_core::Family;
use relight_core::basis::{Counts, FAMILIES};
use std::str::FromStr;

/// Numbers of functions that are tried where none are named: few enough for a table, from small to what a capture of
/// some sixty lights carries.
const COUNTS: [(&str, &[usize]); 5] =
    [("ptm", &[6]), ("sh", &[9, 25]), ("hsh", &[16]), ("srbf", &[25, 49]), ("pca", &[9, 18, 27])];

/// What a value of an axis is called on the command line of `bake`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Axes {
    /// `None` for all families.
    basis: Option<Vec<String>>,
    /// `None` for those of [`COUNTS`].
    counts: Option<Vec<usize>>,
    precision: Vec<Option<String>>,
    block: Vec<Option<String>>,
    quality: Vec<Option<String>>,
}

/// A choice: a basis and how its planes are stored; `None` for what `bake` takes by itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct GridPoint {
    pub(crate) basis: &'static str,
    pub(crate) count: usize,
    pub(crate) precision: Option<String>,
    pub(crate) block: Option<String>,
    pub(crate) quality: Option<String>,
}

impl Default for Axes {
    fn default() -> Self {
        Self {
            basis: None,
            counts: None,
            precision: vec![None],
            block: vec![None, Some("bc1".to_owned()), Some("bc7".to_owned())],
            quality: vec![None],
        }
    }
}

impl FromStr for Axes {
    type Err = String;

    /// Reads `basis,k,block=none/bc7`: the axes that vary, each alone for its usual values or with its own.
    fn from_str(text: &str) -> Result<Self, String> {
        let forms = "write some of basis,k,precision,block,quality, each alone or with values: basis=sh/srbf,k=9/16,block=none/bc7";
        let usual = Self::default();
        let mut axes = Self {
            basis: Some(vec!["ptm".to_owned()]),
            counts: None,
            precision: vec![None],
            block: vec![None],
            quality: vec![None],
        };
        let mut counts_vary = false;
        let mut seen = Vec::new();
        for part in text.split(',').map(str::trim) {
            let (axis, values) = match part.split_once('=') {
                Some((axis, values)) => {
                    (axis, Some(values.split('/').map(str::to_owned).collect::<Vec<_>>()))
                }
                None => (part, None),
            };
            if seen.contains(&axis) {
                return Err(format!("the axis {axis} is there twice; {forms}"));
            }
            seen.push(axis);
            let some = |values: Vec<String>| values.into_iter().map(Some).collect();
            let named = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
            match axis {
                "basis" => axes.basis = values,
                "k" => {
                    counts_vary = true;
                    let number = |text: String| match text.parse::<usize>() {
                        Ok(count) if count > 0 => Ok(count),
                        _ => Err(format!("'{text}' is no number of functions; {forms}")),
                    };
                    axes.counts =
                        values.map(|values| values.into_iter().map(number).collect()).transpose()?;
                }
                "precision" => axes.precision = some(values.unwrap_or_else(|| named(&["u8", "f16"]))),
                "block" => axes.block = values.map_or(usual.block.clone(), some),
                "quality" => {
                    axes.quality = some(values.unwrap_or_else(|| named(&["fast", "normal", "high"])))
                }
                _ => return Err(format!("there is no axis '{axis}'; {forms}")),
            }
        }
        if !counts_vary {
            axes.counts = Some(Vec::new());
        }
        Ok(axes)
    }
}

impl Axes {
    /// The usual axes but for those that options pin; of a family that is pinned alone, all its sizes.
    pub(crate) fn free(basis: Option<&str>, count: Option<usize>, textures: &TextureOptions) -> Self {
        let usual = Self::default();
        Self {
            basis: basis.map(|name| vec![name.to_owned()]),
            counts: count.map(|count| vec![count]).or(basis.and_then(all_counts)),
            block: if textures.asks_for_storage() { vec![None] } else { usual.block.clone() },
            ..usual
        }
    }

    /// The choices, in the order of families, counts, precisions, blocks and qualities.
    ///
    /// # Errors
    /// Exit code 2 for a family that there isn't, and where no family has one of the counts.
    pub(crate) fn grid(&self) -> Result<Vec<GridPoint>, Failure> {
        let families: Vec<&'static Family> = match &self.basis {
            None => FAMILIES.iter().collect(),
            Some(names) => names
                .iter()
                .map(|name| crate::function_options::family_of_name(name))
                .collect::<Result<_, _>>()?,
        };
        let mut points = Vec::new();
        for family in families {
            for count in self.counts_of(family) {
                for precision in &self.precision {
                    for block in &self.block {
                        for quality in &self.quality {
                            let blocks = block.as_ref().is_some_and(|block| block != "none");
                            // Blocks have a precision of their own, and only they have a quality.
                            let (first_precision, first_quality) = (&self.precision[0], &self.quality[0]);
                            if (blocks && precision != first_precision)
                                || (!blocks && quality != first_quality)
                            {
                                continue;
                            }
                            points.push(GridPoint {
                                basis: family.name,
                                count,
                                precision: precision.clone().filter(|_| !blocks),
                                block: block.clone().filter(|_| blocks),
                                quality: quality.clone().filter(|_| blocks),
                            });
                        }
                    }
                }
            }
        }
        if points.is_empty() {
            let counts = self.counts.iter().flatten().map(usize::to_string).collect::<Vec<_>>().join("/");
            return Err(Failure::usage(format!(
                "--axes: none of the families has {counts} functions; ptm has 6, 10 and 15, sh and hsh squares, srbf and pca any"
            )));
        }
        Ok(points)
    }

    fn counts_of(&self, family: &Family) -> Vec<usize> {
        let has = |count: usize| family.counts.contains(count);
        match &self.counts {
            Some(counts) if counts.is_empty() => vec![family.default_count],
            Some(counts) => counts.iter().copied().filter(|&count| has(count)).collect(),
            None => {
                let usual = COUNTS.iter().find(|(name, _)| *name == family.name);
                usual.map_or(vec![family.default_count], |(_, counts)| counts.to_vec())
            }
        }
    }
}

/// All numbers of functions of a family, where they are a list.
fn all_counts(basis: &str) -> Option<Vec<usize>> {
    match Family::by_name(basis)?.counts {
        Counts::Listed(list) => Some(list.to_vec()),
        Counts::UpTo(_) => None,
    }
}

impl GridPoint {
    /// A name for files and tables: `sh-25`, `pca-18-bc7`, `srbf-16-bc7-best`, `ptm-6-f16`.
    pub(crate) fn name(&self) -> String {
        let parts = [&self.precision, &self.block, &self.quality].into_iter().flatten();
        let mut name = format!("{}-{}", self.basis, self.count);
        for part in parts {
            name.push('-');
            name.push_str(part);
        }
        name
    }

    /// The options of `bake` that make it.
    pub(crate) fn flags(&self) -> Vec<String> {
        let mut flags =
            vec!["--basis".to_owned(), self.basis.to_owned(), "-k".to_owned(), self.count.to_string()];
        for (flag, value) in
            [("--precision", &self.precision), ("--block", &self.block), ("--quality", &self.quality)]
        {
            flags.extend(value.iter().flat_map(|value| [flag.to_owned(), value.clone()]));
        }
        flags
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(axes: &str) -> Vec<String> {
        axes.parse::<Axes>().unwrap().grid().unwrap().iter().map(GridPoint::name).collect()
    }

    #[test]
    fn every_axis_varies_alone_or_with_values() {
        assert_eq!(names("k"), ["ptm-6"]);
        assert_eq!(names("k=6/9/10"), ["ptm-6", "ptm-10"]);
        assert_eq!(names("basis=sh/srbf,k=9/16/18"), ["sh-9", "sh-16", "srbf-9", "srbf-16", "srbf-18"]);
        assert_eq!(names("basis=hsh,block=none/bc1"), ["hsh-9", "hsh-9-bc1"]);
        assert_eq!(names("precision"), ["ptm-6-u8", "ptm-6-f16"]);
        // Blocks have no precision, plain texels no quality.
        let both = names("precision=u8/f16,block=none/bc7,quality=fast/best");
        assert_eq!(both, ["ptm-6-u8", "ptm-6-bc7-fast", "ptm-6-bc7-best", "ptm-6-f16"]);
        let usual = Axes::default().grid().unwrap();
        assert_eq!(usual.len(), 27);
        assert_eq!(usual[5].flags(), ["--basis", "sh", "-k", "9", "--block", "bc7"]);
    }

    #[test]
    fn what_is_no_axis_is_refused() {
        for text in ["", "colour", "k=x", "k=0", "basis,basis", "basis=sh,,k"] {
            assert!(text.parse::<Axes>().is_err(), "{text}");
        }
        assert!("basis=ptm,k=7".parse::<Axes>().unwrap().grid().is_err());
        assert!("basis=fourier".parse::<Axes>().unwrap().grid().is_err());
    }
}
