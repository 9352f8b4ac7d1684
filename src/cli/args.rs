//! The command line's grammar (clap) and its help.

use std::ops::Deref;
use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};

use crate::session::Override;

/// Inverse rendering in a language of its own: scenes, unknowns, losses, optimisers.
#[derive(Debug, Parser)]
#[command(name = "dsl", version, about, arg_required_else_help = true)]
#[command(after_help = "\
Examples:
  dsl run examples/03_shadow_blocker.dscene          pull an occluder into place by its shadow
  dsl check scene.dscene                             all errors and warnings, nothing rendered
  dsl render scene.dscene -o out.png --spp 64        one picture
  dsl grad scene.dscene --repeats 32 --fd            gradients against finite differences
  dsl repl scene.dscene                              ask it questions
  dsl watch scene.dscene                             see it in the browser while you edit it

Exit codes: 0 success, 1 the script is wrong or an `expect` failed, 2 bad usage, 130 interrupted.")]
pub struct Cli {
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Checks a script, then runs its actions in order; writes a run folder
    #[command(after_help = "\
Examples:
  dsl run scene.dscene                               into runs/scene-TIMESTAMP/
  dsl run scene.dscene --out result --seed 7         into result/, with other random samples
  dsl run scene.dscene --out result --force          the same once more, in place of the run that is there
  dsl run scene.dscene --set spp=16 --steps 20       override a declaration, shorten the optimisation
  dsl run scene.dscene --resume result               go on with what was interrupted or killed
  dsl run scene.dscene --live                        with a page that shows it: pictures, losses, pause and stop
  dsl run scene.dscene --timings                     and where the time went: load, build, render, gradient, loss, save

The run folder holds run.json (script, imports, overrides, version, seed), log.jsonl (one object per step), checkpoint.bin
(what --resume goes on from), report.html (a page about the run, from report.jsonl and the others) and what the script saves. A line of
the log has step, of (the loss), stage, loss, loss_error (where a solver measures it), lr, grad_norm, gradients (by param: norm, and
standard error as steps differ), skipped_steps, samples, bytes (of memory), seconds, phases (where they went), the params of up to 64
numbers, and of larger ones mean, least and most (ranges); all but bytes, seconds and phases follow from the seed. Angles are in radians. With --json, each line of standard output is one object: {\"event\": \"print\", \"text\": …}, and at the end
{\"event\": \"done\", \"exit\": …, \"out\": …, \"steps\": …, \"saved\": […], …}. Ctrl-C ends after the current step with exit code 130; a second one ends at once.")]
    Run(RunArgs),
    /// Runs a script under every combination of values and seeds; makes a table
    #[command(after_help = "\
Examples:
  dsl sweep scene.dscene --set lr=0.01,0.03,0.1 --seeds 5     three values, five seeds each: fifteen runs
  dsl sweep scene.dscene --set spp=1..5 --set 'eye.film=[32, 32],[64, 64]' --jobs 4
  dsl sweep scene.dscene --jobs 8 --prune            the `sweep lr in [0.01, 0.1], seed in 0..5 { … }` of the script
  dsl sweep scene.dscene --shard 2/10                the second of ten processes that share the work, and a folder

The values of --set are what stands between the brackets of a list, or a range. They take the place of what the script declares, and of
the values of a variable of its own `sweep`. Each run has a folder below runs/NAME-sweep (or --out), named by its values. The same command
goes on where it was interrupted or killed: what has finished is not run again, more values and seeds may be added, and the result is the
same to the bit. journal.jsonl has a line for each run that begins or ends; table.csv and table.json have the means over seeds with their
standard errors, and compare.html shows the curves of up to 60 runs. In the table, * marks the least of a column, or the largest of one that is reported by `maximize(…)`. Its columns are what the script says (`report { error: …, seconds }`; an angle is in
degrees, and its column is named so: `tilt (deg)`), else the losses at the end and the seconds. --prune stops runs whose loss is worse than the median of at least three finished ones after the
same share of their steps, by more than the noise of both (median stopping rule, Golovin et al. 2017): not before a third of the steps, not
if another seed has ended among the better half, and compared with runs that begin with the same loss alone. Exits with 1 if a run diverged, failed or has a failed
`expect`; all others are run all the same. With --json, standard output gets one object for each run that ends, and one at the end.")]
    Sweep(SweepArgs),
    /// Reports all errors and warnings without running anything
    #[command(after_help = "\
Examples:
  dsl check scene.dscene other.dscene
  dsl check --json scene.dscene                      one JSON object per diagnostic
  dsl check --estimate scene.dscene                  how long each action will take, and how much memory
  dsl check --deps scene.dscene                      what it reads, as a rule for Make: runs/scene: scene.dscene lib.dscene …

Exits with 1 if there are errors; warnings alone are no failure. --estimate rehearses the script: everything is evaluated, but renderings
see a small film with few samples, from which is reckoned what film, samples, bounces, triangles and steps will take; a range says how far
off that may be, and an action that fails makes it exit with 1. With --json it is {\"file\": …, \"estimate\": {\"seconds\": {\"low\", \"expected\",
\"high\"}, \"bytes\": …, \"actions\": […]}}, and --deps is {\"file\": …, \"target\": …, \"deps\": [FILE], \"unknown\": [TEXT]}: what names files only
when it runs. The target is --out, or else runs/NAME.")]
    Check(CheckArgs),
    /// Runs the tests that scripts hold: `test "name" { let … expect … }`
    #[command(after_help = "\
Examples:
  dsl test lib/studio.dscene                         every test of a file
  dsl test .                                         of every script in and below a folder
  dsl test lib --filter lamp                         those with `lamp` in their names

A test stands beside the functions that it tests. It sees the declarations of its file, with params at their initial values, and what it
declares itself by `let`; `dsl run` and imports pass over it. A line tells what became of each, and each `expect` that fails is shown
with the values that it compared. Exits with 1 if a test fails or a script is wrong, with 2 if no test has the name that is asked for.
With --json, standard output gets {\"event\": \"test\", \"file\": …, \"name\": …, \"holds\": …, \"expects\": N, \"failures\": […], \"seconds\": …}
for each, and at the end {\"event\": \"done\", \"exit\": …, \"tests\": N, \"failed\": N, \"wrong_files\": N}.")]
    Test(TestArgs),
    /// Lays scripts out anew, in place
    #[command(after_help = "\
Examples:
  dsl fmt scene.dscene                               rewritten, if that changes it; its name is printed
  dsl fmt --check .                                  what would change in all scripts of a folder; exits with 1 if something would
  dsl fmt - < scene.dscene                           from standard input to standard output, as editors want it

Lines have at most 100 columns; comments, blank lines between groups (one) and how numbers and strings are written stay. A block that was
written on one line stays on it if it fits there. A file with a mistake in it is told and left as it is. With --json, standard output gets
one object a file: {\"file\": …, \"changed\": …}, with \"text\" for standard input, and one for each error.")]
    Fmt(FmtArgs),
    /// Renders one image
    #[command(after_help = "\
Examples:
  dsl render scene.dscene                            the file's only camera (or its first), into scene.exr
  dsl render scene.dscene --camera side --spp 256 -o side.png
  dsl render scene.dscene --set eye.film='[64, 64]'  with a field overridden

The extension says the format: .exr and .hdr keep linear radiance, .png is sRGB. With --json, standard output gets one
object: {\"file\": …, \"camera\": …, \"saved\": [FILE], \"shape\": [height, width, channels], \"seconds\": …}, or standard error
one object for each diagnostic.")]
    Render(RenderArgs),
    /// Derivatives of a scalar, with standard errors
    #[command(after_help = "\
Examples:
  dsl grad scene.dscene                              the only loss, every param that reaches it
  dsl grad scene.dscene --of 'mean(render(eye))' --wrt corners --repeats 32
  dsl grad scene.dscene --fd --repeats 64            beside central finite differences, with z-scores
  dsl grad scene.dscene --json                       one JSON object, a stable schema
  dsl grad scene.dscene --wrt height --image d.exr   the image of ∂pixel/∂height (of the first camera)

Each repeat has its own seed. `std` is the spread of one evaluation, `std_error` that of the mean;
one repeat knows neither.")]
    Grad(GradArgs),
    /// Begins a project: a script that runs, functions, a mesh, a README
    #[command(after_help = "\
Examples:
  dsl new shadows && dsl run shadows/main.dscene

The folder must be empty or not there yet.")]
    New(NewArgs),
    /// Prints the value of an expression
    #[command(after_help = "\
Examples:
  dsl eval scene.dscene 'mean(render(eye, spp: 16))'
  dsl eval scene.dscene corners[0] --json            {\"value\": …, \"type\": \"…\", \"seconds\": …}

In JSON angles are in radians: \"unit\": \"rad\" says so of an angle and of arrays of them, the type which fields are angles.")]
    Eval(EvalArgs),
    /// What a run has found: its params as numbers, the meshes that they make, or the script with them
    #[command(after_help = "\
Examples:
  dsl export runs/scene-20261121-093312              the params at the last checkpoint, as JSON
  dsl export RUN --step 20                           those of a step (steps count from 0 in each `optimize`)
  dsl export RUN --format npy --out found            each param in a file of its own, found/NAME.npy
  dsl export RUN --format glb --out found            each mesh, shape and area light that params move, found/NAME.glb
  dsl export RUN --script > found.dscene             the script as it was run, with the found values as initial ones

Angles are in radians. A run writes checkpoints every 30 seconds (`dsl run --checkpoint N`: every N steps), when it is interrupted, and at its end. The log
has the params of each step that have up to 64 numbers; for larger ones the steps are taken again, from the first one on.")]
    Export(ExportArgs),
    /// The page about a run, made again: of one that was killed or goes on
    #[command(after_help = "\
Examples:
  dsl report runs/scene-20261121-093312              RUN/report.html
  dsl report RUN -o page.html

`dsl run` writes report.html at its end, however it ends, but for a kill.")]
    Report(ReportArgs),
    /// What differs between runs: settings, scripts, curves, results, images; as a table and as a page
    #[command(after_help = "\
Examples:
  dsl compare runs/scene-*                           a table, and compare.html
  dsl compare a b -o page.html                       with the page at another place
  dsl compare a b --json                             {\"saved\": FILE, \"runs\": [{\"folder\": …, \"settings\": …, \"loss\": …, \"params\": …}]}

The page needs no network. Runs may be going on.")]
    Compare(CompareArgs),
    /// An interactive session: declarations, expressions, gradients
    #[command(after_help = "\
Examples:
  dsl repl scene.dscene
  echo 'grad(loss)' | dsl repl scene.dscene
  dsl repl --json scene.dscene                       for programs: a JSON object on a line for each entry

Type :help inside. Images are drawn as the terminal knows it; DSCENE_IMAGES=kitty, iterm, sixel or blocks decides it. With --json an answer
has value, type, unit and name (_1), or declared, printed and so on, and always entry, ok and diagnostics; --out DIR saves images there.")]
    Repl(ReplArgs),
    /// Shows a script in the browser as it is edited
    #[command(after_help = "\
Examples:
  dsl watch scene.dscene                             prints the address to open
  dsl watch scene.dscene --spp 256 --port 8000       finer pictures; the first free port from 8000 on

The page renders anew whenever the script, an import or a file that it reads is saved: only what the edit reaches, at first with few
samples. Drag the picture to turn the camera, with the right button (or two fingers) to shift it, scroll to come nearer, and copy the
camera's line into the script. Params have sliders, and show the derivative of the picture with respect to each of their numbers.
`Start` takes the steps of the script's `optimize`, which can be paused; nothing is saved. The page is for this machine only, and for
who knows its address. Ctrl-C ends it.")]
    Watch(WatchArgs),
    /// Serves editors by the language server protocol, on standard input and output
    #[command(after_help = "\
Started by an editor, not by hand; docs/editors.md says how to set up VS Code, Helix, Neovim, Zed and Emacs.")]
    Lsp,
    /// The standard library: what it declares, with text and example
    #[command(after_help = "\
Examples:
  dsl doc                                            all names, by module
  dsl doc blur                                       one of them
  dsl doc std.image                                  a whole module

With --json, one object for each name: {\"name\": …, \"module\": …, \"head\": …, \"text\": …, \"example\": …}.")]
    Doc(DocArgs),
    /// What a diagnostic means, and why: with a script that is wrong and one that is right
    #[command(after_help = "\
Examples:
  dsl explain dscene::type::unit
  dsl explain unused_param                           the end of a code is enough, if no other ends so
  dsl explain                                        lists all codes

With --json, standard output gets an object for each page: {\"code\": …, \"title\": …, \"text\": …, \"wrong\": SCRIPT, \"right\": SCRIPT}.")]
    Explain(ExplainArgs),
    /// What the program and the machine are: version, processor, memory
    Info(InfoArgs),
    /// Completion of commands and options for a shell, to standard output
    #[command(after_help = "\
