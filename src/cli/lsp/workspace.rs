//! Folders of the workspace with their scripts, the library as files, and the commands of code lenses.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use serde_json::{Value, json};

use super::message::{Failure, INVALID_PARAMS, notification, request};
use super::text::{path_of, uri_of};
use super::{Output, Server};
use crate::check::{library_text, normal};
use crate::ide::Analysis;
use crate::source::SourceFile;

/// More scripts of a workspace are not looked at.
const MOST_FILES: usize = 500;
/// Folders deeper below the workspace are not looked at.
const DEEPEST: usize = 6;

/// Pictures that clients were asked to show.
static SHOWN: AtomicUsize = AtomicUsize::new(0);

pub const RUN: &str = "dscene.run";
pub const RENDER: &str = "dscene.render";
pub const GRAD: &str = "dscene.grad";

impl Server {
    /// The folders that the client has opened.
    pub fn note_folders(&mut self, params: &Value) {
        let folders = params.get("workspaceFolders").and_then(Value::as_array);
        let uris = folders.into_iter().flatten().filter_map(|f| f.get("uri")).chain(params.get("rootUri"));
        self.folders = uris.filter_map(Value::as_str).filter_map(path_of).collect();
        self.folders.dedup();
    }

    /// All scripts of the workspace that are not open, with the paths of those that are.
    pub fn scripts(&self) -> Vec<PathBuf> {
        let mut found = Vec::new();
        for folder in &self.folders {
            collect(folder, DEEPEST, &mut found);
        }
        let mut found: Vec<PathBuf> = found.iter().map(|path| normal(path)).collect();
        found.sort();
        found.dedup();
        found
    }

    /// Analyses of all scripts that read a file: of the text itself first, then of what is open, then of the rest of the workspace.
    pub fn readers(&mut self, uri: &str, file: &Path) -> Vec<Arc<Analysis>> {
        let reads = |analysis: &Analysis| {
            analysis.known.sources.iter().any(|(_, f)| f.path.as_deref().is_some_and(|p| normal(p) == file))
        };
        let mut found: Vec<Arc<Analysis>> = self.documents.analysis(uri).into_iter().collect();
        let others: Vec<String> = self.documents.uris().into_iter().filter(|other| other != uri).collect();
        let mut known: Vec<PathBuf> = path_of(uri).iter().map(|p| normal(p)).collect();
        for other in others {
            known.extend(path_of(&other).map(|p| normal(&p)));
            found.extend(self.documents.analysis(&other).filter(|analysis| reads(analysis)));
        }
        for path in self.scripts().into_iter().filter(|path| !known.contains(path)) {
            // Most files import nothing.
            let imports =
                crate::files::read(&path).is_ok_and(|bytes| String::from_utf8_lossy(&bytes).contains("import"));
            if imports {
                found.extend(self.documents.analyse_file(&path).filter(|analysis| reads(analysis)));
            }
        }
        found
    }

    /// `dscene.run`, `dscene.render` and `dscene.grad` start this program with a file; what it has to say is shown when it ends, and so is the
    /// picture.
    pub fn execute(&mut self, params: &Value) -> Result<Value, Failure> {
        let invalid = |what: &str| Failure::new(INVALID_PARAMS, what);
        let command = params.get("command").and_then(Value::as_str).unwrap_or("");
        if ![RUN, RENDER, GRAD].contains(&command) {
            return Err(invalid(&format!("there is no command `{command}`")));
        }
        let argument = |i: usize| params.pointer(&format!("/arguments/{i}")).and_then(Value::as_str);
        let path = argument(0).and_then(path_of).ok_or_else(|| invalid("the first argument is the file's address"))?;
        let name = || argument(1).ok_or_else(|| invalid("the second argument is a name"));
        let mut arguments: Vec<String> = Vec::new();
        let mut picture = None;
        match command {
            RUN => arguments.extend(["run".to_owned(), path.display().to_string()]),
            RENDER => {
                let camera = name()?;
                let output = path.with_file_name(format!("{camera}.png"));
                let words = ["render", "--camera", camera, "-o", &output.display().to_string()];
                arguments.extend(words.map(str::to_owned));
                arguments.push(path.display().to_string());
                picture = Some(output).filter(|_| self.can_show);
            }
            // GRAD: as often as errors of the gradient need to be known.
            _ => {
                let words = ["grad", "--repeats", "8", "--of", name()?, &path.display().to_string()];
                arguments.extend(words.map(str::to_owned));
            }
        }
        if !self.starts_programs {
            return Err(invalid("this server starts no programs"));
        }
        let folder = path.parent().unwrap_or(Path::new("."));
        start(arguments, folder, picture, self.output.clone()).map_err(|why| invalid(&why))?;
        Ok(Value::Null)
    }
}

