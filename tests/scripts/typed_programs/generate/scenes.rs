//! Images and meshes.

use super::*;

impl Generator<'_, '_> {
    pub(super) fn image(&mut self, [h, w, c]: [usize; 3], depth: usize) -> E {
        let t = T::Image([h, w, c]);
        const WRONG: &[&str] = &["\"a\"", "true", "eye", "sphere()", "30deg", "image([[1]])"];
        match (self.tape.below(20), [h, w, c]) {
            (0, _) => {
                let op = *self.pick(&[" + ", " - ", " * ", " / "]);
                let (a, b) = (self.expr(&t, depth), self.expr(&t, depth));
                self.form(&["(", op, ")"], vec![Place { e: a, wrong: WRONG }, Place { e: b, wrong: WRONG }])
            }
            (1, _) => self.both(" * ", &t, &SCALAR, depth).loosely(),
            (2, [.., 3]) => self.both(" + ", &t, &vector(3), depth),
            (3, [.., 3]) => self.both(" * ", &t, &T::Image([h, w, 1]), depth).loosely(),
            (4, _) => {
                let f = *self.pick(&["abs", "exp", "tonemap", "gamma", "to_srgb", "sign", "sqrt"]);
                let e = self.expr(&t, depth);
                E::Form(vec!["", "(", ")"], vec![free(atom(f)), Place { e, wrong: &["\"a\"", "true", "eye"] }])
            }
            (5, _) => self.form_of("blur(", t.clone(), ", 0.5)", depth),
            (6, _) => {
                let (m, a, b) = (self.expr(&T::Image([h, w, 1]), depth), self.expr(&t, depth), self.expr(&t, depth));
                self.form(
                    &["where(", " > 0.2, ", ", ", ")"],
                    vec![beside(m, &t), Place { e: a, wrong: WRONG }, Place { e: b, wrong: WRONG }],
                )
            }
            (7, _) => self.open("flip", &t, depth).loosely(),
            (8, _) => {
                let (a, b) = (self.expr(&t, depth), self.expr(&t, depth));
                self.form(&["max(", ", ", ")"], vec![Place { e: a, wrong: WRONG }, Place { e: b, wrong: WRONG }])
            }
            (9, [2, 3, c]) => {
                let e = self.expr(&T::Image([3, 4, c]), depth);
                self.form(&["crop(", ", x: 1, width: 3, height: 2)"], vec![Place { e, wrong: WRONG }])
            }
            (10, [2, 3, c]) => {
                let e = self.expr(&T::Image([3, 4, c]), depth);
                self.form(&["resize(", ", width: 3, height: 2)"], vec![Place { e, wrong: IMAGE_WRONG }])
            }
            (11, [3, 4, 3]) => self.channel(&["render", "position", "normal", "albedo", "geometric_normal"], depth),
            (11, [3, 4, 1]) => self.channel(&["depth", "alpha", "shape_index"], depth),
            (12, [3, 4, 1]) => self.call("luminance", &[T::Image([3, 4, 3])], depth).loosely(),
            (13, [3, 4, 1]) => {
                let name = *self.pick(&[".r", ".g", ".b", ".x"]);
                self.field("", T::Image([3, 4, 3]), name, depth)
            }
            (14, [3, 4, 1]) => self.form_of("sum(", T::Image([3, 4, 3]), ", axis: 2)", depth),
            (15, [3, 4, 3]) => {
                let (a, uv) = (self.expr(&T::Image([2, 3, 3]), depth), self.expr(&T::Camera([4, 3]), depth));
                self.form(
                    &["sample(", ", uv(", ", spp: 1))"],
                    vec![Place { e: a, wrong: IMAGE_WRONG }, Place { e: uv, wrong: &["1", "img", "\"a\""] }],
                )
            }
            (16, [3, 4, 3]) if !self.inside => {
                let of = self.expr(&t, depth);
                self.form(&["jvp(", ", level)"], vec![free(of)])
            }
            (15, [3, 4, 1]) => {
                let e = self.expr(&t, depth);
                self.form(&["estimate(", ", repeats: 2).mean"], vec![Place { e, wrong: &["eye", "sphere()", "\"a\""] }])
            }
            (17, [3, 4, 3]) => self.form_of("pad(", T::Image([2, 3, 3]), ", left: 1, top: 1)", depth),
            (18, [3, 4, 3]) => self.form_of("colormap(", T::Image([3, 4, 1]), ", map: turbo)", depth),
            (18, [3, 4, 1]) => self.form_of("montage([", t.clone(), "])", depth),
            (16, [3, 4, 3]) => self.both(" @ ", &T::Num(vec![3, 3]), &t, depth),
            (_, [h, w, c]) => {
                let shape = if c == 1 { vec![h, w] } else { vec![h, w, c] };
                if shape == [2, 3] {
                    let e = self.expr(&T::Num(shape), depth);
                    return self.form(&["image(", ")"], vec![Place { e, wrong: &["\"a\"", "true", "1", "eye"] }]);
                }
                self.both(" + ", &SCALAR, &t, depth)
            }
        }
    }

