//! Long programs, long arrays and long sessions: what they give is right, and they end. (How long it takes is for `benches/language.rs`.)

use std::sync::Arc;

use dscene::check::types::Ty;
use dscene::check::{self, Checked, Disk, Line, Purpose, check_expression, check_line, hir};
use dscene::diag::Diagnostic;
use dscene::eval::{Engine, EngineOptions};
use dscene::session::{Recorder, Runner};

use crate::dice::Dice;

fn program(text: &str) -> hir::Program {
    let Checked { program, diagnostics, .. } = check::check_text("test.dscene", None, text, &[], &Disk);
    program.unwrap_or_else(|| panic!("{:#?}", diagnostics.iter().find(|d| d.is_error())))
}

/// The numbers of a declaration, or the code of its error.
fn numbers(engine: &mut Engine, name: &str) -> Result<Vec<f64>, String> {
    let id = engine.program().find(name).expect("declared");
    match engine.eval_decl(id) {
        Ok(value) => Ok(value.var().unwrap_or_else(|| panic!("{name} is no number")).value().data.clone()),
        Err(error) => Err(error.code.to_owned()),
    }
}

fn engine(text: &str) -> Engine {
    Engine::new(program(text), EngineOptions::default())
}

fn close(a: &Result<Vec<f64>, String>, b: &Result<Vec<f64>, String>) -> bool {
    let near = |(a, b): (&f64, &f64)| a == b || (a.is_nan() && b.is_nan()) || (a - b).abs() <= 1e-9 * (1.0 + b.abs());
    match (a, b) {
        (Ok(a), Ok(b)) => a.len() == b.len() && a.iter().zip(b).all(near),
        (Err(a), Err(b)) => a == b,
        _ => false,
    }
}

/// An expression of `X` and `Y`, which stand for items, and of the names of `NAMES`.
fn body(dice: &mut Dice, depth: usize) -> String {
    if depth == 0 {
        return ["X", "X", "X", "Y", "a", "b[1]", "0.5", "2", "p.y"][dice.below(9)].to_owned();
    }
    let (l, r) = (body(dice, depth - 1), body(dice, depth - 1));
    match dice.below(18) {
        0 => format!("({l} + {r})"),
        1 => format!("({l} - {r})"),
        2 | 3 => format!("({l} * {r})"),
        4 => format!("({l} / {r})"),
        5 => format!("({l}) ^ 2"),
        6 => format!("abs({l}) ^ 0.5"),
        7 => format!("sin({l} * 40deg)"),
        8 => format!("exp(min({l}, 2))"),
        9 => format!("max({l}, {r})"),
        10 => format!("clamp({l}, -1, {r})"),
        11 => format!("(if {l} > {r} then {l} else {r} * 2)"),
        12 => format!("(if {l} > 0 and not ({r} < 0.4) then sqrt({l}) else -({r}))"),
        13 => format!("(if {l} <= 0 or {r} >= 1 then {r} else log({l}))"),
        14 => format!("f({l})"),
        15 => format!("g({l}, k: {r})"),
        16 => format!("g({l})"),
        _ => format!("-tanh({l})"),
    }
}

const NAMES: &str = "param q = [0.3, -1.2, 0, 2]
param r = [1, 0.25, -0.5, 3]
param a = 0.7
param b = [0.4, 1.5]
param p = [[1, 2], [0.5, -1]]
let w = [1, -2, 0.5, 3]
fn f(t) { let u = t * 2 - a  u * u + t }
fn g(t, k = 3) = if t > k then t - k else k * t
";

#[test]
fn comprehensions_give_what_their_items_give() {
    let mut dice = Dice(0x1357_9bdf);
    let mut sound = 0;
    for round in 0..150 {
        let depth = 1 + round % 3;
        let body = body(&mut dice, depth).replace("p.y", "p[0].y");
        let item = |i: usize| format!("({})", body.replace('X', &format!("q[{i}]")).replace('Y', &format!("r[{i}]")));
        let named = body.replace('X', "x").replace('Y', "y");
        // All of them, and those that a condition lets through.
        for (condition, kept) in [("", vec![0, 1, 2, 3]), (" if x > 0.1", vec![0, 3])] {
            let items: Vec<String> = kept.iter().map(|i| item(*i)).collect();
            let text = format!(
                "{NAMES}let at_once = [{named} for x, y in zip(q, r){condition}]
let one_by_one = [{}]
let weights = w[0..{}]
let slope_once = [grad(dot(weights, at_once), q), grad(dot(weights, at_once), r)]
let slope_each = [grad(dot(weights, one_by_one), q), grad(dot(weights, one_by_one), r)]
let of_a_once = grad(dot(weights, at_once), a)
let of_a_each = grad(dot(weights, one_by_one), a)
let twice_once = grad(sum(grad(dot(weights, at_once), q)), q)
let twice_each = grad(sum(grad(dot(weights, one_by_one), q)), q)
",
                items.join(", "),
                kept.len(),
            );
            let mut engine = engine(&text);
            for (once, each) in [
                ("at_once", "one_by_one"),
                ("slope_once", "slope_each"),
                ("of_a_once", "of_a_each"),
                ("twice_once", "twice_each"),
            ] {
                let (found, wanted) = (numbers(&mut engine, once), numbers(&mut engine, each));
                assert!(close(&found, &wanted), "{once}: {found:?}, {each}: {wanted:?}\n{text}");
                sound += usize::from(wanted.is_ok());
            }
        }
    }
    assert!(sound > 800, "only {sound} of 1200 had a value");
}

