#![allow(clippy::unwrap_used, reason = "a test's helpers fail as the test does")]

use super::*;

const LIMIT: u64 = 1 << 24;

/// Two parts, lopsided: no two numbers are the same.
fn rig_file() -> RigFile {
    let part = |name: &str, text: &str, first: f64, quantities: &[Quantity]| {
        let model = Model::parse(text).unwrap();
        let number = |i: usize| first + 0.1 * i as f64 + 1.0 / (i as f64 + 3.0);
        let samples: Vec<Sample> = (0..quantities.len())
            .map(|i| Sample { position: [0, 1, 2].map(|axis| number(3 * i + axis)), quantity: quantities[i] })
            .collect();
        let operator = (0..model.parameters().len() * samples.len()).map(|i| -number(i + 100)).collect();
        let surface = (0..5).map(|i| SurfacePoint {
            position: [0, 1, 2].map(|axis| number(3 * i + axis + 1000)),
            normal: relight_core::vectors::unit([number(i), -0.3, first]).unwrap(),
        });
        RigPart {
            name: name.to_owned(),
            model,
            frame: Frame {
                centre: [-0.0, first, 1e-300],
                half_extent: [1.0 / 3.0, 2.0, 0.0],
                radius: 2.5 + first,
            },
            samples,
            operator,
            surface: surface.collect(),
            errors: ErrorTable {
                distances: vec![1.1, 2.0 + first, 40.0],
                rig: vec![0.3, 0.1, 0.0],
                total: vec![0.5 + first, 0.3, 0.1],
            },
        }
    };
    use Quantity::{Slope, Value};
    let parts = vec![
        part("body \"ü\"", "mixed:3,gradient,constant", 0.25, &[Value; 4]),
        part("", "gradient", 7.0, &[Value, Slope(0), Slope(1), Slope(2)]),
    ];
    let mesh = MeshKey { name: "car.glb".to_owned(), triangles: 12, key: "0123456789abcdef".repeat(4) };
    RigFile { mesh, rig: Rig { bands: 3, parts } }
}

fn bytes_of_rig(file: &RigFile) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rig");
    write_rig(&path, file).unwrap();
    assert!(is_rig(&path));
    std::fs::read(path).unwrap()
}

fn read_bytes(bytes: &[u8], limit: u64) -> Result<RigFile, FormatError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rig");
    std::fs::write(&path, bytes).unwrap();
    read_rig(&path, limit)
}

/// The file with its head's text changed, its length kept honest.
fn with_head(bytes: &[u8], from: &str, to: &str) -> Vec<u8> {
    let length = u64::from_le_bytes(bytes[8..16].try_into().unwrap()) as usize;
    let head = std::str::from_utf8(&bytes[16..16 + length]).unwrap();
    assert!(head.contains(from), "{head}");
    let head = head.replacen(from, to, 1);
    [&bytes[..8], &(head.len() as u64).to_le_bytes(), head.as_bytes(), &bytes[16 + length..]].concat()
}

#[test]
fn rigs_come_back_bit_for_bit() {
    let file = rig_file();
    let bytes = bytes_of_rig(&file);
    let back = read_bytes(&bytes, LIMIT).unwrap();
    assert_eq!(back, file);
    assert_eq!(back.rig.parts[0].frame.centre[0].to_bits(), (-0.0f64).to_bits());
    assert_eq!(bytes_of_rig(&back), bytes);
}

#[test]
fn the_layout_is_the_documented_one() {
    let file = rig_file();
    let bytes = bytes_of_rig(&file);
    let length = u64::from_le_bytes(bytes[8..16].try_into().unwrap()) as usize;
    assert_eq!(length % 8, 0);
    let head: serde_json::Value = serde_json::from_slice(&bytes[16..16 + length]).unwrap();
    assert_eq!(head["parts"][1]["quantities"], "vxyz");
    let array = &head["parts"][1]["operator"];
    assert_eq!(array["shape"], serde_json::json!([4, 4]));
    // Row 2, column 1 of the second part's operator, found as docs/formats.md says.
    let at = 16 + length + array["offset"].as_u64().unwrap() as usize + 8 * (2 * 4 + 1);
    let number = f64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
    assert_eq!(number, file.rig.parts[1].operator[9]);
}

