//! Paths: when two are the same file, and of files that are not there what was probably meant.

use std::path::{Path, PathBuf};

use crate::diag::suggest;

/// Entries of a folder that are looked at for a name like the one that is written.
const LOOKED_AT: usize = 4096;

/// The help for a path at which there is no file, if it can be told what is wrong with it; it is written in a script that lies in `folder`.
pub fn missing(path: &str, folder: &Path) -> Option<String> {
    let scheme =
        path.split_once("://").map(|(scheme, _)| scheme).filter(|s| s.bytes().all(|b| b.is_ascii_alphabetic()));
    Some(if path.trim().is_empty() {
        "write the name of a file".to_owned()
    } else if let Some(scheme) = scheme {
        match path.strip_prefix("file://") {
            Some(rest) => format!("write the path alone: `\"{rest}\"`"),
            None => format!("files are read from the disk: fetch it first (`curl -O {path}`); {scheme} is not spoken"),
        }
    } else if path.starts_with(['~', '$']) {
        "nothing is put in the place of `~` or `$NAME`: write the path from the folder of the script, or from `/` on"
            .to_owned()
    } else if cfg!(unix) && path.contains('\\') {
        format!("folders are told apart by `/`: `\"{}\"`", path.replace('\\', "/"))
    } else if path.contains(['*', '?']) {
        "a path names one file: read several by `[load(\"{name}.obj\") for name in [\"a\", \"b\"]]`".to_owned()
    } else {
        format!("did you mean `\"{}\"`?", nearest(path, folder)?)
    })
}

/// The help for a path to a folder where a file is wanted.
pub fn within(path: &str, folder: &Path) -> String {
    let first = names(&folder.join(path)).into_iter().find(|name| !name.starts_with('.') && name.contains('.'));
    match first {
        Some(name) => format!("name a file in it, for instance `\"{}/{name}\"`", path.trim_end_matches('/')),
        None => "name a file in it".to_owned(),
    }
}

/// A path to something that exists, whose parts are like those that are written.
fn nearest(path: &str, folder: &Path) -> Option<String> {
    let mut found = PathBuf::new();
    for part in Path::new(path).components() {
        let written = part.as_os_str().to_str()?;
        if folder.join(&found).join(written).exists() {
            found.push(written);
            continue;
        }
        let names = names(&folder.join(&found));
        let plain = written.trim();
        let alike = names.iter().find(|name| name.as_str() == plain).map(String::as_str);
        found.push(alike.or_else(|| suggest(written, names.iter().map(String::as_str)))?);
    }
    folder.join(&found).is_file().then(|| found.to_str().map(|found| found.replace('\\', "/")))?
}

fn names(folder: &Path) -> Vec<String> {
    let place = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let entries = std::fs::read_dir(place).into_iter().flatten().flatten().take(LOOKED_AT);
    let mut names: Vec<String> = entries.filter_map(|entry| entry.file_name().into_string().ok()).collect();
    names.sort_unstable();
    names
}

/// Normalises a path, so that `a/./b/../c` and `a/c` are the same file.
pub fn normal(path: &Path) -> PathBuf {
    let mut out = PathBuf::new();
    for part in path.components() {
        match part {
            std::path::Component::CurDir => {}
            std::path::Component::ParentDir if out.file_name().is_some() => {
                out.pop();
            }
            part => out.push(part),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_meant_is_looked_for_part_by_part() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir_all(folder.path().join("my meshes/old")).unwrap();
        for name in ["my meshes/bunny.obj", "my meshes/old/é x.ply", "photo.png"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        for (path, help) in [
            ("my meshes/buny.obj", "did you mean `\"my meshes/bunny.obj\"`?"),
            ("My Meshes/Bunny.OBJ", "did you mean `\"my meshes/bunny.obj\"`?"),
            (" my meshes/bunny.obj", "did you mean `\"my meshes/bunny.obj\"`?"),
            ("my meshes/old/é y.ply", "did you mean `\"my meshes/old/é x.ply\"`?"),
            ("phto.png", "did you mean `\"photo.png\"`?"),
            ("./photo.pmg", "did you mean `\"./photo.png\"`?"),
            ("photo.jpg", "did you mean `\"photo.png\"`?"),
            ("my meshes\\bunny.obj", "told apart by `/`: `\"my meshes/bunny.obj\"`"),
            ("~/photo.png", "nothing is put in the place of `~`"),
            ("$HOME/photo.png", "nothing is put in the place of `~`"),
            ("https://example.org/photo.png", "`curl -O https://example.org/photo.png`"),
            ("file:///photo.png", "write the path alone: `\"/photo.png\"`"),
            ("my meshes/*.obj", "names one file"),
            ("", "the name of a file"),
        ] {
            let told = missing(path, folder.path()).unwrap_or_default();
            assert!(told.contains(help), "{path}: {told}");
        }
        for path in ["nowhere/at/all.obj", "my meshes/old", "my meshes/teapot.obj"] {
            assert_eq!(missing(path, folder.path()), None, "{path}");
        }
        assert!(within("my meshes/", folder.path()).ends_with("`\"my meshes/bunny.obj\"`"));
    }
}
