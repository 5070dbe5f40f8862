//! Lines through the texels of a block: the ends that make the least squared error in q.

use super::scale::Scale;

/// 64ths of the way from one end to the other, by index. Source: *BC6H Format*, as in `modes`.
const WEIGHTS_8: [i32; 8] = [0, 9, 18, 27, 37, 46, 55, 64];
const WEIGHTS_16: [i32; 16] = [0, 4, 9, 13, 17, 21, 26, 30, 34, 38, 43, 47, 51, 55, 60, 64];

/// How far along a line the colour of an index lies, in 64ths.
pub(super) fn weights(colors: usize) -> &'static [i32] {
    if colors == 8 { &WEIGHTS_8 } else { &WEIGHTS_16 }
}

/// A block by channel, and what the fit needs of it.
pub(super) struct Texels {
    pub(super) scale: Scale,
    pub(super) q: [[f32; 16]; 3],
    /// Positions of q.
    position: [[f32; 16]; 3],
    /// Squared slopes: what a squared error of position costs in q.
    cost: [[f32; 16]; 3],
    /// The positions of the domain's ends.
    limits: (f32, f32),
}

/// Ends of a line, positions before rounding.
pub(super) type Ends = [[f32; 3]; 2];

/// Indices of all texels on one line, and what each costs there.
pub(super) struct Assigned {
    pub(super) index: [u8; 16],
    pub(super) error: [f32; 16],
}

impl Assigned {
    /// The error over the texels of a line.
    pub(super) fn error_of(&self, texels: u16) -> f32 {
        (0..16).filter(|i| texels >> i & 1 == 1).map(|i| self.error[i]).sum()
    }
}

impl Texels {
    /// Of 16 RGB texels.
    pub(super) fn new(texels: &[f32; 48], scale: Scale) -> Self {
        let by_channel =
            |of: &dyn Fn(f32) -> f32| std::array::from_fn(|c| std::array::from_fn(|i| of(texels[i * 3 + c])));
        let cost = |q| {
            let slope = scale.slope(q);
            slope * slope
        };
        let high = scale.position(1.0);
        Self {
            scale,
            q: by_channel(&|q| q),
            position: by_channel(&|q| scale.position(q)),
            cost: by_channel(&cost),
            limits: (if scale.signed { -high } else { 0.0 }, high),
        }
    }

    /// The nearest of the line's colours for each texel.
    pub(super) fn assign(&self, ends: [[i32; 3]; 2], colors: usize) -> Assigned {
        let mut error = [f32::INFINITY; 16];
        let mut index = [0u32; 16];
        for (k, weight) in weights(colors).iter().enumerate() {
            let color: [f32; 3] =
                std::array::from_fn(|c| self.scale.q(Scale::between(ends[0][c], ends[1][c], *weight)));
            for i in 0..16 {
                let (r, g, b) = (self.q[0][i] - color[0], self.q[1][i] - color[1], self.q[2][i] - color[2]);
                let squares = r * r + g * g + b * b;
                let nearer = squares < error[i];
                error[i] = if nearer { squares } else { error[i] };
                index[i] = if nearer { k as u32 } else { index[i] };
            }
        }
        Assigned { index: index.map(|k| k as u8), error }
    }

    /// The squared error of one channel of a line when the indices are given.
    pub(super) fn channel_error(
        &self,
        c: usize,
        ends: [i32; 2],
        texels: u16,
        index: &[u8; 16],
        colors: usize,
    ) -> f32 {
        let mut palette = [0.0; 16];
        for (color, weight) in palette.iter_mut().zip(weights(colors)) {
            *color = self.scale.q(Scale::between(ends[0], ends[1], *weight));
        }
        let square = |i: usize| {
            let difference = self.q[c][i] - palette[usize::from(index[i])];
            if texels >> i & 1 == 1 { difference * difference } else { 0.0 }
        };
        (0..16).map(square).sum()
    }

