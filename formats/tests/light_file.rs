//! Light files as they are found in the wild, and the pictures that they name.

#![allow(clippy::unwrap_used, reason = "clippy spares tests, not the functions they share")]

use relight_formats::FormatError;
use relight_formats::light_file::{LightFile, light_file_in, match_pictures, parse_light_file, unmatched};
use std::fs;
use std::path::Path;

fn parse(bytes: impl AsRef<[u8]>) -> Result<LightFile, FormatError> {
    parse_light_file(bytes.as_ref(), Path::new("dome/lights.lp"))
}

/// Names and vectors.
fn entries(file: &LightFile) -> Vec<(&str, [f64; 3])> {
    file.entries.iter().map(|entry| (entry.name.as_str(), entry.vector)).collect()
}

#[test]
fn plain_file_keeps_order_lines_and_digits() {
    let file =
        parse("2\nb.jpg 0.205158607891401 -0.237020612397229 0.949595268999854\na.jpg 0 0.6 0.8\n").unwrap();
    assert_eq!(file.declared, Some(2));
    assert_eq!(
        entries(&file),
        [("b.jpg", [0.205158607891401, -0.237020612397229, 0.949595268999854]), ("a.jpg", [0.0, 0.6, 0.8])]
    );
    assert_eq!((file.entries[0].line, file.entries[1].line), (2, 3));
    let [x, y, z] = file.entries[1].direction.components();
    assert!(x == 0.0 && (y - 0.6).abs() < 1e-15 && (z - 0.8).abs() < 1e-15);
    assert!(file.notes.is_empty(), "{:?}", file.notes);
}

#[test]
fn every_way_of_writing_a_line_is_understood() {
    let half = [0.5, -0.5, 0.707];
    for (line, name) in [
        ("a.jpg 0.5 -0.5 0.707", "a.jpg"),
        ("a.jpg\t0.5\t-0.5\t0.707", "a.jpg"),
        ("  a.jpg   0.5 -.5 7.07e-1 \t ", "a.jpg"),
        (r"H:\RTI_Data\my object\x 01.jpg 0.5 -0.5 0.707", r"H:\RTI_Data\my object\x 01.jpg"),
        ("photo of 12 3 0.5 -0.5 0.707", "photo of 12 3"),
        ("12 0.5 -0.5 0.707", "12"),
        ("\"my file.jpg\" 0.5 -0.5 0.707", "my file.jpg"),
        ("'my file.jpg'\t0.5 -0.5 0.707", "my file.jpg"),
        ("\"a.jpg\";\"0.5\";\"-0.5\";\"0.707\"", "a.jpg"),
        ("a.jpg 0,5 -0,5 0,707", "a.jpg"),
        ("a.jpg;0,5;-0,5;0,707", "a.jpg"),
        ("a.jpg; 0.5; -0.5; 0.707;", "a.jpg"),
        ("a.jpg, 0.5, -0.5, 0.707", "a.jpg"),
        ("a.jpg,0.5,-0.5,0.707", "a.jpg"),
        ("a.jpg ,0.5 ,-0.5 ,0.707", "a.jpg"),
        ("a.jpg 0.5,-0.5,0.707", "a.jpg"),
        ("a.jpg, 0,5, -0,5, 0,707", "a.jpg"),
        ("one, two.jpg 0.5 -0.5 0.707", "one, two.jpg"),
        ("one, two.jpg,0.5,-0.5,0.707", "one, two.jpg"),
        ("one;two.jpg 0.5 -0.5 0.707", "one;two.jpg"),
        ("a.jpg +0.5 -5e-1 0.707,", "a.jpg"),
    ] {
        let file = parse(format!("1\n{line}\n")).unwrap_or_else(|error| panic!("'{line}': {error}"));
        assert_eq!(entries(&file), [(name, half)], "'{line}'");
    }
}

#[test]
fn every_way_of_ending_lines_is_understood() {
    let expected = [("a.jpg", [1.0, 0.0, 0.0]), ("b.jpg", [0.0, 1.0, 0.0])];
    for (text, last) in [
        ("2\na.jpg 1 0 0\nb.jpg 0 1 0", 3),
        ("2\r\na.jpg 1 0 0 \r\nb.jpg 0 1 0 \r\n", 3),
        ("2\ra.jpg 1 0 0\rb.jpg 0 1 0\r", 3),
        ("\u{feff}2\n\na.jpg 1 0 0\n\n\nb.jpg 0 1 0\n\n", 6),
        ("\r\n  2 \r\n\t\r\na.jpg 1 0 0\r\nb.jpg 0 1 0", 5),
    ] {
        let file = parse(text).unwrap();
        assert_eq!(entries(&file), expected, "{text:?}");
        assert_eq!(file.entries[1].line, last, "{text:?}");
        assert_eq!((file.declared, file.notes.len()), (Some(2), 0), "{text:?}");
    }
}

