//! What every name of a file means: one walk over its statements, with the scopes of parameters, loops and blocks.

use crate::check::hir::DeclId;
use crate::check::types::Ty;
use crate::check::{ModuleId, Understanding};
use crate::source::{SourceId, Span};
use crate::syntax::ast::{self, Expr, ExprKind, StatementKind, StrPart};

/// What a name means. Two names mean the same thing if their symbols are equal.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Symbol {
    /// A declaration of a file or of the library.
    Decl(DeclId),
    /// A parameter of a function, a variable of a loop or a `let` in a block: by the place where it gets its name. The name of an
    /// argument, `radius: 2`, means the parameter.
    Local(Span),
    /// The name of an import, by the place where it gets it: `import … as lib`.
    Module(Span),
    /// A field behind a dot, with the place of the value that has it.
    Field(Span),
    /// A field of a record, wherever it is written: in the record, in its type, behind a dot.
    Key(Key),
    /// A field of `optimize`, of a param or of a plot.
    Setting,
    /// The name of a type.
    Type,
    /// One of the words that an argument may be: `kind: orthographic`.
    Word,
    /// `step`, `progress`, and `loss` in `stop_when`.
    Running,
    /// A name that means nothing.
    Unknown,
}

/// A field of all records that have the same fields: records of one type, since no record stands for one with others.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Key {
    pub name: String,
    /// The names of all fields, in alphabetical order.
    pub fields: Vec<String>,
}

impl Key {
    fn new<'f>(name: &str, fields: impl Iterator<Item = &'f str>) -> Key {
        let mut fields: Vec<String> = fields.map(str::to_owned).collect();
        fields.sort_unstable();
        fields.dedup();
        Key { name: name.to_owned(), fields }
    }

    /// The field of a record's type.
    fn of(ty: &Ty, name: &str) -> Option<Key> {
        let fields = ty.record()?.iter().map(|(name, _)| name.as_str());
        Some(Key::new(name, fields)).filter(|key| key.fields.contains(&key.name))
    }
}

/// A name at its place. Where a name is two things, as in `{ photo }`, there are two, that of the value first.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Occurrence {
    pub span: Span,
    pub symbol: Symbol,
    /// Whether the name is given here.
    pub declares: bool,
}

/// All names of a source in the order of the text.
pub fn occurrences(known: &Understanding, source: SourceId) -> Vec<Occurrence> {
    let mut walk =
        Walk { known, module: known.module_of(source), scope: Vec::new(), running_loss: false, found: Vec::new() };
    for statement in known.trees.get(&source).into_iter().flatten() {
        walk.statement(statement);
    }
    let mut found = walk.found;
    found.sort_by_key(|o| (o.span.start, o.span.end));
    found
}

/// A parameter of a function, as it is declared.
pub fn parameter<'k>(known: &'k Understanding, function: DeclId, name: &str) -> Option<&'k ast::FnParam> {
    parameters(known, function).iter().find(|p| p.name.text == name)
}

/// The parameters of a function; of what is no function, none.
pub fn parameters(known: &Understanding, function: DeclId) -> &[ast::FnParam] {
    match known.statement(function).map(|s| &s.kind) {
        Some(StatementKind::Fn(f)) => &f.params,
        _ => &[],
    }
}

/// The words that a parameter may be given: `"perspective" | "orthographic"`.
pub fn words(parameter: &ast::FnParam) -> impl Iterator<Item = &str> {
    parameter.ty.iter().flat_map(|ty| &ty.choices).filter_map(|atom| match &atom.kind {
        ast::TypeKind::Word(word) => Some(word.as_str()),
        _ => None,
    })
}

struct Walk<'k> {
    known: &'k Understanding,
    module: ModuleId,
    /// Names of the scopes around, innermost last, with the places where they are given.
    scope: Vec<(String, Span)>,
    /// Whether `loss` is the running loss, as it is in `stop_when`.
    running_loss: bool,
    found: Vec<Occurrence>,
}

