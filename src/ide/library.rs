//! The standard library as pages: modules, and what each declares.

use super::describe;
use crate::check::{self, Disk, hir};

/// What has a full stop and ends no sentence.
const ABBREVIATIONS: [&str; 3] = ["e.g", "Rec", "et al"];

/// A module of the library.
pub struct Module {
    /// Its name, without `std.`.
    pub name: &'static str,
    /// Its names are known everywhere; those of others by `import std.NAME`.
    pub is_prelude: bool,
    /// What it is about: the comment that its file begins with.
    pub about: String,
    /// What it declares, in the order of its file.
    pub entries: Vec<Entry>,
}

/// A declaration of the library.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// As a script calls it: `blur`, `studio.three_point`.
    pub name: String,
    /// `fn floor(y: scalar = 0)`
    pub head: String,
    /// Without its example.
    pub text: String,
    /// Expressions that may be evaluated as they are, a line each; empty if there are none.
    pub example: String,
}

impl Entry {
    /// The name without its module.
    pub fn bare(&self) -> &str {
        self.name.rsplit('.').next().unwrap_or(&self.name)
    }

    /// The first sentence of the text.
    pub fn summary(&self) -> &str {
        let is_abbreviated = |at: usize| ABBREVIATIONS.iter().any(|word| self.text[..at].ends_with(word));
        let end = self.text.match_indices(". ").map(|(at, _)| at).find(|at| !is_abbreviated(*at));
        let sentence = end.map_or(self.text.as_str(), |at| &self.text[..at]);
        sentence.trim_end_matches(['.', '\n'])
    }
}

/// All modules, in the library's order.
pub fn modules() -> Vec<Module> {
    let names: Vec<(&'static str, bool)> = check::library_modules().collect();
    let imports: Vec<String> = names
        .iter()
        .filter(|(_, prelude)| !prelude)
        .map(|(name, _)| format!("import std.{name} as {name}\n"))
        .collect();
    let checked = check::check_text("<library>", None, imports.concat(), &[], &Disk);
    let program = checked.program.unwrap_or_default();
    let module = |(name, is_prelude): (&'static str, bool)| {
        let file = format!("std/{name}.dscene");
        let bare = |decl: &hir::Decl| decl.name.rsplit('.').next().unwrap_or_default().to_owned();
        let is_own = |decl: &&hir::Decl| program.sources.name(decl.span.source) == file;
        let own =
            program.ids().map(|id| program.decl(id)).filter(is_own).filter(|decl| !check::is_private(&bare(decl)));
        let mut own: Vec<&hir::Decl> = own.collect();
        own.sort_by_key(|decl| decl.span.start);
        let entries = own.into_iter().map(|decl| entry(&program, decl, name, is_prelude)).collect();
        let lines = check::library_text(name).unwrap_or_default().lines();
        let about: Vec<&str> = lines.map_while(|line| line.strip_prefix("// ")).collect();
        Module { name, is_prelude, about: about.join(" "), entries }
    };
    names.into_iter().map(module).collect()
}

fn entry(program: &hir::Program, decl: &hir::Decl, module: &str, is_prelude: bool) -> Entry {
    let examples = decl.doc.lines().filter_map(|line| line.strip_prefix("Example: "));
    let text: Vec<&str> = decl.doc.trim().lines().filter(|line| !line.starts_with("Example: ")).collect();
    let bare = decl.name.rsplit('.').next().unwrap_or(&decl.name);
    let name = if is_prelude { bare.to_owned() } else { format!("{module}.{bare}") };
    // What stands alone there is only the name of what needs a file.
    let example = examples.filter(|example| *example != bare).collect::<Vec<&str>>().join("\n");
    Entry { name, head: describe::head(program, decl), text: text.join(" "), example }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_library_has_pages() {
        let modules = modules();
        assert_eq!(modules.iter().filter(|m| m.is_prelude).count(), 10);
        for module in &modules {
            assert!(!module.entries.is_empty() && module.about.ends_with('.'), "{}", module.name);
            for entry in &module.entries {
                assert!(!entry.text.is_empty() && !entry.summary().is_empty(), "{}", entry.name);
            }
        }
        let find = |name: &str| modules.iter().flat_map(|m| &m.entries).find(|e| e.name == name).cloned().unwrap();
        let blur = find("blur");
        assert_eq!(blur.head, "native fn blur(image: image, sigma: scalar in 0..10000): image");
        assert_eq!(blur.summary(), "Smoothed by a Gaussian of standard deviation `sigma` pixels");
        assert_eq!(blur.example, "blur(img, sigma: 1.5)");
        assert_eq!(find("load").example, "");
        assert_eq!(find("luminance").summary(), "Luminance of a linear RGB image (one channel) or colour (Rec. 709)");
        assert!(modules.iter().flat_map(|m| &m.entries).all(|e| !e.name.contains("._")), "what is private has no page");
        assert!(find("studio.three_point").head.starts_with("fn three_point("));
    }
}
