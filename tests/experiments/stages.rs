//! Stages of an optimisation: what each moves, and what `then` declares anew where one ends.

use std::fs;

use crate::place::{Place, assert_code, assert_diagnosed, stderr, stdout};
use serde_json::Value;

#[track_caller]
fn refused(script: &str, told: &[&str]) {
    let place = Place::new();
    place.write("script.dscene", script);
    let output = place.dsl(&["check", "script.dscene"]);
    assert_diagnosed(&output);
    let text = stderr(&output);
    told.iter().for_each(|part| assert!(text.contains(part), "{part}: {text}"));
}

#[test]
fn a_param_gets_another_size_where_a_stage_ends() {
    let place = Place::new();
    let printed = place.run(
        "param row: scalar[] = [0, 5] in 0..5.5
         let wanted = 3
         loss fit = sum([(x - wanted) ^ 2 for x in row])
         optimize fit {
           using: sgd(lr: 0.25), steps: 20
           stage coarse {
             then {
               param row = [row[0], mix(row[0], row[1], 0.5), row[1]]
               let wanted = wanted + row[0]
             }
           }
           stage fine { }
         }",
    );
    assert_eq!(printed, "");
    let log = fs::read_to_string(place.path("run/log.jsonl")).unwrap();
    let lines: Vec<Value> = log.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(lines.len(), 40);
    assert_eq!(lines[19]["params"]["row"].as_array().unwrap().len(), 2);
    // The new values are those of the end of the stage; all are taken before any counts.
    let first: Vec<f64> = serde_json::from_value(lines[20]["params"]["row"].clone()).unwrap();
    assert!(first.len() == 3 && first.iter().all(|x| (x - 3.0).abs() < 1e-5), "{first:?}");
    // 3 × (5.5 − 3)² would be the bound's, 3 × 3² is what is wanted: 6 lies beyond the bound.
    let loss = lines[39]["loss"].as_f64().unwrap();
    assert!((loss - 3.0 * 0.25).abs() < 1e-4, "{loss}");
    let exported = |step: &str| {
        let output = place.dsl(&["export", "run", "--step", step]);
        assert_code(&output, 0);
        serde_json::from_slice::<Value>(&output.stdout).unwrap()["row"].as_array().unwrap().len()
    };
    assert_eq!((exported("19"), exported("20")), (2, 3));
    let output = place.dsl(&["export", "run", "--script"]);
    assert_code(&output, 0);
    let script = stdout(&output);
    assert!(
        script.contains("param row: scalar[] = [5.5, 5.5, 5.5]") && script.contains("let wanted = 5.9999"),
        "{script}"
    );
}

/// What follows sees what the last stage made, whether it took all its steps or was stopped.
#[test]
fn what_the_last_stage_declares_anew_is_seen_after_it() {
    let script = |stop: &str| {
        format!(
            "param x = 4
             let half = x / 2
             loss fit = x ^ 2
             optimize fit {{
               using: sgd(lr: 0.1), steps: 3
               stop_when: loss < {stop}
               stage only {{ then {{ param x = 10, let half = step }} }}
             }}
             print x, half"
        )
    };
    let place = Place::new();
    assert_eq!(place.run(&script("0")).trim(), "10 3");
    assert_eq!(place.run(&script("100")).trim(), "10 1");
}