/// An expression of the vectors `P` and `Q` and of the number `X`, which stand for items, and of the names of `VECTORS`: a number, or a vector of three.
fn vectors(dice: &mut Dice, depth: usize, is_number: bool) -> String {
    if depth == 0 {
        let leaves = if is_number { ["X", "P.y", "Q[2]", "0.5"] } else { ["P", "Q", "d", "P.zxy"] };
        return leaves[dice.below(4)].to_owned();
    }
    let mut number = |is_number: bool| vectors(dice, depth - 1, is_number);
    let (n, m, u, v) = (number(true), number(true), number(false), number(false));
    let scalars = [
        format!("dot({u}, {v})"),
        format!("length({u})"),
        format!("distance({u}, {v})"),
        format!("sum({u} * {n})"),
        format!("norm({u} - {v})"),
        format!("max({u})"),
        format!("mean({u} ^ 2)"),
        format!("sum([({n} + k) * {m} for k in s])"),
        format!("sum([e * {n} + h for e, h in zip({u}, {v})])"),
        format!("max([dot(r, {u}) for r in m])"),
        format!("sum([c * sin(o * {n} * 1deg) for o in 0..3 for c in {u}])"),
        format!("({u} @ {v})"),
        format!("pair({n}, {u}).weight"),
        format!("len({u}) * {n}"),
        format!("std({u}) + {u}[0..2].y"),
        format!("(if {n} > {m} then dot({u}, d) else {m})"),
        format!("both(t => t * {n}, {m})"),
        format!("apply(t => t ^ 2, {n})"),
        format!("({n} * {m} - {n})"),
        format!("[{u}, {v}][1].x"),
    ];
    let of_three = [
        format!("cross({u}, {v})"),
        format!("normalize({u})"),
        format!("({u} + {v} * {n})"),
        format!("(m @ {u})"),
        format!("(turn @ {u})"),
        format!("[{n}, {m}, X]"),
        format!("pair({n}, {u}).at"),
        format!("[{n} * k for k in {u}]"),
        format!("(if {n} < 0.3 then {u} else {v})"),
        format!("sum([{u} * k for k in s], axis: 0)"),
    ];
    let all: &[String] = if is_number { &scalars } else { &of_three };
    format!("({})", all[dice.below(all.len())])
}

