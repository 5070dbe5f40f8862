//! Rows of f32 values that go through the harmonics together.
//!
//! A row is so long that loops over it are not unrolled but become vector instructions, whatever stands around them: in loops
//! over [`super::lanes::LANES`] values the compiler may make vectors of functions instead, gathered from afar.

use super::lanes::RECURSION;

/// Values in a row.
pub(crate) const ROW: usize = 64;

/// [`ROW`] values.
pub(crate) type Row = [f32; ROW];

/// Runs `$body` for each function of `$bands` bands at unit vectors, with its band, its place `l * l + l + m` and the two rows whose
/// product by value it is; `$start` is what all functions are multiplied by.
///
/// A macro, since closures may be compiled without the CPU level's instructions.
macro_rules! for_each_function {
    ($bands:expr, $direction:expr, $start:expr, |$l:ident, $at:ident, $a:ident, $b:ident| $body:expr) => {{
        let [x, y, z]: &[Row; 3] = $direction;
        let (mut cos_m, mut sin_m): (Row, Row) = ($start, [0.0; ROW]);
        for m in 0..$bands {
            let [mut before, mut current]: [&mut Row; 2] = [&mut [0.0; ROW], &mut first(m)];
            for $l in m..$bands {
                let middle = $l * $l + $l;
                {
                    let ($at, $a, $b): (usize, &Row, &Row) = (middle + m, current, &cos_m);
                    $body
                }
                if m > 0 {
                    let ($at, $a, $b): (usize, &Row, &Row) = (middle - m, current, &sin_m);
                    $body
                }
                step(m, $l, z, current, before);
                std::mem::swap(&mut before, &mut current);
            }
            turn(x, y, &mut cos_m, &mut sin_m);
        }
    }};
}
pub(crate) use for_each_function;

/// The function of band m.
#[inline(always)]
pub(crate) fn first(m: usize) -> Row {
    [RECURSION.sectoral[m]; ROW]
}

/// Puts the function of the next band where that of the band before stood.
#[inline(always)]
pub(crate) fn step(m: usize, l: usize, z: &Row, current: &Row, before: &mut Row) {
    let (a, ab) = RECURSION.steps[m][l];
    for i in 0..ROW {
        before[i] = a * (z[i] * current[i]) - ab * before[i];
    }
}

/// From m to m + 1.
#[inline(always)]
pub(crate) fn turn(x: &Row, y: &Row, cos_m: &mut Row, sin_m: &mut Row) {
    for i in 0..ROW {
        let next = x[i] * cos_m[i] - y[i] * sin_m[i];
        sin_m[i] = y[i] * cos_m[i] + x[i] * sin_m[i];
        cos_m[i] = next;
    }
}

#[inline(always)]
pub(crate) fn add_product(sum: &mut Row, a: &Row, b: &Row) {
    for i in 0..ROW {
        sum[i] += a[i] * b[i];
    }
}

#[inline(always)]
pub(crate) fn put_product(out: &mut Row, a: &Row, b: &Row) {
    for i in 0..ROW {
        out[i] = a[i] * b[i];
    }
}
