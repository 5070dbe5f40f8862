#![allow(missing_docs, unreachable_pub)]
use crate::Light;
use relight_core::CpuLevel;
pub struct SurfaceRows<'a> {
    pub x: &'a [f32],
    pub y: &'a [f32],
    pub z: &'a [f32],
    pub nx: &'a [f32],
    pub ny: &'a [f32],
    pub nz: &'a [f32],
}
pub fn add_reflectance(light: &Light, _: CpuLevel, rows: &SurfaceRows<'_>, out: [&mut [f32]; 3]) {
    let [r, g, b] = out;
    for i in 0..r.len() {
        let p = [rows.x[i], rows.y[i], rows.z[i]].map(f64::from);
        let n = [rows.nx[i], rows.ny[i], rows.nz[i]].map(f64::from);
        let e = light.irradiance(p, n).map(|e| (e / std::f64::consts::PI) as f32);
        r[i] += e[0];
        g[i] += e[1];
        b[i] += e[2];
    }
}
pub struct Projector<'a> {
    lights: Vec<(&'a Light, f64)>,
    bands: usize,
}
impl<'a> Projector<'a> {
    pub fn new(lights: &[(&'a Light, f64)], bands: usize, _: ([f64; 3], f64)) -> Self {
        Self { lights: lights.to_vec(), bands }
    }
    pub fn project(&self, _: CpuLevel, point: [f64; 3], out: &mut [[f64; 3]]) {
        for (l, w) in &self.lights {
            let mut v = vec![[0.0; 3]; out.len()];
            l.add_projection(point, self.bands, &mut v);
            for (o, v) in out.iter_mut().zip(v) {
                for c in 0..3 {
                    o[c] += w * v[c];
                }
            }
        }
    }
    pub fn project_with_gradient(
        &self,
        _: CpuLevel,
        point: [f64; 3],
        out: &mut [[f64; 3]],
        g: &mut [[[f64; 3]; 3]],
    ) {
        for (l, w) in &self.lights {
            let l = Light { color: l.color.map(|c| c * w), ..(*l).clone() };
            l.add_projection_with_gradient(point, self.bands, out, g);
        }
    }
}
pub struct SphereTable(usize, f64);
impl SphereTable {
    pub fn new(n: usize) -> Self {
        Self(n, 0.02)
    }
    pub fn of_the_paper(n: usize) -> Self {
        Self(n, 5.1)
    }
    pub fn largest_error_grey(&self) -> f64 {
        self.1
    }
    pub fn values(&self) -> &[f32] {
        &[]
    }
}
