//! Web pages as Chromium shows them: what is on them, at 1280 and 390 pixels, dark and light.
//!
//! `DSCENE_BROWSER=1` asks for them, and `DSCENE_SCREENSHOTS=FOLDER` leaves pictures to look at.

#[path = "common/browser.rs"]
mod browser;
#[path = "common/place.rs"]
mod place;

use std::path::Path;

use browser::{Browser, Page, Scheme};
use place::{Place, TRIANGLE, assert_code};
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
