//! What a sweep runs over: the script's own variables, and what the command line sets.

use crate::check::hir::{self, Values};
use crate::check::types::Ty;
use crate::check::{self, SEED};
use crate::cli::args::{Common, SweepArgs};
use crate::cli::load::engine_options;
use crate::cli::script::as_script;
use crate::cli::{Loaded, Terminal, check_file};
use crate::diag::Diagnostic;
use crate::eval::Engine;
use crate::natives::value::Value;
use crate::session::sweep::Axis;
use crate::session::{Override, World};
use crate::source::SourceMap;
use crate::syntax;
use crate::syntax::ast::ExprKind;

/// More values of one variable than this are not checked before the runs begin, but as they do.
const CHECKED: usize = 64;

/// The combinations, by their parts.
pub struct Plan {
    pub axes: Vec<Axis>,
    pub seeds: Vec<u64>,
    /// The script's sweep has a variable `seed`, which is the seed of the run.
    pub declares_seed: bool,
}

impl Plan {
    /// Reports what is wrong; `None` if the sweep cannot run.
    pub fn new(args: &SweepArgs, loaded: &mut Loaded, terminal: &mut Terminal) -> Option<Plan> {
        let sweep = loaded.engine.program().sweep.clone();
        let mut axes: Vec<Axis> = Vec::new();
        for axis in sweep.iter().flat_map(|sweep| &sweep.axes) {
            let values = match &axis.values {
                Values::Written(values) => {
                    let sources = &loaded.engine.program().sources;
                    values.iter().map(|value| sources.text(value.span).to_owned()).collect()
                }
                Values::Computed(expr) => computed(expr, loaded, terminal)?,
            };
            axes.push(Axis { name: axis.name.clone(), values });
        }
        let declares_seed = axes.iter().any(|axis| axis.name == SEED);
        let mut named: Vec<&str> = Vec::new();
        for Override { name, value } in &args.run.common.set {
            if name == SEED && !declares_seed {
                let told = Diagnostic::error("dscene::sweep::seed", "the seeds of a sweep are not set as a value is")
                    .help("write `--seeds 5`, and perhaps `--seed N` for the first of them");
                terminal.diagnostic(&told, &SourceMap::default());
                return None;
            }
            let values = listed(name, value, loaded, terminal)?;
            if named.contains(&name.as_str()) {
                let told = Diagnostic::error("dscene::sweep::twice", format!("`--set {name}` is given twice"))
                    .help(format!("give all values at once: `--set {name}=A,B`"));
                terminal.diagnostic(&told, &SourceMap::default());
                return None;
            }
            named.push(name);
            match axes.iter_mut().find(|axis| axis.name == *name) {
                Some(axis) => axis.values = values,
                None => axes.push(Axis { name: name.clone(), values }),
            }
        }
        if declares_seed && args.seeds.is_none() && args.run.common.seed != 0 {
            let told = Diagnostic::error("dscene::sweep::seed", "the script's sweep has seeds of its own")
                .help(format!("take others in their place: `--seeds 1 --seed {}`", args.run.common.seed));
            terminal.diagnostic(&told, &SourceMap::default());
            return None;
        }
        let own_seeds = axes.iter().position(|axis| axis.name == SEED && declares_seed).map(|i| axes.remove(i));
        let seeds = match (args.seeds, own_seeds) {
            (Some(count), _) => (0..count.min(1 + crate::session::sweep::MOST as u64))
                .map(|i| args.run.common.seed.wrapping_add(i))
                .collect(),
            (None, Some(axis)) => axis.values.iter().map(|text| seed(text, loaded, terminal)).collect::<Option<_>>()?,
            (None, None) => vec![args.run.common.seed],
        };
        check_values(args, &axes, terminal)?;
        Some(Plan { axes, seeds, declares_seed })
    }
}

/// The values of `--set NAME=VALUES`.
fn listed(name: &str, text: &str, loaded: &mut Loaded, terminal: &mut Terminal) -> Option<Vec<String>> {
    let parse = |text: &str| {
        let mut sources = SourceMap::new();
        let source = sources.add(format!("--set {name}"), None, text);
        let (expr, diagnostics) = syntax::parse_expr(&sources, source);
        (expr, diagnostics, sources)
    };
    let is_range = |kind: &ExprKind| matches!(kind, ExprKind::Range { .. });
    let (whole, ..) = parse(text);
    if whole.is_some_and(|expr| is_range(&expr.kind)) {
        let expr = loaded.expression(text, "the range", terminal)?;
        return computed(&expr, loaded, terminal);
    }
    let list = format!("[{text}]");
    let (expr, diagnostics, sources) = parse(&list);
    let Some(expr) = expr else {
        diagnostics.iter().for_each(|d| terminal.diagnostic(d, &sources));
        return None;
    };
    match expr.kind {
        ExprKind::Array(items) => Some(items.iter().map(|item| sources.text(item.span).to_owned()).collect()),
        // `2^-k for k in 0..5`
        _ => {
            let expr = loaded.expression(&list, "the list", terminal)?;
            computed(&expr, loaded, terminal)
        }
    }
}

