//! `dsl watch`: a script as it is edited.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use serde_json::json;

use super::hub::Order;
use super::wake::Watched;
use super::{Live, Obeyed};
use crate::check::{Purpose, hir};
use crate::cli::args::{PICTURE_SPP, PORT, WatchArgs};
use crate::cli::living::Living;
use crate::cli::load::Noting;
use crate::cli::{EXIT_WRONG, Terminal, check_file_by};
use crate::diag::Diagnostic;
use crate::eval::INTERRUPTED;
use crate::files::{self, Stamp, stamp};
use crate::session::{Optimization, World, world};
use crate::source::SourceMap;

/// A file, what is known of it, and who sees it.
struct Watch {
    file: PathBuf,
    living: Living,
    live: Live,
    /// The file as it is now is the program.
    is_right: bool,
    /// Files that it reads have changed since it was read last without errors.
    files_have_changed: bool,
    /// The optimisation goes on.
    running: bool,
}

/// `dsl watch`. It ends with Ctrl-C.
pub fn run(args: &WatchArgs) -> u8 {
    let interrupt = Arc::new(AtomicBool::new(false));
    let title = args.file.display().to_string();
    let live = match Live::start(&args.common, args.port, args.spp, &title, &interrupt, false) {
        Ok(live) => live,
        Err(diagnostic) => {
            Terminal::new(&args.common).diagnostic(&diagnostic, &SourceMap::default());
            return EXIT_WRONG;
        }
    };
    let living = Living::new(args.common.clone(), interrupt);
    let mut watch =
        Watch { file: args.file.clone(), living, live, is_right: false, files_have_changed: false, running: false };
    watch.read();
    loop {
        watch.turn();
    }
}

/// `:watch` of the REPL: the page shows its program until Ctrl-C. What the page has moved stays where it is.
pub fn session(living: &mut Living, camera: Option<&str>) -> Result<(), Diagnostic> {
    let interrupt = Arc::new(AtomicBool::new(false));
    let title = living.file.as_ref().map_or("the session".to_owned(), |file| file.display().to_string());
    let mut live = Live::start(&living.common, PORT, PICTURE_SPP, &title, &interrupt, false)?;
    camera.into_iter().for_each(|name| live.view.choose(name.to_owned()));
    let stand_in = Living::new(living.common.clone(), interrupt.clone());
    let mut own = std::mem::replace(living, stand_in);
    let before = own.engine.stop_by(Some(interrupt));
    let file = own.file.clone().unwrap_or_default();
    let mut watch = Watch { file, living: own, live, is_right: true, files_have_changed: false, running: false };
    watch.introduce();
    watch.say_phase();
    while !world::interrupted() {
        watch.turn();
    }
    watch.living.engine.stop_by(before);
    watch.living.optimization = None;
    watch.live.end("ended", &mut watch.living.engine);
    *living = watch.living;
    Ok(())
}

impl Watch {
    /// Obeys what was asked for, and does some of what there is to do.
    fn turn(&mut self) {
        let is_busy = self.running || self.live.view.wants_more();
        let patience = if is_busy { Duration::ZERO } else { Duration::from_secs(3600) };
        let ends = std::mem::take(&mut self.live.ends);
        let orders = if ends.is_empty() { self.live.hub.take_orders(patience) } else { ends };
        let (edits, others): (Vec<Order>, Vec<Order>) =
            orders.into_iter().partition(|order| matches!(order, Order::Changed { .. }));
        if !edits.is_empty() {
            self.files_have_changed |= edits.contains(&Order::Changed { read: true });
            self.read();
        }
        for order in others {
            if let Obeyed::Ends(order) = self.live.obey(order, &mut self.living.engine) {
                self.begin_or_end(order);
            }
        }
        if self.running {
            self.optimize();
        } else if self.live.view.wants_more() {
            self.live.refine(&mut self.living.engine);
            if !self.live.view.wants_more() {
                self.say_phase();
            }
        }
    }

