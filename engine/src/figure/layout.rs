//! Where the marks of a figure are.

use super::axis::{Scale, Tick};
use super::letters;
use super::{Anchor, Colour, Curve, Figure, INK, Mark, Point, Role, Words};

/// Colours that can be told apart by colour-blind readers (Okabe & Ito 2008), without the yellow, which is faint on white.
const COLOURS: [Colour; 7] = [
    [0x00, 0x72, 0xb2],
    [0xd5, 0x5e, 0x00],
    [0x00, 0x9e, 0x73],
    [0xcc, 0x79, 0xa7],
    [0xe6, 0x9f, 0x00],
    [0x56, 0xb4, 0xe9],
    [0x00, 0x00, 0x00],
];
const GRID: Colour = [0xe4, 0xe4, 0xe4];

/// Heights of lines of words.
const TEXT: f64 = 13.0;
const TITLE: f64 = 15.0;
/// Between words and what they belong to.
const SPACE: f64 = 8.0;
/// The line before a name in the legend.
const KEY: f64 = 22.0;
/// Curves with so few points have dots.
const FEW: usize = 30;
/// Points of a curve beyond which those are left out that lie within a part of a pixel of others.
const MANY: usize = 4000;

/// The rectangle of the curves, in pixels.
struct Frame {
    left: f64,
    top: f64,
    right: f64,
    bottom: f64,
}

/// A way to draw a curve.
#[derive(Clone, Copy)]
struct Style {
    colour: Colour,
    dashed: bool,
}

impl Style {
    fn of(at: usize) -> Style {
        Style { colour: COLOURS[at % COLOURS.len()], dashed: at / COLOURS.len() % 2 == 1 }
    }
}

pub(super) fn marks(figure: &Figure) -> Vec<Mark> {
    let points = || figure.curves.iter().flat_map(|curve| &curve.points);
    let seen = || points().filter(|p| is_shown(figure, p));
    let x = Scale::new(&figure.x, seen().map(|p| p.x), 0.0);
    // A band has its lower end in sight unless it nears 0 on a logarithmic axis, which would take all room.
    let below = |p: &Point| if figure.y.log { p.y } else { p.y - p.error };
    let y = Scale::new(&figure.y, seen().flat_map(|p| [p.y, p.y + p.error, below(p)]), 0.04);
    let [width, height] = figure.size;
    let rows = y.ticks(((height / 60.0) as usize).max(2));
    let columns = x.ticks(((width / 90.0) as usize).max(2));
    let mut marks = Vec::new();
    let frame = surroundings(figure, &rows, &columns, &mut marks);
    axes(&frame, &rows, &columns, &mut marks);
    for (at, curve) in figure.curves.iter().enumerate() {
        draw(figure, curve, Style::of(at), (&x, &y), &frame, &mut marks);
    }
    marks
}

/// Whether the axes have a place for a point.
fn is_shown(figure: &Figure, p: &Point) -> bool {
    let has_place = |x: f64, log: bool| x.is_finite() && (!log || x > 0.0);
    has_place(p.x, figure.x.log) && has_place(p.y, figure.y.log)
}

/// Title, legend and names of the axes; what they leave is the frame.
fn surroundings(figure: &Figure, rows: &[Tick], columns: &[Tick], marks: &mut Vec<Mark>) -> Frame {
    let [width, height] = figure.size;
    let widest = |ticks: &[Tick]| ticks.iter().map(|t| letters::room(&t.label, TEXT)).fold(0.0, f64::max);
    let named = |label: &str| if label.is_empty() { 0.0 } else { TEXT + SPACE };
    let left = SPACE + named(&figure.y.label) + widest(rows) + SPACE;
    // Half of the last number stands out to the right.
    let right = width - SPACE - widest(columns) / 2.0;
    let bottom = height - SPACE - named(&figure.x.label) - TEXT - SPACE;
    let mut top = SPACE;
    let words = |text: &str, at: [f64; 2], anchor: Anchor, size: f64| {
        Mark::Words(Words { text: text.to_owned(), at, anchor, upright: false, size })
    };
    if !figure.title.is_empty() {
        top += TITLE;
        marks.push(words(&figure.title, [(left + right) / 2.0, top], Anchor::Middle, TITLE));
        top += SPACE;
    }
    if figure.curves.len() > 1 {
        let (mut x, mut line) = (left, top);
        for (at, curve) in figure.curves.iter().enumerate() {
            let own = KEY + SPACE + letters::room(&curve.name, TEXT);
            if x > left && x + own > right {
                (x, line) = (left, line + TEXT + SPACE / 2.0);
            }
            let Style { colour, dashed } = Style::of(at);
            let middle = line + 0.65 * TEXT;
            let points = vec![[x, middle], [x + KEY, middle]];
            marks.push(Mark::Line { role: Role::Key, points, colour, width: 2.0, dashed });
            marks.push(words(&curve.name, [x + KEY + SPACE, line + TEXT], Anchor::Start, TEXT));
            x += own + 2.0 * SPACE;
        }
        top = line + TEXT + SPACE;
    }
    let frame = Frame { left, top: top + SPACE, right, bottom };
    let middle = [(frame.left + frame.right) / 2.0, (frame.top + frame.bottom) / 2.0];
    if !figure.x.label.is_empty() {
        marks.push(words(&figure.x.label, [middle[0], height - SPACE], Anchor::Middle, TEXT));
    }
    if !figure.y.label.is_empty() {
        let (text, at) = (figure.y.label.clone(), [SPACE + 0.8 * TEXT, middle[1]]);
        marks.push(Mark::Words(Words { text, at, anchor: Anchor::Middle, upright: true, size: TEXT }));
    }
    frame
}

