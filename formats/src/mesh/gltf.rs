//! glTF 2.0, as text or binary.
//!
//! The `gltf` crate checks the document; what it trusts (ranges, shapes, a tree of nodes) is checked here before
//! its iterators run.

use super::data_uri::{Named, named_by};
use super::{BYTES_OF_CORNER, Elements, Piece, check_memory};
use crate::FormatError;
use crate::machine::bytes_of;
use gltf::accessor::{DataType, Dimensions};
use gltf::buffer::{Source, View};
use gltf::mesh::Mode;
use gltf::{Accessor, Document, Gltf, Node, Primitive, Semantic};
use relight_core::vectors::cross;
use relight_surface::Mesh;
use std::collections::{HashMap, HashSet};
use std::path::Path;

/// Columns of a matrix that takes points of a node to the scene.
type Placement = [[f64; 4]; 4];

const AS_IT_IS: Placement =
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];

/// The primitives of a file's scene, each in the axes of the scene.
pub(super) fn read(
    bytes: &[u8],
    path: &Path,
    memory_limit: u64,
    elements: Elements,
) -> Result<Vec<Piece>, FormatError> {
    // A number of the document's text becomes a value of some tens of bytes.
    check_memory((bytes.len() as u64).saturating_mul(2), memory_limit, path)?;
    let Gltf { document, blob } = checked(bytes).map_err(|error| of_gltf(path, &error))?;
    let version = &document.as_json().asset.version;
    if !version.starts_with("2.") {
        let version: String = version.chars().take(20).collect();
        let problem = format!("glTF of version '{version}' where 2.0 is read; export it as 2.0");
        return Err(FormatError::unsupported(path, problem));
    }
    let mut file = GltfFile { path, memory_left: memory_limit, buffers: Vec::new() };
    file.read_buffers(&document, blob)?;
    let mut pieces = Vec::new();
    let mut names = Names::default();
    for PlacedMesh { name, mesh, placement } in file.placed_meshes(&document)? {
        let part = names.unlike_others(name);
        for primitive in mesh.primitives() {
            let mesh = file.mesh_of(&primitive, &placement, elements)?;
            pieces.extend(mesh.map(|mesh| Piece { part: part.clone(), mesh }));
        }
    }
    Ok(pieces)
}

/// A mesh where a node puts it.
struct PlacedMesh<'d> {
    name: String,
    mesh: gltf::Mesh<'d>,
    placement: Placement,
}

/// Names that were given.
#[derive(Default)]
struct Names {
    given: HashSet<String>,
    /// The number after a name that came twice.
    last: HashMap<String, usize>,
}

impl Names {
    /// `name`, numbered where it was given before.
    fn unlike_others(&mut self, name: String) -> String {
        let mut unlike = name.clone();
        while !self.given.insert(unlike.clone()) {
            let last = self.last.entry(name.clone()).or_insert(1);
            *last += 1;
            unlike = format!("{name} {last}");
        }
        unlike
    }
}

/// The document, checked by the crate. It looks at the bounds of positions before it knows that they exist, so
/// those that don't lead nowhere from here on.
fn checked(bytes: &[u8]) -> Result<Gltf, gltf::Error> {
    let Gltf { document, blob } = Gltf::from_slice_without_validation(bytes)?;
    let mut root = document.into_json();
    let accessors = root.accessors.len();
    for primitive in root.meshes.iter_mut().flat_map(|mesh| &mut mesh.primitives) {
        primitive.attributes.retain(|_, accessor| accessor.value() < accessors);
    }
    Ok(Gltf { document: Document::from_json(root)?, blob })
}

fn of_gltf(path: &Path, error: &gltf::Error) -> FormatError {
    match error {
        gltf::Error::Validation(faults)
            if faults.iter().any(|(at, _)| at.as_str().contains("extensionsRequired")) =>
        {
            let problem = "the mesh can't be read without a glTF extension (compression or quantisation); export it \
                           without";
            FormatError::unsupported(path, problem)
        }
        _ => {
            let words = error.to_string().replace('\n', " ");
            FormatError::invalid(path, format!("damaged glTF: {}; export it again", words.trim()))
        }
    }
}

/// A file while it is read.
struct GltfFile<'a> {
    path: &'a Path,
    memory_left: u64,
    buffers: Vec<Vec<u8>>,
}

