//! Vectors of three numbers, right-handed.

/// The scalar product.
pub fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The vector product. `cross(a, b)` is `-cross(b, a)` to the bit: the differences only change their sign.
pub fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// a - b.
pub fn difference(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// `factor` times `v`.
pub fn scaled(v: [f64; 3], factor: f64) -> [f64; 3] {
    v.map(|c| c * factor)
}

/// The length, without overflow or underflow of squares.
pub fn length(v: [f64; 3]) -> f64 {
    let largest = v.iter().fold(0.0f64, |a, c| a.max(c.abs()));
    if largest == 0.0 || !largest.is_finite() {
        return largest;
    }
    let v = v.map(|c| c / largest);
    largest * dot(v, v).sqrt()
}

/// The unit vector along `v`; `None` for 0 and for what is not finite.
pub fn unit(v: [f64; 3]) -> Option<[f64; 3]> {
    let largest = v.iter().fold(0.0f64, |a, c| a.max(c.abs()));
    if !(largest > 0.0 && v.iter().all(|c| c.is_finite())) {
        return None;
    }
    // Divided by the largest first: the length of a denormal vector has no digits.
    let v = v.map(|c| c / largest);
    let length = dot(v, v).sqrt();
    Some(v.map(|c| c / length))
}

/// The same numbers in f64.
pub fn wide(v: [f32; 3]) -> [f64; 3] {
    v.map(f64::from)
}

/// Two unit vectors that make a right-handed frame with the unit vector `axis`, always the same ones.
///
/// Source: Duff et al., *Building an Orthonormal Basis, Revisited*, JCGT 6(1), 2017, listing 3 (branch-free); -0
/// counts as 0, so that equal axes have equal frames.
pub fn frame_around([x, y, z]: [f64; 3]) -> [[f64; 3]; 2] {
    let sign = if z >= 0.0 { 1.0 } else { -1.0 };
    let a = -1.0 / (sign + z);
    let b = x * y * a;
    [[1.0 + sign * x * x * a, sign * b, -sign * x], [b, sign + y * y * a, -y]]
}