/// Grid, ticks with their numbers, and the two axes.
fn axes(frame: &Frame, rows: &[Tick], columns: &[Tick], marks: &mut Vec<Mark>) {
    let Frame { left, top, right, bottom } = *frame;
    let mut line = |role: Role, a: [f64; 2], b: [f64; 2]| {
        let colour = if role == Role::Grid { GRID } else { INK };
        marks.push(Mark::Line { role, points: vec![a, b], colour, width: 1.0, dashed: false });
    };
    let row = |tick: &Tick| bottom + (top - bottom) * tick.at;
    let column = |tick: &Tick| left + (right - left) * tick.at;
    for tick in rows.iter().filter(|t| !t.label.is_empty()) {
        line(Role::Grid, [left, row(tick)], [right, row(tick)]);
    }
    for tick in columns.iter().filter(|t| !t.label.is_empty()) {
        line(Role::Grid, [column(tick), top], [column(tick), bottom]);
    }
    let length = |tick: &Tick| if tick.label.is_empty() { 2.0 } else { 4.0 };
    rows.iter().for_each(|tick| line(Role::Tick, [left - length(tick), row(tick)], [left, row(tick)]));
    columns.iter().for_each(|tick| line(Role::Tick, [column(tick), bottom + length(tick)], [column(tick), bottom]));
    line(Role::Axis, [left, top], [left, bottom]);
    line(Role::Axis, [left, bottom], [right, bottom]);
    let mut number = |tick: &Tick, at: [f64; 2], anchor: Anchor| {
        if !tick.label.is_empty() {
            marks.push(Mark::Words(Words { text: tick.label.clone(), at, anchor, upright: false, size: TEXT }));
        }
    };
    rows.iter().for_each(|tick| number(tick, [left - SPACE, row(tick) + 0.35 * TEXT], Anchor::End));
    columns.iter().for_each(|tick| number(tick, [column(tick), bottom + SPACE + 0.8 * TEXT], Anchor::Middle));
}

/// The band around a curve, the curve, and dots if there are few points. Gaps divide both.
fn draw(figure: &Figure, curve: &Curve, style: Style, (x, y): (&Scale, &Scale), frame: &Frame, marks: &mut Vec<Mark>) {
    let column = |v: f64| x.place(v).map(|at| frame.left + (frame.right - frame.left) * at);
    let row = |v: f64| y.place(v).map(|at| frame.bottom + (frame.top - frame.bottom) * at.clamp(0.0, 1.0));
    let place = |p: &Point| Some([column(p.x)?, row(p.y)?]);
    let points = thinned(&curve.points);
    let Style { colour, dashed } = style;
    for run in points.split(|p| !is_shown(figure, p) || p.error.is_nan()).filter(|run| run.len() > 1) {
        // A band that reaches beyond what the axis has a place for, such as 0 on a logarithmic one, goes on to its end.
        let side = |sign: f64| {
            let end = if sign > 0.0 { frame.top } else { frame.bottom };
            run.iter().filter_map(move |p| Some([column(p.x)?, row(p.y + sign * p.error).unwrap_or(end)]))
        };
        let below: Vec<[f64; 2]> = side(-1.0).collect();
        let outline = side(1.0).chain(below.into_iter().rev()).collect();
        marks.push(Mark::Area { points: outline, colour, opacity: 0.22 });
    }
    for run in points.split(|p| !is_shown(figure, p)).filter(|run| !run.is_empty()) {
        let line: Vec<[f64; 2]> = run.iter().filter_map(place).collect();
        let alone = line.len() == 1;
        if alone || points.len() <= FEW {
            marks.extend(line.iter().map(|at| Mark::Dot { at: *at, radius: 3.0, colour }));
        }
        if !alone {
            marks.push(Mark::Line { role: Role::Curve, points: line, colour, width: 1.8, dashed });
        }
    }
}

/// Of very many points those that are seen: the least and the largest of every few neighbours, in their order, and what makes gaps.
fn thinned(points: &[Point]) -> Vec<Point> {
    if points.len() <= MANY {
        return points.to_vec();
    }
    let mut kept = Vec::new();
    for near in points.chunks(points.len().div_ceil(MANY / 2)) {
        let finite = || near.iter().enumerate().filter(|(_, p)| p.y.is_finite());
        let by = |a: &(usize, &Point), b: &(usize, &Point)| a.1.y.total_cmp(&b.1.y);
        let gap = near.iter().position(|p| !p.y.is_finite());
        let mut chosen: Vec<usize> =
            [finite().min_by(by), finite().max_by(by)].into_iter().flatten().map(|(i, _)| i).chain(gap).collect();
        chosen.sort_unstable();
        chosen.dedup();
        kept.extend(chosen.into_iter().map(|i| near[i]));
    }
    kept
}
