//! The live page from outside, over plain TCP: `dsl watch` and `dsl run --live`.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{ChildStdout, Command, Stdio};
use std::time::Duration;

use serde_json::{Value, json};

use crate::browser::{self, Browser, Scheme};
use crate::live::Server;
use crate::place::{BOWL, Place, TRIANGLE, png_colors, send};

/// The brightest number of a picture.
fn brightest(png: &[u8]) -> u8 {
    assert_eq!(&png[1..4], b"PNG");
    png_colors(png).1.into_iter().flatten().max().unwrap()
}

const FAST: &[&str] = &["--spp", "4"];

fn watch(place: &Place, file: &str) -> Server {
    Server::start(place, &[&["watch", file], FAST].concat())
}

#[test]
fn an_edit_is_seen_and_an_error_keeps_the_picture() {
    let place = Place::new();
    place.write("t.dscene", TRIANGLE);
    let server = watch(&place, "t.dscene");
    let mut events = server.events();
    let first = events.until("picture", |p| p["spp"] == 4);
    assert_eq!((&first["width"], &first["height"]), (&json!(16), &json!(16)));
    events.phase("ready");
    let before = server.get("/picture").body;
    assert!(brightest(&before) > 200);

    place.write("t.dscene", TRIANGLE.replace("radiance: 1", "radiance: 0.01"));
    events.until("picture", |p| p["spp"] == 4);
    events.phase("ready");
    let dark = server.get("/picture").body;
    assert!(brightest(&dark) < 100, "{}", brightest(&dark));

    // A place, and the last good picture.
    place.write("t.dscene", TRIANGLE.replace("radiance: 1", "radiance: ?"));
    let wrong = events.until("diagnostics", |d| !d.as_array().unwrap().is_empty());
    assert_eq!(wrong[0]["severity"], "error");
    assert_eq!(wrong[0]["labels"][0]["start"]["line"], 6);
    assert!(wrong[0]["text"].as_str().unwrap().contains("radiance: ?"), "{wrong}");
    events.phase("wrong");
    assert_eq!(server.get("/picture").body, dark);

    // Deleted, back, and mended.
    std::fs::remove_file(place.path("t.dscene")).unwrap();
    events.until("diagnostics", |d| d[0]["message"].as_str().is_some_and(|m| m.contains("there is no such file")));
    place.write("t.dscene", TRIANGLE);
    events.until("diagnostics", |d| d.as_array().unwrap().is_empty());
    events.phase("ready");
    assert!(brightest(&server.get("/picture").body) > 200);
}

#[test]
fn imports_and_assets_are_watched_too() {
    let place = Place::new();
    place.write("light.dscene", "light sky = constant(radiance: 1)\n");
    let script = TRIANGLE.replace("light sky = constant(radiance: 1)", "import \"light.dscene\"");
    let script = script.replace("reflectance: glow", "reflectance: load_json(\"grey.json\") * glow");
    place.write("t.dscene", script);
    let server = watch(&place, "t.dscene");
    let mut events = server.events();
    // A file that is not there yet.
    events.until("diagnostics", |d| d[0]["message"].as_str().is_some_and(|m| m.contains("grey.json")));
    place.write("grey.json", "1");
    events.until("diagnostics", |d| d.as_array().unwrap().is_empty());
    events.phase("ready");
    let before = server.get("/picture").body;
    place.write("grey.json", "0.1");
    events.until("picture", |p| p["spp"] == 4);
    events.phase("ready");
    let darker = server.get("/picture").body;
    assert_ne!(before, darker);
    place.write("light.dscene", "light sky = constant(radiance: 0.001)\n");
    events.until("picture", |p| p["spp"] == 4);
    events.phase("ready");
    assert!(brightest(&server.get("/picture").body) < 40);
}

#[test]
fn a_script_that_is_wrong_from_the_start_is_waited_for() {
    let place = Place::new();
    place.write("t.dscene", "camera eye {");
    let server = watch(&place, "t.dscene");
    let mut events = server.events();
    events.phase("wrong");
    place.write("t.dscene", TRIANGLE);
    events.until("picture", |p| p["spp"] == 4);
}

