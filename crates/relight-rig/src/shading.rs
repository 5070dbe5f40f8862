//! Rigs at every pixel: many points at once, in f32.

use crate::light::rows::{ROW, Row, add_product, first, for_each_function, put_product, step, turn};
use crate::{AxisFunction, Bands, MOST_BANDS, RigPart, cosine_lobe};
use relight_core::{CpuLevel, Vectorized};
use std::f64::consts::PI;

/// A part's vectors, ready to be evaluated at many points.
#[derive(Clone, Debug)]
pub struct ShadedRig {
    bands: usize,
    /// Functions of each axis that any parameter has, in the order in which they first stand there.
    functions: [Vec<AxisFunction>; 3],
    /// By parameter: its function of each axis.
    products: Vec<[usize; 3]>,
    /// By parameter, then function of the normal that irradiance has, in order: R, G, B of reflected radiance. Black ones fill the
    /// last [`TOGETHER`].
    coefficients: Vec<[[[f32; 3]; TOGETHER]; MOST_TOGETHER]>,
}

/// Functions that are added together, so that sums are stored less often.
const TOGETHER: usize = 4;

/// Most of these: functions of bands 0, 1, 2, 4 and 6.
const MOST_TOGETHER: usize = 8;

/// Whether a band's radiance makes irradiance.
fn is_seen(l: usize) -> bool {
    cosine_lobe(l) != 0.0
}

/// Points of a part and where light goes.
#[derive(Debug)]
pub struct RigRows<'a> {
    /// x, y, z in the mesh's box ([`crate::Frame::coordinates`]).
    pub coordinates: [&'a [f32]; 3],
    /// Unit normals in the scene.
    pub normals: [&'a [f32]; 3],
    /// R, G, B: reflected radiance of a white diffuser is added.
    pub out: [&'a mut [f32]; 3],
}

impl ShadedRig {
    /// From the vectors of [`RigPart::coefficients`].
    pub fn new(part: &RigPart, coefficients: &[[f64; 3]], bands: impl Into<Bands>) -> Self {
        let Bands { count: bands, window } = bands.into();
        let mut functions: [Vec<AxisFunction>; 3] = Default::default();
        let products = part.model.parameters().iter().map(|product| {
            [0, 1, 2].map(|axis| {
                let known = functions[axis].iter().position(|function| *function == product[axis]);
                known.unwrap_or_else(|| {
                    functions[axis].push(product[axis]);
                    functions[axis].len() - 1
                })
            })
        });
        let products = products.collect();
        let count = bands * bands;
        let coefficients = coefficients.chunks_exact(count).map(|vector| {
            let mut out = [[[0.0; 3]; TOGETHER]; MOST_TOGETHER];
            let seen = (0..count).filter(|at| is_seen(at.isqrt()));
            for (at, out) in seen.zip(out.as_flattened_mut()) {
                let l = at.isqrt();
                let lobe = cosine_lobe(l) / PI * window.factors[l];
                *out = vector[at].map(|value| (lobe * value) as f32);
            }
            out
        });
        Self { bands, functions, products, coefficients: coefficients.collect() }
    }

    /// Adds what the rig gives to points; the same bits at every level.
    ///
    /// # Panics
    /// When the rows differ in length.
    pub fn add(&self, level: CpuLevel, rows: RigRows<'_>) {
        let count = rows.out[0].len();
        let lengths = rows.coordinates.iter().chain(&rows.normals).map(|row| row.len());
        assert!(
            lengths.chain(rows.out.iter().map(|row| row.len())).all(|len| len == count),
            "rows of one length"
        );
        level.run(Adding { rig: self, rows });
    }
}

struct Adding<'a> {
    rig: &'a ShadedRig,
    rows: RigRows<'a>,
}

impl Vectorized for Adding<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { rig, mut rows } = self;
        // By function, those without irradiance left out.
        let mut harmonics = [[[0.0; ROW]; TOGETHER]; MOST_TOGETHER];
        let count = (0..rig.bands).filter(|&l| is_seen(l)).map(|l| 2 * l + 1).sum::<usize>();
        let mut before = [0; MOST_BANDS];
        for l in 1..rig.bands {
            before[l] = before[l - 1] + if is_seen(l - 1) { 2 * l - 1 } else { 0 };
        }
        let mut of_axes: [Vec<Row>; 3] = rig.functions.each_ref().map(|list| vec![[0.0; ROW]; list.len()]);
        for start in (0..rows.out[0].len()).step_by(ROW) {
            let lanes = ROW.min(rows.out[0].len() - start);
            let load = |row: &[f32]| {
                let mut lane = [0.0; ROW];
                lane[..lanes].copy_from_slice(&row[start..start + lanes]);
                lane
            };
            for_each_function!(rig.bands, &rows.normals.map(load), [1.0; ROW], |l, at, a, b| {
                if is_seen(l) {
                    put_product(&mut harmonics.as_flattened_mut()[before[l] + at - l * l], a, b);
                }
            });
            let coordinates = rows.coordinates.map(load);
            for axis in 0..3 {
                for (function, values) in rig.functions[axis].iter().zip(&mut of_axes[axis]) {
                    put_values(*function, &coordinates[axis], values);
                }
            }
            let mut sums = [[0.0f32; ROW]; 3];
            for (product, coefficients) in rig.products.iter().zip(&rig.coefficients) {
                let [x, y, z] = [0, 1, 2].map(|axis| &of_axes[axis][product[axis]]);
                let mut weights = [0.0; ROW];
                let mut any = 0;
                for i in 0..ROW {
                    weights[i] = x[i] * y[i] * z[i];
                    any |= weights[i].to_bits();
                }
                // Most nodes of a lattice are far from all of these points.
                if any == 0 {
                    continue;
                }
                let mut values = [[0.0f32; ROW]; 3];
                for (harmonics, coefficients) in
                    harmonics.iter().zip(coefficients).take(count.div_ceil(TOGETHER))
                {
                    add(harmonics, coefficients, &mut values);
                }
                for (sum, value) in sums.iter_mut().zip(&values) {
                    add_product(sum, &weights, value);
                }
            }
            for (out, sum) in rows.out.iter_mut().zip(&sums) {
                for (out, value) in out[start..start + lanes].iter_mut().zip(sum) {
                    *out += value;
                }
            }
        }
    }
}

