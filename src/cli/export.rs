//! `dsl export`

use std::collections::HashMap;
use std::io;
use std::path::{Path, PathBuf};

use serde::{Serialize, Serializer};
use serde_json::json;

use super::args::{ExportArgs, ExportFormat};
use super::render::{cannot_save, in_folder, interrupted};
use super::script::{found_script, script_of_report};
use super::{EXIT_WRONG, Terminal, out};
use crate::check::types::Ty;
use crate::check::{self, Disk, Loader};
use crate::data::{npy, safetensors, table};
use crate::diag::Diagnostic;
use crate::eval::{Engine, EngineOptions, INTERRUPTED};
use crate::files::write_atomically;
use crate::natives::value::{LightValue, MeshValue, Value as Made};
use crate::session::folder::{Nested, cannot_write};
use crate::session::record::Step;
use crate::session::save::{image_of, save_value};
use crate::session::show::digits;
use crate::session::{Checkpoint, RunInfo, Runner, StepOfRun, World, world};
use crate::source::SourceMap;
use crate::tape::{Tensor, Var};

/// Params by the names that the script has for them.
type Params = Vec<(String, Tensor)>;

/// Their numbers, in the order of their declarations.
struct InOrder<'a>(&'a Params);

impl Serialize for InOrder<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.iter().map(|(name, t)| (name, Nested { shape: &t.shape, data: &t.data })))
    }
}

pub fn run(args: &ExportArgs) -> u8 {
    let mut terminal = Terminal::new(&args.common);
    match world::listening(|| export(args, &mut terminal)) {
        Ok(()) => 0,
        Err(told) if told.0.code == INTERRUPTED => interrupted(&mut terminal),
        Err(told) => {
            let (diagnostic, sources) = *told;
            terminal.diagnostic(&diagnostic, &sources);
            EXIT_WRONG
        }
    }
}

/// The script of a run with the values at its last checkpoint as initial ones, for its report.
pub fn script_of(run: &Path) -> Result<Option<String>, Told> {
    let checkpoint = Checkpoint::read(run).map_err(plain)?;
    let params = checkpoint.state().params();
    let mut engine = resumed(None, run, &checkpoint, &params)?;
    let text = script_of_report(&mut engine, &checkpoint.settings.overrides);
    text.map_err(|told| Box::new((told, engine.program().sources.clone())))
}

/// What is wrong, and the texts that it points into.
pub type Told = Box<(Diagnostic, SourceMap)>;

fn plain(told: Diagnostic) -> Told {
    Box::new((told, SourceMap::default()))
}

fn export(args: &ExportArgs, terminal: &mut Terminal) -> Result<(), Told> {
    let checkpoint = Checkpoint::read(&args.run).map_err(plain)?;
    checkpoint.note_inputs();
    let mut engine = None;
    let params = match args.step.or(last_step(&args.run, &checkpoint, terminal).map_err(plain)?) {
        None => checkpoint.state().params(),
        Some(step) => at_step(&args.run, &checkpoint, step, &mut engine, terminal)?,
    };
    if args.script {
        let mut engine = resumed(engine, &args.run, &checkpoint, &params)?;
        // What is printed is put beside the script.
        let script = found_script(&mut engine, &checkpoint.settings.overrides, args.out.as_deref());
        let script = script.map_err(|told| Box::new((told, engine.program().sources.clone())))?;
        deliver(args, "script.dscene", script.text.as_bytes(), terminal).map_err(plain)?;
        tell_lost(&script.lost, terminal);
        return Ok(());
    }
    match args.format {
        ExportFormat::Json => {
            let text = serde_json::to_string(&InOrder(&params)).unwrap_or_default();
            deliver(args, "params.json", format!("{text}\n").as_bytes(), terminal).map_err(plain)
        }
        ExportFormat::Safetensors => {
            let bytes = safetensors::encode(params.iter().map(|(name, tensor)| (name.as_str(), tensor)));
            let folder = folder(args, "a file").map_err(plain)?;
            write(folder, "params.safetensors", &bytes, terminal).map_err(plain)
        }
        ExportFormat::Npy => each(args, params, "npy", |tensor| Ok(Some(npy::encode(tensor))), terminal),
        ExportFormat::Csv => each(args, params, "csv", |tensor| rows(tensor).map(Some), terminal),
        ExportFormat::Exr => pictures(args, params, terminal),
        ExportFormat::Obj | ExportFormat::Ply | ExportFormat::Glb => {
            let ending = match args.format {
                ExportFormat::Obj => "obj",
                ExportFormat::Ply => "ply",
                _ => "glb",
            };
            let mut engine = resumed(engine, &args.run, &checkpoint, &params)?;
            meshes(args, &mut engine, ending, terminal)
        }
    }
}

