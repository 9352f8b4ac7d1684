//! Files that are named where a script is wanted: what they are, by their endings, and what can be done with them.

use std::path::Path;

use crate::diag::Diagnostic;

/// The one error about a file that is no script: to read it as one would give an error for each of its lines.
pub fn no_script(path: &Path) -> Option<Diagnostic> {
    let name = path.file_name()?.to_string_lossy();
    let (kind, help) = kind_and_help(&name)?;
    let message = format!("`{}` is {kind}, and no script", path.display());
    Some(Diagnostic::error("dscene::file::format", message).help(help))
}

/// What a file is that is no script, and what is to be written in place of its name.
pub fn kind_and_help(name: &str) -> Option<(&'static str, String)> {
    let ending = Path::new(name).extension()?.to_str()?.to_lowercase();
    let is = |endings: &[&str]| endings.contains(&ending.as_str());
    let read_by = |native: &str| format!("a script reads it: `{native}(\"{name}\")`");
    Some(match ending.as_str() {
        "gltf" | "glb" => ("a scene in glTF", read_by("load_shapes")),
        "json" => ("a file of data", read_by("load_json")),
        "csv" | "tsv" => ("a table", read_by("load_table")),
        "npy" => ("an array", read_by("load_array")),
        "ies" => ("the profile of a light", read_by("load_profile")),
        "py" => {
            ("a program in Python", format!("it is run by `python {name}`, in which the package `dscene` runs scripts"))
        }
        "ipynb" => ("a notebook", "it is opened in Jupyter, where the package `dscene` runs scripts".to_owned()),
        "md" => ("a page in Markdown", "scripts have names that end in `.dscene`".to_owned()),
        "xml" | "pbrt" => (
            if ending == "xml" { "an XML file" } else { "a scene of pbrt" },
            "scenes of other renderers are written anew as scripts: the book shows those of Mitsuba line by line"
                .to_owned(),
        ),
        "blend" | "fbx" | "usd" | "usda" | "usdc" | "usdz" => {
            let glb = Path::new(name).with_extension("glb");
            let help = format!("export it as glTF, which a script reads: `load_shapes(\"{}\")`", glb.display());
            ("a scene of another program", help)
        }
        _ if is(&crate::mesh::load::EXTENSIONS) => ("a mesh", read_by("load")),
        _ if is(&crate::image::file::READABLE) => ("an image", read_by("load_image")),
        _ => return None,
    })
}
