//! Web folders of CNR relight and OpenLIME: the reader.
//!
//! Types `ptm`, `hsh` and `sh` (rgb, lrgb), `rbf` and `bilinear` (rgb, mrgb). Source: FORMATS.md of this project.

use super::web::{OF_A_FILE, Place, file_name, place_of_role};
use super::web_functions::{RBF_NODES, table_from_lights, table_from_square};
use super::web_info::{INFO, WebInfo, WebMaterial, info_path, read_info};
use super::web_tiles::{self, dzi_name};
use super::{AssetHeader, Details, open_measured, planar, plane_bytes, plane_quantizers};
use crate::FormatError;
use relight_core::basis::{Hsh, Learned, Ptm, Sh};
use relight_core::sphere::Octahedral;
use relight_core::{Basis, Direction, Layout, Model, RelightingMap, RelightingMaps, Space, Texels};
use relight_texture::{Precision, Quantizer, TexelFormat};
use std::path::{Path, PathBuf};

/// Sides of JPEG.
const SIDES: std::ops::RangeInclusive<usize> = 1..=65_535;

/// Enough for every description; `summarize` has no limit of its own.
const INFO_LIMIT: u64 = 64 << 20;

struct WebFolder {
    info: PathBuf,
    header: AssetHeader,
    description: WebInfo,
    /// Planes of the folder.
    planes: usize,
}

/// Reads a web folder, by its name or that of its `info.json`; see [`super::read_asset`].
pub(super) fn read(path: &Path, memory_limit: u64) -> Result<RelightingMaps, FormatError> {
    let web = open(path, memory_limit)?;
    let AssetHeader { width, height, model, .. } = &web.header;
    let format = TexelFormat::Plain { precision: Precision::U8, channels: 1 };
    let held = plane_bytes(*width, *height, model, format);
    if held > memory_limit || usize::try_from(held).is_err() {
        return Err(FormatError::too_large(path, held, memory_limit));
    }
    let mut texels = vec![Vec::new(); model.plane_count()];
    for file in 0..web.planes.div_ceil(OF_A_FILE) {
        let size = (*width, *height);
        let samples = match web.tiles(file) {
            None => web_tiles::read_planes(&web.file(file), size, memory_limit, held)?,
            Some(dzi) => web_tiles::read(&dzi, size, memory_limit, held)?,
        };
        for (role, texels) in texels.iter_mut().enumerate() {
            let Place { plane, negated } = place_of_role(model, role);
            if plane / OF_A_FILE == file {
                let flip = if negated { 255 } else { 0 };
                let codes = samples[plane % OF_A_FILE..].iter().step_by(OF_A_FILE);
                *texels = codes.map(|code| code ^ flip).collect();
            }
        }
    }
    let planes = plane_quantizers(&web.header)
        .into_iter()
        .zip(texels)
        .map(|(q, codes)| RelightingMap { scale: q.scale, bias: q.bias, texels: Texels::U8(codes) })
        .collect();
    let AssetHeader { width, height, model, .. } = web.header;
    Ok(RelightingMaps { width, height, model, planes })
}

/// See [`super::summarize_asset`].
pub(super) fn summarize(path: &Path) -> Result<(AssetHeader, Details), FormatError> {
    let web = open(path, INFO_LIMIT)?;
    let mut files = vec![web.info.clone()];
    let mut file_bytes = open_measured(&web.info)?.1;
    for file in 0..web.planes.div_ceil(OF_A_FILE) {
        let tiles = web.tiles(file);
        file_bytes += match &tiles {
            None => open_measured(&web.file(file))?.1,
            Some(dzi) => web_tiles::bytes(dzi)?,
        };
        files.push(tiles.unwrap_or_else(|| web.file(file)));
    }
    let WebInfo { kind, colorspace, quality, sigma, resolution, pixel_size_in_mm, colorprofile, .. } =
        web.description;
    let mut rows = vec![("type".to_owned(), kind), ("colour space".to_owned(), colorspace)];
    let numbers = [
        ("JPEG quality", quality),
        ("sigma", sigma),
        ("resolution", resolution.map(|resolution| resolution as f64)),
        ("pixel size (mm)", pixel_size_in_mm),
    ];
    rows.extend(numbers.into_iter().filter_map(|(name, value)| Some((name.to_owned(), value?.to_string()))));
    rows.extend(colorprofile.map(|profile| ("colour profile".to_owned(), profile)));
    Ok((web.header, Details { files, file_bytes, rows, ..Details::default() }))
}

impl WebFolder {
    fn file(&self, file: usize) -> PathBuf {
        self.info.with_file_name(file_name(file))
    }

