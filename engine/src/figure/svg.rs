//! Marks as the text of an SVG file.

use std::fmt::Write;

use super::{Anchor, Colour, INK, Mark, Role, Words};

pub(super) fn write([width, height]: [f64; 2], title: &str, marks: &[Mark]) -> String {
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" \
         font-family=\"sans-serif\" fill=\"{}\" role=\"img\">\n",
        hex(INK)
    );
    if !title.is_empty() {
        let _ = writeln!(out, "<title>{}</title>", escaped(title));
    }
    let _ = writeln!(out, "<rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>");
    marks.iter().for_each(|mark| out.push_str(&element(mark)));
    out.push_str("</svg>\n");
    out
}

fn element(mark: &Mark) -> String {
    match mark {
        Mark::Line { role, points, colour, width, dashed } => {
            let class = match role {
                Role::Grid => "grid",
                Role::Tick => "tick",
                Role::Axis => "axis",
                Role::Curve => "curve",
                Role::Key => "key",
            };
            let dashes = if *dashed { " stroke-dasharray=\"6 4\"" } else { "" };
            let (points, colour) = (listed(points), hex(*colour));
            format!(
                "<polyline class=\"{class}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\" \
                 stroke-linejoin=\"round\" stroke-linecap=\"round\"{dashes} points=\"{points}\"/>\n"
            )
        }
        Mark::Area { points, colour, opacity } => {
            let (points, colour) = (listed(points), hex(*colour));
            format!("<polygon class=\"band\" fill=\"{colour}\" fill-opacity=\"{opacity}\" points=\"{points}\"/>\n")
        }
        Mark::Dot { at: [x, y], radius, colour } => {
            format!("<circle class=\"point\" cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"{radius}\" fill=\"{}\"/>\n", hex(*colour))
        }
        Mark::Words(Words { text, at: [x, y], anchor, upright, size }) => {
            let anchor = match anchor {
                Anchor::Start => "start",
                Anchor::Middle => "middle",
                Anchor::End => "end",
            };
            let turn = if *upright { format!(" transform=\"rotate(-90 {x:.2} {y:.2})\"") } else { String::new() };
            let text = escaped(text);
            format!(
                "<text x=\"{x:.2}\" y=\"{y:.2}\" font-size=\"{size}\" text-anchor=\"{anchor}\"{turn}>{text}</text>\n"
            )
        }
    }
}

fn listed(points: &[[f64; 2]]) -> String {
    points.iter().map(|[x, y]| format!("{x:.2},{y:.2}")).collect::<Vec<String>>().join(" ")
}

fn hex([r, g, b]: Colour) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// Without what XML gives a meaning, and without what it has no place for.
fn escaped(text: &str) -> String {
    let allowed = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect::<String>();
    allowed.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