Examples:
  dsl completions bash > ~/.local/share/bash-completion/completions/dsl
  dsl completions zsh > ~/.zfunc/_dsl                a folder of $fpath
  dsl completions fish > ~/.config/fish/completions/dsl.fish")]
    Completions(CompletionsArgs),
    /// Writes manual pages, one for each command
    #[command(after_help = "\
Examples:
  dsl man ~/.local/share/man/man1 && man dsl-run")]
    Man(ManArgs),
}

/// How diagnostics are written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum DiagnosticFormat {
    #[default]
    Full,
    Short,
    Json,
}

/// What every command takes: how it speaks.
#[derive(Clone, Debug, Default, Args)]
pub struct Output {
    /// No progress bar, no notes, and of warnings only those of results that are not what they seem
    #[arg(long, short)]
    pub quiet: bool,
    /// Machine-readable output
    #[arg(long)]
    pub json: bool,
    /// How errors and warnings are shown: with the lines that they are about, on a line each, or as JSON objects
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t)]
    pub diagnostic_format: DiagnosticFormat,
}

/// What commands take too that compute: how much of the machine they may have.
#[derive(Clone, Debug, Default, Args)]
pub struct Machine {
    /// Worker threads (default: one per core); results do not depend on it
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Memory it may take, such as 8GB (default: half of the machine's); what needs more ends with a diagnostic
    #[arg(long, value_name = "SIZE", value_parser = crate::memory::parse_size)]
    pub memory: Option<u64>,
    #[command(flatten)]
    pub output: Output,
}

/// What commands take too that evaluate a script. The options of all commands are read as if they were its own.
#[derive(Clone, Debug, Default, Args)]
pub struct Common {
    /// Override a declaration, or a field of one (`eye.fov=30deg`); may be repeated
    #[arg(long = "set", value_name = "NAME=EXPR", value_parser = parse_override)]
    pub set: Vec<Override>,
    /// Seed of all random samples
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Of several processes (`mpirun dsl-mpi`), only the first reads files; it gives them to the others
    #[arg(long, hide_short_help = true)]
    pub broadcast: bool,
    /// Folder for what is written
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    pub machine: Machine,
}

impl Deref for Common {
    type Target = Machine;

