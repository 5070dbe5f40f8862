//! Rig files (`.rig`): a JSON head and little-endian f64 arrays. docs/formats.md has the layout.

use crate::content::content_key;
use crate::error::check_memory;
use crate::machine::bytes_of;
use crate::{FormatError, write_whole};
use relight_core::vectors::length;
use relight_rig::{ErrorTable, Frame, MOST_BANDS, Model, Quantity, Rig, RigPart, Sample, SurfacePoint};
use serde::{Deserialize, Serialize};
use std::collections::HashSet;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// The first bytes; they don't survive being sent as text.
const MAGIC: [u8; 8] = *b"\x89RIG\r\n\x1a\n";

/// The version that is written and read.
const VERSION: u64 = 1;

/// Bytes before the head: magic and the head's length.
const BEFORE_HEAD: usize = 16;

/// Memory that a byte of a file may take: those of a lattice of 512 parameters and one sample, 37 kB for 4.
const MEMORY_OF_BYTE: u64 = 12;

/// How far from 1 a normal's length may be: it may come from 8-bit normals.
const NORMAL_TOLERANCE: f64 = 1e-3;

/// A rig and the mesh that it was made for.
#[derive(Clone, Debug, PartialEq)]
pub struct RigFile {
    /// Which mesh.
    pub mesh: MeshKey,
    /// The rig.
    pub rig: Rig,
}

/// By what a mesh is known again.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeshKey {
    /// Name of its file, without folders; for people.
    pub name: String,
    /// How many triangles it has, for people.
    pub triangles: usize,
    /// [`content_key`] of its file, without settings: 64 hexadecimal digits. Buffers beside a `.gltf` don't count.
    pub key: String,
}

impl MeshKey {
    /// The key of the mesh in a file.
    ///
    /// # Errors
    /// [`FormatError::Io`].
    pub fn of(path: &Path, triangles: usize) -> Result<Self, FormatError> {
        let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        Ok(Self { name, triangles, key: content_key("", [path])? })
    }
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Head {
    version: u64,
    bands: usize,
    mesh: MeshKey,
    parts: Vec<PartRecord>,
}

#[derive(Deserialize)]
struct HeadOfAnyVersion {
    version: u64,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PartRecord {
    name: String,
    model: String,
    centre: [f64; 3],
    half_extent: [f64; 3],
    radius: f64,
    /// A letter a sample.
    quantities: String,
    samples: ArrayRecord,
    operator: ArrayRecord,
    surface: ArrayRecord,
    errors: ErrorsRecord,
}

/// Where an array lies, row-major.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ArrayRecord {
    /// In bytes from the end of the head.
    offset: usize,
    shape: [usize; 2],
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ErrorsRecord {
    distances: Vec<f64>,
    rig: Vec<f64>,
    total: Vec<f64>,
}

/// Whether a file begins as rigs do; `false` where it can't be read.
pub fn is_rig(path: &Path) -> bool {
    let mut first = [0; MAGIC.len()];
    File::open(path).and_then(|mut file| file.read_exact(&mut first)).is_ok() && first == MAGIC
}

/// Writes a rig, whole or not at all.
///
/// # Errors
/// [`FormatError::Invalid`] for a rig that [`read_rig`] would refuse, [`FormatError::Io`].
pub fn write_rig(path: &Path, file: &RigFile) -> Result<(), FormatError> {
    check(file).map_err(|problem| FormatError::invalid(path, problem))?;
    let mut arrays = Vec::new();
    let parts = file.rig.parts.iter().map(|part| record_of(part, &mut arrays)).collect();
    let head = Head { version: VERSION, bands: file.rig.bands, mesh: file.mesh.clone(), parts };
    let mut text = serde_json::to_vec(&head)
        .map_err(|error| FormatError::io(path, "write", std::io::Error::other(error)))?;
    text.resize(text.len().next_multiple_of(8), b' ');
    write_whole(path, &[&MAGIC[..], &(text.len() as u64).to_le_bytes(), &text, &arrays].concat())
}

/// Reads a rig; `memory_limit` bounds what it takes meanwhile, in bytes.
///
/// # Errors
/// [`FormatError::Unsupported`] for other files and other versions, [`FormatError::Invalid`] for what is damaged or
/// contradicts itself, [`FormatError::TooLarge`], [`FormatError::Io`].
pub fn read_rig(path: &Path, memory_limit: u64) -> Result<RigFile, FormatError> {
    let metadata = std::fs::metadata(path).map_err(|source| FormatError::io(path, "open", source))?;
    check_memory(metadata.len().saturating_mul(MEMORY_OF_BYTE), memory_limit, path)?;
    let bytes = bytes_of(path, memory_limit / MEMORY_OF_BYTE)?;
    let invalid = |problem: String| FormatError::invalid(path, problem);
    if !bytes.starts_with(&MAGIC) {
        return Err(FormatError::unsupported(path, "is no rig file; make one with `relight rig bake`"));
    }
    let (head, arrays) = head_and_arrays(&bytes).ok_or_else(|| {
        invalid("truncated rig: its head is longer than the file; copy it again".to_owned())
    })?;
    let damaged =
        |error: serde_json::Error| invalid(format!("damaged head of the rig: {error}; bake it again"));
    let HeadOfAnyVersion { version } = serde_json::from_slice(head).map_err(damaged)?;
    if version != VERSION {
        let problem = format!("rig of version {version} where {VERSION} is read; bake it again");
        return Err(FormatError::unsupported(path, problem));
    }
    let head: Head = serde_json::from_slice(head).map_err(damaged)?;
    let mut arrays = Arrays { bytes: arrays, taken: 0 };
    let parts = head.parts.into_iter().map(|record| part_of(record, &mut arrays));
    let parts = parts.collect::<Result<_, String>>().map_err(invalid)?;
    if arrays.taken != arrays.bytes.len() {
        let left = arrays.bytes.len() - arrays.taken;
        return Err(invalid(format!("{left} bytes after the rig's last array; bake it again")));
    }
    let file = RigFile { mesh: head.mesh, rig: Rig { bands: head.bands, parts } };
    check(&file).map_err(invalid)?;
    Ok(file)
}

fn head_and_arrays(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let length = bytes.get(MAGIC.len()..BEFORE_HEAD)?.as_chunks::<8>().0.first()?;
    let length = usize::try_from(u64::from_le_bytes(*length)).ok()?;
    bytes[BEFORE_HEAD..].split_at_checked(length)
}

/// The arrays of a file, which follow one another without gaps: no byte is read twice.
struct Arrays<'a> {
    bytes: &'a [u8],
    taken: usize,
}

impl<'a> Arrays<'a> {
    /// The numbers of the next array, a row of `N` at a time.
    fn rows<const N: usize>(
        &mut self,
        what: &str,
        record: &ArrayRecord,
        shape: [usize; 2],
    ) -> Result<impl ExactSizeIterator<Item = [f64; N]> + use<'a, N>, String> {
        let ArrayRecord { offset, shape: stored } = *record;
        if stored != shape {
            return Err(format!("the rig's {what} are {stored:?} where {shape:?} belong; bake it again"));
        }
        let size = shape[0].checked_mul(shape[1]).and_then(|count| count.checked_mul(8));
        let bytes = size.and_then(|size| self.bytes.get(self.taken..)?.get(..size));
        let bytes = bytes.filter(|_| offset == self.taken).ok_or_else(|| {
            format!(
                "the rig's {what}, {stored:?} numbers at byte {offset} of its arrays, should start at {} and end at {} \
                 at the latest; copy it again",
                self.taken,
                self.bytes.len()
            )
        })?;
        self.taken += bytes.len();
        let numbers = |row: &[[u8; 8]; N]| row.map(f64::from_le_bytes);
        Ok(bytes.as_chunks::<8>().0.as_chunks::<N>().0.iter().map(numbers))
    }
}

