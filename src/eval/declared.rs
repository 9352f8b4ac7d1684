//! Values whose types are known only now are held against what they are declared as.

use crate::check::Sig;
use crate::check::hir::{Callee, DeclId, DeclKind, Declared, Expr, ExprKind, FnDecl};
use crate::check::types::Ty;
use crate::check::{READERS, text};
use crate::diag::{Diagnostic, did_you_mean};
use crate::natives::value::Value;
use crate::source::Span;
use crate::tape::Var;

use super::{Engine, Result, error, show};

/// Longer values are not shown.
const LONGEST: usize = 60;

/// How many names are followed to the file that a value came from.
const STEPS: usize = 64;

/// Where a value is not as it is declared.
pub(super) struct Misfit {
    /// The way to the part of it: `.a[2]`, or nothing.
    way: String,
    wanted: String,
    found: String,
    help: Option<String>,
}

impl Engine {
    /// The value, if it is as it is declared.
    pub(super) fn declared(&mut self, declared: &Declared) -> Result<Value> {
        let value = self.expr(&declared.value)?;
        let Some(misfit) = misfit(&declared.sig, &value) else { return Ok(value) };
        let (span, origin) = (declared.value.span, self.read_at(&declared.value));
        let within = origin.as_ref().is_some_and(|(at, _)| span.contains(*at));
        let from = origin.as_ref().map_or_else(String::new, |(_, file)| format!(", from `{file}`"));
        let mut told = told(&misfit).label(span, format!("this is {}{from}", shown(&value, &declared.value.ty)));
        if let Some(place) = declared.place {
            told = told.label(place, format!("declared as `{}`", declared.sig));
        }
        if let Some((place, _)) = origin.filter(|_| !within) {
            told = told.label(place, "read here");
        }
        Err(told)
    }

    /// Arguments of a function that was called by a value, so that the checker did not see which one it is.
    pub(super) fn check_arguments(&self, id: DeclId, f: &FnDecl, args: &[Value], span: Span) -> Result<()> {
        if self.is_library(span) && f.params.iter().all(|param| param.place.is_none_or(|place| self.is_library(place)))
        {
            return Ok(());
        }
        for (param, value) in f.params.iter().zip(args) {
            if let Some(misfit) = misfit(&param.takes, value) {
                let of = format!("`{}` of `{}` is {}", param.name, self.program.decl(id).name, shown(value, &Ty::Any));
                let told = told(&misfit).label(span, of);
                return Err(match param.place {
                    Some(place) => told.label(place, format!("declared as `{}`", param.takes)),
                    None => told,
                });
            }
        }
        Ok(())
    }

    /// Lengths that have one name are the same in all arguments, and in the result.
    pub(super) fn check_lengths(&self, id: DeclId, f: &FnDecl, values: &[Option<Value>], span: Span) -> Result<()> {
        let mut known: Vec<(&str, usize, &str)> = Vec::new();
        for (param, value) in f.params.iter().zip(values) {
            for (axis, name) in &param.lens {
                let Some(length) = value.as_ref().and_then(|value| length(value, *axis)) else { continue };
                match known.iter().find(|(n, ..)| n == name) {
                    None => known.push((name, length, &param.name)),
                    Some((_, first, _)) if *first == length => {}
                    Some((_, first, other)) => {
                        let function = &self.program.decl(id).name;
                        let message = match *other == param.name {
                            true => format!("`{other}` of `{function}` is as long along one axis as along the other"),
                            false => {
                                format!("`{other}` and `{}` of `{function}` have the same length `{name}`", param.name)
                            }
                        };
                        return Err(error::lengths(message, span, format!("{first} and {length} long")));
                    }
                }
            }
        }
        Ok(())
    }

    /// As [`Engine::check_lengths`], of what the call gives.
    pub(super) fn check_given(
        &self,
        (id, f): (DeclId, &FnDecl),
        lengths: &[(String, usize, String)],
        value: &Value,
        span: Span,
    ) -> Result<()> {
        for (axis, name) in &f.result_lens {
            let (Some(found), Some((_, wanted, param))) =
                (length(value, *axis), lengths.iter().find(|(n, ..)| n == name))
            else {
                continue;
            };
            if found != *wanted {
                let function = &self.program.decl(id).name;
                let message = format!("what `{function}` gives has the length `{name}` of `{param}`");
                return Err(error::lengths(message, span, format!("gives {found}, `{param}` is {wanted} long")));
            }
        }
        Ok(())
    }

