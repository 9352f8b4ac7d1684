//! `dsl grad`

use std::path::{Path, PathBuf};

use serde_json::json;

use super::args::GradArgs;
use super::grad_server::serve;
use super::render::{cannot_save, choose_camera, in_folder, interrupted};
use super::{EXIT_WRONG, Loaded, Terminal, load, out};
use crate::check::hir;
use crate::check::types::Ty;
use crate::diag::Diagnostic;
use crate::session::clock::Stopwatch;
use crate::session::run::tell_warnings;
use crate::session::save::{lost_warning, save_value};
use crate::session::script::{Targets, find_target, losses, reaching_targets};
use crate::session::{MeasureOptions, World, measure, world};

pub fn run(args: &GradArgs) -> u8 {
    let mut terminal = Terminal::new(&args.common);
    let Some(mut loaded) = load(&args.file, &args.common, &mut terminal) else {
        return EXIT_WRONG;
    };
    if args.serve {
        return serve(args, loaded, &mut terminal);
    }
    let result = world::listening(|| match &args.image {
        Some(path) => gradient_images(args, path, &mut loaded, &mut terminal),
        None => gradients(args, &mut loaded, &mut terminal),
    });
    tell_warnings(&mut loaded.engine, &mut terminal);
    match result {
        Ok(code) => code,
        Err(diagnostic) if diagnostic.code == crate::eval::INTERRUPTED => interrupted(&mut terminal),
        Err(diagnostic) => {
            let sources = loaded.engine.program().sources.clone();
            terminal.diagnostic(&diagnostic, &sources);
            EXIT_WRONG
        }
    }
}

fn gradients(args: &GradArgs, loaded: &mut Loaded, terminal: &mut Terminal) -> Result<u8, Diagnostic> {
    let of = match &args.of {
        Some(of) => of.clone(),
        None => default_loss(loaded, terminal)?,
    };
    let Some(expr) = loaded.expression(&of, "--of", terminal) else {
        return Ok(EXIT_WRONG);
    };
    if !(expr.ty.is_scalar() || expr.ty.is_unknown()) {
        let message = format!("a gradient is of a scalar, `{of}` is of type {}", expr.ty);
        return Err(Diagnostic::error("dscene::cli::of", message).label(expr.span, "not a scalar").help(
            match expr.ty {
                Ty::Angle => format!("divide by a unit: `({of}) / 1rad`"),
                Ty::Bool | Ty::Str => "give an expression whose value is a number".to_owned(),
                _ => format!("reduce it: `mean({of})`, or write the derivative image with --image OUT.exr"),
            },
        ));
    }
    let Some(wrt) = targets(args, loaded, &expr, terminal)? else {
        return Ok(EXIT_WRONG);
    };
    if wrt.is_empty() {
        return Err(Diagnostic::error("dscene::cli::wrt", format!("no param reaches `{of}`"))
            .help("name one with --wrt, or a numeric field such as --wrt lamp.radiance"));
    }
    let options = MeasureOptions {
        repeats: args.repeats,
        seed: args.common.seed,
        fd_step: args.fd.then_some(args.fd_step),
        warm: args.warm,
    };
    let Some(measurement) = measure(&mut loaded.engine, &expr, &wrt, options, &world::interrupted)? else {
        return Ok(interrupted(terminal));
    };
    if args.common.json {
        let file = args.file.display().to_string();
        let object = measurement.to_json(&file, &of, args.common.seed, rayon::current_num_threads());
        out::line(&object.to_string());
    } else {
        out::line(&measurement.to_text(&of, true));
        let (primal, gradient) = (measurement.primal.wall, measurement.gradient.wall);
        terminal.note(&format!(
            "\nvalue {}, value and gradient {}",
            crate::session::clock::human_seconds(primal),
            crate::session::clock::human_seconds(gradient)
        ));
    }
    measurement.not_finite(&mut loaded.engine, &expr).map_or(Ok(0), Err)
}

