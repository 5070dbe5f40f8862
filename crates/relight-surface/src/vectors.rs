//! Vectors of three numbers.

pub(crate) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// `cross(a, b)` is `-cross(b, a)` to the bit: the differences only change their sign.
pub(crate) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(crate) fn difference(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(crate) fn scaled(v: [f64; 3], factor: f64) -> [f64; 3] {
    v.map(|c| c * factor)
}

/// The length, without overflow or underflow of squares.
pub(crate) fn length(v: [f64; 3]) -> f64 {
    let largest = v.iter().fold(0.0f64, |a, c| a.max(c.abs()));
    if largest == 0.0 || !largest.is_finite() {
        return largest;
    }
    let v = v.map(|c| c / largest);
    largest * dot(v, v).sqrt()
}

/// The unit vector along `v`; `None` for 0 and for what is not finite.
pub(crate) fn unit(v: [f64; 3]) -> Option<[f64; 3]> {
    let largest = v.iter().fold(0.0f64, |a, c| a.max(c.abs()));
    if !(largest > 0.0 && v.iter().all(|c| c.is_finite())) {
        return None;
    }
    // Divided by the largest first: the length of a denormal vector has no digits.
    let v = v.map(|c| c / largest);
    let length = dot(v, v).sqrt();
    Some(v.map(|c| c / length))
}

pub(crate) fn wide(v: [f32; 3]) -> [f64; 3] {
    v.map(f64::from)
}
