//! Blocks of three channels side by side, one in each lane: what their encoders share. No branch depends on a value, so that loops
//! over lanes become vector instructions, with the same bits however wide these are.

#![expect(clippy::needless_range_loop, reason = "a lane of several rows at once")]

use super::encode::BlockRow;

/// Blocks side by side.
pub(super) const LANES: usize = 16;

/// A value of each block.
pub(super) type Lanes = [f32; LANES];

/// Texels of a block.
pub(super) const TEXELS: usize = 16;

/// By texel and channel.
pub(super) type Texels = [[Lanes; 3]; TEXELS];

/// Two colours of each block.
pub(super) type Ends = [[Lanes; 3]; 2];

/// The blocks from number `index` x [`LANES`] on, as many as there are; what other lanes held stays.
pub(super) fn gather(row: &BlockRow<'_>, index: usize, count: usize, texels: &mut Texels) {
    let stride = row.width * row.channels;
    for (texel, values) in texels.iter_mut().enumerate() {
        let first = texel / 4 * stride + (index * LANES * 4 + texel % 4) * row.channels;
        for lane in 0..count {
            let at = first + lane * 4 * row.channels;
            for (values, value) in values.iter_mut().zip(&row.texels[at..at + 3]) {
                values[lane] = *value;
            }
        }
    }
}

/// The nearest integer, for magnitudes below 2^22, in two additions.
#[inline(always)]
pub(super) fn nearest(value: f32) -> f32 {
    (value + 12_582_912.0) - 12_582_912.0
}

/// Between 0 and `most`, without `clamp`'s care for NaN.
#[inline(always)]
pub(super) fn limited(value: f32, most: f32) -> f32 {
    let low = if value > 0.0 { value } else { 0.0 };
    if low < most { low } else { most }
}

/// 1 for texels that count, else 0.
pub(super) type Mask = [Lanes; TEXELS];

/// The moments xx, xy, xz, yy, yz, zz of the texels that count about their mean.
#[inline(always)]
pub(super) fn moments_of(texels: &Texels, mask: &Mask, means: &[Lanes; 3]) -> [Lanes; 6] {
    let mut moments = [[0.0f32; LANES]; 6];
    for (texel, mask) in texels.iter().zip(mask) {
        for i in 0..LANES {
            let x = mask[i] * (texel[0][i] - means[0][i]);
            let y = mask[i] * (texel[1][i] - means[1][i]);
            let z = mask[i] * (texel[2][i] - means[2][i]);
            moments[0][i] += x * x;
            moments[1][i] += x * y;
            moments[2][i] += x * z;
            moments[3][i] += y * y;
            moments[4][i] += y * z;
            moments[5][i] += z * z;
        }
    }
    moments
}

/// Ends on the axis through the mean, with shares `insets` of the range cut off at its start and at its end.
#[inline(always)]
pub(super) fn ends_on_axis(
    means: &[Lanes; 3],
    axis: &[Lanes; 3],
    range: &[Lanes; 2],
    insets: [f32; 2],
) -> Ends {
    let mut ends = [[[0.0; LANES]; 3]; 2];
    for c in 0..3 {
        for i in 0..LANES {
            let width = range[1][i] - range[0][i];
            ends[0][c][i] = means[c][i] + axis[c][i] * (range[0][i] + insets[0] * width);
            ends[1][c][i] = means[c][i] + axis[c][i] * (range[1][i] - insets[1] * width);
        }
    }
    ends
}

/// Ends whose error is less take the place of the best.
#[inline(always)]
pub(super) fn keep_better(error: &Lanes, ends: &Ends, best_error: &mut Lanes, best: &mut Ends) {
    for end in 0..2 {
        for c in 0..3 {
            for i in 0..LANES {
                best[end][c][i] = if error[i] < best_error[i] { ends[end][c][i] } else { best[end][c][i] };
            }
        }
    }
    for i in 0..LANES {
        best_error[i] = if error[i] < best_error[i] { error[i] } else { best_error[i] };
    }
}

