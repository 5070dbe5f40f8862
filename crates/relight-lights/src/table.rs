//! The papers' 1-D table of a Gaussian.
//!
//! Source: Wong et al., *Lighting Precomputation Using the Relighting Map*, figure 9, sampled where it is
//! looked up (MATH.md section 1.2: the paper's lookup puts a cosine of 1 on the table's outer edge).

use crate::path::Directions;
use relight_core::basis::Kernel;
use relight_core::{CpuLevel, Vectorized};

/// What a table is over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Argument {
    /// The cosine of the angle to the centre, -1 to 1.
    Cosine,
    /// The sine of half that angle, 0 to 1.
    HalfSine,
}

/// A Gaussian at equally spaced nodes, the first and the last at the argument's ends.
#[derive(Clone, Debug)]
pub(crate) struct Table {
    argument: Argument,
    /// The nodes, and the last once more: where the argument is at its end the next node is read, too.
    values: Vec<f32>,
}

impl Table {
    /// `nodes` values of the kernel of that spread.
    pub(crate) fn new(spread: f64, kernel: Kernel, argument: Argument, nodes: usize) -> Self {
        let nodes = nodes.max(2);
        let value = |i: usize| {
            let at = i as f64 / (nodes - 1) as f64;
            let half_sine = match argument {
                Argument::Cosine => (1.0 - at).sqrt(),
                Argument::HalfSine => at,
            };
            let exponent = match kernel {
                Kernel::Geodesic => {
                    let angle = 2.0 * libm::asin(half_sine.min(1.0));
                    -angle * angle / (2.0 * spread * spread)
                }
                Kernel::Spherical => -2.0 * half_sine * half_sine / (spread * spread),
            };
            libm::exp(exponent) as f32
        };
        let mut values: Vec<f32> = (0..nodes).map(value).collect();
        values.push(values[nodes - 1]);
        Self { argument, values }
    }

    /// Writes the Gaussian about `centre` of each direction to `row`.
    pub(crate) fn evaluate(
        &self,
        level: CpuLevel,
        directions: Directions<'_>,
        centre: [f32; 3],
        row: &mut [f32],
    ) {
        level.run(Lookup { table: self, directions, centre, row });
    }
}

struct Lookup<'a> {
    table: &'a Table,
    directions: Directions<'a>,
    centre: [f32; 3],
    row: &'a mut [f32],
}

impl Vectorized for Lookup<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Directions { x, y, z } = self.directions;
        let [a, b, c] = self.centre;
        let n = self.row.len();
        let (x, y, z) = (&x[..n], &y[..n], &z[..n]);
        let values = &self.table.values[..];
        let last = (values.len() - 2) as f32;
        let at = |i: usize, position: f32| {
            // `as` takes NaN to 0 and stays within the table.
            let position = position.max(0.0).min(last);
            let node = position as usize;
            let rest = position - node as f32;
            (i, values[node] + rest * (values[node + 1] - values[node]))
        };
        match self.table.argument {
            Argument::Cosine => {
                for i in 0..n {
                    let cosine = x[i] * a + y[i] * b + z[i] * c;
                    let (i, value) = at(i, (cosine + 1.0) * (0.5 * last));
                    self.row[i] = value;
                }
            }
            Argument::HalfSine => {
                for i in 0..n {
                    let (dx, dy, dz) = (x[i] - a, y[i] - b, z[i] - c);
                    let half_sine = (0.25 * (dx * dx + dy * dy + dz * dz)).sqrt();
                    let (i, value) = at(i, half_sine * last);
                    self.row[i] = value;
                }
            }
        }
    }
}