    /// The ends of least squared error for given indices, to first order: errors of position count
    /// by the squared slope at the texel.
    pub(super) fn refit(&self, before: Ends, texels: u16, index: &[u8; 16], colors: usize) -> Ends {
        let weights = weights(colors);
        let mut ends = before;
        for c in 0..3 {
            let (mut aa, mut ab, mut bb, mut ax, mut bx) = (0.0f32, 0.0f32, 0.0f32, 0.0f32, 0.0f32);
            for i in 0..16 {
                let cost = if texels >> i & 1 == 1 { self.cost[c][i] } else { 0.0 };
                let b = weights[usize::from(index[i])] as f32 / 64.0;
                let a = 1.0 - b;
                aa += cost * a * a;
                ab += cost * a * b;
                bb += cost * b * b;
                ax += cost * a * self.position[c][i];
                bx += cost * b * self.position[c][i];
            }
            let determinant = aa * bb - ab * ab;
            if determinant > 1e-4 * aa * bb {
                let (low, high) = self.limits;
                ends[0][c] = ((ax * bb - bx * ab) / determinant).clamp(low, high);
                ends[1][c] = ((bx * aa - ax * ab) / determinant).clamp(low, high);
            }
        }
        ends
    }

    /// Ends at the outermost texels along the direction of the largest variance in q.
    pub(super) fn first_ends(&self, texels: u16) -> Ends {
        let spread = Spread::of(self, texels);
        let axis = spread.axis();
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        for i in (0..16).filter(|i| texels >> i & 1 == 1) {
            let along: f32 = (0..3).map(|c| (self.q[c][i] - spread.mean[c]) * axis[c]).sum();
            low = low.min(along);
            high = high.max(along);
        }
        [low, high].map(|along| {
            std::array::from_fn(|c| {
                let q = spread.mean[c] + along * axis[c];
                self.scale.position(q.clamp(if self.scale.signed { -1.0 } else { 0.0 }, 1.0))
            })
        })
    }

    /// A guess at the error of a partition's two lines, for ranking: what is off the lines, and an
    /// 8-colour palette's share of what is along them.
    pub(super) fn guess(&self, second: u16) -> f32 {
        [!second, second].iter().map(|texels| Spread::of(self, *texels).off_line()).sum()
    }
}

/// Mean and scatter of texels in q.
struct Spread {
    mean: [f32; 3],
    /// rr, gg, bb, rg, rb, gb: sums of products of differences to the mean.
    scatter: [f32; 6],
}

impl Spread {
    fn of(block: &Texels, texels: u16) -> Self {
        let inside: [f32; 16] = std::array::from_fn(|i| f32::from(texels >> i & 1));
        let count: f32 = inside.iter().sum();
        let mean = std::array::from_fn(|c| {
            block.q[c].iter().zip(&inside).map(|(q, inside)| q * inside).sum::<f32>() / count
        });
        let mut scatter = [0.0; 6];
        for i in 0..16 {
            let [r, g, b]: [f32; 3] = std::array::from_fn(|c| (block.q[c][i] - mean[c]) * inside[i]);
            for (sum, product) in scatter.iter_mut().zip([r * r, g * g, b * b, r * g, r * b, g * b]) {
                *sum += product;
            }
        }
        Self { mean, scatter }
    }

    fn times(&self, [r, g, b]: [f32; 3]) -> [f32; 3] {
        let [rr, gg, bb, rg, rb, gb] = self.scatter;
        [rr * r + rg * g + rb * b, rg * r + gg * g + gb * b, rb * r + gb * g + bb * b]
    }

    /// The unit direction of the largest variance, by power iteration from the widest channel's row.
    fn axis(&self) -> [f32; 3] {
        let [rr, gg, bb, ..] = self.scatter;
        let mut axis = [1.0, 0.0, 0.0];
        if gg > rr && gg >= bb {
            axis = [0.0, 1.0, 0.0];
        } else if bb > rr {
            axis = [0.0, 0.0, 1.0];
        }
        for _ in 0..5 {
            let next = self.times(axis);
            let length = (next[0] * next[0] + next[1] * next[1] + next[2] * next[2]).sqrt();
            if !(length > 1e-30) {
                break;
            }
            axis = next.map(|value| value / length);
        }
        axis
    }

    fn off_line(&self) -> f32 {
        let axis = self.axis();
        let along: f32 = self.times(axis).iter().zip(axis).map(|(a, b)| a * b).sum();
        let all = self.scatter[0] + self.scatter[1] + self.scatter[2];
        (all - along).max(0.0) + along / 49.0
    }
}
