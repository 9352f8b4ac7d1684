//! What is shown live: a page in a browser on this machine, served by the program that works. `dsl watch` shows a file as it is edited,
//! `dsl run --live` a run as it goes on.
//!
//! [`hub`] holds what the program and the pages share, [`server`] serves it, [`view`] makes the pictures. The program itself stays on one
//! thread: it looks at the orders between two passes of a picture and between two steps of an optimisation.

mod describe;
mod hub;
mod request;
mod server;
mod view;
mod wake;
pub mod watch;

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use serde_json::{Value as Json, json};

use super::args::Common;
use super::living::set_param;
use super::{Terminal, out};
use crate::diag::{self, Diagnostic, RenderOptions};
use crate::eval::{Engine, INTERRUPTED};
use crate::session::run::tell_warnings;
use crate::session::{Optimization, Progress, World, world};
use crate::source::SourceMap;
use crate::tape::Tensor;
use hub::{Hub, Order, Weight};
use view::{View, Wrong};

/// Lines of output that a page shows.
const MOST_LINES: usize = 200;
/// Diagnostics that a page shows.
const MOST_DIAGNOSTICS: usize = 50;
/// Losses of which the curve on the page is made.
const MOST_LOSSES: usize = 500;
/// Shortest time between two pictures of an optimisation, and the part of the time that they may take.
const PICTURE_PAUSE: f64 = 0.2;
const PICTURE_SHARE: f64 = 0.25;
/// Shortest time between two states of an optimisation.
const PROGRESS_PAUSE: f64 = 0.05;

/// The terminal and the pages, as the world of a session.
pub struct Live {
    terminal: Terminal,
    hub: Arc<Hub>,
    view: View,
    /// Params are not set, nothing is started: a run has its results from its script alone.
    is_run: bool,
    paused: bool,
    /// A paused optimisation may take one step.
    one_step: bool,
    /// Orders that end the optimisation under way, for who began it.
    ends: Vec<Order>,
    /// A step was taken since the last look.
    stepped: bool,
    /// What the picture shows has changed.
    changed: bool,
    diagnostics: Vec<Json>,
    /// What is wrong with the last picture.
    wrong_view: Option<Json>,
    /// Why the last value that a page gave a param was not taken.
    refused: Option<Json>,
    lines: Vec<String>,
    curve: Curve,
    next_picture: Instant,
    next_progress: Instant,
}

/// The losses of the optimisation that is shown.
#[derive(Default)]
struct Curve {
    name: String,
    done: u64,
    total: u64,
    seconds_per_step: f64,
    losses: Vec<f64>,
}

/// What is to become of an order.
enum Obeyed {
    Done,
    /// Who began the optimisation is to see to it.
    Ends(Order),
}

impl Live {
    /// Starts the server and says where it is. The flag is that of the engine whose work orders interrupt.
    pub fn start(
        common: &Common,
        port: u16,
        spp: u32,
        title: &str,
        engine: &Arc<AtomicBool>,
        is_run: bool,
    ) -> Result<Live, Diagnostic> {
        let hub = Hub::new(engine.clone(), is_run);
        let address = server::start(port, &hub)?;
        wake::start(&hub)?;
        if common.json {
            out::line(&json!({"event": "live", "address": address}).to_string());
        } else {
            out::line(&format!("live at {address}"));
        }
        let now = Instant::now();
        let live = Live {
            terminal: Terminal::new(common),
            hub,
            view: View::new(spp),
            is_run,
            paused: false,
            one_step: false,
            ends: Vec::new(),
            stepped: true,
            changed: true,
            diagnostics: Vec::new(),
            wrong_view: None,
            refused: None,
            lines: Vec::new(),
            curve: Curve::default(),
            next_picture: now,
            next_progress: now,
        };
        live.hub.tell("program", &json!({"title": title, "run": is_run}));
        live.say_phase("starting");
        Ok(live)
    }

    /// Shows a program for the first time, with a first look at its picture.
    pub fn introduce(&mut self, engine: &mut Engine) {
        self.view.of(engine.program());
        self.show_params(engine);
        self.show_camera(engine);
        self.refine(engine);
        self.changed = true;
    }

    /// The end of a run, for pages that are still open.
    pub fn end(mut self, how: &str, engine: &mut Engine) {
        self.show_params(engine);
        self.tell_optimization();
        self.say_phase(how);
        self.hub.close();
    }

    fn say_phase(&self, phase: &str) {
        self.hub.tell("phase", &json!(phase));
    }

    // ---- orders ----------------------------------------------------------------------------------------------------

