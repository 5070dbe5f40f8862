//! Pictures and planes at the size of the page.

/// Pixels along a picture of `length` pixels when `factor` become one.
pub(super) fn shrunk_length(length: usize, factor: usize) -> usize {
    length.div_ceil(factor)
}

/// The means over squares of `factor` x `factor` pixels (fewer at the right and lower edge) of a picture of `size` (width,
/// height) with `channels` interleaved samples a pixel, which `row` gives by number.
pub(super) fn shrunk(
    size: (usize, usize),
    channels: usize,
    factor: usize,
    mut row: impl FnMut(usize, &mut [f32]),
) -> Vec<f32> {
    let (width, height) = size;
    let columns = shrunk_length(width, factor);
    let mut samples = Vec::with_capacity(columns * shrunk_length(height, factor) * channels);
    let mut values = vec![0.0; width * channels];
    let mut sums = vec![0.0f64; columns * channels];
    for first in (0..height).step_by(factor) {
        sums.fill(0.0);
        let rows = factor.min(height - first);
        for y in first..first + rows {
            row(y, &mut values);
            for (x, pixel) in values.chunks_exact(channels).enumerate() {
                let sums = &mut sums[x / factor * channels..][..channels];
                sums.iter_mut().zip(pixel).for_each(|(sum, value)| *sum += f64::from(*value));
            }
        }
        samples.extend(sums.iter().enumerate().map(|(i, sum)| {
            let pixels = rows * factor.min(width - i / channels * factor);
            (sum / pixels as f64) as f32
        }));
    }
    samples
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_at_the_edge_are_means_of_what_there_is() {
        // 5 x 3 pixels of two channels, 2 x 2 of which become one.
        let picture: Vec<f32> = (0..30).map(|i| (i * i % 17) as f32).collect();
        let found = shrunk((5, 3), 2, 2, |y, row| row.copy_from_slice(&picture[y * 10..][..10]));
        let mean = |xs: &[usize], ys: &[usize], c: usize| {
            let values = ys.iter().flat_map(|y| xs.iter().map(move |x| (y * 5 + x) * 2 + c));
            let values: Vec<f32> = values.map(|i| picture[i]).collect();
            values.iter().sum::<f32>() / values.len() as f32
        };
        let columns: [&[usize]; 3] = [&[0, 1], &[2, 3], &[4]];
        let rows: [&[usize]; 2] = [&[0, 1], &[2]];
        let expected: Vec<f32> = rows
            .iter()
            .flat_map(|ys| columns.iter().flat_map(|xs| [0, 1].map(|c| mean(xs, ys, c))))
            .collect();
        assert_eq!(found, expected);
    }
}
