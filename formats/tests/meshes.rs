//! Meshes: what is read, from where, and what is refused.

#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

use relight_formats::{FormatError, read_mesh, read_mesh_parts};
use relight_surface::Mesh;
use serde_json::{Value, json};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::fs;
use std::path::Path;

const LIMIT: u64 = 1 << 20;

/// Remembers the largest single request for memory of each test, so that one sized by a damaged number shows.
struct Watched;
thread_local! {
    static LARGEST: Cell<usize> = const { Cell::new(0) };
}
#[global_allocator]
static ALLOCATOR: Watched = Watched;

// SAFETY: all work is the system allocator's.
unsafe impl GlobalAlloc for Watched {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        LARGEST.set(LARGEST.get().max(layout.size()));
        // SAFETY: as the caller promises.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(pointer, layout) }
    }
}

/// A tetrahedron's lopsided half: two triangles, texture coordinates everywhere else than lightmap coordinates.
const POSITIONS: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.5], [1.5, 1.0, 0.0], [-0.5, 1.5, 0.25]];
const UV: [[f32; 2]; 4] = [[0.0, 1.0], [0.75, 1.0], [0.5, 0.25], [0.0, 0.0]];
const UV2: [[f32; 2]; 4] = [[0.125, 0.5], [0.25, 0.5], [0.25, 0.375], [0.125, 0.25]];
const CORNERS: [u16; 6] = [0, 1, 2, 0, 2, 3];

fn bytes_of_floats<const N: usize>(values: &[[f32; N]]) -> Vec<u8> {
    values.iter().flatten().flat_map(|value| value.to_le_bytes()).collect()
}

/// The document and its buffer: positions at 0, uv at 48, uv2 at 80, corners at 112.
fn document() -> (Value, Vec<u8>) {
    let mut buffer = [bytes_of_floats(&POSITIONS), bytes_of_floats(&UV), bytes_of_floats(&UV2)].concat();
    buffer.extend(CORNERS.iter().flat_map(|corner| corner.to_le_bytes()));
    let view =
        |offset: usize, length: usize| json!({"buffer": 0, "byteOffset": offset, "byteLength": length});
    let accessor = |view: usize, component: usize, kind: &str, count: usize| json!({"bufferView": view, "componentType": component, "type": kind, "count": count});
    let mut positions = accessor(0, 5126, "VEC3", 4);
    positions["min"] = json!([-0.5, 0.0, 0.0]);
    positions["max"] = json!([2.0, 1.5, 0.5]);
    let primitive = json!({
        "attributes": {"POSITION": 0, "TEXCOORD_0": 1, "TEXCOORD_1": 2}, "indices": 3
    });
    let document = json!({
        "asset": {"version": "2.0"},
        "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "accessors": [positions, accessor(1, 5126, "VEC2", 4), accessor(2, 5126, "VEC2", 4), accessor(3, 5123, "SCALAR", 6)],
        "bufferViews": [view(0, 48), view(48, 32), view(80, 32), view(112, 12)],
        "buffers": [{"byteLength": buffer.len()}],
    });
    (document, buffer)
}

fn glb(document: &Value, buffer: &[u8]) -> Vec<u8> {
    let mut text = serde_json::to_vec(document).unwrap();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut buffer = buffer.to_vec();
    buffer.resize(buffer.len().next_multiple_of(4), 0);
    let word = |n: usize| (n as u32).to_le_bytes();
    let length = 12 + 8 + text.len() + 8 + buffer.len();
    [
        &b"glTF"[..],
        &word(2),
        &word(length),
        &word(text.len()),
        b"JSON",
        &text,
        &word(buffer.len()),
        b"BIN\0",
        &buffer,
    ]
    .concat()
}

fn read_bytes(bytes: &[u8]) -> Result<Mesh, FormatError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh");
    fs::write(&path, bytes).unwrap();
    read_mesh(&path, LIMIT)
}

/// The document after `change`, read as .glb.
fn read_changed(change: impl FnOnce(&mut Value, &mut Vec<u8>)) -> Result<Mesh, FormatError> {
    let (mut document, mut buffer) = document();
    change(&mut document, &mut buffer);
    read_bytes(&glb(&document, &buffer))
}

