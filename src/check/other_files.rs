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
    let read_by = |native: &str| format!("a script reads it: `{native}(\"{name}\")`");
    Some(match ending.as_str() {
        "gltf" | "glb" => ("a scene in glTF", read_by("load_shapes")),
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
        _ => data_kind(&ending).map(|(kind, native)| (kind, read_by(native)))?,
    })
}

/// What a file of numbers, a mesh or an image is, by its ending in lower case, and the native that reads it.
pub fn data_kind(ending: &str) -> Option<(&'static str, &'static str)> {
    Some(match ending {
        "json" => ("a file of data", "load_json"),
        "csv" | "tsv" => ("a table", "load_table"),
        "npy" => ("an array", "load_array"),
        "ies" => ("the profile of a light", "load_profile"),
        _ if crate::mesh::load::EXTENSIONS.contains(&ending) => ("a mesh", "load"),
        _ if crate::image::file::READABLE.contains(&ending) => ("an image", "load_image"),
        _ => return None,
    })
}
