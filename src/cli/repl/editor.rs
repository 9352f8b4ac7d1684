//! The line editor: multi-line input while brackets are open, completion, history.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use rustyline::completion::{Completer, Pair};
use rustyline::error::ReadlineError;
use rustyline::highlight::Highlighter;
use rustyline::hint::Hinter;
use rustyline::history::DefaultHistory;
use rustyline::validate::{ValidationContext, ValidationResult, Validator};
use rustyline::{Config, Context, Editor, Helper};

use super::input::{Completeness, completeness};
use crate::ide::complete::{Completion, What, complete};
use crate::ide::{Analysis, files};
use crate::syntax;

/// What Tab knows.
#[derive(Default)]
pub struct Words {
    /// What the program sees.
    pub known: Option<Analysis>,
    /// `:help` and its kin, with the colon.
    pub commands: Vec<String>,
}

/// Reads lines from a terminal.
pub struct LineEditor {
    editor: Editor<Assistant, DefaultHistory>,
    history: Option<PathBuf>,
}

/// What came from the user.
#[derive(Debug, PartialEq, Eq)]
pub enum Input {
    Text(String),
    /// Ctrl-C: the line is dropped.
    Interrupted,
    /// Ctrl-D.
    End,
}

impl LineEditor {
    /// With the history of earlier sessions, if there is a place for it.
    pub fn new() -> rustyline::Result<LineEditor> {
        let config =
            Config::builder().max_history_size(2000)?.history_ignore_dups(true)?.auto_add_history(true).build();
        let mut editor: Editor<Assistant, DefaultHistory> = Editor::with_config(config)?;
        editor.set_helper(Some(Assistant::default()));
        let history = history_path();
        if let Some(path) = &history {
            // There is none on the first day.
            let _ = editor.load_history(path);
        }
        Ok(LineEditor { editor, history })
    }

    pub fn set_words(&mut self, words: Words) {
        if let Some(assistant) = self.editor.helper_mut() {
            assistant.words = words;
        }
    }

    pub fn read(&mut self) -> rustyline::Result<Input> {
        match self.editor.readline("dsl> ") {
            Ok(text) => Ok(Input::Text(text)),
            Err(ReadlineError::Interrupted) => Ok(Input::Interrupted),
            Err(ReadlineError::Eof) => Ok(Input::End),
            Err(e) => Err(e),
        }
    }

    /// Keeps the history for the next session; a read-only home is no reason to complain.
    pub fn save_history(&mut self) {
        if let Some(path) = &self.history {
            if let Some(parent) = path.parent() {
                let _ = std::fs::create_dir_all(parent);
            }
            let _ = self.editor.save_history(path);
        }
    }
}

/// `history` in dscene's folder of the user's data directory.
fn history_path() -> Option<PathBuf> {
    let variable = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    let data = if cfg!(windows) {
        variable("APPDATA")
    } else if cfg!(target_os = "macos") {
        variable("HOME").map(|home| home.join("Library/Application Support"))
    } else {
        variable("XDG_DATA_HOME").or_else(|| variable("HOME").map(|home| home.join(".local/share")))
    };
    Some(data?.join("dscene").join("history"))
}

#[derive(Default)]
struct Assistant {
    words: Words,
}

impl Helper for Assistant {}

impl Hinter for Assistant {
    type Hint = String;
}

impl Highlighter for Assistant {
    fn highlight_prompt<'b, 's: 'b, 'p: 'b>(&'s self, prompt: &'p str, _default: bool) -> Cow<'b, str> {
        Cow::Owned(format!("\x1b[1;36m{prompt}\x1b[0m"))
    }
}

impl Validator for Assistant {
    fn validate(&self, context: &mut ValidationContext<'_>) -> rustyline::Result<ValidationResult> {
        Ok(match completeness(context.input()) {
            Completeness::Complete => ValidationResult::Valid(None),
            Completeness::Open => ValidationResult::Incomplete,
        })
    }
}

impl Completer for Assistant {
    type Candidate = Pair;

    fn complete(&self, line: &str, position: usize, _: &Context<'_>) -> rustyline::Result<(usize, Vec<Pair>)> {
        let (start, candidates) = candidates(&self.words, line, position);
        let pair = |word: String| Pair { display: word.clone(), replacement: word };
        Ok((start, candidates.into_iter().map(pair).collect()))
    }
}

/// Where the word at `position` begins and what it may become.
fn candidates(words: &Words, line: &str, position: usize) -> (usize, Vec<String>) {
    let before = line.get(..position).unwrap_or(line);
    if before.starts_with(':') && !before.contains(' ') {
        return (0, words.commands.iter().filter(|c| c.starts_with(before)).cloned().collect());
    }
    if let Some(path) = before.strip_prefix(":load ") {
        let path = path.trim_start();
        return (position - path.len(), files::paths(Path::new("."), path, &[".dscene"]));
    }
    let Some(known) = &words.known else { return (position, Vec::new()) };
    // What a command is given is an expression; a line is a statement or an expression.
    let (skipped, as_statement) = match before.strip_prefix(':').and_then(|rest| rest.find(' ')) {
        Some(space) => (space + 1, None),
        None => (0, Some(complete(known, line, position))),
    };
    const PRINT: &str = "print ";
    let as_expression = format!("{PRINT}{}", &line[skipped..]);
    let mut found = complete(known, &as_expression, position - skipped + PRINT.len());
    found.start = (found.start + skipped).saturating_sub(PRINT.len());
    if let Some(statement) = as_statement {
        // Where a statement is being written, it is no argument of `print`.
        if statement.items.iter().any(|item| item.what != What::Keyword) || syntax::is_statement(before) {
            found = statement;
        } else {
            found.items.extend(statement.items);
        }
    }
    let prefix = before.get(found.start..).unwrap_or("");
    let is_bare = prefix.is_empty() && matches!(before.trim_end().chars().next_back(), None | Some(')' | ']' | '}'));
    let fits = |item: &Completion| item.label.starts_with(prefix) && !is_bare;
    let mut texts: Vec<String> = found.items.into_iter().filter(fits).map(|item| item.text).collect();
    texts.sort();
    texts.dedup();
    (found.start, texts)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::{check_line, library};

    #[test]
    fn tab_completes_names_fields_arguments_and_commands() {
        let mut program = library();
        check_line(&mut program, "let corners = [[1, 2], [3, 4]]");
        let commands = vec![":help".into(), ":params".into(), ":type".into()];
        let words = Words { known: Analysis::of_program(&program), commands };
        for (line, start, wanted) in [
            (":he", 0, &[":help"][..]),
            ("mean(rect", 5, &["rectangle"]),
            ("\"é\" + corn", 7, &["corners"]),
            (":type corn", 6, &["corners"]),
            ("corners[0].", 11, &["g", "r", "x", "y"]),
            ("sphere(rad", 7, &["radius: "]),
            ("let c = corn", 8, &["corners"]),
            ("camera eye { kind: ortho", 19, &["orthographic"]),
            ("opti", 0, &["optimize"]),
            ("", 0, &[]),
        ] {
            let (at, found) = candidates(&words, line, line.len());
            assert_eq!(
                (at, found.iter().map(String::as_str).collect::<Vec<_>>().as_slice()),
                (start, wanted),
                "{line}"
            );
        }
    }
}
