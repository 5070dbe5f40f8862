//! The walls between crates: which may depend on which stands in docs/architecture.md alone.

use std::collections::BTreeMap;
use std::path::Path;

/// Rows `| crate | folder | of ours | from outside |` of the table headed "Walls".
fn table(text: &str) -> BTreeMap<String, (String, Vec<String>)> {
    let section = text.split("## Walls").nth(1).expect("a section 'Walls'");
    let section = section.split("\n## ").next().unwrap_or(section);
    let mut rows = BTreeMap::new();
    for line in section.lines().filter(|line| line.starts_with("| `")) {
        let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
        let names = |cell: &str| cell.split('`').skip(1).step_by(2).map(str::to_owned).collect::<Vec<_>>();
        let allowed = names(cells[2]).into_iter().chain(names(cells[3])).collect();
        rows.insert(names(cells[0])[0].clone(), (names(cells[1])[0].clone(), allowed));
    }
    rows
}

#[test]
fn every_dependency_is_in_the_table_and_every_crate_is_a_row() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let read = |path: &str| std::fs::read_to_string(root.join(path)).unwrap();
    let rows = table(&read("docs/architecture.md"));
    let workspace: toml::Table = read("Cargo.toml").parse().unwrap();
    let members = workspace["workspace"]["members"].as_array().unwrap();
    assert_eq!(members.len(), rows.len(), "a row for each crate and a crate for each row");
    for (name, (folder, allowed)) in rows {
        assert!(members.iter().any(|member| member.as_str() == Some(&folder)), "{folder} is no member");
        let manifest: toml::Table = read(&format!("{folder}/Cargo.toml")).parse().unwrap();
        assert_eq!(manifest["package"]["name"].as_str(), Some(name.as_str()));
        let dependencies = manifest["dependencies"].as_table().unwrap();
        for dependency in dependencies.keys() {
            assert!(
                allowed.contains(dependency),
                "{name} depends on {dependency}: docs/architecture.md, \"Walls\", does not list it"
            );
        }
        for allowed in &allowed {
            assert!(
                dependencies.contains_key(allowed),
                "{name} no longer depends on {allowed}: mend the table"
            );
        }
    }
}

#[test]
fn only_formats_touches_files_and_only_the_program_prints() {
    let libraries = ["core", "fit", "texture", "shader", "gpu", "surface"]
        .map(|name| format!("crates/relight-{name}/src"));
    for folder in libraries.iter().map(String::as_str).chain(["cli/src"]) {
        assert_eq!(lines_with(folder, &["std::fs", "fs::"]), Vec::<String>::new());
    }
    for folder in libraries.iter().map(String::as_str).chain(["formats/src"]) {
        assert_eq!(lines_with(folder, &["println!", "print!(", "process::exit"]), Vec::<String>::new());
    }
}

/// Lines of code below `folder` that hold one of `words`.
fn lines_with(folder: &str, words: &[&str]) -> Vec<String> {
    let mut found = Vec::new();
    visit(&Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(folder), &mut |path, text| {
        let code = text.lines().enumerate().filter(|(_, line)| !line.trim_start().starts_with("//"));
        for (number, line) in code.filter(|(_, line)| words.iter().any(|word| line.contains(word))) {
            found.push(format!("{}:{}: {}", path.display(), number + 1, line.trim()));
        }
    });
    found
}

fn visit(folder: &Path, look: &mut impl FnMut(&Path, &str)) {
    for entry in std::fs::read_dir(folder).expect("a folder of sources") {
        let path = entry.expect("a name in it").path();
        if path.is_dir() {
            visit(&path, look);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            look(&path, &std::fs::read_to_string(&path).expect("UTF-8 source"));
        }
    }
}
