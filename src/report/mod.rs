//! Web pages about runs: what one has done, and how several differ. Each is one file that needs no network: data as JSON, drawn by the
//! scripts beside this file.

mod comparison;
mod data;
mod run;
mod table;

use serde_json::Value;

pub(crate) use comparison::{Comparison, comparison};
pub(crate) use run::LONGEST_SCRIPT;
pub use run::report;
pub(crate) use table::text_table;

/// A page: the data in JSON, and the scripts that draw them.
fn page(title: &str, data: &Value, scripts: &[&str]) -> String {
    let scripts: String = scripts.iter().map(|text| format!("<script>\n{text}</script>\n")).collect();
    let parts = [
        ("{{title}}", escaped(title)),
        ("{{style}}", include_str!("page.css").to_owned()),
        ("{{data}}", embedded(data)),
        ("{{scripts}}", scripts),
    ];
    let mut rest = include_str!("page.html");
    let mut out = String::with_capacity(rest.len() + parts.iter().map(|(_, text)| text.len()).sum::<usize>());
    // What is put in may have the names of places in it.
    for (place, text) in parts {
        let (before, after) = rest.split_once(place).unwrap_or((rest, ""));
        out.push_str(before);
        out.push_str(&text);
        rest = after;
    }
    out.push_str(rest);
    out
}

const CHARTS: &str = include_str!("charts.js");
const PICTURES: &str = include_str!("pictures.js");

/// JSON within a script element: without `<`, no text can end the element or begin a comment.
fn embedded(data: &Value) -> String {
    data.to_string().replace('<', "\\u003c")
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_in_the_data_ends_its_element() {
        let text = "</script><!-- <script> {{scripts}} & \u{2028} \"";
        let page = page(text, &serde_json::json!({ "text": text }), &["let a\n"]);
        assert_eq!(page.matches("</script>").count(), 2, "{page}");
        assert_eq!(page.matches("<!--").count(), 0);
        assert!(page.contains("<title>&lt;/script&gt;"));
        let (_, rest) = page.split_once("type=\"application/json\">").unwrap();
        let (json, _) = rest.split_once("</script>").unwrap();
        assert_eq!(serde_json::from_str::<Value>(json).unwrap()["text"], text);
    }
}
