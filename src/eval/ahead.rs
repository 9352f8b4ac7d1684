//! Looks ahead: which inputs of the library would leave their domains at the present params, found without rendering anything.
//!
//! The expression is evaluated as ever, but in place of each rendering stands an image of NaN, once its camera and its scene are known to be
//! ones that can be rendered. What is made of such an image is unknown, and is not judged.

use std::collections::HashMap;

use crate::check::hir::{Domain, Expr, NativeDecl, Target};
use crate::diag::Diagnostic;
use crate::natives::value::{SceneValue, Texels, Value};
use crate::render::validate_camera;
use crate::source::Span;
use crate::stop::paced;
use crate::tape::{Tensor, Var, backward_with, depends, edge};

use super::error::{INTERRUPTED, NOT_A_NUMBER};
use super::lower::{self, LowerError, LoweredCamera};
use super::render::Origin;
use super::{Engine, Result};

/// What is known while an expression is looked at ahead.
pub(super) struct Lookahead {
    /// What images are made of. Whatever depends on it is unknown.
    unseen: Var,
    /// What derivatives are taken with respect to, in the order of the request.
    leaves: Vec<Var>,
    found: Vec<Stray>,
    /// How often each input was met.
    met: HashMap<(Span, usize), usize>,
    /// How many calls of `where` are around what is evaluated: they leave out what has no meaning.
    chosen: usize,
}

/// An input of the library that lies outside of its domain.
#[derive(Clone, Debug)]
pub struct Stray {
    /// The function whose input it is, such as `conductor`.
    pub function: String,
    /// The input's name, such as `roughness`.
    pub argument: String,
    /// Where it has a meaning.
    pub domain: Domain,
    /// The first number of it that lies outside.
    pub number: f64,
    /// The call.
    pub place: Span,
    /// The targets that it depends on, by their indices in the request.
    pub from: Vec<usize>,
    /// Which of the function's inputs it is, and the how many-th evaluation of that.
    key: (usize, usize),
    /// Which of its numbers lie outside.
    at: Vec<usize>,
    var: Var,
}

impl Stray {
    /// By target: which of its numbers those that lie outside depend on; a rotation has 3.
    fn reaching(&self, leaves: &[Var]) -> Vec<(usize, Vec<bool>)> {
        let of: Vec<Var> = self.from.iter().filter_map(|i| leaves.get(*i)).cloned().collect();
        let mut seed = Tensor::zeros(self.var.shape());
        // Weights that are all different, so that no two derivatives sum up to 0.
        self.at.iter().for_each(|i| seed.data[*i] = 1.0 + (*i as f64 * 0.618_033_988_75).fract());
        let found = backward_with(&self.var, seed, &of).unwrap_or_default();
        let mask = |(leaf, d): (&Var, Option<&Tensor>)| -> Vec<bool> {
            let mask = d.map_or_else(Vec::new, |d| d.data.iter().map(|x| *x != 0.0).collect());
            // A derivative of 0 does not say which ones they are.
            if mask.contains(&true) { mask } else { vec![true; leaf.len()] }
        };
        let masks = of.iter().enumerate().map(|(k, leaf)| mask((leaf, found.get(k))));
        self.from.iter().copied().zip(masks).collect()
    }
}

/// What was seen.
#[derive(Default)]
pub struct Ahead {
    leaves: Vec<Var>,
    /// The inputs that lie outside of their domains and depend on what was asked for.
    pub strays: Vec<Stray>,
    /// Why the expression has no value.
    pub error: Option<Diagnostic>,
}

impl Ahead {
    /// Whether nothing stands in the way.
    pub fn is_clear(&self) -> bool {
        self.strays.is_empty() && self.error.is_none()
    }

