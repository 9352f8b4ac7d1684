//! Expressions that give one type: operators and the library.

use super::*;

impl Generator<'_, '_> {
    /// An expression that only makes sense for this type.
    pub(super) fn special(&mut self, t: &T, depth: usize) -> Option<E> {
        Some(match t {
            T::Num(shape) if shape.is_empty() => self.scalar(depth),
            T::Num(shape) => self.numbers(t, &shape.clone(), depth),
            T::Angle(None) => self.angle(depth),
            T::Angle(Some(n)) => self.angles(*n, depth),
            T::Bool => self.truth(depth),
            T::Str => self.text(depth),
            T::Image(size) => self.image(*size, depth),
            T::Rotation => match self.tape.below(6) {
                0 => self.named("rotation", &[("axis", vector(3)), ("angle", ANGLE)], depth),
                1 => self.call("euler", &[ANGLE, ANGLE, ANGLE], depth).any_left_out(0),
                2 => self.both(" @ ", t, t, depth).loosely(),
                3 => self.call("inverse", &[T::Rotation], depth).loosely(),
                4 => self.call("quaternion", &[SCALAR, SCALAR, SCALAR, SCALAR], depth),
                _ => self.named("rotation", &[("matrix", T::Num(vec![3, 3]))], depth),
            },
            T::Transform => match self.tape.below(5) {
                0 => self.call("translation", &[vector(3)], depth),
                1 => self.call("scaling", &[SCALAR], depth),
                2 => self.both(" @ ", &T::Rotation, t, depth).loosely(),
                3 => self.call("compose", &[T::Rotation, T::Transform], depth),
                _ => self.call("look_at", &[vector(3), vector(3), vector(3)], depth).any_left_out(2),
            },
            T::Mesh => self.mesh(depth),
            T::Material => match self.tape.below(15) {
                0 => self.named("diffuse", &[("reflectance", T::Texture)], depth),
                1 => self.call("one_sided", &[T::Material], depth),
                2 => self.call("mask", &[T::Material, T::Texture], depth),
                3 => self.named("plastic", &[("diffuse", T::Texture), ("roughness", T::Texture)], depth),
                4 => self.named("dielectric", &[("ior", T::Texture)], depth),
                5 => self.call("normal_map", &[T::Material, T::Texture], depth).loosely(),
                6 => self.named("principled", &[("roughness", T::Texture), ("base_color", T::Texture)], depth),
                7 => self.named("thin_dielectric", &[("tint", T::Texture)], depth),
                8 => self.call("coated", &[T::Material, T::Texture], depth).loosely().any_left_out(1),
                9 => self.named("cloth", &[("sheen", T::Texture), ("roughness", T::Texture)], depth),
                12 => self.named("thin_dielectric", &[("ior", T::Texture), ("roughness", T::Texture)], depth),
                11 => self.call("brushed", &[T::Material, T::Texture, T::Angle(None)], depth).loosely().any_left_out(1),
                13 => self.call("sheened", &[T::Material, T::Texture], depth).loosely().any_left_out(1),
                10 => self.call("blend", &[T::Material, T::Material, T::Texture], depth).loosely().any_left_out(2),
                _ => self.field("", T::Shape, ".material", depth),
            },
            T::Texture => match self.tape.below(4) {
                0 => self.open("texture", &T::Image([3, 4, 3]), depth).loosely(),
                1 => atom("checkerboard(a: 0.1, b: [0.2, 0.3, 0.4], tiles: 2)"),
                2 => atom("texture([[1, 1]], filter: nearest, wrap: mirror)"),
                _ => atom("vertex_color()"),
            },
            T::Shape => self.named("shape", &[("mesh", T::Mesh), ("material", T::Material)], depth),
            T::Light => match self.tape.below(5) {
                0 => self.named("point", &[("position", vector(3))], depth),
                1 => self.named("area", &[("mesh", T::Mesh), ("material", T::Material)], depth),
                4 => {
                    let parts =
                        [("position", vector(3)), ("profile", T::Image([3, 4, 3])), ("rotation", T::Angle(None))];
                    self.named("point", &parts, depth)
                }
                2 => self.named("directional", &[("direction", vector(3))], depth),
                _ => self.named("spot", &[("position", vector(3)), ("direction", vector(3))], depth),
            },
            T::Camera([w, h]) => {
                let mut e = self.named("camera", &[("position", vector(3)), ("up", vector(3))], depth);
                if let E::Call(call) = &mut e {
                    let place =
                        Place { e: atom(format!("[{w}, {h}]")), wrong: &["\"a\"", "[1, 2, 3]", "30deg", "[1.5, 2]"] };
                    call.args.push(Argument { name: Some("film".to_owned()), place, needed: false });
                }
                e
            }
            T::Scene => {
                let (shape, light) = (self.at(&T::Shape, depth), self.at(&T::Light, depth));
                self.form(&["scene(shapes: [", "], lights: [", "])"], vec![shape, light])
            }
            T::List(item, n) => {
                let places = (0..*n).map(|_| free(self.expr(item, depth))).collect();
                self.list(places)
            }
            T::Tuple(items) => {
                let places = items.iter().map(|t| free(self.expr(t, depth))).collect();
                self.list(places)
            }
            T::Record(fields) => {
                const TEXTS: [&str; 3] = ["{ first: ", ", glow: ", ", param: "];
                let places: Vec<Place> = fields.iter().map(|t| free(self.expr(t, depth))).collect();
                E::Form(TEXTS[..places.len()].iter().copied().chain([" }"]).collect(), places)
            }
            T::Fn(params, result) => self.lambda(params, result, depth),
            T::Estimate => {
                let of = self.at(&SCALAR, depth);
                self.form(&["estimate(", ", repeats: 2)"], vec![free(of.e)])
            }
        })
    }

