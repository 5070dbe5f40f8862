//! Lights against values of 20 to 50 digits (testdata/golden, made with mpmath), in f64 and f32.

use crate::{COLOR, light, sphere};
use relight_core::CpuLevel;
use relight_rig::{CutDiscs, Projector, Source, SurfaceRows, add_reflectance, cosine_lobe};
use serde_json::Value;
use std::f64::consts::PI;

fn golden(name: &str) -> Value {
    let path = format!("{}/../../testdata/golden/{name}", env!("CARGO_MANIFEST_DIR"));
    serde_json::from_slice(&std::fs::read(&path).expect(&path)).expect(&path)
}

/// The entries of the list `key`; a file without any would make a test that cannot fail.
fn entries<'a>(value: &'a Value, key: &str) -> &'a [Value] {
    let list = value[key].as_array().expect(key);
    assert!(!list.is_empty(), "{key} is empty");
    list
}

/// A number, or one written as a decimal string of more digits than f64 has.
fn number(value: &Value) -> f64 {
    match value {
        Value::String(digits) => digits.parse().expect(digits),
        other => other.as_f64().expect("a number"),
    }
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("a list").iter().map(number).collect()
}

fn vector(value: &Value) -> [f64; 3] {
    numbers(value).try_into().unwrap()
}

#[test]
fn cosine_lobes() {
    for (l, exact) in numbers(&golden("cosine_lobe.json")["A"]).into_iter().enumerate() {
        let found = cosine_lobe(l);
        assert!((found - exact).abs() <= 1e-9 * exact.abs(), "A_{l}: {found} for {exact}");
    }
}

/// z_l and g_l are the coefficients along the axis through the light, over Y_l0 there.
#[test]
fn zonal_coefficients_of_spheres() {
    for case in entries(&golden("zh_sphere.json"), "cases") {
        let (r, d) = (number(&case["r"]), number(&case["d"]));
        let (mut values, mut gradients) = (vec![[0.0; 3]; 36], vec![[[0.0; 3]; 3]; 36]);
        sphere([0.0, 0.0, d], r).add_projection_with_gradient([0.0; 3], 6, &mut values, &mut gradients);
        for l in 0..6 {
            let pole = ((2 * l + 1) as f64 / (4.0 * PI)).sqrt();
            for channel in 0..3 {
                let factor = pole * COLOR[channel];
                let (z, g) = (values[l * l + l][channel] / factor, gradients[l * l + l][2][channel] / factor);
                let exact = number(&case["z"][l]);
                assert!((z - exact).abs() <= 1e-9 * exact.abs(), "r {r} d {d} z_{l}: {z} for {exact}");
                if !case["g"][l].is_null() && r < d {
                    let exact = number(&case["g"][l]);
                    assert!((g - exact).abs() <= 1e-9 * exact.abs(), "r {r} d {d} g_{l}: {g} for {exact}");
                }
            }
        }
    }
}

#[test]
fn gradients_of_spheres() {
    for case in entries(&golden("sh_gradient_sphere.json"), "cases") {
        let light = sphere(vector(&case["light"]), number(&case["r"]));
        let (mut values, mut gradients) = (vec![[0.0; 3]; 16], vec![[[0.0; 3]; 3]; 16]);
        light.add_projection_with_gradient([0.0; 3], 4, &mut values, &mut gradients);
        let mut alone = vec![[0.0; 3]; 16];
        light.add_projection([0.0; 3], 4, &mut alone);
        assert_eq!(values, alone);
        for (i, exact) in numbers(&case["sh"]).into_iter().enumerate() {
            let found = values[i][1] / COLOR[1];
            assert!((found - exact).abs() <= 1e-9 * exact.abs() + 1e-15, "{i}: {found} for {exact}");
            for (axis, exact) in numbers(&case["grad_xyz"][i]).into_iter().enumerate() {
                let found = gradients[i][axis][2] / COLOR[2];
                assert!(
                    (found - exact).abs() <= 1e-9 * exact.abs() + 1e-15,
                    "{i} {axis}: {found} for {exact}"
                );
            }
        }
    }
}

/// MATH.md: every z_l and g_l within 1e-7 of the largest, which functions, sums and colours in f32 make 1e-6 and 2e-6.
#[test]
fn zonal_coefficients_of_spheres_side_by_side() {
    for case in entries(&golden("zh_sphere.json"), "cases") {
        let (r, d) = (number(&case["r"]), number(&case["d"]));
        let light = sphere([0.0, 0.0, d], r);
        let projector = Projector::new(&[(&light, 1.0)], 6, ([0.0; 3], 0.0));
        let (mut values, mut gradients) = (vec![[0.0; 3]; 36], vec![[[0.0; 3]; 3]; 36]);
        projector.project_with_gradient(CpuLevel::detect(), [0.0; 3], &mut values, &mut gradients);
        let [z, g] = ["z", "g"].map(|key| case[key].as_array().unwrap());
        let largest = |list: &[Value]| list.iter().filter(|v| !v.is_null()).map(number).fold(0.0, f64::max);
        for l in 0..6 {
            let pole = ((2 * l + 1) as f64 / (4.0 * PI)).sqrt();
            for channel in 0..3 {
                let factor = pole * COLOR[channel];
                let found = values[l * l + l][channel] / factor;
                let exact = number(&z[l]);
                assert!((found - exact).abs() <= 1e-6 * largest(z), "r {r} d {d} z_{l}: {found} for {exact}");
                if !g[l].is_null() && r < d {
                    let (found, exact) = (gradients[l * l + l][2][channel] / factor, number(&g[l]));
                    assert!(
                        (found - exact).abs() <= 2e-6 * largest(g),
                        "r {r} d {d} g_{l}: {found} for {exact}"
                    );
                }
            }
        }
    }
}

