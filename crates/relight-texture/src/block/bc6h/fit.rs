//! Lines through the texels of a block: the ends that make the least squared error in q.

#![expect(clippy::needless_range_loop, reason = "several arrays by one index")]

use super::scale::Scale;

/// How far along a line of N colours each colour lies, in 64ths. Source: *BC6H Format*.
const fn weights<const N: usize>() -> [f32; N] {
    const EIGHT: [f32; 8] = [0.0, 9.0, 18.0, 27.0, 37.0, 46.0, 55.0, 64.0];
    const SIXTEEN: [f32; 16] =
        [0.0, 4.0, 9.0, 13.0, 17.0, 21.0, 26.0, 30.0, 34.0, 38.0, 43.0, 47.0, 51.0, 55.0, 60.0, 64.0];
    let mut weights = [0.0; N];
    let mut i = 0;
    while i < N {
        weights[i] = if N == 8 { EIGHT[i] } else { SIXTEEN[i] };
        i += 1;
    }
    weights
}

/// A block by channel, and what the fit needs of it.
pub(super) struct Texels {
    pub(super) scale: Scale,
    q: [[f32; 16]; 3],
    /// Positions of q.
    position: [[f32; 16]; 3],
    /// Squared slopes: what a squared error of position costs in q.
    cost: [[f32; 16]; 3],
    /// The positions of the domain's ends.
    limits: (f32, f32),
    mean: [f32; 3],
    whole: Spread,
}

/// The texels of a line: 1 for its own, 0 for the others.
pub(super) type Members = [f32; 16];

/// The members of the line whose texels are the bits that are set.
pub(super) fn members(texels: u16) -> Members {
    std::array::from_fn(|i| f32::from(texels >> i & 1))
}

/// Ends of a line, positions before rounding.
pub(super) type Ends = [[f32; 3]; 2];

/// The sum, in an order that needs no shuffling of vectors.
fn sum(values: [f32; 16]) -> f32 {
    let four: [f32; 4] =
        std::array::from_fn(|i| (values[i] + values[4 + i]) + (values[8 + i] + values[12 + i]));
    (four[0] + four[2]) + (four[1] + four[3])
}

fn products(a: &[f32; 16], b: &[f32; 16]) -> [f32; 16] {
    std::array::from_fn(|i| a[i] * b[i])
}

/// The colours of one channel between two ends.
fn palette<const N: usize>(scale: Scale, ends: [i32; 2]) -> [f32; N] {
    let [a, b] = ends.map(|position| position as f32);
    let weights = weights::<N>();
    let mut palette = [0.0; N];
    for k in 0..N {
        // Exact, since the sum is an integer below 2^22: added to 1.5 x 2^23, it is what the bits
        // are above those of that number. A conversion would not be compiled to vectors.
        let sum = a * (64.0 - weights[k]) + b * weights[k] + 32.0;
        let position = ((sum + 12_582_912.0).to_bits() as i32 - 0x4b40_0000) >> 6;
        palette[k] = scale.q(position);
    }
    palette
}

/// The texels of a line by index, in one channel.
pub(super) struct Bins<const N: usize> {
    count: [f32; N],
    mean: [f32; N],
}

impl<const N: usize> Bins<N> {
    /// What ends cost, less what no ends can help.
    pub(super) fn error(&self, scale: Scale, ends: [i32; 2]) -> f32 {
        let palette = palette::<N>(scale, ends);
        let mut four = [0.0; 4];
        for k in 0..N {
            let difference = palette[k] - self.mean[k];
            four[k % 4] += self.count[k] * difference * difference;
        }
        (four[0] + four[2]) + (four[1] + four[3])
    }
}

impl Texels {
    /// Of 16 RGB texels.
    pub(super) fn new(texels: &[f32; 48], scale: Scale) -> Self {
        let q: [[f32; 16]; 3] = std::array::from_fn(|c| std::array::from_fn(|i| texels[i * 3 + c]));
        let high = scale.position(1.0);
        let mean = q.map(|channel| sum(channel) / 16.0);
        let mut block = Self {
            scale,
            q,
            position: q.map(|channel| channel.map(|q| scale.position(q))),
            cost: q.map(|channel| channel.map(|q| scale.slope(q) * scale.slope(q))),
            limits: (if scale.signed { -high } else { 0.0 }, high),
            mean,
            whole: Spread::default(),
        };
        block.whole = block.spread(&members(u16::MAX));
        block
    }

    /// The nearest of a line's N colours for each texel: its index, and the line's error.
    pub(super) fn assign<const N: usize>(&self, ends: [[i32; 3]; 2], line: &Members) -> ([u8; 16], f32) {
        let palettes: [[f32; N]; 3] = std::array::from_fn(|c| palette(self.scale, [ends[0][c], ends[1][c]]));
        let mut error = [f32::INFINITY; 16];
        let mut index = [0u32; 16];
        for k in 0..N {
            for i in 0..16 {
                let [r, g, b]: [f32; 3] = std::array::from_fn(|c| self.q[c][i] - palettes[c][k]);
                let squares = r * r + g * g + b * b;
                let nearer = squares < error[i];
                error[i] = if nearer { squares } else { error[i] };
                index[i] = if nearer { k as u32 } else { index[i] };
            }
        }
        (index.map(|k| k as u8), sum(products(&error, line)))
    }

