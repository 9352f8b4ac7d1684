//! The line editor: multi-line input while brackets are open, completion, history.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use rustyline::completion::{Completer, Pair};
use rustyline::error::ReadlineError;
use rustyline::highlight::{CmdKind, Highlighter};
use rustyline::hint::Hinter;
use rustyline::history::DefaultHistory;
use rustyline::validate::{ValidationContext, ValidationResult, Validator};
use rustyline::{CompletionType, Config, Context, Editor, Helper};

use super::input::{Completeness, completeness};
use crate::cli::bars;
use crate::cli::out;
use crate::ide::complete::{Completion, What, complete};
use crate::ide::tokens::{Class, words_painted};
use crate::ide::{Analysis, files};
use crate::syntax;

/// What Tab knows.
#[derive(Default)]
pub struct Words {
    /// What the program sees.
    pub known: Option<Analysis>,
    /// `:help` and its kin, without the colon: name, arguments and what it does.
    pub commands: &'static [(&'static str, &'static str, &'static str)],
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
        // All that may follow is listed, below the line.
        let config = Config::builder()
            .max_history_size(2000)?
            .history_ignore_dups(true)?
            .auto_add_history(true)
            .completion_type(CompletionType::List)
            .build();
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
        let columns = self.editor.dimensions().map_or(80, |(columns, _)| usize::from(columns));
        if let Some(assistant) = self.editor.helper_mut() {
            *assistant = Assistant { words, columns };
        }
    }

    pub fn read(&mut self) -> rustyline::Result<Input> {
        bars::clear();
        match self.editor.readline("dsl> ") {
            Ok(text) => Ok(Input::Text(text)),
            Err(ReadlineError::Interrupted) => Ok(Input::Interrupted),
            Err(ReadlineError::Eof) => Ok(Input::End),
            Err(e) => Err(e),
        }
    }

    /// Keeps what was typed since the last call for other sessions, also if this one is killed; a read-only home is no reason to complain.
    pub fn keep_history(&mut self) {
        if let Some(path) = &self.history {
            if let Some(parent) = path.parent() {
                let _ = std::fs::create_dir_all(parent);
            }
            let _ = self.editor.append_history(path);
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
    /// Of the terminal.
    columns: usize,
}

impl Helper for Assistant {}

impl Hinter for Assistant {
    type Hint = String;
}

impl Highlighter for Assistant {
    fn highlight_prompt<'b, 's: 'b, 'p: 'b>(&'s self, prompt: &'p str, _default: bool) -> Cow<'b, str> {
        if !out::colors_on_stdout() {
            return Cow::Borrowed(prompt);
        }
        Cow::Owned(format!("\x1b[1;36m{prompt}\x1b[0m"))
    }

    fn highlight<'l>(&self, line: &'l str, _position: usize) -> Cow<'l, str> {
        match &self.words.known {
            Some(known) if out::colors_on_stdout() => Cow::Owned(highlighted(known, line)),
            _ => Cow::Borrowed(line),
        }
    }

    /// A character may change what those before it are: all are drawn anew.
    fn highlight_char(&self, _line: &str, _position: usize, _kind: CmdKind) -> bool {
        out::colors_on_stdout()
    }
}

/// The line with colours for what its words are.
fn highlighted(known: &Analysis, line: &str) -> String {
    // The name of a command is no word of the language.
    let start = match line.starts_with(':') {
        true => line.find(' ').unwrap_or(line.len()),
        false => 0,
    };
    let (command, text) = line.split_at(start);
    let mut out = if command.is_empty() { String::new() } else { format!("\x1b[36m{command}\x1b[0m") };
    let mut copied = 0;
    for piece in words_painted(known, text) {
        let color = match piece.class {
            Class::Comment => "2",
            Class::String => "32",
            Class::Number => "33",
            Class::Keyword => "1;35",
            Class::Function => "34",
            Class::Type | Class::Module => "36",
            Class::Param => "1",
            Class::Variable | Class::Parameter | Class::Property | Class::Word => continue,
        };
        let (before, word) = (&text[copied..piece.start], &text[piece.start..piece.end]);
        out.push_str(&format!("{before}\x1b[{color}m{word}\x1b[0m"));
        copied = piece.end;
    }
    out.push_str(&text[copied..]);
    out
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
        let (start, mut candidates) = candidates(&self.words, line, position);
        describe(&mut candidates, self.columns);
        let pair = |c: Candidate| Pair { display: c.shown, replacement: c.text };
        Ok((start, candidates.into_iter().map(pair).collect()))
    }
}