#[test]
fn oddities_are_noted() {
    for (text, words) in [
        ("3\na 0 0 1\nb 1 0 0\n", ["3 pictures", "2 lines"]),
        ("1\na 0 0 1\nb 1 0 0\n", ["1 pictures", "2 lines"]),
        ("a 0 0 1\nb 1 0 0\n", ["no number of pictures", "2 lines"]),
        ("2\na 0 0 1\nb 3 0 4\n", ["1 of 2", "line 3: 5.0000"]),
    ] {
        let file = parse(text).unwrap();
        assert_eq!(file.notes.len(), 1, "{:?}", file.notes);
        for word in words {
            assert!(file.notes[0].contains(word), "'{word}' is missing in: {}", file.notes[0]);
        }
    }
    let file = parse("1\na 3 0 4\n").unwrap();
    assert_eq!(file.entries[0].vector, [3.0, 0.0, 4.0]);
    assert_eq!(file.entries[0].direction.components(), [0.6, 0.0, 0.8]);
    // Within 1 %: the digits of the file, not worth a word.
    assert!(parse("1\na 0.6 0 0.807\n").unwrap().notes.is_empty());
    let file = parse(b"1\ncaf\xe9.jpg 0 0 1\n").unwrap();
    assert_eq!(file.entries[0].name, "café.jpg");
    assert!(file.notes[0].contains("Latin-1"));
}

#[test]
fn what_is_wrong_is_named_with_line_value_and_remedy() {
    for (text, words) in [
        ("2\na 0 0 1\nb.jpg 0 nan 1\n", ["line 3", "'b.jpg'", "NaN", "finite"]),
        ("1\nb.jpg inf 0 1\n", ["line 2", "'b.jpg'", "inf", "finite"]),
        ("1\nb.jpg 0 0,0 0.0\n", ["line 2", "'b.jpg'", "(0, 0, 0)", "length above 0"]),
        ("1\nb.jpg 0.1 0.2\n", ["line 2", "'b.jpg 0.1 0.2'", "2 numbers where 3", "name x y z"]),
        ("1\nb.jpg 0.1 0.2 up\n", ["line 2", "0 numbers where 3", "name x y z", "up"]),
        ("1\n0.1 0.2 0.9\n", ["line 2", "no picture name", "name x y z", "0.1 0.2 0.9"]),
        ("1\nb,0,577,0,577,0,577\n", ["line 2", "commas", "decimal points", "name x y z"]),
        ("1\nb 0,577,0,577,0,577\n", ["line 2", "commas", "decimal points", "name x y z"]),
        ("lights\na 0 0 1\n", ["line 1", "'lights'", "0 numbers", "name x y z"]),
        ("0\n", ["no light", "1..4096", "name x y z", "lights.lp"]),
        ("", ["no light", "1..4096", "name x y z", "lights.lp"]),
    ] {
        let error = parse(text).expect_err(text);
        assert!(matches!(error, FormatError::Invalid { .. }));
        for word in words {
            assert!(error.to_string().contains(word), "'{word}' is missing in: {error}");
        }
    }
    let utf16: Vec<u8> = "1\na 0 0 1\n".encode_utf16().flat_map(u16::to_le_bytes).collect();
    let marked = [&[0xff, 0xfe][..], &utf16].concat();
    for bytes in [utf16, marked] {
        let error = parse(bytes).unwrap_err();
        assert!(matches!(error, FormatError::Unsupported { .. }));
        assert!(error.to_string().contains("UTF-16") && error.to_string().contains("save it as UTF-8"));
    }
}

#[test]
fn size_is_bounded() {
    let lines = |count: usize| format!("{count}\n{}", "a.jpg 0 0 1\n".repeat(count));
    assert_eq!(parse(lines(4096)).unwrap().entries.len(), 4096);
    let error = parse(lines(4097)).unwrap_err().to_string();
    assert!(error.contains("line 4098") && error.contains("1..4096"), "{error}");
    assert!(matches!(parse(vec![b' '; (8 << 20) + 1]).unwrap_err(), FormatError::Invalid { .. }));
}