impl Walk<'_> {
    fn note(&mut self, span: Span, symbol: Symbol, declares: bool) {
        // What the parser names, `ast::ROW`, stands nowhere.
        if span.start < span.end {
            self.found.push(Occurrence { span, symbol, declares });
        }
    }

    /// The names that a type is made of, and the fields of its records.
    fn ty(&mut self, ty: Option<&ast::Type>) {
        for atom in ty.iter().flat_map(|ty| &ty.choices) {
            match &atom.kind {
                ast::TypeKind::Record(fields) => {
                    let names = || fields.iter().map(|(name, _)| name.text.as_str());
                    for (name, ty) in fields {
                        self.note(name.span, Symbol::Key(Key::new(&name.text, names())), true);
                        self.ty(Some(ty));
                    }
                }
                ast::TypeKind::Fn(parameters, result) => {
                    parameters.iter().for_each(|ty| self.ty(Some(ty)));
                    self.ty(Some(result));
                }
                ast::TypeKind::Named(name) => {
                    let (source, start) = (atom.span.source, atom.span.start as usize);
                    self.note(Span::new(source, start, start + name.len()), Symbol::Type, false);
                }
                ast::TypeKind::Word(_) => {}
            }
        }
    }

    /// Names a local from here to the end of its scope.
    fn bind(&mut self, name: &ast::Name) {
        self.note(name.span, Symbol::Local(name.span), true);
        self.scope.push((name.text.clone(), name.span));
    }

    /// Walks what sees more names than what stands around it.
    fn scoped(&mut self, inside: impl FnOnce(&mut Self)) {
        let depth = self.scope.len();
        inside(self);
        self.scope.truncate(depth);
    }

    fn declared(&mut self, name: &ast::Name) {
        let id = self.known.lookup(self.module, &name.text);
        let symbol = id.map_or(Symbol::Unknown, Symbol::Decl);
        self.note(name.span, symbol, true);
    }

    fn statement(&mut self, statement: &ast::Statement) {
        match &statement.kind {
            StatementKind::Import(import) => {
                if let Some(alias) = &import.alias {
                    self.note(alias.span, Symbol::Module(alias.span), true);
                }
            }
            StatementKind::Let { name, ty, value } => {
                self.declared(name);
                self.ty(ty.as_ref());
                self.expr(value);
            }
            StatementKind::Loss { name, value } => {
                self.declared(name);
                self.expr(value);
            }
            StatementKind::Param(param) => self.param(param),
            StatementKind::Fn(f) => {
                self.declared(&f.name);
                self.scoped(|walk| {
                    for param in &f.params {
                        // A default sees the parameters before it.
                        walk.ty(param.ty.as_ref());
                        param.default.iter().for_each(|default| walk.expr(default));
                        walk.bind(&param.name);
                    }
                    walk.ty(f.result.as_ref());
                    f.body.iter().for_each(|body| walk.expr(body));
                });
            }
            StatementKind::Kind { kind, name, ty, body } => {
                self.declared(name);
                self.ty(ty.as_ref());
                match body {
                    ast::KindBody::Value(value) => self.expr(value),
                    ast::KindBody::Fields(fields) => {
                        let constructor = self.known.lookup(crate::check::PRELUDE, &kind.text);
                        for field in fields {
                            self.named_argument(constructor, &field.name);
                            self.argument(constructor, Some(&field.name.text), 0, &field.value);
                        }
                    }
                }
            }
            StatementKind::Action(action) => self.action(action),
            StatementKind::Test(test) => self.scoped(|walk| {
                for step in &test.steps {
                    step.parts().for_each(|part| walk.expr(part));
                    if let ast::TestStep::Let { name, ty, .. } = step {
                        walk.ty(ty.as_ref());
                        walk.bind(name);
                    }
                }
            }),
        }
    }

    fn param(&mut self, param: &ast::Param) {
        self.declared(&param.name);
        self.ty(param.ty.as_ref());
        param.value.iter().chain(&param.prior).for_each(|e| self.expr(e));
        let bounds = param.bounds.iter().flat_map(|bounds| [&bounds.low, &bounds.high]);
        bounds.flatten().for_each(|e| self.expr(e));
        for field in &param.settings {
            self.note(field.name.span, Symbol::Setting, false);
            // `space: interior` is a word.
            match &field.value.kind {
                ExprKind::Name(_) if field.name.text == "space" => {
                    self.note(field.value.span, Symbol::Word, false);
                }
                _ => self.expr(&field.value),
            }
        }
    }

    fn settings(&mut self, fields: &[ast::Field]) {
        for field in fields {
            self.note(field.name.span, Symbol::Setting, false);
            let outer = std::mem::replace(&mut self.running_loss, field.name.text == "stop_when");
            self.expr(&field.value);
            self.running_loss = outer;
        }
    }

    fn action(&mut self, action: &ast::Action) {
        match action {
            ast::Action::Optimize(optimize) => {
                self.expr(&optimize.loss);
                self.settings(&optimize.fields);
                for stage in &optimize.stages {
                    self.settings(&stage.fields);
                    for renewal in stage.then.iter().flat_map(|then| &then.renewals) {
                        self.used(&renewal.name.text, renewal.name.span);
                        self.expr(&renewal.value);
                    }
                }
                for every in &optimize.every {
                    self.expr(&every.steps);
                    every.actions.iter().for_each(|action| self.action(action));
                }
            }
            ast::Action::Save { value, path, .. } => {
                self.expr(value);
                self.expr(path);
            }
            ast::Action::Print { values, .. } => values.iter().for_each(|value| self.expr(value)),
            ast::Action::Plot(plot) => {
                plot.values.iter().chain(&plot.over).chain(&plot.path).for_each(|e| self.expr(e));
                self.settings(&plot.fields);
            }
            ast::Action::Expect { condition, why, .. } => {
                std::iter::once(condition).chain(why).for_each(|e| self.expr(e));
            }
            ast::Action::Report { columns, .. } => {
                for column in columns {
                    // `error` alone is `error: error`.
                    self.expr(&column.value);
                    self.note(column.name.span, Symbol::Setting, false);
                }
            }
            ast::Action::Sweep(sweep) => {
                for variable in &sweep.variables {
                    self.declared(&variable.name);
                    self.expr(&variable.values);
                }
                sweep.actions.iter().for_each(|action| self.action(action));
            }
        }
    }

    /// A name that is used: of a scope around, of a declaration, or of what an `optimize` keeps.
    fn used(&mut self, name: &str, span: Span) {
        let symbol = if let Some((_, place)) = self.scope.iter().rev().find(|(n, _)| n == name) {
            Symbol::Local(*place)
        } else if self.running_loss && name == "loss" {
            Symbol::Running
        } else if let Some(id) = self.known.lookup(self.module, name) {
            Symbol::Decl(id)
        } else if let Some(place) = self.alias(name) {
            Symbol::Module(place)
        } else if matches!(name, "step" | "progress") {
            Symbol::Running
        } else {
            Symbol::Unknown
        };
        self.note(span, symbol, false);
    }

    /// Where an import gets this name.
    fn alias(&self, name: &str) -> Option<Span> {
        if !self.known.module(self.module)?.aliases.contains_key(name) {
            return None;
        }
        let imports = self.known.trees.values().flatten().filter_map(|s| match &s.kind {
            StatementKind::Import(import) => import.alias.as_ref(),
            _ => None,
        });
        let here = |alias: &&ast::Name| alias.text == name && self.known.module_of(alias.span.source) == self.module;
        imports.into_iter().find(here).map(|alias| alias.span)
    }

    /// `studio.three_point`: the declaration of a module.
    fn module_member(&self, base: &Expr, name: &ast::Name) -> Option<DeclId> {
        let ExprKind::Name(alias) = &base.kind else { return None };
        if self.scope.iter().any(|(n, _)| n == alias) {
            return None;
        }
        let module = *self.known.module(self.module)?.aliases.get(alias)?;
        self.known.module(module)?.names.get(name.text.as_str()).copied()
    }

    /// The function that an expression names.
    fn function(&self, callee: &Expr) -> Option<DeclId> {
        match &callee.kind {
            ExprKind::Name(name) if !self.scope.iter().any(|(n, _)| n == name) => self.known.lookup(self.module, name),
            ExprKind::Member { base, name } => self.module_member(base, name),
            _ => None,
        }
    }

    fn named_argument(&mut self, function: Option<DeclId>, name: &ast::Name) {
        let parameter = function.and_then(|id| parameter(self.known, id, &name.text));
        let symbol = parameter.map_or(Symbol::Unknown, |p| Symbol::Local(p.name.span));
        self.note(name.span, symbol, false);
    }

    /// The value of an argument, which may be one of the words of its parameter.
    fn argument(&mut self, function: Option<DeclId>, name: Option<&str>, position: usize, value: &Expr) {
        let parameter = function.and_then(|id| match name {
            Some(name) => parameter(self.known, id, name),
            None => parameters(self.known, id).get(position),
        });
        if let (ExprKind::Name(word), Some(parameter)) = (&value.kind, parameter)
            && words(parameter).any(|w| w == word)
            && !self.scope.iter().any(|(n, _)| n == word)
        {
            return self.note(value.span, Symbol::Word, false);
        }
        self.expr(value);
    }

    fn expr(&mut self, e: &Expr) {
        match &e.kind {
            ExprKind::Name(name) => self.used(name, e.span),
            ExprKind::Str(parts) => {
                for part in parts {
                    if let StrPart::Value { value, .. } = part {
                        self.expr(value);
                    }
                }
            }
            ExprKind::Record(fields) => {
                let names = || fields.iter().map(|field| field.name.text.as_str());
                for field in fields {
                    // `{ photo }` is `{ photo: photo }`.
                    self.expr(&field.value);
                    self.note(field.name.span, Symbol::Key(Key::new(&field.name.text, names())), true);
                }
            }
            ExprKind::Call { callee, args } => {
                self.expr(callee);
                let function = self.function(callee);
                for (i, arg) in args.iter().enumerate() {
                    arg.name.iter().for_each(|name| self.named_argument(function, name));
                    self.argument(function, arg.name.as_ref().map(|n| n.text.as_str()), i, &arg.value);
                }
            }
            ExprKind::Member { base, name } => {
                self.expr(base);
                let symbol = match self.module_member(base, name) {
                    Some(id) => Symbol::Decl(id),
                    None => self.field(self.known.types.get(&base.span), base.span, &name.text),
                };
                self.note(name.span, symbol, false);
            }
            ExprKind::Comprehension { element, clauses } => self.scoped(|walk| {
                for clause in clauses {
                    walk.expr(&clause.items);
                    clause.names.iter().for_each(|name| walk.bind(name));
                    clause.condition.iter().for_each(|condition| walk.expr(condition));
                }
                walk.expr(element);
            }),
            ExprKind::Lambda { params, body } => self.scoped(|walk| {
                params.iter().for_each(|param| walk.bind(param));
                walk.expr(body);
            }),
            ExprKind::Block { lets, body } => self.scoped(|walk| {
                for (name, ty, value) in lets {
                    walk.ty(ty.as_ref());
                    walk.expr(value);
                    walk.bind(name);
                }
                walk.expr(body);
            }),
            ExprKind::With { body, replacements } => {
                self.expr(body);
                replacements.iter().for_each(|replacement| self.replacement(replacement));
            }
            _ => children(e).into_iter().for_each(|child| self.expr(child)),
        }
    }

    /// A field of a value of a type that stands at `base`.
    fn field(&self, ty: Option<&Ty>, base: Span, name: &str) -> Symbol {
        ty.and_then(|ty| Key::of(ty, name)).map_or(Symbol::Field(base), Symbol::Key)
    }

    /// `lamp.radiance: 2`, `lib.lamp.radiance: 2`, `points[0]: 1`.
    fn replacement(&mut self, replacement: &ast::Replacement) {
        let mut path = replacement.path.iter();
        let Some(first) = path.next() else { return };
        self.used(&first.text, first.span);
        let mut base = first.span;
        let mut of_module = self.found.last().is_some_and(|o| matches!(o.symbol, Symbol::Module(_)));
        let mut ty = match self.found.last().map(|o| &o.symbol) {
            Some(Symbol::Decl(id)) => Some(self.known.program.decl(*id).ty.clone()),
            _ => None,
        };
        for name in path {
            let module = self.known.module(self.module).and_then(|m| m.aliases.get(&first.text));
            let member = module.and_then(|m| self.known.module(*m)?.names.get(name.text.as_str()).copied());
            let symbol = match member.filter(|_| of_module) {
                Some(id) => Symbol::Decl(id),
                None => self.field(ty.as_ref(), base, &name.text),
            };
            ty = match (&symbol, ty) {
                (Symbol::Decl(id), _) => Some(self.known.program.decl(*id).ty.clone()),
                (_, Some(Ty::Record(fields))) => fields.iter().find(|(n, _)| *n == name.text).map(|(_, ty)| ty.clone()),
                (_, Some(Ty::Array(item, _))) if name.text.starts_with('[') => Some(*item),
                _ => None,
            };
            match name.index().filter(|(index, _)| index.starts_with(|c: char| c.is_ascii_alphabetic())) {
                Some((index, span)) => self.used(index, span),
                None => self.note(name.span, symbol, false),
            }
            of_module = false;
            base = base.to(name.span);
        }
        self.expr(&replacement.value);
    }
}