/// The last step of the log of a run that was killed before a checkpoint had what it found.
fn last_step(run: &Path, checkpoint: &Checkpoint, terminal: &mut Terminal) -> Result<Option<u64>, Diagnostic> {
    if !checkpoint.state().moved.is_empty() {
        return Ok(None);
    }
    let last = Step::all(run)?.last().map(|line| line.step);
    if let Some(step) = last {
        terminal.note(&format!("no checkpoint has what the run found: these are the params of its step {step}"));
    }
    Ok(last)
}

/// Tells which files a script that was written to another folder does not find from there.
pub(super) fn tell_lost(lost: &[String], world: &mut dyn World) {
    if !lost.is_empty() {
        let lost: Vec<String> = lost.iter().map(|text| format!("`{text}`")).collect();
        let message = format!("paths are looked for from the script's new folder, also by {}", lost.join(", "));
        let told = Diagnostic::warning("dscene::file::missing", message)
            .help("put beside the script what these read, or write their paths out");
        world.diagnostic(&told, &SourceMap::default());
    }
}

// ---- where it goes -------------------------------------------------------------------------------------------------

/// To standard output, or into the folder that was asked for.
fn deliver(args: &ExportArgs, name: &str, text: &[u8], terminal: &mut Terminal) -> Result<(), Diagnostic> {
    match &args.out {
        None => out::print(&String::from_utf8_lossy(text)),
        Some(folder) => write(folder, name, text, terminal)?,
    }
    Ok(())
}

fn folder<'a>(args: &'a ExportArgs, what: &str) -> Result<&'a Path, Diagnostic> {
    args.out.as_deref().ok_or_else(|| {
        Diagnostic::error("dscene::export::folder", format!("this format becomes {what}"))
            .help("say where it goes: `--out DIR`")
    })
}

fn write(folder: &Path, name: &str, bytes: &[u8], terminal: &mut Terminal) -> Result<(), Diagnostic> {
    let path = in_folder(Some(folder), Path::new(name))?;
    write_atomically(&path, bytes).map_err(|e| cannot_write(&path, &e))?;
    terminal.note(&format!("saved {}", path.display()));
    Ok(())
}

/// A file for each param that has such a one.
fn each(
    args: &ExportArgs,
    params: Params,
    ending: &str,
    encode: impl Fn(&Tensor) -> Result<Option<Vec<u8>>, Diagnostic>,
    terminal: &mut Terminal,
) -> Result<(), Told> {
    let folder = folder(args, "a file for each param").map_err(plain)?;
    for (name, tensor) in params {
        if let Some(bytes) = encode(&tensor).map_err(plain)? {
            write(folder, &format!("{name}.{ending}"), &bytes, terminal).map_err(plain)?;
        }
    }
    Ok(())
}

/// A table with a line for each entry of the first dimension.
fn rows(tensor: &Tensor) -> Result<Vec<u8>, Diagnostic> {
    let columns = tensor.shape.iter().skip(1).product::<usize>().max(1);
    let rows: Vec<Vec<String>> =
        tensor.data.chunks(columns).map(|row| row.iter().map(|x| exact(*x)).collect()).collect();
    table::encode(None, &rows).map_err(|why| Diagnostic::error("dscene::export::table", why))
}

/// A number to its last bit.
fn exact(x: f64) -> String {
    if x.is_finite() { json!(x).to_string() } else { digits(x) }
}

/// Params that are pictures: rows of pixels of up to four numbers.
fn pictures(args: &ExportArgs, params: Params, terminal: &mut Terminal) -> Result<(), Told> {
    let folder = folder(args, "a file for each picture").map_err(plain)?;
    let pictures: Vec<(String, Made)> =
        params.into_iter().map(|(name, tensor)| (name, Made::Image(Var::constant(tensor)))).collect();
    let pictures: Vec<_> = pictures.into_iter().filter(|(_, picture)| image_of(picture).is_some()).collect();
    if pictures.is_empty() {
        let told = Diagnostic::error("dscene::export::picture", "no param of the run is a picture");
        return Err(plain(told.help("that is `height` × `width` × 1 to 4 numbers; `--format npy` takes any")));
    }
    let ty = Ty::Image { height: None, width: None, channels: None, made: Default::default() };
    for (name, picture) in pictures {
        save(&picture, &ty, folder, &format!("{name}.exr"), terminal).map_err(plain)?;
    }
    Ok(())
}