    fn deref(&self) -> &Machine {
        &self.machine
    }
}

impl Deref for Machine {
    type Target = Output;

    fn deref(&self) -> &Output {
        &self.output
    }
}

#[derive(Clone, Debug, Args)]
pub struct RunArgs {
    /// The script
    pub file: PathBuf,
    /// Steps of each `optimize`, in place of the script's
    #[arg(long, value_name = "N")]
    pub steps: Option<u64>,
    /// Take an `--out` folder that has files in it: an earlier run there is replaced, and a sweep of another script begun anew; with --resume, go on although files have changed
    #[arg(long)]
    pub force: bool,
    /// Go on with a run that was interrupted or killed, to the bit as if it had not been; RUN is its folder
    #[arg(long, value_name = "RUN", conflicts_with_all = ["set", "seed", "steps", "out"])]
    pub resume: Option<PathBuf>,
    /// Write a checkpoint every N steps (default: every 30 seconds)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub checkpoint: Option<u64>,
    /// Write what TensorBoard shows beside the log: `tensorboard --logdir RUN`
    #[arg(long, conflicts_with = "resume")]
    pub tensorboard: bool,
    /// Tell where the time went, statement by statement; with =FILE as trace events too, which ui.perfetto.dev draws
    #[arg(long, value_name = "FILE", num_args = 0..=1, require_equals = true)]
    pub timings: Option<Option<PathBuf>>,
    /// Run the actions once as a part of a sweep, until standard input ends; sweeps begin their runs so
    #[arg(long, hide = true)]
    pub part: bool,
    /// The sweep's folder, in which this run is compared with others and perhaps pruned
    #[arg(long, hide = true, value_name = "DIR")]
    pub compared: Option<PathBuf>,
    /// Show the run in the browser as it goes on; the page has the first free port from PORT on
    #[arg(long, value_name = "PORT", num_args = 0..=1, default_missing_value = "3000", value_parser = clap::value_parser!(u16).range(1..))]
    pub live: Option<u16>,
    #[command(flatten)]
    pub common: Common,
}

#[derive(Debug, Args)]
pub struct SweepArgs {
    /// Run each combination with N seeds, from --seed on
    #[arg(long, value_name = "N", conflicts_with = "resume", value_parser = clap::value_parser!(u64).range(1..))]
    pub seeds: Option<u64>,
    /// Runs at the same time; they share the threads and the memory
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub jobs: u16,
    /// The I-th of N processes that share the runs of one folder
    #[arg(long, value_name = "I/N", value_parser = parse_shard)]
    pub shard: Option<Shard>,
    /// Stop runs that are worse than half of the finished ones, by more than noise
    #[arg(long)]
    pub prune: bool,
    #[command(flatten)]
    pub run: RunArgs,
}

impl From<RunArgs> for SweepArgs {
    fn from(run: RunArgs) -> SweepArgs {
        SweepArgs { seeds: None, jobs: 1, shard: None, prune: false, run }
    }
}

/// Of `count` processes the one with this index, from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    pub index: usize,
    pub count: usize,
}