/// The expressions that an expression is made of, in the order of the text.
pub fn children(e: &Expr) -> Vec<&Expr> {
    match &e.kind {
        ExprKind::Number(_)
        | ExprKind::Percent(_)
        | ExprKind::Angle(_)
        | ExprKind::Color(_)
        | ExprKind::Bool(_)
        | ExprKind::Name(_)
        | ExprKind::Error => Vec::new(),
        ExprKind::Str(parts) => {
            let values = parts.iter().filter_map(|part| match part {
                StrPart::Value { value, .. } => Some(value),
                StrPart::Text(_) => None,
            });
            values.collect()
        }
        ExprKind::Array(items) => items.iter().collect(),
        ExprKind::Record(fields) => fields.iter().map(|field| &field.value).collect(),
        ExprKind::Comprehension { element, clauses } => {
            let clauses = clauses.iter().flat_map(|c| std::iter::once(&c.items).chain(&c.condition));
            std::iter::once(&**element).chain(clauses).collect()
        }
        ExprKind::Call { callee, args } => std::iter::once(&**callee).chain(args.iter().map(|a| &a.value)).collect(),
        ExprKind::Index { base, index } => vec![base, index],
        ExprKind::Slice { base, start, end, .. } => {
            let ends = start.iter().chain(end).map(|e| &**e);
            std::iter::once(&**base).chain(ends).collect()
        }
        ExprKind::Member { base, .. } => vec![base],
        ExprKind::Unary { operand, .. } => vec![operand],
        ExprKind::Binary { left, right, .. } => vec![left, right],
        ExprKind::Near { left, right, tolerance, .. } => {
            [left, right].into_iter().chain(tolerance).map(|e| &**e).collect()
        }
        ExprKind::Range { start, end, .. } => vec![start, end],
        ExprKind::If { condition, then, otherwise } => vec![condition, then, otherwise],
        ExprKind::Lambda { body, .. } => vec![body],
        ExprKind::With { body, replacements } => {
            std::iter::once(&**body).chain(replacements.iter().map(|r| &r.value)).collect()
        }
        ExprKind::Block { lets, body } => lets.iter().map(|(_, _, e)| e).chain([&**body]).collect(),
    }
}

