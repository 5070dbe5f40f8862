//! Rigs at every pixel: many points at once, in f32.

use crate::light::lanes::{LANES, Lanes, RECURSION, lanes};
use crate::{AxisFunction, MOST_BANDS, RigPart, cosine_lobe};
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
    /// By parameter, then function of the normal: R, G, B of reflected radiance.
    coefficients: Vec<[f32; 3]>,
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
    pub fn new(part: &RigPart, coefficients: &[[f64; 3]], bands: usize) -> Self {
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
        let coefficients = coefficients.iter().enumerate().map(|(i, values)| {
            let lobe = cosine_lobe((i % count).isqrt()) / PI;
            values.map(|value| (lobe * value) as f32)
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
        let functions = rig.bands * rig.bands;
        let mut harmonics = [[0.0; LANES]; MOST_BANDS * MOST_BANDS];
        let mut of_axes: [Vec<Lanes>; 3] =
            rig.functions.each_ref().map(|list| vec![[0.0; LANES]; list.len()]);
        for first in (0..rows.out[0].len()).step_by(LANES) {
            let lanes = LANES.min(rows.out[0].len() - first);
            let load = |row: &[f32]| {
                let mut lane = [0.0; LANES];
                lane[..lanes].copy_from_slice(&row[first..first + lanes]);
                lane
            };
            RECURSION.evaluate(rig.bands, &rows.normals.map(load), &mut harmonics);
            let coordinates = rows.coordinates.map(load);
            for axis in 0..3 {
                for (function, values) in rig.functions[axis].iter().zip(&mut of_axes[axis]) {
                    *values = values_of(*function, &coordinates[axis]);
                }
            }
            let mut sums = [[0.0f32; LANES]; 3];
            for (product, coefficients) in rig.products.iter().zip(rig.coefficients.chunks_exact(functions)) {
                let [x, y, z] = [0, 1, 2].map(|axis| &of_axes[axis][product[axis]]);
                let mut weights = [0.0; LANES];
                for i in 0..LANES {
                    weights[i] = x[i] * y[i] * z[i];
                }
                // Most nodes of a lattice are far from all of these points.
                if weights == [0.0; LANES] {
                    continue;
                }
                let mut values = [[0.0f32; LANES]; 3];
                for (harmonic, color) in
                    harmonics.iter().zip(coefficients).filter(|(_, color)| **color != [0.0; 3])
                {
                    for (value, &factor) in values.iter_mut().zip(color) {
                        *value = lanes!(|i| value[i] + factor * harmonic[i]);
                    }
                }
                for (sum, value) in sums.iter_mut().zip(&values) {
                    *sum = lanes!(|i| sum[i] + weights[i] * value[i]);
                }
            }
            for (out, sum) in rows.out.iter_mut().zip(&sums) {
                for (out, value) in out[first..first + lanes].iter_mut().zip(sum) {
                    *out += value;
                }
            }
        }
    }
}

#[inline(always)]
fn values_of(function: AxisFunction, coordinate: &Lanes) -> Lanes {
    let mut values = [1.0; LANES];
    match function {
        AxisFunction::One => {}
        AxisFunction::Coordinate => values = *coordinate,
        AxisFunction::Hat { node, nodes } => {
            let (scale, node) = (0.5 * (nodes - 1) as f32, node as f32);
            for i in 0..LANES {
                let place = (coordinate[i].clamp(-1.0, 1.0) + 1.0) * scale;
                values[i] = (1.0 - (place - node).abs()).max(0.0);
            }
        }
    }
    values
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
        let mut random = crate::surface::Random { state: 3 };
        // A length that leaves lanes over, coordinates outside the box among them.
        let mut number = |_| 2.6 * random.next() - 1.3;
        let points: Vec<[f64; 3]> = (0..53).map(|_| [0, 1, 2].map(&mut number)).collect();
        let normals: Vec<[f64; 3]> =
            (0..53).map(|_| relight_core::vectors::unit([0, 1, 2].map(&mut number)).unwrap()).collect();
        for (model, bands) in
            [("constant", 6), ("gradient", 3), ("lattice:3x2x4", 3), ("mixed:3,gradient,constant", 2)]
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
                let mut out = [0, 1, 2].map(|c| vec![c as f32; 53]);
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