/// The only loss, or the first with a note.
fn default_loss(loaded: &Loaded, terminal: &mut Terminal) -> Result<String, Diagnostic> {
    let losses = losses(loaded.engine.program());
    match losses.as_slice() {
        [] => Err(Diagnostic::error("dscene::cli::of", "the script declares no loss")
            .help("say what to differentiate: --of 'mean(render(eye))'")),
        [only] => Ok(only.clone()),
        [first, ..] => {
            terminal.note(&format!("the script has {} losses; this is `{first}` (choose with --of)", losses.len()));
            Ok(first.clone())
        }
    }
}

/// The `--wrt` names; by default every param that reaches the expression. `None` if a name is wrong, which is reported.
fn targets(
    args: &GradArgs,
    loaded: &mut Loaded,
    of: &hir::Expr,
    terminal: &mut Terminal,
) -> Result<Option<Targets>, Diagnostic> {
    if args.wrt.is_empty() {
        return reaching_targets(&mut loaded.engine, of).map(Some);
    }
    let mut found = Vec::new();
    for name in &args.wrt {
        let target = find_target(loaded.engine.program(), name)?;
        // The checker knows best what is wrong with a field.
        if loaded.expression(name, "--wrt", terminal).is_none() {
            return Ok(None);
        }
        found.push((name.trim().to_owned(), target));
    }
    Ok(Some(found))
}

/// `--image`: ∂image/∂param for each param, forward mode. Several params make several files.
fn gradient_images(
    args: &GradArgs,
    path: &Path,
    loaded: &mut Loaded,
    terminal: &mut Terminal,
) -> Result<u8, Diagnostic> {
    let of = match &args.of {
        Some(of) => of.clone(),
        None => format!("render({})", choose_camera(loaded.engine.program(), None)?),
    };
    let Some(expr) = loaded.expression(&of, "--of", terminal) else {
        return Ok(EXIT_WRONG);
    };
    let Some(wrt) = targets(args, loaded, &expr, terminal)? else {
        return Ok(EXIT_WRONG);
    };
    let names: Vec<String> = wrt.into_iter().map(|(name, _)| name).collect();
    if names.is_empty() {
        return Err(Diagnostic::error("dscene::cli::wrt", format!("no param reaches `{of}`"))
            .help("name one with --wrt, or a numeric field such as --wrt lamp.radiance"));
    }
    let watch = Stopwatch::start();
    let mut saved: Vec<String> = Vec::new();
    for name in &names {
        if world::interrupted() {
            return Ok(interrupted(terminal));
        }
        let Some(derivative) = loaded.expression(&format!("jvp({of}, {name})"), "--wrt", terminal) else {
            return Ok(EXIT_WRONG);
        };
        let value = loaded.engine.eval(&derivative)?;
        let path = if names.len() == 1 { path.to_path_buf() } else { with_suffix(path, name) };
        let path = in_folder(args.common.out.as_deref(), &path)?;
        let written = loaded.engine.stoppable(|| save_value(&value, &derivative.ty, &path))?;
        for lost in written.map_err(|e| cannot_save(&path, e))? {
            let text = loaded.engine.program().sources.text(derivative.span);
            loaded.engine.warn_once(derivative.span, lost.kind(), lost_warning(&lost, &path, text));
        }
        terminal.note(&format!("saved {}: ∂({of})/∂{name}", path.display()));
        saved.push(path.display().to_string());
    }
    if args.common.json {
        let seconds = watch.elapsed().wall;
        let object = json!({"file": args.file.display().to_string(), "of": of, "saved": saved, "seconds": seconds});
        out::line(&object.to_string());
    }
    Ok(0)
}

/// `d.exr` → `d-height.exr`
fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let stem = path.file_stem().map_or(String::new(), |s| s.to_string_lossy().into_owned());
    let extension = path.extension().map_or(String::new(), |e| format!(".{}", e.to_string_lossy()));
    path.with_file_name(format!("{stem}-{suffix}{extension}"))
}