    pub(super) fn list(&self, places: Vec<Place>) -> E {
        let texts: Vec<&'static str> = (0..=places.len())
            .map(|i| match i {
                0 => "[",
                i if i == places.len() => "]",
                _ => ", ",
            })
            .collect();
        E::Form(texts, places)
    }

    pub(super) fn named(&mut self, name: &str, params: &[(&str, T)], depth: usize) -> E {
        let args = params
            .iter()
            .map(|(n, t)| Argument { name: Some((*n).to_owned()), place: self.at(t, depth), needed: false })
            .collect();
        E::Call(Call { callee: Box::new(atom(name)), args, full: false })
    }

    /// An operator between two types.
    pub(super) fn both(&mut self, op: &'static str, a: &T, b: &T, depth: usize) -> E {
        let (x, y) = (self.expr(a, depth), self.expr(b, depth));
        self.form(&["(", op, ")"], vec![beside(x, a), beside(y, b)])
    }

    pub(super) fn field(&mut self, before: &'static str, of: T, name: &'static str, depth: usize) -> E {
        let e = self.expr(&of, depth);
        self.form(&[before, name], vec![Place { e, wrong: &["1", "true", "sin"] }])
    }

    /// `f(x)` for any numbers.
    pub(super) fn of_numbers(&mut self, name: &'static str, depth: usize) -> E {
        let types = [vector(3), T::Num(vec![2, 3]), T::Image([3, 4, 3]), vector(4), SCALAR];
        let t = self.pick(&types).clone();
        let e = self.expr(&t, depth);
        let args = vec![Argument {
            name: None,
            place: Place { e, wrong: &["\"a\"", "true", "sphere()", "eye"] },
            needed: true,
        }];
        E::Call(Call { callee: Box::new(atom(name)), args, full: false })
    }