#[test]
fn the_camera_moves_and_params_are_set() {
    let place = Place::new();
    place.write("t.dscene", format!("{TRIANGLE}\noptimize fit {{ using: adam(lr: 0.02), steps: 3 }}\n"));
    let server = watch(&place, "t.dscene");
    let mut events = server.events();
    let params = events.until("params", |_| true);
    assert_eq!(
        (&params[1]["name"], &params[1]["values"], &params[1]["high"]),
        (&json!("glow"), &json!([0.5]), &json!([1.0]))
    );
    events.phase("ready");
    let before = server.get("/picture").body;

    let pose = json!({"position": [0.0, 2.0, -4.0], "look_at": [0.0, 0.0, 0.0], "up": [0.0, 1.0, 0.0]});
    server.order(json!({"do": "view", "number": 7, "pose": pose}));
    let camera = events.until("camera", |c| c["moved"] == true);
    let line = "camera eye { position: [0, 2, -4], look_at: [0, 0, 0], fov: 45deg, film: [16, 16] }";
    assert_eq!((&camera["pose"], &camera["line"]), (&pose, &json!(line)));
    events.until("picture", |p| p["view"] == 7 && p["spp"] == 4);
    let above = server.get("/picture").body;
    assert_ne!(before, above);
    // An edit keeps the view.
    place.write("t.dscene", format!("{TRIANGLE}\nlet more = 1\n"));
    events.until("picture", |p| p["view"] == 7 && p["spp"] == 4);
    assert_eq!(server.get("/picture").body, above);
    server.order(json!({"do": "view", "number": 8, "pose": null}));
    events.until("picture", |p| p["view"] == 8 && p["spp"] == 4);
    assert_eq!(server.get("/picture").body, before);

    // Within its bounds, and back.
    server.order(json!({"do": "set", "name": "glow", "values": [0.9]}));
    events.until("params", |p| p[1]["values"] == json!([0.9]));
    events.until("picture", |p| p["spp"] == 4);
    assert_ne!(server.get("/picture").body, before);
    server.order(json!({"do": "set", "name": "glow", "values": [1.5]}));
    events.until("diagnostics", |d| d[0]["message"] == "`glow` stays within 0..1");
    server.order(json!({"do": "set", "name": "glow", "values": [0.1, 0.2]}));
    events.until("diagnostics", |d| d[0]["message"] == "these are not the numbers of `glow`");
    server.order(json!({"do": "reset"}));
    events.until("params", |p| p[1]["values"] == json!([0.5]));

    // The derivative with respect to the height of the third corner.
    server.order(json!({"do": "derivative", "name": "corners", "element": 7}));
    let told = events.until("derivative", |d| d["param"] == "corners");
    assert!(told["limit"].as_f64().unwrap() > 0.0, "{told}");
    // It covers more of a sky that is brighter than the panel: less light, which is blue.
    let (_, change) = png_colors(&server.get("/derivative").body);
    let blue = change.iter().filter(|c| c[2] > c[0].saturating_add(60)).count();
    let red = change.iter().filter(|c| c[0] > c[2].saturating_add(60)).count();
    assert!(blue >= 3 && blue > 2 * red, "{blue} {red}");
    server.order(json!({"do": "derivative", "name": null, "element": 0}));
    events.until("derivative", Value::is_null);
}

/// Sliders end where bounds are, on either side.
#[test]
fn bounds_of_one_side_are_told() {
    let place = Place::new();
    let more = "param far = 2 in 1..\nparam turn: angle = 3deg in ..90deg\nparam dim: vec2 = [0, 1] in 0..[1, 2]";
    place.write("t.dscene", format!("{TRIANGLE}\n{more}\n"));
    let server = watch(&place, "t.dscene");
    let params = server.events().until("params", |_| true);
    let bounds = |name: &str| {
        let param = params.as_array().unwrap().iter().find(|p| p["name"] == name).unwrap();
        json!([param["low"], param["high"]])
    };
    assert_eq!(bounds("far"), json!([[1.0], [null]]));
    assert_eq!(bounds("turn"), json!([[null], [90.0]]));
    assert_eq!(bounds("dim"), json!([[0.0, 0.0], [1.0, 2.0]]));
}

