//! Solutions at nodes in space, and between them.
//!
//! What makes coefficients of a pixel's values depends on where the pixel's point is, and on nothing else, and does so smoothly.
//! It is solved at the nodes of a grid through the box of all points, at corners of those cells alone that hold points, and
//! between nodes it is linear along each axis. Cells are halved until that is exact enough.

use super::{NearLamps, absolute_ridge, ridge_solution};
use crate::rebin::{NEAR_TILE_BYTES, SPAN};
use crate::row_products::combination;
use crate::{FitError, LeastSquares};
use rayon::prelude::*;
use relight_core::vectors::wide;
use relight_core::weighted_sums::{Rows, weighted_sums};
use relight_core::{CpuLevel, Vectorized};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::RangeInclusive;

/// How far a relit picture of a fitted lamp may be off in the middle of a cell, whatever values from 0 to 1 the pictures have.
///
/// It is the worst case over all pictures: noise is off by a fortieth of that in root mean square, a tenth of a step of 8 bits
/// (`fit/tests/fit/near.rs`), and photographs by less.
pub const MOST_OFF: f64 = 1.0 / 64.0;

/// How often (N + k) k^2 may be worked through for the nodes; some ten seconds of one thread.
const MOST_WORK: f64 = 5e9;

/// Bytes of nodes.
const MOST_BYTES: usize = 64 << 20;

/// Nodes that may always be solved, enough for a grid of 33 x 33, and that never are exceeded.
const NODES: RangeInclusive<usize> = 1200..=16384;

/// Corners of a cell.
const CORNERS: usize = 8;

/// An axis along which points lie within this part of the box's longest edge has no cells.
const FLAT: f32 = 1e-6;

/// Bytes that fitting `functions` functions to `lights` pictures under near lamps takes at most beyond what
/// [`span_bytes`](crate::span_bytes) counts, in `threads` threads.
pub fn near_bytes(lights: usize, functions: usize, threads: usize) -> u64 {
    // Nodes twice, while they are put in order.
    let nodes = 2 * most_nodes(lights, functions) * lights * functions * size_of::<f32>();
    // Pixels in the order of their cells, products and sums of a tile, and where a span's pixels are.
    let tile = 2 * NEAR_TILE_BYTES + 2 * NEAR_TILE_BYTES * functions / lights.max(1) + 48 * SPAN;
    (nodes + threads * tile) as u64
}

/// The same whatever memory there is, as coefficients are to be.
fn most_nodes(lights: usize, functions: usize) -> usize {
    let work = (lights + functions) as f64 * (functions * functions) as f64;
    let bytes = (lights * functions * size_of::<f32>()).max(1);
    ((MOST_WORK / work) as usize).min(MOST_BYTES / bytes).clamp(*NODES.start(), *NODES.end())
}

/// What makes coefficients of a pixel's values, at every place of a surface.
#[derive(Clone, Debug)]
pub struct NearSolutions<'a> {
    lamps: &'a NearLamps,
    grid: Grid,
    /// Numbers of a node: k x N.
    size: usize,
    /// Node after node.
    nodes: Vec<f32>,
    /// Of each cell with points, where its corners are among the nodes.
    cells: BTreeMap<[u32; 3], [u32; CORNERS]>,
    /// The most that a relit picture of a fitted lamp is off in the middle of a cell; [`MOST_OFF`] or less unless nodes were
    /// too many.
    pub off: f64,
}

/// Cells of a box.
#[derive(Clone, Debug)]
struct Grid {
    least: [f32; 3],
    edges: [f32; 3],
    /// Cells along each axis, 0 where there is no way along it.
    cells: [u32; 3],
}

/// Buffers of one thread.
#[derive(Default)]
pub(crate) struct NearScratch {
    /// Cell and pixel, in the order in which they are taken.
    order: Vec<([u32; 3], u32)>,
    /// Where each pixel is in its cell, 0..1.
    places: Vec<[f32; 3]>,
    gathered: Vec<f32>,
    products: Vec<f32>,
    sums: Vec<f32>,
    weights: Vec<f32>,
}

