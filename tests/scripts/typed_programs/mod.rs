//! A checked program fails only for values: random programs whose types are known check, evaluate, and have the values that their types
//! say; random edits that no type allows are refused by `check`.

mod generate;
mod tree;

use dscene::check::{Checked, Disk, check_text, hir};
use dscene::diag::Diagnostic;
use dscene::eval::{Engine, EngineOptions};
use proptest::prelude::*;

use crate::typed::disagreement;
use generate::{PRELUDE, Statement};

pub use generate::program;

/// What may go wrong with values of the right types.
const OF_VALUES: [&str; 4] = ["dscene::run::value", "dscene::run::nan", "dscene::run::index", "dscene::run::scene"];

pub fn script(statements: &[Statement]) -> String {
    let lines: Vec<String> = statements.iter().map(Statement::text).collect();
    format!("{PRELUDE}{}\n", lines.join("\n"))
}

fn checked(text: &str) -> Checked {
    check_text("generated.dscene", None, text, &[], &Disk)
}

pub fn tapes() -> impl Strategy<Value = Vec<Vec<u16>>> {
    prop::collection::vec(prop::collection::vec(0u16..5000, 1..60), 1..7)
}

/// Checks and evaluates everything; says what went wrong, if it should not have.
fn fault(statements: &[Statement]) -> Option<String> {
    let text = script(statements);
    let Checked { program, diagnostics, .. } = checked(&text);
    let errors: Vec<String> =
        diagnostics.iter().filter(|d| d.is_error()).map(|d| format!("{}: {}", d.code, d.message)).collect();
    // Of random numbers it may be that a camera looks along its `up`, that a matrix has no inverse, or a sum no arc sine.
    let of_values = ["dscene::value::look_at", "dscene::value::refused", "dscene::value::range"];
    let is_of_values = |d: &Diagnostic| of_values.contains(&d.code);
    if program.is_none() && diagnostics.iter().filter(|d| d.is_error()).all(is_of_values) {
        return None;
    }
    let Some(program) = program else { return Some(format!("{text}\nis refused: {}", errors.join("\n"))) };
    let mut engine = Engine::new(program.clone(), EngineOptions { base_dir: ".".into(), ..Default::default() });
    for id in program.ids().filter(|id| program.decl(*id).user) {
        let decl = program.decl(id);
        if matches!(decl.kind, hir::DeclKind::Fn(_)) {
            continue;
        }
        match engine.eval_decl(id) {
            Ok(value) => {
                if let Some(why) = disagreement(&decl.ty, &value) {
                    return Some(format!("{text}\n`{}` should be `{}`, but {why}", decl.name, decl.ty));
                }
            }
            Err(e) if OF_VALUES.contains(&e.code) => {}
            Err(e) => return Some(format!("{text}\n`{}`: {}: {}", decl.name, e.code, e.message)),
        }
    }
    None
}

pub fn config(cases: u32) -> ProptestConfig {
    // The same programs each time; `PROPTEST_CASES` asks for more, and for others.
    let cases = std::env::var("PROPTEST_CASES").ok().and_then(|n| n.parse().ok()).unwrap_or(cases);
    let rng_seed = proptest::test_runner::RngSeed::Fixed(u64::from(cases));
    // Programs without a place to edit are passed over.
    let max_global_rejects = 2 * cases;
    ProptestConfig {
        cases,
        rng_seed,
        failure_persistence: None,
        max_shrink_iters: 4000,
        max_global_rejects,
        ..ProptestConfig::default()
    }
}

proptest! {
    #![proptest_config(config(300))]

    #[test]
    fn well_typed_programs_have_values_of_their_types(tapes in tapes()) {
        let fault = fault(&program(&tapes));
        prop_assert!(fault.is_none(), "{}", fault.unwrap_or_default());
    }

    #[test]
    fn ill_typed_edits_are_refused(tapes in tapes(), statement: usize, edit: usize) {
        let mut statements = program(&tapes);
        let n = statements.len();
        let broken = &mut statements[statement % n].e;
        let edits = broken.edits();
        prop_assume!(edits > 0);
        prop_assume!(broken.break_at(edit % edits));
        let text = script(&statements);
        prop_assert!(checked(&text).program.is_none(), "{}\nis accepted", text);
    }
}