#[test]
fn an_optimisation_is_followed_paused_and_stopped() {
    let place = Place::new();
    let script = format!(
        "{TRIANGLE}\noptimize fit {{ using: adam(lr: 0.001), steps: 100000\n every 1 {{ save 1 to \"x.json\" }} }}\n"
    );
    place.write("t.dscene", &script);
    let server = watch(&place, "t.dscene");
    let mut events = server.events();
    assert_eq!(events.until("optimizations", |_| true), json!(["fit"]));
    events.phase("ready");
    server.order(json!({"do": "start", "index": 0}));
    events.until("optimization", |o| o["done"].as_u64() > Some(3));
    // A picture from elsewhere while it goes on.
    let pose = json!({"position": [0.0, 2.0, -4.0], "look_at": [0.0, 0.0, 0.0], "up": [0.0, 1.0, 0.0]});
    server.order(json!({"do": "view", "number": 1, "pose": pose}));
    events.until("picture", |p| p["view"] == 1);
    server.order(json!({"do": "pause"}));
    events.phase("paused");
    events.until("picture", |p| p["spp"] == 4);
    server.order(json!({"do": "step"}));
    let stepped = events.until("optimization", |_| true)["done"].as_u64().unwrap();
    events.phase("paused");
    server.order(json!({"do": "step"}));
    events.until("optimization", |o| o["done"] == stepped + 1);
    server.order(json!({"do": "resume"}));
    events.until("optimization", |o| o["done"].as_u64() > Some(stepped + 5));
    server.order(json!({"do": "stop"}));
    events.phase("ready");
    // An edit ends it as well.
    server.order(json!({"do": "start", "index": 0}));
    events.phase("optimising");
    place.write("t.dscene", script.replace("steps: 100000", "steps: 2"));
    events.phase("ready");
    server.order(json!({"do": "start", "index": 0}));
    let end = events.until("optimization", |o| o["done"] == 2);
    assert_eq!((&end["total"], end["losses"].as_array().unwrap().len()), (&json!(2), 2));
    events.phase("ready");
    assert!(!place.path("x.json").exists());
}

/// A long step is given up for a look, and taken again after it: nobody waits for its end.
#[test]
fn a_long_step_keeps_no_page_waiting() {
    let place = Place::new();
    let long = TRIANGLE.replace("[16, 16]", "[32, 32]").replace("spp: 2)", "spp: 600)");
    place.write("t.dscene", format!("{long}\noptimize fit {{ using: adam(lr: 0.001), steps: 100000 }}\n"));
    let server = watch(&place, "t.dscene");
    let mut events = server.events();
    events.phase("ready");
    server.order(json!({"do": "start", "index": 0}));
    let mut done = events.until("optimization", |o| o["done"].as_u64() > Some(0))["done"].clone();
    // An order that comes at the end of a step gives up none: one of some does not.
    let mut look = |number: u64| {
        let pose = json!({"position": [0.0, 2.0, -4.0], "look_at": [0.0, 0.0, 0.0], "up": [0.0, 1.0, 0.0]});
        server.order(json!({"do": "view", "number": number, "pose": pose}));
        let before = done.clone();
        loop {
            let (topic, told) = events.next().unwrap();
            match topic.as_str() {
                "optimization" => done = told["done"].clone(),
                "picture" if told["view"] == number => return done == before,
                _ => {}
            }
        }
    };
    assert!((1..6).any(&mut look));
    server.order(json!({"do": "stop"}));
    events.phase("ready");
}