    fn obey(&mut self, order: Order, engine: &mut Engine) -> Obeyed {
        match order {
            Order::View { number, pose } => {
                self.view.look_from(number, pose);
                self.show_camera(engine);
                self.changed = true;
            }
            Order::Camera { name } => {
                self.view.choose(name);
                self.show_camera(engine);
                self.changed = true;
            }
            Order::Exposure { stops } => self.view.expose(stops, &self.hub),
            Order::Derivative { name, element } => {
                self.view.derive(name.map(|name| (name, element)), &self.hub);
                self.changed = true;
            }
            // The results of a run follow from its script alone.
            Order::Set { .. } | Order::Reset | Order::Start { .. } | Order::Changed { .. } if self.is_run => {}
            Order::Set { name, values } => {
                let set = set_by_hand(engine, &name, values);
                self.refused = set.err().map(|why| described(&why, &engine.program().sources));
                if self.refused.is_none() {
                    self.view.restart();
                    self.changed = true;
                }
                self.tell_diagnostics();
                self.show_params(engine);
            }
            Order::Pause => self.paused = true,
            Order::Resume => self.paused = false,
            Order::Step => (self.paused, self.one_step) = (true, true),
            Order::Reset | Order::Start { .. } | Order::Stop | Order::Changed { .. } => return Obeyed::Ends(order),
        }
        Obeyed::Done
    }

    /// Obeys what was asked for by now; what ends an optimisation is put by.
    fn obey_all(&mut self, engine: &mut Engine, patience: Duration) {
        for order in self.hub.take_orders(patience) {
            if let Obeyed::Ends(order) = self.obey(order, engine) {
                self.ends.push(order);
            }
        }
    }

    // ---- pictures --------------------------------------------------------------------------------------------------

    /// One more pass over the picture.
    fn refine(&mut self, engine: &mut Engine) {
        let found = self.view.pass(engine, &self.hub);
        self.seen(found, engine);
    }

    /// What came of a look: an error is shown until the next one.
    fn seen(&mut self, found: Result<(), Wrong>, engine: &mut Engine) {
        match found {
            // Whatever interrupted it comes next.
            Err(Wrong(e, _)) if e.code == INTERRUPTED => return,
            Err(wrong) => self.wrong_view(&wrong),
            Ok(()) => {
                let warning = engine.take_warnings().into_iter().next();
                let sources = engine.program().sources.clone();
                self.wrong_view = warning.map(|warning| described(&warning, &sources));
            }
        }
        self.tell_diagnostics();
    }

    fn wrong_view(&mut self, Wrong(diagnostic, sources): &Wrong) {
        self.wrong_view = Some(described(diagnostic, sources));
        self.tell_diagnostics();
    }

    // ---- what pages are told ---------------------------------------------------------------------------------------

    fn show_params(&mut self, engine: &mut Engine) {
        match describe::params(engine) {
            Ok(params) => self.hub.tell("params", &params),
            Err(e) if e.code == INTERRUPTED => {}
            Err(e) => self.wrong_view(&Wrong(e, engine.program().sources.clone())),
        }
    }

    fn show_camera(&mut self, engine: &mut Engine) {
        if !self.view.has_camera() {
            return self.hub.tell("camera", &json!(null));
        }
        match self.view.camera(engine) {
            Ok((name, camera)) => {
                self.hub.tell("camera", &describe::camera(engine, &name, &camera, self.view.pose()));
            }
            Err(Wrong(e, _)) if e.code == INTERRUPTED => {}
            Err(wrong) => self.wrong_view(&wrong),
        }
    }

    fn tell_diagnostics(&self) {
        let all: Vec<&Json> = self.diagnostics.iter().chain(&self.wrong_view).chain(&self.refused).collect();
        self.hub.tell("diagnostics", &json!(all));
    }

    fn forget_diagnostics(&mut self) {
        self.diagnostics.clear();
        (self.wrong_view, self.refused) = (None, None);
    }

    fn add_line(&mut self, text: &str) {
        self.lines.extend(text.lines().map(str::to_owned));
        let surplus = self.lines.len().saturating_sub(MOST_LINES);
        self.lines.drain(..surplus);
        self.hub.tell("log", &json!(self.lines));
    }

    fn tell_optimization(&mut self) {
        let Curve { name, done, total, seconds_per_step, losses } = &self.curve;
        if name.is_empty() {
            return;
        }
        let stride = losses.len().div_ceil(MOST_LOSSES).max(1);
        let last = losses.len().saturating_sub(1);
        let is_shown = |i: &usize| i.is_multiple_of(stride) || *i == last;
        let points: Vec<(usize, f64)> = losses.iter().copied().enumerate().filter(|(i, _)| is_shown(i)).collect();
        self.hub.tell(
            "optimization",
            &json!({
                "name": name, "done": done, "total": total, "seconds_per_step": seconds_per_step,
                "loss": losses.last(), "losses": points,
            }),
        );
    }
}