impl<'a> NearSolutions<'a> {
    /// Solves `fit`, which is that of the middle, wherever `lamps`' surface is.
    ///
    /// Weights of the lights are those of the middle, and so is the ridge, so that solutions are smooth; a lamp that says nothing
    /// at a node ([`NearLamps::direction`]) has no weight there. `check` is called now and then.
    ///
    /// # Errors
    /// Those of `check`.
    pub fn new<E: From<FitError> + Send>(
        fit: &LeastSquares,
        lamps: &'a NearLamps,
        check: impl Fn() -> Result<(), E> + Sync,
    ) -> Result<Self, E> {
        let lights = lamps.positions.len();
        let size = fit.basis.count() * lights;
        let most = most_nodes(lights, fit.basis.count());
        let largest = fit.decomposition.singular_values.first().copied().unwrap_or(0.0);
        let ridge = absolute_ridge(fit.ridge, largest);
        let solve = |point: [f64; 3]| -> Result<(Vec<f64>, Vec<f64>), E> {
            check()?;
            let design = lamps.design(&fit.basis, point);
            let solution = ridge_solution(&design, &fit.decomposition.weights, ridge);
            Ok((design, solution))
        };
        let mut grid = Grid::around(lamps);
        let mut solved: BTreeMap<[u32; 3], Vec<f32>> = BTreeMap::new();
        loop {
            let cells = grid.occupied(lamps);
            let wanted: BTreeSet<[u32; 3]> = cells
                .iter()
                .flat_map(|&cell| grid.corners(cell))
                .filter(|key| !solved.contains_key(key))
                .collect();
            let more = wanted.into_par_iter().map(|key| {
                let (_, solution) = solve(grid.node(key.map(f64::from)))?;
                Ok((key, narrow(&solution)))
            });
            solved.extend(more.collect::<Result<Vec<_>, E>>()?);
            let middles = cells.par_iter().map(|&cell| {
                let (design, exact) = solve(grid.node(grid.middle(cell)))?;
                let corners = grid.corners(cell).map(|key| &solved[&key][..]);
                Ok((off_by(lights, &design, &exact, corners), narrow(&exact)))
            });
            let middles = middles.collect::<Result<Vec<_>, E>>()?;
            let off = middles.iter().fold(0.0f64, |most, (off, _)| most.max(*off));
            let is_flat = grid.cells == [0; 3];
            // A surface has four times the nodes when its cells are halved.
            let are_too_many = 4 * solved.len() > most;
            if off <= MOST_OFF || is_flat || are_too_many {
                return Ok(Self::of_nodes(lamps, grid, size, &solved, &cells, off));
            }
            solved = solved.into_iter().map(|(key, solution)| (key.map(|c| 2 * c), solution)).collect();
            for (cell, (_, solution)) in cells.into_iter().zip(middles) {
                solved.insert([0, 1, 2].map(|axis| (2.0 * grid.middle(cell)[axis]) as u32), solution);
            }
            grid.halve();
        }
    }

    fn of_nodes(
        lamps: &'a NearLamps,
        grid: Grid,
        size: usize,
        solved: &BTreeMap<[u32; 3], Vec<f32>>,
        cells: &BTreeSet<[u32; 3]>,
        off: f64,
    ) -> Self {
        let used: BTreeSet<[u32; 3]> = cells.iter().flat_map(|&cell| grid.corners(cell)).collect();
        let mut nodes = Vec::with_capacity(used.len() * size);
        let mut indices = BTreeMap::new();
        for (index, key) in (0u32..).zip(used) {
            nodes.extend_from_slice(&solved[&key]);
            indices.insert(key, index);
        }
        let cells = cells.iter().map(|&cell| (cell, grid.corners(cell).map(|key| indices[&key]))).collect();
        Self { lamps, grid, size, nodes, cells, off }
    }

    /// Nodes that were solved.
    pub fn nodes(&self) -> usize {
        self.nodes.len() / self.size.max(1)
    }

