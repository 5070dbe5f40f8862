//! The light side of web folders of types `rbf` and `bilinear`: whole numbers over directions, from and to
//! learned functions.
//!
//! Source: FORMATS.md of this project; Ponchio, Corsini, Scopigno, *Relight: a compact and accurate RTI
//! representation for the web*, 2019. Two things are said in neither and are as docs/formats.md has it: the
//! form of the Gaussian, and how the octahedral square lies.

use relight_core::Direction;
use relight_core::basis::{FunctionsOfLight, Learned};
use relight_core::sphere::{Cap, Octahedral, fibonacci_in};
use std::f64::consts::FRAC_PI_2;

/// Nodes along the table into which Gaussians between lights are read.
pub(super) const RBF_NODES: usize = 49;

/// Edges that are written, unless the functions' own is reached before.
const EDGES: [usize; 8] = [8, 10, 12, 16, 20, 24, 28, 32];

/// A coarser square may add so much of the square of what lights left out miss by: 0.04 dB.
const SHARE: f64 = 0.01;

/// Directions at which squares are compared.
const TRIALS: usize = 400;

/// The code of a weight of 0.
const ZERO: f64 = 127.0;

/// Functions over `count` directions as the file has them: `basis` in the order of
/// [`WebInfo::basis`](super::web_info::WebInfo::basis), `range` one a plane. Gives direction by direction the
/// values of [`Learned`], in 0..1 units.
fn by_direction(basis: &[f32], range: &[f64], count: usize) -> Vec<f64> {
    let functions = 3 * (range.len() + 1);
    let mut values = vec![0.0; count * functions];
    for (i, &code) in basis.iter().enumerate() {
        let (row, direction, channel) = (i / (3 * count), i / 3 % count, i % 3);
        let code = f64::from(code);
        let value = match row.checked_sub(1) {
            None => code / 255.0,
            Some(plane) => (code - ZERO) / range[plane],
        };
        values[direction * functions + 3 * row + channel] = value;
    }
    values
}

/// The table of a `bilinear` folder on its `edge` x `edge` nodes, as [`Learned::new`] takes it.
pub(super) fn table_from_square(basis: &[f32], range: &[f64], edge: usize) -> Vec<f32> {
    let values = by_direction(basis, range, edge * edge);
    let functions = values.len() / (edge * edge);
    let of_node = |node: usize| &values[node_of_file(edge, node) * functions..][..functions];
    (0..edge * edge).flat_map(of_node).map(|&value| value as f32).collect()
}

/// The place in a file of our node: columns are alike, (x + y) grows along them; (y - x) grows along the rows
/// of a file where it falls along ours.
fn node_of_file(edge: usize, node: usize) -> usize {
    (edge - 1 - node / edge) * edge + node % edge
}

/// The table of an `rbf` folder over the nodes of `square`: weights at the lights, interpolated by Gaussians
/// of the chord, exp(-chord^2 / sigma^2), whose sum is made 1.
pub(super) fn table_from_lights(
    basis: &[f32],
    range: &[f64],
    lights: &[Direction],
    sigma: f64,
    square: Octahedral,
) -> Vec<f32> {
    let values = by_direction(basis, range, lights.len());
    let functions = values.len() / lights.len().max(1);
    let mut table = Vec::with_capacity(square.count() * functions);
    for node in 0..square.count() {
        let direction = square.direction(node);
        let squares: Vec<f64> = lights.iter().map(|light| 2.0 - 2.0 * light.cosine(direction)).collect();
        // Only differences count once the sum is 1, and the nearest light's never underflows.
        let nearest = squares.iter().copied().fold(f64::INFINITY, f64::min);
        let shares: Vec<f64> =
            squares.iter().map(|square| libm::exp((nearest - square) / (sigma * sigma))).collect();
        let sum: f64 = shares.iter().sum();
        for function in 0..functions {
            let of_lights = shares.iter().zip(values[function..].iter().step_by(functions));
            table.push((of_lights.map(|(share, value)| share * value).sum::<f64>() / sum) as f32);
        }
    }
    table
}

