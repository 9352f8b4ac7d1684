//! Whole figures.

use super::*;

fn point(x: f64, y: f64) -> Point {
    Point { x, y, error: f64::NAN }
}

fn curve(name: &str, points: &[(f64, f64)]) -> Curve {
    Curve { name: name.to_owned(), points: points.iter().map(|(x, y)| point(*x, *y)).collect() }
}

fn figure(curves: Vec<Curve>) -> Figure {
    let axis = |label: &str| Axis { label: label.to_owned(), log: false };
    Figure { title: "a < b".to_owned(), x: axis("step"), y: axis("loss"), curves, size: [400.0, 300.0] }
}

/// The values of an attribute of all elements with a class.
fn attributes(text: &str, class: &str, name: &str) -> Vec<String> {
    let of_class = text.lines().filter(|l| l.contains(&format!("class=\"{class}\"")));
    let value = |l: &str| Some(l.split(&format!(" {name}=\"")).nth(1)?.split('"').next()?.to_owned());
    of_class.filter_map(value).collect()
}

fn pairs(points: &str) -> Vec<[f64; 2]> {
    let number = |text: &str| text.parse::<f64>().unwrap();
    points.split(' ').map(|p| p.split_once(',').unwrap()).map(|(x, y)| [number(x), number(y)]).collect()
}

#[test]
fn curves_are_where_their_numbers_are() {
    let text = svg(&figure(vec![curve("a", &[(0.0, 0.0), (1.0, 10.0), (2.0, 5.0)])]));
    let curves = attributes(&text, "curve", "points");
    assert_eq!(curves.len(), 1);
    let [a, b, c] = pairs(&curves[0])[..] else { panic!("{curves:?}") };
    // Evenly apart to the right; the last is half as high as the second.
    assert!(((b[0] - a[0]) - (c[0] - b[0])).abs() < 0.02 && b[0] > a[0], "{curves:?}");
    assert!(((a[1] - c[1]) * 2.0 - (a[1] - b[1])).abs() < 0.03 && b[1] < a[1], "{curves:?}");
    // The horizontal grid line of 10 goes through the second point.
    let grid: Vec<f64> = attributes(&text, "grid", "points").iter().map(|p| pairs(p)[0][1]).collect();
    assert!(grid.iter().any(|y| (y - b[1]).abs() < 0.02), "{grid:?} {b:?}");
    assert!(text.contains(">10</text>") && text.contains("a &lt; b") && !text.contains("a < b"), "{text}");
    assert_eq!(attributes(&text, "point", "cx").len(), 3);
}

#[test]
fn gaps_divide_curves_and_lone_points_are_dots() {
    let gap = f64::NAN;
    let text = svg(&figure(vec![curve(
        "a",
        &[(0.0, 1.0), (1.0, 2.0), (2.0, gap), (3.0, 1.0), (4.0, f64::INFINITY), (5.0, 0.0), (6.0, 1.0)],
    )]));
    assert_eq!(attributes(&text, "curve", "points").len(), 2);
    assert_eq!(attributes(&text, "point", "cx").len(), 5);
    assert!(!text.contains("NaN") && !text.contains("inf"), "{text}");
    let mut logarithmic = figure(vec![curve("a", &[(0.0, 1.0), (1.0, 0.0), (2.0, -1.0), (3.0, 1e-3), (4.0, 1e-2)])]);
    logarithmic.y.log = true;
    let text = svg(&logarithmic);
    assert_eq!(attributes(&text, "curve", "points").len(), 1);
    assert_eq!(attributes(&text, "point", "cx").len(), 3);
    assert!(text.contains(">10⁻³</text>"), "{text}");
    // Nothing at all is an empty frame.
    assert!(svg(&figure(vec![curve("a", &[])])).contains("class=\"axis\""));
}

