//! Sweeps: many runs of one script, killed and shared, make one table.
#![cfg(unix)]

use std::fs;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::place::{Place, TRIANGLE, assert_code, assert_diagnosed, send, stderr, stdout};

/// A noisy problem with a sweep of twelve runs.
fn triangle() -> String {
    let small = TRIANGLE.replace("[16, 16]", "[8, 8]");
    format!(
        "{small}
         sweep lr in [0.01, 0.02, 0.05, 0.1], seed in 0..3 {{
           optimize fit {{ using: adam(lr: lr), steps: 12 }}
           save glow to \"glow.json\"
           report {{ error: abs(glow - 0.8), fit }}
         }}"
    )
}

/// A quick one without noise.
const VALLEY: &str = "
param x = start
let start = 3
let rate = 0.1
loss valley = (x - 1) ^ 2
optimize valley { using: sgd(lr: rate), steps: 20 }
";

fn lines(place: &Place, folder: &str, event: &str) -> Vec<Value> {
    let text = fs::read_to_string(place.path(folder).join("journal.jsonl")).unwrap_or_default();
    let lines = text.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    lines.filter(|line| line["event"] == event).collect()
}

fn table(place: &Place, folder: &str) -> [String; 2] {
    ["table.csv", "table.json"].map(|name| fs::read_to_string(place.path(folder).join(name)).unwrap())
}