/// Something that Tab may write.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Candidate {
    text: String,
    /// What stands in the list.
    shown: String,
    /// Its type, and the first sentence of its documentation.
    about: String,
}

/// More candidates than these are listed by their names alone, side by side.
const DESCRIBED: usize = 24;

/// Has the list say what the candidates are, each in a line that the terminal holds.
fn describe(candidates: &mut [Candidate], columns: usize) {
    if candidates.len() > DESCRIBED {
        return;
    }
    let width = candidates.iter().map(|c| c.shown.chars().count()).max().unwrap_or(0).min(columns / 2);
    for candidate in candidates.iter_mut().filter(|c| !c.about.is_empty()) {
        let line = format!("{:width$}  {}", candidate.shown, candidate.about);
        let most = columns.saturating_sub(2);
        candidate.shown = match line.chars().count() > most {
            true => line.chars().take(most.saturating_sub(1)).chain(['…']).collect(),
            false => line,
        };
    }
}

impl Candidate {
    fn new(text: impl Into<String>, about: impl Into<String>) -> Candidate {
        let text = text.into();
        Candidate { shown: text.trim_end_matches([' ', ':', '(']).to_owned(), text, about: about.into() }
    }

    fn of(item: Completion) -> Candidate {
        // Up to the end of the first sentence: lists have one line for each.
        let docs = item.docs.lines().next().unwrap_or("");
        let sentence = docs.split_once(". ").map_or(docs, |(first, _)| first).trim_end_matches('.');
        let parts: Vec<&str> = [item.detail.as_str(), sentence].into_iter().filter(|part| !part.is_empty()).collect();
        let about = parts.join(" · ");
        Candidate { text: item.text, shown: item.label, about }
    }
}