/// The principal axis of each block, about as long as 1, from the moments xx, xy, xz, yy, yz, zz about the mean; 0 where there is none.
#[inline(always)]
pub(super) fn principal_axis(moments: &[Lanes; 6]) -> [Lanes; 3] {
    let mut axis = [[0.0; LANES]; 3];
    for i in 0..LANES {
        let v = turned_by(moments, i, 4);
        let length = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
        let inverse = if length > 1e-18 { 1.0 / length } else { 0.0 };
        axis[0][i] = v[0] * inverse;
        axis[1][i] = v[1] * inverse;
        axis[2][i] = v[2] * inverse;
    }
    axis
}

/// Adds about what of the moments' trace lies beside their principal axis to `beside`, and the rest to `along`.
///
/// The sum of the eigenvalues' squares tells it without finding them: with s and t in two directions it is st / (s + t), nearly the
/// smaller one.
#[inline(always)]
pub(super) fn spread(moments: &[Lanes; 6], beside: &mut Lanes, along: &mut Lanes) {
    for i in 0..LANES {
        let [xx, xy, xz, yy, yz, zz] =
            [moments[0][i], moments[1][i], moments[2][i], moments[3][i], moments[4][i], moments[5][i]];
        let trace = xx + yy + zz;
        let squares = xx * xx + yy * yy + zz * zz + 2.0 * (xy * xy + xz * xz + yz * yz);
        let off = 0.5 * (trace - squares / (trace + f32::MIN_POSITIVE));
        beside[i] += off;
        along[i] += trace - off;
    }
}

/// The moments' row of the channel that varies most, multiplied by the moments so often.
#[inline(always)]
fn turned_by(moments: &[Lanes; 6], i: usize, times: usize) -> [f32; 3] {
    let [xx, xy, xz, yy, yz, zz] =
        [moments[0][i], moments[1][i], moments[2][i], moments[3][i], moments[4][i], moments[5][i]];
    let x_first = xx >= yy && xx >= zz;
    let y_first = yy >= zz;
    let rest = if y_first { [xy, yy, yz] } else { [xz, yz, zz] };
    let mut v = if x_first { [xx, xy, xz] } else { rest };
    for _ in 0..times {
        let [a, b, c] = [v[0].abs(), v[1].abs(), v[2].abs()];
        let ab = if a > b { a } else { b };
        let most = if ab > c { ab } else { c };
        let scale = 1.0 / (most + f32::MIN_POSITIVE);
        let [x, y, z] = [v[0] * scale, v[1] * scale, v[2] * scale];
        v = [xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z];
    }
    v
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Numbers that look random and are always the same, 0..1.
    struct Random(u32);

    impl Random {
        fn next(&mut self) -> f32 {
            self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (self.0 >> 8) as f32 / (1 << 24) as f32
        }
    }

    /// A row of blocks: smooth, noisy, of two colours, of three, grey, and constant ones.
    pub(crate) fn row(blocks: usize) -> Vec<f32> {
        let mut random = Random(5);
        let mut texels = vec![0.0; 4 * 4 * blocks * 3];
        for block in 0..blocks {
            let mut color = || [random.next(), random.next(), random.next()];
            let (a, b) = (color(), color());
            for texel in 0..TEXELS {
                let t = match block % 6 {
                    0 => (texel % 4 + texel / 4) as f32 / 6.0,
                    1 => random.next(),
                    2 => (texel % 2) as f32,
                    3 => (texel % 3) as f32 / 2.0,
                    4 => random.next().round(),
                    _ => 0.0,
                };
                for c in 0..3 {
                    let noise = if block % 6 == 1 { 0.1 * random.next() } else { 0.0 };
                    let value = (a[c] + t * (b[c] - a[c]) + noise).clamp(0.0, 1.0);
                    texels[(texel / 4 * 4 * blocks + 4 * block + texel % 4) * 3 + c] = value;
                }
            }
        }
        texels
    }
}