    /// What of it was not so before: inputs of which other numbers lie outside, and the error if there was none.
    pub fn beyond<'a>(&'a self, before: &Ahead) -> (Vec<&'a Stray>, Option<&'a Diagnostic>) {
        let was = |stray: &Stray| {
            let same = |old: &&Stray| (old.place, old.key) == (stray.place, stray.key);
            let old = before.strays.iter().find(same);
            old.is_some_and(|old| stray.at.iter().all(|i| old.at.binary_search(i).is_ok()))
        };
        let new = self.strays.iter().filter(|stray| !was(stray)).collect();
        (new, self.error.as_ref().filter(|_| before.error.is_none()))
    }

    /// By target: which of its numbers an input depends on where it lies outside; a rotation has 3.
    pub fn reaching(&self, stray: &Stray) -> Vec<(usize, Vec<bool>)> {
        stray.reaching(&self.leaves)
    }
}

impl Engine {
    /// Whether there is anything to look ahead for: an input with a domain, or a rendering, that params reach.
    pub fn may_stray(&self) -> bool {
        self.may_stray
    }

    /// Evaluates an expression as the next step of an optimisation would, but for renderings. If nothing stands in its way, what was
    /// evaluated is kept for that step; else all is left as it was.
    pub fn look_ahead(&mut self, of: &Expr, wrt: &[Target]) -> Result<Ahead> {
        let (declarations, step, total) = (self.statistics.declarations, self.step, self.total);
        if step + 1 < total {
            self.set_step(step + 1, total);
        }
        let warnings = std::mem::take(&mut self.warnings);
        let (seen, leaves, strays) = self.unrendered(of, wrt);
        let told = std::mem::replace(&mut self.warnings, warnings);
        let error = match seen {
            Err(e) if e.code == INTERRUPTED => {
                self.forget_since(declarations);
                self.set_step(step, total);
                return Err(e);
            }
            // Whoever asks what an image has is asked again when there is one.
            Err(e) => Some(e).filter(|e| e.code != NOT_A_NUMBER),
            Ok(_) => None,
        };
        let ahead = Ahead { leaves, strays, error };
        if ahead.is_clear() {
            self.forget_rendered_since(declarations);
            self.warnings.add(&told);
        } else {
            self.forget_since(declarations);
        }
        self.set_step(step, total);
        Ok(ahead)
    }