    /// `f(a, b)` of one type.
    pub(super) fn pair(&mut self, name: &'static str, t: &T, wrong: &'static [&'static str], depth: usize) -> E {
        let args =
            (0..2).map(|_| Argument { name: None, place: Place { e: self.expr(t, depth), wrong }, needed: true });
        let args = args.collect();
        E::Call(Call { callee: Box::new(atom(name)), args, full: false })
    }

    pub(super) fn scalar(&mut self, depth: usize) -> E {
        match self.tape.below(54) {
            way @ ..15 => self.scalar_by_operators(way, depth),
            way @ 15..31 => self.scalar_of_many(way, depth),
            way => self.scalar_of_things(way, depth),
        }
    }

    fn total_variation(&mut self, depth: usize) -> E {
        self.call("total_variation", &[T::Image([3, 4, 3])], depth)
    }

    /// Of operators and of few numbers.
    fn scalar_by_operators(&mut self, way: usize, depth: usize) -> E {
        match way {
            0 => self.both(" + ", &SCALAR, &SCALAR, depth),
            1 => self.both(" - ", &SCALAR, &SCALAR, depth),
            2 => self.both(" * ", &SCALAR, &SCALAR, depth).loosely(),
            3 => self.both(" / ", &SCALAR, &SCALAR, depth).loosely(),
            4 => self.both(" ^ ", &SCALAR, &SCALAR, depth),
            5 => {
                let x = self.expr(&SCALAR, depth);
                self.form(&["(-", ")"], vec![Place { e: x, wrong: TEXTS }])
            }
            6 => {
                let f = *self.pick(&["sin", "cos", "tan"]);
                self.call(f, &[ANGLE], depth)
            }
            7 => {
                let (a, b) = (self.expr(&ANGLE, depth), self.expr(&ANGLE, depth));
                self.form(&["(", " / ", ")"], vec![free(a), Place { e: b, wrong: &["\"a\"", "true", "sphere()"] }])
            }
            8 => {
                let t = vector(2 + self.tape.below(3));
                self.call("dot", &[t.clone(), t], depth)
            }
            9 => {
                let t = vector(2 + self.tape.below(3));
                let name = *self.pick(&["length", "norm"]);
                self.open(name, &t, depth).loosely()
            }
            10 => self.field("", vector(3), ".y", depth),
            11 => {
                let v = self.expr(&vector(3), depth);
                let i = *self.pick(&["0", "1", "-1"]);
                let index = Place { e: atom(i), wrong: &["\"a\"", "true", "30deg", "7", "0.5", "[0, 1]"] };
                self.form(&["", "[", "]"], vec![Place { e: v, wrong: &["1", "true", "30deg"] }, index])
            }
            12 => {
                let f = *self.pick(&["sum", "mean", "std", "median", "variance", "norm", "min", "max"]);
                self.of_numbers(f, depth)
            }
            13 => {
                let types = [T::Image([3, 4, 3]), vector(3), T::Num(vec![2, 3]), SCALAR];
                let t = self.pick(&types).clone();
                let f = *self.pick(&["mse", "l1", "l2", "huber", "smape", "relative_mse", "psnr"]);
                self.pair(f, &t, TEXTS, depth)
            }
            14 => {
                let f = *self.pick(&["min", "max"]);
                self.pair(f, &SCALAR, NUMBERS_AND_ANGLES, depth).any_left_out(1)
            }
            _ => self.total_variation(depth),
        }
    }

    /// Of many numbers, of derivatives and of lists.
    fn scalar_of_many(&mut self, way: usize, depth: usize) -> E {
        match way {
            15 => {
                let args = (0..3).map(|_| Argument {
                    name: None,
                    place: beside(self.expr(&SCALAR, depth), &SCALAR),
                    needed: true,
                });
                E::Call(Call { callee: Box::new(atom("clamp")), args: args.collect(), full: true })
            }
            16 => self.call("mix", &[SCALAR, SCALAR, SCALAR], depth).loosely(),
            17 => {
                let f = *self.pick(&["abs", "exp", "floor", "sqrt", "tanh", "sign", "round", "ceil", "log"]);
                let x = self.expr(&SCALAR, depth);
                E::Call(Call {
                    callee: Box::new(atom(f)),
                    args: vec![Argument { name: None, place: Place { e: x, wrong: TEXTS }, needed: true }],
                    full: true,
                })
            }
            18 => {
                let n = self.tape.below(3) + 1;
                let list = self.expr(&T::List(Box::new(T::Str), n), depth);
                self.form(&["len(", ")"], vec![free(list)])
            }
            19 => {
                let name = *self.pick(&[".width", ".height", ".channels"]);
                self.field("", T::Image([3, 4, 3]), name, depth)
            }
            20 => self.call("determinant", &[T::Num(vec![3, 3])], depth).loosely(),
            21 => {
                let f = *self.pick(&[
                    "surface_area",
                    "volume",
                    "laplacian_energy",
                    "edge_length_energy",
                    "normal_consistency",
                ]);
                self.call(f, &[T::Mesh], depth)
            }
            22 => self.call("chamfer", &[T::Mesh, T::Mesh], depth).loosely(),
            23 => {
                let (c, a, b) = (self.at(&T::Bool, depth), self.expr(&SCALAR, depth), self.expr(&SCALAR, depth));
                let c = Place { wrong: &["\"a\"", "30deg", "eye"], ..c };
                self.form(&["where(", ", ", ", ", ")"], vec![c, beside(a, &SCALAR), beside(b, &SCALAR)])
            }
            24 if !self.inside => {
                let of = self.at(&SCALAR, depth);
                let p = Place { e: atom(*self.pick(&["level", "tilt"])), wrong: &["img", "eye", "1", "\"a\""] };
                let f = *self.pick(&["grad(", "fd("]);
                self.form(&[f, ", ", ")"], vec![of, p])
            }
            25 if !self.inside => {
                let of = self.expr(&SCALAR, depth);
                self.form(&["jvp(", ", corner, ", ")"], vec![free(of), free(atom("[1, 0, 0]"))])
            }
            26 => self.field("", T::Estimate, ".mean", depth),
            27 => self.call("silhouette_iou", &[T::Image([3, 4, 1]), T::Image([3, 4, 1])], depth),
            28 => {
                let (f, x) = (self.expr(&T::Fn(vec![SCALAR], Box::new(SCALAR)), depth), self.expr(&SCALAR, depth));
                let f = Place { e: f, wrong: &["1", "\"a\"", "eye"] };
                self.form(&["", "(", ")"], vec![f, free(x)])
            }
            29 => {
                let items = self.expr(&vector(4), depth);
                let n = self.name("i");
                self.names.push((n.clone(), SCALAR));
                let e = self.expr(&SCALAR, depth);
                self.names.pop();
                self.form(
                    &["sum([", " for ", " in ", "])"],
                    vec![Place { e, wrong: TEXTS }, free(atom(n)), Place { e: items, wrong: &["1", "true", "eye"] }],
                )
            }
            30 => {
                let m = self.expr(&T::Num(vec![2, 3]), depth);
                self.form(&["", "[1][2]"], vec![Place { e: m, wrong: &["1", "true", "30deg", "[1, 2]"] }])
            }
            _ => self.total_variation(depth),
        }
    }

    /// Of images and scenes, and what is known late.
    fn scalar_of_things(&mut self, way: usize, depth: usize) -> E {
        match way {
            31 => self.call("pyramid_loss", &[T::Image([3, 4, 3]), T::Image([3, 4, 3])], depth).open_ended(),
            32 => {
                let x = self.expr(&SCALAR, depth);
                self.form(&["(", " |> max(0.1) |> sqrt)"], vec![Place { e: x, wrong: TEXTS }])
            }
            33 => self.call("distance", &[vector(3), vector(3)], depth),
            34 => self.form_of("percentile(", vector(4), ", 30)", depth),
            35 => {
                let x = self.expr(&T::Tuple(vec![T::Str, SCALAR, SCALAR]), depth);
                self.form(&["", "[1]"], vec![free(x)])
            }
            36 => self.field("", T::Camera([4, 3]), ".height", depth),
            37 => self.call("ssim", &[T::Image([3, 4, 3]), T::Image([3, 4, 3])], depth).open_ended(),
            38 => self.both(" @ ", &vector(3), &vector(3), depth),
            39 => {
                // One of several functions; which one is known late.
                let t = T::Fn(vec![SCALAR], Box::new(SCALAR));
                let (f, g, x) = (self.expr(&t, depth), self.expr(&t, depth), self.expr(&SCALAR, depth));
                let which = free(atom("[if level > 2 then 1 else 0]"));
                E::Form(vec!["[", ", ", "]", "(", ")"], vec![free(f), free(g), which, Place { e: x, wrong: &[] }])
            }
            40 => {
                // A condition that is known would leave one of the two out.
                let t = T::Fn(vec![ANGLE], Box::new(SCALAR));
                let (c, f, x) = (free(atom("level > 2")), self.expr(&t, depth), self.expr(&ANGLE, depth));
                let x = Place { e: x, wrong: &["1", "\"a\"", "true"] };
                self.form(&["(if ", " then sin else ", ")(", ")"], vec![c, Place { e: f, wrong: &["1", "\"a\""] }, x])
            }
            41 => {
                // A length that is known late.
                let (items, i) = (self.expr(&vector(4), depth), self.name("i"));
                self.names.push((i.clone(), SCALAR));
                let (e, c) = (self.expr(&SCALAR, depth), self.at(&T::Bool, depth));
                self.names.pop();
                let e = Place { e, wrong: TEXTS };
                self.form(&["sum([", " for ", " in ", " if ", "])"], vec![e, free(atom(i)), free(items), c])
            }
            42 => {
                let (a, b) = (self.expr(&vector(3), depth), self.expr(&T::Angle(Some(2)), depth));
                let wrong = &["1", "true", "eye"];
                let places = vec![Place { e: a, wrong }, Place { e: b, wrong }];
                self.form(&["sum([a * sin(b) for a, b in zip(", "[0..2], ", ")])"], places)
            }
            43 => atom("mean(lamp.intensity)"),
            44 => self.form_of("mean(grad(", SCALAR, ", lamp.intensity))", depth).outside(self.inside),
            45 => self.form_of("mean(pyramid(", T::Image([3, 4, 3]), ", levels: 2)[1])", depth),
            46 => self.form_of("argmin(", vector(4), ")", depth),
            47 => self.form_of("max(downsample(", T::Image([3, 4, 3]), "))", depth),
            48 => self
                .form_of("(render(eye, spp: 1) with { eye.film: [2, 2], level: ", SCALAR, " }).width", depth)
                .outside(self.inside),
            49 => {
                let e = self.expr(&T::Mesh, depth);
                self.form(&["mean(", ".vertices)"], vec![Place { e, wrong: &["1", "true", "sin", "img"] }])
            }
            50 => self.form_of("(", SCALAR, " |> min(level))", depth).loosely(),
            51 => {
                let e = self.expr(&T::Angle(Some(2)), depth);
                let before = *self.pick(&["sum(sin(", "mean(cos(", "max(tan("]);
                self.form(&[before, "))"], vec![Place { e, wrong: &["1", "[1, 2]", "img", "true"] }])
            }
            52 => self.form_of("mean(cos(1rad * ", T::Image([3, 4, 3]), "))", depth).loosely(),
            _ => self.total_variation(depth),
        }
    }

    pub(super) fn numbers(&mut self, t: &T, shape: &[usize], depth: usize) -> E {
        match (self.tape.below(14), shape) {
            (0, _) => self.both(" + ", t, t, depth),
            (1, _) => self.both(" * ", t, &SCALAR, depth).loosely(),
            (2, _) => self.both(" - ", &SCALAR, t, depth),
            (3, [_, rest @ ..]) => {
                let inner = T::Num(rest.to_vec());
                let places = (0..shape[0]).map(|_| strict_item(self.expr(&inner, depth), &inner)).collect();
                self.list(places)
            }
            (4, [n, rest @ ..]) => {
                let i = self.name("i");
                self.names.push((i.clone(), SCALAR));
                let e = self.expr(&T::Num(rest.to_vec()), depth);
                self.names.pop();
                let range = Place { e: atom(format!("0..{n}")), wrong: &["1", "true", "eye"] };
                E::Form(vec!["[", " for ", " in ", "]"], vec![free(e), free(atom(i)), range])
            }
            (5, _) => {
                let f = *self.pick(&["abs", "exp", "floor", "sqrt", "stop_gradient", "to_srgb", "sigmoid", "sort"]);
                let e = self.expr(t, depth);
                E::Form(vec![f, "(", ")"], vec![free(atom("")), Place { e, wrong: &["\"a\"", "true", "sphere()"] }])
            }
            (6, _) => {
                let (m, a, b) = (self.expr(t, depth), self.expr(t, depth), self.expr(t, depth));
                self.form(&["where(", " > 0.2, ", ", ", ")"], vec![beside(m, t), beside(a, t), beside(b, t)])
            }
            (7, [3]) => self.call("cross", &[vector(3), vector(3)], depth),
            (8, [3]) => self.both(" @ ", &T::Rotation, &vector(3), depth).loosely(),
            (9, [3]) => self.both(" @ ", &T::Num(vec![3, 3]), &vector(3), depth),
            (10, [3]) => self.open("centroid", &T::Mesh, depth),
            (11, [3]) if !self.inside => {
                let of = self.at(&SCALAR, depth);
                self.form(&["grad(", ", corner)"], vec![of])
            }
            (12, [3]) => self.call("normalize", &[vector(3)], depth).loosely(),
            (13, [3]) => self.field("", vector(3), ".zyx", depth),
            (7, [2]) => self.field("", vector(3), ".xy", depth),
            (8, [2]) => self.field("", vector(3), ".rg", depth),
            (9, [2]) => self.both(" @ ", &T::Num(vec![2, 3]), &vector(3), depth),
            (10, [2]) => {
                let (camera, e) = (self.arg(&T::Camera([4, 3]), depth), self.expr(&vector(3), depth));
                let place = Place { e, wrong: &["\"a\"", "true", "eye"] };
                let args = vec![camera, Argument { name: None, place, needed: true }];
                E::Call(Call { callee: Box::new(atom("project")), args, full: true })
            }
            (11, [2]) => {
                let e = self.expr(&vector(4), depth);
                self.form(&["", "[1..3]"], vec![Place { e, wrong: &["1", "true", "30deg"] }])
            }
            (12, [2]) => self.field("", T::Camera([4, 3]), ".film", depth),
            (7, [4]) => {
                let (a, b) = (self.expr(&vector(2), depth), self.expr(&vector(2), depth));
                let wrong = &["1", "\"a\"", "true"];
                self.form(&["concat(", ", ", ")"], vec![Place { e: a, wrong }, Place { e: b, wrong }])
            }
            (8, [4]) => self.form_of("reshape(", T::Num(vec![2, 2]), ", [4])", depth),
            (9, [4]) => self.form_of("linspace(", SCALAR, ", 2, 4)", depth),
            (7, [3, 3]) => self.both(" @ ", t, t, depth),
            (8, [3, 3]) => self.call("inverse", std::slice::from_ref(t), depth).loosely(),
            (9, [3, 3]) => self.call("matrix", &[T::Rotation], depth),
            (10, [3, 3]) => self.call("transpose", std::slice::from_ref(t), depth).loosely(),
            (11, [3, 3]) if !self.inside => {
                let of = self.expr(&vector(3), depth);
                self.form(&["jacobian(", ", corner)"], vec![free(of)])
            }
            (7, [2, 3]) => self.call("bounds", &[T::Mesh], depth),
            (8, [2, 3]) => self.both(" @ ", t, &T::Num(vec![3, 3]), depth),
            (9, [2, 3]) => self.both(" @ ", &T::Transform, t, depth).loosely(),
            (10, [2, 3]) => self.form_of("reshape(", T::Num(vec![6]), ", [2, 3])", depth),
            (_, [n]) => {
                // Along an axis.
                let e = self.expr(&T::Num(vec![2, *n]), depth);
                let f = *self.pick(&["sum", "mean", "max", "median", "norm"]);
                let wrong: &'static [&'static str] = &["\"a\"", "true", "sphere()", "1"];
                E::Form(
                    vec!["", "(", ", axis: ", ")"],
                    vec![free(atom(f)), Place { e, wrong }, Place { e: atom("0"), wrong: &["5", "\"a\"", "30deg"] }],
                )
            }
            _ => self.both(" / ", t, t, depth).loosely(),
        }
    }