#[test]
fn mangled_bytes_give_an_error_or_a_result() {
    let valid =
        "3\r\n\"a b.jpg\" 0,1 0,2 0,9\r\nC:\\x\\é.jpg 0.5 -0.5 0.7\r\nc, 0.1, 0.2, 0.9\r\n".as_bytes();
    let mut state = 1u64;
    let mut below = |bound: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % bound
    };
    for _ in 0..5000 {
        let mut bytes = valid[..below(valid.len()) + 1].to_vec();
        for _ in 0..below(5) {
            let at = below(bytes.len());
            bytes[at] = b"0123456789,.;- \t\r\n\"'\\/ane\xff\xc3\x00"[below(28)];
        }
        if let Ok(file) = parse(&bytes) {
            assert!(
                file.entries.iter().all(|e| !e.name.is_empty() && e.vector.iter().all(|c| c.is_finite()))
            );
        }
    }
}

/// A folder of empty files and a light file whose lines bear `names`.
fn capture(files: &[&str], names: &[&str]) -> (tempfile::TempDir, LightFile) {
    let folder = tempfile::tempdir().unwrap();
    for file in files {
        let path = folder.path().join(file);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, "").unwrap();
    }
    let lines: String = names.iter().enumerate().map(|(i, name)| format!("{name} {i} 0 1\n")).collect();
    let path = folder.path().join("lights.lp");
    fs::write(&path, format!("{}\n{lines}", names.len())).unwrap();
    let mut file = relight_formats::light_file::read_light_file(&path).unwrap();
    file.notes.clear();
    (folder, file)
}

/// The pictures found, relative to the folder, and the notes.
fn matched(files: &[&str], names: &[&str]) -> Result<(Vec<String>, Vec<String>), String> {
    let (folder, file) = capture(files, names);
    let capture = match_pictures(&file).map_err(|error| error.to_string())?;
    assert_eq!(capture.lights.len(), names.len());
    for (i, light) in capture.lights.lights.iter().enumerate() {
        assert_eq!((light.name.as_str(), capture.vectors[i][0]), (names[i], i as f64));
    }
    let relative =
        |path: &std::path::PathBuf| path.strip_prefix(folder.path()).unwrap().to_str().unwrap().to_owned();
    Ok((capture.pictures.iter().map(relative).collect(), capture.notes))
}

#[test]
fn names_decide_never_the_order_of_lines() {
    let (pictures, notes) = matched(&["a.jpg", "b.jpg", "c.jpg"], &["c.jpg", "a.jpg", "b.jpg"]).unwrap();
    assert_eq!(pictures, ["c.jpg", "a.jpg", "b.jpg"]);
    assert!(notes.is_empty());
    let names = [r"H:\RTI\out\B 1.JPG", "/home/x/a.JPEG", "c.jpg"];
    let (pictures, notes) = matched(&["a.jpeg", "b 1.jpg", "c.jpg", "unused.jpg"], &names).unwrap();
    assert_eq!(pictures, ["b 1.jpg", "a.jpeg", "c.jpg"]);
    assert!(notes.is_empty(), "{notes:?}");
    // An exact name goes before one in another case.
    let (pictures, _) = matched(&["A.jpg", "a.jpg"], &["a.jpg", "A.jpg"]).unwrap();
    assert_eq!(pictures, ["a.jpg", "A.jpg"]);
}

#[test]
fn another_extension_is_accepted_and_noted() {
    let (pictures, notes) = matched(&["a.png", "b.jpg", "a.txt"], &["b.jpg", "A.tif"]).unwrap();
    assert_eq!(pictures, ["b.jpg", "a.png"]);
    assert_eq!(notes.len(), 1);
    assert!(notes[0].contains("1 pictures") && notes[0].contains("'A.tif' is 'a.png'"), "{}", notes[0]);
    let error = matched(&["a.png", "a.exr"], &["a.tif"]).unwrap_err();
    assert!(error.contains("a.exr, a.png") && error.contains("line 2"), "{error}");
}

#[test]
fn relative_paths_count_as_written() {
    let (pictures, _) = matched(&["left/a.jpg", "right/a.jpg"], &["right/a.jpg", r"left\a.jpg"]).unwrap();
    assert_eq!(pictures, ["right/a.jpg", "left/a.jpg"]);
}