/// Examples look at things from all sides by a list of cameras.
#[test]
fn cameras_in_a_list_are_looked_through_and_chosen() {
    let place = Place::new();
    let list = "let eyes = [camera(position: [0, 0, -4 - 9 * k], look_at: [0, 0, 0], fov: 45deg, film: [16, 16]) for k in 0..2]\n";
    let camera = TRIANGLE.lines().find(|line| line.starts_with("camera eye")).unwrap();
    place.write("t.dscene", TRIANGLE.replace(camera, list).replace("render(eye", "render(eyes[0]"));
    let server = watch(&place, "t.dscene");
    let mut events = server.events();
    let camera = events.until("camera", |_| true);
    assert_eq!((&camera["names"], &camera["name"]), (&json!(["eyes[0]", "eyes[1]"]), &json!("eyes[0]")));
    assert_eq!(camera["movable"], true);
    assert!(camera["line"].as_str().unwrap().starts_with("camera(position: [0, 0, -4]"), "{camera}");
    events.until("picture", |p| p["spp"] == 4);
    events.phase("ready");
    let near = server.get("/picture").body;
    server.order(json!({"do": "camera", "name": "eyes[1]"}));
    events.until("camera", |camera| camera["name"] == "eyes[1]");
    events.until("picture", |p| p["spp"] == 4);
    let far = server.get("/picture").body;
    assert!(brightest(&near) > 200 && near != far);
    // Moved to where the first one stands, the second sees what that one does, from the same samples.
    let pose = json!({"position": [0.0, 0.0, -4.0], "look_at": [0.0, 0.0, 0.0], "up": [0.0, 1.0, 0.0]});
    server.order(json!({"do": "view", "number": 7, "pose": pose}));
    events.until("camera", |camera| camera["moved"] == true);
    events.until("picture", |p| p["view"] == 7 && p["spp"] == 4);
    assert!(server.get("/picture").body == near);
    server.order(json!({"do": "derivative", "name": "glow", "element": 0}));
    events.until("derivative", |d| d["param"] == "glow");
}

#[test]
fn a_script_without_a_camera_has_no_picture_and_no_errors() {
    let place = Place::new();
    place.write("t.dscene", BOWL);
    let server = watch(&place, "t.dscene");
    let mut events = server.events();
    let mut seen = Vec::new();
    while !seen.contains(&("phase".to_owned(), json!("ready"))) {
        seen.extend(events.next());
    }
    server.order(json!({"do": "start", "index": 0}));
    while seen.last().is_none_or(|(_, told)| told["done"] != 60) {
        seen.extend(events.next());
    }
    assert!(seen.contains(&("camera".to_owned(), Value::Null)), "{seen:?}");
    assert!(seen.iter().all(|(topic, told)| topic != "diagnostics" || *told == json!([])), "{seen:?}");
}

#[test]
fn without_the_token_there_is_nothing() {
    let place = Place::new();
    place.write("t.dscene", TRIANGLE);
    let server = watch(&place, "t.dscene");
    let page = server.get("/");
    assert_eq!(page.status, 200);
    assert!(
        page.head.contains("frame-ancestors 'none'") && !page.head.to_lowercase().contains("access-control"),
        "{}",
        page.head
    );
    for path in ["/page.css", "/page.js", "/view.js"] {
        assert_eq!(server.get(path).status, 200, "{path}");
    }
    let host = server.host();
    let (root, other) = (server.root.clone(), format!("/{}", "0".repeat(32)));
    let request = |line: &str, headers: &str| server.raw(format!("{line} HTTP/1.1\r\n{headers}\r\n").as_bytes());
    for (line, headers, status) in [
        ("GET /".to_owned(), host.clone(), 403),
        (format!("GET {other}/"), host.clone(), 403),
        (format!("GET {}/", &root[..root.len() - 1]), host.clone(), 403),
        (format!("GET {other}/events"), host.clone(), 403),
        (format!("POST {other}/do"), host.clone(), 403),
        (format!("GET {root}/"), "Host: evil.example\r\n".to_owned(), 403),
        (format!("GET {root}/"), String::new(), 403),
        (format!("GET {root}/"), format!("{host}Origin: http://evil.example\r\n"), 403),
        (format!("GET {root}/none"), host.clone(), 404),
        (format!("GET {root}/../../etc/passwd"), host.clone(), 404),
        (format!("DELETE {root}/"), host.clone(), 405),
        (format!("POST {root}/do"), host.clone(), 415),
        (format!("POST {root}/do"), format!("{host}Content-Type: application/json\r\n"), 411),
        (
            format!("POST {root}/do"),
            format!("{host}Content-Type: application/json\r\nContent-Length: 99999999\r\n"),
            413,
        ),
        (
            format!("POST {root}/do"),
            format!("{host}Content-Type: application/json\r\nContent-Length: 2\r\n\r\n{{}}"),
            400,
        ),
        (format!("GET /{}", "x".repeat(1 << 20)), host.clone(), 431),
        ("nonsense".to_owned(), String::new(), 400),
    ] {
        let answer = request(&line, &headers);
        let line = &line[..line.len().min(60)];
        assert_eq!((answer.status, answer.body.len()), (status, 0), "{line} {headers}");
    }
    // Nobody else may read it, and it still works.
    assert_eq!(server.get("/").status, 200);
}

