//! The text for one small asset in each language, to the byte.
//!
//! RELIGHT_UPDATE_GOLDEN=1 writes the files anew: look at what changed before it is committed.

use crate::lopsided::{bases, layers_of, learned, model};
use relight_core::{Layout, Model};
use relight_shader::{Language, ShaderOptions, shader};
use relight_texture::{ArrayPlan, BlockFormat, Packing, TexelFormat, Wrap};
use std::path::Path;

#[test]
fn text_is_what_it_was() {
    let basis = bases(&[4]).into_iter().find(|basis| basis.family().name == "srbf").unwrap();
    let model = model(&basis, Layout::Lrgb);
    let array = |format, planes| ArrayPlan { format: TexelFormat::Block(format), layers: layers_of(planes) };
    let arrays = vec![
        array(BlockFormat::Bc5, vec![vec![0, 1], vec![2, 3]]),
        array(BlockFormat::Bc7, vec![vec![4, 5, 6]]),
    ];
    check("srbf4_lrgb", &model, &Packing { arrays, levels: 5, wrap: Wrap::Repeat });

    let model = crate::lopsided::model(&learned(5, 3, false), Layout::Shared);
    let arrays =
        vec![array(BlockFormat::Bc7, vec![vec![0, 1, 2]]), array(BlockFormat::Bc5, vec![vec![3, 4]])];
    check("pca5_shared", &model, &Packing { arrays, levels: 1, wrap: Wrap::Clamp });
}

fn check(asset: &str, model: &Model, packing: &Packing) {
    for language in Language::all() {
        for maps_per_pass in [None, Some(1)] {
            let text = shader(model, packing, 20, 12, &ShaderOptions { language, maps_per_pass });
            let suffix = if maps_per_pass.is_some() { "_passes" } else { "" };
            check_text(&format!("{asset}{suffix}.{}", language.name()), &text);
        }
    }
}

/// Holds a text to that of a file.
pub(crate) fn check_text(name: &str, text: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name);
    if std::env::var("RELIGHT_UPDATE_GOLDEN").is_ok_and(|value| value == "1") {
        std::fs::write(&path, text).unwrap();
    }
    let golden = std::fs::read_to_string(&path).unwrap();
    for (number, (got, expected)) in (1..).zip(text.lines().zip(golden.lines())) {
        assert_eq!(got, expected, "{} line {number}", path.display());
    }
    assert_eq!(text, golden, "{}", path.display());
}
