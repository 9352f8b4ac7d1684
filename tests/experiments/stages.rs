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

/// What follows sees what the last stage made, and a loop that ends early makes nothing.
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
    assert_eq!(place.run(&script("100")).trim(), "3.2 1.6");
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