#[test]
fn clients_that_do_nothing_hold_nothing_up() {
    let place = Place::new();
    place.write("t.dscene", TRIANGLE);
    let server = watch(&place, "t.dscene");
    // One begins a request, one listens and reads nothing, one goes away in the middle.
    let mut slow = server.connect();
    slow.write_all(b"GET /").unwrap();
    let deaf = server.events();
    drop(server.events());
    let mut events = server.events();
    for i in 0..5 {
        place.write("t.dscene", format!("{TRIANGLE}\nlet n = {i}\n"));
        events.until("picture", |p| p["spp"] == 4);
        events.phase("ready");
    }
    // The one that never ends its request is answered so in the end.
    let mut rest = Vec::new();
    slow.read_to_end(&mut rest).unwrap();
    assert!(String::from_utf8_lossy(&rest).starts_with("HTTP/1.1 408"), "{}", String::from_utf8_lossy(&rest));
    drop(deaf);
}

#[test]
fn a_port_that_is_taken_is_passed_over() {
    // Two neighbouring ports of which the first is taken.
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port();
    let place = Place::new();
    place.write("t.dscene", TRIANGLE);
    let server = Server::start(&place, &["watch", "t.dscene", "--port", &port.to_string()]);
    assert!(server.port > port, "{} {port}", server.port);
    assert_eq!(server.get("/").status, 200);
    // It listens on this machine's own address only.
    assert!(
        TcpStream::connect_timeout(&format!("127.0.0.2:{}", server.port).parse().unwrap(), Duration::from_secs(1))
            .is_err()
    );
}

#[test]
fn control_c_ends_it() {
    let place = Place::new();
    place.write("t.dscene", TRIANGLE);
    let mut server = watch(&place, "t.dscene");
    server.events().phase("ready");
    assert!(send(&server.child, "-INT"));
    assert_eq!(server.child.wait().unwrap().code(), Some(130));
}

/// The last picture is fetched after the run has ended: nobody is cut off in the middle of a question, or waited for forever.
#[test]
fn the_end_waits_for_pages_to_say_goodbye() {
    let place = Place::new();
    place.write("t.dscene", format!("{TRIANGLE}\noptimize fit {{ using: adam(lr: 0.001), steps: 100000 }}\n"));
    let start = |out: &str| Server::start(&place, &["run", "t.dscene", "--out", out, "--live"]);
    let mut server = start("a");
    let mut events = server.events();
    events.until("picture", |_| true);
    server.order(json!({"do": "stop"}));
    events.until("end", |_| true);
    for path in ["/picture", "/"] {
        assert_eq!(server.get(path).status, 200, "{path}");
    }
    assert_eq!(server.child.try_wait().unwrap(), None);
    drop(events);
    assert_eq!(server.child.wait().unwrap().code(), Some(130));
    // One that neither reads on nor leaves.
    let mut server = start("b");
    let mut deaf = server.events();
    deaf.until("picture", |_| true);
    server.order(json!({"do": "stop"}));
    assert_eq!(server.child.wait().unwrap().code(), Some(130));
}

/// The log without what is measured.
fn results(place: &Place, run: &str) -> Vec<Value> {
    let text = std::fs::read_to_string(place.path(run).join("log.jsonl")).unwrap();
    let line = |line: &str| {
        let mut value: Value = serde_json::from_str(line).unwrap();
        for measured in ["seconds", "phases", "bytes"] {
            value.as_object_mut().unwrap().remove(measured);
        }
        value
    };
    text.lines().map(line).collect()
}