    /// As [`weighted_sums`] with each pixel's own solution: coefficients of the `width` samples of `input`, `channels` a pixel,
    /// from pixel `first` on.
    ///
    /// Pixels are taken cell by cell; what comes of a pixel does not depend on the others.
    #[allow(clippy::too_many_arguments, reason = "those of weighted_sums, and which pixels they are")]
    pub(crate) fn sums(
        &self,
        scratch: &mut NearScratch,
        level: CpuLevel,
        (first, channels): (usize, usize),
        input: Rows<&[f32]>,
        output: Rows<&mut [f32]>,
        width: usize,
    ) {
        let lights = self.lamps.positions.len();
        let NearScratch { order, places, gathered, products, sums, weights } = scratch;
        order.clear();
        places.clear();
        for pixel in 0..width / channels {
            let (cell, place) = self.grid.place(self.lamps.surface.point(first + pixel));
            order.push((cell, pixel as u32));
            places.push(place);
        }
        let is_in_order = order.is_sorted();
        let samples = if is_in_order {
            input.samples
        } else {
            order.sort_unstable();
            gathered.resize(lights * input.stride, 0.0);
            for (to, from) in gathered.chunks_exact_mut(input.stride).zip(input.samples.chunks(input.stride))
            {
                match channels {
                    3 => gather(from.as_chunks::<3>().0, to.as_chunks_mut().0, order),
                    _ => gather(from.as_chunks::<1>().0, to.as_chunks_mut().0, order),
                }
            }
            &gathered[..]
        };
        let functions = self.size / lights;
        let mut start = 0;
        for group in order.chunk_by(|(a, _), (b, _)| a == b) {
            let samples = Rows { samples: &samples[start * channels..], stride: input.stride };
            let width = group.len() * channels;
            products.resize(functions * width, 0.0);
            sums.clear();
            sums.resize(functions * width, 0.0);
            for (corner, node) in self.grid.distinct(&self.cells[&group[0].0]) {
                let solution = &self.nodes[node as usize * self.size..][..self.size];
                weighted_sums(
                    level,
                    solution,
                    lights,
                    samples,
                    Rows { samples: products, stride: width },
                    width,
                );
                weights.clear();
                for (_, pixel) in group {
                    let weight = self.grid.weight(corner, places[*pixel as usize]);
                    weights.extend(std::iter::repeat_n(weight, channels));
                }
                level.run(AddWeighted { weights, products, sums });
            }
            for (sums, out) in sums.chunks_exact(width).zip(output.samples.chunks_mut(output.stride)) {
                for (sums, (_, pixel)) in sums.chunks_exact(channels).zip(group) {
                    out[*pixel as usize * channels..][..channels].copy_from_slice(sums);
                }
            }
            start += group.len();
        }
    }
}

/// The pixels of a row in the order in which they are taken.
fn gather<const CHANNELS: usize>(
    from: &[[f32; CHANNELS]],
    to: &mut [[f32; CHANNELS]],
    order: &[([u32; 3], u32)],
) {
    to.iter_mut().zip(order).for_each(|(to, (_, pixel))| *to = from[*pixel as usize]);
}

/// `sums[r][x] += weights[x] * products[r][x]`.
struct AddWeighted<'a> {
    weights: &'a [f32],
    products: &'a [f32],
    sums: &'a mut [f32],
}

impl Vectorized for AddWeighted<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let width = self.weights.len();
        for (sums, products) in self.sums.chunks_exact_mut(width).zip(self.products.chunks_exact(width)) {
            for ((sum, product), weight) in sums.iter_mut().zip(products).zip(self.weights) {
                *sum += weight * product;
            }
        }
    }
}

fn narrow(solution: &[f64]) -> Vec<f32> {
    solution.iter().map(|&value| value as f32).collect()
}

/// The most that values from 0 to 1 can make of the difference between `exact` (k x N) and the mean of `corners` in a relit
/// picture of a lamp of `design` (N x k).
///
/// Half the sum of absolute values of a row of the hat matrix's difference, which is what values from -1/2 to 1/2 make, and
/// half their sum, which is what the constant 1/2 makes.
fn off_by(lights: usize, design: &[f64], exact: &[f64], corners: [&[f32]; CORNERS]) -> f64 {
    let mean = |at: usize| corners.iter().map(|corner| f64::from(corner[at])).sum::<f64>() / CORNERS as f64;
    let difference: Vec<f64> = exact.iter().enumerate().map(|(at, exact)| mean(at) - exact).collect();
    let of_row = |row: &[f64]| {
        let off = combination(row, &difference, lights);
        0.5 * (off.iter().map(|off| off.abs()).sum::<f64>() + off.iter().sum::<f64>().abs())
    };
    design.chunks_exact(exact.len() / lights).map(of_row).fold(0.0, f64::max)
}