/// Runs this program and tells the client how it ended: all that it has said goes to the log. A message, of which editors show one line, has the first
/// error, or else the last line (where a picture is), or the value of the loss that was differentiated.
fn start(arguments: Vec<String>, folder: &Path, picture: Option<PathBuf>, tell: Output) -> Result<(), String> {
    let program = std::env::current_exe().map_err(|e| format!("cannot find dsl: {e}"))?;
    let child = Command::new(program)
        .args(&arguments)
        .current_dir(folder)
        .env("NO_COLOR", "1")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|e| format!("cannot start dsl: {e}"))?;
    let wait = move || {
        let Ok(output) = child.wait_with_output() else { return };
        let is_fine = output.status.success();
        let [found, said] =
            [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).trim().to_owned());
        let text = format!("{found}\n{said}");
        let message = format!("dsl {}\n{}", arguments.join(" "), text.trim());
        tell(&notification("window/logMessage", json!({"type": 3, "message": message})));
        let last = text.trim().lines().last().unwrap_or("").trim();
        let wrong = said.lines().find_map(|line| line.trim_start().strip_prefix("× ")).filter(|_| !is_fine);
        let line = match (wrong, found.lines().next()) {
            (Some(wrong), _) => wrong.to_owned(),
            (None, Some(first)) if is_fine && arguments[0] == "grad" => format!("{first}, gradient in the output"),
            (None, _) => last.to_owned(),
        };
        let kind = if is_fine { 3 } else { 1 };
        tell(&notification("window/showMessage", json!({"type": kind, "message": line})));
        if let Some(picture) = picture.filter(|_| is_fine) {
            let params = json!({"uri": uri_of(&picture), "takeFocus": false});
            let id = format!("picture {}", SHOWN.fetch_add(1, Ordering::Relaxed));
            tell(&request(&id, "window/showDocument", params));
        }
    };
    let thread = std::thread::Builder::new().name("command".to_owned()).spawn(wait);
    thread.map(|_| ()).map_err(|e| format!("cannot start a thread: {e}"))
}

fn collect(folder: &Path, depth: usize, found: &mut Vec<PathBuf>) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    let mut paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    paths.sort();
    for path in paths {
        let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        if found.len() >= MOST_FILES || name.starts_with('.') {
            continue;
        }
        if path.is_dir() {
            if depth > 0 && name != "target" && name != "node_modules" {
                collect(&path, depth - 1, found);
            }
        } else if name.ends_with(".dscene") {
            found.push(path);
        }
    }
}

/// A file of the library, written where editors can open it: into a folder of this version in the user's cache.
pub fn library_file(file: &SourceFile) -> Option<PathBuf> {
    let name = file.name.strip_prefix("std/")?;
    let text = library_text(name.strip_suffix(".dscene")?)?;
    let folder = library_folder();
    let path = folder.join(name);
    if std::fs::read_to_string(&path).ok().as_deref() != Some(text) {
        std::fs::create_dir_all(&folder).ok()?;
        crate::files::write_atomically(&path, text.as_bytes()).ok()?;
    }
    Some(path)
}

/// Whether a path is that of a file of the library, as [`library_file`] writes it.
pub fn is_library(path: &Path) -> bool {
    normal(path).starts_with(normal(&library_folder()))
}

fn library_folder() -> PathBuf {
    let variable = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    let cache = if cfg!(windows) {
        variable("LOCALAPPDATA")
    } else if cfg!(target_os = "macos") {
        variable("HOME").map(|home| home.join("Library/Caches"))
    } else {
        variable("XDG_CACHE_HOME").or_else(|| variable("HOME").map(|home| home.join(".cache")))
    };
    cache.unwrap_or_else(std::env::temp_dir).join("dscene").join(format!("std-{}", env!("CARGO_PKG_VERSION")))
}
