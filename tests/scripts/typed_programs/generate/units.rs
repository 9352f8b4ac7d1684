//! Angles, truths and texts.

use super::*;

impl Generator<'_, '_> {
    pub(super) fn angle(&mut self, depth: usize) -> E {
        match self.tape.below(14) {
            0 => self.both(" + ", &ANGLE, &ANGLE, depth),
            1 => {
                let (a, b) = (self.expr(&ANGLE, depth), self.expr(&SCALAR, depth));
                self.form(&["(", " * ", ")"], vec![free(a), Place { e: b, wrong: &["30deg", "\"a\"", "true"] }])
            }
            2 => {
                let (a, b) = (self.expr(&SCALAR, depth), self.expr(&ANGLE, depth));
                self.form(&["(", " * ", ")"], vec![Place { e: a, wrong: &["30deg", "\"a\"", "true"] }, free(b)])
            }
            3 => {
                let (a, b) = (self.expr(&ANGLE, depth), self.expr(&SCALAR, depth));
                self.form(&["(", " / ", ")"], vec![Place { e: a, wrong: &["\"a\"", "true", "eye"] }, free(b)])
            }
            4 => {
                let f = *self.pick(&["asin", "acos", "atan"]);
                self.open(f, &SCALAR, depth).loosely()
            }
            5 => self.pair("atan2", &SCALAR, &["30deg", "\"a\"", "true"], depth),
            6 => {
                let f = *self.pick(&["min", "max", "mod"]);
                self.pair(f, &ANGLE, &["1", "\"a\"", "true"], depth).any_left_out(1)
            }
            7 => {
                let args = (0..3).map(|_| Argument {
                    name: None,
                    place: beside(self.expr(&ANGLE, depth), &ANGLE),
                    needed: true,
                });
                E::Call(Call { callee: Box::new(atom("clamp")), args: args.collect(), full: true })
            }
            8 => {
                let (a, b, x) = (self.expr(&ANGLE, depth), self.expr(&ANGLE, depth), self.expr(&SCALAR, depth));
                self.form(&["mix(", ", ", ", ", ")"], vec![beside(a, &ANGLE), beside(b, &ANGLE), beside(x, &SCALAR)])
            }
            9 => {
                let f = *self.pick(&["sum", "mean", "min", "max", "median", "std"]);
                let e = self.expr(&T::Angle(Some(2)), depth);
                E::Form(
                    vec!["", "(", ")"],
                    vec![free(atom(f)), Place { e, wrong: &["\"a\"", "true", "[[1, 2], [3]]"] }],
                )
            }
            10 => {
                let e = self.expr(&T::Angle(Some(2)), depth);
                self.form(&["", "[1]"], vec![Place { e, wrong: &["1", "true", "30deg"] }])
            }
            11 => {
                let e = self.expr(&ANGLE, depth);
                self.form(&["abs(", ")"], vec![Place { e, wrong: &["\"a\"", "true", "eye"] }])
            }
            12 => {
                let e = self.expr(&ANGLE, depth);
                self.form(&["(-", ")"], vec![Place { e, wrong: &["\"a\"", "true", "eye"] }])
            }
            _ => self.both(" - ", &ANGLE, &ANGLE, depth),
        }
    }

    pub(super) fn angles(&mut self, n: usize, depth: usize) -> E {
        let t = T::Angle(Some(n));
        match self.tape.below(8) {
            0 => self.both(" + ", &t, &ANGLE, depth),
            1 => {
                let (a, b) = (self.expr(&t, depth), self.expr(&SCALAR, depth));
                self.form(&["(", " * ", ")"], vec![free(a), Place { e: b, wrong: &["30deg", "\"a\"", "true"] }])
            }
            2 => {
                let places = (0..n).map(|_| Place { e: self.expr(&ANGLE, depth), wrong: &[] }).collect();
                self.list(places)
            }
            3 => {
                let i = self.name("i");
                let e = self.expr(&ANGLE, depth);
                E::Form(vec!["[", " for ", " in ", "]"], vec![free(e), free(atom(i)), free(atom(format!("0..{n}")))])
            }
            4 => {
                let (a, b) = (self.expr(&ANGLE, depth), self.expr(&ANGLE, depth));
                E::Form(
                    vec!["linspace(", ", ", ", ", ")"],
                    vec![beside(a, &ANGLE), beside(b, &ANGLE), free(atom(n.to_string()))],
                )
            }
            5 => {
                let f = *self.pick(&["asin", "acos", "atan"]);
                self.open(f, &vector(n), depth).loosely()
            }
            6 => self.pair("atan2", &vector(n), &["30deg", "\"a\"", "true"], depth),
            _ => {
                let (a, b) = (self.expr(&t, depth), self.expr(&t, depth));
                let f = *self.pick(&["max(", "mod("]);
                self.form(&[f, ", ", ")"], vec![beside(a, &t), beside(b, &t)])
            }
        }
    }

