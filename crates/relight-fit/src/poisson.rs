//! Weighted differences of neighbouring pixels brought into one height: conjugate gradients with a multigrid
//! preconditioner.
//!
//! Source: Saad, *Iterative Methods for Sparse Linear Systems*, algorithm 9.1; Trottenberg et al., *Multigrid*, section 5.3
//! (Galerkin coarsening with piecewise constant prolongation, corrected by 1/2 for the spacing that doubles). Rows are the unit
//! of parallel work and of sums, so the result has the same bits with any number of threads.

use rayon::prelude::*;

/// Weights of a grid's edges and their sum at each cell.
struct Level {
    width: usize,
    /// Of the edge from (x, y) to (x + 1, y); 0 in the last column.
    right: Vec<f32>,
    /// Of the edge from (x, y) to (x, y + 1); 0 in the last row.
    down: Vec<f32>,
    /// Sum of the weights of a cell's edges.
    diagonal: Vec<f32>,
}

/// The preconditioner's vectors on a level.
struct Vectors {
    right_side: Vec<f64>,
    solution: Vec<f64>,
    spare: Vec<f64>,
}

/// Part of a Jacobi step that is taken: smooths best on grids of five points.
const DAMPING: f64 = 0.8;

/// Steps before and after the coarser level's correction; as many of each keep the preconditioner symmetric.
const SMOOTHINGS: usize = 2;

/// The residual's part at which the height is exact to far below what a normal tells.
const EXACT: f64 = 1e-9;

/// Some 10 iterations reach [`EXACT`] on grids of one weight, some 20 with weights of 1 and 1/1000 side by side.
const MOST_ITERATIONS: usize = 200;

/// Bytes that [`solve`] takes a pixel, its arguments and result included: a third on top for coarser levels.
pub(crate) const BYTES_PER_PIXEL: u64 = 112;

/// Differences that a height should have.
pub(crate) struct Differences {
    /// Pixels in a row.
    pub(crate) width: usize,
    /// Height at (x + 1, y) less that at (x, y), and its weight, 0 in the last column.
    pub(crate) right: Vec<(f32, f32)>,
    /// Height at (x, y + 1) less that at (x, y), and its weight, 0 in the last row.
    pub(crate) down: Vec<(f32, f32)>,
}

/// The height of mean 0 with the least weighted sum of squared errors in its differences: no value is asked for at the edge
/// (natural boundary), so that a plane stays a plane. `check` is called once an iteration.
pub(crate) fn solve<E>(differences: Differences, check: impl Fn() -> Result<(), E>) -> Result<Vec<f64>, E> {
    let Differences { width, right, down } = differences;
    let count = right.len();
    let mut residual = vec![0.0f64; count];
    residual.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (x, sum) in row.iter_mut().enumerate() {
            let at = y * width + x;
            let flow = |(difference, weight): (f32, f32)| f64::from(difference) * f64::from(weight);
            *sum -= flow(right[at]) + flow(down[at]);
            *sum += if x > 0 { flow(right[at - 1]) } else { 0.0 };
            *sum += if y > 0 { flow(down[at - width]) } else { 0.0 };
        }
    });
    let weights = |edges: Vec<(f32, f32)>| edges.into_iter().map(|(_, weight)| weight).collect();
    let levels = levels(Level::new(width, weights(right), weights(down)));
    let mut vectors: Vec<Vectors> = levels
        .iter()
        .map(|level| {
            let zeros = vec![0.0; level.right.len()];
            Vectors { right_side: zeros.clone(), solution: zeros.clone(), spare: zeros }
        })
        .collect();

    let mut height = vec![0.0f64; count];
    let mut direction = vec![0.0f64; count];
    let mut applied = vec![0.0f64; count];
    let mut before: Option<f64> = None;
    let mut first = 0.0;
    for _ in 0..MOST_ITERATIONS {
        check()?;
        vectors[0].right_side.copy_from_slice(&residual);
        cycle(&levels, &mut vectors);
        let improved = &vectors[0].solution;
        let product = inner(&residual, improved, width);
        if before.is_none() {
            first = product;
        }
        if product.is_nan() || product <= EXACT * EXACT * first {
            break;
        }
        let keep = before.map_or(0.0, |before| product / before);
        each(&mut direction, improved, width, |d, z| z + keep * d);
        levels[0].apply(&direction, &mut applied);
        let step = product / inner(&direction, &applied, width);
        each(&mut height, &direction, width, |h, d| h + step * d);
        each(&mut residual, &applied, width, |r, a| r - step * a);
        before = Some(product);
    }
    let mean = rows_sum(&height, width, |row| row.iter().sum()) / count.max(1) as f64;
    height.par_iter_mut().for_each(|h| *h -= mean);
    Ok(height)
}

/// The grid and ever coarser ones down to a single cell.
fn levels(finest: Level) -> Vec<Level> {
    let mut levels = vec![finest];
    while let Some(last) = levels.last().filter(|level| level.right.len() > 1) {
        let coarser = last.coarser();
        levels.push(coarser);
    }
    levels
}

