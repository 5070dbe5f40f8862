//! Text that stands in a page as it is, whatever it holds.

use serde_json::Value;

/// `text` within HTML or SVG, between tags or in an attribute of double quotes.
pub(crate) fn html(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            _ => escaped.push(character),
        }
    }
    escaped
}

/// `value` within a script element: nothing in it can end the element or begin a comment there.
pub(crate) fn json(value: &Value) -> String {
    // All of these stand in strings of JSON only, where their escapes mean the same.
    value.to_string().replace('<', "\\u003c").replace('>', "\\u003e").replace('&', "\\u0026")
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    const NASTY: &str = "a </script><!-- <script> \"b\" 'c' & \\ \u{2028} d\u{0}.jpg";

    #[test]
    fn no_name_ends_a_script_and_every_name_comes_back() {
        let value = json!({ NASTY: [NASTY, 1.5] });
        let text = super::json(&value);
        assert!(!text.contains(['<', '>', '&']), "{text}");
        assert_eq!(serde_json::from_str::<Value>(&text).unwrap(), value);
    }

    #[test]
    fn no_name_ends_an_element_or_an_attribute() {
        let text = html(NASTY);
        assert!(!text.contains(['<', '>', '"', '\'']), "{text}");
        assert!(
            text.starts_with("a &lt;/script&gt;&lt;!-- &lt;script&gt; &quot;b&quot; &#39;c&#39; &amp; \\")
        );
    }
}