#[derive(Debug, Args)]
pub struct CheckArgs {
    /// The scripts
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// Tell how long, and how much memory, each action of a script will take
    #[arg(long)]
    pub estimate: bool,
    /// Tell which files a script reads: imports, pictures, meshes, data
    #[arg(long, conflicts_with = "estimate")]
    pub deps: bool,
    #[command(flatten)]
    pub common: Common,
}

#[derive(Debug, Args)]
pub struct ExplainArgs {
    /// The code, as a diagnostic shows it
    pub code: Option<String>,
    #[command(flatten)]
    pub common: Output,
}

#[derive(Debug, Args)]
pub struct NewArgs {
    /// The project's folder
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    #[command(flatten)]
    pub common: Output,
}

#[derive(Debug, Args)]
pub struct DocArgs {
    /// A name of the library, or one of its modules
    pub name: Option<String>,
    /// Adds the pages of the library and of diagnostics to the book that mdBook gives on standard input
    #[arg(long, num_args = 0.., hide = true, value_name = "QUESTION", conflicts_with = "name")]
    pub book: Option<Vec<String>>,
    #[command(flatten)]
    pub common: Output,
}

#[derive(Debug, Args)]
pub struct InfoArgs {
    #[command(flatten)]
    pub common: Machine,
}

#[derive(Debug, Args)]
pub struct CompletionsArgs {
    /// The shell
    #[arg(value_enum)]
    pub shell: clap_complete::Shell,
    #[command(flatten)]
    pub common: Output,
}

