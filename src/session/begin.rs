//! How a run begins: a folder with its record, and a checkpoint before its first action.

use std::path::PathBuf;

use super::checkpoint::{Checkpoint, RunSettings};
use super::clock::Date;
use super::folder::{RunFolder, RunInfo, SourceText};
use crate::check::{LINE, hir};
use crate::diag::Diagnostic;
use crate::eval::Engine;
use crate::source::SourceFile;

/// A run that is to begin.
#[derive(Clone, Debug)]
pub struct Begin {
    /// The script's name without folder and extension.
    pub name: String,
    /// The words of the command line.
    pub command: Vec<String>,
    /// Number of worker threads.
    pub threads: usize,
    /// What is kept for those who resume the run.
    pub settings: RunSettings,
    /// Its folder; by default a new one in `runs`.
    pub out: Option<PathBuf>,
    /// Takes a folder with files in it.
    pub force: bool,
    /// Whether the log is written for TensorBoard as well.
    pub tensorboard: bool,
}

impl Begin {
    /// The new folder, and the checkpoint from which the run goes on: however early it is killed, what has a record can be resumed.
    pub fn run(self, engine: &Engine) -> Result<(RunFolder, Checkpoint), Diagnostic> {
        let info = RunInfo {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            name: self.name,
            file: self.settings.file.clone(),
            command: self.command,
            seed: self.settings.seed,
            threads: self.threads,
            started: Date::now().iso(),
            overrides: self.settings.overrides.clone(),
            steps: self.settings.steps,
            sources: source_texts(engine.program()),
        };
        let mut folder = match &self.out {
            Some(path) => RunFolder::at(path, self.force)?,
            None => RunFolder::fresh(&info.name, Date::now())?,
        };
        if self.tensorboard {
            folder.begin_events()?;
        }
        let checkpoint = Checkpoint::first(engine, self.settings, &mut folder)?;
        checkpoint.write(folder.path())?;
        folder.record(&info)?;
        Ok((folder, checkpoint))
    }
}

/// The script and its imports.
pub fn source_texts(program: &hir::Program) -> Vec<SourceText> {
    let is_set = |id| program.origin.overrides.iter().any(|(_, source)| *source == id);
    let is_script = |file: &SourceFile| file.path.is_some() && file.name != LINE;
    let scripts = program.sources.iter().filter(|(id, file)| is_script(file) && !is_set(*id));
    scripts.map(|(_, f)| SourceText { file: f.name.clone(), text: f.text.clone() }).collect()
}
