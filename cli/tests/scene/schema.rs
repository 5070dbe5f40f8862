//! Documents held to the schemas in docs/schema, by the keywords that those use.

use serde_json::Value;
use std::path::Path;

/// Fails where `document` is not what `docs/schema/NAME.schema.json` says.
pub(crate) fn check(name: &str, document: &Value) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../docs/schema/{name}.schema.json"));
    let schema: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    held_to(&schema, document, "the document");
}

/// Keywords that say something to people alone.
const WORDS: [&str; 3] = ["$schema", "title", "description"];

fn held_to(schema: &Value, value: &Value, at: &str) {
    for (keyword, rule) in schema.as_object().unwrap() {
        match keyword.as_str() {
            "type" => {
                let kinds = rule.as_array().map_or(vec![rule.clone()], Clone::clone);
                assert!(
                    kinds.iter().any(|kind| is_of(kind.as_str().unwrap(), value)),
                    "{at} is no {rule}: {value}"
                );
            }
            "const" => assert_eq!(rule, value, "{at}"),
            "enum" => assert!(rule.as_array().unwrap().contains(value), "{at} is {value}, not one of {rule}"),
            "minimum" => {
                let number = value.as_f64();
                assert!(number.is_none_or(|number| number >= rule.as_f64().unwrap()), "{at} is {value}");
            }
            // What concerns objects says nothing of null.
            "required" | "additionalProperties" if value.is_null() => {}
            "required" => {
                let has = |key: &Value| value.get(key.as_str().unwrap()).is_some();
                rule.as_array().unwrap().iter().for_each(|key| assert!(has(key), "{at} has no {key}"));
            }
            "properties" => {
                for (key, rule) in rule.as_object().unwrap() {
                    if let Some(value) = value.get(key) {
                        held_to(rule, value, &format!("{at}.{key}"));
                    }
                }
            }
            "additionalProperties" => {
                let known = |key: &String| schema["properties"].get(key).is_some();
                for (key, value) in value.as_object().unwrap().iter().filter(|(key, _)| !known(key)) {
                    assert_ne!(rule, &Value::Bool(false), "{at} has {key}, which its schema doesn't know");
                    held_to(rule, value, &format!("{at}.{key}"));
                }
            }
            "items" => {
                for (index, value) in value.as_array().unwrap().iter().enumerate() {
                    held_to(rule, value, &format!("{at}[{index}]"));
                }
            }
            word => assert!(WORDS.contains(&word), "schemas use {word}, which this test doesn't check"),
        }
    }
}

fn is_of(kind: &str, value: &Value) -> bool {
    match kind {
        "object" => value.is_object(),
        "array" => value.is_array(),
        "string" => value.is_string(),
        "boolean" => value.is_boolean(),
        "null" => value.is_null(),
        "integer" => value.is_i64() || value.is_u64(),
        "number" => value.is_number(),
        other => panic!("no such type: {other}"),
    }
}