impl Grid {
    /// The box of all points of `lamps`' surface, in halves of its longest edge.
    fn around(lamps: &NearLamps) -> Self {
        let (width, height) = lamps.surface.size();
        let first = lamps.surface.point(0);
        let (least, largest) = (0..width * height).fold((first, first), |(least, largest), pixel| {
            let point = lamps.surface.point(pixel);
            ([0, 1, 2].map(|i| point[i].min(least[i])), [0, 1, 2].map(|i| point[i].max(largest[i])))
        });
        let extents = [0, 1, 2].map(|axis| largest[axis] - least[axis]);
        let longest = extents.into_iter().fold(0.0, f32::max);
        let cells =
            extents.map(|extent| if extent > FLAT * longest { (2.0 * extent / longest).ceil() } else { 0.0 });
        let edges = [0, 1, 2].map(|axis| extents[axis] / cells[axis].max(1.0));
        Self { least, edges, cells: cells.map(|cells| cells as u32) }
    }

    fn halve(&mut self) {
        self.edges = self.edges.map(|edge| 0.5 * edge);
        self.cells = self.cells.map(|cells| 2 * cells);
    }

    /// The cell of a point in the box, and where in it the point is.
    fn place(&self, point: [f32; 3]) -> ([u32; 3], [f32; 3]) {
        let (mut cell, mut place) = ([0; 3], [0.0; 3]);
        for axis in (0..3).filter(|&axis| self.cells[axis] > 0) {
            let cells = (point[axis] - self.least[axis]) / self.edges[axis];
            cell[axis] = (cells as u32).min(self.cells[axis] - 1);
            place[axis] = (cells - cell[axis] as f32).clamp(0.0, 1.0);
        }
        (cell, place)
    }

    /// The cells that hold points.
    fn occupied(&self, lamps: &NearLamps) -> BTreeSet<[u32; 3]> {
        let (width, height) = lamps.surface.size();
        let mut cells = BTreeSet::new();
        let mut last = None;
        for pixel in 0..width * height {
            let (cell, _) = self.place(lamps.surface.point(pixel));
            if last != Some(cell) {
                cells.insert(cell);
                last = Some(cell);
            }
        }
        cells
    }

    /// The nodes at the corners of `cell`; bit i of a corner is the side along axis i. Along axes without cells both sides
    /// are one.
    fn corners(&self, cell: [u32; 3]) -> [[u32; 3]; CORNERS] {
        std::array::from_fn(|corner| {
            [0, 1, 2].map(|axis| match self.cells[axis] {
                0 => 0,
                _ => cell[axis] + (corner >> axis & 1) as u32,
            })
        })
    }

    /// Corners that are nodes of their own, each with its node.
    fn distinct(&self, nodes: &[u32; CORNERS]) -> impl Iterator<Item = (usize, u32)> {
        let flat = self.cells.map(|cells| cells == 0);
        let is_own = move |corner: usize| (0..3).all(|axis| !(flat[axis] && corner >> axis & 1 == 1));
        nodes.iter().copied().enumerate().filter(move |(corner, _)| is_own(*corner))
    }

    /// How much a corner counts at a place in its cell.
    fn weight(&self, corner: usize, place: [f32; 3]) -> f32 {
        let along = |axis: usize| if corner >> axis & 1 == 1 { place[axis] } else { 1.0 - place[axis] };
        along(0) * along(1) * along(2)
    }

    /// The middle of `cell`, in cells.
    fn middle(&self, cell: [u32; 3]) -> [f64; 3] {
        [0, 1, 2].map(|axis| f64::from(cell[axis]) + if self.cells[axis] > 0 { 0.5 } else { 0.0 })
    }

    /// The point `at` cells from the box's least corner.
    fn node(&self, at: [f64; 3]) -> [f64; 3] {
        let (least, edges) = (wide(self.least), wide(self.edges));
        [0, 1, 2].map(|axis| least[axis] + at[axis] * edges[axis])
    }
}