/// MATH.md: within 4e-7 sine^3 to a sine of .9, where it says nothing within 1e-6.
#[test]
fn clipped_irradiance_of_spheres_side_by_side() {
    let mut worst = 0.0f64;
    for row in entries(&golden("sphere_irradiance_clipped.json"), "rows") {
        let [cosine, radius, _] = vector(row);
        let (nz, r) = (cosine as f32, radius as f32);
        // The golden value is that of f64's cosine; the closed form in f64, which it judges above, is f32's.
        let nx = ((1.0 - nz) * (1.0 + nz)).sqrt();
        let light = sphere([0.0, 0.0, 1.0], f64::from(r));
        let exact = light.irradiance([0.0; 3], [f64::from(nx), 0.0, f64::from(nz)])[1] / PI;
        let points = SurfaceRows { x: &[0.0], y: &[0.0], z: &[0.0], nx: &[nx], ny: &[0.0], nz: &[nz] };
        let (mut red, mut green, mut blue) = ([0.0], [0.0], [0.0]);
        let out = [&mut red[..], &mut green, &mut blue];
        add_reflectance(&light, CutDiscs::Exact, CpuLevel::detect(), &points, out);
        let error = (f64::from(green[0]) - exact).abs() * PI / COLOR[1];
        let size = radius * radius * radius.max(cosine.abs()).min(1.0);
        let bound = if radius <= 0.9 { 4e-7 * size } else { 1e-6 };
        assert!(error <= bound, "cos {cosine} r {radius}: off by {error}, bound {bound}");
        worst = worst.max(error / size);
    }
    assert!(worst > 1e-9, "nothing was compared");
}

/// To 1e-9 of themselves, also where 1e-8 of the sphere's irradiance are above the horizon; 0 where it is 0.
#[test]
fn clipped_irradiance_of_spheres() {
    for row in entries(&golden("sphere_irradiance_clipped.json"), "rows") {
        let [cosine, radius, exact] = vector(row);
        // The cosine is the normal's z to the bit.
        let normal = [((1.0 - cosine) * (1.0 + cosine)).sqrt(), 0.0, cosine];
        let found = sphere([0.0, 0.0, 1.0], radius).irradiance([0.0; 3], normal)[2] / COLOR[2];
        assert!((found - exact).abs() <= 1e-9 * exact, "cos {cosine} r {radius}: {found} for {exact}");
    }
}

/// Golden harmonics are quadrature's, good to 1e-15.
#[test]
fn discs() {
    for case in entries(&golden("disc_light.json"), "cases") {
        let (centre, radius) = (vector(&case["centre"]), number(&case["R"]));
        let normal = vector(&case["normal"]);
        let light = light(Source::Disc { centre, normal, radius });
        let exact = numbers(&case["vector_irradiance"]);
        // Towards the disc nothing of it is below the horizon.
        let length = exact.iter().map(|c| c * c).sum::<f64>().sqrt();
        let towards = [0, 1, 2].map(|i| exact[i] / length);
        let found = light.irradiance([0.0; 3], towards)[1] / COLOR[1];
        assert!((found / length - 1.0).abs() < 1e-9, "{centre:?}: {found} for {length}");
        let mut values = vec![[0.0; 3]; 16];
        light.add_projection([0.0; 3], 4, &mut values);
        let sh = numbers(&case["sh"]);
        let constant = number(&case["solid_angle"]) * (0.25 / PI).sqrt();
        assert!((values[0][0] / constant - 1.0).abs() < 1e-9);
        for (i, exact) in sh.iter().enumerate() {
            let found = values[i][2] / COLOR[2];
            assert!(
                (found - exact).abs() <= 1e-9 * exact.abs() + 1e-15,
                "{centre:?} {i}: {found} for {exact}"
            );
        }
        // l = 1 is the vector irradiance.
        let factor = (0.75 / PI).sqrt();
        for (i, axis, sign) in [(1, 1, -1.0), (2, 2, 1.0), (3, 0, -1.0)] {
            let found = values[i][0] * sign / factor;
            assert!((found - exact[axis]).abs() <= 1e-9 * exact[axis].abs() + 1e-15, "{found} {exact:?}");
        }
    }
}