#[test]
fn rigs_that_contradict_themselves_are_refused_in_a_sentence() {
    let bytes = bytes_of_rig(&rig_file());
    let refused = |bytes: &[u8], words: &str| {
        let message = read_bytes(bytes, LIMIT).unwrap_err().to_string();
        assert!(message.contains(words) && message.contains(';'), "{message} lacks '{words}'");
    };
    let changed = |from: &str, to: &str, words: &str| refused(&with_head(&bytes, from, to), words);
    changed("\"version\":1", "\"version\":2,\"new\":[]", "version 2 where 1 is read");
    changed("\"bands\":3", "\"bands\":8", "8 bands");
    changed("gradient,constant\"", "gradient,gradient\"", "where [12, 4] belong");
    changed("\"vxyz\"", "\"vxyw\"", "'w' of a sample");
    changed("\"vxyz\"", "\"vxy\"", "where [3, 3] belong");
    changed("\"offset\":96", "\"offset\":88", "should start at 96");
    changed("40.0", "2.25", "don't rise");
    changed("\"distances\":[1.1", "\"distances\":[0.9", "from above 1");
    changed("[0.3,0.1,0.0]", "[0.3,0.1]", "2 and 3 errors for 3");
    changed("[0.3,0.1,0.0]", "[0.3,-0.1,0.0]", "error of -0.1");
    changed("2.75", "0.0", "radius");
    changed("0123", "012g", "64 hexadecimal digits");
    changed("car.glb", "../car.glb", "names a folder");
    changed("body \\\"ü\\\"", "", "two parts ''");
    changed("\"bands\"", "\"bnads\"", "unknown field");
    refused(&[&bytes[..], &[0; 8]].concat(), "8 bytes after");
    refused(&bytes[..bytes.len() - 1], "copy it again");
    refused(&bytes[..12], "truncated");
    refused(b"{}", "no rig file");
    // The last number is a normal's component.
    for (number, words) in [(f64::NAN, "normal"), (1.5, "normal of length")] {
        let last = bytes.len() - 8;
        refused(&[&bytes[..last], &number.to_le_bytes()].concat(), words);
    }
    assert!(matches!(read_bytes(&bytes, 4096), Err(FormatError::TooLarge { .. })));
}

#[test]
fn rigs_that_would_not_be_read_are_not_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rig");
    let refused = |change: &dyn Fn(&mut RigPart)| {
        let mut file = rig_file();
        change(&mut file.rig.parts[1]);
        assert!(write_rig(&path, &file).is_err());
        assert!(!path.exists() && !is_rig(&path));
    };
    refused(&|part| part.operator[3] = f64::INFINITY);
    refused(&|part| part.operator.truncate(15));
    refused(&|part| part.samples[0].position[1] = f64::NAN);
    refused(&|part| part.samples[0].quantity = Quantity::Slope(3));
    refused(&|part| part.samples.clear());
    refused(&|part| part.frame.radius = f64::NAN);
    refused(&|part| part.surface[0].normal = [0.0; 3]);
}

#[test]
fn mangled_rigs_are_errors_or_rigs() {
    let valid = bytes_of_rig(&rig_file());
    let mut state = 0x9E37_79B9_7F4A_7C15u64;
    let mut random = |below: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((state >> 33) % below as u64) as usize
    };
    let mut refused = 0;
    for round in 0..500 {
        let mut bytes = valid.clone();
        for _ in 0..=random(4) {
            let at = random(if round % 2 == 0 { valid.len().min(1200) } else { valid.len() });
            bytes[at] = if random(2) == 0 { bytes[at] ^ (1 << random(8)) } else { random(256) as u8 };
        }
        if random(4) == 0 {
            bytes.truncate(random(valid.len()));
        }
        match read_bytes(&bytes, LIMIT) {
            // What is read can be written, and is what was read.
            Ok(file) => assert_eq!(read_bytes(&bytes_of_rig(&file), LIMIT).unwrap(), file),
            Err(FormatError::Invalid { .. } | FormatError::Unsupported { .. }) => refused += 1,
            Err(other) => panic!("{other}"),
        }
    }
    assert!((250..490).contains(&refused), "{refused}");
}

#[test]
fn mesh_keys_are_of_contents() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        MeshKey::of(&path, 5).unwrap()
    };
    let (a, b, c) = (file("a.obj", b"one"), file("b.obj", b"one"), file("c.obj", b"two"));
    assert_eq!((a.name.as_str(), a.triangles, a.key.len()), ("a.obj", 5, 64));
    assert!(a.key == b.key && a.key != c.key);
}
