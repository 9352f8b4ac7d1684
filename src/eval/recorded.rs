//! The images that a loss compares, recorded as they were evaluated, so that showing them costs no rendering.

use std::sync::Arc;

use crate::check::hir::{Call, DeclId};
use crate::natives::value::Value;
use crate::source::Span;
use crate::tape::Tensor;

use super::Engine;

/// An image that params reach, `[height, width, channels]`.
#[derive(Clone, Debug)]
pub struct RecordedImage {
    /// The expression.
    pub name: String,
    /// Its numbers.
    pub image: Arc<Tensor>,
    /// What it was compared with.
    pub target: Option<Arc<Tensor>>,
}

/// Most images that are kept.
const MOST_RECORDED: usize = 6;

/// What tells recorded images apart: the place in the program, and the way there.
type Key = (Span, u64);

#[derive(Default)]
pub(super) struct ImageLog {
    compared: Vec<(Key, RecordedImage)>,
    rendered: Vec<(Key, RecordedImage)>,
    /// Within a function of `std/loss.dscene`, whose arguments have been recorded: what it does with them is its own affair.
    within_loss: bool,
}

impl Engine {
    /// Begins to record images, until [`Engine::recorded_images`] is called.
    pub fn record_images(&mut self) {
        self.image_log = Some(ImageLog::default());
    }

    /// The images since [`Engine::record_images`]: images that were compared with others, or else those that were rendered, each place as
    /// it was evaluated first.
    pub fn recorded_images(&mut self) -> Vec<RecordedImage> {
        let ImageLog { compared, rendered, .. } = self.image_log.take().unwrap_or_default();
        let found = if compared.is_empty() { rendered } else { compared };
        found.into_iter().map(|(_, image)| image).collect()
    }

    /// A call that may be that of a loss: its first two images are compared. Returns whether they are.
    pub(super) fn begin_loss(&mut self, function: DeclId, call: &Call, values: &[Option<Value>]) -> bool {
        if self.image_log.as_ref().is_none_or(|log| log.within_loss) {
            return false;
        }
        let (Some(Some(a)), Some(Some(b))) = (values.first(), values.get(1)) else { return false };
        let spans: Vec<Span> = call.args.iter().flatten().take(2).map(|arg| arg.span).collect();
        let &[left, right] = &spans[..] else { return false };
        let is_compared = self.program.compares(function) && self.compared((a, left), (b, right));
        if let Some(log) = &mut self.image_log {
            log.within_loss = is_compared;
        }
        is_compared
    }

    pub(super) fn end_loss(&mut self) {
        if let Some(log) = &mut self.image_log {
            log.within_loss = false;
        }
    }

    /// Two values that are compared. If they are images of one size, and params reach one of them, they are kept; returns whether.
    pub(super) fn compared(&mut self, left: (&Value, Span), right: (&Value, Span)) -> bool {
        let (Value::Image(a), Value::Image(b)) = (left.0, right.0) else { return false };
        if self.image_log.as_ref().is_none_or(|log| log.within_loss) || a.shape() != b.shape() {
            return false;
        }
        let ((image, span), target) = match (a.is_live(), b.is_live()) {
            (true, _) => ((a, left.1), b),
            (false, true) => ((b, right.1), a),
            (false, false) => return false,
        };
        let image = RecordedImage { name: self.name_of(span), image: image.tensor(), target: Some(target.tensor()) };
        let key = (span, self.path);
        if let Some(log) = &mut self.image_log {
            keep(&mut log.compared, key, image);
        }
        true
    }

    /// A rendering that params reach.
    pub(super) fn rendered(&mut self, value: &Value, span: Span) {
        let (Some(_), Value::Image(image)) = (&self.image_log, value) else { return };
        let image = RecordedImage { name: self.name_of(span), image: image.tensor(), target: None };
        let key = (span, self.path);
        if let Some(log) = &mut self.image_log {
            keep(&mut log.rendered, key, image);
        }
    }

    fn name_of(&self, span: Span) -> String {
        self.program.sources.text(span).split_whitespace().collect::<Vec<&str>>().join(" ")
    }
}

fn keep(kept: &mut Vec<(Key, RecordedImage)>, key: Key, image: RecordedImage) {
    if kept.len() < MOST_RECORDED && kept.iter().all(|(known, _)| *known != key) {
        kept.push((key, image));
    }
}
