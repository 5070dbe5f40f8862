//! Discs that the receiver's horizon cuts, seen by many points at once in f32: sums over the visible segment.
//!
//! The segment is cut into chords along the horizon. With x across them, from the disc's middle in radii, and the horizon at x0, the
//! irradiance over pi r^2 is the integral of `r tilt (x - x0) h / D^4 / pi` over the segment: h the distance from the disc's plane, D that
//! from the place on the disc, both cosines among it. x = 1 - (1 - x0) w^2 takes the square root out of the chord's length at the rim,
//! so that few of Gauss and Legendre's nodes do; places left and right on a chord share a division. Derived for this program; checked
//! against `View::irradiance`.

use super::lanes::{LANES, Lanes, lanes, three};
use super::quadrature::{Node, gauss_legendre};
use std::f32::consts::FRAC_1_PI;
use std::sync::LazyLock;

/// Nodes of a segment seen from so far.
pub(super) struct Segments {
    /// Least distance of the disc's middle in radii.
    nearest: f32,
    /// w, and the weight of the chord there: that of w times 2 w (1 - w^2).
    chords: Vec<[f32; 2]>,
    /// Place on half a chord, 0 to 1, and its weight.
    halves: Vec<[f32; 2]>,
}

/// How many rules there are.
pub(super) const SEGMENT_RULES: usize = 5;

/// From the farthest to the nearest; errors are below 2e-4 of what the disc gives at most from there.
pub(super) static SEGMENTS: LazyLock<[Segments; SEGMENT_RULES]> = LazyLock::new(|| {
    [
        Segments::new(8.0, &gauss_legendre::<5>(), &gauss_legendre::<2>()),
        Segments::new(6.0, &gauss_legendre::<6>(), &gauss_legendre::<2>()),
        Segments::new(4.0, &gauss_legendre::<6>(), &gauss_legendre::<4>()),
        Segments::new(3.0, &gauss_legendre::<7>(), &gauss_legendre::<4>()),
        Segments::new(2.0, &gauss_legendre::<8>(), &gauss_legendre::<4>()),
    ]
});

impl Segments {
    fn new(nearest: f32, across: &[Node], along: &[Node]) -> Self {
        let chords =
            across.iter().map(|&(w, weight)| [w, 2.0 * weight * w * (1.0 - w * w)].map(|c| c as f32));
        // Weights of -1..1, twice over for the two of a pair.
        let halves = along.iter().map(|&(place, weight)| [2.0 * place - 1.0, 4.0 * weight].map(|c| c as f32));
        Self { nearest, chords: chords.collect(), halves: halves.filter(|half| half[0] > 0.0).collect() }
    }

    /// The rule for squared distances in squared radii; `None` where a disc is so near that no rule does.
    #[inline(always)]
    pub(super) fn index(distance2: f32, radius2: f32) -> Option<usize> {
        SEGMENTS.iter().position(|rule| distance2 >= rule.nearest * rule.nearest * radius2)
    }
}

/// A disc, in any unit.
#[derive(Clone, Copy)]
pub(super) struct Rim {
    /// Unit vector out of the side that shines.
    pub(super) normal: [f32; 3],
    pub(super) radius: f32,
}

impl Rim {
    /// Irradiance for radiance 1, over pi radius^2, of the part above the horizon of points that have the disc's middle `towards` them
    /// and a surface of unit normal `normal`, all of them before the disc and cut by it.
    #[inline(always)]
    pub(super) fn segments(self, rule: &Segments, towards: &[Lanes; 3], normal: &[Lanes; 3]) -> Lanes {
        let m = self.normal;
        let mut falloff = [0.0f32; LANES];
        let mut size = [0.0f32; LANES];
        let mut reach = [0.0f32; LANES];
        let mut front = [0.0f32; LANES];
        let [mut along_up, mut along_side] = [[0.0f32; LANES]; 2];
        for i in 0..LANES {
            let v = three!(|a| towards[a][i]);
            let n = three!(|a| normal[a][i]);
            let inverse = 1.0 / (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
            let v = three!(|a| v[a] * inverse);
            let facing = n[0] * m[0] + n[1] * m[1] + n[2] * m[2];
            let up = three!(|a| n[a] - facing * m[a]);
            let tilt = (up[0] * up[0] + up[1] * up[1] + up[2] * up[2]).sqrt().max(f32::MIN_POSITIVE);
            let up = three!(|a| up[a] / tilt);
            let side =
                [m[1] * up[2] - m[2] * up[1], m[2] * up[0] - m[0] * up[2], m[0] * up[1] - m[1] * up[0]];
            let radius = self.radius * inverse;
            let height = -(v[0] * m[0] + v[1] * m[1] + v[2] * m[2]);
            let middle = n[0] * v[0] + n[1] * v[1] + n[2] * v[2];
            // 1 - x0, the segment's height in radii.
            let high = 1.0 + (middle / (radius * tilt)).clamp(-1.0, 1.0);
            reach[i] = high;
            size[i] = radius;
            front[i] = height * radius * tilt * (high * high);
            falloff[i] = inverse * inverse;
            along_up[i] = 2.0 * radius * (v[0] * up[0] + v[1] * up[1] + v[2] * up[2]);
            along_side[i] = 2.0 * radius * (v[0] * side[0] + v[1] * side[1] + v[2] * side[2]);
        }
        let mut sum = [0.0f32; LANES];
        for &[w, weight] in &rule.chords {
            let (mut chord, mut base, mut skew, mut square) =
                ([0.0f32; LANES], [0.0f32; LANES], [0.0f32; LANES], [0.0f32; LANES]);
            for i in 0..LANES {
                let depth = reach[i] * (w * w);
                let x = 1.0 - depth;
                let chord2 = depth * (2.0 - depth);
                chord[i] = chord2.max(0.0).sqrt();
                let radius2 = size[i] * size[i];
                base[i] = 1.0 + x * (radius2 * x + along_up[i]);
                square[i] = radius2 * chord2;
                skew[i] = chord[i] * along_side[i];
            }
            let mut places = [0.0f32; LANES];
            for &[place, share] in &rule.halves {
                for i in 0..LANES {
                    let even = base[i] + (place * place) * square[i];
                    let odd = place * skew[i];
                    let (even2, odd2) = (even * even, odd * odd);
                    let both = even2 - odd2;
                    places[i] += share * ((even2 + odd2) / (both * both));
                }
            }
            for i in 0..LANES {
                sum[i] += weight * chord[i] * places[i];
            }
        }
        lanes!(|i| FRAC_1_PI * (front[i] * falloff[i]) * sum[i])
    }
}