    /// Reads the file and goes on with it. If it is wrong, all stays in sight as it was.
    fn read(&mut self) {
        self.live.forget_diagnostics();
        self.live.say_phase("reading");
        self.running = false;
        let noting = Noting::default();
        let checked = check_file_by(Purpose::Run, &self.file, &self.living.common, &noting);
        let own: Vec<PathBuf> = checked.sources.iter().filter_map(|(_, file)| file.path.clone()).collect();
        self.is_right = match self.living.file {
            None => self.living.begin(checked, &self.file, &mut self.live).is_some(),
            Some(_) => self.living.renew(checked, self.files_have_changed, &mut self.live),
        };
        self.live.tell_diagnostics();
        if self.is_right {
            self.files_have_changed = false;
            self.introduce();
        }
        self.watch_files(&own, noting);
        self.say_phase();
    }

    fn introduce(&mut self) {
        self.live.introduce(&mut self.living.engine);
        let names: Vec<&str> = self.living.optimizations().map(|o| o.name.as_str()).collect();
        self.live.hub.tell("optimizations", &json!(names));
    }

    /// All that a change of is a change of what is shown: also files that are not there yet.
    fn watch_files(&self, own: &[PathBuf], noting: Noting) {
        let full = |path: &Path| path.canonicalize().unwrap_or_else(|_| path.to_path_buf());
        let is_own = |path: &Path| path == self.file || own.iter().any(|known| full(known) == full(path));
        let watched = |(path, known): (PathBuf, Stamp)| Watched { is_read: !is_own(&path), path, known };
        let mut all: Vec<Watched> = noting.asked().into_iter().map(watched).collect();
        let known: HashSet<PathBuf> = all.iter().map(|file| full(&file.path)).collect();
        let read = files::inputs().into_iter().map(|(path, _)| path).filter(|path| !known.contains(path));
        all.extend(read.map(|path| Watched { known: stamp(&path), path, is_read: true }));
        self.live.hub.set_files(all);
    }

    fn say_phase(&self) {
        let phase = match () {
            () if !self.is_right => "wrong",
            () if self.running => "optimising",
            () if self.live.view.wants_more() => "rendering",
            () => "ready",
        };
        self.live.say_phase(phase);
    }

    fn begin_or_end(&mut self, order: Order) {
        match order {
            Order::Reset => {
                self.living.reset();
                self.running = false;
                self.live.view.restart();
                self.live.show_params(&mut self.living.engine);
            }
            Order::Stop => {
                self.living.optimization = None;
                self.running = false;
                self.live.view.restart();
                self.live.show_params(&mut self.living.engine);
            }
            Order::Start { index } => self.start(index),
            _ => {}
        }
        self.say_phase();
    }

    fn start(&mut self, index: usize) {
        let Some(optimize) = self.living.optimizations().nth(index) else { return };
        // Pictures that the script saves on its way are those of a run; a page shows its own.
        let optimize = hir::Optimize { every: Vec::new(), ..optimize.clone() };
        self.live.forget_diagnostics();
        self.live.tell_diagnostics();
        match Optimization::new(&mut self.living.engine, &optimize, None) {
            Ok(optimization) => {
                self.living.optimization = Some(optimization);
                self.running = true;
                (self.live.paused, self.live.stepped) = (false, true);
            }
            Err(diagnostic) => self.live.diagnostic(&diagnostic, &self.living.engine.program().sources.clone()),
        }
    }

    /// All steps, unless something else is asked for.
    fn optimize(&mut self) {
        self.say_phase();
        let done = self.living.advance(u64::MAX, &mut self.live);
        crate::session::run::tell_warnings(&mut self.living.engine, &mut self.live);
        match done {
            Err(e) if e.code == INTERRUPTED => return,
            Err(e) => {
                let sources = self.living.engine.program().sources.clone();
                self.live.diagnostic(&e, &sources);
            }
            // What is asked for decides how it goes on.
            Ok(_) if !self.live.ends.is_empty() => return,
            Ok(_) => {}
        }
        self.running = false;
        self.live.view.restart();
        self.live.show_params(&mut self.living.engine);
        self.say_phase();
    }
}
