//! Makes `testdata/rigs`: meshes to bake rigs for and scenes to light them.
//!
//! `cargo run -p relight-formats --example rig_testdata [FOLDER]`; every run, on any machine, gives the same bytes.

mod car;
mod figure;
mod glb;
mod room;
mod scenes;
mod surface;

use relight_formats::{create_folder, write_whole};
use std::path::{Path, PathBuf};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR")).join("../testdata/rigs");
    let folder = std::env::args_os().nth(1).map_or(here, PathBuf::from);
    create_folder(&folder)?;
    let car = car::car();
    let radius = car.radius();
    write_whole(&folder.join("car.glb"), &glb::glb(&[("car", [0.0; 3], car)])?)?;
    write_whole(&folder.join("figure.glb"), &glb::glb(&figure::parts())?)?;
    write_whole(&folder.join("room.toml"), room::room().as_bytes())?;
    write_whole(&folder.join("flyby.toml"), scenes::flyby(radius).as_bytes())?;
    write_whole(&folder.join("small.toml"), scenes::SMALL.as_bytes())?;
    Ok(())
}