    /// Where the file is read that a value came from, and its name, as far as names and fields lead there.
    fn read_at(&mut self, e: &Expr) -> Option<(Span, String)> {
        let program = self.shared();
        let mut e = e;
        for _ in 0..STEPS {
            e = match &e.kind {
                ExprKind::Field { base, .. } | ExprKind::Index { base, .. } | ExprKind::Slice { base, .. } => base,
                ExprKind::Declared(declared) => &declared.value,
                ExprKind::Decl(id) => program.decl(*id).body.as_deref()?,
                ExprKind::Call(call) => {
                    let Callee::Native(id) = call.callee else { return None };
                    let decl = program.decl(id);
                    if !matches!(decl.kind, DeclKind::Native(_)) || !READERS.contains(&decl.name.as_str()) {
                        return None;
                    }
                    let path = call.args.first()?.as_ref()?;
                    return match self.expr(path) {
                        Ok(Value::Str(file)) => Some((e.span, file.to_string())),
                        _ => None,
                    };
                }
                _ => return None,
            };
        }
        None
    }
}

/// The lengths of arguments that have names, with the parameters that have them.
pub(super) fn lengths(f: &FnDecl, args: &[Option<Value>]) -> Vec<(String, usize, String)> {
    let all = f.params.iter().zip(args).flat_map(|(param, value)| {
        let of = move |(axis, name): &(usize, String)| {
            Some((name.clone(), length(value.as_ref()?, *axis)?, param.name.clone()))
        };
        param.lens.iter().filter_map(of)
    });
    all.collect()
}

fn length(value: &Value, axis: usize) -> Option<usize> {
    match value {
        Value::Num(x) => x.shape().get(axis).copied(),
        Value::List(items) => match axis.checked_sub(1) {
            None => Some(items.len()),
            Some(axis) => length(items.first()?, axis),
        },
        _ => None,
    }
}

fn told(misfit: &Misfit) -> Diagnostic {
    let Misfit { way, wanted, found, help } = misfit;
    let message = match way.is_empty() {
        true => format!("expected `{wanted}`, found {found}"),
        false => format!("expected `{wanted}` as `{way}`, found {found}"),
    };
    error::not_declared(message).help_opt(help.clone())
}

/// A value in a few words.
fn shown(value: &Value, ty: &Ty) -> String {
    let text = show::brief(value, ty);
    match text.chars().count() <= LONGEST && !text.contains('\n') {
        true => text,
        false => kind(value),
    }
}

/// What a value is, as a type where it has one.
fn kind(value: &Value) -> String {
    match value {
        Value::Num(x) => format!("`{}`", Ty::Num(x.shape().iter().map(|n| Some(*n)).collect())),
        Value::Str(_) => "`string`".to_owned(),
        Value::Bool(_) => "`bool`".to_owned(),
        Value::List(items) => format!("an array of {}", items.len()),
        other => other.kind().to_owned(),
    }
}

/// The first part of a value that is not as declared.
pub(super) fn misfit(sig: &Sig, value: &Value) -> Option<Misfit> {
    let here = |found: String| {
        let help = match value {
            Value::Str(word) if !sig.words().is_empty() => did_you_mean(word, "the words are", sig.words()),
            _ => None,
        };
        Some(Misfit { way: String::new(), wanted: sig.to_string(), found, help })
    };
    match (sig, value) {
        // A missing argument.
        (_, Value::None) => None,
        (_, Value::Num(x)) if are_numbers(sig, x.shape(), x) => None,
        (Sig::Int(shape), Value::Num(x)) if has_shape(&Ty::Num(shape.clone()), x.shape()) => {
            here(x.value().data.iter().find(|x| x.fract() != 0.0).map_or(kind(value), |x| text::number_text(*x)))
        }
        (Sig::Word(word), Value::Str(found)) if **found == **word => None,
        (Sig::Union(choices), value) => {
            let fits = choices.iter().any(|choice| misfit(choice, value).is_none());
            let is_word = matches!(value, Value::Str(_)) && !sig.words().is_empty();
            if fits { None } else { here(if is_word { shown(value, &Ty::Str) } else { kind(value) }) }
        }
        (Sig::Word(_), Value::Str(_)) => here(shown(value, &Ty::Str)),
        (Sig::Any | Sig::Var('A'..='M' | 'O' | 'P' | 'R'..='Z'), _) => None,
        (Sig::Var(_) | Sig::Number | Sig::Angles, Value::Image(_)) => None,
        (Sig::List(item, n), Value::List(items)) if n.is_none_or(|n| n == items.len()) => {
            items.iter().enumerate().find_map(|(i, value)| within(&format!("[{i}]"), misfit(item, value)))
        }
        (Sig::Is(Ty::Num(shape)), Value::List(items)) if !shape.is_empty() => {
            let item = Sig::Is(Ty::Num(shape[1..].to_vec()));
            let part = |(i, value)| within(&format!("[{i}]"), misfit(&item, value));
            match shape[0].is_none_or(|n| n == items.len()) {
                true => items.iter().enumerate().find_map(part),
                false => here(kind(value)),
            }
        }
        (Sig::Is(Ty::Array(item, n)), Value::List(items)) if n.is_none_or(|n| n == items.len()) => {
            let item = Sig::Is((**item).clone());
            items.iter().enumerate().find_map(|(i, value)| within(&format!("[{i}]"), misfit(&item, value)))
        }
        (Sig::Record(wanted), Value::Record(found)) => {
            for (name, sig) in wanted {
                match found.iter().find(|(n, _)| n == name) {
                    Some((_, value)) => match within(&format!(".{name}"), misfit(sig, value)) {
                        None => {}
                        some => return some,
                    },
                    None => return here(format!("a record without `{name}`")),
                }
            }
            let more = found.iter().find(|(name, _)| wanted.iter().all(|(n, _)| n != name));
            more.and_then(|(name, _)| here(format!("a record that has `{name}` too")))
        }
        (Sig::Int(shape), Value::List(items))
            if items.is_empty() && shape.first().is_some_and(|n| n.is_none_or(|n| n == 0)) =>
        {
            None
        }
        (Sig::Number | Sig::Angles | Sig::Var(_), Value::List(items)) if items.is_empty() => None,
        (Sig::Fn(..), Value::Function(_)) => None,
        (Sig::Is(ty), value) if is_of(ty, value) => None,
        _ => here(kind(value)),
    }
}