fn save(value: &Made, ty: &Ty, folder: &Path, name: &str, terminal: &mut Terminal) -> Result<(), Diagnostic> {
    let path = in_folder(Some(folder), Path::new(name))?;
    save_value(value, ty, &path).map_err(|e| cannot_save(&path, e))?;
    terminal.note(&format!("saved {}", path.display()));
    Ok(())
}

/// What the script makes of the params: its meshes, shapes and area lights that move with them.
fn meshes(args: &ExportArgs, engine: &mut Engine, ending: &str, terminal: &mut Terminal) -> Result<(), Told> {
    let folder = folder(args, "a file for each mesh").map_err(plain)?;
    let fields: Vec<String> =
        engine.state().moved.iter().filter_map(|p| Some(p.shown.split_once('.')?.0.to_owned())).collect();
    let mut saved = 0;
    for id in engine.program().ids().collect::<Vec<_>>() {
        let decl = engine.program().decl(id);
        let is_mesh = decl.user && matches!(decl.ty, Ty::Mesh | Ty::Shape | Ty::Light);
        let name = decl.name.clone();
        if !is_mesh || decl.body.is_none() {
            continue;
        }
        let value = engine.eval_decl(id).map_err(|told| Box::new((told, engine.program().sources.clone())))?;
        let Some(mesh) = mesh_of(&value) else { continue };
        let numbers = [Some(&mesh.vertices), mesh.normals.as_ref(), mesh.uvs.as_ref(), mesh.colors.as_ref()];
        if numbers.into_iter().flatten().any(Var::is_live) || fields.contains(&name) {
            save(&Made::Mesh(mesh), &Ty::Mesh, folder, &format!("{name}.{ending}"), terminal).map_err(plain)?;
            saved += 1;
        }
    }
    if saved > 0 {
        return Ok(());
    }
    let told = Diagnostic::error("dscene::export::mesh", "no mesh of the script moves with what the run has found");
    Err(plain(told.help("`--format json` gives the params as numbers")))
}

fn mesh_of(value: &Made) -> Option<std::sync::Arc<MeshValue>> {
    match value {
        Made::Mesh(mesh) => Some(mesh.clone()),
        Made::Shape(shape) => Some(shape.mesh.clone()),
        Made::Light(light) => match &**light {
            LightValue::Area { mesh, .. } => Some(mesh.clone()),
            _ => None,
        },
        _ => None,
    }
}

// ---- what it is ----------------------------------------------------------------------------------------------------

/// The params at a step: from the log, if that has all of them; else the steps are taken again.
fn at_step(
    run: &Path,
    checkpoint: &Checkpoint,
    step: u64,
    engine: &mut Option<Engine>,
    terminal: &mut Terminal,
) -> Result<Params, Told> {
    let (place, logged) = logged(run, step).map_err(plain)?;
    if checkpoint.state().moved.iter().all(|p| logged.iter().any(|(name, _)| *name == p.shown)) {
        return Ok(logged);
    }
    let recorded = Recorded::of(run, checkpoint).map_err(plain)?;
    let changes = checkpoint.changes(checkpoint.script_folder(), &recorded.paths());
    if !changes.is_empty() {
        let why = format!("the way to that step cannot be taken again: {}", changes.join(", "));
        let told = Diagnostic::error("dscene::export::step", why);
        return Err(plain(told.help("undo the change, or leave out `--step` for the params at the last checkpoint")));
    }
    let engine = engine.insert(recorded.engine(checkpoint)?);
    terminal.note("the log does not have all params: their way to that step is taken again");
    let actions = engine.program().actions.clone();
    let mut runner = Runner::new(engine, terminal);
    runner.steps = checkpoint.settings.steps;
    let came = runner.replay(&actions, place);
    let pointed = |told: Diagnostic| Box::new((told, engine.program().sources.clone()));
    match came.map_err(pointed)? {
        Some(true) => {
            let mut params = engine.state().params();
            // A field that is about to move for the first time.
            params.extend(
                logged
                    .into_iter()
                    .filter(|(name, _)| params.iter().all(|(known, _)| known != name))
                    .collect::<Params>(),
            );
            Ok(params)
        }
        Some(false) => {
            Err(plain(Diagnostic::error("dscene::export::step", "the run does not come to that step again")))
        }
        None => Err(plain(Diagnostic::error(INTERRUPTED, "interrupted"))),
    }
}