fn part_of(record: PartRecord, arrays: &mut Arrays<'_>) -> Result<RigPart, String> {
    let name = &record.name;
    let model = Model::parse(&record.model).map_err(|error| format!("part '{name}': {error}"))?;
    let count = record.quantities.len();
    let quantities = record.quantities.bytes().map(|letter| {
        quantity_of(letter).ok_or_else(|| {
            format!("part '{name}' takes '{}' of a sample; v, x, y and z are known", letter.escape_ascii())
        })
    });
    let positions = arrays.rows("samples", &record.samples, [count, 3])?;
    let samples =
        positions.zip(quantities).map(|(position, quantity)| Ok(Sample { position, quantity: quantity? }));
    let samples = samples.collect::<Result<_, String>>()?;
    let operator = arrays.rows("operator", &record.operator, [model.parameters().len(), count])?;
    let operator = operator.map(|[number]| number).collect();
    let surface = arrays.rows("surface", &record.surface, [record.surface.shape[0], 6])?;
    let point = |[x, y, z, nx, ny, nz]: [f64; 6]| SurfacePoint { position: [x, y, z], normal: [nx, ny, nz] };
    let surface = surface.map(point).collect();
    let ErrorsRecord { distances, rig, total } = record.errors;
    Ok(RigPart {
        name: record.name,
        model,
        frame: Frame { centre: record.centre, half_extent: record.half_extent, radius: record.radius },
        samples,
        operator,
        surface,
        errors: ErrorTable { distances, rig, total },
    })
}