/// The outermost expressions of a statement, in the order of the text.
pub fn roots(statement: &ast::Statement) -> Vec<&Expr> {
    let mut found = Vec::new();
    match &statement.kind {
        StatementKind::Import(_) => {}
        StatementKind::Let { value, .. } | StatementKind::Loss { value, .. } => found.push(value),
        StatementKind::Param(param) => {
            found.extend(param.value.iter().chain(&param.prior));
            found.extend(param.bounds.iter().flat_map(|bounds| [&bounds.low, &bounds.high]).flatten());
            found.extend(param.settings.iter().map(|field| &field.value));
        }
        StatementKind::Fn(f) => {
            found.extend(f.params.iter().filter_map(|p| p.default.as_ref()));
            found.extend(&f.body);
        }
        StatementKind::Kind { body: ast::KindBody::Value(value), .. } => found.push(value),
        StatementKind::Kind { body: ast::KindBody::Fields(fields), .. } => {
            found.extend(fields.iter().map(|f| &f.value))
        }
        StatementKind::Action(action) => action_roots(action, &mut found),
        StatementKind::Test(test) => found.extend(test.steps.iter().flat_map(ast::TestStep::parts)),
    }
    found
}

fn action_roots<'a>(action: &'a ast::Action, found: &mut Vec<&'a Expr>) {
    let fields = |fields: &'a [ast::Field]| fields.iter().map(|f| &f.value);
    match action {
        ast::Action::Optimize(optimize) => {
            found.push(&optimize.loss);
            found.extend(fields(&optimize.fields));
            for stage in &optimize.stages {
                found.extend(fields(&stage.fields));
                found.extend(stage.then.iter().flat_map(|then| &then.renewals).map(|renewal| &renewal.value));
            }
            for every in &optimize.every {
                found.push(&every.steps);
                every.actions.iter().for_each(|action| action_roots(action, found));
            }
        }
        ast::Action::Save { value, path, .. } => found.extend([value, path]),
        ast::Action::Print { values, .. } => found.extend(values),
        ast::Action::Plot(plot) => {
            found.extend(plot.values.iter().chain(&plot.over).chain(&plot.path));
            found.extend(fields(&plot.fields));
        }
        ast::Action::Expect { condition, why, .. } => found.extend(std::iter::once(condition).chain(why)),
        ast::Action::Report { columns, .. } => found.extend(fields(columns)),
        ast::Action::Sweep(sweep) => {
            found.extend(sweep.variables.iter().map(|variable| &variable.values));
            sweep.actions.iter().for_each(|action| action_roots(action, found));
        }
    }
}
