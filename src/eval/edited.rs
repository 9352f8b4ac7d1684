//! A program whose file was edited: what the edit does not reach stays computed.

use std::collections::HashMap;
use std::sync::Arc;

use super::call::holds_function;
use super::deps::Params;
use super::reach::{Reach, mentioned};
use super::warnings::Warnings;
use super::{Engine, RenderOverrides};
use crate::check::hir::{DeclId, DeclKind, Program};
use crate::check::types::Ty;

impl Engine {
    /// Goes on with a program that was read and checked anew, with the same result as a new engine of it, but for the params. A value stays
    /// computed, and a param where it is, if the declaration's text is the same and so is all that it mentions: what was rendered, too,
    /// unless steps or stages had changed its samples. What was read from files is read again if they have changed.
    pub fn take_edit(&mut self, program: Program, files_have_changed: bool) {
        self.reset_renewed();
        self.carried_out.clear();
        let moved = std::mem::take(&mut self.moved);
        let settings = self.overrides.differences(&RenderOverrides::default());
        let had_steps = (self.step, self.total, self.sample_seed) != (0, 0, 0) || !self.losses.is_empty();
        self.forget(|d| {
            d.settings.intersects(settings) || (d.sample || d.step) && had_steps || d.params.intersects(&moved)
        });
        let new_ids = same_declarations(&self.program, &program, files_have_changed);
        let params = std::mem::take(&mut self.params).into_iter();
        self.params = params.filter_map(|(id, state)| Some((*new_ids.get(&id)?, state))).collect();
        self.worlds.truncate(1);
        self.evaluated.clear();
        let cache = std::mem::take(&mut self.worlds[0].cache).into_iter();
        // Functions mention declarations by their ids, which are other ones now.
        let kept = cache.filter(|(_, entry)| !holds_function(&entry.value)).filter_map(|(id, mut entry)| {
            entry.deps.params = entry.deps.params.renamed(&new_ids);
            Some((*new_ids.get(&id)?, entry))
        });
        self.worlds[0].cache = kept.collect();
        self.reach = Arc::new(Reach::new(&program));
        self.program = Arc::new(program);
        (self.step, self.total, self.sample_seed) = (0, 0, 0);
        self.overrides = RenderOverrides::default();
        self.warnings = Warnings::default();
        self.clear_losses();
    }
}

impl Params {
    /// The same params by other ids. Those without a new one are left out.
    fn renamed(&self, new_ids: &HashMap<DeclId, DeclId>) -> Params {
        let mut renamed = Params::default();
        new_ids.iter().filter(|(old, _)| self.contains(old)).for_each(|(_, new)| renamed.insert(*new));
        renamed
    }
}