    pub(super) fn form_of(&mut self, before: &'static str, t: T, after: &'static str, depth: usize) -> E {
        let e = self.expr(&t, depth);
        self.form(&[before, after], vec![Place { e, wrong: &["\"a\"", "true", "sphere()"] }])
    }
}

impl E {
    /// What is wrong in its places is what nothing that computes takes.
    pub(super) fn loosely(mut self) -> E {
        self.places().into_iter().for_each(|place| place.wrong = &["\"a\"", "true", "eye"]);
        self
    }

    /// From the argument of that number on they may be left out.
    pub(super) fn any_left_out(mut self, from: usize) -> E {
        if let E::Call(call) = &mut self {
            call.args.iter_mut().skip(from).for_each(|a| a.needed = false);
        }
        self
    }

    /// Something else within a function's body, where it cannot be.
    pub(super) fn outside(self, inside: bool) -> E {
        if inside { atom("level") } else { self }
    }

    /// There are further arguments.
    pub(super) fn open_ended(mut self) -> E {
        if let E::Call(call) = &mut self {
            call.full = false;
        }
        self
    }
}

/// What is no number.
const TEXTS: &[&str] = &["\"a\"", "true", "sphere()", "eye"];

const NUMBERS_AND_ANGLES: &[&str] = &["30deg", "\"a\"", "true", "sphere()"];

/// An item of an array of numbers.
fn strict_item(e: E, t: &T) -> Place {
    let wrong: &'static [&'static str] = match t {
        T::Num(shape) if shape.is_empty() => &["30deg"],
        _ => &[],
    };
    Place { e, wrong }
}