#[track_caller]
fn assert_refused(result: Result<Mesh, FormatError>, words: &str) {
    let message = result.expect_err(words).to_string();
    assert!(message.contains(words), "no '{words}' in '{message}'");
    assert!(!message.contains('\n'), "{message}");
}

/// Position, uv and uv2 of every corner in order.
fn corners(mesh: &Mesh) -> Vec<([f32; 3], [f32; 2], [f32; 2])> {
    let corner = |&vertex: &u32| {
        let vertex = vertex as usize;
        let uv2 = if mesh.uv2.is_empty() { [f32::NAN; 2] } else { mesh.uv2[vertex] };
        (mesh.positions[vertex], mesh.uv[vertex], uv2)
    };
    mesh.triangles.iter().flatten().map(corner).collect()
}

#[test]
fn gltf_text_with_data_or_a_file_and_binary_are_one_mesh() {
    let (mut document, buffer) = document();
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let read = |name: &str| read_mesh(&here.join(name), LIMIT).unwrap();
    fs::write(here.join("a.glb"), glb(&document, &buffer)).unwrap();
    let whole = read("a.glb");
    let expected: Vec<_> = CORNERS.map(usize::from).iter().map(|&i| (POSITIONS[i], UV[i], UV2[i])).collect();
    assert_eq!(corners(&whole), expected);
    assert_eq!((whole.normals.len(), whole.tangents.len()), (6, 6));

    fs::create_dir(here.join("parts")).unwrap();
    fs::write(here.join("parts/the buffer.bin"), &buffer).unwrap();
    document["buffers"][0]["uri"] = json!("parts/the%20buffer.bin");
    fs::write(here.join("b.gltf"), format!("\n  {document:#}")).unwrap();
    assert_eq!(read("b.gltf"), whole);
    use base64::Engine;
    let text = base64::engine::general_purpose::STANDARD.encode(&buffer);
    document["buffers"][0]["uri"] = json!(format!("data:application/octet-stream;base64,{text}"));
    fs::write(here.join("c"), document.to_string()).unwrap();
    assert_eq!(read("c"), whole);
}

#[test]
fn nodes_place_turn_and_mirror_what_hangs_on_them() {
    // Normals and tangents as a file has them, in the axes of the mesh.
    let normals: Vec<[f32; 3]> = vec![[0.0, 0.6, 0.8]; 4];
    let tangents: Vec<[f32; 4]> = vec![[1.0, 0.0, 0.0, 1.0]; 4];
    let read = |scale: [f64; 3]| {
        read_changed(|document, buffer| {
            for (name, kind, bytes) in [
                ("NORMAL", "VEC3", bytes_of_floats(&normals)),
                ("TANGENT", "VEC4", bytes_of_floats(&tangents)),
            ] {
                let views = document["bufferViews"].as_array_mut().unwrap();
                views.push(json!({"buffer": 0, "byteOffset": buffer.len(), "byteLength": bytes.len()}));
                let view = views.len() - 1;
                buffer.extend(bytes);
                let accessors = document["accessors"].as_array_mut().unwrap();
                accessors.push(json!({"bufferView": view, "componentType": 5126, "type": kind, "count": 4}));
                let accessor = accessors.len() - 1;
                document["meshes"][0]["primitives"][0]["attributes"][name] = json!(accessor);
            }
            document["buffers"][0]["byteLength"] = json!(buffer.len());
            // A quarter turn about z takes x to y, then the parent moves and scales.
            let half = 0.5f64.sqrt();
            document["nodes"] = json!([
                {"children": [1], "translation": [10.0, 20.0, 30.0], "scale": scale},
                {"mesh": 0, "rotation": [0.0, 0.0, half, half]},
            ]);
        })
        .unwrap()
    };
    let near = |a: &[f32], b: &[f64]| a.iter().zip(b).all(|(a, b)| (f64::from(*a) - b).abs() < 1e-5);
    for scale in [[2.0, 3.0, 4.0], [2.0, 3.0, -4.0]] {
        let mesh = read(scale);
        for (vertex, [x, y, z]) in POSITIONS.map(|p| p.map(f64::from)).into_iter().enumerate() {
            let expected = [10.0 - scale[0] * y, 20.0 + scale[1] * x, 30.0 + scale[2] * z];
            assert!(near(&mesh.positions[vertex], &expected), "{:?} {expected:?}", mesh.positions[vertex]);
        }
        // (0, 0.6, 0.8) turned is (-0.6, 0, 0.8); normals scale by the inverse, whichever the side.
        let [x, z] = [-0.6 / scale[0], 0.8 / scale[2]];
        let length = (x * x + z * z).sqrt();
        let side = scale[2].signum();
        for vertex in 0..4 {
            assert!(
                near(&mesh.normals[vertex], &[x / length, 0.0, z / length]),
                "{:?}",
                mesh.normals[vertex]
            );
            assert!(near(&mesh.tangents[vertex], &[0.0, 1.0, 0.0, side]), "{:?}", mesh.tangents[vertex]);
        }
        assert_eq!(mesh.triangles[0], if side > 0.0 { [0, 1, 2] } else { [0, 2, 1] });
    }
}