impl GltfFile<'_> {
    fn invalid(&self, problem: &str) -> FormatError {
        FormatError::invalid(self.path, format!("damaged glTF: {problem}; export it again"))
    }

    /// Takes from the memory that is left, before it is allocated.
    fn take(&mut self, bytes: u64) -> Result<(), FormatError> {
        check_memory(bytes, self.memory_left, self.path)?;
        self.memory_left -= bytes;
        Ok(())
    }

    fn read_buffers(&mut self, document: &Document, mut blob: Option<Vec<u8>>) -> Result<(), FormatError> {
        for buffer in document.buffers() {
            let bytes = match buffer.source() {
                Source::Bin => blob.take().ok_or_else(|| self.invalid("it has no binary chunk"))?,
                Source::Uri(uri) => match named_by(uri) {
                    Some(Named::Bytes(bytes)) => bytes,
                    Some(Named::File(name)) => {
                        let folder = self.path.parent().unwrap_or(Path::new(""));
                        bytes_of(&folder.join(name), self.memory_left)?
                    }
                    None => {
                        let shown: String = uri.chars().take(60).collect();
                        let problem = format!(
                            "buffer {} is '{shown}', neither base64 data nor a file below the folder of the mesh; \
                             export it as .glb",
                            buffer.index()
                        );
                        return Err(FormatError::unsupported(self.path, problem));
                    }
                },
            };
            self.take(bytes.len() as u64)?;
            self.buffers.push(bytes);
        }
        Ok(())
    }

    /// The meshes of the scene where their nodes put them; all as they are in a file without a scene.
    fn placed_meshes<'d>(&self, document: &'d Document) -> Result<Vec<PlacedMesh<'d>>, FormatError> {
        let named = |name: Option<&str>, mesh: &gltf::Mesh<'_>, index: usize| {
            name.or(mesh.name()).map_or_else(|| format!("node {index}"), str::to_owned)
        };
        let Some(scene) = document.default_scene().or_else(|| document.scenes().next()) else {
            let as_it_is = |mesh: gltf::Mesh<'d>| PlacedMesh {
                name: named(None, &mesh, mesh.index()),
                mesh,
                placement: AS_IT_IS,
            };
            return Ok(document.meshes().map(as_it_is).collect());
        };
        let mut placed = Vec::new();
        let mut seen = HashSet::new();
        let mut ahead: Vec<(Node<'d>, Placement)> = scene.nodes().map(|node| (node, AS_IT_IS)).collect();
        ahead.reverse();
        while let Some((node, parent)) = ahead.pop() {
            // Children of two nodes could number more than memory holds, those of themselves never end.
            if !seen.insert(node.index()) {
                return Err(self.invalid("its nodes are no tree"));
            }
            let own = node.transform().matrix().map(|column| column.map(f64::from));
            let placement = own.map(|column| transformed(&parent, column));
            placed.extend(node.mesh().map(|mesh| PlacedMesh {
                name: named(node.name(), &mesh, node.index()),
                mesh,
                placement,
            }));
            let from = ahead.len();
            ahead.extend(node.children().map(|child| (child, placement)));
            ahead[from..].reverse();
        }
        Ok(placed)
    }

    /// A primitive's triangles or points; `None` where it is of something else.
    fn mesh_of(
        &mut self,
        primitive: &Primitive<'_>,
        placement: &Placement,
        elements: Elements,
    ) -> Result<Option<Mesh>, FormatError> {
        let mode = primitive.mode();
        let wanted = match elements {
            Elements::Triangles => {
                matches!(mode, Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan)
            }
            Elements::Points => mode == Mode::Points,
        };
        if !wanted {
            return Ok(None);
        }
        let positions =
            primitive.get(&Semantic::Positions).ok_or_else(|| self.invalid("it has no positions"))?;
        let mut corners = positions.count();
        if let Some(indices) = primitive.indices() {
            self.check_accessor(&indices, &[Dimensions::Scalar])?;
            corners = corners.saturating_add(indices.count());
        }
        self.take((corners as u64).saturating_mul(3 * BYTES_OF_CORNER))?;
        for (semantic, accessor) in primitive.attributes() {
            match semantic {
                Semantic::Positions | Semantic::Normals => self.check_floats(&accessor, Dimensions::Vec3)?,
                Semantic::Tangents => self.check_floats(&accessor, Dimensions::Vec4)?,
                Semantic::TexCoords(0 | 1) => self.check_accessor(&accessor, &[Dimensions::Vec2])?,
                _ => continue,
            }
            if accessor.count() != positions.count() {
                return Err(self.invalid("a primitive's attributes differ in number"));
            }
        }
        let reader = primitive.reader(|buffer| self.buffers.get(buffer.index()).map(Vec::as_slice));
        let positions: Vec<_> = reader.read_positions().into_iter().flatten().collect();
        let coordinates = |set| reader.read_tex_coords(set).map_or(Vec::new(), |c| c.into_f32().collect());
        let order: Vec<u32> = match reader.read_indices() {
            Some(indices) => indices.into_u32().collect(),
            None => (0..positions.len() as u32).collect(),
        };
        let mesh = Mesh {
            positions,
            normals: reader.read_normals().into_iter().flatten().collect(),
            tangents: reader.read_tangents().into_iter().flatten().collect(),
            uv: coordinates(0),
            uv2: coordinates(1),
            triangles: triangles_of(mode, &order),
        };
        Ok(Some(placed(mesh, placement)))
    }

    fn check_floats(&self, accessor: &Accessor<'_>, shape: Dimensions) -> Result<(), FormatError> {
        if accessor.data_type() != DataType::F32 {
            return Err(self.invalid("an attribute that must be of floats is not"));
        }
        self.check_accessor(accessor, &[shape])
    }

    /// Refuses accessors whose values are not all within their buffers.
    fn check_accessor(&self, accessor: &Accessor<'_>, shapes: &[Dimensions]) -> Result<(), FormatError> {
        if !shapes.contains(&accessor.dimensions()) || accessor.count() == 0 {
            return Err(self.invalid("an accessor has another shape than its use needs, or no values"));
        }
        let size = accessor.size();
        if let Some(view) = accessor.view() {
            self.check_range(&view, accessor.offset(), accessor.count(), size)?;
        }
        match accessor.sparse() {
            Some(sparse) if sparse.count() == 0 || sparse.count() > accessor.count() => {
                Err(self.invalid("an accessor has more sparse values than values, or none"))
            }
            Some(sparse) => {
                let (indices, values) = (sparse.indices(), sparse.values());
                let size_of_index = indices.index_type().size();
                self.check_range(&indices.view(), indices.offset(), sparse.count(), size_of_index)?;
                self.check_range(&values.view(), values.offset(), sparse.count(), size)
            }
            None if accessor.view().is_none() => Err(self.invalid("an accessor has no data")),
            None => Ok(()),
        }
    }

    fn check_range(
        &self,
        view: &View<'_>,
        offset: usize,
        count: usize,
        size: usize,
    ) -> Result<(), FormatError> {
        let stride = view.stride().unwrap_or(size);
        let end = (count - 1).checked_mul(stride).and_then(|n| n.checked_add(size)?.checked_add(offset));
        let within_view = stride >= size && end.is_some_and(|end| end <= view.length());
        let length = self.buffers.get(view.buffer().index()).map_or(0, Vec::len);
        let end = view.offset().checked_add(view.length());
        if within_view && end.is_some_and(|end| end <= length) {
            return Ok(());
        }
        Err(self.invalid("an accessor reaches beyond its buffer"))
    }
}