#[test]
fn bands_reach_as_far_as_their_errors() {
    let points = [(0.0, 1.0, 0.5), (1.0, 2.0, 0.25), (2.0, 3.0, f64::NAN)];
    let points = points.map(|(x, y, error)| Point { x, y, error }).to_vec();
    let text = svg(&figure(vec![Curve { name: "a".to_owned(), points }]));
    let bands = attributes(&text, "band", "points");
    let curve = pairs(&attributes(&text, "curve", "points")[0]);
    assert_eq!(bands.len(), 1);
    let [up0, up1, down1, down0] = pairs(&bands[0])[..] else { panic!("{bands:?}") };
    // A band beyond all numbers goes on to the end of the axis.
    let far = Point { x: 0.0, y: 1e308, error: 1e308 };
    let text = svg(&figure(vec![Curve { name: "a".to_owned(), points: vec![far, Point { x: 1.0, ..far }] }]));
    let wide = pairs(&attributes(&text, "band", "points")[0]);
    assert!(
        wide[0][1] < 60.0 && wide[0][1] == wide[1][1] && !text.contains("inf") && !text.contains("NaN"),
        "{wide:?}"
    );
    let unit = curve[0][1] - curve[1][1];
    for (found, at, by) in [(up0, 0, 0.5), (up1, 1, 0.25), (down1, 1, -0.25), (down0, 0, -0.5)] {
        assert!(
            (found[1] - (curve[at][1] - by * unit)).abs() < 0.05 && found[0] == curve[at][0],
            "{bands:?} {curve:?}"
        );
    }
}

#[test]
fn several_curves_have_a_legend_and_their_own_look() {
    let curves: Vec<Curve> = (0..9).map(|i| curve(&format!("curve {i}"), &[(0.0, f64::from(i)), (1.0, 1.0)])).collect();
    let text = svg(&figure(curves));
    assert_eq!(attributes(&text, "key", "points").len(), 9);
    let looks = |class: &str| {
        let lines = text.lines().filter(|l| l.contains(&format!("class=\"{class}\"")));
        lines.map(|l| (l.split("stroke=").nth(1).unwrap()[..9].to_owned(), l.contains("dasharray"))).collect::<Vec<_>>()
    };
    let mut own = looks("curve");
    assert_eq!(own, looks("key"));
    own.sort();
    own.dedup();
    assert_eq!(own.len(), 9, "{own:?}");
    // The legend does not run out of the picture.
    let ends = attributes(&text, "key", "points").iter().map(|p| pairs(p)[1][0]).fold(0.0, f64::max);
    assert!(ends < 400.0);
}

#[test]
fn very_long_curves_keep_their_extremes() {
    let mut points: Vec<(f64, f64)> = (0..100_000).map(|i| (f64::from(i), f64::from(i % 7))).collect();
    points[77_777].1 = 100.0;
    let text = svg(&figure(vec![curve("a", &points)]));
    assert!(text.len() < 200_000, "{}", text.len());
    let drawn = pairs(&attributes(&text, "curve", "points")[0]);
    let top = drawn.iter().map(|p| p[1]).fold(f64::INFINITY, f64::min);
    assert!(drawn.iter().filter(|p| p[1] == top).count() == 1 && drawn.len() <= 4000);
}

#[test]
fn pictures_show_what_the_svg_says() {
    let drawn = figure(vec![curve("a", &[(0.0, 1.0), (1.0, 1.0)]), curve("b", &[(0.0, 0.0), (1.0, 2.0)])]);
    let bytes = png(&drawn).unwrap();
    let mut reader = ::png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    assert_eq!((info.width, info.height), (800, 600));
    let at = |x: f64, y: f64| {
        let start = ((2.0 * y) as usize * 800 + (2.0 * x) as usize) * 3;
        [pixels[start], pixels[start + 1], pixels[start + 2]]
    };
    let text = svg(&drawn);
    let level = pairs(&attributes(&text, "curve", "points")[0]);
    assert_eq!(at(0.8 * level[0][0] + 0.2 * level[1][0], level[0][1]), [0x00, 0x72, 0xb2]);
    assert_eq!(at(1.0, 1.0), [255; 3]);
    // Some ink of the words is as dark as it gets.
    assert!(pixels.chunks_exact(3).filter(|p| **p == INK).count() > 100);
}
