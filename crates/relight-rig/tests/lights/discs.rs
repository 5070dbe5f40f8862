//! Discs against sums that know nothing of contours.

use crate::{COLOR, Random, apart, disc, dot, largest};
use std::f64::consts::PI;

/// Adaptive Simpson's rule.
fn simpson(f: &dyn Fn(f64) -> f64, from: f64, to: f64, tolerance: f64) -> f64 {
    fn split(
        f: &dyn Fn(f64) -> f64,
        (a, fa, m, fm, b, fb): (f64, f64, f64, f64, f64, f64),
        whole: f64,
        tolerance: f64,
        depth: u32,
    ) -> f64 {
        let (l, r) = (0.5 * (a + m), 0.5 * (m + b));
        let (fl, fr) = (f(l), f(r));
        let left = (m - a) / 6.0 * (fa + 4.0 * fl + fm);
        let right = (b - m) / 6.0 * (fm + 4.0 * fr + fb);
        let change = left + right - whole;
        if depth == 0 || change.abs() <= 15.0 * tolerance {
            return left + right + change / 15.0;
        }
        split(f, (a, fa, l, fl, m, fm), left, tolerance, depth - 1)
            + split(f, (m, fm, r, fr, b, fb), right, tolerance, depth - 1)
    }
    // Pieces first: what shows for a few degrees only is not to be missed.
    (0..301).fold(0.0, |sum, i| {
        let step = (to - from) / 301.0;
        let (a, b) = (from + step * f64::from(i), from + step * f64::from(i + 1));
        let m = 0.5 * (a + b);
        let (fa, fm, fb) = (f(a), f(m), f(b));
        sum + split(f, (a, fa, m, fm, b, fb), step / 6.0 * (fa + 4.0 * fm + fb), tolerance / 301.0, 20)
    })
}

/// Irradiance of a disc of radius 1 at height z = h, x = a, by azimuth around z; within an azimuth it is in closed form.
fn by_azimuth(h: f64, a: f64, n: [f64; 3], tolerance: f64) -> f64 {
    let at = |phi: f64, rays: [f64; 2]| {
        let (sin, cos) = libm::sincos(phi);
        let across = n[0] * cos + n[1] * sin;
        // n.w = |..| cos(theta - lean) above the horizon.
        let lean = libm::atan2(across, n[2]);
        let [from, to] =
            [libm::atan2(rays[0], h).max(lean - 0.5 * PI), libm::atan2(rays[1], h).min(lean + 0.5 * PI)];
        let integral = |t: f64| {
            let (sin, cos) = libm::sincos(t);
            0.5 * (n[2] * sin * sin + across * (t - sin * cos))
        };
        if to > from { integral(to) - integral(from) } else { 0.0 }
    };
    if a < 1.0 {
        let around = |phi: f64| {
            let (sin, cos) = libm::sincos(phi);
            at(phi, [0.0, a * cos + (1.0 - a * a * sin * sin).max(0.0).sqrt()])
        };
        simpson(&around, -PI, PI, tolerance)
    } else {
        let across = |tau: f64| {
            let (sin, cos) = libm::sincos(tau);
            let phi = libm::asin(sin / a);
            let (middle, half) = (a * libm::cos(phi), cos);
            cos / (a * libm::cos(phi)) * at(phi, [middle - half, middle + half])
        };
        simpson(&across, -0.5 * PI, 0.5 * PI, tolerance)
    }
}

/// Near, far, above the disc, beside it, next to the rim, in all attitudes, most of them cut by the horizon.
#[test]
fn irradiance_cut_by_the_horizon() {
    let mut random = Random(7);
    let mut cut = 0;
    let places: [(f64, f64); 17] = [
        (1e-3, 0.3),
        (1e-3, 0.999),
        (1e-3, 1.001),
        (1e-3, 2.0),
        (0.1, 0.0),
        (0.5, 0.0),
        (0.5, 1e-9),
        (0.5, 0.5),
        (0.7, 1.0),
        (1.0, 3.0),
        (3.0, 1.0),
        (0.01, 9.0),
        (20.0, 5.0),
        (30.0, 5.0),
        (300.0, 40.0),
        (1e6, 0.0),
        (1e6, 3e5),
    ];
    for (h, a) in places {
        let scale = 1.0 / (1.0 + h * h + a * a);
        for attitude in 0..40 {
            let mut n = random.direction();
            if attitude >= 20 {
                // The horizon within the disc, at its edge and just beside it.
                let reach: f64 = [-1.001, -0.999999, -0.5, 0.0, 0.3, 0.99][attitude % 6];
                let length = (h * h + (a + reach) * (a + reach)).sqrt();
                let (up, side) = ([-h / length, 0.0, (a + reach) / length], [0.0, 1.0, 0.0]);
                let turn = 0.3 * random.number();
                let sign = if attitude % 2 == 0 { 1.0 } else { -1.0 };
                n = [0, 1, 2].map(|i| sign * libm::cos(turn) * up[i] + libm::sin(turn) * side[i]);
            }
            let light = disc([a, 0.0, h], [0.0, 0.0, -1.0], 1.0);
            let found = light.irradiance([0.0; 3], n)[1] / COLOR[1];
            let exact = by_azimuth(h, a, n, 1e-12 * scale);
            assert!((found - exact).abs() <= 1e-10 * scale, "h {h} a {a} n {n:?}: {found} for {exact}");
            cut += u32::from(exact > 0.0 && exact > 1.001 * light_facing(h, a, n));
        }
    }
    assert!(cut > 150, "{cut} were cut");
}