/// Learned functions of three channels as a `bilinear` folder has them.
pub(super) struct SquareCodes {
    /// Nodes along an edge.
    pub(super) edge: usize,
    /// In the order of [`WebInfo::basis`](super::web_info::WebInfo::basis).
    pub(super) basis: Vec<f32>,
    /// One a plane.
    pub(super) range: Vec<f64>,
    /// Mean squared error that they make in relit samples.
    pub(super) square_error: f64,
}

/// Codes of `learned` on the least square that serves.
///
/// `plane_squares` is each plane's mean square over the pixels, `left_out` the root mean square error of
/// predicting lights that were left out, if known. Planes count as independent.
pub(super) fn codes_on_square(
    learned: &Learned,
    lights: &[Direction],
    plane_squares: &[f64],
    left_out: Option<f64>,
) -> SquareCodes {
    let farthest = lights.iter().map(|light| light.angle_to(Direction::OUT)).fold(0.0, f64::max);
    let radius = if lights.is_empty() { FRAC_PI_2 } else { farthest.min(FRAC_PI_2) };
    let trials = fibonacci_in(Cap { axis: Direction::OUT, radius }, TRIALS);
    let half_a_step = 1.0 / (12.0 * 255.0 * 255.0);
    let allowed = left_out.map_or(half_a_step, |rmse| (SHARE * rmse * rmse).max(half_a_step));
    let own = learned.square().nodes.min(EDGES[EDGES.len() - 1]);
    let coarser = EDGES.into_iter().filter(|&edge| edge < own);
    let table = |edge: usize| sampled(learned, Octahedral { nodes: edge, hemisphere: true });
    let error = |edge: usize, table: &[f64]| square_error(learned, edge, table, &trials, plane_squares);
    let edge = coarser.clone().find(|&edge| error(edge, &table(edge)) <= allowed).unwrap_or(own);
    let values = table(edge);
    let (basis, range) = coded(&values, learned.planes(), edge);
    let back: Vec<f64> = table_from_square(&basis, &range, edge).into_iter().map(f64::from).collect();
    SquareCodes { edge, basis, range, square_error: error(edge, &back) }
}

/// The functions at the nodes of `square`, node by node.
fn sampled(learned: &Learned, square: Octahedral) -> Vec<f64> {
    let functions = learned.count();
    let mut values = vec![0.0; square.count() * functions];
    for (node, values) in values.chunks_exact_mut(functions).enumerate() {
        learned.evaluate(square.direction(node), values);
    }
    values
}

/// Mean squared error in relit samples of a table of `edge` x `edge` nodes instead of `learned`.
fn square_error(
    learned: &Learned,
    edge: usize,
    table: &[f64],
    trials: &[Direction],
    plane_squares: &[f64],
) -> f64 {
    let square = Octahedral { nodes: edge, hemisphere: true };
    let functions = learned.count();
    let mut exact = vec![0.0; functions];
    let mut sum = 0.0;
    for &direction in trials {
        learned.evaluate(direction, &mut exact);
        let taps = square.taps(direction);
        for (function, exact) in exact.iter().enumerate() {
            let of_nodes = taps.nodes.iter().zip(taps.weights);
            let found: f64 = of_nodes.map(|(node, weight)| weight * table[node * functions + function]).sum();
            let energy = (function / 3).checked_sub(1).map_or(1.0, |plane| plane_squares[plane]);
            sum += (found - exact) * (found - exact) * energy;
        }
    }
    sum / (3.0 * trials.len() as f64)
}