#[test]
fn order_serves_only_when_no_name_matches_and_counts_agree() {
    let files = ["p10.jpg", "p9.jpg", "p1.png", "notes.txt", ".hidden.jpg"];
    let (pictures, notes) = matched(&files, &["x", "y", "z"]).unwrap();
    assert_eq!(pictures, ["p1.png", "p9.jpg", "p10.jpg"]);
    assert!(
        notes[0].contains("none of the 3 names") && notes[0].contains("'p1.png' is line 2"),
        "{}",
        notes[0]
    );
    // One name matches: the others are missing, whatever the counts.
    let error = matched(&files, &["p9.jpg", "y", "z"]).unwrap_err();
    assert!(error.contains("2 of 3 pictures") && error.contains("line 3: 'y'"), "{error}");
    let error = matched(&files, &["x", "y"]).unwrap_err();
    assert!(error.contains("2 of 2 pictures") && error.contains("holds 3 pictures"), "{error}");
}

#[test]
fn missing_names_are_listed_with_similar_ones() {
    let names = ["img_01.jpg", "imgg_02.jpg", "q1", "q2", "q3", "q4", "q5"];
    let error = matched(&["img_01.jpg", "img_02.jpg"], &names).unwrap_err();
    assert!(error.contains("line 3: 'imgg_02.jpg' (similar: 'img_02.jpg')"), "{error}");
    assert!(error.contains("line 4: 'q1'") && !error.contains("'q1' (similar"), "{error}");
    assert!(error.contains("and 1 more") && !error.contains("'q5'"), "{error}");
}

#[test]
fn two_lines_of_one_picture_are_refused() {
    let error = matched(&["a.jpg", "b.jpg"], &["a.jpg", "b.jpg", "x/A.JPG"]).unwrap_err();
    assert!(error.contains("lines 2 and 4") && error.contains("'a.jpg'"), "{error}");
}

#[test]
fn unmatched_names_both_sides() {
    let (folder, file) = capture(&["a.jpg", "extra.png", "b.tif", "x.txt"], &["b.jpg", "gone.jpg", "A.jpg"]);
    let unmatched = unmatched(&file).unwrap();
    assert_eq!(unmatched.pictures, [folder.path().join("extra.png")]);
    assert_eq!(unmatched.entries.len(), 1);
    assert_eq!((unmatched.entries[0].name.as_str(), unmatched.entries[0].line), ("gone.jpg", 3));
}

#[test]
fn the_light_file_of_a_folder_must_be_the_only_one() {
    let folder = tempfile::tempdir().unwrap();
    let find = |name: &str| light_file_in(&folder.path().join(name)).map_err(|error| error.to_string());
    assert!(find("").unwrap_err().contains("holds no .lp file"));
    fs::write(folder.path().join("Dome.LP"), "").unwrap();
    fs::write(folder.path().join("._Dome.LP"), "").unwrap();
    fs::write(folder.path().join("a.jpg"), "").unwrap();
    assert_eq!(find("").unwrap(), folder.path().join("Dome.LP"));
    assert_eq!(find("Dome.LP").unwrap(), folder.path().join("Dome.LP"));
    assert!(find("a.jpg").unwrap_err().contains("neither a folder nor an .lp file"));
    fs::write(folder.path().join("b.lp"), "").unwrap();
    let error = find("").unwrap_err();
    assert!(error.contains("2 .lp files (Dome.LP, b.lp)"), "{error}");
    assert!(matches!(light_file_in(&folder.path().join("gone")).unwrap_err(), FormatError::Io { .. }));
}

#[test]
fn real_captures_match() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    let data = if data.is_dir() { data } else { Path::new("/work/shared/data").to_owned() };
    for (set, lights) in [("icon72", 72), ("lion64", 240), ("buddha12", 12), ("relief256", 50)] {
        let folder = data.join(set);
        if !folder.is_dir() {
            println!("skipped: {} is absent", folder.display());
            continue;
        }
        let file = relight_formats::light_file::read_light_file(&light_file_in(&folder).unwrap()).unwrap();
        let capture = match_pictures(&file).unwrap();
        assert_eq!(capture.lights.len(), lights, "{set}");
        assert!(capture.notes.is_empty(), "{set}: {:?}", capture.notes);
    }
}