/// `stop_when` ends the stage in which it holds; the next one begins, with a window of its own.
#[test]
fn what_stops_a_stage_lets_the_next_one_begin() {
    let place = Place::new();
    place.write(
        "script.dscene",
        "param x = 4
         param y = 4
         loss fit = x ^ 2 + y ^ 2
         optimize fit {
           using: sgd(lr: linear(0.25, 0.25))
           stop_when: plateau(window: 2, tolerance: 1e9)
           stage first { steps: 50, over: x, then { param y = 3 } }
           stage second { steps: 50, over: y, stop_when: loss < 1 }
           stage third { steps: 20 }
         }
         expect abs(y - 0.375 / 16) < 1e-9 and abs(x - 4 / 256) < 1e-9",
    );
    let output = place.dsl(&["run", "script.dscene", "--out", "run"]);
    assert_code(&output, 0);
    let log = fs::read_to_string(place.path("run/log.jsonl")).unwrap();
    let lines: Vec<Value> = log.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let of = |stage: &str| -> Vec<usize> { (0..lines.len()).filter(|at| lines[*at]["stage"] == *stage).collect() };
    // Any four losses are such a plateau. In the second stage y is 3, 1.5 and 0.75.
    assert_eq!(of("first"), [0, 1, 2, 3]);
    assert_eq!(of("second"), [4, 5, 6]);
    assert_eq!(of("third"), [7, 8, 9, 10]);
    assert_eq!(lines.len(), 11);
    assert!((0..11).all(|at| lines[at]["step"] == at));
    let told = stderr(&output);
    for part in [
        "`stop_when` holds: the stage `first` of `fit` ends after step 3, `second` follows",
        "`stop_when` holds: the stage `second` of `fit` ends after step 6, `third` follows",
        "`stop_when` holds: `fit` stops after step 10",
        "11 steps",
    ] {
        assert!(told.contains(part), "{part}: {told}");
    }
    // The report draws stages where they were.
    let page = fs::read_to_string(place.path("run/report.html")).unwrap();
    assert!(page.contains(r#"["first",4],["second",7],["third",27]"#));
}

/// Schedules go on to their end over the steps that are left.
#[test]
fn schedules_end_with_the_last_stage_although_one_was_stopped() {
    let place = Place::new();
    place.run(
        "param x = 4
         loss fit = x ^ 2
         optimize fit {
           using: sgd(lr: linear(0.2, 0.1))
           stage first { steps: 60, stop_when: step >= 1 }
           stage second { steps: 8 }
         }",
    );
    let log = fs::read_to_string(place.path("run/log.jsonl")).unwrap();
    let rates: Vec<f64> =
        log.lines().map(|line| serde_json::from_str::<Value>(line).unwrap()["lr"].as_f64().unwrap()).collect();
    assert_eq!(rates.len(), 10);
    // `progress` at step k of n is k / (n − 1), where n is 68 and then 10.
    let near = |at: usize, progress: f64| (rates[at] - (0.2 - 0.1 * progress)).abs() < 1e-9;
    assert!(near(1, 1.0 / 67.0) && near(2, 2.0 / 9.0) && near(9, 1.0), "{rates:?}");
}

/// A stage moves what it names; the others stand still, and what it learns of them is told to be nothing only if no stage moves them.
#[test]
fn a_stage_moves_what_it_names() {
    let place = Place::new();
    place.run(
        "param a = 1
         param b = 1
         loss fit = a ^ 2 + b ^ 2
         optimize fit {
           using: sgd(lr: 0.25)
           stage first { steps: 2, over: a }
           stage second { steps: 2, over: [b] }
           stage both { steps: 2 }
         }
         expect abs(a - 0.0625) < 1e-9 and abs(b - 0.0625) < 1e-9",
    );
    let log = fs::read_to_string(place.path("run/log.jsonl")).unwrap();
    let moved: Vec<Vec<String>> = log
        .lines()
        .map(|line| {
            serde_json::from_str::<Value>(line).unwrap()["params"].as_object().unwrap().keys().cloned().collect()
        })
        .collect();
    assert_eq!(moved, [vec!["a"], vec!["a"], vec!["b"], vec!["b"], vec!["a", "b"], vec!["a", "b"]]);
}

/// A coarse ball is fitted, subdivided and fitted again, with the preconditioner of the mesh that is there.
#[test]
fn a_mesh_is_subdivided_between_stages() {
    let place = Place::new();
    let script = "integrator direct { max_bounces: 1 }
         camera eye { position: [0, 0, 4], look_at: [0, 0, 0], fov: 40deg, film: [16, 16] }
         light sky = constant(1)
         let ball = icosphere(subdivisions: 0)
         param points = ball.vertices { precondition: laplacian(ball, lambda: 4) }
         shape blob { mesh: mesh(vertices: points, faces: ball.faces) }
         let photo = render(eye, spp: 64) with { points: 1.3 * icosphere(subdivisions: 2).vertices, ball: icosphere(subdivisions: 2) }
         loss fit = mse(render(eye, spp: 16), photo)
         print fit
         optimize fit {
           using: adam_uniform(lr: 0.05)
           stage coarse {
             steps: 15
             then {
               let ball = subdivide(mesh(vertices: points, faces: ball.faces))
               param points = subdivide(mesh(vertices: points, faces: ball.faces)).vertices
             }
           }
           stage fine { steps: 10 }
         }
         print len(points), len(ball.faces)
         expect fit < 0.01
         save blob.mesh to \"blob.obj\"";
    let printed = place.run(script);
    assert_eq!(printed.lines().nth(1), Some("42 80"), "{printed}");
    let output = place.dsl(&["export", "run", "--script"]);
    assert_diagnosed(&output);
    assert!(
        stderr(&output).contains("a script cannot hold a mesh, which a stage made of `ball`"),
        "{}",
        stderr(&output)
    );
    assert_code(&place.dsl(&["export", "run", "--format", "obj", "--out", "found"]), 0);
    assert_eq!(fs::read(place.path("found/blob.obj")).unwrap(), fs::read(place.path("run/blob.obj")).unwrap());
}

#[test]
fn what_then_cannot_declare_is_told_before_anything_runs() {
    let with = |then: &str| {
        format!(
            "param x = [1, 2, 3, 4, 5, 6]\nparam y: vec2[2] = [[1, 2], [3, 4]]\nlet ball = sphere()\nlight sun = constant(1)\n\
             loss fit = sum(x) ^ 2 + sum(y) ^ 2\noptimize fit {{ stage a {{ steps: 2, {then} }} }}\n"
        )
    };
    refused(&with("then { param z = 1 }"), &["the script declares no `z`"]);
    refused(&with("then { let x = [1] }"), &["`x` is no `let` that can be declared anew", "write `param x = …`"]);
    refused(&with("then { param fit = 1 }"), &["declare anew what it is made of"]);
    refused(&with("then { light sun = constant(2) }"), &["a `light` cannot be declared anew"]);
    refused(&with("then { param x = ball }"), &["`x` is `scalar[]`, what `then` makes of it `mesh`"]);
    refused(&with("then { param x = 3 }"), &["what `then` makes of it `scalar`"]);
    refused(&with("then { param y = [[1, 2], [3, 4], [5, 6]] }"), &["leave the number out"]);
    refused(&with("then { param y = [1, 2, 3] }"), &["what `then` makes of it `vec3`"]);
    refused(&with("then { param x = [1], param x = [2] }"), &["`x` is given twice"]);
    refused(&with("then { param x = [1] } then { param x = [2] }"), &["`then` is given twice"]);
    refused(&with("steps: 3"), &["`steps` is given twice"]);
    refused(&with("over: ball.vertices"), &["does not reach the loss"]);
    // A param does not follow what it began from.
    let place = Place::new();
    let began = with("then { let ball = cube() }").replace("param x = [1, 2, 3, 4, 5, 6]", "param x = ball.vertices");
    place.write("script.dscene", began);
    let output = place.dsl(&["check", "script.dscene"]);
    assert_code(&output, 0);
    assert!(stderr(&output).contains("`x` stays what it is when `ball`"), "{}", stderr(&output));
    // Sizes that were known of the first value are not known any more.
    let place = Place::new();
    place.write("script.dscene", with("then { param x = [1, 2] }") + "let first = x[5]\nprint first\n");
    assert_code(&place.dsl(&["check", "script.dscene"]), 0);
    let output = place.dsl(&["run", "script.dscene", "--out", "run"]);
    assert_diagnosed(&output);
    assert!(stderr(&output).contains("x[5]"), "{}", stderr(&output));
}

/// A line of the REPL may have stages that declare something anew; what follows is checked against the new sizes.
#[test]
fn the_repl_goes_on_with_what_a_stage_declared_anew() {
    let place = Place::new();
    let lines = "param row: scalar[] = [1, 2]\nloss fit = sum([x ^ 2 for x in row])\n\
        optimize fit { using: sgd(lr: 0.1), stage a { steps: 1, then { param row = [row[0], row[1], 7] } } }\n\
        len(row)\nrow[2]\n:reset\nlen(row)\n";
    let output = place.command(&["repl"]).write_stdin(lines).output().unwrap();
    let printed = stdout(&output);
    let numbers: Vec<&str> =
        printed.lines().filter(|line| line.trim().starts_with(|c: char| c.is_ascii_digit())).collect();
    assert_eq!(
        numbers.iter().map(|line| line.split_whitespace().next().unwrap()).collect::<Vec<_>>(),
        ["3", "7", "2"],
        "{printed}"
    );
}

/// A ball that is pushed to where a photograph has it, by a loss of `now` and `photo`.
fn pushed(loss: &str, settings: &str) -> String {
    format!(
        "camera eye {{ position: [0, 0, -4], look_at: [0, 0, 0], fov: 45deg, film: [16, 16] }}
         light sky = constant(1)
         param x = 0.4
         shape ball {{ mesh: sphere(radius: 0.5) |> translate([x, 0, 0]), material: diffuse(reflectance: 0.2) }}
         let photo = render(eye, spp: 16) with {{ x: -0.4 }}
         let now = render(eye, spp: 2)
         let left = stop_gradient(pixels(eye).x < 0.7) * 1
         fn mine(a: image, b: image): scalar = mse(a, b)
         let same = mse
         loss fit = {loss}
         optimize fit {{ {settings} }}"
    )
}

/// `blur` gives what the loss of blurred pictures gives, to the bit.
#[test]
fn the_blur_of_a_stage_is_that_of_both_pictures() {
    let place = Place::new();
    let losses = |loss: &str, settings: &str| {
        place.run(&pushed(loss, settings));
        let log = fs::read_to_string(place.path("run/log.jsonl")).unwrap();
        let loss = |line: &str| serde_json::from_str::<Value>(line).unwrap()["loss"].as_f64().unwrap();
        log.lines().map(loss).collect::<Vec<f64>>()
    };
    let three = "using: adam(lr: 0.02), steps: 3";
    let by_hand = losses("mse(blur(now, 2), blur(photo, 2))", three);
    let sharp = losses("mse(now, photo)", three);
    assert!(by_hand[0] < 0.7 * sharp[0], "{by_hand:?} {sharp:?}");
    for loss in ["mse(now, photo)", "mine(now, photo)", "same(now, photo)"] {
        assert_eq!(losses(loss, &format!("{three}, blur: 2")), by_hand, "{loss}");
    }
    // What a loss of the library does with its pictures is done with blurred ones, once.
    let pyramids = losses("pyramid_loss(blur(now, 2), blur(photo, 2), loss: mse)", three);
    assert_eq!(losses("pyramid_loss(now, photo, loss: mse)", &format!("{three}, blur: 2")), pyramids);
    // A stage has its own, and may have none; a schedule has one for each step.
    let stages = losses(
        "mse(now, photo)",
        "using: adam(lr: 0.02), blur: 2 stage far { steps: 2 } stage near { blur: 0, steps: 1 }",
    );
    let faded = losses("mse(now, photo)", &format!("{three}, blur: if step < 2 then 2 else 0"));
    assert_eq!(stages, faded);
    assert_eq!(stages[..2], by_hand[..2]);
    assert!(stages[2] > by_hand[2] / 0.7, "{stages:?} {by_hand:?}");
    // Pixels that count for nothing are not smeared over those that count.
    let masked = losses("mse(now, photo, weight: left)", &format!("{three}, blur: 2"));
    let dirty = losses("mse(now, photo + 100 * (1 - left), weight: left)", &format!("{three}, blur: 2"));
    assert_eq!(dirty, masked);
    let weighted = "mse(blur(now * left, 2) / (blur(left, 2) + 1e-12), blur(photo * left, 2) / (blur(left, 2) + 1e-12), weight: left)";
    assert_eq!(losses(weighted, three), masked);
}

/// Pictures that do not overlap say which way to go once they are blurred, and steps of least squares are long ones.
#[test]
fn a_blur_that_fades_finds_what_is_far_away() {
    let place = Place::new();
    let found = |settings: &str| {
        let script = pushed("mse(now, photo)", &format!("using: levenberg_marquardt(), steps: 12{settings}"));
        let script = script
            .replace("x = 0.4\n", "x = 0.6\n")
            .replace("x: -0.4", "x: -0.6")
            .replace("radius: 0.5", "radius: 0.25");
        place.run(&format!("{script}\nprint x")).trim().parse::<f64>().unwrap()
    };
    let (sharp, blurred) = (found(""), found(", blur: fade(4)"));
    assert!((blurred + 0.6).abs() < 0.05 && (sharp + 0.6).abs() > 0.2, "{blurred} {sharp}");
}

#[test]
fn a_blur_is_a_number_of_pixels() {
    refused(&pushed("mse(now, photo)", "blur: -1"), &["`blur` must be", "this is -1"]);
    refused(&pushed("mse(now, photo)", "blur: 3deg"), &["3deg"]);
    refused(
        &pushed("mse(now, photo)", "stage a { blurs: 3 }"),
        &["a stage has no field `blurs`", "did you mean `blur`?"],
    );
    let place = Place::new();
    place.write("script.dscene", pushed("mse(now, photo)", "steps: 9, blur: 3 - 2 * step * sum(noise([1]) ^ 0)"));
    let output = place.dsl(&["run", "script.dscene", "--out", "run"]);
    assert_code(&output, 1);
    assert!(
        stderr(&output).contains("`blur` must be from 0 to 10000 pixels") && stderr(&output).contains("this is -1")
    );
}
