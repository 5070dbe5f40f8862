//! Assets with a scale and a bias of its own for every plane, in every packing.

use relight_core::basis::{FAMILIES, Kernel, PointSet, SrbfDesign};
use relight_core::{Basis, Design, Direction, Layout, LightSet, Model, Space};
use relight_texture::{
    ArrayPlan, BlockFormat, LayerPlan, Packing, Precision, Quantizer, TexelFormat, Wrap, planes_of_layers,
};

pub(crate) const LAYOUTS: [Layout; 3] = [Layout::Grey, Layout::Rgb, Layout::Lrgb];

/// Every plain and block format.
pub(crate) fn formats() -> Vec<TexelFormat> {
    let plain = [1, 4].map(|channels| TexelFormat::Plain { precision: Precision::U8, channels });
    let halves = TexelFormat::Plain { precision: Precision::F16, channels: 4 };
    let blocks = BlockFormat::all().map(TexelFormat::Block);
    plain.into_iter().chain([halves]).chain(blocks).collect()
}

/// Lights all over the upper hemisphere.
fn lights() -> LightSet {
    let ring = |i: f64| Direction::from_azimuth_elevation(i * 2.4, 0.1 + 0.035 * i).unwrap();
    LightSet::from_directions((0..40).map(|i| ring(f64::from(i))).collect())
}

/// Every family at each of `counts` that it has, both kernels, centres on a cap and on the sphere.
pub(crate) fn bases(counts: &[usize]) -> Vec<Basis> {
    let lights = lights();
    let mut all = Vec::new();
    for family in &FAMILIES {
        for &count in counts.iter().filter(|&&count| family.counts.contains(count)) {
            all.push(family.build(&Design::new(count, &lights)).unwrap());
            if family.name == "srbf" {
                let domain = relight_core::basis::Domain::Sphere;
                let (kernel, points) = (Kernel::Spherical, PointSet::Hammersley2);
                let srbf = SrbfDesign { domain, kernel, points, ..SrbfDesign::default() };
                all.push(family.build(&Design { count, lights: &lights, srbf }).unwrap());
            }
        }
    }
    all
}

pub(crate) fn model(basis: &Basis, layout: Layout) -> Model {
    let space = if layout == Layout::Grey { Space::Linear } else { Space::Encoded };
    Model { basis: basis.clone(), layout, space, lights: Vec::new(), figures: None }
}

/// Distinct by plane, of both signs, and such that no two planes could be swapped unnoticed.
pub(crate) fn quantizer(plane: usize) -> Quantizer {
    let p = plane as f32;
    Quantizer {
        scale: 0.3 + 0.0137 * p,
        bias: if plane.is_multiple_of(2) { -0.11 * p.sqrt() } else { 0.07 * p.sqrt() },
    }
}

pub(crate) fn layers_of(planes: Vec<Vec<usize>>) -> Vec<LayerPlan> {
    let plan = |planes: Vec<usize>| LayerPlan {
        quantizers: planes.iter().map(|&plane| quantizer(plane)).collect(),
        planes,
    };
    planes.into_iter().map(plan).collect()
}

/// All layers in one array of `format`.
pub(crate) fn packed(model: &Model, format: TexelFormat) -> Packing {
    let layers = layers_of(planes_of_layers(model, format));
    Packing { arrays: vec![ArrayPlan { format, layers }], levels: 1, wrap: Wrap::Clamp }
}

/// Layers dealt in turn to three arrays of three formats, base colour ahead of luminance in the last: no
/// array holds planes in order and none but the first starts at layer 0.
pub(crate) fn mixed(model: &Model) -> Packing {
    let block = TexelFormat::Block;
    let formats = [BlockFormat::Bc7, BlockFormat::Bc5, BlockFormat::Bc4Signed].map(block);
    let planes = 0..model.plane_count();
    let luminance = if model.layout == Layout::Lrgb { model.basis.count() } else { planes.end };
    let mut arrays: Vec<Vec<Vec<usize>>> = vec![Vec::new(); 3];
    if luminance < planes.end {
        arrays[2].push(vec![luminance + 2]);
        arrays[2].push(vec![luminance]);
        arrays[1].push(vec![luminance + 1]);
    }
    let mut rest: Vec<usize> = (0..luminance).rev().collect();
    for array in (0..3).cycle() {
        if rest.is_empty() {
            break;
        }
        let channels = formats[array].channels().min(rest.len());
        arrays[array].push(rest.drain(..channels).collect());
    }
    if model.layout == Layout::Rgb {
        // Three planes of one function, as RGB formats hold them.
        for layer in &mut arrays[0] {
            layer.reverse();
        }
    }
    let arrays = formats.into_iter().zip(arrays).filter(|(_, planes)| !planes.is_empty());
    let arrays = arrays.map(|(format, planes)| ArrayPlan { format, layers: layers_of(planes) }).collect();
    Packing { arrays, levels: 3, wrap: Wrap::Mirror }
}

/// Every packing of `model`; of many functions, those that differ most.
pub(crate) fn packings(model: &Model) -> Vec<Packing> {
    let few = [BlockFormat::Bc3, BlockFormat::Bc4].map(TexelFormat::Block).to_vec();
    let formats = if model.basis.count() > 16 { few } else { formats() };
    formats.into_iter().map(|format| packed(model, format)).chain([mixed(model)]).collect()
}