#[test]
fn a_run_that_is_looked_at_is_the_same_run() {
    let place = Place::new();
    let steps = "optimize fit { using: adam(lr: 0.02)\n steps: 24\n every 8 { save render(eye, spp: 2) to \"{step}.exr\" } }\n\
                 save corners to \"corners.json\"\n";
    place.write("t.dscene", format!("{TRIANGLE}\n{steps}"));
    assert!(place.dsl(&["run", "t.dscene", "--out", "alone"]).status.success());
    let mut server = Server::start(&place, &["run", "t.dscene", "--out", "seen", "--live"]);
    let mut events = server.events();
    let pose = |y: f64| json!({"position": [0.0, y, -4.0], "look_at": [0.0, 0.0, 0.0], "up": [0.0, 1.0, 0.0]});
    events.until("optimization", |_| true);
    server.order(json!({"do": "pause"}));
    events.phase("paused");
    for i in 0..8 {
        server.order(json!({"do": "view", "number": i, "pose": pose(f64::from(i as u32))}));
        server.order(json!({"do": "step"}));
    }
    // Nothing that would change its results.
    for ignored in [
        json!({"do": "set", "name": "glow", "values": [0.9]}),
        json!({"do": "reset"}),
        json!({"do": "start", "index": 0}),
    ] {
        server.order(ignored);
    }
    server.order(json!({"do": "derivative", "name": "glow", "element": 0}));
    events.until("derivative", |d| d["param"] == "glow");
    server.order(json!({"do": "resume"}));
    events.phase("finished");
    while events.next().is_some() {}
    assert_eq!(server.child.wait().unwrap().code(), Some(0));
    let (alone, seen) = (results(&place, "alone"), results(&place, "seen"));
    for (a, b) in alone.iter().zip(&seen) {
        assert_eq!(a, b);
    }
    assert_eq!(alone.len(), seen.len());
    for file in ["corners.json", "8.exr", "16.exr"] {
        let read = |run: &str| std::fs::read(place.path(run).join(file)).unwrap();
        assert_eq!(read("alone"), read("seen"), "{file}");
    }
}

#[test]
fn a_run_that_the_page_stops_goes_on_later() {
    let place = Place::new();
    place.write("t.dscene", BOWL.replace("steps: 60", "steps: 100000"));
    let mut server = Server::start(&place, &["run", "t.dscene", "--out", "r", "--live"]);
    let mut events = server.events();
    events.until("optimization", |_| true);
    server.order(json!({"do": "stop"}));
    events.phase("stopped");
    drop(events);
    assert_eq!(server.child.wait().unwrap().code(), Some(130));
    let mut rest = String::new();
    server.out.read_to_string(&mut rest).unwrap();
    assert!(place.path("r/checkpoint.bin").exists() && !rest.contains("x is"), "{rest}");
}