#[test]
fn strips_fans_sparse_and_small_integers_are_read_and_lines_are_not() {
    let fan = read_changed(|document, _| {
        let primitive = &mut document["meshes"][0]["primitives"][0];
        primitive["mode"] = json!(6);
        primitive.as_object_mut().unwrap().remove("indices");
    });
    assert_eq!(corners(&fan.unwrap()), corners(&read_changed(|_, _| {}).unwrap()));
    let strip =
        read_changed(|document, _| document["meshes"][0]["primitives"][0]["mode"] = json!(5)).unwrap();
    // 0 1 2 0 2 3 as a strip; triangles with a corner twice stay in, without area.
    let expected: Vec<_> = [0, 1, 2, 2, 1, 0, 2, 0, 2, 2, 0, 3].map(|i: usize| POSITIONS[i]).to_vec();
    assert_eq!(corners(&strip).iter().map(|c| c.0).collect::<Vec<_>>(), expected);
    let lines = read_changed(|document, _| document["meshes"][0]["primitives"][0]["mode"] = json!(1));
    assert_refused(lines, "no triangle");

    // Vertex 2 moved by a sparse value; texture coordinates as bytes of 255.
    let changed = read_changed(|document, buffer| {
        let at = buffer.len();
        buffer.extend(2u32.to_le_bytes());
        buffer.extend(bytes_of_floats(&[[7.0, 8.0, 9.0]]));
        buffer.extend([0, 255, 51, 102, 153, 204, 255, 0]);
        document["buffers"][0]["byteLength"] = json!(buffer.len());
        let views = document["bufferViews"].as_array_mut().unwrap();
        for (offset, length) in [(0, 4), (4, 12), (16, 8)] {
            views.push(json!({"buffer": 0, "byteOffset": at + offset, "byteLength": length}));
        }
        document["accessors"][0]["sparse"] = json!({
            "count": 1, "indices": {"bufferView": 4, "componentType": 5125}, "values": {"bufferView": 5}
        });
        document["accessors"][1] =
            json!({"bufferView": 6, "componentType": 5121, "normalized": true, "type": "VEC2", "count": 4});
    });
    let found = corners(&changed.unwrap());
    assert_eq!(found[2].0, [7.0, 8.0, 9.0]);
    assert_eq!(found[1].0, POSITIONS[1]);
    for (found, expected) in found.iter().zip([[0.0, 1.0], [0.2, 0.4], [0.6, 0.8]]) {
        assert!((0..2).all(|i| (found.1[i] - expected[i]).abs() < 1e-6), "{found:?}");
    }
}

