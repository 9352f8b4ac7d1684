//! Web pages as Chromium shows them: what is on them, at 1280 and 390 pixels, dark and light.
//!
//! `DSCENE_BROWSER=1` asks for them, and `DSCENE_SCREENSHOTS=FOLDER` leaves pictures to look at.

use std::path::Path;

use crate::browser::{Browser, Page, Scheme};
use crate::place::{Place, TRIANGLE, assert_code};
use serde_json::json;

/// A file that the browser shows in every size and scheme: nothing is wrong, nothing is fetched, nothing is too wide.
fn seen(browser: &mut Browser, name: &str, path: &Path, mut look: impl FnMut(&mut Page)) {
    for (width, scheme) in [(1280, Scheme::Light), (1280, Scheme::Dark), (390, Scheme::Light), (390, Scheme::Dark)] {
        let mut page = browser.open_file(path, (width, 900), scheme);
        page.wait_for("document.querySelector('section')");
        look(&mut page);
        let what = format!("{name}, {width} px, {scheme:?}");
        if let Some(folder) = std::env::var_os("DSCENE_SCREENSHOTS") {
            page.screenshot(&Path::new(&folder).join(format!("{name}-{width}-{scheme:?}.png").to_lowercase()));
        }
        assert_eq!(page.errors(), Vec::<String>::new(), "{what}");
        assert_eq!(page.requests().len(), 1, "{what}: {:?}", page.requests());
        assert_eq!(page.overflow(), 0.0, "{what}");
        let dark =
            page.number("Number(getComputedStyle(document.body).backgroundColor.match(/\\d+/)[0]) < 128 ? 1 : 0");
        assert_eq!(dark == 1.0, scheme == Scheme::Dark, "{what}");
    }
}

#[test]
fn runs_are_compared_side_by_side() {
    let Some(mut browser) = Browser::wanted() else { return };
    let place = Place::new();
    let script = format!(
        "{TRIANGLE}let rate = 0.02\noptimize fit {{ using: adam(lr: rate), steps: 12 }}\nsave render(eye) to \"</script>.png\"\n"
    );
    place.write("a.dscene", &script);
    place.write("b.dscene", script.replace("steps: 12 }", "steps: 9 } // </script><script>throw 1</script>"));
    for arguments in ["a.dscene --out one", "a.dscene --out two --seed 4 --set rate=0.05", "b.dscene --out three"] {
        let mut all = vec!["run", "--quiet"];
        all.extend(arguments.split(' '));
        assert_code(&place.dsl(&all), 0);
    }
    assert_code(&place.dsl(&["compare", "one", "two", "three", "--quiet"]), 0);
    seen(&mut browser, "comparison", &place.path("compare.html"), |page| {
        assert_eq!(page.number("document.querySelectorAll('tbody')[0].rows.length"), 3.0);
        // Curves by steps and by time, with ticks and units.
        page.wait_for("document.querySelectorAll('path.curve').length === 6");
        let charts = page.eval("[...document.querySelectorAll('.chart')].map((c) => c.textContent)");
        let text = charts.to_string();
        assert!(text.contains("step") && text.contains("seconds of steps") && text.contains("loss"), "{text}");
        assert_eq!(page.number("document.querySelectorAll('.legend')[0].children.length"), 3.0);
        // Settings and scripts.
        let settings = page.eval(
            "[...document.querySelectorAll('section')].find((s) => s.textContent.startsWith('Settings')).innerText",
        );
        assert!(settings.as_str().unwrap().contains("rate"), "{settings}");
        assert_eq!(
            page.text("document.querySelector('pre .more').textContent").trim(),
            "+ optimize fit { using: adam(lr: rate), steps: 9 } // </script><script>throw 1</script>"
        );
        // The images are there: each run's, not black.
        page.wait_for("[...document.querySelectorAll('canvas.picture')].filter((c) => c.width === 16).length >= 3");
        let sum = "[...document.querySelectorAll('canvas.picture')].map((c) => \
                   c.getContext('2d').getImageData(0, 0, c.width, c.height).data.reduce((a, b) => a + b, 0) - 255 * 256)";
        let sums = page.eval(sum);
        assert!(sums.as_array().unwrap().iter().all(|s| s.as_f64().unwrap() > 1000.0), "{sums}");
        // A curve is hidden by its legend, and shown again.
        page.click(".legend button");
        page.wait_for("document.querySelectorAll('path.curve').length === 5");
        page.click(".legend button");
        page.wait_for("document.querySelectorAll('path.curve').length === 6");
        assert_eq!(page.eval("document.title"), json!("Comparison of runs"));
    });
}