/// The page in a browser, with its mouse and its buttons.
#[test]
fn the_page_shows_turns_sets_and_follows() {
    let Some(mut browser) = Browser::wanted() else { return };
    let place = Place::new();
    let script = TRIANGLE.replace("film: [16, 16]", "film: [96, 64]");
    let script = format!("{script}\noptimize fit {{ using: adam(lr: 0.001), steps: 100000 }}\n");
    for (width, scheme) in [(1280, Scheme::Light), (1280, Scheme::Dark), (390, Scheme::Light), (390, Scheme::Dark)] {
        place.write("t.dscene", &script);
        let server = watch(&place, "t.dscene");
        let address = format!("http://127.0.0.1:{}{}/", server.port, server.root);
        let mut page = browser.open(&address, (width, 900), scheme);
        let shot = |page: &mut browser::Page, name: &str| {
            if let Some(folder) = std::env::var_os("DSCENE_SCREENSHOTS") {
                let file = format!("live-{name}-{width}-{scheme:?}.png").to_lowercase();
                page.screenshot(&std::path::Path::new(&folder).join(file));
            }
        };
        page.wait_for("document.querySelector('#phase').textContent === 'ready'");
        page.wait_for("document.querySelector('#picture').naturalWidth === 96");
        assert_eq!(page.number("document.querySelectorAll('.param').length"), 2.0);
        shot(&mut page, "ready");

        // Turned with the mouse: the line says where it is now.
        let line = "document.querySelector('#line').textContent";
        let before = page.text(line);
        page.eval("document.querySelector('#picture').scrollIntoView({ block: 'center' })");
        let frame = page.eval("(({ x, y, width, height }) => [x + width / 2, y + height / 2])(document.querySelector('#frame').getBoundingClientRect())");
        let (x, y) = (frame[0].as_f64().unwrap(), frame[1].as_f64().unwrap());
        page.mouse("mousePressed", x, y);
        page.mouse("mouseMoved", x + 40.0, y + 20.0);
        page.mouse("mouseReleased", x + 40.0, y + 20.0);
        page.wait_for(&format!("{line} !== {before:?} && {line}.startsWith('camera eye {{ position: [')"));
        page.click("#back");
        page.wait_for(&format!("{line} === {before:?}"));

        // A param, and the derivative of the picture with respect to it.
        page.eval("(() => { const r = document.querySelector('[data-param=glow] input[type=range]'); r.value = 0.9; r.dispatchEvent(new Event('input')); })()");
        page.wait_for("document.querySelector('[data-param=glow] input[type=number]').value === '0.9'");
        page.click("[data-param=glow] button");
        page.wait_for("document.querySelector('#derivative').naturalWidth === 96");
        page.wait_for("document.querySelector('#most').textContent.startsWith('+')");
        shot(&mut page, "derivative");
        page.click("#close-change");
        page.wait_for("document.querySelector('#change').hidden");

        // An optimisation, which does not keep the page from answering.
        page.click("#start");
        page.wait_for("document.querySelector('#phase').textContent === 'optimising'");
        page.wait_for("document.querySelector('#losses').getAttribute('points').split(' ').length > 5");
        page.wait_for("document.querySelector('#curve').getBoundingClientRect().height > 50");
        page.click("#pause");
        page.wait_for("document.querySelector('#phase').textContent === 'paused'");
        let steps = "document.querySelector('#steps').textContent.split(' of ')[0]";
        let before = page.text(steps);
        page.click("#step");
        page.wait_for(&format!("{steps} !== {before:?} && document.querySelector('#phase').textContent === 'paused'"));
        shot(&mut page, "paused");
        page.click("#stop");
        page.wait_for("document.querySelector('#phase').textContent === 'ready'");

        // What is wrong, with its place; the picture stays.
        place.write("t.dscene", script.replace("radiance: 1", "radiance: one"));
        page.wait_for("!document.querySelector('#wrong').hidden");
        let told = page.text("document.querySelector('#wrong h3').textContent");
        assert!(told.starts_with("t.dscene:6:") && told.contains("one"), "{told}");
        assert_eq!(page.number("document.querySelector('#picture').naturalWidth"), 96.0);
        shot(&mut page, "wrong");

        assert_eq!(page.errors(), Vec::<String>::new(), "{width} {scheme:?}");
        assert_eq!(page.overflow(), 0.0, "{width} {scheme:?}");
        let elsewhere: Vec<String> = page.requests().into_iter().filter(|url| !url.starts_with(&address)).collect();
        assert_eq!(elsewhere, Vec::<String>::new());
    }
}

