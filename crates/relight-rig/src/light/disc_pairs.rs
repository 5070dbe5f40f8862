//! Discs that stay well away from points: pairs of a disc and a point side by side, a node of the disc at a time.

use super::disc_nodes::{Disc, RULE_COUNT, RULES, Rule};
use super::harmonics::MOST_BANDS;
use super::lanes::three;
use super::rows::{ROW, Row, add_product, first, for_each_function, step, turn};
use relight_core::Vectorized;

/// Most points that look together.
pub(super) const POINTS: usize = 16;

/// Rows of pairs that are summed in f32.
const BLOCK: usize = 16;

/// Most functions.
const MOST: usize = MOST_BANDS * MOST_BANDS;

/// What some points see of discs.
pub(super) struct DiscLook<'a> {
    pub(super) bands: usize,
    /// By band: whether its coefficients are asked for.
    pub(super) is_asked: [bool; MOST_BANDS],
    pub(super) discs: &'a [Disc],
    /// What colours are divided by.
    pub(super) scale: f64,
    /// From the ball's middle, 1 to [`POINTS`].
    pub(super) points: &'a [[f64; 3]],
    /// By point, then function: added to.
    pub(super) out: &'a mut [[f64; 3]],
}

impl Vectorized for DiscLook<'_> {
    /// Discs that a point may be so near to that each point takes nodes of its own.
    type Output = Vec<usize>;

    #[inline(always)]
    fn run(self) -> Vec<usize> {
        let count = self.points.len();
        let most = ROW / count;
        let mut near = Vec::new();
        let mut sums = Sums { bands: self.bands, is_asked: self.is_asked, values: [[[0.0; ROW]; 3]; MOST] };
        let mut rows = [const { Pairs::NONE }; RULE_COUNT];
        let mut summed = 0;
        let out = self.out;
        for (index, disc) in self.discs.iter().enumerate() {
            let views = Views::new(disc, self.points);
            if !views.is_faced {
                continue;
            }
            let size = disc.radius * disc.unit;
            let Some(rule) = RULES.iter().position(|rule| views.nearest >= rule.nearest * size) else {
                near.push(index);
                continue;
            };
            let row = &mut rows[rule];
            row.push(disc, &views, count, self.scale);
            if row.discs == most {
                sums.add(row, &RULES[rule]);
                row.discs = 0;
                summed += 1;
                if summed % BLOCK == 0 {
                    sums.flush(count, self.scale, out);
                }
            }
        }
        for (row, rule) in rows.iter_mut().zip(RULES.iter()).filter(|(row, _)| row.discs > 0) {
            // What earlier discs left there.
            for color in &mut row.color {
                color[row.discs * count..].fill(0.0);
            }
            sums.add(row, rule);
        }
        sums.flush(count, self.scale, out);
        near
    }
}

/// A disc as points see it, in the disc's units.
struct Views {
    towards: [[f64; POINTS]; 3],
    /// Of the points above the disc's plane.
    height: [f64; POINTS],
    /// Whether any point is above it.
    is_faced: bool,
    /// Least distance of a point from the middle.
    nearest: f64,
}

impl Views {
    #[inline(always)]
    fn new(disc: &Disc, points: &[[f64; 3]]) -> Self {
        let mut views =
            Self { towards: [[0.0; POINTS]; 3], height: [0.0; POINTS], is_faced: false, nearest: 0.0 };
        let mut nearest2 = f64::INFINITY;
        for (i, point) in points.iter().enumerate() {
            let v = three!(|axis| (disc.position[axis] - point[axis]) * disc.unit);
            for (towards, v) in views.towards.iter_mut().zip(v) {
                towards[i] = v;
            }
            views.height[i] = -(v[0] * disc.normal[0] + v[1] * disc.normal[1] + v[2] * disc.normal[2]);
            views.is_faced |= views.height[i] > 0.0;
            nearest2 = nearest2.min(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
        }
        views.nearest = nearest2.sqrt();
        views
    }
}

/// Discs with the same nodes by the points: pair `disc * points + point`.
struct Pairs {
    towards: [Row; 3],
    /// The disc's axes, as long as its radius.
    across: [[Row; 3]; 2],
    /// Radiance times the area as it is turned towards the point.
    color: [Row; 3],
    /// How many there are.
    discs: usize,
}

impl Pairs {
    /// A unit away and black.
    const NONE: Self =
        Self { towards: [[1.0; ROW]; 3], across: [[[0.0; ROW]; 3]; 2], color: [[0.0; ROW]; 3], discs: 0 };

    #[inline(always)]
    fn push(&mut self, disc: &Disc, views: &Views, count: usize, scale: f64) {
        let first = self.discs * count;
        let size = disc.radius * disc.unit;
        for axis in 0..3 {
            for (side, across) in self.across.iter_mut().zip(&disc.across) {
                side[axis][first..first + count].fill((across[axis] * size) as f32);
            }
            let brightness = disc.brightness[axis] / scale;
            for i in 0..count {
                self.towards[axis][first + i] = views.towards[axis][i] as f32;
                // From behind nothing is seen.
                self.color[axis][first + i] = (brightness * views.height[i].max(0.0)) as f32;
            }
        }
        self.discs += 1;
    }
}

struct Sums {
    bands: usize,
    is_asked: [bool; MOST_BANDS],
    /// By function.
    values: [[Row; 3]; MOST],
}

impl Sums {
    #[inline(always)]
    fn add(&mut self, pairs: &Pairs, rule: &Rule) {
        let mut sums = [[0.0f32; ROW]; MOST];
        let [a, b] = &pairs.across;
        for [u, v, share] in rule.places() {
            let mut direction = [[0.0f32; ROW]; 3];
            let mut weight = [0.0f32; ROW];
            for i in 0..ROW {
                let [x, y, z] = three!(|axis| pairs.towards[axis][i] + (u * a[axis][i] + v * b[axis][i]));
                let inverse = 1.0 / (x * x + y * y + z * z).sqrt();
                direction[0][i] = x * inverse;
                direction[1][i] = y * inverse;
                direction[2][i] = z * inverse;
                weight[i] = share * inverse * (inverse * inverse);
            }
            for_each_function!(self.bands, &direction, weight, |l, at, a, b| {
                if self.is_asked[l] {
                    add_product(&mut sums[at], a, b);
                }
            });
        }
        for (values, sum) in self.values.iter_mut().zip(&sums).take(self.bands * self.bands) {
            for (value, color) in values.iter_mut().zip(&pairs.color) {
                add_product(value, color, sum);
            }
        }
    }

    /// Moves the sums to `out`.
    #[inline(always)]
    fn flush(&mut self, count: usize, scale: f64, out: &mut [[f64; 3]]) {
        let functions = self.bands * self.bands;
        for (at, values) in self.values[..functions].iter_mut().enumerate() {
            for (c, row) in values.iter_mut().enumerate() {
                for point in 0..count {
                    let sum = row[point..].iter().step_by(count).fold(0.0, |sum, v| sum + f64::from(*v));
                    out[point * functions + at][c] += scale * sum;
                }
                row.fill(0.0);
            }
        }
    }
}