#[test]
fn a_sweep_shows_its_table_and_a_colour_for_all_seeds() {
    let Some(mut browser) = Browser::wanted() else { return };
    let place = Place::new();
    let sweep = "sweep rate in [0.01, 0.05], samples in [1, 2], seed in 0..3 {
                   optimize fit { using: adam(lr: rate), steps: 12 / samples }
                   report { error: abs(glow - 0.8), likeness: maximize(psnr(render(eye, spp: 16), target)), seconds }
                 }";
    place.write("a.dscene", TRIANGLE.replace("spp: 2", "spp: samples") + sweep);
    assert_code(&place.dsl(&["run", "a.dscene", "--out", "r", "--quiet"]), 0);
    seen(&mut browser, "sweep", &place.path("r/compare.html"), |page| {
        let part = |title: &str| {
            format!("[...document.querySelectorAll('section')].find((s) => s.innerText.startsWith('{title}'))")
        };
        // A row for each combination, the best of each column marked once.
        let cells = |title: &str, which: &str| {
            format!("[...{}.querySelectorAll('{which}')].map((c) => c.innerText)", part(title))
        };
        assert_eq!(
            page.eval(&cells("Means", "th")),
            json!(["rate", "samples", "seeds", "error", "likeness", "seconds"])
        );
        assert_eq!(page.number(&format!("{}.querySelectorAll('tbody tr').length", part("Means"))), 4.0);
        assert_eq!(page.eval(&cells("Means", "b.good")).as_array().unwrap().len(), 3);
        assert!(page.eval(&cells("Means", "td")).to_string().contains(" ± "));
        // Twelve runs, with what they report, and their seeds once.
        assert_eq!(page.number(&format!("{}.querySelectorAll('tbody tr').length", part("Final"))), 12.0);
        let head = page.eval(&cells("Final", "th"));
        assert!(head.as_array().unwrap().contains(&json!("likeness")), "{head}");
        assert_eq!(page.eval(&cells("Settings", "th")), json!(["run", "rate", "samples", "seed"]));
        // Curves of all runs, with four colours and four entries.
        page.wait_for("document.querySelectorAll('path.curve').length === 24");
        assert_eq!(page.number("document.querySelector('.legend').children.length"), 4.0);
        let colours = "new Set([...document.querySelector('.chart').querySelectorAll('path.curve')].map((c) => c.getAttribute('stroke'))).size";
        assert_eq!(page.number(colours), 4.0);
        page.click(".legend button");
        page.wait_for("document.querySelectorAll('path.curve').length === 21");
        page.click(".legend button");
        page.wait_for("document.querySelectorAll('path.curve').length === 24");
    });
}