impl Level {
    fn new(width: usize, right: Vec<f32>, down: Vec<f32>) -> Self {
        let mut diagonal = vec![0.0f32; right.len()];
        diagonal.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            for (x, sum) in row.iter_mut().enumerate() {
                let at = y * width + x;
                *sum = right[at] + down[at];
                *sum += if x > 0 { right[at - 1] } else { 0.0 };
                *sum += if y > 0 { down[at - width] } else { 0.0 };
            }
        });
        Self { width, right, down, diagonal }
    }

    /// Cells of two by two: half the sum of the weights of the edges that cross between them.
    fn coarser(&self) -> Self {
        let (width, height) = (self.width, self.right.len() / self.width);
        let (across, along) = (width.div_ceil(2), height.div_ceil(2));
        let edge = |edges: &[f32], x: usize, y: usize| {
            if x < width && y < height { edges[y * width + x] } else { 0.0 }
        };
        let mut right = vec![0.0; across * along];
        let mut down = vec![0.0; across * along];
        for at in 0..across * along {
            let (x, y) = (2 * (at % across), 2 * (at / across));
            right[at] = 0.5 * (edge(&self.right, x + 1, y) + edge(&self.right, x + 1, y + 1));
            down[at] = 0.5 * (edge(&self.down, x, y + 1) + edge(&self.down, x + 1, y + 1));
        }
        Self::new(across, right, down)
    }

    /// Weighted differences of the cell `at` = (x, y) to its neighbours.
    #[inline(always)]
    fn at(&self, values: &[f64], x: usize, at: usize) -> f64 {
        let width = self.width;
        let mut sum = f64::from(self.diagonal[at]) * values[at];
        if x + 1 < width {
            sum -= f64::from(self.right[at]) * values[at + 1];
        }
        if x > 0 {
            sum -= f64::from(self.right[at - 1]) * values[at - 1];
        }
        if at + width < values.len() {
            sum -= f64::from(self.down[at]) * values[at + width];
        }
        if at >= width {
            sum -= f64::from(self.down[at - width]) * values[at - width];
        }
        sum
    }

    fn apply(&self, values: &[f64], out: &mut [f64]) {
        out.par_chunks_mut(self.width).enumerate().for_each(|(y, row)| {
            for (x, out) in row.iter_mut().enumerate() {
                *out = self.at(values, x, y * self.width + x);
            }
        });
    }

    /// A damped Jacobi step into the spare vector, which then is the solution.
    fn smooth(&self, vectors: &mut Vectors) {
        let Vectors { right_side, solution, spare } = vectors;
        spare.par_chunks_mut(self.width).enumerate().for_each(|(y, row)| {
            for (x, out) in row.iter_mut().enumerate() {
                let at = y * self.width + x;
                let diagonal = f64::from(self.diagonal[at]);
                let step = if diagonal > 0.0 { DAMPING / diagonal } else { 0.0 };
                *out = solution[at] + step * (right_side[at] - self.at(solution, x, at));
            }
        });
        std::mem::swap(solution, spare);
    }
}

/// One V-cycle from 0 towards the solution of the first level's right side.
fn cycle(levels: &[Level], vectors: &mut [Vectors]) {
    let ([level, coarser @ ..], [own, rest @ ..]) = (levels, vectors) else { return };
    own.solution.fill(0.0);
    for _ in 0..SMOOTHINGS {
        level.smooth(own);
    }
    if let ([next, ..], [below, ..]) = (coarser, &mut *rest) {
        let (width, across) = (level.width, next.width);
        below.right_side.par_chunks_mut(across).enumerate().for_each(|(y, row)| {
            for (x, sum) in row.iter_mut().enumerate() {
                *sum = 0.0;
                for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    let (x, at) = (2 * x + dx, (2 * y + dy) * width + 2 * x + dx);
                    if x < width && at < own.right_side.len() {
                        *sum += own.right_side[at] - level.at(&own.solution, x, at);
                    }
                }
            }
        });
        cycle(coarser, rest);
        let correction = &rest[0].solution;
        own.solution.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            for (x, value) in row.iter_mut().enumerate() {
                *value += correction[y / 2 * across + x / 2];
            }
        });
    }
    for _ in 0..SMOOTHINGS {
        level.smooth(own);
    }
}

/// `to = change(to, from)`, cell by cell.
fn each(to: &mut [f64], from: &[f64], width: usize, change: impl Fn(f64, f64) -> f64 + Sync) {
    to.par_chunks_mut(width).zip(from.par_chunks(width)).for_each(|(to, from)| {
        for (to, from) in to.iter_mut().zip(from) {
            *to = change(*to, *from);
        }
    });
}

fn inner(a: &[f64], b: &[f64], width: usize) -> f64 {
    let rows: Vec<f64> = a
        .par_chunks(width)
        .zip(b.par_chunks(width))
        .map(|(a, b)| a.iter().zip(b).map(|(a, b)| a * b).sum())
        .collect();
    rows.iter().sum()
}

/// The sum over rows of `of`, in their order.
fn rows_sum(values: &[f64], width: usize, of: impl Fn(&[f64]) -> f64 + Sync + Send) -> f64 {
    let rows: Vec<f64> = values.par_chunks(width).map(of).collect();
    rows.iter().sum()
}