/// Declarations of the old program that mean the same in the new one, with their new ids.
fn same_declarations(old: &Program, new: &Program, files_have_changed: bool) -> HashMap<DeclId, DeclId> {
    let by_name = |program: &Program, id: DeclId| {
        let decl = program.decl(id);
        (program.sources.name(decl.name_span.source).to_owned(), decl.name.clone())
    };
    let old_ids: HashMap<(String, String), DeclId> = old.ids().map(|id| (by_name(old, id), id)).collect();
    let alike = |a: DeclId, b: DeclId| {
        let (before, now) = (old.decl(a), new.decl(b));
        // Natives that read files are told which by a string.
        let reads =
            matches!(&now.kind, DeclKind::Native(native) if native.params.iter().any(|p| p.takes.names(&Ty::Str)));
        std::mem::discriminant(&before.kind) == std::mem::discriminant(&now.kind)
            && before.ty == now.ty
            && old.sources.text(before.span) == new.sources.text(now.span)
            && old.sources.place(before.name_span) == new.sources.place(now.name_span)
            && !(reads && files_have_changed)
    };
    let mut found: Vec<Option<DeclId>> =
        new.ids().map(|id| old_ids.get(&by_name(new, id)).copied().filter(|&before| alike(before, id))).collect();

    // The same text may mean something else, if the names in it do.
    let mut users: Vec<Vec<u32>> = vec![Vec::new(); new.decls.len()];
    let mut other: Vec<u32> = Vec::new();
    for id in new.ids() {
        let uses = mentioned(new, id);
        uses.iter().for_each(|used| users[*used as usize].push(id.0));
        let before: Option<Vec<u32>> = uses.iter().map(|used| Some(found[*used as usize]?.0)).collect();
        let before = before.map(|mut ids| {
            ids.sort_unstable();
            ids
        });
        if found[id.0 as usize].is_none_or(|own| before != Some(mentioned(old, own))) {
            other.push(id.0);
        }
    }
    let mut is_other = vec![false; new.decls.len()];
    while let Some(id) = other.pop() {
        if !std::mem::replace(&mut is_other[id as usize], true) {
            found[id as usize] = None;
            other.extend(&users[id as usize]);
        }
    }
    new.ids().filter_map(|id| Some((found[id.0 as usize]?, id))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::{self, Disk};
    use crate::eval::{EngineOptions, show};
    use crate::image::{Image, file};
    use crate::tape::Tensor;

    fn program(text: &str) -> Program {
        let checked = check::check_text("t.dscene", None, text, &[], &Disk);
        checked.program.unwrap_or_else(|| panic!("{text}\n{:?}", checked.diagnostics))
    }

    const SCENE: &str = "
        camera eye { position: [0, 0, -4], look_at: [0, 0, 0], film: [8, 8] }
        param glow = 0.5 in 0..1
        let size = 0.5
        fn twice(x) = 2 * x
        let large = twice(size)
        let round = sphere(radius: large)
        shape ball { mesh: round, material: diffuse(reflectance: glow) }
        light sky = constant(radiance: 1)
        let seen = mean(render(eye, spp: 4))
        ";

    fn value(engine: &mut Engine, name: &str) -> String {
        let id = engine.program().find(name).unwrap();
        let value = engine.eval_decl(id).unwrap();
        show(&value, &engine.program().decl(id).ty.clone())
    }

    /// An edit computes what it reaches and nothing else, and everything is as if the file had just been read.
    #[test]
    fn an_edit_computes_what_it_reaches() {
        let edits = [
            // An unrelated declaration in front, which moves everything behind it in the text.
            (format!("let more = 1\n{SCENE}"), "round", 0),
            (format!("let more = 1\n{SCENE}"), "seen", 0),
            (SCENE.replace("radiance: 1", "radiance: 2"), "seen", 2),
            // Another light, which nothing mentions but the scene.
            (format!("{SCENE}\nlight lamp = point(position: [0, 3, 0], intensity: 1)"), "seen", 2),
            (format!("{SCENE}\nintegrator few {{ max_bounces: 0 }}"), "seen", 2),
            (SCENE.replace("size = 0.5", "size = 0.25"), "round", 3),
            (SCENE.replace("2 * x", "3 * x"), "round", 2),
            // The same text calls something else.
            (format!("{SCENE}\nfn sphere(radius: scalar) = cube()"), "round", 1),
        ];
        for (edited, name, work) in edits {
            let mut engine = Engine::new(program(SCENE), EngineOptions::default());
            for name in ["round", "seen"] {
                value(&mut engine, name);
            }
            engine.take_edit(program(&edited), false);
            let before = engine.statistics().declarations;
            let found = value(&mut engine, name);
            assert_eq!(engine.statistics().declarations - before, work, "{name} of {edited}");
            let mut anew = Engine::new(program(&edited), EngineOptions::default());
            assert_eq!(found, value(&mut anew, name), "{name} of {edited}");
        }
    }

    #[test]
    fn params_stay_where_they_are_unless_their_declaration_changes() {
        let text = "let start = 1\nparam a = start\nparam b = 2\nlet c = a + b\nlet f = x => x + a";
        let mut engine = Engine::new(program(text), EngineOptions::default());
        for name in ["a", "b"] {
            let id = engine.program().find(name).unwrap();
            engine.set_param(id, Tensor::scalar(7.0)).unwrap();
        }
        for (edited, values) in [
            (format!("let d = 0\n{text}"), ["7", "7", "14"]),
            (text.replace("start = 1", "start = 3"), ["3", "7", "10"]),
            (text.replace("b = 2", "b = 4"), ["1", "4", "5"]),
        ] {
            engine.take_edit(program(&edited), false);
            assert_eq!(["a", "b", "c"].map(|name| value(&mut engine, name)), values, "{edited}");
            // A function that an earlier program made would look for `a` where it is no more.
            let id = engine.program().find("f").unwrap();
            engine.eval_decl(id).unwrap();
        }
    }

    #[test]
    fn changed_files_are_read_again() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("n.json");
        let picture = folder.path().join("i.png");
        let save = |x: f32| file::save(&picture, &Image { width: 1, height: 1, channels: 1, data: vec![x] }).unwrap();
        let text = format!(
            "param p = load_json({file:?})\nlet q = load_json({file:?})\nlet t = mean(texture({picture:?}).texels)"
        );
        std::fs::write(&file, "1").unwrap();
        save(0.0);
        let mut engine = Engine::new(program(&text), EngineOptions::default());
        let all = |engine: &mut Engine| ["p", "q", "t"].map(|name| value(engine, name));
        assert_eq!(all(&mut engine), ["1", "1", "0"]);
        std::fs::write(&file, "2").unwrap();
        save(1.0);
        engine.take_edit(program(&text), false);
        assert_eq!(all(&mut engine), ["1", "1", "0"]);
        engine.take_edit(program(&text), true);
        assert_eq!(all(&mut engine), ["2", "2", "1"]);
    }
}