#[test]
fn obj_files_have_v_from_the_bottom_polygons_and_several_objects() {
    let text = "# made by hand\no first\nv 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 0.75\nvt 0 0.75\n\
                vn 0 0 -1\nusemtl nothing\nf 1/1/1 2/2/1 3/3/1 4/4/1\no second\nv 0 0 5\nf -5//1 -4//1 -1//1\nl 1 2\n";
    let mesh = read_bytes(text.as_bytes()).unwrap();
    assert_eq!(mesh.triangles.len(), 3);
    let found = corners(&mesh);
    assert_eq!(found[2].0, [2.0, 1.0, 0.0]);
    assert_eq!([found[0].1, found[2].1], [[0.0, 1.0], [1.0, 0.25]]);
    assert_eq!([found[6].0, found[8].0, found[8].0], [[0.0; 3], [0.0, 0.0, 5.0], [0.0, 0.0, 5.0]]);
    assert!(mesh.normals.iter().all(|normal| *normal == [0.0, 0.0, -1.0]));
    // Seen from its normal's side, u grows to the left: mirrored.
    assert_eq!(mesh.tangents[0], [1.0, 0.0, 0.0, -1.0]);
    let windows = text.replace('\n', "\r\n");
    assert_eq!(read_bytes(windows.as_bytes()).unwrap(), mesh);
}

fn parts_of(bytes: &[u8]) -> Result<Vec<(String, Mesh)>, FormatError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh");
    fs::write(&path, bytes).unwrap();
    read_mesh_parts(&path, LIMIT)
}

#[test]
fn nodes_are_parts_where_they_stand_and_no_two_have_one_name() {
    let (mut document, buffer) = document();
    document["meshes"][0]["name"] = json!("table");
    document["nodes"] = json!([
        {"name": "leg", "mesh": 0, "translation": [1.0, 0.0, 0.0]},
        {"name": "leg 2", "mesh": 0},
        {"name": "leg", "mesh": 0, "translation": [3.0, 0.0, 0.0]},
        {"children": [4], "translation": [0.0, 5.0, 0.0]},
        {"mesh": 0},
    ]);
    document["scenes"][0]["nodes"] = json!([0, 1, 2, 3]);
    let bytes = glb(&document, &buffer);
    let parts = parts_of(&bytes).unwrap();
    let places: Vec<_> = parts.iter().map(|(name, mesh)| (name.as_str(), mesh.positions[0])).collect();
    let [x, y, z] = POSITIONS[CORNERS[0] as usize];
    let expected = [
        ("leg", [x + 1.0, y, z]),
        ("leg 2", [x, y, z]),
        ("leg 3", [x + 3.0, y, z]),
        ("table", [x, y + 5.0, z]),
    ];
    assert_eq!(places, expected);
    let meshes: Vec<Mesh> = parts.into_iter().map(|(_, mesh)| mesh).collect();
    assert_eq!(Mesh::joined(meshes).unwrap(), read_bytes(&bytes).unwrap());
}

#[test]
fn a_file_of_points_alone_has_them_as_parts() {
    let (mut document, buffer) = document();
    document["meshes"][0]["primitives"][0] = json!({"attributes": {"POSITION": 0}, "mode": 0});
    assert_refused(read_bytes(&glb(&document, &buffer)), "no triangle");
    let parts = parts_of(&glb(&document, &buffer)).unwrap();
    let [(name, mesh)] = &parts[..] else { panic!("{parts:?}") };
    assert_eq!(name, "node 0");
    assert_eq!(corner_positions(mesh), POSITIONS.iter().flat_map(|&p| [p; 3]).collect::<Vec<_>>());
    mesh.check().unwrap();
    // Beside triangles they don't count.
    let triangles = json!({"attributes": {"POSITION": 0}, "indices": 3});
    document["meshes"][0]["primitives"].as_array_mut().unwrap().push(triangles);
    assert_eq!(parts_of(&glb(&document, &buffer)).unwrap()[0].1.triangles.len(), 2);

    let parts = parts_of(b"o one\nv 3 4 5\r\ng two\nv 1 1 1\nv 2e0 2 2 1\np 1 2 3\n").unwrap();
    let first_corners = |mesh: &Mesh| corner_positions(mesh).into_iter().step_by(3).collect::<Vec<_>>();
    let found: Vec<_> = parts.iter().map(|(name, mesh)| (name.as_str(), first_corners(mesh))).collect();
    assert_eq!(found, [("one", vec![[3.0, 4.0, 5.0]]), ("two", vec![[1.0; 3], [2.0; 3]])]);
    for (text, words) in [
        ("vn 0 0 1\n", "neither glTF nor"),
        ("input = 'capture'\nv = 3\n", "neither glTF nor"),
        ("v 3 4\n", "damaged OBJ"),
    ] {
        let error = parts_of(text.as_bytes()).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    }
}