    /// What a camera sees.
    pub(super) fn channel(&mut self, names: &[&'static str], depth: usize) -> E {
        let name = *self.pick(names);
        let camera = self.at(&T::Camera([4, 3]), depth);
        let mut args = vec![Argument { name: None, place: camera, needed: true }];
        if self.tape.below(2) > 0 {
            let scene = self.at(&T::Scene, depth);
            args.push(Argument { name: Some("scene".to_owned()), place: scene, needed: false });
        }
        let spp = Place { e: atom("1"), wrong: &["\"a\"", "30deg", "1.5", "0", "level"] };
        args.push(Argument { name: Some("spp".to_owned()), place: spp, needed: false });
        E::Call(Call { callee: Box::new(atom(name)), args, full: false })
    }

    pub(super) fn mesh(&mut self, depth: usize) -> E {
        match self.tape.below(12) {
            0 => self.call("translate", &[T::Mesh, vector(3)], depth),
            1 => {
                let (m, a) = (self.at(&T::Mesh, depth), self.at(&ANGLE, depth));
                self.form(&["(", " |> rotate(y: ", "))"], vec![m, a])
            }
            2 => self.both(" @ ", &T::Rotation, &T::Mesh, depth).loosely(),
            3 => self.both(" @ ", &T::Transform, &T::Mesh, depth).loosely(),
            4 => {
                let f = *self.pick(&["smooth_normals", "flat_normals", "center", "subdivide", "flip", "normalize"]);
                let e = self.expr(&T::Mesh, depth);
                E::Form(vec!["", "(", ")"], vec![free(atom(f)), Place { e, wrong: &["\"a\"", "true", "eye", "30deg"] }])
            }
            5 => self.call("merge", &[T::Mesh, T::Mesh], depth).open_ended().any_left_out(1),
            6 => self.call("triangle", &[vector(3), vector(3), vector(3)], depth),
            7 => self.call("transform", &[T::Mesh, T::Transform], depth),
            8 => self.field("", T::Shape, ".mesh", depth),
            9 => self.form_of("merge(", T::List(Box::new(T::Mesh), 2), ")", depth).loosely(),
            10 => {
                let (a, b, c) =
                    (self.expr(&vector(3), depth), self.expr(&vector(3), depth), self.expr(&vector(3), depth));
                let places = [a, b, c].map(|e| Place { e, wrong: &["\"a\"", "30deg", "[1, 2, 3, 4]", "1"] });
                self.form(&["mesh(vertices: [", ", ", ", ", "], faces: [[0, 1, 2]])"], places.into())
            }
            _ => atom("rectangle(width: 1, depth: 2)"),
        }
    }
}

const IMAGE_WRONG: &[&str] = &["\"a\"", "true", "eye", "sphere()", "30deg", "1"];
