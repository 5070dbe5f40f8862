//! The middle of values.

use std::cmp::Ordering;

/// The value that half of `values` come before, the later of the two middle ones where their number is even; `None`
/// for none. Puts `values` in another order.
pub fn median<T: Copy>(values: &mut [T], compare: impl FnMut(&T, &T) -> Ordering) -> Option<T> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, compare).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_later_of_two_middles_is_taken() {
        assert_eq!(median(&mut [5.0, -1.0, 9.0, 2.0], f64::total_cmp), Some(5.0));
        assert_eq!(median(&mut [5.0, -1.0, 2.0], f64::total_cmp), Some(2.0));
        assert_eq!(median(&mut [], f64::total_cmp), None);
    }
}