#[derive(Debug, Args)]
pub struct ManArgs {
    /// The folder of the pages
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    #[command(flatten)]
    pub common: Output,
}

#[derive(Debug, Args)]
pub struct TestArgs {
    /// Scripts, and folders of scripts
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// Only tests with TEXT in their names
    #[arg(long, value_name = "TEXT")]
    pub filter: Option<String>,
    #[command(flatten)]
    pub common: Common,
}

#[derive(Debug, Args)]
pub struct FmtArgs {
    /// Scripts, folders of scripts, or `-` for standard input
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// Change nothing: print what would change, and exit with 1 if something would
    #[arg(long)]
    pub check: bool,
    #[command(flatten)]
    pub common: Output,
}

#[derive(Debug, Args)]
pub struct RenderArgs {
    /// The script
    pub file: PathBuf,
    /// Which camera (default: the only one, or the first)
    #[arg(long, value_name = "NAME")]
    pub camera: Option<String>,
    /// Samples a pixel
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub spp: Option<u32>,
    /// Where to: .exr, .hdr or .png
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    #[command(flatten)]
    pub common: Common,
}

#[derive(Debug, Args)]
pub struct GradArgs {
    /// The script
    pub file: PathBuf,
    /// The scalar (default: the only loss, or the first)
    #[arg(long, value_name = "EXPR", allow_hyphen_values = true)]
    pub of: Option<String>,
    /// A param, or a numeric field such as `lamp.radiance`; may be repeated (default: all that reach it)
    #[arg(long, value_name = "NAME")]
    pub wrt: Vec<String>,
    /// Independent evaluations, each with its own seed
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub repeats: u32,
    /// Compare with central finite differences of the value
    #[arg(long)]
    pub fd: bool,
    /// Step of the finite differences
    #[arg(long, value_name = "H", default_value_t = 0.01, value_parser = parse_step)]
    pub fd_step: f64,
    /// Keep learnt sampling tables from repeat to repeat, as an optimisation does from step to step
    #[arg(long)]
    pub warm: bool,
    /// Write the image of the camera's derivative along all the params instead of a scalar's gradient
    #[arg(long, value_name = "FILE")]
    pub image: Option<PathBuf>,
    /// Answer questions, a line of JSON each, from standard input: values and derivatives at params that they give
    #[arg(long, conflicts_with_all = ["image", "fd", "repeats", "warm"])]
    pub serve: bool,
    #[command(flatten)]
    pub common: Common,
}

