//! `test "name" { let … expect … }`

use super::hir;
use super::modules::Checker;
use crate::diag::Diagnostic;
use crate::syntax::ast;

impl Checker<'_> {
    pub fn test(&mut self, test: &ast::Test) {
        if self.origin.lines.contains(&test.head.source) {
            self.diagnostics.push(
                Diagnostic::error("dscene::test::line", "a test belongs to a file")
                    .label(test.head, "is not run here")
                    .help("write it into the file whose functions it tests, and run it by `dsl test FILE`"),
            );
            return;
        }
        if let Some(first) = self.tests.iter().find(|t| t.name == test.name.text) {
            self.diagnostics.push(
                Diagnostic::error("dscene::name::duplicate", format!("two tests are called \"{}\"", test.name.text))
                    .label(test.name.span, "again here")
                    .label(first.name_span, "first here")
                    .help("say what is different about the second one"),
            );
            return;
        }
        if !test.steps.iter().any(|step| matches!(step, ast::TestStep::Expect { .. })) {
            self.diagnostics.push(
                Diagnostic::warning("dscene::test::empty", "this test expects nothing")
                    .label(test.head, "cannot fail")
                    .help("say what holds: `expect a ≈ b within 1%`"),
            );
        }
        self.no_step = true;
        let depth = self.locals.len();
        let mut steps = Vec::new();
        for step in &test.steps {
            steps.push(match step {
                ast::TestStep::Let { name, ty, value } => {
                    let typed = self.annotated(ty.as_ref(), value);
                    let local = self.new_local(&name.text, typed.expr.ty.clone(), typed.value);
                    hir::TestStep::Let { local, value: typed.expr }
                }
                ast::TestStep::Expect { condition, why, span } => {
                    let condition = self.condition(condition);
                    hir::TestStep::Expect { condition, why: why.as_ref().map(|why| self.why(why)), span: *span }
                }
            });
        }
        self.locals.truncate(depth);
        self.no_step = false;
        self.tests.push(hir::Test { name: test.name.text.clone(), name_span: test.name.span, steps });
    }
}