/// A strip's every second triangle is wound the other way; fans share their first vertex.
fn triangles_of(mode: Mode, order: &[u32]) -> Vec<[u32; 3]> {
    match mode {
        Mode::TriangleStrip => {
            let turned =
                |(i, t): (usize, &[u32])| if i % 2 == 0 { [t[0], t[1], t[2]] } else { [t[1], t[0], t[2]] };
            order.windows(3).enumerate().map(turned).collect()
        }
        Mode::TriangleFan => order.windows(2).skip(1).map(|pair| [order[0], pair[0], pair[1]]).collect(),
        Mode::Points => order.iter().map(|&point| [point; 3]).collect(),
        _ => order.as_chunks::<3>().0.to_vec(),
    }
}

fn transformed(columns: &Placement, [x, y, z, w]: [f64; 4]) -> [f64; 4] {
    [0, 1, 2, 3]
        .map(|row| columns[0][row] * x + columns[1][row] * y + columns[2][row] * z + columns[3][row] * w)
}

/// `mesh` where `placement` puts it: normals by the cofactors, which need no inverse, and mirrored
/// meshes with the other handedness and winding.
fn placed(mut mesh: Mesh, placement: &Placement) -> Mesh {
    let axes = [0, 1, 2].map(|i| [placement[i][0], placement[i][1], placement[i][2]]);
    let cofactors = [0, 1, 2].map(|i| cross(axes[(i + 1) % 3], axes[(i + 2) % 3]));
    let determinant: f64 = (0..3).map(|i| axes[0][i] * cofactors[0][i]).sum();
    let side = if determinant < 0.0 { -1.0 } else { 1.0 };
    let turned = |columns: &[[f64; 3]; 3], v: [f32; 3]| {
        [0, 1, 2].map(|row| (0..3).map(|i| columns[i][row] * f64::from(v[i])).sum::<f64>())
    };
    for position in &mut mesh.positions {
        let [x, y, z] = position.map(f64::from);
        let [x, y, z, _] = transformed(placement, [x, y, z, 1.0]);
        *position = [x, y, z].map(|c| c as f32);
    }
    for normal in &mut mesh.normals {
        *normal = unit(turned(&cofactors, *normal).map(|c| side * c));
    }
    for tangent in &mut mesh.tangents {
        let [x, y, z, handedness] = *tangent;
        let [x, y, z] = unit(turned(&axes, [x, y, z]));
        *tangent = [x, y, z, handedness * side as f32];
    }
    if side < 0.0 {
        mesh.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
    }
    mesh
}

/// `v` at unit length; 0 stays 0, which drawing knows.
fn unit(v: [f64; 3]) -> [f32; 3] {
    let length = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    v.map(|c| if length > 0.0 { (c / length) as f32 } else { 0.0 })
}