/// Codes 0..255 of a table over `edge` x `edge` nodes, and the ranges of its planes.
fn coded(table: &[f64], planes: usize, edge: usize) -> (Vec<f32>, Vec<f64>) {
    let (count, functions) = (edge * edge, 3 * (planes + 1));
    let of_row = |row: usize| table.chunks_exact(functions).flat_map(move |values| &values[3 * row..][..3]);
    let range: Vec<f64> = (1..=planes)
        .map(|row| {
            let largest = of_row(row).map(|value| value.abs()).fold(0.0, f64::max);
            if largest > 0.0 { ZERO / largest } else { 1.0 }
        })
        .collect();
    // The file's order of nodes is its own inverse.
    let our_node = |node: usize| node_of_file(edge, node);
    let mut basis = Vec::with_capacity(count * functions);
    for row in 0..=planes {
        for node in 0..count {
            for &value in &table[our_node(node) * functions + 3 * row..][..3] {
                let code = match row.checked_sub(1) {
                    None => value * 255.0,
                    Some(plane) => ZERO + value * range[plane],
                };
                basis.push(code.round().clamp(0.0, 255.0) as f32);
            }
        }
    }
    (basis, range)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Smooth functions, each its own, that tell x from y and their signs.
    fn learned(nodes: usize) -> Learned {
        let square = Octahedral { nodes, hemisphere: true };
        let of_node = |node: usize| {
            let [x, y, z] = square.direction(node).components();
            (0..9).map(move |f| {
                let f = f as f64;
                (0.4 + 0.1 * x * (f + 1.0) - 0.07 * y * y * f + 0.05 * y + 0.02 * x * y * z) as f32
            })
        };
        let table = (0..square.count()).flat_map(of_node).collect();
        Learned::new("pca".to_owned(), 2, 3, square, table).unwrap()
    }

    #[test]
    fn codes_on_a_square_give_the_functions_back() {
        let learned = learned(33);
        let codes = codes_on_square(&learned, &[], &[1.0, 0.5], Some(0.05));
        assert!(codes.edge < 33, "{}", codes.edge);
        let table = table_from_square(&codes.basis, &codes.range, codes.edge);
        let square = Octahedral { nodes: codes.edge, hemisphere: true };
        let back = Learned::new("pca".to_owned(), 2, 3, square, table).unwrap();
        let cap = Cap { axis: Direction::OUT, radius: FRAC_PI_2 };
        let (mut a, mut b, mut sum) = ([0.0; 9], [0.0; 9], 0.0);
        for direction in fibonacci_in(cap, 999) {
            learned.evaluate(direction, &mut a);
            back.evaluate(direction, &mut b);
            let energy = [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.5, 0.5, 0.5];
            sum += (0..9).map(|f| (a[f] - b[f]) * (a[f] - b[f]) * energy[f]).sum::<f64>() / 3.0 / 999.0;
        }
        assert!((sum / codes.square_error - 1.0).abs() < 0.1, "{sum} of {}", codes.square_error);
        assert!(codes.square_error < 0.02 * 0.05 * 0.05, "{}", codes.square_error);
        // Nothing may be lost: the finest square there is.
        let codes = codes_on_square(&learned, &[], &[1e6, 1e6], None);
        assert_eq!(codes.edge, 32);
    }

    #[test]
    fn gaussians_between_lights_pass_near_them_and_lean_to_the_nearer() {
        let lights: Vec<Direction> = [[0.6, 0.0, 0.8], [-0.6, 0.0, 0.8], [0.0, 0.6, 0.8]]
            .map(|[x, y, z]| Direction::new(x, y, z).unwrap())
            .to_vec();
        let square = Octahedral { nodes: RBF_NODES, hemisphere: true };
        // Mean 51, 102, 153; one plane of weights (code - 127) / 64.
        let mean = [[51.0; 3], [102.0; 3], [153.0; 3]].concat();
        let plane = [[191.0, 127.0, 63.0], [127.0; 3], [255.0, 0.0, 127.0]].concat();
        let basis = [mean, plane].concat();
        let table = table_from_lights(&basis, &[64.0], &lights, 0.2, square);
        let learned = Learned::new("web rbf".to_owned(), 1, 3, square, table).unwrap();
        let mut found = [0.0; 6];
        learned.evaluate(lights[2], &mut found);
        for (found, expected) in found.into_iter().zip([0.6, 0.6, 0.6, 2.0, -127.0 / 64.0, 0.0]) {
            assert!((found - expected).abs() < 0.02, "{found} {expected}");
        }
        // Midway between two of them, the third being farther: their mean, less a little.
        learned.evaluate(Direction::OUT, &mut found);
        let far = Direction::new(1.0, -0.2, 0.0).unwrap();
        learned.evaluate(far, &mut found);
        assert!((found[0] - 0.2).abs() < 0.01 && (found[3] - 1.0).abs() < 0.05, "{found:?}");
    }
}