fn record_of(part: &RigPart, arrays: &mut Vec<u8>) -> PartRecord {
    let mut stored = |shape: [usize; 2], numbers: &mut dyn Iterator<Item = f64>| {
        let offset = arrays.len();
        arrays.extend(numbers.flat_map(f64::to_le_bytes));
        ArrayRecord { offset, shape }
    };
    let (samples, surface) = (&part.samples, &part.surface);
    let parameters = part.model.parameters().len();
    PartRecord {
        name: part.name.clone(),
        model: part.model.text().to_owned(),
        centre: part.frame.centre,
        half_extent: part.frame.half_extent,
        radius: part.frame.radius,
        quantities: samples.iter().map(|sample| letter_of(sample.quantity)).collect(),
        samples: stored([samples.len(), 3], &mut samples.iter().flat_map(|sample| sample.position)),
        operator: stored([parameters, samples.len()], &mut part.operator.iter().copied()),
        surface: stored(
            [surface.len(), 6],
            &mut surface.iter().flat_map(|point| [point.position, point.normal].into_iter().flatten()),
        ),
        errors: ErrorsRecord {
            distances: part.errors.distances.clone(),
            rig: part.errors.rig.clone(),
            total: part.errors.total.clone(),
        },
    }
}

const LETTERS: [char; 3] = ['x', 'y', 'z'];

fn letter_of(quantity: Quantity) -> char {
    match quantity {
        Quantity::Value => 'v',
        Quantity::Slope(axis) => LETTERS[axis],
    }
}

fn quantity_of(letter: u8) -> Option<Quantity> {
    let axis = || LETTERS.iter().position(|&axis| axis == char::from(letter));
    if letter == b'v' { Some(Quantity::Value) } else { axis().map(Quantity::Slope) }
}

/// Whether a rig is one that lighting by it can trust; what is wrong with it otherwise.
fn check(file: &RigFile) -> Result<(), String> {
    let RigFile { mesh, rig } = file;
    if mesh.key.len() != 64 || !mesh.key.bytes().all(|digit| digit.is_ascii_hexdigit()) {
        return Err("the key of the rig's mesh is not 64 hexadecimal digits; bake it again".to_owned());
    }
    if mesh.name.contains(['/', '\\']) {
        return Err(format!("the name '{}' of the rig's mesh names a folder; bake it again", mesh.name));
    }
    if !(1..=MOST_BANDS).contains(&rig.bands) {
        return Err(format!(
            "{} bands of harmonics where 1 to {MOST_BANDS} are known; bake the rig again",
            rig.bands
        ));
    }
    if rig.parts.is_empty() {
        return Err("the rig has no parts where it needs 1; bake it again".to_owned());
    }
    let mut names = HashSet::new();
    for part in &rig.parts {
        if !names.insert(&part.name) {
            return Err(format!("the rig has two parts '{}'; give them names of their own", part.name));
        }
        check_part(part).map_err(|problem| format!("part '{}' {problem}; bake the rig again", part.name))?;
    }
    Ok(())
}

fn check_part(part: &RigPart) -> Result<(), String> {
    let RigPart { model, frame, samples, operator, surface, errors, .. } = part;
    finite("frame", frame.centre.into_iter().chain(frame.half_extent).chain([frame.radius]))?;
    if !(frame.radius > 0.0 && frame.half_extent.iter().all(|&half| half >= 0.0)) {
        return Err("has a frame whose radius is not above 0 or whose box has an edge below 0".to_owned());
    }
    if samples.is_empty() {
        return Err("has no samples where it needs 1".to_owned());
    }
    let parameters = model.parameters().len();
    if operator.len() != parameters * samples.len() {
        let (numbers, samples) = (operator.len(), samples.len());
        return Err(format!("has an operator of {numbers} numbers for {parameters} x {samples}"));
    }
    if let Some(axis) = samples.iter().find_map(|sample| match sample.quantity {
        Quantity::Slope(axis) if axis > 2 => Some(axis),
        _ => None,
    }) {
        return Err(format!("has a slope along axis {axis} where 0 to 2 are known"));
    }
    finite("samples", samples.iter().flat_map(|sample| sample.position))?;
    finite("operator", operator.iter().copied())?;
    finite("surface", surface.iter().flat_map(|point| point.position))?;
    for point in surface {
        let length = length(point.normal);
        if length.is_nan() || (length - 1.0).abs() > NORMAL_TOLERANCE {
            return Err(format!(
                "has a normal of length {length} where 1 is needed, within {NORMAL_TOLERANCE}"
            ));
        }
    }
    let ErrorTable { distances, rig, total } = errors;
    if rig.len() != distances.len() || total.len() != distances.len() {
        let (distances, rig, total) = (distances.len(), rig.len(), total.len());
        return Err(format!("has {rig} and {total} errors for {distances} distances"));
    }
    finite("table of errors", [distances, rig, total].into_iter().flatten().copied())?;
    let outside = distances.first().is_some_and(|&first| first <= 1.0);
    if outside || distances.windows(2).any(|pair| pair[0] >= pair[1]) {
        return Err("has distances of errors that don't rise from above 1".to_owned());
    }
    match rig.iter().chain(total).find(|&&error| error < 0.0) {
        Some(error) => Err(format!("has an error of {error} where 0 is the least")),
        None => Ok(()),
    }
}

fn finite(what: &str, numbers: impl IntoIterator<Item = f64>) -> Result<(), String> {
    match numbers.into_iter().find(|number| !number.is_finite()) {
        Some(number) => Err(format!("has {number} in its {what} where numbers must be finite")),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests;
