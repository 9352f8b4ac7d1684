//! The line editor: multi-line input while brackets are open, completion, history.

use std::borrow::Cow;
use std::path::PathBuf;

use rustyline::completion::{Completer, Pair};
use rustyline::error::ReadlineError;
use rustyline::highlight::Highlighter;
use rustyline::hint::Hinter;
use rustyline::history::DefaultHistory;
use rustyline::validate::{ValidationContext, ValidationResult, Validator};
use rustyline::{Config, Context, Editor, Helper};

use super::input::{Completeness, completeness};

/// Names that Tab knows.
#[derive(Clone, Debug, Default)]
pub struct Words {
    /// Declarations of the file and the library.
    pub names: Vec<String>,
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
        let start = position - path.len();
        return (start, files(path.trim_start()));
    }
    let start = before
        .rfind(|c: char| !c.is_alphanumeric() && c != '_')
        .map_or(0, |i| i + before[i..].chars().next().map_or(1, char::len_utf8));
    let prefix = &before[start..];
    let mut found: Vec<String> = words.names.iter().filter(|n| n.starts_with(prefix)).cloned().collect();
    found.sort();
    found.dedup();
    (start, if prefix.is_empty() { Vec::new() } else { found })
}

/// Scripts and folders whose path begins so.
fn files(prefix: &str) -> Vec<String> {
    let (folder, start) = prefix.rsplit_once('/').map_or(("", prefix), |(f, s)| (f, s));
    let place = if folder.is_empty() && !prefix.starts_with('/') { "." } else { folder };
    let place = if place.is_empty() { "/" } else { place };
    let Ok(entries) = std::fs::read_dir(place) else {
        return Vec::new();
    };
    let shown = |entry: std::fs::DirEntry| {
        let name = entry.file_name().into_string().ok()?;
        let is_folder = entry.file_type().is_ok_and(|t| t.is_dir());
        let fits = name.starts_with(start) && (is_folder || name.ends_with(".dscene"));
        let parent = if prefix.contains('/') { format!("{folder}/") } else { String::new() };
        (fits && !name.starts_with('.')).then(|| format!("{parent}{name}{}", if is_folder { "/" } else { "" }))
    };
    let mut found: Vec<String> = entries.flatten().filter_map(shown).collect();
    found.sort();
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tab_completes_names_and_commands() {
        let words = Words {
            names: vec!["render".into(), "rectangle".into(), "corners".into()],
            commands: vec![":help".into(), ":params".into()],
        };
        assert_eq!(candidates(&words, ":he", 3), (0, vec![":help".to_owned()]));
        assert_eq!(candidates(&words, "mean(re", 7), (5, vec!["rectangle".to_owned(), "render".to_owned()]));
        assert_eq!(candidates(&words, "é + cor", 8), (5, vec!["corners".to_owned()]));
        assert_eq!(candidates(&words, "", 0), (0, vec![]));
    }
}