    /// By target: what is infinitely steep on the way from it to an expression at the present params, in words that follow "through".
    pub fn edges(&mut self, of: &Expr, wrt: &[Target]) -> Vec<Option<&'static str>> {
        let declarations = self.statistics.declarations;
        let (seen, leaves, _) = self.unrendered(of, wrt);
        self.forget_since(declarations);
        let value = seen.ok().and_then(|value| value.var().cloned());
        leaves.iter().map(|leaf| value.as_ref().and_then(|value| edge(value, leaf))).collect()
    }

    /// The value of an expression whose renderings are unknown, the nodes of the targets, and which inputs strayed.
    fn unrendered(&mut self, of: &Expr, wrt: &[Target]) -> (Result<Value>, Vec<Var>, Vec<Stray>) {
        let log = self.image_log.take();
        self.ahead = Some(Lookahead {
            unseen: Var::leaf(f64::NAN),
            leaves: Vec::new(),
            found: Vec::new(),
            met: HashMap::new(),
            chosen: 0,
        });
        let look = |engine: &mut Engine| {
            engine.with_leaves(wrt, of.span, |engine, leaves| {
                if let Some(ahead) = &mut engine.ahead {
                    ahead.leaves = leaves.to_vec();
                }
                engine.expr(of)
            })
        };
        let seen = self.on_stack(|e| e.fresh_frame(look));
        self.image_log = log;
        let (leaves, strays) = self.ahead.take().map(|ahead| (ahead.leaves, ahead.found)).unwrap_or_default();
        (seen, leaves, strays)
    }

    /// An error about a value that is made of an image which is unknown says nothing.
    pub(super) fn unless_unseen(&self, error: Diagnostic, values: &[Value]) -> Diagnostic {
        let Some(ahead) = &self.ahead else { return error };
        let is_unseen = values.iter().filter_map(Value::var).any(|var| depends(var, &ahead.unseen));
        if is_unseen { Diagnostic { code: NOT_A_NUMBER, ..error } } else { error }
    }

    /// Notes which arguments of a native lie outside of their domains.
    pub(super) fn watch_arguments(&mut self, native: &NativeDecl, values: &[Value], span: Span) {
        if self.may_stray && self.ahead.is_none() {
            return;
        }
        for (i, (param, value)) in native.params.iter().zip(values).enumerate() {
            if let Some(domain) = param.domain {
                self.watch(domain, [&native.name, &param.name], value, span, i);
            }
        }
    }

    /// Notes whether a value lies outside of a domain, that of an input of a function: the `index`-th one of a call.
    pub(super) fn watch(
        &mut self,
        domain: Domain,
        [function, argument]: [&str; 2],
        value: &Value,
        place: Span,
        index: usize,
    ) {
        let var = match value {
            Value::Texture(texture) => match &texture.texels {
                Texels::Var(var) => var,
                Texels::Packed(_) => return,
            },
            other => match other.var() {
                Some(var) => var,
                None => return,
            },
        };
        if !var.is_live() {
            return;
        }
        self.may_stray = true;
        let Some(ahead) = self.ahead.as_mut().filter(|ahead| ahead.chosen == 0) else { return };
        let nth = ahead.met.entry((place, index)).or_default();
        *nth += 1;
        let is_outside = |x: f64| !x.is_nan() && !domain.contains(x);
        let numbers = paced(var.value().data.iter().enumerate(), 1);
        let at: Vec<usize> = numbers.filter(|(_, x)| is_outside(**x)).map(|(i, _)| i).collect();
        let Some(number) = at.first().map(|i| var.value().data[*i]) else { return };
        let from: Vec<usize> = (0..ahead.leaves.len()).filter(|i| depends(var, &ahead.leaves[*i])).collect();
        if from.is_empty() || depends(var, &ahead.unseen) {
            return;
        }
        let (function, argument, key) = (function.to_owned(), argument.to_owned(), (index, *nth));
        ahead.found.push(Stray { function, argument, domain, number, place, from, key, at, var: var.clone() });
    }

    /// Evaluates what may lie outside of a domain, because `where` leaves it out there.
    pub(super) fn chosen_from<T>(&mut self, is_where: bool, f: impl FnOnce(&mut Engine) -> T) -> T {
        let count = |engine: &mut Engine, up: bool| {
            if let Some(ahead) = engine.ahead.as_mut().filter(|_| is_where) {
                ahead.chosen = if up { ahead.chosen + 1 } else { ahead.chosen.saturating_sub(1) };
            }
        };
        count(self, true);
        let done = f(self);
        count(self, false);
        done
    }

    /// What stands for a rendering with so many channels, if that is possible; `None` if it is to be rendered.
    pub(super) fn unseen_image(
        &self,
        camera: &LoweredCamera,
        channels: usize,
        (scene, origins): (&SceneValue, &[Origin]),
        span: Span,
    ) -> Result<Option<Value>> {
        let Some(ahead) = &self.ahead else { return Ok(None) };
        let unseen = ahead.unseen.clone();
        // A scene with inputs outside of their domains is no scene yet.
        if ahead.found.is_empty() {
            let known = self.scenes.get(scene).map(|lowered| lowered.scene.description.origin);
            let checked = known
                .map_or_else(|| lower::assert_renderable(scene), Ok)
                .and_then(|origin| validate_camera(&camera.relative_to(origin)).map_err(LowerError::Scene));
            checked.map_err(|e| self.scene_error(e, scene, origins, span))?;
        }
        let image = unseen.broadcast_to(&[camera.camera.height, camera.camera.width, channels]);
        image.map(Value::Image).map(Some).map_err(|e| super::error::shape(e.0, span))
    }

    /// Forgets what was evaluated since [`super::Statistics::declarations`] was this.
    fn forget_since(&mut self, declarations: u64) {
        for world in &mut self.worlds {
            world.cache.retain(|_, entry| entry.computed <= declarations);
        }
    }
}