    /// What describes the tiles of a file of planes, where it isn't whole.
    fn tiles(&self, file: usize) -> Option<PathBuf> {
        let dzi = self.info.with_file_name(dzi_name(file));
        (!self.file(file).is_file() && dzi.is_file()).then_some(dzi)
    }
}

/// Reads and checks the description.
fn open(path: &Path, memory_limit: u64) -> Result<WebFolder, FormatError> {
    let info = info_path(path);
    let description = read_info(&info, memory_limit)?;
    let checked = Checked { path: &info };
    let (width, height) = (description.width, description.height);
    if !SIDES.contains(&width) || !SIDES.contains(&height) {
        let problem =
            format!("width {width} and height {height} must be within 1..65535, as those of JPEG are");
        return Err(FormatError::invalid(&info, problem));
    }
    if !["jpg", "jpeg"].contains(&description.format.as_str()) {
        let problem = format!(
            "has planes of format '{}'; relight reads jpg, to which the program that made it can write them",
            description.format
        );
        return Err(FormatError::unsupported(&info, problem));
    }
    let planes = checked.planes(&description)?;
    let [material] = &description.materials[..] else {
        let problem = format!("has {} materials where 1 is read; keep one", description.materials.len());
        return Err(FormatError::unsupported(&info, problem));
    };
    let quantizers = checked.quantizers(material, planes)?;
    let lights = checked.lights(&description.lights)?;
    let (basis, layout) = checked.functions(&description, material, planes, &lights)?;
    let model = Model { basis, layout, space: Space::Encoded, lights, figures: None, provenance: None };
    let of_role = |role: usize| {
        let Place { plane, negated } = place_of_role(&model, role);
        let (scale, bias) = quantizers[plane];
        // Of a negated plane the codes are counted from the other end.
        let bias = if negated { 1.0 - bias } else { bias };
        Quantizer { scale: scale as f32, bias: (-bias * scale) as f32 }
    };
    let packing = planar::packing(Precision::U8, (0..model.plane_count()).map(of_role));
    let header = AssetHeader { width, height, model, packing };
    let folder = WebFolder { info, header, description, planes };
    folder.check_files()?;
    Ok(folder)
}

impl WebFolder {
    /// Names the first file of planes that is missing.
    fn check_files(&self) -> Result<(), FormatError> {
        for file in 0..self.planes.div_ceil(OF_A_FILE) {
            let path = self.file(file);
            if path.is_file() || self.tiles(file).is_some() {
                continue;
            }
            let tiles = path.with_extension("tzi");
            if tiles.is_file() {
                let problem = "holds tiles in one file, which relight does not read; write plane_0.jpg .. or plane_0.dzi ..";
                return Err(FormatError::unsupported(&tiles, problem));
            }
            let problem =
                format!("is missing, though {INFO} has {} planes; copy the whole folder", self.planes);
            return Err(FormatError::invalid(&path, problem));
        }
        Ok(())
    }
}

/// What checks the numbers of the description at `path`.
struct Checked<'a> {
    path: &'a Path,
}

