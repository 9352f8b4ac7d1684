//! `dsl render`

use std::path::{Path, PathBuf};

use serde_json::json;

use super::args::RenderArgs;
use super::run::name_of;
use super::{EXIT_INTERRUPTED, EXIT_WRONG, Terminal, load, out};
use crate::check::hir::{self, DeclKind};
use crate::diag::{self, Diagnostic};
use crate::eval;
use crate::files::is_run_file;
use crate::session::clock::{Stopwatch, human_seconds};
use crate::session::folder::{cannot_write, spare_inputs};
use crate::session::run::tell_warnings;
use crate::session::save::{SaveError, lost_warning, save_value};
use crate::session::{World, world};

pub fn run(args: &RenderArgs) -> u8 {
    let mut terminal = Terminal::new(&args.common);
    let Some(mut loaded) = load(&args.file, &args.common, &mut terminal) else {
        return EXIT_WRONG;
    };
    let sources = loaded.engine.program().sources.clone();
    let camera = match choose_camera(loaded.engine.program(), args.camera.as_deref()) {
        Ok(camera) => camera,
        Err(diagnostic) => {
            terminal.diagnostic(&diagnostic, &sources);
            return EXIT_WRONG;
        }
    };
    let spp = args.spp.map_or(String::new(), |n| format!(", spp: {n}"));
    let Some(expr) = loaded.expression(&format!("render({camera}{spp})"), "render", &mut terminal) else {
        return EXIT_WRONG;
    };
    let watch = Stopwatch::start();
    let result = world::listening(|| {
        let path = output(args)?;
        let value = loaded.engine.eval(&expr)?;
        // Only now all files are known that the script reads.
        writable(&path)?;
        let saved = loaded.engine.stoppable(|| save_value(&value, &expr.ty, &path))?;
        let lost = saved.map_err(|e| cannot_save(&path, e))?;
        for lost in lost {
            let text = loaded.engine.program().sources.text(expr.span);
            loaded.engine.warn_once(expr.span, lost.kind(), lost_warning(&lost, &path, text));
        }
        Ok::<_, Diagnostic>((value, path))
    });
    let seconds = watch.elapsed().wall;
    tell_warnings(&mut loaded.engine, &mut terminal);
    match result {
        Ok((value, path)) => {
            if args.common.json {
                let shape = value.var().map_or(Vec::new(), |v| v.shape().to_vec());
                let object = json!({
                    "file": args.file.display().to_string(), "camera": camera, "saved": [path.display().to_string()],
                    "shape": shape, "seconds": seconds,
                });
                out::line(&object.to_string());
            } else {
                let text = eval::brief(&value, &expr.ty);
                terminal.note(&format!("{text}\nsaved {} in {}", path.display(), human_seconds(seconds)));
            }
            0
        }
        Err(diagnostic) if diagnostic.code == eval::INTERRUPTED => interrupted(&mut terminal),
        Err(diagnostic) => {
            let sources = loaded.engine.program().sources.clone();
            terminal.diagnostic(&diagnostic, &sources);
            EXIT_WRONG
        }
    }
}

/// The `-o` file (below `--out` if that is given), by default the script's name with `.exr`.
fn output(args: &RenderArgs) -> Result<PathBuf, Diagnostic> {
    let file = args.output.clone().unwrap_or_else(|| format!("{}.exr", name_of(&args.file)).into());
    in_folder(args.common.out.as_deref(), &file)
}

/// Refuses a path at which an output would replace an input, or the record of a run.
pub fn writable(path: &Path) -> Result<(), Diagnostic> {
    if path.file_name().is_some_and(|name| is_run_file(&name.to_string_lossy())) {
        let message =
            format!("cannot write `{}`: this is the name of a file in which a run is recorded", path.display());
        return Err(Diagnostic::error("dscene::run::write", message).help("give the output another name"));
    }
    spare_inputs(path)
}

/// A file below the `--out` folder, which is made if it is not there. Inputs are spared.
pub fn in_folder(folder: Option<&Path>, file: &Path) -> Result<PathBuf, Diagnostic> {
    let path = match folder {
        None => file.to_path_buf(),
        Some(folder) => {
            std::fs::create_dir_all(folder).map_err(|e| no_folder(folder, file, &e))?;
            folder.join(file)
        }
    };
    writable(&path)?;
    Ok(path)
}

/// Why a folder could not be made for a file.
fn no_folder(folder: &Path, file: &Path, error: &std::io::Error) -> Diagnostic {
    if !folder.is_file() {
        return cannot_write(folder, error);
    }
    let message = format!("cannot write into `{}`: it is a file, and `--out` names a folder", folder.display());
    let help = format!("name a folder, into which `{}` is written: `--out DIR`", file.display());
    Diagnostic::error("dscene::run::write", message).help(help)
}

/// What Ctrl-C leaves to say.
pub fn interrupted(terminal: &mut Terminal) -> u8 {
    terminal.note("interrupted");
    EXIT_INTERRUPTED
}

/// A failed [`save_value`] as a diagnostic without a place in the script.
pub fn cannot_save(path: &Path, error: SaveError) -> Diagnostic {
    match error {
        SaveError::Io(e) => cannot_write(path, &e),
        SaveError::Other { message, help } => Diagnostic::error("dscene::run::save", message).help(help),
    }
}

/// The names of a file's cameras.
pub fn cameras(program: &hir::Program) -> Vec<String> {
    let is_camera = |id: &_| {
        let decl = program.decl(*id);
        decl.user && matches!(decl.kind, DeclKind::Kind("camera"))
    };
    program.ids().filter(is_camera).map(|id| program.decl(id).name.clone()).collect()
}

/// The camera of that name; without one, the file's first.
pub fn choose_camera(program: &hir::Program, wanted: Option<&str>) -> Result<String, Diagnostic> {
    let cameras = cameras(program);
    match (wanted, cameras.first()) {
        (Some(name), _) if cameras.iter().any(|c| c == name) => Ok(name.to_owned()),
        (Some(name), _) => {
            let message = format!("there is no camera `{name}`");
            let names = cameras.iter().map(String::as_str);
            Err(Diagnostic::error("dscene::cli::camera", message).help_opt(diag::did_you_mean(
                name,
                "the cameras are",
                names,
            )))
        }
        (None, Some(first)) => Ok(first.clone()),
        (None, None) => Err(Diagnostic::error("dscene::cli::camera", "the script declares no camera").help(
            "declare one: `camera eye { position: [0, 2, -5], look_at: [0, 0, 0], fov: 45deg, film: [256, 256] }`",
        )),
    }
}
