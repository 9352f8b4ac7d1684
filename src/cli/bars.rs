//! Progress bars below what is printed: one of the steps of an optimisation or the runs of a sweep, and one of the rendering, the derivatives
//! or the file that is being worked on, once that has taken a while.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::session::clock::human_seconds;
use crate::work::{self, Now};

/// Work that takes less is not shown.
const A_WHILE: Duration = Duration::from_secs(1);

/// How often it is looked at what is worked on.
const LOOK: Duration = Duration::from_millis(200);

/// The bars of this process; `None` if nobody looks.
static BARS: Mutex<Option<Bars>> = Mutex::new(None);

struct Bars {
    drawn: MultiProgress,
    steps: Option<ProgressBar>,
    work: Option<ProgressBar>,
}

fn bars() -> MutexGuard<'static, Option<Bars>> {
    BARS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Draws bars from now on.
pub fn start() {
    let mut bars = bars();
    if bars.is_some() {
        return;
    }
    let drawn = MultiProgress::with_draw_target(ProgressDrawTarget::stderr_with_hz(8));
    *bars = Some(Bars { drawn, steps: None, work: None });
    // Without a thread there is no bar of what is worked on, and that is all.
    let _ = std::thread::Builder::new().spawn(|| {
        loop {
            std::thread::sleep(LOOK);
            if let Some(bars) = self::bars().as_mut() {
                bars.work(work::now());
            }
        }
    });
}

/// Prints something above the bars.
pub fn above(print: impl FnOnce()) {
    // What is printed because of a fault in here must not wait for it.
    let mut bars = BARS.try_lock().ok();
    match bars.as_mut().and_then(|bars| bars.as_mut()) {
        Some(bars) => {
            if work::now().is_none() {
                bars.work(None);
            }
            bars.drawn.suspend(print);
        }
        None => print(),
    }
}

/// Shows the bar of steps.
pub fn steps(name: &str, done: u64, total: u64, message: String) {
    if let Some(bars) = bars().as_mut() {
        let drawn = &bars.drawn;
        let template = "{prefix} {bar:28.cyan/blue} {pos}/{len}  {msg}";
        let bar =
            bars.steps.get_or_insert_with(|| drawn.insert(0, ProgressBar::new(total).with_style(style(template))));
        bar.set_length(total);
        bar.set_prefix(name.to_owned());
        bar.set_message(message);
        bar.set_position(done);
    }
}

/// Leaves the bar of steps as it is.
pub fn steps_done() {
    if let Some(bar) = bars().as_mut().and_then(|bars| bars.steps.take()) {
        bar.abandon();
    }
}

/// Takes the bar of work that has ended off the screen, before something else is drawn there.
pub fn clear() {
    above(|| ());
}

impl Bars {
    fn work(&mut self, now: Option<Now>) {
        let Some(now) = now.filter(|now| now.begun.elapsed() >= A_WHILE) else {
            if let Some(bar) = self.work.take() {
                bar.finish_and_clear();
                self.drawn.remove(&bar);
            }
            return;
        };
        let drawn = &self.drawn;
        let bar = self.work.get_or_insert_with(|| drawn.add(ProgressBar::new(100)));
        bar.set_prefix(now.name);
        let seconds = now.begun.elapsed().as_secs_f64();
        // What has no length is shown by its name and the time that it has taken.
        if now.total == 0 {
            bar.set_style(style("{prefix}  {msg}"));
            bar.set_message(human_seconds(seconds));
        } else {
            let share = now.done as f64 / now.total as f64;
            bar.set_style(style("{prefix} {bar:28.blue} {pos} %  {msg}"));
            bar.set_position((100.0 * share) as u64);
            let left = (now.done > 0).then(|| format!("{} left", human_seconds(seconds * (1.0 / share - 1.0))));
            bar.set_message(left.unwrap_or_default());
        }
        bar.tick();
    }
}

/// A template that does not parse costs the looks, not the run.
fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()).progress_chars("━╸─")
}