    pub(super) fn truth(&mut self, depth: usize) -> E {
        match self.tape.below(11) {
            0 => {
                let op = *self.pick(&[" > ", " <= ", " == ", " != "]);
                self.both(op, &SCALAR, &SCALAR, depth)
            }
            1 => {
                let op = *self.pick(&[" < ", " >= ", " == "]);
                self.both(op, &ANGLE, &ANGLE, depth)
            }
            2 => {
                let op = *self.pick(&[" and ", " or "]);
                let (a, b) = (self.at(&T::Bool, depth), self.at(&T::Bool, depth));
                let wrong = &["1", "\"a\"", "30deg"];
                self.form(&["(", op, ")"], vec![Place { wrong, ..a }, Place { wrong, ..b }])
            }
            3 => {
                let a = self.at(&T::Bool, depth);
                self.form(&["(not ", ")"], vec![Place { wrong: &["1", "\"a\"", "30deg", "eye"], ..a }])
            }
            4 => {
                let (a, b) = (self.expr(&T::Str, depth), self.expr(&T::Str, depth));
                self.form(&["(", " == ", ")"], vec![strict(a, &T::Str), strict(b, &T::Str)])
            }
            5 => {
                let t = self.pick(&[vector(3), T::Num(vec![2, 3])]).clone();
                self.both(" == ", &t, &t, depth)
            }
            6 => {
                let f = *self.pick(&["all", "any"]);
                let t = self.pick(&[vector(3), T::Image([3, 4, 1]), T::Num(vec![2, 3])]).clone();
                let e = self.expr(&t, depth);
                E::Form(vec!["", "(", " > 0.3)"], vec![free(atom(f)), beside(e, &t)])
            }
            7 => {
                let n = 1 + self.tape.below(3);
                let e = self.expr(&T::List(Box::new(T::Bool), n), depth);
                self.form(&["all(", ")"], vec![Place { e, wrong: &["\"a\"", "30deg", "true"] }])
            }
            8 => {
                let e = self.expr(&SCALAR, depth);
                self.form(&["is_nan(", ")"], vec![Place { e, wrong: &["\"a\"", "true"] }])
            }
            9 => {
                let t = T::List(Box::new(T::Str), 2);
                let (a, b) = (self.expr(&t, depth), self.expr(&t, depth));
                let wrong = &["[1, 2]", "1", "true"];
                self.form(&["(", " == ", ")"], vec![Place { e: a, wrong }, Place { e: b, wrong }])
            }
            _ => self.both(" == ", &T::Angle(Some(2)), &T::Angle(Some(2)), depth),
        }
    }

    pub(super) fn text(&mut self, depth: usize) -> E {
        match self.tape.below(5) {
            0 | 1 => {
                let t = self.pick(&[SCALAR, T::Str, ANGLE, T::Bool, vector(3), T::Estimate]).clone();
                let e = self.expr(&t, depth).to_string();
                // What is quoted inside of a text cannot be written there.
                let e = if e.contains('"') || e.contains('{') { "level".to_owned() } else { e };
                self.form(&["\"x {", "}\""], vec![Place { e: atom(e), wrong: &["sphere()", "eye", "diffuse()"] }])
            }
            2 => self.form(&["\"{", ":.2}\""], vec![Place { e: atom("level"), wrong: &["sphere()", "eye"] }]),
            3 => {
                let e = self.expr(&T::Tuple(vec![T::Str, SCALAR, SCALAR]), depth);
                self.form(&["", "[0]"], vec![free(e)])
            }
            _ => self.field("", T::Camera([4, 3]), ".kind", depth),
        }
    }
}
