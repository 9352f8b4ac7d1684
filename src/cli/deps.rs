//! `dsl check --deps`: the files that a script reads.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::json;

use super::args::Common;
use super::load::{Noting, STDIN, check_file_by};
use super::out;
use super::run::name_of;
use crate::check::hir::{Callee, DeclKind, Expr, ExprKind, Program, StrPart};
use crate::check::{Checked, Purpose, READERS, walk};
use crate::files;
use crate::mesh::load::{EXTENSIONS, Wanted, load};

/// Checks a file and tells what it reads: its imports, the files that it names, and those that these name. Whether it has no errors is for
/// the caller to see.
pub fn run(file: &Path, common: &Common) -> Checked {
    let noting = Noting::default();
    let checked = check_file_by(Purpose::Run, file, common, &noting);
    let Some(program) = &checked.program else { return checked };
    let mut found: Vec<PathBuf> =
        noting.asked().into_iter().map(|(path, _)| path).filter(|path| path.is_file()).collect();
    let meshes: Vec<PathBuf> = found.iter().filter(|path| is_mesh(path)).cloned().collect();
    for mesh in meshes {
        found.extend(parts(&mesh));
    }
    let mut seen = std::collections::HashSet::new();
    found.retain(|path| seen.insert(path.canonicalize().unwrap_or_else(|_| path.clone())));
    let unknown = unknown(program);
    let target = match &common.out {
        Some(folder) => folder.clone(),
        None => Path::new("runs").join(name_of(file)),
    };
    if common.json {
        let files: Vec<String> = found.iter().map(|path| path.display().to_string()).collect();
        let (file, target) = (file.display().to_string(), target.display().to_string());
        out::line(&json!({ "file": file, "target": target, "deps": files, "unknown": unknown }).to_string());
    } else {
        out::line(&rule(&target, &found));
        for text in unknown {
            out::line(&format!("# and what `{text}` names when it runs"));
        }
    }
    checked
}

fn is_mesh(path: &Path) -> bool {
    path.extension().is_some_and(|ending| EXTENSIONS.contains(&ending.to_string_lossy().to_lowercase().as_str()))
}

/// The files that a mesh's file names: materials, textures, buffers. They are known once it is read.
fn parts(mesh: &Path) -> Vec<PathBuf> {
    let before: Vec<PathBuf> = files::inputs().into_iter().map(|(path, _)| path).collect();
    // What is wrong with it is for the run to say.
    let _ = load(mesh, Wanted::Scene);
    let new = files::inputs().into_iter().map(|(path, _)| path).filter(|path| !before.contains(path));
    let here = fs::canonicalize(".").unwrap_or_default();
    new.map(|path| path.strip_prefix(&here).map_or(path.clone(), Path::to_path_buf)).collect()
}

/// Names of files that are known when the program runs, as they are written.
fn unknown(program: &Program) -> Vec<String> {
    let mut found = Vec::new();
    let mut look = |e: &Expr| {
        walk(e, &mut |e| {
            let ExprKind::Call(call) = &e.kind else { return };
            let Callee::Native(id) = call.callee else { return };
            if !READERS.contains(&program.decl(id).name.as_str()) {
                return;
            }
            let Some(Some(path)) = call.args.first() else { return };
            let is_written = match &path.kind {
                ExprKind::Str(parts) => parts.iter().all(|part| matches!(part, StrPart::Text(_))),
                // Textures and environments are made of pictures too.
                _ => path.ty != crate::check::types::Ty::Str,
            };
            if !is_written {
                found.push(program.sources.text(e.span).split_whitespace().collect::<Vec<&str>>().join(" "));
            }
        });
    };
    for decl in program.ids().map(|id| program.decl(id)).filter(|decl| decl.user) {
        decl.body.as_deref().into_iter().for_each(&mut look);
        if let DeclKind::Fn(function) = &decl.kind {
            look(&function.body);
        }
    }
    program.actions.iter().flat_map(crate::check::hir::Action::parts).for_each(&mut look);
    found
}

/// A rule as Make reads it.
fn rule(target: &Path, files: &[PathBuf]) -> String {
    let escaped = |path: &Path| {
        let text = path.display().to_string();
        text.replace('$', "$$").replace('#', "\\#").replace(' ', "\\ ")
    };
    let is_file = |path: &&PathBuf| path.as_path() != Path::new(STDIN);
    let mut rule = format!("{}:", escaped(target));
    for file in files.iter().filter(is_file) {
        rule.push_str(" \\\n  ");
        rule.push_str(&escaped(file));
    }
    rule
}
