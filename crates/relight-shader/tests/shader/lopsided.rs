//! Assets with a scale and a bias of its own for every plane, in every packing.

use relight_core::basis::{FAMILIES, Kernel, Learned, PointSet, SrbfDesign};
use relight_core::sphere::Octahedral;
use relight_core::{Basis, Design, Direction, Layout, LightSet, Model, Space};
use relight_texture::{
    ArrayPlan, BlockFormat, LayerPlan, Packing, Precision, Quantizer, TexelFormat, Wrap, function_texels,
    planes_of_layers,
};

/// The layouts that `basis` has.
pub(crate) fn layouts_of(basis: &Basis) -> &'static [Layout] {
    match basis {
        Basis::Learned(_) => &[Layout::Shared],
        _ => &[Layout::Grey, Layout::Rgb, Layout::Lrgb],
    }
}

/// Learned functions of `planes` planes, a value of its own in every place of the table.
pub(crate) fn learned(planes: usize, channels: usize, hemisphere: bool) -> Basis {
    let square = Octahedral { nodes: 7, hemisphere };
    let count = square.count() * channels * (planes + 1);
    let table = (0..count).map(|i| ((i * 37) % 101) as f32 / 50.5 - 1.0).collect();
    Basis::Learned(Learned::new("pca".to_owned(), planes, channels, square, table).unwrap())
}

/// The table of learned functions as texels of an array texture: nodes along an edge, and texels layer by layer.
pub(crate) fn table_of(basis: &Basis) -> Option<(usize, Vec<[f32; 4]>)> {
    match basis {
        Basis::Learned(learned) => {
            let texels = function_texels(learned).into_iter().map(|texel| texel.map(f32::from)).collect();
            Some((learned.square().nodes, texels))
        }
        _ => None,
    }
}

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
    for family in FAMILIES.iter().filter(|family| !family.learned) {
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
    if counts.contains(&6) {
        // Seven functions, eighteen and eighteen: whole texels of four, and a rest.
        all.extend([learned(6, 1, true), learned(5, 3, true), learned(5, 3, false)]);
    }
    all
}

pub(crate) fn model(basis: &Basis, layout: Layout) -> Model {
    let space = if layout == Layout::Grey { Space::Linear } else { Space::Encoded };
    Model { basis: basis.clone(), layout, space, lights: Vec::new(), figures: None, provenance: None }
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
    let luminance = if model.layout == Layout::Lrgb { model.maps() } else { planes.end };
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
