//! The values that the session has shown: `_` is the last one, `_1`, `_2`, … all of them in order. They stay as they were shown, whatever
//! changes later.

use std::collections::VecDeque;

use super::Repl;
use crate::check::hir::DeclId;
use crate::check::types::Ty;
use crate::diag::Diagnostic;
use crate::ide::lexical::{TokenKind, tokens};
use crate::natives::value::Value;
use crate::session::line::give;
use crate::syntax;

/// How many of them are kept: a program that drives the REPL for a day must not fill the memory.
const KEPT: usize = 100;

#[derive(Default)]
pub struct Values {
    kept: VecDeque<Kept>,
    /// The number of the last one.
    count: u64,
}

pub struct Kept {
    pub name: String,
    /// What was typed.
    text: String,
    pub ty: Ty,
    /// `None` for what cannot be kept apart from the program: functions, materials, lights.
    pub value: Option<Value>,
}

impl Values {
    /// Those that are kept, in order.
    pub fn all(&self) -> impl Iterator<Item = &Kept> {
        self.kept.iter()
    }
}

impl Repl<'_> {
    /// Keeps a value that is shown; gives its name.
    pub(super) fn keep(&mut self, text: &str, ty: &Ty, value: &Value) -> String {
        let program = self.living.engine.program();
        let own = |name: &str| program.find(name).is_some();
        // A script may have names of that kind.
        let number = (self.values.count + 1..).find(|n| !own(&format!("_{n}"))).unwrap_or(u64::MAX);
        let name = format!("_{number}");
        self.values.count = number;
        let kept = Kept { name: name.clone(), text: text.to_owned(), ty: ty.clone(), value: value.detached() };
        self.values.kept.push_back(kept);
        if self.values.kept.len() > KEPT {
            self.values.kept.pop_front();
        }
        name
    }

    /// The text with the name of the last value in the place of `_`, so that it means the same later. Values that it mentions become
    /// declarations of the program.
    pub(super) fn spelled_out(&mut self, text: &str) -> Result<String, Diagnostic> {
        let mut spelled = String::with_capacity(text.len());
        let mut copied = 0;
        let words = tokens(text).into_iter().filter(|token| token.kind == TokenKind::Word);
        for token in words {
            let word = token.text(text);
            let is_number = word.len() > 1 && word[1..].bytes().all(|b| b.is_ascii_digit());
            if !(word == "_" || word.starts_with('_') && is_number) {
                continue;
            }
            let last = self.values.kept.back().map(|kept| kept.name.clone());
            let name = match (word, last) {
                ("_", Some(last)) => last,
                _ => word.to_owned(),
            };
            self.declare_value(&name, text)?;
            spelled.push_str(&text[copied..token.start]);
            spelled.push_str(&name);
            copied = token.end;
        }
        spelled.push_str(&text[copied..]);
        Ok(spelled)
    }

    /// Makes a kept value a declaration, for a text that mentions it. What never was a value is the checker's to report.
    fn declare_value(&mut self, name: &str, mentioned_in: &str) -> Result<(), Diagnostic> {
        let id = match self.living.engine.program().find(name) {
            Some(id) => id,
            None => match self.give_kept(name)? {
                Some(id) => id,
                None => return Ok(()),
            },
        };
        // Declarations that mention a value are saved with it.
        let source = self.living.engine.program().decl(id).span.source;
        let is_given = self.living.engine.program().origin.given.contains_key(&source);
        if is_given && syntax::is_statement(mentioned_in) && !self.typed.contains(&source) {
            self.typed.push(source);
        }
        Ok(())
    }

    fn give_kept(&mut self, name: &str) -> Result<Option<DeclId>, Diagnostic> {
        let gone = |message: String| Err(Diagnostic::error("dscene::repl::value", message));
        let Some(kept) = self.values.kept.iter().find(|kept| kept.name == name) else {
            let number = name[1..].parse().unwrap_or(u64::MAX);
            if number <= self.values.count && number > 0 {
                return gone(format!("`{name}` is not kept any more: only the last {KEPT} values are"));
            }
            return Ok(None);
        };
        let Some(value) = kept.value.clone() else {
            let what = kept.ty.a();
            return gone(format!("`{name}` was {what}, which is not kept: type `{}` again", kept.text));
        };
        Ok(give(&mut self.living.engine, name, &kept.text, &kept.ty, value))
    }
}