/// A run is followed, and stopped, and not changed; what sees nothing has no picture.
#[test]
fn the_page_follows_a_run() {
    let Some(mut browser) = Browser::wanted() else { return };
    let place = Place::new();
    // More numbers than there are sliders for.
    let many = |script: &str, loss: &str| {
        let more = format!("param many = [0.1 * i for i in 0..100]\nloss {loss} = 0 * sum(many) + ");
        script.replace(&format!("loss {loss} = "), &more)
    };
    let seen = format!("{}\noptimize fit {{ using: adam(lr: 0.001), steps: 100000 }}\n", many(TRIANGLE, "fit"));
    place.write("seen.dscene", seen);
    place.write("blind.dscene", many(BOWL, "bowl").replace("steps: 60", "steps: 1000000"));
    for (file, (width, scheme)) in [
        ("seen", (390, Scheme::Light)),
        ("seen", (1280, Scheme::Dark)),
        ("blind", (390, Scheme::Dark)),
        ("blind", (1280, Scheme::Light)),
    ] {
        let out = format!("{file}-{width}");
        let mut server = Server::start(&place, &["run", &format!("{file}.dscene"), "--out", &out, "--live"]);
        let mut page = browser.open(&format!("http://127.0.0.1:{}{}/", server.port, server.root), (width, 900), scheme);
        page.wait_for("document.querySelector('#phase').textContent === 'optimising'");
        page.wait_for("document.querySelector('#curve').getBoundingClientRect().height > 50");
        let is_shown = |page: &mut browser::Page, selector: &str| {
            page.number(&format!("document.querySelector({selector:?}).getClientRects().length")) > 0.0
        };
        if file == "seen" {
            page.wait_for("document.querySelector('#picture').naturalWidth === 16");
        }
        assert_eq!(is_shown(&mut page, "#stage"), file == "seen");
        // Where there is no picture, or no slider, the page says why.
        assert_eq!(is_shown(&mut page, "#unseen"), file != "seen");
        let told = page.text("document.querySelector('[data-param=many]').innerText");
        assert!(told.contains("100 numbers have no sliders"), "{told}");
        assert_eq!((told.contains("first 3 of 100"), is_shown(&mut page, ".pick")), (file == "seen", file == "seen"));
        assert!(!is_shown(&mut page, "#start") && !is_shown(&mut page, "#reset") && is_shown(&mut page, "#unknowns"));
        assert_eq!(page.number("document.querySelectorAll('.param input:enabled').length"), 0.0);
        page.click("#pause");
        page.wait_for("document.querySelector('#phase').textContent === 'paused'");
        if let Some(folder) = std::env::var_os("DSCENE_SCREENSHOTS") {
            page.screenshot(
                &std::path::Path::new(&folder).join(format!("live-run-{out}-{scheme:?}.png").to_lowercase()),
            );
        }
        page.click("#stop");
        page.wait_for("document.querySelector('#phase').textContent === 'stopped'");
        assert_eq!(server.child.wait().unwrap().code(), Some(130));
        page.wait_for("document.querySelector('#phase').textContent === 'stopped'");
        assert_eq!(page.errors(), Vec::<String>::new());
        assert_eq!(page.overflow(), 0.0);
    }
}

/// `:watch` of the REPL: params that the page moves are the session's.
#[test]
fn the_repl_takes_up_what_its_page_has_moved() {
    let place = Place::new();
    place.write("t.dscene", TRIANGLE);
    let mut child = Command::new(assert_cmd::cargo::cargo_bin!("dsl"))
        .args(["repl", "t.dscene", "--threads", "2", "--quiet"])
        .current_dir(place.path(""))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut to = child.stdin.take().unwrap();
    let mut out = BufReader::new(child.stdout.take().unwrap());
    let answer = |out: &mut BufReader<ChildStdout>| {
        let mut line = String::new();
        out.read_line(&mut line).unwrap();
        line.trim_end().to_owned()
    };
    writeln!(to, "glow / 2\n:watch eye").unwrap();
    assert_eq!(answer(&mut out), "0.25   : scalar");
    let mut server = Server::of(child, out);
    let mut events = server.events();
    events.until("picture", |picture| picture["width"] == 16);
    server.order(json!({ "do": "set", "name": "glow", "values": [0.75] }));
    events.until("params", |params| params.to_string().contains("0.75"));
    drop(events);
    assert!(send(&server.child, "-INT"));
    writeln!(to, "glow / 2\n:undo\nglow / 2").unwrap();
    assert_eq!([answer(&mut server.out), answer(&mut server.out)], ["0.375   : scalar", "0.25   : scalar"]);
    // The page can be shown again, and by nothing but a camera.
    writeln!(to, ":watch nobody\n:watch").unwrap();
    assert!(answer(&mut server.out).starts_with("live at http://127.0.0.1:"));
    drop(to);
    assert!(send(&server.child, "-INT"));
    assert_eq!(server.child.wait().unwrap().code(), Some(1));
}