#[derive(Debug, Args)]
pub struct ExportArgs {
    /// The run's folder
    pub run: PathBuf,
    /// The params at this step, in place of those at the last checkpoint
    #[arg(long, value_name = "N")]
    pub step: Option<u64>,
    /// What is written
    #[arg(long, value_enum, default_value_t = ExportFormat::Json)]
    pub format: ExportFormat,
    /// The script itself, with the params' values as its initial ones
    #[arg(long, conflicts_with = "format")]
    pub script: bool,
    /// Folder for what is written
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    pub common: Machine,
}

#[derive(Debug, Args)]
pub struct ReportArgs {
    /// The run's folder
    pub run: PathBuf,
    /// Where the page goes (default: RUN/report.html)
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Folder for what is written
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    pub common: Output,
}

#[derive(Debug, Args)]
pub struct CompareArgs {
    /// The runs' folders
    #[arg(required = true, value_name = "RUN")]
    pub runs: Vec<PathBuf>,
    /// Where the page goes (default: compare.html)
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Folder for what is written
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    pub common: Output,
}

/// What `dsl export` writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ExportFormat {
    /// All params in one object
    Json,
    /// NumPy arrays, one a file
    Npy,
    /// Tables, one a file
    Csv,
    /// All params in one file, params.safetensors
    Safetensors,
    /// Params that are pictures, one a file
    Exr,
    /// Meshes, one a file
    Obj,
    /// Meshes, one a file
    Ply,
    /// Meshes in glTF, one a file
    Glb,
}

#[derive(Debug, Args)]
pub struct EvalArgs {
    /// The script
    pub file: PathBuf,
    /// The expression; behind `--` if it begins with a minus
    pub expr: String,
    #[command(flatten)]
    pub common: Common,
}

#[derive(Debug, Args)]
pub struct ReplArgs {
    /// A script to start from
    pub file: Option<PathBuf>,
    #[command(flatten)]
    pub common: Common,
}

#[derive(Debug, Args)]
pub struct WatchArgs {
    /// The script
    pub file: PathBuf,
    /// The page has the first free port from here on
    #[arg(long, value_name = "N", default_value_t = PORT, value_parser = clap::value_parser!(u16).range(1..))]
    pub port: u16,
    /// Samples a pixel at which a picture is good enough
    #[arg(long, value_name = "N", default_value_t = PICTURE_SPP, value_parser = clap::value_parser!(u32).range(1..=65536))]
    pub spp: u32,
    #[command(flatten)]
    pub common: Common,
}