/// Adds functions by their coefficients, one after the other.
#[inline(always)]
fn add(functions: &[Row; TOGETHER], coefficients: &[[f32; 3]; TOGETHER], [r, g, b]: &mut [Row; 3]) {
    for i in 0..ROW {
        let mut sum = [r[i], g[i], b[i]];
        for k in 0..TOGETHER {
            for c in 0..3 {
                sum[c] += coefficients[k][c] * functions[k][i];
            }
        }
        [r[i], g[i], b[i]] = sum;
    }
}

#[inline(always)]
fn put_values(function: AxisFunction, coordinate: &Row, values: &mut Row) {
    match function {
        AxisFunction::One => *values = [1.0; ROW],
        AxisFunction::Coordinate => *values = *coordinate,
        AxisFunction::Hat { node, nodes } => {
            let (scale, node) = (0.5 * (nodes - 1) as f32, node as f32);
            for i in 0..ROW {
                let place = (coordinate[i].clamp(-1.0, 1.0) + 1.0) * scale;
                values[i] = (1.0 - (place - node).abs()).max(0.0);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ErrorTable, Frame, Model};

    /// A part of any model, in its own box.
    fn part(model: &str) -> RigPart {
        RigPart {
            name: String::new(),
            model: Model::parse(model).unwrap(),
            frame: Frame { centre: [0.0; 3], half_extent: [1.0; 3], radius: 1.0 },
            samples: Vec::new(),
            operator: Vec::new(),
            surface: Vec::new(),
            errors: ErrorTable::default(),
        }
    }

    #[test]
    fn many_points_are_lit_as_one_at_a_time_at_every_level() {
        let mut random = relight_core::SplitMix64::new(3);
        // A length that leaves lanes over, coordinates outside the box among them.
        let mut number = |_| 2.6 * random.unit() - 1.3;
        let points: Vec<[f64; 3]> = (0..150).map(|_| [0, 1, 2].map(&mut number)).collect();
        let normals: Vec<[f64; 3]> =
            (0..150).map(|_| relight_core::vectors::unit([0, 1, 2].map(&mut number)).unwrap()).collect();
        for (model, bands) in
            [("constant", 7), ("gradient", 3), ("lattice:3x2x4", 3), ("mixed:3,gradient,constant", 2)]
        {
            let part = part(model);
            let coefficients: Vec<[f64; 3]> = (0..part.model.parameters().len() * bands * bands)
                .map(|_| [0, 1, 2].map(&mut number))
                .collect();
            let shaded = ShadedRig::new(&part, &coefficients, bands);
            let column = |of: &[[f64; 3]], axis: usize| of.iter().map(|v| v[axis] as f32).collect::<Vec<_>>();
            let [p, n] = [&points, &normals].map(|of| [0, 1, 2].map(|axis| column(of, axis)));
            let mut all = Vec::new();
            for level in CpuLevel::available() {
                let mut out = [0, 1, 2].map(|c| vec![c as f32; 150]);
                let [r, g, b] = &mut out;
                let rows = RigRows {
                    coordinates: p.each_ref().map(Vec::as_slice),
                    normals: n.each_ref().map(Vec::as_slice),
                    out: [r, g, b],
                };
                shaded.add(level, rows);
                for (i, (&point, &normal)) in points.iter().zip(&normals).enumerate() {
                    let exact = part.reflectance(&coefficients, point, normal);
                    for c in 0..3 {
                        let error = f64::from(out[c][i]) - c as f64 - exact[c];
                        assert!(error.abs() < 4e-6, "{model} {} {i} {c}: {error}", level.name());
                    }
                }
                all.push(out);
            }
            assert!(all.iter().all(|out| *out == all[0]), "{model}: the same bits at every level");
        }
    }
}
