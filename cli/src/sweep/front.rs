//! The choices that no other one beats.

/// For each point, a cost and a figure of quality, whether it is on the Pareto front: no other point costs at most as
/// much and is at least as good, and better in one of the two. Points that are alike are on it together.
///
/// A cost that is not a number keeps its point off the front.
pub(crate) fn front(points: &[(f64, f64)]) -> Vec<bool> {
    let beats = |(cost, quality): (f64, f64), (other_cost, other_quality): (f64, f64)| {
        cost <= other_cost && quality >= other_quality && (cost < other_cost || quality > other_quality)
    };
    points
        .iter()
        .map(|&point| {
            !point.0.is_nan() && !point.1.is_nan() && !points.iter().any(|&other| beats(other, point))
        })
        .collect()
}

/// The cheapest point of at least that quality, the better and then the first among equals.
pub(crate) fn cheapest(points: &[(f64, f64)], least: f64) -> Option<usize> {
    let good = points.iter().enumerate().filter(|(_, point)| point.1 >= least && !point.0.is_nan());
    good.min_by(|(_, a), (_, b)| a.0.total_cmp(&b.0).then(b.1.total_cmp(&a.1))).map(|(index, _)| index)
}

/// The best point of at most that cost, the cheaper and then the first among equals.
pub(crate) fn best_within(points: &[(f64, f64)], most: f64) -> Option<usize> {
    let cheap = points.iter().enumerate().filter(|(_, point)| point.0 <= most && !point.1.is_nan());
    cheap.min_by(|(_, a), (_, b)| b.1.total_cmp(&a.1).then(a.0.total_cmp(&b.0))).map(|(index, _)| index)
}

#[cfg(test)]
mod tests {
    use super::*;

    const POINTS: [(f64, f64); 7] =
        [(4.0, 20.0), (4.0, 21.0), (6.0, 21.0), (6.0, 24.0), (6.0, 24.0), (1.0, 12.0), (9.0, 23.0)];

    #[test]
    fn what_another_choice_beats_is_not_on_the_front() {
        assert_eq!(front(&POINTS), [false, true, false, true, true, true, false]);
        assert_eq!(front(&[(f64::NAN, 50.0), (1.0, f64::NAN), (2.0, 3.0)]), [false, false, true]);
        assert!(front(&[]).is_empty());
    }

    #[test]
    fn targets_take_the_cheapest_that_reaches_and_the_best_that_fits() {
        assert_eq!(cheapest(&POINTS, 20.5), Some(1));
        assert_eq!(cheapest(&POINTS, 21.5), Some(3));
        assert_eq!(cheapest(&POINTS, 24.5), None);
        assert_eq!(best_within(&POINTS, 6.0), Some(3));
        assert_eq!(best_within(&POINTS, 5.0), Some(1));
        assert_eq!(best_within(&POINTS, 0.5), None);
    }
}
