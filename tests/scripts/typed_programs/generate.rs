//! Random well-typed programs. Every choice is a number of a tape, and where the tape ends the first alternative is taken, which is
//! the simplest: a shorter tape of smaller numbers is a shorter program.

use super::tree::*;

/// What every program may use.
pub const PRELUDE: &str = "\
camera eye { position: [0, 1, -4], look_at: [0, 0, 0], film: [4, 3] }
shape ball { mesh: icosphere(subdivisions: 0), material: diffuse(reflectance: level) }
light lamp = point(position: [0, 3, -2], intensity: 5)
param level = 0.5
param corner = [0.1, 0.2, 0.3]
param tilt = 20deg
param tilts = [10deg, 20deg]
param pose = rotation(angle: 10deg)
loss fit = mean(render(eye, spp: 1)) + sum(corner ^ 2) + tilt / 1rad
let img = image([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]])
";

pub struct Tape<'a> {
    numbers: &'a [u16],
    at: usize,
}

impl<'a> Tape<'a> {
    pub fn new(numbers: &'a [u16]) -> Tape<'a> {
        Tape { numbers, at: 0 }
    }

    fn below(&mut self, n: usize) -> usize {
        let x = self.numbers.get(self.at).copied().unwrap_or(0);
        self.at += 1;
        usize::from(x) % n.max(1)
    }

    fn ended(&self) -> bool {
        self.at >= self.numbers.len()
    }
}

/// A statement: its text around the expression that it is about.
pub struct Statement {
    pub before: String,
    pub e: E,
    pub after: String,
}

impl Statement {
    pub fn text(&self) -> String {
        format!("{}{}{}", self.before, self.e, self.after)
    }
}

struct Function {
    name: String,
    params: Vec<(String, T)>,
    /// How many at the end have a default.
    defaults: usize,
    result: T,
}

/// What an expression may name.
struct Generator<'a, 'b> {
    tape: &'b mut Tape<'a>,
    names: Vec<(String, T)>,
    functions: Vec<Function>,
    fresh: usize,
    /// Within a function's body: no derivatives and replacements of what is outside.
    inside: bool,
}

/// A program of so many statements, each from a tape of its own.
pub fn program(tapes: &[Vec<u16>]) -> Vec<Statement> {
    let named = |name: &str, t: T| (name.to_owned(), t);
    let mut names = vec![
        named("eye", T::Camera([4, 3])),
        named("ball", T::Shape),
        named("lamp", T::Light),
        named("level", SCALAR),
        named("corner", vector(3)),
        named("tilt", ANGLE),
        named("tilts", T::Angle(Some(2))),
        named("pose", T::Rotation),
        named("fit", SCALAR),
        named("img", T::Image([2, 3, 1])),
    ];
    let mut functions = Vec::new();
    let mut out = Vec::new();
    let mut fresh = 0;
    for numbers in tapes {
        let mut tape = Tape::new(numbers);
        let mut generator = Generator { tape: &mut tape, names, functions, fresh, inside: false };
        generator.statement(&mut out);
        (names, functions, fresh) = (generator.names, generator.functions, generator.fresh);
    }
    out
}

fn atom(text: impl Into<String>) -> E {
    E::Atom(text.into())
}

/// A place for exactly this type.
fn strict(e: E, t: &T) -> Place {
    Place { e, wrong: wrong_for(t) }
}

/// A place where many things may stand.
fn free(e: E) -> Place {
    Place { e, wrong: &[] }
}

fn beside(e: E, t: &T) -> Place {
    Place { e, wrong: wrong_beside(t) }
}

impl Generator<'_, '_> {
    fn pick<'c, V>(&mut self, all: &'c [V]) -> &'c V {
        &all[self.tape.below(all.len())]
    }

    fn name(&mut self, stem: &str) -> String {
        self.fresh += 1;
        format!("{stem}{}", self.fresh)
    }

    fn statement(&mut self, out: &mut Vec<Statement>) {
        match self.tape.below(8) {
            6 => self.function(out),
            7 => self.lambda_statement(out),
            n => {
                let t = self.any_type(2);
                let e = self.expr(&t, 4);
                let name = self.name("x");
                let annotated = if n == 5 { annotation(&t) } else { None };
                let annotated = annotated.map_or(String::new(), |a| format!(": {a}"));
                out.push(Statement { before: format!("let {name}{annotated} = "), e, after: String::new() });
                self.names.push((name, t));
            }
        }
    }

    /// `fn f(a: vec3, b = 2) = …`, and a call of it: without annotations only calls are fully checked.
    fn function(&mut self, out: &mut Vec<Statement>) {
        let name = self.name("f");
        let count = 1 + self.tape.below(3);
        let annotated = self.tape.below(3) > 0;
        let mut params = Vec::new();
        let mut heads = Vec::new();
        let defaults = self.tape.below(count + 1);
        for i in 0..count {
            let t = self.any_type(1);
            let param = self.name("p");
            let shown = annotation(&t).filter(|_| annotated).map_or(String::new(), |a| format!(": {a}"));
            let default = if i + defaults >= count { format!(" = {}", self.leaf(&t)) } else { String::new() };
            heads.push(format!("{param}{shown}{default}"));
            params.push((param, t));
        }
        let result = self.any_type(1);
        let outer = self.names.len();
        self.names.extend(params.iter().cloned());
        let inside = std::mem::replace(&mut self.inside, true);
        let body = self.expr(&result, 3);
        self.inside = inside;
        self.names.truncate(outer);
        let shown = annotation(&result).filter(|_| self.tape.below(2) > 0).map_or(String::new(), |a| format!(": {a}"));
        let before = format!("fn {name}({}){shown} = ", heads.join(", "));
        out.push(Statement { before, e: body, after: String::new() });
        self.functions.push(Function { name, params, defaults, result: result.clone() });
        let e = self.call_function(self.functions.len() - 1, 2);
        let name = self.name("x");
        out.push(Statement { before: format!("let {name} = "), e, after: String::new() });
        self.names.push((name, result));
    }

    /// `let g = (a, b) => …`, and a call of it.
    fn lambda_statement(&mut self, out: &mut Vec<Statement>) {
        let params: Vec<T> = (0..1 + self.tape.below(2)).map(|_| self.any_type(1)).collect();
        let result = self.any_type(1);
        let t = T::Fn(params.clone(), Box::new(result.clone()));
        let e = self.expr(&t, 3);
        let g = self.name("g");
        out.push(Statement { before: format!("let {g} = "), e, after: String::new() });
        let args: Vec<Place> = params.iter().map(|p| self.at(p, 2)).collect();
        let args = args.into_iter().map(|p| Argument { name: None, place: free(p.e), needed: true }).collect();
        let call = E::Call(Call { callee: Box::new(atom(g.clone())), args, full: true });
        let name = self.name("x");
        out.push(Statement { before: format!("let {name} = "), e: call, after: String::new() });
        self.names.push((g, t));
        self.names.push((name, result));
    }

    fn any_type(&mut self, depth: usize) -> T {
        let plain = [
            SCALAR,
            vector(3),
            ANGLE,
            T::Bool,
            T::Str,
            T::Image([3, 4, 3]),
            vector(2),
            T::Num(vec![2, 3]),
            T::Num(vec![3, 3]),
            T::Num(vec![4]),
            T::Image([3, 4, 1]),
            T::Image([2, 3, 1]),
            T::Angle(Some(2)),
            T::Mesh,
            T::Material,
            T::Rotation,
            T::Transform,
            T::Texture,
            T::Light,
            T::Shape,
            T::Camera([4, 3]),
            T::Camera([2, 2]),
            T::Scene,
            T::Estimate,
        ];
        let n = self.tape.below(plain.len() + if depth > 0 { 8 } else { 0 });
        if let Some(t) = plain.get(n) {
            return t.clone();
        }
        match n - plain.len() {
            0 | 1 => {
                let things = [T::Str, T::Mesh, T::Bool, T::Shape, T::Light, T::Material, T::Camera([4, 3])];
                let item = self.pick(&things).clone();
                T::List(Box::new(item), 1 + self.tape.below(3))
            }
            2 | 3 => T::Tuple(vec![T::Str, self.any_type(depth - 1), SCALAR]),
            4 | 5 => {
                let params = (0..1 + self.tape.below(2)).map(|_| self.any_type(0)).collect();
                T::Fn(params, Box::new(self.any_type(0)))
            }
            _ => T::Record((0..1 + self.tape.below(FIELDS.len())).map(|_| self.any_type(0)).collect()),
        }
    }

    fn at(&mut self, t: &T, depth: usize) -> Place {
        let e = self.expr(t, depth);
        strict(e, t)
    }

    fn arg(&mut self, t: &T, depth: usize) -> Argument {
        Argument { name: None, place: self.at(t, depth), needed: true }
    }

    fn call(&mut self, name: &str, types: &[T], depth: usize) -> E {
        let args = types.iter().map(|t| self.arg(t, depth)).collect();
        E::Call(Call { callee: Box::new(atom(name)), args, full: true })
    }

    /// A call whose arguments beyond the first are left out, or may be many things.
    fn open(&mut self, name: &str, t: &T, depth: usize) -> E {
        let place = self.at(t, depth);
        E::Call(Call {
            callee: Box::new(atom(name)),
            args: vec![Argument { name: None, place, needed: true }],
            full: false,
        })
    }

    fn form(&self, texts: &[&'static str], places: Vec<Place>) -> E {
        E::Form(texts.to_vec(), places)
    }

    /// An expression of that type.
    pub fn expr(&mut self, t: &T, depth: usize) -> E {
        if depth == 0 || self.tape.ended() {
            return self.leaf(t);
        }
        let known: Vec<String> = self.names.iter().filter(|(_, n)| n == t).map(|(n, _)| n.clone()).collect();
        match self.tape.below(12) {
            0 => self.leaf(t),
            1 | 2 if !known.is_empty() => atom(self.pick(&known).clone()),
            3 => self.general(t, depth - 1),
            _ => self.special(t, depth - 1).unwrap_or_else(|| self.leaf(t)),
        }
    }

    /// Ways that there are for any type.
    fn general(&mut self, t: &T, depth: usize) -> E {
        let callable: Vec<usize> = (0..self.functions.len()).filter(|i| self.functions[*i].result == *t).collect();
        match self.tape.below(16) {
            0 => {
                let condition = self.at(&T::Bool, depth);
                let (a, b) = (self.expr(t, depth), self.expr(t, depth));
                self.form(&["(if ", " then ", " else ", ")"], vec![condition, strict(a, t), strict(b, t)])
            }
            1 => {
                // One of a list.
                let (a, b) = (self.expr(t, depth), self.expr(t, depth));
                let i = *self.pick(&["[0]", "[1]", "[-1]", "[if level > 2 then 1 else 0]"]);
                match t {
                    T::Tuple(_) | T::Fn(..) => self.form(&["[", ", ", "][1]"], vec![free(a), free(b)]),
                    _ => E::Form(vec!["[", ", ", "]", ""], vec![free(a), free(b), free(atom(i))]),
                }
            }
            2 => {
                let name = self.name("k");
                let u = self.any_type(0);
                let value = self.expr(&u, depth);
                self.names.push((name.clone(), u));
                let body = self.expr(t, depth);
                self.names.pop();
                E::Form(
                    vec!["(z => { let ", " = ", "  let r = ", "  r })(1)"],
                    vec![free(atom(name)), free(value), free(body)],
                )
            }
            3 => {
                // A function value, called at once.
                let u = self.any_type(0);
                let f = self.lambda(std::slice::from_ref(&u), t, depth);
                let arg = self.expr(&u, depth);
                self.form(&["(", ")(", ")"], vec![free(f), free(arg)])
            }
            4 if !callable.is_empty() => {
                let f = *self.pick(&callable);
                self.call_function(f, depth)
            }
            5 if !self.inside => {
                let body = self.expr(t, depth);
                let (target, value) = match self.tape.below(5) {
                    0 => ("level: ", strict(atom("0.25"), &SCALAR)),
                    1 => ("corner: ", strict(self.expr(&vector(3), depth), &T::Str)),
                    2 => ("tilt: ", self.at(&ANGLE, depth)),
                    3 => ("lamp.intensity: ", free(atom("[3, 2, 1]"))),
                    _ => ("corner[1]: ", self.at(&SCALAR, depth)),
                };
                let value = match target {
                    "corner: " => beside(value.e, &SCALAR),
                    _ => value,
                };
                E::Form(vec!["(", " with { ", "", " })"], vec![free(body), free(atom(target)), value])
            }
            6 => {
                let item = self.name("i");
                let items = *self.pick(&["0..2", "0..=1", "[4, 5]"]);
                self.names.push((item.clone(), SCALAR));
                let e = self.expr(t, depth);
                self.names.pop();
                E::Form(vec!["[", " for ", " in ", "][0]"], vec![free(e), free(atom(item)), free(atom(items))])
            }
            8 => {
                // Through a function of which nothing is written.
                let (e, name) = (self.expr(t, depth), self.name("q"));
                self.form(&["(", " => ", ")(", ")"], vec![free(atom(&name)), free(atom(&name)), free(e)])
            }
            9 => {
                let u = self.any_type(0);
                let f = self.lambda(std::slice::from_ref(&u), t, depth);
                let arg = self.expr(&u, depth);
                self.form(
                    &["((f, x) => f(x))(", ", ", ")"],
                    vec![Place { e: f, wrong: &["1", "\"a\"", "eye"] }, free(arg)],
                )
            }
            11 => {
                let (c, a, b) = (self.at(&T::Bool, depth), self.expr(t, depth), self.expr(t, depth));
                let c = Place { wrong: &["\"a\"", "30deg", "eye"], ..c };
                self.form(&["where(", ", ", ", ", ")"], vec![c, free(a), free(b)])
            }
            13 => {
                // A field of a record.
                let other = self.any_type(0);
                let (e, other) = (self.expr(t, depth), self.expr(&other, depth));
                let name = Place { e: atom("glow"), wrong: &["glwo", "x", "vertices"] };
                self.form(&["{ glow: ", ", first: ", " }.", ""], vec![free(e), free(other), name])
            }
            way @ (7 | 10 | 12 | 14) => self.listed(way, t, depth),
            _ => self.special(t, depth).unwrap_or_else(|| self.leaf(t)),
        }
    }

    /// Ways through lists and records of several values of a type.
    fn listed(&mut self, way: usize, t: &T, depth: usize) -> E {
        match way {
            7 => {
                // Through a list of values of this type.
                let (a, b) = (self.expr(t, depth), self.expr(t, depth));
                if matches!(t, T::Tuple(_) | T::Fn(..)) {
                    return a;
                }
                let item = self.name("i");
                let last = atom(format!("{item} in ["));
                self.names.push((item.clone(), t.clone()));
                let e = self.expr(t, depth);
                self.names.pop();
                E::Form(vec!["[", " for ", "", ", ", "]][1]"], vec![free(e), free(last), free(a), free(b)])
            }
            10 => {
                let (a, b, c) = (self.expr(t, depth), self.expr(t, depth), self.any_type(0));
                let (c, d) = (self.expr(&c, depth), self.expr(&c, depth));
                if matches!(t, T::Tuple(_) | T::Fn(..)) {
                    return a;
                }
                self.form(&["zip([", ", ", "], [", ", ", "])[1][0]"], [a, b, c, d].map(free).into())
            }
            12 => {
                let (a, b) = (self.expr(t, depth), self.expr(t, depth));
                if matches!(t, T::Tuple(_) | T::Fn(..)) {
                    return b;
                }
                let (before, after) = *self.pick(&[("concat([", "])[1]"), ("minibatch(concat([", "]), 1)[0]")]);
                self.form(&[before, "], [", after], vec![free(a), free(b)])
            }
            _ => {
                // A field of each of several records.
                let (a, b) = (self.expr(t, depth), self.expr(t, depth));
                if matches!(t, T::Tuple(_) | T::Fn(..)) {
                    return a;
                }
                let item = self.name("v");
                let name = Place { e: atom("first"), wrong: &["frist", "glow"] };
                let item = || free(atom(item.clone()));
                let texts = &["[", ".", " for ", " in [{ first: ", " }, { first: ", " }]][1]"];
                self.form(texts, vec![item(), name, item(), free(a), free(b)])
            }
        }
    }

    fn lambda(&mut self, params: &[T], result: &T, depth: usize) -> E {
        let names: Vec<String> = params.iter().map(|_| self.name("a")).collect();
        let outer = self.names.len();
        self.names.extend(names.iter().cloned().zip(params.iter().cloned()));
        let inside = std::mem::replace(&mut self.inside, true);
        let body = self.expr(result, depth);
        self.inside = inside;
        self.names.truncate(outer);
        let head = match names.as_slice() {
            [one] => one.clone(),
            all => format!("({})", all.join(", ")),
        };
        self.form(&["(", " => ", ")"], vec![free(atom(head)), free(body)])
    }

    /// A call of a declared function: by position, by name, with arguments left out.
    fn call_function(&mut self, f: usize, depth: usize) -> E {
        let (name, params) = (self.functions[f].name.clone(), self.functions[f].params.clone());
        let needed = params.len() - self.functions[f].defaults;
        let count = needed + self.tape.below(params.len() - needed + 1);
        let from = self.tape.below(count + 1);
        let mut args = Vec::new();
        for (i, (param, t)) in params.iter().take(count).enumerate() {
            let e = self.expr(t, depth);
            let name = (i >= count - from).then(|| param.clone());
            args.push(Argument { name, place: free(e), needed: i < needed });
        }
        E::Call(Call { callee: Box::new(atom(name)), args, full: count == params.len() })
    }

    fn leaf(&mut self, t: &T) -> E {
        let digits = |n: usize| (1..=n).map(|i| format!("0.{i}")).collect::<Vec<_>>().join(", ");
        atom(match t {
            T::Num(shape) => match shape.as_slice() {
                [] => (*self.pick(&["0.5", "1", "0.25", "0.75", "level"])).to_owned(),
                [3] => (*self.pick(&["[0.1, 0.2, 0.3]", "corner", "#f80"])).to_owned(),
                [n] => format!("[{}]", digits(*n)),
                // A matrix that has an inverse.
                [h, w] => {
                    let row = |i: usize| {
                        (0..*w)
                            .map(|k| if i == k { "0.9".to_owned() } else { format!("0.{}", k + 1) })
                            .collect::<Vec<_>>()
                            .join(", ")
                    };
                    format!("[{}]", (0..*h).map(|i| format!("[{}]", row(i))).collect::<Vec<_>>().join(", "))
                }
                _ => "[[[0.1]]]".to_owned(),
            },
            T::Angle(None) => (*self.pick(&["30deg", "0.5rad", "tilt"])).to_owned(),
            T::Angle(Some(2)) => (*self.pick(&["[20deg, 20deg]", "tilts"])).to_owned(),
            T::Angle(Some(n)) => format!("[{}]", vec!["20deg"; *n].join(", ")),
            T::Bool => (*self.pick(&["true", "false"])).to_owned(),
            T::Str => (*self.pick(&["\"a\"", "\"b\""])).to_owned(),
            T::Image([h, w, c]) => {
                let pixel = if *c == 1 { "0.5".to_owned() } else { format!("[{}]", digits(*c)) };
                let row = format!("[{}]", vec![pixel; *w].join(", "));
                format!("image([{}])", vec![row; *h].join(", "))
            }
            T::Rotation => (*self.pick(&["rotation(angle: 30deg)", "pose"])).to_owned(),
            T::Transform => "translation([0, 1, 0])".to_owned(),
            T::Mesh => (*self.pick(&["icosphere(subdivisions: 0)", "cube()"])).to_owned(),
            T::Material => "diffuse()".to_owned(),
            T::Texture => "texture([[1, 1], [1, 1]])".to_owned(),
            T::Shape => "shape(mesh: cube())".to_owned(),
            T::Light => (*self.pick(&["constant(0.5)", "area(cube(), radiance: 2)"])).to_owned(),
            T::Camera([w, h]) => format!("camera(film: [{w}, {h}])"),
            T::Scene => "scene(shapes: [ball], lights: [lamp])".to_owned(),
            T::List(item, n) => {
                let items: Vec<String> = (0..*n).map(|_| self.leaf(item).to_string()).collect();
                format!("[{}]", items.join(", "))
            }
            T::Tuple(items) => {
                let items: Vec<String> = items.iter().map(|t| self.leaf(t).to_string()).collect();
                format!("[{}]", items.join(", "))
            }
            T::Record(fields) => {
                let fields: Vec<String> =
                    FIELDS.iter().zip(fields).map(|(name, t)| format!("{name}: {}", self.leaf(t))).collect();
                format!("{{ {} }}", fields.join(", "))
            }
            T::Fn(params, result) => {
                let params: Vec<String> = params.iter().map(|_| self.name("a")).collect();
                format!("(({}) => {})", params.join(", "), self.leaf(result))
            }
            T::Estimate => "estimate(level, repeats: 2)".to_owned(),
        })
    }
}

mod scenes;
mod special;
mod units;