impl World for Live {
    fn print(&mut self, text: &str) {
        self.terminal.print(text);
        self.add_line(text);
    }

    fn note(&mut self, text: &str) {
        // That a page has ended an optimisation is no news to it.
        if self.ends.is_empty() {
            self.terminal.note(text);
            self.add_line(text);
        }
    }

    fn diagnostic(&mut self, diagnostic: &Diagnostic, sources: &SourceMap) {
        self.terminal.diagnostic(diagnostic, sources);
        if self.diagnostics.len() < MOST_DIAGNOSTICS {
            self.diagnostics.push(described(diagnostic, sources));
        }
        self.tell_diagnostics();
    }

    fn progress(&mut self, progress: Progress<'_>) {
        self.terminal.progress(progress);
        self.stepped = true;
        // A stage has its own name, and goes on with the curve.
        if progress.done <= self.curve.done || self.curve.total != progress.total {
            self.curve.losses.clear();
        }
        let Progress { done, total, seconds_per_step, .. } = progress;
        self.curve = Curve {
            name: progress.name.to_owned(),
            done,
            total,
            seconds_per_step,
            losses: std::mem::take(&mut self.curve.losses),
        };
        self.curve.losses.push(progress.loss);
        let now = Instant::now();
        if now >= self.next_progress {
            self.next_progress = now + Duration::from_secs_f64(PROGRESS_PAUSE);
            self.tell_optimization();
        }
    }

    fn progress_done(&mut self) {
        self.terminal.progress_done();
        self.tell_optimization();
        // What comes now is interrupted by nothing that only looks.
        self.hub.begin(Weight::Ends);
    }

    fn interrupted(&self) -> bool {
        !self.ends.is_empty() || world::interrupted()
    }

    /// Between two steps: orders, a pause if it is asked for, and a picture if it is time for one.
    fn look(&mut self, engine: &mut Engine, optimization: &Optimization) -> bool {
        self.obey_all(engine, Duration::ZERO);
        if self.paused && !self.one_step {
            // Pictures of a pause are as good as they can be, not as a stage wants those of its steps.
            optimization.leave(engine);
            self.tell_optimization();
            self.show_params(engine);
            self.say_phase("paused");
            self.view.restart();
            while self.paused && !self.one_step && !self.interrupted() {
                if self.view.wants_more() && self.hub.pages() > 0 {
                    self.refine(engine);
                    self.obey_all(engine, Duration::ZERO);
                } else {
                    self.obey_all(engine, Duration::from_millis(500));
                }
            }
        }
        self.one_step = false;
        if self.interrupted() {
            return true;
        }
        self.say_phase("optimising");
        let begun = Instant::now();
        if self.hub.pages() > 0 && (self.changed || begun >= self.next_picture) {
            self.changed = false;
            tell_warnings(engine, self);
            let found = self.view.glance(engine, &self.hub);
            self.seen(found, engine);
            self.show_params(engine);
            let pause = PICTURE_PAUSE.max(begun.elapsed().as_secs_f64() / PICTURE_SHARE);
            self.next_picture = Instant::now() + Duration::from_secs_f64(pause);
        }
        // A step is given up for a look once, and then taken whatever comes.
        let stepped = std::mem::take(&mut self.stepped);
        self.hub.begin(if stepped { Weight::Looks } else { Weight::Ends });
        true
    }
}

/// Gives a param numbers that a page sent: angles in degrees.
fn set_by_hand(engine: &mut Engine, name: &str, values: Vec<f64>) -> Result<(), Diagnostic> {
    let program = engine.program();
    let found = program.params().find(|&id| program.decl(id).name == name);
    let unknown = || Diagnostic::error("dscene::name::unknown", format!("there is no param `{name}`"));
    let id = found.ok_or_else(unknown)?;
    let is_angle = crate::eval::is_angle(&program.decl(id).ty);
    let info = engine.param_info(id)?;
    let fits = values.len() == info.shape.iter().product::<usize>() && values.iter().all(|x| x.is_finite());
    if !fits || info.kind == crate::eval::ParamKind::Rotation {
        let message = format!("these are not the numbers of `{name}`");
        return Err(Diagnostic::error("dscene::live::value", message));
    }
    let data = values.into_iter().map(|x| if is_angle { x.to_radians() } else { x }).collect();
    set_param(engine, id, Tensor { shape: info.shape, data })
}

/// A diagnostic for pages: as data, and drawn as in a terminal.
fn described(diagnostic: &Diagnostic, sources: &SourceMap) -> Json {
    let mut told = diag::to_json(diagnostic, sources);
    if let Some(fields) = told.as_object_mut() {
        fields.insert("text".into(), json!(diag::render(diagnostic, sources, RenderOptions::plain())));
    }
    told
}