#[test]
fn one_name_is_one_part_of_an_obj_whatever_its_materials() {
    let text = "v 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 0 5\no top\nusemtl a\nf 1 2 3\nusemtl b\nf 1 2 4\ng side\n\
                f 2 3 4\no empty\nl 1 2\no top\nf 1 3 4\n";
    let parts = parts_of(text.as_bytes()).unwrap();
    let names: Vec<_> = parts.iter().map(|(name, mesh)| (name.as_str(), mesh.triangles.len())).collect();
    assert_eq!(names, [("top", 3), ("side", 1)]);
    assert_eq!(corner_positions(&parts[1].1), [[2.0, 0.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 5.0]]);
    // Triangles without area are a surface, too.
    let flat = parts_of(b"v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n").unwrap();
    assert_eq!(corner_positions(&flat[0].1), [[1.0; 3]; 3]);
}

fn corner_positions(mesh: &Mesh) -> Vec<[f32; 3]> {
    mesh.triangles.iter().flatten().map(|&vertex| mesh.positions[vertex as usize]).collect()
}

#[test]
fn what_is_no_mesh_or_leads_elsewhere_is_refused_in_a_sentence() {
    assert_refused(read_bytes(b""), "neither glTF nor the text of an OBJ file");
    assert_refused(read_bytes(b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"), "no triangle");
    assert_refused(read_bytes(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n"), "damaged OBJ");
    assert_refused(read_bytes(b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"), "positions of vertex 0");
    assert_refused(read_bytes(b"\x89PNG\r\n\x1a\n\0\0"), "neither glTF nor the text of an OBJ file");
    assert_refused(read_bytes(b"{}"), "damaged glTF");
    assert_refused(
        read_changed(|d, _| d["asset"]["version"] = json!("1.0")),
        "version '1.0' where 2.0 is read",
    );
    let required = read_changed(|d, _| {
        d["extensionsUsed"] = json!(["KHR_draco_mesh_compression"]);
        d["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]);
    });
    assert_refused(required, "can't be read without a glTF extension");
    for uri in ["../mesh.bin", "/etc/hostname", "http://localhost/mesh.bin", "data:;base64,!"] {
        let result = read_changed(|d, _| d["buffers"][0]["uri"] = json!(uri));
        assert_refused(result, "neither base64 data nor a file below the folder");
    }
    let absent = read_changed(|d, _| d["buffers"][0]["uri"] = json!("absent.bin")).unwrap_err();
    assert!(matches!(&absent, FormatError::Io { path, .. } if path.ends_with("absent.bin")), "{absent}");
    assert!(matches!(read_mesh(Path::new("absent.glb"), LIMIT), Err(FormatError::Io { .. })));
}

#[test]
fn numbers_that_lie_are_refused() {
    let beyond = "reaches beyond its buffer";
    assert_refused(read_changed(|d, _| d["accessors"][3]["count"] = json!(7)), beyond);
    assert_refused(read_changed(|d, _| d["accessors"][1]["byteOffset"] = json!(4)), beyond);
    assert_refused(read_changed(|d, _| d["bufferViews"][3]["byteOffset"] = json!(114)), beyond);
    assert_refused(read_changed(|d, _| d["bufferViews"][3]["byteOffset"] = json!(u64::MAX - 3)), beyond);
    assert_refused(read_changed(|_, buffer| buffer.truncate(100)), beyond);
    assert_refused(read_changed(|d, _| d["accessors"][1]["count"] = json!(3)), "differ in number");
    assert_refused(read_changed(|d, _| d["accessors"][1]["type"] = json!("VEC3")), "another shape");
    assert_refused(read_changed(|d, _| d["accessors"][0]["componentType"] = json!(5123)), "damaged glTF");
    assert_refused(read_changed(|_, buffer| buffer[114] = 4), "names vertex 4 of 4");
    let nan = read_changed(|_, buffer| buffer[..4].copy_from_slice(&f32::NAN.to_le_bytes()));
    assert_refused(nan, "positions of vertex 0");
    assert_refused(
        read_changed(|d, _| d["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = json!(4)),
        "damaged glTF",
    );
    let circle = read_changed(|d, _| d["nodes"] = json!([{"mesh": 0, "children": [1]}, {"children": [0]}]));
    assert_refused(circle, "no tree");
    let twice = read_changed(|d, _| d["nodes"] = json!([{"children": [1, 1]}, {"mesh": 0}]));
    assert_refused(twice, "no tree");
}

#[test]
fn memory_is_bounded_before_it_is_asked_for() {
    let (mut document, buffer) = document();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.glb");
    fs::write(&path, glb(&document, &buffer)).unwrap();
    assert!(matches!(read_mesh(&path, 4000), Err(FormatError::TooLarge { .. })));
    assert!(matches!(read_mesh(&path, 100), Err(FormatError::TooLarge { .. })));
    // Sparse values alone need no buffer, so a count may claim anything.
    let sparse =
        json!({"count": 1, "indices": {"bufferView": 3, "componentType": 5123}, "values": {"bufferView": 0}});
    for accessor in 0..3 {
        document["accessors"][accessor]["sparse"] = sparse.clone();
        document["accessors"][accessor]["count"] = json!(100_000_000);
        document["accessors"][accessor].as_object_mut().unwrap().remove("bufferView");
    }
    fs::write(&path, glb(&document, &buffer)).unwrap();
    assert!(matches!(read_mesh(&path, LIMIT), Err(FormatError::TooLarge { .. })));
    // One mesh at very many nodes.
    let (mut document, buffer) = self::document();
    document["nodes"] = Value::Array(vec![json!({"mesh": 0}); 5000]);
    document["scenes"][0]["nodes"] = (0..5000).collect();
    fs::write(&path, glb(&document, &buffer)).unwrap();
    assert!(matches!(read_mesh(&path, LIMIT), Err(FormatError::TooLarge { .. })));
}

#[test]
fn mangled_meshes_are_errors_or_results_within_the_memory_limit() {
    let (mut document, buffer) = document();
    let binary = glb(&document, &buffer);
    use base64::Engine;
    let text = base64::engine::general_purpose::STANDARD.encode(&buffer);
    document["buffers"][0]["uri"] = json!(format!("data:;base64,{text}"));
    let obj =
        b"v 0 0 0\nv 2 0 0\nv 2 1 0\nvt 0 0\nvt 1 0\nvn 0 0 1\nf 1/1/1 2/2/1 3/2/1\nf -1//1 -2//1 -3//1\n";
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh");
    let mut state = 77u64;
    let mut random = |below: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    for whole in [binary, document.to_string().into_bytes(), obj.to_vec()] {
        let mut read = 0;
        LARGEST.set(0);
        for round in 0..1500 {
            let mut bytes = whole.clone();
            if round % 5 == 0 {
                bytes.truncate(random(whole.len()));
            }
            for _ in 0..1 + random(3) {
                if !bytes.is_empty() {
                    let at = random(bytes.len());
                    bytes[at] = match random(3) {
                        0 => bytes[at] ^ (1 << random(8)),
                        1 => b'0' + random(10) as u8,
                        _ => random(256) as u8,
                    };
                }
            }
            fs::write(&path, &bytes).unwrap();
            read += usize::from(read_mesh(&path, LIMIT).is_ok());
            drop(read_mesh_parts(&path, LIMIT));
        }
        assert!((20..1450).contains(&read), "{read} of 1500 were read");
        let largest = LARGEST.get() as u64;
        assert!(largest <= LIMIT, "{largest} bytes were asked for at once");
    }
}
