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
    let folder = std::env::args_os().nth(1).map_or(testdata(), PathBuf::from);
    create_folder(&folder)?;
    for (name, bytes) in files()? {
        write_whole(&folder.join(name), &bytes)?;
    }
    Ok(())
}

fn testdata() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../testdata/rigs")
}

/// Names and what they hold.
type Files = [(&'static str, Vec<u8>); 5];

fn files() -> Result<Files, Box<dyn std::error::Error>> {
    let car = car::car();
    let flyby = scenes::flyby(car.radius());
    Ok([
        ("car.glb", glb::glb(&[("car", [0.0; 3], car)])?),
        ("figure.glb", glb::glb(&figure::parts())?),
        ("room.toml", room::room().into_bytes()),
        ("flyby.toml", flyby.into_bytes()),
        ("small.toml", scenes::SMALL.as_bytes().to_vec()),
    ])
}

#[cfg(test)]
mod tests {
    #[test]
    fn testdata_is_what_this_makes() {
        for (name, bytes) in super::files().unwrap() {
            let kept = std::fs::read(super::testdata().join(name)).unwrap();
            assert!(kept == bytes, "{name} differs: make it again and say why");
        }
    }
}