fn wait_for(what: &str, mut is_there: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !is_there() {
        assert!(begun.elapsed() < Duration::from_secs(60), "{what} takes too long");
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn a_sweep_that_is_killed_twice_gives_the_table_of_an_undisturbed_one() {
    let place = Place::new();
    place.write("a.dscene", triangle());
    let whole = place.dsl(&["run", "a.dscene", "--out", "whole", "--quiet"]);
    assert_code(&whole, 0);
    assert_eq!(stdout(&whole).lines().count(), 5, "{}", stdout(&whole));
    let command = ["sweep", "a.dscene", "--out", "killed", "--jobs", "2", "--threads", "2", "--checkpoint", "1"];
    for (ended, signal) in [(2, "-KILL"), (6, "-KILL"), (8, "-TERM")] {
        let child = place.start(&command);
        wait_for("the sweep", || lines(&place, "killed", "ended").len() >= ended);
        // Both runs that go on are half-way.
        std::thread::sleep(Duration::from_millis(30));
        assert!(send(&child, signal));
        let output = child.wait_with_output().unwrap();
        if signal == "-TERM" {
            assert_code(&output, 130);
            assert!(stderr(&output).contains("it goes on with the same command"), "{}", stderr(&output));
        }
    }
    assert!(lines(&place, "killed", "ended").len() < 12, "nothing was left to do");
    assert_code(&place.dsl(&command), 0);
    assert_eq!(table(&place, "killed"), table(&place, "whole"));
    for line in lines(&place, "killed", "ended") {
        let saved = |folder: &str| fs::read(place.path(folder).join(line["run"].as_str().unwrap()).join("glow.json"));
        assert_eq!(saved("killed").unwrap(), saved("whole").unwrap());
    }
    // What has finished is not run again, and says the same by another way of asking.
    let begun = lines(&place, "killed", "begun").len();
    let again = place.dsl(&["run", "a.dscene", "--resume", "killed", "--json"]);
    assert_code(&again, 0);
    assert_eq!(lines(&place, "killed", "begun").len(), begun);
    let done: Value = serde_json::from_str(stdout(&again).trim()).unwrap();
    assert_eq!(done["table"], serde_json::from_str::<Value>(&table(&place, "whole")[1]).unwrap());
}

#[test]
fn two_shards_make_the_table_of_one() {
    let place = Place::new();
    place.write("a.dscene", triangle());
    let shared = ["sweep", "a.dscene", "--steps", "4", "--quiet", "--threads", "1"];
    assert_code(&place.dsl(&[&shared[..], &["--out", "whole"]].concat()), 0);
    let shards =
        ["1/2", "2/2"].map(|shard| place.start(&[&shared[..], &["--out", "parts", "--shard", shard]].concat()));
    for shard in shards {
        assert_code(&shard.wait_with_output().unwrap(), 0);
    }
    assert_eq!(table(&place, "parts"), table(&place, "whole"));
    assert_eq!(lines(&place, "parts", "ended").len(), 12);
    // A single one says what is left to others.
    let alone = place.dsl(&["sweep", "a.dscene", "--steps", "4", "--out", "half", "--shard", "2/2"]);
    assert_code(&alone, 0);
    assert!(stderr(&alone).contains("6 runs are left"), "{}", stderr(&alone));
}

#[test]
fn any_script_is_swept_over_from_the_command_line() {
    let place = Place::new();
    place.write("a.dscene", VALLEY);
    let sweep = |more: &[&str]| place.dsl(&[&["sweep", "a.dscene", "--quiet"][..], more].concat());
    let output = sweep(&["--set", "rate=0.1,0.4", "--set", "start=2..4", "--seeds", "2", "--jobs", "3"]);
    assert_code(&output, 0);
    let csv = table(&place, "runs/a-sweep")[0].clone();
    let head =
        "rate,start,runs_finished,runs_diverged,runs_pruned,runs_error,valley,valley_error,seconds,seconds_error";
    let rows: Vec<&str> = csv.lines().collect();
    assert_eq!((rows.len(), rows[0]), (5, head), "{csv}");
    assert!(rows[1].starts_with("0.1,2,2,0,0,0,0.0001329") && rows[4].starts_with("0.4,3,2,0,0,0,"), "{csv}");
    assert!(place.path("runs/a-sweep/rate=0.4,start=3,seed=1/checkpoint.bin").is_file());
    // More of it only runs what is new.
    assert_code(&sweep(&["--set", "rate=0.1,0.4", "--set", "start=2..5", "--seeds", "3"]), 0);
    assert_eq!(lines(&place, "runs/a-sweep", "begun").len(), 18);
    // A list in words, and values that are lists.
    assert_code(&sweep(&["--out", "b", "--set", "rate=0.1 * 2^-k for k in 0..3"]), 0);
    assert!(
        place.path("b/rate=0.025,seed=0").is_dir(),
        "{:?}",
        fs::read_dir(place.path("b")).unwrap().flatten().collect::<Vec<_>>()
    );
    // What nothing depends on has no rows of its own.
    place.write("u.dscene", "let idle = 20deg\nprint 1\n");
    let output = place.dsl(&["sweep", "u.dscene", "--set", "idle=10deg,20deg", "--out", "u"]);
    assert_code(&output, 1);
    assert!(stderr(&output).contains("nothing that a run does depends on `idle`"), "{}", stderr(&output));
    assert_code(&place.dsl(&["sweep", "u.dscene", "--set", "idle=10deg", "--out", "u"]), 0);
    place.write("c.dscene", TRIANGLE.to_owned() + "print mean(render(eye))");
    let output = place.dsl(&["sweep", "c.dscene", "--set", "eye.film=[4, 4],[8, 8]", "--quiet"]);
    assert_code(&output, 0);
    assert_eq!(
        stdout(&output).matches("eye.film=[").count() + stdout(&output).matches("eye.film=_").count(),
        2,
        "{}",
        stdout(&output)
    );
}

#[test]
fn where_more_is_better_the_largest_mean_is_marked() {
    let place = Place::new();
    let report = "report { gap: (x - 1) ^ 2, likeness: maximize(-(x - 1) ^ 2), unlikeness: -(x - 1) ^ 2 }";
    let actions = "optimize valley { using: sgd(lr: rate), steps: 20 }";
    let swept = format!("sweep rate in [0.01, 0.1] {{ {actions} {report} }}");
    place.write("valley.dscene", VALLEY.replace("let rate = 0.1\n", "").replace(actions, &swept));
    assert_code(&place.dsl(&["run", "valley.dscene", "--out", "s"]), 0);
    let table: Value = serde_json::from_str(&table(&place, "s")[1]).unwrap();
    assert_eq!(table["best"], serde_json::json!({ "gap": 1, "likeness": 1, "unlikeness": 0 }));
}

#[test]
fn what_is_wrong_is_told_before_anything_runs() {
    let place = Place::new();
    place.write("a.dscene", VALLEY);
    place.write("b.dscene", triangle());
    let cases: &[(&str, &[&str], &str)] = &[
        ("a.dscene", &["--set", "rat=0.1,0.2"], "did you mean `rate`?"),
        ("a.dscene", &["--set", "rate=0.1,\"fast\""], "dscene::"),
        ("a.dscene", &["--set", "rate=3..3"], "there is nothing to sweep over"),
        ("a.dscene", &["--set", "rate=0.1,,0.2"], "dscene::syntax"),
        ("a.dscene", &["--set", "rate=0.1", "--set", "rate=0.2"], "`--set rate=A,B`"),
        ("a.dscene", &["--set", "seed=1,2"], "`--seeds 5`"),
        ("a.dscene", &["--set", "start=0..2000", "--seeds", "1000"], "more than 100,000 runs"),
        ("a.dscene", &["--memory", "200MB", "--jobs", "8"], "a run needs 50 MB"),
        ("b.dscene", &["--seed", "7"], "`--seeds 1 --seed 7`"),
        ("b.dscene", &["--set", "lr=0.1,eye"], "dscene::"),
        ("none.dscene", &[], "there is no such file"),
        ("a.dscene", &["--resume", "nowhere"], "is not the folder of a sweep"),
    ];
    for (file, arguments, told) in cases {
        let output = place.dsl(&[&["sweep", file, "--out", "out"][..], arguments].concat());
        let output = if arguments.contains(&"--resume") {
            place.dsl(&[&["sweep", file][..], arguments].concat())
        } else {
            output
        };
        assert_diagnosed(&output);
        assert!(stderr(&output).contains(told), "{arguments:?}: {}", stderr(&output));
        assert!(lines(&place, "out", "begun").is_empty(), "{arguments:?}");
    }
    for wrong in [&["--shard", "3/2"][..], &["--seeds", "0"], &["--jobs", "0"]] {
        assert_code(&place.dsl(&[&["sweep", "a.dscene"][..], wrong].concat()), 2);
    }
}

#[test]
fn what_the_script_reads_is_not_replaced() {
    let place = Place::new();
    fs::create_dir(place.path("sub")).unwrap();
    let table = "let v = mean(load_table(\"sub/table.csv\").x)";
    let of_json = |name: &str| format!("let v = load_json(\"sub/{name}\").x");
    let cases = [
        ("table.csv", "x\n1\n3\n", table.to_owned()),
        ("table.json", "{\"x\": 2}", of_json("table.json")),
        ("sweep.json", "{\"x\": 2}", of_json("sweep.json")),
    ];
    for (name, text, read) in cases {
        let path = place.path("sub").join(name);
        fs::write(&path, text).unwrap();
        place.write("s.dscene", format!("{read}\nsweep k in [1, 2] {{ report {{ v: v * k }} }}\n"));
        for command in ["sweep", "run"] {
            let output = place.dsl(&[command, "s.dscene", "--out", "sub", "--force"]);
            assert_diagnosed(&output);
            let told = stderr(&output);
            let is_record = name == "sweep.json";
            assert!(is_record || told.contains("the script reads this file, which would be lost"), "{told}");
            assert_eq!(fs::read_to_string(&path).unwrap(), text);
        }
        // Nothing else is there either.
        assert_eq!(fs::read_dir(place.path("sub")).unwrap().count(), 1, "{name}");
        assert_code(&place.dsl(&["sweep", "s.dscene", "--out", "elsewhere"]), 0);
        fs::remove_dir_all(place.path("elsewhere")).unwrap();
        fs::remove_file(&path).unwrap();
    }
    // Values of the sweep name files too.
    fs::write(place.path("sub/table.csv"), "x\n1\n3\n").unwrap();
    place.write("other.csv", "x\n2\n");
    place.write(
        "s.dscene",
        "let file = \"other.csv\"\nsweep file in [\"sub/table.csv\"] { report { v: mean(load_table(file).x) } }\n",
    );
    let output = place.dsl(&["sweep", "s.dscene", "--out", "sub", "--force"]);
    assert_diagnosed(&output);
    assert!(stderr(&output).contains("the script reads this file, which would be lost"), "{}", stderr(&output));
    assert_eq!(fs::read_to_string(place.path("sub/table.csv")).unwrap(), "x\n1\n3\n");
}

#[test]
fn a_run_that_fails_is_told_and_stops_no_other() {
    let place = Place::new();
    let script = "param x = 1\nloss l = 4 * sqrt(sum([x]))\n
                  sweep rate in [0.1, 1.2, 0.2], i in [0, 5] {
                    print [7, 8][floor(x) - 1 + i]
                    optimize l { using: sgd(lr: if rate > 1 then 1e308 else rate / 4), steps: 3 }
                    expect x < 0.8
                    report { x }
                  }";
    place.write("a.dscene", script);
    let output = place.dsl(&["run", "a.dscene", "--out", "r"]);
    assert_code(&output, 1);
    let text = stdout(&output);
    let row = |rate: &str, i: &str| {
        let is_row = |line: &&str| line.split_whitespace().take(2).eq([rate, i]);
        text.lines().find(is_row).unwrap_or_default().to_owned()
    };
    assert!(row("0.1", "0").contains("an `expect` failed in 1"), "{text}");
    assert!(row("1.2", "0").contains("0 of 1") && row("1.2", "0").contains("1 diverged"), "{text}");
    assert!(row("0.2", "0").ends_with('*') && row("0.2", "5").contains("1 ended with an error"), "{text}");
    assert!(text.contains("rate=0.2,i=0,seed=0: 7"), "{text}");
    assert!(stderr(&output).contains("rate=1.2,i=0,seed=0: diverged"), "{}", stderr(&output));
    assert!(stderr(&output).contains("dscene::"), "{}", stderr(&output));
    // What ended with an error is tried again, what diverged would do so again.
    let before = lines(&place, "r", "begun").len();
    assert_code(&place.dsl(&["run", "a.dscene", "--out", "r"]), 1);
    assert_eq!((before, lines(&place, "r", "begun").len()), (6, 9));
    let page = fs::read_to_string(place.path("r/compare.html")).unwrap();
    assert!(page.contains("Sweep of a") && page.contains("rate = 0.2"), "{page}");
}

#[test]
fn hopeless_runs_are_given_up() {
    let place = Place::new();
    let script = "param x = 1\nloss l = x ^ 2\n
                  sweep rate in [0.01, 0.011, 0.012, 0.0001, 0.02] { optimize l { using: sgd(lr: rate), steps: 40 } }";
    place.write("a.dscene", script);
    let output = place.dsl(&["sweep", "a.dscene", "--prune", "--out", "r"]);
    assert_code(&output, 0);
    let text = stdout(&output);
    assert_eq!(text.matches("1 pruned").count(), 1, "{text}");
    let pruned = lines(&place, "r", "ended").into_iter().find(|line| line["end"] == "pruned").unwrap();
    // Not after ten steps, which are a quarter of its way.
    assert_eq!((&pruned["run"], &pruned["steps"]), (&Value::from("rate=0.0001,seed=0"), &Value::from(20)));
    assert!(pruned["why"].as_str().unwrap().contains("after step 19"), "{pruned}");
    let events =
        fs::read_to_string(place.path("r").join(pruned["run"].as_str().unwrap()).join("report.jsonl")).unwrap();
    let last: Value = serde_json::from_str(events.lines().last().unwrap()).unwrap();
    assert_eq!((&last["event"], &last["how"]), (&Value::from("end"), &Value::from("pruned")));
    // Where another loss is measured, or from elsewhere, a larger one says nothing.
    let elsewhere = script
        .replace("= 1", "= start")
        .replace("rate in [0.01, 0.011, 0.012, 0.0001, 0.02]", "start in [1, 1.1, 1.2, 50]");
    place.write("b.dscene", elsewhere.replace("lr: rate", "lr: 0.001"));
    assert_code(&place.dsl(&["sweep", "b.dscene", "--prune", "--out", "b"]), 0);
    assert!(lines(&place, "b", "ended").iter().all(|line| line["end"] == "finished"));
}

/// A column of angles says in what unit its numbers are, on the terminal, on the page and in files.
#[test]
fn angles_are_reported_in_degrees() {
    let place = Place::new();
    place.write(
        "a.dscene",
        "param tilt: angle = 0deg\nsweep tilt in [30deg, 0.5rad], seed in 0..2 { report { turn: 2 * tilt, x: 1 } }\n",
    );
    let output = place.dsl(&["sweep", "a.dscene", "--out", "r"]);
    assert_code(&output, 0);
    let words: Vec<String> = stdout(&output).split_whitespace().map(str::to_owned).collect();
    assert!(words.windows(2).any(|w| w == ["turn", "(deg)"]) && words.contains(&"60".to_owned()), "{words:?}");
    let [csv, json] = table(&place, "r");
    assert!(
        csv.starts_with(
            "tilt,runs_finished,runs_diverged,runs_pruned,runs_error,turn (deg),turn (deg)_error,x,x_error\n"
        ),
        "{csv}"
    );
    let json: Value = serde_json::from_str(&json).unwrap();
    let mean = json["rows"][1]["mean"]["turn (deg)"].as_f64().unwrap();
    assert!((mean - 1f64.to_degrees()).abs() < 1e-9, "{json}");
}

/// What the page of a sweep holds; `pages.rs` looks at it in a browser.
#[test]
fn the_page_of_a_sweep_has_its_table_and_one_name_for_all_seeds() {
    let place = Place::new();
    let actions = "optimize valley { using: sgd(lr: rate), steps: 20 }";
    let report = "report { gap: (x - 1) ^ 2, likeness: maximize(-(x - 1) ^ 2), seed }";
    let swept = format!("sweep rate in [0.01, 0.1], start in [3], seed in 0..3 {{ {actions} {report} }}");
    let script = VALLEY.replace("let rate = 0.1\n", "").replace("let start = 3\n", "").replace(actions, &swept);
    place.write("a.dscene", script);
    assert_code(&place.dsl(&["run", "a.dscene", "--out", "r", "--quiet"]), 0);
    let page = fs::read_to_string(place.path("r/compare.html")).unwrap();
    let (_, rest) = page.split_once("type=\"application/json\">").unwrap();
    let data: Value = serde_json::from_str(rest.split_once("</script>").unwrap().0).unwrap();
    let runs = data["runs"].as_array().unwrap();
    let labels: Vec<&str> = runs.iter().map(|run| run["label"].as_str().unwrap()).collect();
    assert_eq!((labels.len(), labels[0], labels[5]), (6, "rate = 0.01, seed = 0", "rate = 0.1, seed = 2"));
    assert_eq!((&runs[0]["kind"], &runs[0]["kind"]), (&runs[2]["kind"], &runs[4]["kind"]));
    assert_eq!(
        (&runs[1]["kind"], &runs[1]["reported"][2]),
        (&Value::from("rate = 0.1, start = 3"), &serde_json::json!(["seed", 0.0]))
    );
    let settings: Vec<&Value> = data["settings"].as_array().unwrap().iter().map(|row| &row[0]).collect();
    assert_eq!(settings, ["rate", "seed"]);
    let means = |row: usize| {
        data["table"]["rows"][row]["means"].as_array().unwrap().iter().map(|mean| mean[1] == true).collect::<Vec<_>>()
    };
    assert_eq!(data["table"]["columns"], serde_json::json!(["gap", "likeness", "seed"]));
    assert_eq!((means(0), means(1)), (vec![false, false, true], vec![true, true, false]));
}

#[test]
fn the_folder_of_a_sweep_is_told_from_that_of_a_run() {
    let place = Place::new();
    place.write("a.dscene", VALLEY);
    assert_code(&place.dsl(&["sweep", "a.dscene", "--set", "rate=0.1,0.2", "--out", "r", "--quiet"]), 0);
    for arguments in
        [&["compare", "r"][..], &["report", "r/"], &["export", "r"], &["compare", "r/rate=0.1,seed=0", "r"]]
    {
        let output = place.dsl(arguments);
        assert_diagnosed(&output);
        let told = stderr(&output).split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(told.contains("`r` is the folder of a sweep, not of a run"), "{arguments:?}: {told}");
        assert!(
            told.contains("`dsl compare r/*/`") && told.contains("`r/rate=0.1,seed=0` is one"),
            "{arguments:?}: {told}"
        );
    }
    // What is proposed works.
    assert_code(&place.dsl(&["compare", "r/rate=0.1,seed=0/", "r/rate=0.2,seed=0/"]), 0);
}

#[test]
fn a_changed_script_and_a_folder_in_use_are_refused() {
    let place = Place::new();
    place.write("a.dscene", VALLEY);
    let sweep = |more: &[&str]| place.dsl(&[&["sweep", "a.dscene", "--out", "r", "--quiet"][..], more].concat());
    assert_code(&sweep(&["--set", "rate=0.1,0.2"]), 0);
    place.write("a.dscene", VALLEY.replace("x - 1", "x - 2"));
    let output = sweep(&["--set", "rate=0.1,0.2"]);
    assert_diagnosed(&output);
    let told = stderr(&output);
    assert!(told.contains("`a.dscene` has changed") && told.contains("--force"), "{told}");
    // By force it begins anew: no row is one of the old script, whatever was there.
    assert_code(&sweep(&["--set", "rate=0.1,0.2,0.3", "--force"]), 0);
    assert_eq!(lines(&place, "r", "begun").len(), 3);
    let new = |more: &[&str]| place.dsl(&[&["sweep", "a.dscene", "--out", "new", "--quiet"][..], more].concat());
    assert_code(&new(&["--set", "rate=0.1,0.2,0.3"]), 0);
    let losses = |folder: &str| {
        let ended = lines(&place, folder, "ended");
        ended.iter().map(|line| (line["run"].to_string(), line["values"]["valley"].to_string())).collect::<Vec<_>>()
    };
    assert_eq!((losses("r"), losses("r").len()), (losses("new"), 3));
    // What is the same goes on by force too.
    assert_code(&sweep(&["--set", "rate=0.1,0.2,0.3,0.4", "--force"]), 0);
    assert_eq!(lines(&place, "r", "begun").len(), 4);
}

/// Rows of older data do not stand beside rows of newer ones.
#[test]
fn changed_data_are_seen() {
    let place = Place::new();
    let script = VALLEY.replace("(x - 1)", "(x - load_table(\"goal.csv\")[0, 0])");
    fs::create_dir(place.path("a")).unwrap();
    place.write("a/a.dscene", &script);
    place.write("a/goal.csv", "1,0\n");
    let sweep = |values: &str, more: &[&str]| {
        place.dsl(&[&["sweep", "a/a.dscene", "--out", "r", "--quiet", "--set", values][..], more].concat())
    };
    assert_code(&sweep("rate=0.1", &[]), 0);
    assert_code(&sweep("rate=0.1,0.2", &[]), 0);
    assert_eq!(lines(&place, "r", "begun").len(), 2);
    place.write("a/goal.csv", "2,0\n");
    let output = sweep("rate=0.1,0.2,0.3", &[]);
    assert_diagnosed(&output);
    assert!(stderr(&output).contains("`goal.csv` has changed"), "{}", stderr(&output));
    assert_code(&sweep("rate=0.1,0.2,0.3", &["--force"]), 0);
    assert_eq!(lines(&place, "r", "begun").len(), 3);
    assert_code(&sweep("rate=0.1,0.2,0.3,0.4", &[]), 0);
}

/// What has no value is told before the first run, and once.
#[test]
fn values_are_tried_before_the_first_run() {
    let place = Place::new();
    place.write("a.dscene", VALLEY);
    for (values, why) in [
        ("start=1,sqrt(sum(noise([1]) ^ 0) - 3)", "the square root of -2"),
        ("x=1,0/0", "is not finite"),
        ("x=1,2,load_table(\"a{1}.csv\")[0, 0]", "a1.csv"),
    ] {
        let output = place.dsl(&["sweep", "a.dscene", "--out", "r", "--set", values]);
        assert_diagnosed(&output);
        let told = stderr(&output);
        assert!(told.contains(why) && told.matches('×').count() == 1, "{told}");
        assert!(!place.path("r").exists(), "{values}");
    }
}

#[test]
fn a_sweep_goes_on_when_the_disk_has_room_again() {
    let place = Place::new();
    place.write("a.dscene", VALLEY.replace("steps: 20", "steps: 150"));
    assert_code(&place.dsl(&["sweep", "a.dscene", "--set", "rate=0.01,0.02", "--out", "whole"]), 0);
    let output = place.with_little_room("sweep a.dscene --set rate=0.01,0.02 --out full");
    assert_diagnosed(&output);
    assert!(stderr(&output).contains("cannot write"), "{}", stderr(&output));
    assert_code(&place.dsl(&["sweep", "a.dscene", "--set", "rate=0.01,0.02", "--out", "full"]), 0);
    let losses = |folder: &str| {
        let ended = lines(&place, folder, "ended").into_iter().filter(|line| line["end"] == "finished");
        ended.map(|line| line["values"]["valley"].to_string()).collect::<Vec<_>>()
    };
    assert_eq!((losses("full").len(), losses("full")), (2, losses("whole")));
}

#[test]
fn a_thousand_combinations_are_shared_by_many() {
    let place = Place::new();
    place.write("a.dscene", VALLEY);
    let command = ["sweep", "a.dscene", "--set", "start=0..1000", "--shard", "7/500", "--out", "r", "--quiet"];
    assert_code(&place.dsl(&command), 0);
    assert_eq!(lines(&place, "r", "ended").len(), 2);
    assert_eq!(table(&place, "r")[0].lines().count(), 1001);
}

#[test]
fn a_script_with_a_sweep_is_still_one_scene() {
    let place = Place::new();
    place.write("a.dscene", triangle());
    // Outside of its runs a variable is its first value.
    let output = place.dsl(&["eval", "a.dscene", "[lr, seed]"]);
    assert_code(&output, 0);
    assert_eq!(stdout(&output).trim(), "[0.01, 0]");
    assert_code(&place.dsl(&["check", "a.dscene"]), 0);
    // What only a stage's end depends on is of effect.
    let staged = "param x = 1\nsweep start in [1, 2] { optimize x ^ 2 { stage a { steps: 2 then { param x = start } } stage b { steps: 1 } } }";
    place.write("staged.dscene", staged);
    assert_code(&place.dsl(&["check", "staged.dscene"]), 0);
    assert_code(&place.dsl(&["grad", "a.dscene", "--wrt", "glow"]), 0);
    let typed = place
        .command(&["repl", "a.dscene"])
        .write_stdin("sweep x in [1] { print x }\nreport { lr }\nlr\n")
        .output()
        .unwrap();
    let told = stdout(&typed) + &stderr(&typed);
    assert!(
        told.contains("a sweep is many runs") && told.contains("outside of a sweep") && told.contains("0.01"),
        "{told}"
    );
    // A run of it is a run: it can be exported.
    assert_code(
        &place.dsl(&["sweep", "a.dscene", "--set", "lr=0.05", "--seeds", "1", "--steps", "3", "--out", "r"]),
        0,
    );
    let output = place.dsl(&["export", "r/lr=0.05,seed=0"]);
    assert_code(&output, 0);
    assert!(stdout(&output).contains("corners"), "{}", stdout(&output));
}

#[test]
fn slips_are_told_by_what_to_write() {
    let place = Place::new();
    let cases = [
        ("let rate = 0.1\nsweep rate in [rate, 2 * rate] { print rate }", "is made of `rate`, which it replaces"),
        ("sweep rate = [0.1, 0.2] { print rate }", "write `sweep rate in [a, b] { … }`"),
        ("sweep rate in [0.1, 0.2]", "write `sweep rate in [a, b] { … }`"),
        ("sweep in [0.1, 0.2] { print 1 }", "expected a name"),
        ("param x = 1\nfor rate in [0.1] { optimize x ^ 2 { steps: 3 } }", "runs with several values are a sweep"),
    ];
    for (script, told) in cases {
        place.write("a.dscene", script);
        let output = place.command(&["check", "a.dscene"]).env("COLUMNS", "120").output().unwrap();
        assert_diagnosed(&output);
        let text = stderr(&output).split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(text.contains(told), "{script}: {text}");
    }
}