/// Which step of the run it is, and the params at it that the log has: those of few numbers.
fn logged(run: &Path, step: u64) -> Result<(StepOfRun, Params), Diagnostic> {
    let mut steps = Step::all(run)?;
    let at = steps.iter().rposition(|line| line.step == step).ok_or_else(|| {
        Diagnostic::error("dscene::export::step", format!("the log has no step {step}"))
            .help("steps count from 0 in each `optimize`; the last one that has it is taken")
    })?;
    // Each optimisation begins with a step 0.
    let nth = steps[..=at].iter().filter(|line| line.step == 0).count().saturating_sub(1);
    Ok((StepOfRun { nth, step }, std::mem::take(&mut steps[at].params)))
}

// ---- the program ---------------------------------------------------------------------------------------------------

/// The texts of a run as they were when it began, whatever has become of the files since; by their full paths.
struct Recorded {
    main: PathBuf,
    texts: HashMap<PathBuf, String>,
}

impl Loader for Recorded {
    fn read(&self, path: &Path) -> io::Result<String> {
        self.texts.get(&check::normal(path)).map_or_else(|| Disk.read(path), |text| Ok(text.clone()))
    }

    fn exists(&self, path: &Path) -> bool {
        self.texts.contains_key(&check::normal(path)) || Disk.exists(path)
    }
}

impl Recorded {
    fn of(run: &Path, checkpoint: &Checkpoint) -> Result<Recorded, Diagnostic> {
        let sources = RunInfo::read(run)?.sources;
        // Names are as they were given where the run was started; the script's folder is known wherever that was.
        let file = Path::new(&checkpoint.settings.file);
        let beside = file.parent().unwrap_or(Path::new(""));
        let place =
            |name: &Path| check::normal(&checkpoint.script_folder().join(name.strip_prefix(beside).unwrap_or(name)));
        let texts = sources.into_iter().map(|source| (place(Path::new(&source.file)), source.text));
        Ok(Recorded { main: place(file), texts: texts.collect() })
    }

    fn paths(&self) -> Vec<&Path> {
        self.texts.keys().map(PathBuf::as_path).collect()
    }

    /// The program as it began.
    fn engine(&self, checkpoint: &Checkpoint) -> Result<Engine, Told> {
        let settings = &checkpoint.settings;
        let overrides: Vec<(String, String)> =
            settings.overrides.iter().map(|o| (o.name.clone(), o.value.clone())).collect();
        let checked = check::check(&self.main, &overrides, self);
        let Some(program) = checked.program.filter(|_| !checked.diagnostics.iter().any(Diagnostic::is_error)) else {
            let first = checked.diagnostics.into_iter().find(Diagnostic::is_error);
            let first = first.unwrap_or_else(|| Diagnostic::error("dscene::export::record", "the script is wrong"));
            return Err(Box::new((first, checked.sources)));
        };
        let base_dir = checkpoint.script_folder().to_path_buf();
        let options = EngineOptions { seed: settings.seed, base_dir, interrupt: Some(world::interrupt_flag()) };
        Ok(Engine::new(program, options))
    }
}

/// An engine with the params that are exported: one that has come there, or a new one.
fn resumed(engine: Option<Engine>, run: &Path, checkpoint: &Checkpoint, params: &Params) -> Result<Engine, Told> {
    let came = engine.is_some();
    let mut engine = match engine {
        Some(engine) => engine,
        None => Recorded::of(run, checkpoint).map_err(plain)?.engine(checkpoint)?,
    };
    if !came {
        let placed = engine.restore(checkpoint.state()).and_then(|()| {
            let state = checkpoint.state().moved.iter();
            let mut values = state.filter_map(|p| Some((p, &params.iter().find(|(name, _)| *name == p.shown)?.1)));
            values.try_for_each(|(p, value)| engine.place(p, value.clone()))
        });
        placed.map_err(|told: Diagnostic| Box::new((told, engine.program().sources.clone())))?;
    }
    Ok(engine)
}
