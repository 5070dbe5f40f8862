//! Binary glTF of positions, normals and triangles.

use crate::surface::Surface;
use serde_json::{Value, json};

const FLOAT: u32 = 5126;
const SHORT: u32 = 5123;

/// A node a part: its name, where it stands, its surface about that place.
pub(crate) fn glb(parts: &[(&str, [f64; 3], Surface)]) -> Result<Vec<u8>, serde_json::Error> {
    let mut buffer: Vec<u8> = Vec::new();
    let (mut views, mut accessors, mut meshes, mut nodes) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (index, (name, place, surface)) in parts.iter().enumerate() {
        let mut stored = |bytes: Vec<u8>, component: u32, kind: &str, count: usize| {
            let (offset, length) = (buffer.len(), bytes.len());
            buffer.extend(bytes);
            buffer.resize(buffer.len().next_multiple_of(4), 0);
            views.push(json!({"buffer": 0, "byteOffset": offset, "byteLength": length}));
            accessors.push(json!({"bufferView": views.len() - 1, "componentType": component, "type": kind, "count": count}));
            accessors.len() - 1
        };
        let narrow = |vectors: &[[f64; 3]]| vectors.iter().map(|v| v.map(|c| c as f32)).collect::<Vec<_>>();
        let bytes = |vectors: &[[f32; 3]]| vectors.iter().flatten().flat_map(|c| c.to_le_bytes()).collect();
        let positions = narrow(&surface.positions);
        let count = positions.len();
        let position = stored(bytes(&positions), FLOAT, "VEC3", count);
        let normal = stored(bytes(&narrow(&surface.normals)), FLOAT, "VEC3", count);
        let corners = surface.triangles.iter().flatten().flat_map(|&v| (v as u16).to_le_bytes()).collect();
        let indices = stored(corners, SHORT, "SCALAR", 3 * surface.triangles.len());
        let bound = |pick: fn(f32, f32) -> f32| {
            positions.iter().copied().reduce(|a, b| [0, 1, 2].map(|i| pick(a[i], b[i])))
        };
        accessors[position]["min"] = json!(bound(f32::min));
        accessors[position]["max"] = json!(bound(f32::max));
        let primitive = json!({"attributes": {"POSITION": position, "NORMAL": normal}, "indices": indices});
        meshes.push(json!({"name": name, "primitives": [primitive]}));
        nodes.push(json!({"name": name, "mesh": index, "translation": place}));
    }
    let document = json!({
        "asset": {"version": "2.0", "generator": "relight rig_testdata"},
        "scene": 0, "scenes": [{"nodes": (0..parts.len()).collect::<Vec<_>>()}],
        "nodes": nodes, "meshes": meshes, "accessors": accessors, "bufferViews": views,
        "buffers": [{"byteLength": buffer.len()}],
    });
    binary(&document, &buffer)
}

fn binary(document: &Value, buffer: &[u8]) -> Result<Vec<u8>, serde_json::Error> {
    let mut text = serde_json::to_vec(document)?;
    text.resize(text.len().next_multiple_of(4), b' ');
    let word = |n: usize| (n as u32).to_le_bytes();
    let length = 12 + 8 + text.len() + 8 + buffer.len();
    let (head, lengths) = (*b"glTF", [word(2), word(length), word(text.len())]);
    Ok([&head[..], &lengths.concat(), b"JSON", &text, &word(buffer.len()), b"BIN\0", buffer].concat())
}
