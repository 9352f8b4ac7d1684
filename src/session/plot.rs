//! Plots of curves: as a line of characters for terminals, and as SVG files.

/// A sparkline: one character per column with eight heights; values that are not finite are blank.
pub fn sparkline(values: &[f64], columns: usize) -> String {
    const BARS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
    let columns = columns.min(values.len());
    let cells: Vec<f64> = (0..columns)
        .map(|c| {
            let range =
                c * values.len() / columns..((c + 1) * values.len() / columns).max(c * values.len() / columns + 1);
            let cell = &values[range];
            cell.iter().sum::<f64>() / cell.len() as f64
        })
        .collect();
    let Some((min, max)) = bounds(&cells) else {
        return String::new();
    };
    let bar = |x: &f64| {
        if !x.is_finite() {
            return ' ';
        }
        let height = if max > min { (x - min) / (max - min) } else { 0.5 };
        BARS[((height * 7.0).round() as usize).min(7)]
    };
    cells.iter().map(bar).collect()
}

/// An SVG of named curves over their index, in one frame labelled with the extremes.
pub fn svg(series: &[(String, Vec<f64>)]) -> String {
    const COLORS: [&str; 6] = ["#1f77b4", "#d62728", "#2ca02c", "#ff7f0e", "#9467bd", "#17becf"];
    let (width, height, margin) = (640.0, 360.0, 56.0);
    let all: Vec<f64> = series.iter().flat_map(|(_, v)| v.iter().copied()).collect();
    let (min, max) = bounds(&all).unwrap_or((0.0, 1.0));
    let span = if max > min { max - min } else { 1.0 };
    let longest = series.iter().map(|(_, v)| v.len()).max().unwrap_or(0).max(2);
    let x = |i: usize| margin + (width - 2.0 * margin) * i as f64 / (longest - 1) as f64;
    let y = |v: f64| height - margin - (height - 2.0 * margin) * (v - min) / span;
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" font-size=\"12\">\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n\
         <rect x=\"{margin}\" y=\"{margin}\" width=\"{}\" height=\"{}\" fill=\"none\" stroke=\"#ccc\"/>\n\
         <text x=\"{}\" y=\"{}\" text-anchor=\"end\">{}</text>\n<text x=\"{}\" y=\"{}\" text-anchor=\"end\">{}</text>\n",
        width - 2.0 * margin,
        height - 2.0 * margin,
        margin - 4.0,
        margin + 4.0,
        super::show::significant(max, 3),
        margin - 4.0,
        height - margin + 4.0,
        super::show::significant(min, 3),
    );
    for (k, (name, values)) in series.iter().enumerate() {
        let color = COLORS[k % COLORS.len()];
        let points: Vec<String> = values
            .iter()
            .enumerate()
            .filter(|(_, v)| v.is_finite())
            .map(|(i, v)| format!("{:.2},{:.2}", x(i), y(*v)))
            .collect();
        out.push_str(&format!("<polyline fill=\"none\" stroke=\"{color}\" points=\"{}\"/>\n", points.join(" ")));
        let (tx, ty) = (margin + 8.0, margin + 16.0 * (k as f64 + 1.0));
        out.push_str(&format!("<text x=\"{tx}\" y=\"{ty}\" fill=\"{color}\">{}</text>\n", escaped(name)));
    }
    out.push_str("</svg>\n");
    out
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

fn bounds(values: &[f64]) -> Option<(f64, f64)> {
    let finite = values.iter().copied().filter(|x| x.is_finite());
    finite.fold(None, |found, x| match found {
        None => Some((x, x)),
        Some((lo, hi)) => Some((f64::min(lo, x), f64::max(hi, x))),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_rise_and_gaps_stay_blank() {
        assert_eq!(sparkline(&[0.0, 1.0, 2.0, f64::NAN], 10), "▁▅█ ");
        assert_eq!(sparkline(&[], 10), "");
        assert_eq!(sparkline(&[3.0; 4], 2).chars().count(), 2);
        assert_eq!(sparkline(&[0.0, 0.0, 7.0, 7.0], 2), "▁█");
    }

    #[test]
    fn svg_escapes_names_and_survives_empty_series() {
        let text = svg(&[("a < b".into(), vec![1.0, 2.0, f64::INFINITY]), ("none".into(), vec![])]);
        assert!(text.contains("a &lt; b") && text.contains("</svg>") && !text.contains("inf"), "{text}");
    }
}