const VECTORS: &str = "param ps = [[0.3, -1.2, 0.5], [2, 0.1, -0.4], [1, 1.5, -2], [-0.7, 0.2, 0.9]]
param qs = [[1, 0.5, -0.3], [0.2, -1, 0.6], [-1.1, 0.4, 0.8], [0.9, -0.2, 1.3]]
param xs = [0.4, -0.8, 1.7, 0.2]
param d = [0.6, -0.1, 1.2]
param s = [0.5, -1.5]
let m = [[1, 0.2, -0.5], [0.3, -1, 0.7], [0.9, 0.1, 0.4]]
let turn = rotation(axis: [0, 1, 1], angle: 40deg)
let balls = [{ at: ps[i], towards: qs[i], size: xs[i], name: \"b\" } for i in 0..4]
fn pair(weight, at) = { weight: weight * 2, at: at - d }
fn apply(f, x) = f(x)
fn both(f, x) = f(x) + x
";

/// Numbers, rows and records at once and one by one: their values, and the derivatives of these by all that they are made of.
#[test]
fn comprehensions_over_vectors_and_records_give_what_their_items_give() {
    let mut dice = Dice(0x2468_ace1);
    let mut sound = 0;
    for round in 0..160 {
        let body = vectors(&mut dice, 1 + round % 3, true);
        let with = |p: &str, q: &str, x: &str| {
            // Names of functions have these letters in small.
            format!("({})", body.replace('P', p).replace('Q', q).replace('X', x))
        };
        let each = |i: usize, j: usize| with(&format!("ps[{i}]"), &format!("qs[{j}]"), &format!("xs[{i}]"));
        let (mut single, mut pairs) = (Vec::new(), Vec::new());
        for i in 0..4 {
            single.push(each(i, i));
            (0..4).for_each(|j| pairs.push(each(i, j)));
        }
        let by_zip = with("p", "q", "x");
        let by_index = with("ps[i]", "qs[i]", "xs[i]");
        let by_record = with("b.at", "b.towards", "b.size");
        let by_pair = with("ps[i]", "q", "xs[i]");
        let mut text = format!("{VECTORS}let w = [1, -2, 0.5, 3]\nlet w2 = [sin(i * 40deg) for i in 0..16]\n");
        let ways = [
            ("zipped", format!("[{by_zip} for p, q, x in zip(ps, qs, xs)]"), "single", "w"),
            ("indexed", format!("[{by_index} for i in 0..4]"), "single", "w"),
            ("recorded", format!("[{by_record} for b in balls]"), "single", "w"),
            ("paired", format!("[{by_pair} for i in 0..4 for q in qs]"), "pairs", "w2"),
        ];
        let mut add = |name: &str, value: &str, weights: &str| {
            text += &format!("let {name} = {value}\n");
            for param in ["ps", "qs", "xs", "d", "s"] {
                text += &format!("let {name}_by_{param} = grad(dot({weights}, {name}), {param})\n");
            }
        };
        add("single", &format!("[{}]", single.join(", ")), "w");
        add("pairs", &format!("[{}]", pairs.join(", ")), "w2");
        ways.iter().for_each(|(name, value, _, weights)| add(name, value, weights));
        let mut engine = engine(&text);
        for (name, _, wanted, _) in ways {
            for suffix in ["", "_by_ps", "_by_qs", "_by_xs", "_by_d", "_by_s"] {
                let found = numbers(&mut engine, &format!("{name}{suffix}"));
                let wanted = numbers(&mut engine, &format!("{wanted}{suffix}"));
                assert!(close(&found, &wanted), "{name}{suffix}: {found:?}, not {wanted:?}\n{text}");
                sound += usize::from(wanted.is_ok());
            }
        }
    }
    assert!(sound > 3000, "only {sound} of 3840 had a value");
}

#[test]
fn comprehensions_over_rows_indices_and_several_ranges() {
    let rows = "param pts = [[1, 2], [3, -4], [0.5, 6]]
let k = [2, 3]
let n = 3
";
    for (comprehension, items) in [
        ("[p.x * p.y for p in pts]", "[pts[0].x * pts[0].y, pts[1].x * pts[1].y, pts[2].x * pts[2].y]"),
        ("[p * p.x + k for p in pts]", "[pts[0] * pts[0].x + k, pts[1] * pts[1].x + k, pts[2] * pts[2].x + k]"),
        ("[x - y for x, y in pts]", "[pts[0][0] - pts[0][1], pts[1][0] - pts[1][1], pts[2][0] - pts[2][1]]"),
        ("[pts[i] * pts[i + 1].x for i in 0..n - 1]", "[pts[0] * pts[1].x, pts[1] * pts[2].x]"),
        ("[pts[-i - 1][1] for i in 0..2]", "[pts[-1][1], pts[-2][1]]"),
        (
            "[[x, k[1] * y] for x, y in pts]",
            "[[pts[0].x, 3 * pts[0].y], [pts[1].x, 3 * pts[1].y], [pts[2].x, 3 * pts[2].y]]",
        ),
        ("[[p, k] for p in pts]", "[[pts[0], k], [pts[1], k], [pts[2], k]]"),
        ("[k * 2 for p in pts]", "[k * 2, k * 2, k * 2]"),
        ("[p.x * j for p in pts for j in 0..2]", "[0, pts[0].x, 0, pts[1].x, 0, pts[2].x]"),
        ("[i * j for i in 1..3 for j in 0..2 if i != j]", "[0, 0, 2]"),
        ("[norm(p) for p in pts]", "[norm(pts[0]), norm(pts[1]), norm(pts[2])]"),
        (
            "[norm(p) * j for p in pts for j in 1..3]",
            "[norm(pts[0]), 2 * norm(pts[0]), norm(pts[1]), 2 * norm(pts[1]), norm(pts[2]), 2 * norm(pts[2])]",
        ),
        ("[if i < 1 then 1 else norm(pts[i]) for i in 0..3]", "[1, norm(pts[1]), norm(pts[2])]"),
        (
            "[sum([p.x * q.y for q in pts if q.x > p.x]) for p in pts]",
            "[pts[0].x * pts[1].y, 0, pts[2].x * pts[0].y + pts[2].x * pts[1].y]",
        ),
        ("[p.x * j for p in pts if p.y > 0 for j in 0..3 if j > p.x]", "[2 * pts[0].x, pts[2].x, 2 * pts[2].x]"),
        (
            "[x * y for p in pts for x, y in zip(p, k)]",
            "[2 * pts[0].x, 3 * pts[0].y, 2 * pts[1].x, 3 * pts[1].y, 2 * pts[2].x, 3 * pts[2].y]",
        ),
        (
            "[sum(p * pts[j]) for p in pts for j in 0..0 + 1]",
            "[dot(pts[0], pts[0]), dot(pts[1], pts[0]), dot(pts[2], pts[0])]",
        ),
        (
            "[r.b * r.a for r in [{ a: p.x, b: p * 2 } for p in pts]]",
            "[pts[0] * 2 * pts[0].x, pts[1] * 2 * pts[1].x, pts[2] * 2 * pts[2].x]",
        ),
        ("[sum([p, k], axis: 0) for p in pts]", "[pts[0] + k, pts[1] + k, pts[2] + k]"),
        ("[sum([p, k], axis: -1) for p in pts]", "[[sum(pts[0]), 5], [sum(pts[1]), 5], [sum(pts[2]), 5]]"),
        (
            "[(transpose([p, k]) @ p) for p in pts]",
            "[transpose([pts[0], k]) @ pts[0], transpose([pts[1], k]) @ pts[1], transpose([pts[2], k]) @ pts[2]]",
        ),
    ] {
        let text = format!(
            "{rows}let once = {comprehension}\nlet each = {items}\nlet slope = grad(sum(once ^ 2), pts)\nlet slope_each = grad(sum(each ^ 2), pts)\n"
        );
        let mut engine = engine(&text);
        for (once, each) in [("once", "each"), ("slope", "slope_each")] {
            let (found, wanted) = (numbers(&mut engine, once), numbers(&mut engine, each));
            assert!(wanted.is_ok() && close(&found, &wanted), "{once} is {found:?}, not {wanted:?}\n{text}");
        }
    }
    // Truths stay truths, and what fails for one item says so as ever.
    let mut engine = engine(
        "let xs = [1, 2, 3] * sum(noise([1]) ^ 0)\nlet some = if any([x > 2 for x in xs]) then 1 else 0\nlet bad = [sqrt(x - 2) for x in xs]\nlet none = len([x for x in xs if x > 5])\n",
    );
    assert_eq!(numbers(&mut engine, "some"), Ok(vec![1.0]));
    assert_eq!(numbers(&mut engine, "bad"), Err("dscene::run::value".to_owned()));
    assert_eq!(numbers(&mut engine, "none"), Ok(vec![0.0]));
}

/// With one pass over the array for each item these would take minutes.
#[test]
fn long_comprehensions_and_their_derivatives_end() {
    let mut engine = engine(
        "param q = [1 + 0 * i for i in 0..100000]
let at_once = mean([(1 - x) ^ 2 for x in q])
let by_item = mean([determinant([[x, 2], [-2, x]]) for x in q[0..30000]])
let slope = grad(at_once, q)[7]
let slope_by_item = grad(by_item, q)[7] * 30000
let constant = sum([len(concat([x], [x])) for x in 0..200000])
",
    );
    assert_eq!(numbers(&mut engine, "at_once"), Ok(vec![0.0]));
    assert_eq!(numbers(&mut engine, "slope"), Ok(vec![0.0]));
    assert!(close(&numbers(&mut engine, "by_item"), &Ok(vec![5.0])));
    assert!(close(&numbers(&mut engine, "slope_by_item"), &Ok(vec![2.0])));
    assert_eq!(numbers(&mut engine, "constant"), Ok(vec![400_000.0]));
}

#[test]
fn thousands_of_params_are_optimised() {
    let count = 8000;
    let params: String = (0..count).map(|i| format!("param p{i} = 1\n")).collect();
    let sums: Vec<String> =
        (0..80).map(|k| (k * 100..(k + 1) * 100).map(|i| format!("p{i} ^ 2")).collect::<Vec<_>>().join(", ")).collect();
    let parts: String = sums.iter().enumerate().map(|(k, sum)| format!("let s{k} = sum([{sum}])\n")).collect();
    let all: Vec<String> = (0..80).map(|k| format!("s{k}")).collect();
    let text =
        format!("{params}{parts}loss l = sum([{}])\noptimize l {{ using: sgd(lr: 0.25), steps: 2 }}\n", all.join(", "));
    let program = program(&text);
    let actions = program.actions.clone();
    let folder = tempfile::tempdir().unwrap();
    let mut engine = Engine::new(program, EngineOptions::default());
    let mut world = Recorder::default();
    let mut runner = Runner::new(&mut engine, &mut world);
    runner.outputs = folder.path().to_path_buf();
    let _ = runner.run(&actions).unwrap_or_else(|d| panic!("{d:#?}"));
    // Each step halves every param.
    assert_eq!(numbers(&mut engine, "p7999"), Ok(vec![0.25]));
    assert_eq!(numbers(&mut engine, "l"), Ok(vec![f64::from(count) / 16.0]));
}

/// On a thread with the stack that a main thread has.
fn on_main_stack<T: Send + 'static>(f: impl FnOnce() -> T + Send + 'static) -> T {
    std::thread::Builder::new().stack_size(8 << 20).spawn(f).unwrap().join().unwrap()
}

/// In seconds and not in hours: each of them once looked at all before it.
#[test]
fn many_actions_are_checked() {
    let text: String = (0..100_000).map(|i| format!("print {i}\n")).collect();
    assert_eq!(program(&text).actions.len(), 100_000);
}

#[test]
fn a_chain_of_50000_declarations_is_checked_and_evaluated() {
    for reversed in [false, true] {
        let value = on_main_stack(move || {
            let mut lines: Vec<String> = (1..50_000).map(|i| format!("let a{i} = a{} + 1", i - 1)).collect();
            lines.push("let a0 = 0".to_owned());
            if reversed {
                lines.reverse();
            }
            numbers(&mut engine(&lines.join("\n")), "a49999")
        });
        assert_eq!(value, Ok(vec![49_999.0]));
    }
}

#[test]
fn a_chain_of_15000_functions_is_evaluated() {
    for body in ["+ 1", "+ sum([x * 0 for k in 0..1])"] {
        let calls: String = (1..15_000).map(|i| format!("fn f{i}(x) = f{}(x) {body}\n", i - 1)).collect();
        let text = format!("fn f0(x) = x\n{calls}let y = f14999(1)\nlet ys = [f14999(x) for x in 0..3]\n");
        let mut engine = engine(&text);
        let more = if body == "+ 1" { 14_999.0 } else { 0.0 };
        assert_eq!(numbers(&mut engine, "y"), Ok(vec![1.0 + more]));
        assert_eq!(numbers(&mut engine, "ys"), Ok(vec![more, 1.0 + more, 2.0 + more]));
    }
    // What never ends has an end all the same.
    let mut endless = engine("fn call(f) = f(f) + 1\nlet y = call(call)\n");
    assert_eq!(numbers(&mut endless, "y"), Err("dscene::run::recursion".to_owned()));
}

#[test]
fn each_of_10000_unknown_names_is_told_once() {
    let text: String = (0..10_000).map(|i| format!("let a{i} = nowhere_{i} * 2\n")).collect();
    let found = check::check_text("test.dscene", None, text, &[], &Disk).diagnostics;
    assert_eq!(found.iter().filter(|d| d.code == "dscene::name::unknown").count(), 10_000);
    assert_eq!(found.len(), 10_000);
}

#[test]
fn what_doubles_with_every_line_is_checked() {
    let chain = |line: &dyn Fn(usize) -> String| (1..=30).map(line).collect::<String>();
    let functions = chain(&|i| format!("fn f{i}(x) = f{0}(x) + f{0}(x)\n", i - 1));
    program(&format!("fn f0(x) = x\n{functions}fn use(x) = f30(x)\nlet y = f3(1)\n"));
    let values = chain(&|i| format!("let f{i} = x => f{0}(f{0}(x))\n", i - 1));
    program(&format!("let f0 = x => x\n{values}let y = f3(1)\n"));
    let pairs = chain(&|i| format!("let z{i} = zip(z{0}, z{0})\n", i - 1));
    program(&format!("let z0 = [1, 2]\n{pairs}"));
    let chained = (0..40).fold("a".to_owned(), |inner, _| format!("zip({inner}, a)"));
    program(&format!("let a = [1, 2]\nlet z = {chained}\n"));
}

/// Whether a script is right, all that `dsl check` looks at included; how often it was warned.
fn checked(text: &str) -> usize {
    let Checked { program, diagnostics, .. } = check::check_text("test.dscene", None, text, &[], &Disk);
    let errors = || diagnostics.iter().filter(|d| d.is_error()).collect::<Vec<_>>();
    let program = program.unwrap_or_else(|| panic!("{:#?}", errors().first()));
    check::kept_inside(&program);
    diagnostics.len()
}

/// What a program is asked about each of its declarations, each of which depends on all before it: looking through these every time takes minutes.
#[test]
fn what_depends_on_all_before_it_is_followed_once() {
    type Line = fn(usize) -> String;
    let rows: [(&str, Line, usize, usize); 12] = [
        // The first line, the others, how many, and how many warnings there are.
        (
            "param p = 0.5\nlet x0 = floor(p)",
            |i| format!("let x{i} = floor(p) + x{}\nloss l{i} = x{i}", i - 1),
            4000,
            1,
        ),
        ("let x0 = 0", |i| format!("param p{i} = 0.5\nlet x{i} = p{i} + x{}\nloss l{i} = x{i} - {i}", i - 1), 4000, 0),
        ("param x0 = 1", |i| format!("let x{i} = if x{0} > 0 then x{0} else 2", i - 1), 20_000, 0),
        ("param x0 = 1\noptimize x0", |i| format!("let x{i} = if x{0} > 0 then x{0} else x{0} * 2", i - 1), 20_000, 0),
        (
            "let x0 = 0",
            |i| format!("param p{i} = 1\nlet x{i} = p{i} + x{}\noptimize x{i} {{ steps: 1 }}", i - 1),
            4000,
            0,
        ),
        (
            "let x0 = 0",
            |i| format!("param p{i} = 1\nlet x{i} = p{i} + x{}\noptimize x{i} {{ over: [p{i}] steps: 1 }}", i - 1),
            4000,
            0,
        ),
        (
            "let x0 = 0",
            |i| format!("param p{i} = 1 {{ lr: 2 }}\nlet x{i} = p{i} + x{}\noptimize x{i} ^ 2 {{ blur: 1 }}", i - 1),
            4000,
            3999,
        ),
        (
            "let x0 = 0",
            |i| format!("param p{i} = 1\nlet x{i} = p{i} + x{}\nlet g{i} = grad(x{i}, p{i})", i - 1),
            4000,
            0,
        ),
        ("let x0 = 0", |i| format!("param p{i} = 1\nlet x{i} = (x{} + p{i}) with {{ p{i}: {i} }}", i - 1), 4000, 0),
        ("let x0 = sum(noise([1]))", |i| format!("let x{i} = x{} + 1\nprint x{i}", i - 1), 20_000, 0),
        (
            "camera eye { position: [0, 0, 5], look_at: [0, 0, 0] }",
            |i| format!("light l{i} = point([0, {i}, 1], 10)\nprint mean(render(eye, spp: 1))"),
            4000,
            0,
        ),
        ("let f0 = x => x", |i| format!("let f{i} = () => f{}", i - 1), 20_000, 0),
    ];
    for (first, line, n, warnings) in rows {
        let text: String = (1..n).map(|i| line(i) + "\n").collect();
        let what = line(1);
        assert_eq!(on_main_stack(move || checked(&format!("{first}\n{text}"))), warnings, "{first}\n{what}");
    }
}

/// Records in records, lists in lists: beyond some depth it is left to the run what they are, so that no type holds those of all before it.
#[test]
fn values_within_values_are_checked() {
    type Line = fn(usize) -> String;
    let rows: [(&str, Line, usize); 6] = [
        ("{ k: 1 }", |i| format!("let r{i} = {{ inner: r{}, k: 1 }}", i - 1), 20_000),
        ("{ k: 1 }", |i| format!("let r{i} = {{ a: r{0}, b: r{0} }}", i - 1), 1000),
        ("1", |i| format!("let r{i} = [r{}]", i - 1), 20_000),
        ("\"text\"", |i| format!("let r{i} = [r{}]", i - 1), 20_000),
        ("{ k: 1 }", |i| format!("let r{i} = [r{0}, [r{0}]]", i - 1), 1000),
        ("[\"a\", \"b\"]", |i| format!("let r{i} = zip(r{}, [1, 2])", i - 1), 20_000),
    ];
    for (first, line, n) in rows {
        let text: String = (1..n).map(|i| line(i) + "\n").collect();
        on_main_stack(move || checked(&format!("let r0 = {first}\n{text}")));
    }
    // What is less deep is still known.
    let text = "let a = { k: 1 }\nlet b = { a: [a] }\nlet c = [{ b: b }]\nlet wrong = c[0].b.a[0].m\n";
    let found = check::check_text("test.dscene", None, text, &[], &Disk).diagnostics;
    assert_eq!(found.iter().map(|d| d.code).collect::<Vec<_>>(), ["dscene::name::field"]);
}

#[test]
fn a_block_of_10000_names_is_checked_and_evaluated() {
    let lets: String = (1..10_000).map(|i| format!("let y{i} = y{} + x\n", i - 1)).collect();
    let text = format!(
        "fn f(x) {{\nlet y0 = 0\n{lets}y9999 }}\nparam p = 2\nlet y = f(p)\nlet slope = grad(y, p)\nlet ys = [f(x) for x in [1, p]]\n"
    );
    for (name, wanted) in [("y", vec![19_998.0]), ("slope", vec![9999.0]), ("ys", vec![9999.0, 19_998.0])] {
        let text = text.clone();
        assert_eq!(on_main_stack(move || numbers(&mut engine(&text), name)), Ok(wanted));
    }
}

/// Checks lines one after the other, as the REPL does.
fn typed(program: &mut hir::Program, text: &str) -> Result<Vec<hir::DeclId>, Vec<Diagnostic>> {
    match check_line(program, text) {
        (Some(Line::Statements { declared, .. }), _) => Ok(declared),
        (Some(_), _) => Ok(Vec::new()),
        (None, diagnostics) => Err(diagnostics),
    }
}

#[test]
fn a_line_checks_nothing_that_it_does_not_touch() {
    let mut program = program("let a0 = 1\n");
    typed(&mut program, "let first = a0").unwrap();
    for i in 1..1000 {
        let before = program.decls.clone();
        typed(&mut program, &format!("let a{i} = a{} + 1", i - 1)).unwrap();
        assert_eq!(program.decls.len(), before.len() + 1);
        // All but the last few are shared, so that a line costs the same however many were before it.
        assert!(program.decls.unshared(&before).count() <= 64, "line {i}");
        assert!(before.iter().zip(program.decls.iter()).all(|(old, new)| Arc::ptr_eq(old, new)), "line {i}");
    }
    let before = program.decls.clone();
    // The last three depend on this one.
    typed(&mut program, "let a997 = 5").unwrap();
    let changed = before.iter().zip(program.decls.iter()).filter(|(old, new)| !Arc::ptr_eq(old, new));
    assert_eq!(changed.map(|(_, new)| new.name.as_str()).collect::<Vec<_>>(), ["a997", "a998", "a999"]);
    let mut engine = Engine::new(program, EngineOptions::default());
    assert_eq!(numbers(&mut engine, "a999"), Ok(vec![7.0]));
}

/// A line that adds to the scene is checked with what it adds: with all parts each time, these lines take minutes.
#[test]
fn a_line_looks_at_no_part_of_the_scene_but_its_own() {
    let mut program = program("camera eye { position: [0, 0, 5], look_at: [0, 0, 0], film: [8, 8] }\nparam p = 1\n");
    for i in 0..5000 {
        typed(&mut program, &format!("light l{i} = point([0, {i}, 1], 10)")).unwrap();
    }
    assert_eq!(program.default_scene.len(), 5000);
    typed(&mut program, "let seen = mean(render(eye, spp: 1))").unwrap();
    for line in ["light last = point([0, 0, 1], seen)", "light l5 = point([0, 0, 1], seen)"] {
        let errors = typed(&mut program, line).expect_err(line);
        assert!(errors.iter().any(|d| d.code == "dscene::name::cycle"), "{line}: {errors:#?}");
    }
    let errors = typed(&mut program, "param q ~ normal(p, 1)").expect_err("a prior that varies");
    assert!(errors.iter().any(|d| d.code == "dscene::flow::prior"), "{errors:#?}");
    typed(&mut program, "light l5 = point([0, 0, 1], 3)").unwrap();
    typed(&mut program, "let l7 = 2").unwrap();
    assert_eq!((program.default_scene.len(), program.default_scene.is_sorted()), (4999, true));
}

/// Params are known as such however they came about: by a line, instead of another declaration, and no more when that is replaced.
#[test]
fn lines_make_params_and_unmake_them() {
    let mut program = program("let a = 1\nparam b = 2\nlet c = a + b\n");
    for (line, wanted) in [
        ("let d = 4", "b"),
        ("param e = 5", "b e"),
        ("param a = 7", "a b e"),
        ("let b = 8", "a e"),
        ("loss l = a + e", "a e"),
    ] {
        typed(&mut program, line).unwrap();
        let params: Vec<&str> = program.params().map(|id| program.decl(id).name.as_str()).collect();
        assert_eq!(params.join(" "), wanted, "{line}");
    }
}

#[test]
fn the_first_line_after_a_file_checks_nothing_of_it_again() {
    let text = "param p = 2\nlet a = p + 1\nfn f(x, k = a) = x * k\nloss l = f(3) ^ 2\nprint a\nprint l\n";
    let set = [("a".to_owned(), "p * 5".to_owned())];
    for (overrides, expected) in [(&[][..], 81.0), (&set[..], 900.0)] {
        let checked = check::check_text_for(Purpose::Lines, "test.dscene", None, text, overrides, &Disk);
        let mut program = checked.program.unwrap_or_else(|| panic!("{:#?}", checked.diagnostics));
        let before = program.decls.clone();
        let (expr, told) = check_expression(&mut program, "l + 0");
        let expr = expr.unwrap_or_else(|| panic!("{told:#?}"));
        assert_eq!(typed(&mut program, "let c = l + f(1)").unwrap().len(), 1);
        assert!(before.iter().zip(program.decls.iter()).all(|(old, new)| Arc::ptr_eq(old, new)));
        assert_eq!((program.actions.len(), program.losses().count()), (2, 1));
        let mut engine = Engine::new(program, EngineOptions::default());
        assert_eq!(engine.eval(&expr).ok().and_then(|value| value.number()), Some(expected));
        assert_eq!(numbers(&mut engine, "c"), Ok(vec![expected + expected.sqrt() / 3.0]));
    }
}

#[test]
fn a_line_that_breaks_what_depends_on_it_changes_nothing() {
    let mut program = program("let a = 1\nlet high = 2\nparam p = 1 in 0..high\nfn f(x) = x * a\nlet y = f([1, 2])\n");
    typed(&mut program, "let b = a + 1").unwrap();
    for (line, code) in [
        ("let a = \"text\"", "dscene::type"),
        ("let a = b", "dscene::name::cycle"),
        ("let high = 0.5", "dscene::type::bounds"),
        ("let a = [1, 2, 3]", "dscene::"),
    ] {
        let errors = typed(&mut program, line).expect_err(line);
        assert!(errors.iter().any(|d| d.code.starts_with(code)), "{line}: {errors:#?}");
        let mut engine = Engine::new(program.clone(), EngineOptions::default());
        assert_eq!(numbers(&mut engine, "b"), Ok(vec![2.0]), "{line}");
    }
    typed(&mut program, "fn f(x) = x * 3").unwrap();
    typed(&mut program, "let a = 4").unwrap();
    let mut engine = Engine::new(program.clone(), EngineOptions::default());
    assert_eq!(numbers(&mut engine, "y"), Ok(vec![3.0, 6.0]));
    assert_eq!(numbers(&mut engine, "b"), Ok(vec![5.0]));
    // A name of the library is another matter: everything that used it means the new one.
    typed(&mut program, "let c = pi").unwrap();
    typed(&mut program, "let pi = 3").unwrap();
    let mut engine = Engine::new(program, EngineOptions::default());
    assert_eq!(numbers(&mut engine, "c"), Ok(vec![3.0]));
}

/// Line by line or as a file: what is accepted is the same, and so is what it gives.
#[test]
fn lines_give_what_a_file_gives() {
    let mut dice = Dice(0xfeed);
    for _ in 0..12 {
        let mut program = program("let start = 1\n");
        let mut file: Vec<(String, String)> = Vec::new();
        for _ in 0..25 {
            let name = ["u", "v", "w", "x", "y"][dice.below(5)].to_owned();
            let other = |dice: &mut Dice| ["u", "v", "w", "x", "y", "start", "2"][dice.below(7)];
            let (a, b) = (other(&mut dice), other(&mut dice));
            let text = match dice.below(7) {
                0 => format!("let {name} = {a} + {b}"),
                1 => format!("let {name} = [{a}, {b}]"),
                2 => format!("let {name} = sum([t * {a} for t in [1, 2]])"),
                3 => format!("param {name} = 0.5 in 0..{b}"),
                4 => format!("let {name} = sum({a}) * len([{b}, 1])"),
                5 => format!("let {name} = {a}[0]"),
                _ => format!("let {name} = {}", dice.below(9)),
            };
            let mut next = file.clone();
            match next.iter_mut().find(|(n, _)| *n == name) {
                Some(line) => line.1 = text.clone(),
                None => next.push((name, text.clone())),
            }
            let whole: Vec<&str> = next.iter().map(|(_, text)| text.as_str()).collect();
            let whole = format!("let start = 1\n{}\n", whole.join("\n"));
            let checked = check::check_text("test.dscene", None, whole.as_str(), &[], &Disk);
            let accepted = typed(&mut program, &text);
            assert_eq!(accepted.is_ok(), checked.program.is_some(), "{text}\nin\n{whole}{accepted:#?}");
            let Some(of_file) = checked.program else { continue };
            file = next;
            let mut by_line = Engine::new(program.clone(), EngineOptions::default());
            let mut by_file = Engine::new(of_file, EngineOptions::default());
            for (name, _) in &file {
                let ty =
                    |engine: &Engine| engine.program().find(name).map(|id| engine.program().decl(id).ty.to_string());
                assert_eq!(ty(&by_line), ty(&by_file), "{name} in\n{whole}");
                let value = |engine: &mut Engine| {
                    let id = engine.program().find(name).unwrap();
                    engine.eval_decl(id).map(|v| dscene::eval::to_json(&v)).map_err(|d| d.code)
                };
                assert_eq!(value(&mut by_line), value(&mut by_file), "{name} in\n{whole}");
            }
        }
    }
}

/// Each use of a name has its type: of records of thousands of fields there are not as many copies as uses.
#[test]
fn uses_of_a_long_record_share_its_type() {
    let fields: Vec<String> = (0..3000).map(|i| format!("a{i}: {i}")).collect();
    let text = format!("let r = {{ {} }}\nlet s = r\nlet t = r.a2999 + s.a1\n", fields.join(", "));
    let program = program(&text);
    let ty = |name: &str| program.decl(program.find(name).expect("declared")).ty.clone();
    let (Ty::Record(r), Ty::Record(s)) = (ty("r"), ty("s")) else { panic!("{} and {}", ty("r"), ty("s")) };
    assert!(r.len() == 3000 && Arc::ptr_eq(&r, &s));
    assert_eq!(numbers(&mut engine(&text), "t"), Ok(vec![3000.0]));
}