/// What is wrong with a part, seen from the whole.
fn within(part: &str, misfit: Option<Misfit>) -> Option<Misfit> {
    misfit.map(|misfit| Misfit { way: format!("{part}{}", misfit.way), ..misfit })
}

/// Whether numbers of that shape are as declared. They may be those of several values: `numbers` are all of them.
pub(super) fn are_numbers(sig: &Sig, shape: &[usize], numbers: &Var) -> bool {
    match sig {
        Sig::Is(ty) => has_shape(ty, shape),
        Sig::Int(wanted) => {
            has_shape(&Ty::Num(wanted.clone()), shape) && numbers.value().data.iter().all(|x| x.fract() == 0.0)
        }
        Sig::Color => shape.is_empty() || *shape == [3],
        Sig::Number | Sig::Angles | Sig::Any | Sig::Var(_) => true,
        Sig::Union(choices) => choices.iter().any(|choice| are_numbers(choice, shape, numbers)),
        Sig::List(item, n) => match shape.split_first() {
            Some((m, rest)) => n.is_none_or(|n| n == *m) && (*m == 0 || are_numbers(item, rest, numbers)),
            None => false,
        },
        Sig::Word(_) | Sig::Fn(..) | Sig::Record(_) => false,
    }
}

/// Whether numbers or angles of that shape are of a type.
fn has_shape(ty: &Ty, shape: &[usize]) -> bool {
    match ty {
        Ty::Any | Ty::Error => true,
        // Of an empty array only the first axis is known.
        Ty::Num(wanted) if shape == [0] => wanted.first().is_some_and(|n| n.is_none_or(|n| n == 0)),
        Ty::Num(wanted) => {
            wanted.len() == shape.len() && wanted.iter().zip(shape).all(|(wanted, n)| wanted.is_none_or(|w| w == *n))
        }
        Ty::Angle => shape.is_empty(),
        Ty::Array(item, wanted) => match shape.split_first() {
            Some((n, rest)) => wanted.is_none_or(|w| w == *n) && (*n == 0 || has_shape(item, rest)),
            None => false,
        },
        _ => false,
    }
}

/// Whether a value that is no array is of a type.
fn is_of(ty: &Ty, value: &Value) -> bool {
    match (ty, value) {
        (Ty::Any | Ty::Error, _) | (Ty::Bool, Value::Bool(_)) | (Ty::Str, Value::Str(_)) => true,
        (Ty::Image { .. } | Ty::AngleImage(_), Value::Image(_)) => true,
        (Ty::Rotation, Value::Rotation(_)) | (Ty::Transform, Value::Transform(_)) => true,
        (_, Value::Num(_) | Value::Bool(_) | Value::Str(_) | Value::Image(_) | Value::List(_) | Value::Record(_)) => {
            false
        }
        (Ty::Bool | Ty::Str | Ty::Num(_) | Ty::Angle | Ty::Image { .. } | Ty::AngleImage(_), _) => false,
        (Ty::Array(..) | Ty::Record(_) | Ty::Fn(..) | Ty::Rotation | Ty::Transform, _) => false,
        (Ty::Mesh | Ty::Material | Ty::Shape | Ty::Light | Ty::Camera { .. } | Ty::Scene | Ty::Texture, value) => {
            value.kind().rsplit(' ').next() == ty.to_string().split(' ').next()
        }
        // Settings of runs, which say themselves what they are.
        _ => !matches!(value, Value::Function(_)),
    }
}