/// The items of a list that has to be evaluated, as texts of the language.
fn computed(expr: &hir::Expr, loaded: &mut Loaded, terminal: &mut Terminal) -> Option<Vec<String>> {
    let sources = loaded.engine.program().sources.clone();
    let told = match loaded.engine.eval(expr) {
        Err(told) => told,
        Ok(value) => {
            let ty = match &expr.ty {
                Ty::Array(item, _) => (**item).clone(),
                _ => Ty::SCALAR,
            };
            let texts: Option<Vec<String>> =
                value.items().unwrap_or_default().iter().map(|v| text_of(v, &ty)).collect();
            match texts {
                Some(texts) if !texts.is_empty() => return Some(texts),
                Some(_) => Diagnostic::error("dscene::sweep::empty", "there is nothing to sweep over")
                    .label(expr.span, "holds no value")
                    .help("give at least one: `[0.01, 0.1]`, or a range that counts upwards such as `0..5`"),
                None => Diagnostic::error("dscene::sweep::values", "these values cannot be given to other processes")
                    .label(expr.span, format!("this is {}", expr.ty.a()))
                    .help("write the values out: `[a, b]`"),
            }
        }
    };
    terminal.diagnostic(&told, &sources);
    None
}

fn text_of(value: &Value, ty: &Ty) -> Option<String> {
    Some(match value {
        Value::Bool(b) => b.to_string(),
        Value::Str(s) => {
            let escaped = s.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n").replace('\t', "\\t");
            format!("\"{}\"", escaped.replace('{', "{{").replace('}', "}}"))
        }
        _ => {
            let tensor = value.var()?.value();
            match tensor.item() {
                Some(x) if ty.is_scalar() && x.fract() == 0.0 && x.abs() < 1e15 => format!("{x}"),
                _ => as_script(tensor, ty),
            }
        }
    })
}

fn seed(text: &str, loaded: &mut Loaded, terminal: &mut Terminal) -> Option<u64> {
    if let Ok(seed) = text.parse() {
        return Some(seed);
    }
    let expr = loaded.expression(text, "a seed", terminal)?;
    let sources = loaded.engine.program().sources.clone();
    let told = match loaded.engine.eval(&expr) {
        Ok(value) => match value.number() {
            Some(x) if x >= 0.0 && x.fract() == 0.0 && x < 2f64.powi(53) => return Some(x as u64),
            _ => Diagnostic::error("dscene::sweep::seed", "a seed is a whole number, 0 or more")
                .label(expr.span, "this one"),
        },
        Err(told) => told,
    };
    terminal.diagnostic(&told, &sources);
    None
}

/// Why what was set has no value, if it is numbers and that shows without an image or a mesh being made.
fn untakeable(args: &SweepArgs, program: &hir::Program, name: &str) -> Option<Diagnostic> {
    let id = program.find(name)?;
    let decl = program.decl(id);
    if !matches!(decl.ty, Ty::Num(_) | Ty::Angle | Ty::Bool | Ty::Str) {
        return None;
    }
    let is_param = matches!(decl.kind, hir::DeclKind::Param(_));
    let options = engine_options(&args.run.common, &args.run.file);
    let mut engine = Engine::new(program.clone(), options);
    if is_param { engine.param_value(id).err() } else { engine.eval_decl(id).err() }
}

/// Checks the script with each value of each variable, the others being at their first one.
fn check_values(args: &SweepArgs, axes: &[Axis], terminal: &mut Terminal) -> Option<()> {
    let first = |axis: &Axis| Some(Override { name: axis.name.clone(), value: axis.values.first()?.clone() });
    let set: Vec<Override> = axes.iter().filter_map(first).collect();
    for (i, axis) in axes.iter().enumerate() {
        // The first value of all stands in the first check.
        for value in axis.values.iter().take(CHECKED).skip(usize::from(i > 0)) {
            let mut set = set.clone();
            set[i].value.clone_from(value);
            let check::Checked { program, diagnostics, sources, .. } =
                check_file(&args.run.file, &Common { set, ..args.run.common.clone() });
            let errors: Vec<&Diagnostic> = diagnostics.iter().filter(|d| d.is_error()).collect();
            if !errors.is_empty() {
                errors.into_iter().for_each(|d| terminal.diagnostic(d, &sources));
                return None;
            }
            let told = program.as_ref().and_then(|program| untakeable(args, program, &axis.name));
            if let Some(told) = told {
                terminal.diagnostic(&told, &sources);
                return None;
            }
            // Of the script's own variables that is told when it is checked.
            let mut swept = args.run.common.set.iter().map(|set| set.name.as_str()).filter(|name| *name == axis.name);
            if let (Some(program), Some(name)) = (&program, swept.next().filter(|_| axis.values.len() > 1))
                && let Some(told) = check::unused(program, name)
            {
                terminal.diagnostic(&told, &sources);
                return None;
            }
        }
    }
    Some(())
}