/// Where live pages are looked for first.
pub const PORT: u16 = 3000;
/// Samples a pixel of the pictures of live pages.
pub const PICTURE_SPP: u32 = 64;

fn parse_override(text: &str) -> Result<Override, String> {
    let (name, value) = text.split_once('=').ok_or("expected NAME=EXPR, such as spp=16")?;
    let (name, value) = (name.trim(), value.trim());
    let is_name = |s: &str| {
        let mut chars = s.chars();
        chars.next().is_some_and(|c| c.is_ascii_alphabetic() || c == '_')
            && chars.all(|c| c.is_ascii_alphanumeric() || c == '_')
    };
    if !name.split('.').all(is_name) {
        return Err(format!("`{name}` is not the name of a declaration"));
    }
    if value.is_empty() {
        return Err(format!("`{name}=` lacks a value"));
    }
    Ok(Override { name: name.to_owned(), value: value.to_owned() })
}

fn parse_shard(text: &str) -> Result<Shard, String> {
    let numbers = text.split_once('/').and_then(|(i, n)| Some((i.trim().parse().ok()?, n.trim().parse().ok()?)));
    match numbers {
        Some((i, n)) if (1..=n).contains(&i) => Ok(Shard { index: i - 1, count: n }),
        _ => Err("expected I/N with I from 1 to N, such as 2/10".to_owned()),
    }
}

fn parse_step(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(step) if step.is_finite() && step > 0.0 => Ok(step),
        _ => Err("expected a positive number".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_grammar_is_sound() {
        use clap::CommandFactory;
        Cli::command().debug_assert();
    }

    #[test]
    fn overrides_are_names_and_expressions() {
        let parsed = parse_override("spp = 4 * 4").unwrap();
        assert_eq!(parsed, Override { name: "spp".into(), value: "4 * 4".into() });
        assert_eq!(parse_override("a=b == c").unwrap().value, "b == c");
        for wrong in ["spp", "=1", "1x=2", "a b=2", "a="] {
            assert!(parse_override(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn shards_count_from_one() {
        assert_eq!(parse_shard("2/10"), Ok(Shard { index: 1, count: 10 }));
        for wrong in ["", "2", "0/3", "4/3", "a/b", "1/0", "-1/2"] {
            assert!(parse_shard(wrong).is_err(), "{wrong}");
        }
    }

    /// An option that would mean nothing is refused, and not listed by `--help`.
    #[test]
    fn commands_take_the_options_that_mean_something_to_them() {
        let evaluating = "--set a=1 --set b=2 --seed 3 --out d --broadcast";
        let computing = "--threads 2 --memory 4GB";
        let all = "--quiet --json --diagnostic-format short";
        let takes = |command: &str, options: &str| {
            let line = format!("dsl {command} {options}");
            Cli::try_parse_from(line.split(' ')).is_ok()
        };
        for command in ["run f", "sweep f", "check f", "test f", "render f", "grad f", "eval f x", "repl", "watch f"] {
            assert!(takes(command, &format!("{evaluating} {computing} {all}")), "{command}");
        }
        for (command, computes, writes) in [
            ("export r", true, true),
            ("info", true, false),
            ("compare r", false, true),
            ("report r", false, true),
            ("fmt f", false, false),
            ("explain", false, false),
            ("doc", false, false),
            ("new d", false, false),
            ("man d", false, false),
            ("completions zsh", false, false),
        ] {
            assert!(takes(command, all), "{command}");
            for option in ["--set a=1", "--seed 3", "--broadcast"] {
                assert!(!takes(command, option), "{command} {option}");
            }
            for option in ["--threads 2", "--memory 4GB"] {
                assert_eq!(takes(command, option), computes, "{command} {option}");
            }
            assert_eq!(takes(command, "--out d"), writes, "{command}");
        }
        assert!(Cli::try_parse_from(["dsl", "run"]).is_err());
        assert!(Cli::try_parse_from(["dsl", "run", "f", "--threads", "0"]).is_err());
        assert!(Cli::try_parse_from(["dsl", "run", "f", "--memory", "much"]).is_err());
    }
}
