//! Where the ticks of a plot's axis stand, and what they say.

/// A range of values and how it is laid out.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Axis {
    /// The value at the beginning of the axis.
    pub(crate) least: f64,
    /// The value at its end, above `least`.
    pub(crate) most: f64,
    /// Whether equal lengths are equal ratios.
    pub(crate) logarithmic: bool,
    /// Values between them with their labels, rising.
    pub(crate) ticks: Vec<(f64, String)>,
}

/// Ratio of largest to least value from which an axis is logarithmic: below it, the least still has a tenth of the length.
const LOGARITHMIC_FROM: f64 = 10.0;

/// Steps on an axis, about.
const STEPS: f64 = 5.0;

impl Axis {
    /// An axis that holds all `values` with a margin; with `may_be_logarithmic`, ratios decide where values are positive and
    /// far apart.
    pub(crate) fn of(values: &[f64], may_be_logarithmic: bool) -> Self {
        let finite = || values.iter().copied().filter(|value| value.is_finite());
        let (least, most) =
            finite().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        let (least, most) = if least <= most { (least, most) } else { (0.0, 1.0) };
        if may_be_logarithmic && least > 0.0 && most / least >= LOGARITHMIC_FROM {
            return Self::logarithmic(least, most);
        }
        let step = round_step((most - least) / STEPS);
        // A single value stands in the middle of an axis of its own scale.
        let step = if step > 0.0 { step } else { round_step(most.abs() / STEPS).max(1e-6) };
        let (first, last) = ((least / step - 0.25).floor(), (most / step + 0.25).ceil());
        let decimals = decimals_of(step);
        let ticks = (0..=(last - first) as usize).map(|i| (first + i as f64) * step);
        let ticks = ticks.map(|value| (value, format!("{:.decimals$}", value + 0.0))).collect();
        Self { least: first * step, most: last * step, logarithmic: false, ticks }
    }

    fn logarithmic(least: f64, most: f64) -> Self {
        let (low, high) = (least / 1.25, most * 1.25);
        let decades = libm::log10(high / low);
        let mantissas: &[f64] = match decades {
            d if d > 4.0 => &[1.0],
            d if d > 2.0 => &[1.0, 3.0],
            _ => &[1.0, 2.0, 5.0],
        };
        let (from, to) = (libm::floor(libm::log10(low)) as i32, libm::ceil(libm::log10(high)) as i32);
        let candidates = (from..=to).flat_map(|decade| mantissas.iter().map(move |m| (decade, *m)));
        let ticks = candidates
            .map(|(decade, mantissa)| (mantissa * libm::pow(10.0, f64::from(decade)), decade))
            .filter(|(value, _)| (low..=high).contains(value))
            .map(|(value, decade)| (value, format!("{value:.0$}", (-decade).max(0) as usize)))
            .collect();
        Self { least: low, most: high, logarithmic: true, ticks }
    }

    /// Where `value` lies: 0 at the beginning, 1 at the end.
    pub(crate) fn place(&self, value: f64) -> f64 {
        match self.logarithmic {
            true => libm::log(value / self.least) / libm::log(self.most / self.least),
            false => (value - self.least) / (self.most - self.least),
        }
    }
}

/// The next of 1, 2 and 5 times a power of ten from `step` upwards; 0 for 0.
fn round_step(step: f64) -> f64 {
    if step <= 0.0 {
        return 0.0;
    }
    let power = libm::pow(10.0, libm::floor(libm::log10(step)));
    let round = [1.0, 2.0, 5.0].into_iter().find(|round| step <= round * power * (1.0 + 1e-9));
    power * round.unwrap_or(10.0)
}

/// Decimals that tell multiples of `step` apart.
fn decimals_of(step: f64) -> usize {
    (-libm::floor(libm::log10(step) + 1e-9)).max(0.0) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(axis: &Axis) -> Vec<&str> {
        axis.ticks.iter().map(|(_, label)| label.as_str()).collect()
    }

    #[test]
    fn ticks_are_round_and_hold_the_values() {
        let axis = Axis::of(&[27.3, 38.1, 31.0], true);
        assert_eq!(labels(&axis), ["25", "30", "35", "40"]);
        assert_eq!((axis.least, axis.most, axis.logarithmic), (25.0, 40.0, false));
        assert_eq!(axis.place(32.5), 0.5);
        assert_eq!(
            labels(&Axis::of(&[0.011, 0.019], false)),
            ["0.010", "0.012", "0.014", "0.016", "0.018", "0.020"]
        );
        assert_eq!(
            labels(&Axis::of(&[-0.4, 0.5], false)),
            ["-0.6", "-0.4", "-0.2", "0.0", "0.2", "0.4", "0.6"]
        );
    }

    #[test]
    fn far_apart_values_have_a_logarithmic_axis() {
        let axis = Axis::of(&[2.5, 60.0], true);
        assert!(axis.logarithmic);
        assert_eq!(labels(&axis), ["2", "5", "10", "20", "50"]);
        assert!((axis.place(axis.least * 10.0) - 1.0 / libm::log10(axis.most / axis.least)).abs() < 1e-12);
        let labels_of_decades = ["0.01", "0.03", "0.1", "0.3", "1", "3", "10"];
        assert_eq!(labels(&Axis::of(&[0.004, 9.0], true)), labels_of_decades);
        // Zero has no logarithm.
        assert!(!Axis::of(&[0.0, 1000.0], true).logarithmic);
        assert!(!Axis::of(&[2.5, 60.0], false).logarithmic);
    }

    #[test]
    fn one_value_and_none_have_an_axis() {
        for values in [&[7.0][..], &[0.0], &[], &[f64::INFINITY, f64::NAN]] {
            let axis = Axis::of(values, true);
            assert!(axis.least < axis.most && axis.ticks.len() >= 2, "{values:?} {axis:?}");
            assert!(
                axis.ticks.iter().all(|(value, _)| (0.0..=1.0).contains(&axis.place(*value))),
                "{axis:?}"
            );
            let inside = values
                .iter()
                .filter(|value| value.is_finite())
                .all(|v| (0.0..=1.0).contains(&axis.place(*v)));
            assert!(inside, "{values:?} {axis:?}");
        }
    }
}