/// Where the word at `position` begins and what it may become.
fn candidates(words: &Words, line: &str, position: usize) -> (usize, Vec<Candidate>) {
    let before = line.get(..position).unwrap_or(line);
    if before.starts_with(':') && !before.contains(' ') {
        let fits = words.commands.iter().filter(|(name, ..)| name.starts_with(&before[1..]));
        let command = |(name, arguments, what): &(&str, &str, &str)| {
            let about = if arguments.is_empty() { (*what).to_owned() } else { format!("{arguments} · {what}") };
            Candidate::new(format!(":{name}"), about)
        };
        return (0, fits.map(command).collect());
    }
    if let Some((_, path)) = before.split_once(' ').filter(|(c, _)| [":load", ":save"].contains(c)) {
        let path = path.trim_start();
        let paths = files::paths(Path::new("."), path, &[".dscene"]).into_iter();
        return (position - path.len(), paths.map(|path| Candidate::new(path, "")).collect());
    }
    let Some(known) = &words.known else { return (position, Vec::new()) };
    // These begin with a name of one's own.
    let named = before.split_once(' ').filter(|(command, _)| [":set", ":edit"].contains(command));
    if let Some(name) = named.map(|(_, rest)| rest.trim_start()).filter(|name| !name.contains(' ')) {
        let program = &known.known.program;
        let own = program.ids().map(|id| program.decl(id)).filter(|d| d.user && d.name.starts_with(name));
        let mut found: Vec<Candidate> = own.map(|d| Candidate::new(&*d.name, d.ty.to_string())).collect();
        found.sort_by(|a, b| a.text.cmp(&b.text));
        return (position - name.len(), found);
    }
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
    // Where a call's arguments begin these are what is asked for, not the hundreds of names that may stand there too.
    let argues = prefix.is_empty() && found.items.iter().any(|item| item.what == What::Argument);
    let fits =
        |item: &Completion| item.label.starts_with(prefix) && !is_bare && (!argues || item.what == What::Argument);
    let mut all: Vec<Candidate> = found.items.into_iter().filter(fits).map(Candidate::of).collect();
    all.sort_by(|a, b| a.text.cmp(&b.text));
    all.dedup_by(|a, b| a.text == b.text);
    (found.start, all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::types::Ty;
    use crate::check::{check_line, library};

    #[test]
    fn tab_completes_names_fields_arguments_and_commands() {
        let mut program = library();
        check_line(&mut program, "let corners = [[1, 2], [3, 4]]");
        check_line(&mut program, "fn far(view: { place: vec3, glow: scalar }) = view.glow");
        let view = Ty::Record(vec![("place".to_owned(), Ty::vector(3)), ("glow".to_owned(), Ty::SCALAR)].into());
        let shown = vec![("_1".to_owned(), Ty::SCALAR), ("_2".to_owned(), view.clone()), ("_".to_owned(), view)];
        let words = Words {
            known: Analysis::of_program(&program).map(|known| Analysis { shown, ..known }),
            commands: &[("help", "[NAME]", "this list"), ("params", "", "every param"), ("type", "EXPR", "the type")],
        };
        for (line, start, wanted) in [
            (":he", 0, &[":help"][..]),
            ("mean(rect", 5, &["rectangle"]),
            ("\"é\" + corn", 7, &["corners"]),
            (":type corn", 6, &["corners"]),
            (":set ", 5, &["corners", "far"]),
            (":edit co", 6, &["corners"]),
            (":set corners corn", 13, &["corners"]),
            ("corners[0].", 11, &["g", "r", "x", "y"]),
            ("sphere(rad", 7, &["radius: "]),
            ("let c = corn", 8, &["corners"]),
            ("camera eye { kind: ortho", 19, &["orthographic"]),
            ("opti", 0, &["optimize"]),
            ("", 0, &[]),
            ("2 * _", 4, &["_", "_1", "_2"]),
            ("_.", 2, &["glow", "place"]),
            ("_2.place.", 9, &["b", "g", "r", "x", "y", "z"]),
            (":type _.gl", 8, &["glow"]),
            ("print _1 + _.pl", 13, &["place"]),
            ("far({ ", 6, &["glow: ", "place: "]),
            ("let v: { x: scalar, y: vec3 } = { x: 1, ", 40, &["y: "]),
        ] {
            let (at, found) = candidates(&words, line, line.len());
            assert_eq!(
                (at, found.iter().map(|c| c.text.as_str()).collect::<Vec<_>>().as_slice()),
                (start, wanted),
                "{line}"
            );
        }
    }

    fn words(lines: &[&str]) -> Words {
        let mut program = library();
        lines.iter().for_each(|line| drop(check_line(&mut program, line)));
        Words { known: Analysis::of_program(&program), commands: super::super::commands::NAMES }
    }

    #[test]
    fn lists_say_what_is_in_them() {
        let words = words(&["/// How bright it is. Rarely more.\nparam glow = 0.5 in 0..1"]);
        let shown = |line: &str, columns: usize| {
            let (_, mut found) = candidates(&words, line, line.len());
            describe(&mut found, columns);
            found.into_iter().map(|c| c.shown).collect::<Vec<String>>()
        };
        assert_eq!(shown("2 * glo", 80), ["glow  scalar · How bright it is"]);
        assert_eq!(
            shown(":und", 80),
            [":undo  takes back the last entry that changed something; again for the one be…"]
        );
        assert!(shown("sphere(rad", 80)[0].starts_with("radius  scalar"), "{:?}", shown("sphere(rad", 80));
        // Where there are many, their names stand side by side.
        assert!(shown("s", 80).contains(&"sphere".to_owned()), "{:?}", shown("s", 80));
        assert!(shown("2 * glo", 20).iter().all(|line| line.chars().count() <= 18));
    }

    #[test]
    fn words_have_the_colours_of_what_they_are() {
        let words = words(&["param glow = 0.5 in 0..1"]);
        let known = words.known.unwrap();
        assert_eq!(
            highlighted(&known, "let a = glow * sqrt(2) // why"),
            "\x1b[1;35mlet\x1b[0m a = \x1b[1mglow\x1b[0m * \x1b[34msqrt\x1b[0m(\x1b[33m2\x1b[0m) \x1b[2m// why\x1b[0m"
        );
        assert_eq!(highlighted(&known, ":type glow"), "\x1b[36m:type\x1b[0m \x1b[1mglow\x1b[0m");
        assert_eq!(highlighted(&known, ":quit"), "\x1b[36m:quit\x1b[0m");
        assert_eq!(highlighted(&known, "print \"é"), "\x1b[1;35mprint\x1b[0m \x1b[32m\"é\x1b[0m");
    }
}