/// A run with stages, bounds, warnings, an `every` and an `expect` that fails.
const STAGED: &str = "
optimize fit {
  using: adam(lr: 0.02)
  stage coarse { steps: 30, film_scale: 0.5 }
  stage fine { steps: 10 }
  every 20 { save render(eye) to \"{step}.png\" }
}
expect fit < 1e-9
print \"</script><script>throw 1</script>\"
";

#[test]
fn a_run_reports_what_it_has_done() {
    let Some(mut browser) = Browser::wanted() else { return };
    let place = Place::new();
    let target = "let target = render(eye, spp: 16) with { glow: 0.8 }";
    let follows = "let target = render(camera(position: [0, 0, -4], look_at: [0, 0, 0], fov: 45deg, film: [16, 16]), spp: 16) with { glow: 0.8 }";
    let script = format!("{}{STAGED}", TRIANGLE.replace(target, follows));
    let script = script.replace("film: [16, 16] }", "film: [16, 16] } // </script><!--");
    place.write("a.dscene", &script);
    assert_code(&place.dsl(&["run", "a.dscene", "--out", "r", "--seed", "3", "--quiet"]), 1);
    let page = std::fs::read_to_string(place.path("r/report.html")).unwrap();
    seen(&mut browser, "report", &place.path("r/report.html"), |page| {
        let facts = page.text("document.querySelector('.facts').innerText");
        assert!(facts.contains("finished, not as the script expects") && facts.contains("40"), "{facts}");
        // Start, end, target, two differences, the wipe, the animation.
        page.wait_for("document.querySelectorAll('canvas.picture').length === 7");
        page.wait_for("document.querySelector('.animation output').textContent.startsWith('step 40')");
        let light = "[...document.querySelectorAll('canvas.picture')].map((c) => c.getContext('2d') \
                     .getImageData(0, 0, c.width, c.height).data.reduce((a, b) => a + b, 0) / (c.width * c.height) - 255)";
        let before = page.eval(light);
        assert!(before.as_array().unwrap().iter().all(|x| x.as_f64().unwrap() > 20.0), "{before}");
        assert_ne!(before[0], before[1], "the start and the end are different images");
        assert_eq!(
            page.eval("[...document.querySelectorAll('figcaption b')].map((b) => b.textContent)"),
            json!(["start, step 0", "end, after 40 steps", "target", "start − target", "end − target"])
        );
        // Less exposure makes the images darker, and not the differences, whose middle is white.
        page.eval("(() => { const e = document.querySelector('[aria-label=\"exposure in stops\"]'); e.value = -3; e.dispatchEvent(new Event('input')); })()");
        let after = page.eval(light);
        for at in [0, 1, 2, 5, 6] {
            assert!(after[at].as_f64() < before[at].as_f64(), "{at}: {before} {after}");
        }
        // The wipe follows the pointer.
        page.eval("document.querySelector('.wipe').scrollIntoView({ block: 'center' })");
        let at = page.eval("(() => { const r = document.querySelector('.wipe').getBoundingClientRect(); return [r.x + 0.25 * r.width, r.y + 20] })()");
        let (x, y) = (at[0].as_f64().unwrap(), at[1].as_f64().unwrap());
        page.mouse("mousePressed", x, y);
        page.mouse("mouseReleased", x, y);
        page.wait_for("Math.abs(parseFloat(document.querySelector('.wipe .bar').style.left) - 25) < 1");
        // The animation has about two dozen steps and the end.
        let frames = page.number("Number(document.querySelector('.animation input').max)");
        assert!((20.0..=24.0).contains(&frames), "{frames}");
        page.eval("(() => { const e = document.querySelector('.animation input'); e.value = 0; e.dispatchEvent(new Event('input')); })()");
        page.wait_for("document.querySelector('.animation output').textContent.startsWith('step 0, loss 0.0')");

        // The loss with its band, and where stages begin.
        let chart = |title: &str| {
            format!("[...document.querySelectorAll('section')].find((s) => s.innerText.startsWith('{title}'))")
        };
        page.wait_for(&format!("{}.querySelector('path.curve')", chart("Loss")));
        let points = page.number(&format!("{}.querySelector('polygon.band').points.length", chart("Loss")));
        assert!(points > 60.0, "{points}");
        let marks = page.text(&format!("{}.querySelector('svg').textContent", chart("Loss")));
        assert!(marks.contains("coarse") && marks.contains("fine") && marks.contains("step"), "{marks}");
        // A tooltip under the pointer.
        let middle = page.eval(&format!(
            "(() => {{ const c = {}.querySelector('.chart'); c.scrollIntoView({{ block: 'center' }}); \
            const r = c.getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2] }})()",
            chart("Loss")
        ));
        page.mouse("mouseMoved", middle[0].as_f64().unwrap(), middle[1].as_f64().unwrap());
        let tip = format!("{}.querySelector('.tip')", chart("Loss"));
        page.wait_for(&format!("!{tip}.hidden && /step 1\\d|step 2\\d/.test({tip}.textContent)"));
        page.mouse("mouseMoved", 1.0, 1.0);

        // Params with their bounds, gradients with their errors, phases, memory.
        page.wait_for(&format!("{}.querySelectorAll('path.curve').length === 10", chart("Params")));
        assert_eq!(page.number(&format!("{}.querySelectorAll('line.bound').length", chart("Params"))), 2.0);
        assert_eq!(page.number(&format!("{}.querySelectorAll('path.curve').length", chart("Gradients"))), 5.0);
        let time = page.text(&format!("{}.innerText", chart("Time")));
        for phase in ["renderings", "derivatives", "solver", "files", "`every`"] {
            assert!(time.contains(phase), "{phase}: {time}");
        }
        let shares = page.number(&format!(
            "[...{}.querySelectorAll('.shares i')].reduce((sum, i) => sum + Number(i.style.flexGrow), 0)",
            chart("Time")
        ));
        assert!((shares - 1.0).abs() < 1e-3, "{shares}");
        // What was told, and the script with other numbers.
        let told = page.text(&format!("{}.innerText", chart("Warnings")));
        assert!(told.contains("expectation failed") && told.contains("a.dscene:"), "{told}");
        let lines = page
            .text(&format!("[...{}.querySelectorAll('.more')].map((l) => l.textContent).join()", chart("The script")));
        assert!(lines.contains("param glow = 0.") && !lines.contains("param glow = 0.5 "), "{lines}");
    });
    // Made again from the folder it is the same page.
    assert_code(&place.dsl(&["report", "r", "--quiet"]), 0);
    assert_eq!(std::fs::read_to_string(place.path("r/report.html")).unwrap(), page);
}

#[test]
fn runs_that_end_early_report_too() {
    let Some(mut browser) = Browser::wanted() else { return };
    let place = Place::new();
    place.write("a.dscene", "param x = 3\nloss l = x ^ 4\noptimize l { using: sgd(lr: 10), steps: 50 }\n");
    assert_code(&place.dsl(&["run", "a.dscene", "--out", "diverged", "--quiet"]), 1);
    place.write("b.dscene", "param x = 1\nloss l = x ^ 2\noptimize l { using: sgd(lr: 1e-7), steps: 1000000 }\n");
    let mut child = place.start(&["run", "b.dscene", "--out", "interrupted", "--quiet"]);
    let log = place.path("interrupted/log.jsonl");
    while std::fs::read_to_string(&log).map_or(0, |text| text.lines().count()) < 50 {
        assert!(child.try_wait().unwrap().is_none());
    }
    assert!(crate::place::send(&child, "-INT"));
    assert_eq!(child.wait().unwrap().code(), Some(130));
    place.write("c.dscene", "print 1\n");
    assert_code(&place.dsl(&["run", "c.dscene", "--out", "nothing", "--quiet"]), 0);
    for (name, ended) in
        [("diverged", "not as the script expects"), ("interrupted", "interrupted"), ("nothing", "finished")]
    {
        seen(&mut browser, name, &place.path(name).join("report.html"), |page| {
            let facts = page.text("document.querySelector('.facts').innerText");
            assert!(facts.contains(ended), "{name}: {facts}");
            if name == "diverged" {
                let told = page.text("document.querySelector('main').innerText");
                assert!(told.contains("error: ") && told.contains("lower the rate"), "{told}");
            }
        });
    }
}