    /// The texels of a line in one channel, by index.
    pub(super) fn bins<const N: usize>(&self, c: usize, line: &Members, index: &[u8; 16]) -> Bins<N> {
        let (mut count, mut mean) = ([0.0; N], [0.0; N]);
        for i in 0..16 {
            count[usize::from(index[i]) % N] += line[i];
            mean[usize::from(index[i]) % N] += line[i] * self.q[c][i];
        }
        mean.iter_mut().zip(&count).for_each(|(mean, count)| *mean /= count.max(1.0));
        Bins { count, mean }
    }

    /// The ends of least squared error for given indices, to first order: errors of position count
    /// by the squared slope at the texel.
    pub(super) fn refit<const N: usize>(&self, before: Ends, line: &Members, index: &[u8; 16]) -> Ends {
        let weights = weights::<N>();
        let b: [f32; 16] = std::array::from_fn(|i| weights[usize::from(index[i]) % N] / 64.0);
        let a = b.map(|b| 1.0 - b);
        let mut ends = before;
        for c in 0..3 {
            let cost = products(&self.cost[c], line);
            let (cost_a, cost_b) = (products(&cost, &a), products(&cost, &b));
            let (aa, ab, bb) =
                (sum(products(&cost_a, &a)), sum(products(&cost_a, &b)), sum(products(&cost_b, &b)));
            let ax = sum(products(&cost_a, &self.position[c]));
            let bx = sum(products(&cost_b, &self.position[c]));
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
    pub(super) fn first_ends(&self, line: &Members) -> Ends {
        let spread = self.spread(line);
        let mean = spread.mean();
        let axis = axis(&spread.scatter());
        let length = (axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]).sqrt();
        let axis = axis.map(|value| value / length);
        let (mut low, mut high) = (0.0f32, 0.0f32);
        for i in 0..16 {
            let [r, g, b]: [f32; 3] =
                std::array::from_fn(|c| (self.q[c][i] - self.mean[c] - mean[c]) * axis[c]);
            let along = (r + g + b) * line[i];
            low = low.min(along);
            high = high.max(along);
        }
        let least = if self.scale.signed { -1.0 } else { 0.0 };
        [low, high].map(|along| {
            std::array::from_fn(|c| {
                let q = self.mean[c] + mean[c] + along * axis[c];
                self.scale.position(q.clamp(least, 1.0))
            })
        })
    }

    /// A guess at the error of a block with two lines, for ranking: what is off the lines, and an
    /// 8-colour palette's share of what is along them.
    pub(super) fn guess(&self, second: &Members) -> f32 {
        let second = self.spread(second);
        second.off_line() + self.whole.without(&second).off_line()
    }

    fn spread(&self, line: &Members) -> Spread {
        let [r, g, b]: [[f32; 16]; 3] =
            std::array::from_fn(|c| std::array::from_fn(|i| (self.q[c][i] - self.mean[c]) * line[i]));
        let product = |a, b| sum(products(a, b));
        Spread {
            count: sum(*line),
            sums: [sum(r), sum(g), sum(b)],
            squares: [
                product(&r, &r),
                product(&g, &g),
                product(&b, &b),
                product(&r, &g),
                product(&r, &b),
                product(&g, &b),
            ],
        }
    }
}

/// Moments of some texels in q, less the block's mean.
#[derive(Default)]
struct Spread {
    count: f32,
    sums: [f32; 3],
    /// rr, gg, bb, rg, rb, gb.
    squares: [f32; 6],
}

impl Spread {
    fn without(&self, other: &Self) -> Self {
        Self {
            count: self.count - other.count,
            sums: std::array::from_fn(|i| self.sums[i] - other.sums[i]),
            squares: std::array::from_fn(|i| self.squares[i] - other.squares[i]),
        }
    }

    fn mean(&self) -> [f32; 3] {
        self.sums.map(|sum| sum / self.count)
    }

    /// Sums of products of differences to the mean.
    fn scatter(&self) -> [f32; 6] {
        let ([r, g, b], [x, y, z]) = (self.mean(), self.sums);
        let mut scatter = self.squares;
        let of_mean = [r * x, g * y, b * z, r * y, r * z, g * z];
        scatter.iter_mut().zip(of_mean).for_each(|(square, of_mean)| *square -= of_mean);
        scatter
    }

    fn off_line(&self) -> f32 {
        let scatter = self.scatter();
        let axis = axis(&scatter);
        let dot = |a: [f32; 3], b: [f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let along = dot(times(&scatter, axis), axis) / dot(axis, axis);
        (scatter[0] + scatter[1] + scatter[2] - along).max(0.0) + along / 49.0
    }
}

/// A direction close to that of the largest variance, by power iteration from the widest channel's
/// row; its length is not 1.
fn axis(scatter: &[f32; 6]) -> [f32; 3] {
    let trace = scatter[0] + scatter[1] + scatter[2];
    if trace < 1e-30 {
        return [1.0; 3];
    }
    let scatter = scatter.map(|value| value / trace);
    let [rr, gg, bb, rg, rb, gb] = scatter;
    let mut axis = [rr, rg, rb];
    if gg > rr && gg >= bb {
        axis = [rg, gg, gb];
    } else if bb > rr {
        axis = [rb, gb, bb];
    }
    for _ in 0..2 {
        axis = times(&scatter, axis);
    }
    axis
}

fn times([rr, gg, bb, rg, rb, gb]: &[f32; 6], [r, g, b]: [f32; 3]) -> [f32; 3] {
    [rr * r + rg * g + rb * b, rg * r + gg * g + gb * b, rb * r + gb * g + bb * b]
}