impl Checked<'_> {
    fn invalid<T>(&self, problem: String) -> Result<T, FormatError> {
        Err(FormatError::invalid(self.path, problem))
    }

    fn unsupported<T>(&self, problem: String) -> Result<T, FormatError> {
        Err(FormatError::unsupported(self.path, problem))
    }

    fn planes(&self, description: &WebInfo) -> Result<usize, FormatError> {
        let space = description.colorspace.as_str();
        if !["rgb", "lrgb", "mrgb"].contains(&space) {
            return self.unsupported(format!(
                "has colour space '{space}'; relight reads rgb, lrgb and mrgb, in which the program that made it \
                 can write it"
            ));
        }
        // Not one basis has more: 121 functions of three channels.
        match description.nplanes {
            Some(planes @ 1..=363) => Ok(planes),
            Some(planes) => self.invalid(format!("{planes} planes (nplanes) are outside 1..363")),
            None => self.invalid("has no number of planes (nplanes)".to_owned()),
        }
    }

    /// Scale and bias of each plane.
    fn quantizers(&self, material: &WebMaterial, planes: usize) -> Result<Vec<(f64, f64)>, FormatError> {
        for (name, numbers) in [("scales", &material.scale), ("biases", &material.bias)] {
            if numbers.len() != planes {
                return self.invalid(format!("has {} {name} for {planes} planes (nplanes)", numbers.len()));
            }
        }
        let pairs = material.scale.iter().copied().zip(material.bias.iter().copied());
        for (plane, (scale, bias)) in pairs.clone().enumerate() {
            let ends = [scale, -bias * scale, (1.0 - bias) * scale];
            if ends.iter().any(|end| !(*end as f32).is_finite()) {
                return self.invalid(format!(
                    "scale {scale:e} and bias {bias:e} of plane {plane} give values beyond 3.4e38"
                ));
            }
        }
        Ok(pairs.collect())
    }

    fn lights(&self, numbers: &[f64]) -> Result<Vec<Direction>, FormatError> {
        let (lights, rest) = numbers.as_chunks::<3>();
        if !rest.is_empty() {
            return self
                .invalid(format!("has {} numbers of lights, which is no multiple of 3", numbers.len()));
        }
        let direction = |(i, &[x, y, z]): (usize, &[f64; 3])| {
            Direction::new(x, y, z)
                .or_else(|error| self.invalid(format!("light {i} ({x}, {y}, {z}): {error}")))
        };
        lights.iter().enumerate().map(direction).collect()
    }

    /// The functions of light, and how planes use them.
    fn functions(
        &self,
        description: &WebInfo,
        material: &WebMaterial,
        planes: usize,
        lights: &[Direction],
    ) -> Result<(Basis, Layout), FormatError> {
        let (kind, space) = (description.kind.as_str(), description.colorspace.as_str());
        if kind == "rbf" || kind == "bilinear" {
            if space == "lrgb" {
                return self.unsupported(format!(
                    "has type {kind} in colour space lrgb; relight reads rgb and mrgb"
                ));
            }
            let learned = self.learned(description, material, planes, lights)?;
            return Ok((Basis::Learned(learned), Layout::Shared));
        }
        if !["ptm", "hsh", "sh"].contains(&kind) {
            return self.unsupported(format!(
                "has type '{kind}'; relight reads ptm, hsh, sh, rbf and bilinear, and the program that made it can \
                 write them"
            ));
        }
        let (layout, count) = match space {
            "lrgb" => (Layout::Lrgb, planes.checked_sub(3)),
            "rgb" => (Layout::Rgb, planes.is_multiple_of(3).then_some(planes / 3)),
            _ => {
                return self.unsupported(format!(
                    "has type {kind} in colour space {space}; relight reads rgb and lrgb"
                ));
            }
        };
        let basis = count.and_then(|count| match kind {
            "ptm" if count == 6 => Ptm::with_count(count).ok().map(Basis::Ptm),
            "hsh" => Hsh::with_count(count).ok().map(Basis::Hsh),
            "sh" => Sh::with_count(count).ok().map(Basis::Sh),
            _ => None,
        });
        let Some(basis) = basis else {
            return self.invalid(format!(
                "has {planes} planes (nplanes) of type {kind} in {space}, which is no number that it can have"
            ));
        };
        Ok((basis, layout))
    }

    /// The learned functions of types `rbf` and `bilinear`.
    fn learned(
        &self,
        description: &WebInfo,
        material: &WebMaterial,
        planes: usize,
        lights: &[Direction],
    ) -> Result<Learned, FormatError> {
        let WebInfo { basis, sigma, resolution, kind, .. } = description;
        let range = &material.range;
        if range.len() != planes {
            return self.invalid(format!("has {} ranges for {planes} planes (nplanes)", range.len()));
        }
        let directions = match (kind.as_str(), resolution) {
            ("bilinear", Some(edge)) if (2..=Octahedral::LARGEST).contains(edge) => edge * edge,
            ("bilinear", _) => {
                let found = resolution.map_or("none".to_owned(), |resolution| resolution.to_string());
                return self
                    .invalid(format!("needs a resolution within 2..{}, has {found}", Octahedral::LARGEST));
            }
            _ if lights.is_empty() => return self.invalid("has type rbf and no lights".to_owned()),
            _ => lights.len(),
        };
        let expected = 3 * (planes + 1) * directions;
        if basis.len() != expected {
            return self.invalid(format!(
                "has {} numbers in basis where {planes} planes and their mean at {directions} directions take \
                 {expected}",
                basis.len()
            ));
        }
        let square = |nodes: usize| Octahedral { nodes, hemisphere: true };
        let (square, table) = match (kind.as_str(), sigma) {
            ("bilinear", _) => {
                let edge = directions.isqrt();
                (square(edge), table_from_square(basis, range, edge))
            }
            // Narrower ones leave nothing but the nearest light, wider ones their mean.
            (_, Some(sigma)) if (1e-4..=1e4).contains(sigma) => {
                let table = table_from_lights(basis, range, lights, *sigma, square(RBF_NODES));
                (square(RBF_NODES), table)
            }
            (_, sigma) => {
                let found = sigma.map_or("none".to_owned(), |sigma| format!("{sigma:e}"));
                return self.invalid(format!("needs a sigma within 1e-4..1e4, has {found}"));
            }
        };
        Learned::new(format!("web {kind}"), planes, 3, square, table)
            .or_else(|error| self.invalid(format!("functions of type {kind}: {error}")))
    }
}
