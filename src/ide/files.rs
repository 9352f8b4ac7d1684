//! Files whose path begins as it is written.

use std::path::Path;

/// Folders and files below `folder` whose path begins with `prefix`, which uses `/`; folders end with one. Of the files those with one of
/// the `endings`, or all if there are none. What is hidden stays so.
pub fn paths(folder: &Path, prefix: &str, endings: &[&str]) -> Vec<String> {
    let (parent, start) = prefix.rsplit_once('/').map_or(("", prefix), |(parent, start)| (parent, start));
    let place = if prefix.starts_with('/') { Path::new("/").join(parent) } else { folder.join(parent) };
    let place = if place.as_os_str().is_empty() { Path::new(".") } else { &place };
    let Ok(entries) = std::fs::read_dir(place) else { return Vec::new() };
    let shown = |entry: std::fs::DirEntry| {
        let name = entry.file_name().into_string().ok()?;
        let is_folder = entry.path().is_dir();
        let has_ending = endings.is_empty() || endings.iter().any(|e| name.ends_with(e));
        let fits = name.starts_with(start) && (is_folder || has_ending) && !name.starts_with('.');
        let parent = if prefix.contains('/') { format!("{parent}/") } else { String::new() };
        fits.then(|| format!("{parent}{name}{}", if is_folder { "/" } else { "" }))
    };
    let mut found: Vec<String> = entries.flatten().filter_map(shown).collect();
    found.sort();
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_completed_part_by_part() {
        let folder = std::env::temp_dir().join(format!("dscene-paths-{}", std::process::id()));
        std::fs::create_dir_all(folder.join("meshes")).unwrap();
        for name in ["meshes/a.obj", "meshes/b.png", "main.dscene", "mug.obj", ".hidden.obj"] {
            std::fs::write(folder.join(name), "").unwrap();
        }
        assert_eq!(paths(&folder, "m", &[".obj"]), ["meshes/", "mug.obj"]);
        assert_eq!(paths(&folder, "meshes/", &[]), ["meshes/a.obj", "meshes/b.png"]);
        let absolute = format!("{}/mesh", folder.display());
        assert_eq!(paths(Path::new("nowhere"), &absolute, &[]), [format!("{}/meshes/", folder.display())]);
        assert!(paths(&folder, "none/x", &[]).is_empty());
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