/// n.Phi, of what is below the horizon, too.
fn light_facing(h: f64, a: f64, n: [f64; 3]) -> f64 {
    let light = disc([a, 0.0, h], [0.0, 0.0, -1.0], 1.0);
    let mut values = vec![[0.0; 3]; 4];
    light.add_projection([0.0; 3], 2, &mut values);
    let factor = (0.75 / PI).sqrt() * COLOR[1];
    dot(n, [-values[3][1], -values[1][1], values[2][1]]) / factor
}

#[test]
fn nothing_is_seen_from_the_plane_and_from_behind() {
    let light = disc([0.0, 0.0, 1.0], [0.0, 0.0, -1.0], 2.0);
    for z in [1.0, 1.0 + 1e-12, 1.5, 100.0] {
        for normal in [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]] {
            assert_eq!(light.irradiance([0.3, 0.2, z], normal), [0.0; 3]);
        }
        let (mut values, mut slopes) = (vec![[0.0; 3]; 36], vec![[[0.0; 3]; 3]; 36]);
        light.add_projection_with_gradient([0.3, 0.2, z], 6, &mut values, &mut slopes);
        assert!(values.iter().all(|v| *v == [0.0; 3]) && slopes.iter().all(|s| *s == [[0.0; 3]; 3]));
    }
    // Right before its face half of all directions shine.
    let found = light.irradiance([0.3, 0.2, 1.0 - 1e-9], [0.0, 0.0, 1.0])[0];
    assert!((found / PI - 1.0).abs() < 1e-8, "{found}");
}

/// The sum over the area from afar and the integral along the rim from near are the same; so are radii of any size.
#[test]
fn rim_and_area_agree_where_they_meet() {
    let mut random = Random(3);
    for _ in 0..50 {
        let (away, normal) = (random.direction(), random.direction());
        let seen = |distance: f64, radius: f64| {
            let (mut values, mut slopes) = (vec![[0.0; 3]; 36], vec![[[0.0; 3]; 3]; 36]);
            disc(away.map(|c| distance * radius * c), normal, radius).add_projection_with_gradient(
                [0.0; 3],
                6,
                &mut values,
                &mut slopes,
            );
            let slopes: Vec<_> = slopes.iter().flatten().map(|s| s.map(|c| c * radius)).collect();
            (values, slopes)
        };
        let (near, far) = (seen(16.0 - 1e-11, 1.0), seen(16.0 + 1e-11, 1.0));
        for (near, far) in [(&near.0, &far.0), (&near.1, &far.1)] {
            assert!(apart(near, far) <= 1e-11 * largest(far), "{} of {}", apart(near, far), largest(far));
        }
        for scale in [1e-30, 1e30] {
            let (other, far) = (seen(3.0, scale), seen(3.0, 1.0));
            assert!(apart(&other.0, &far.0) <= 1e-13 * largest(&far.0));
            assert!(apart(&other.1, &far.1) <= 1e-13 * largest(&far.1));
        }
    }
}

/// Near the rim and in the middle, against the light of very many points.
#[test]
fn harmonics_are_those_of_the_area() {
    let mut random = Random(5);
    for point in [[0.2, 0.1, 0.5], [0.9, 0.4, 0.3], [2.0, 1.0, 0.4], [0.0, 0.0, 1.0]] {
        let normal = random.direction();
        let [x, y] = relight_core::vectors::frame_around(normal);
        let point = [0, 1, 2].map(|i| x[i] * point[0] + y[i] * point[1] + normal[i] * point[2]);
        let mut found = vec![[0.0; 3]; 36];
        disc([0.0; 3], normal, 1.0).add_projection(point, 6, &mut found);
        let mut sum = vec![[0.0; 3]; 36];
        let (rings, spokes) = (400, 400);
        for ring in 0..rings {
            for spoke in 0..spokes {
                let radius = ((f64::from(ring) + 0.5) / f64::from(rings)).sqrt();
                let (sin, cos) = libm::sincos(2.0 * PI * (f64::from(spoke) + 0.5) / f64::from(spokes));
                let position = [0, 1, 2].map(|i| radius * (x[i] * cos + y[i] * sin));
                let towards = [0, 1, 2].map(|i| position[i] - point[i]);
                let distance = dot(towards, towards).sqrt();
                let weight = -dot(towards, normal) / distance * PI / f64::from(rings * spokes);
                let node = relight_rig::Light {
                    color: COLOR.map(|c| c * weight),
                    ..crate::light(relight_rig::Source::Point { position, nearest: 1e-9 })
                };
                node.add_projection(point, 6, &mut sum);
            }
        }
        assert!(apart(&found, &sum) < 1e-4 * largest(&sum), "{} of {}", apart(&found, &sum), largest(&sum));
    }
}
