//! Pictures for papers: plots, and what a saved picture lacks.

use std::fs;
use std::path::Path;

use crate::browser::{Browser, Scheme};
use crate::place::{Place, TRIANGLE, assert_code, assert_diagnosed, png_colors, stderr, stdout};

/// Runs a script, and gives what it says.
fn run(place: &Place, script: &str) -> String {
    place.write("p.dscene", script);
    let output = place.dsl(&["run", "p.dscene", "--out", "r", "--force"]);
    assert_code(&output, 0);
    stdout(&output) + &stderr(&output)
}

fn refused(place: &Place, script: &str, message: &str) {
    place.write("p.dscene", script);
    let output = place.dsl(&["run", "p.dscene", "--out", "r", "--force"]);
    assert_diagnosed(&output);
    // Lines are broken where the terminal ends.
    let text = stderr(&output).split_whitespace().filter(|w| *w != "│").collect::<Vec<&str>>().join(" ");
    assert!(text.contains(message), "{script}: {text}");
}

fn file(place: &Place, name: &str) -> String {
    fs::read_to_string(place.path("r").join(name)).unwrap()
}

/// The elements of an SVG with that class, as the values of one attribute.
fn of_class(svg: &str, class: &str, attribute: &str) -> Vec<String> {
    let lines = svg.lines().filter(|l| l.contains(&format!("class=\"{class}\"")));
    lines.map(|l| l.split(&format!(" {attribute}=\"")).nth(1).unwrap().split('"').next().unwrap().to_owned()).collect()
}

fn points(list: &str) -> Vec<[f64; 2]> {
    list.split(' ').map(|p| p.split_once(',').unwrap()).map(|(x, y)| [x.parse().unwrap(), y.parse().unwrap()]).collect()
}

fn words(svg: &str) -> Vec<&str> {
    svg.lines().filter(|l| l.starts_with("<text")).map(|l| l.split(['<', '>']).nth(2).unwrap()).collect()
}

#[test]
fn lists_are_plotted_over_lists_on_logarithmic_axes() {
    let place = Place::new();
    let said = run(
        &place,
        "let rates = [1, 10, 100, 1000]
         let errors = [0.1, 0.01, 0.001, 0.0001]
         plot errors, [r ^ -0.5 for r in rates] over rates to \"e.svg\" {
           log: xy, band: [0.5 * errors, 0.1 * errors], title: \"Errors\", y_label: \"rms\", legend: [\"ours\", \"1/√n\"]
         }
         plot errors over rates to \"e.png\" { log: \"y\", size: [300, 200] }
         plot errors { log: y }",
    );
    assert!(!said.contains("warning"), "{said}");
    assert!(said.contains("errors  █▆▃▁"), "{said}");
    let svg = file(&place, "e.svg");
    let curves: Vec<_> = of_class(&svg, "curve", "points").iter().map(|p| points(p)).collect();
    assert_eq!(curves.len(), 2);
    // Powers are straight lines: of slope −1 and −1/2 in units of the ticks.
    let slope = |c: &[[f64; 2]]| (c[3][1] - c[0][1]) / (c[3][0] - c[0][0]);
    assert!((slope(&curves[0]) / slope(&curves[1]) - 2.0).abs() < 1e-3, "{curves:?}");
    let middle = [(curves[0][0][0] + curves[0][3][0]) / 2.0, (curves[0][1][0] + curves[0][2][0]) / 2.0];
    assert!((middle[0] - middle[1]).abs() < 0.02, "{curves:?}");
    let bands = of_class(&svg, "band", "points");
    assert_eq!(bands.len(), 2);
    // Half a value up is log10(1.5) of a decade.
    let decade = (curves[0][1][1] - curves[0][0][1]).abs();
    let up = curves[0][0][1] - points(&bands[0])[0][1];
    assert!((up / decade - 1.5_f64.log10()).abs() < 2e-3, "{up} {decade}");
    for word in ["Errors", "rms", "rates", "ours", "1/√n", "10⁻³", "10⁰", "10³"] {
        assert!(words(&svg).contains(&word), "{word}: {:?}", words(&svg));
    }
    let bytes = fs::read(place.path("r/e.png")).unwrap();
    let (width, colors) = png_colors(&bytes);
    assert_eq!((width, colors.len()), (600, 600 * 400));
    let blue = colors.iter().filter(|c| **c == [0x00, 0x72, 0xb2]).count();
    assert!(blue > 500, "{blue}");
}

#[test]
fn a_loss_comes_with_its_steps_and_their_noise() {
    let place = Place::new();
    run(
        &place,
        "param x = 3
         loss fit = (x + mean(uniform(4)) - 0.5) ^ 2 + 1
         optimize fit { steps: 40, using: sgd(lr: 0.05) every 10 { plot x to \"x.svg\" } }
         plot fit to \"fit.svg\"",
    );
    let svg = file(&place, "fit.svg");
    // The step after the last is the loss there.
    assert_eq!(points(&of_class(&svg, "curve", "points")[0]).len(), 41);
    assert_eq!(points(&of_class(&svg, "band", "points")[0]).len(), 80);
    assert!(words(&svg).contains(&"step") && words(&svg).contains(&"fit") && words(&svg).contains(&"40"), "{svg}");
    // What `every` plots is where its step is: 0, 10, 20, 30.
    let svg = file(&place, "x.svg");
    let dots: Vec<f64> = of_class(&svg, "point", "cx").iter().map(|x| x.parse().unwrap()).collect();
    assert_eq!(dots.len(), 4);
    assert!((dots[1] - dots[0] - (dots[3] - dots[2])).abs() < 0.02);
    assert!(words(&svg).contains(&"step") && words(&svg).contains(&"30"), "{svg}");
}

#[test]
fn estimates_have_bands_and_rows_make_curves() {
    let place = Place::new();
    run(
        &place,
        &format!(
            "{TRIANGLE}
         let counts = [1, 4, 16]
         plot [estimate(mean(render(eye, spp: n)), repeats: 16) for n in counts] over counts to \"e.svg\" {{ log: x }}
         plot [[0, 10, 20], [1, 11, 21], [2, 12, 22], [3, 13, 23]] to \"rows.svg\"
         plot [10deg, 20deg] over [0deg, 45deg] to \"turn.svg\""
        ),
    );
    let svg = file(&place, "e.svg");
    let (curve, band) = (points(&of_class(&svg, "curve", "points")[0]), points(&of_class(&svg, "band", "points")[0]));
    assert_eq!((curve.len(), band.len()), (3, 6));
    // The error of a mean falls as 1/√n: by 4 from 1 sample to 16, if 16 repeats tell it well.
    let width = |i: usize| band[5 - i][1] - band[i][1];
    assert!(width(0) > 1.5 * width(2) && width(2) > 0.0, "{band:?}");
    let svg = file(&place, "rows.svg");
    assert_eq!(of_class(&svg, "curve", "points").len(), 3);
    assert!(words(&svg).iter().filter(|w| w.ends_with(".x") || w.ends_with(".y") || w.ends_with(".z")).count() == 3);
    assert!(words(&svg).contains(&"index"), "{:?}", words(&svg));
    let svg = file(&place, "turn.svg");
    for word in ["[10deg, 20deg] (°)", "[0deg, 45deg] (°)", "10", "20", "40"] {
        assert!(words(&svg).contains(&word), "{word}: {:?}", words(&svg));
    }
}

#[test]
fn what_an_axis_has_no_place_for_is_told_with_its_place() {
    let place = Place::new();
    let said = run(
        &place,
        "let values = [1, 0.1, 0, -1, 0.01]
         plot values to \"a.svg\" { log: y }
         plot [1, log(0), 2, 3] to \"b.svg\"
         plot [1, 2, 3] over [0, 1, 2] to \"c.svg\" { log: x }",
    );
    assert_eq!(said.matches("dscene::plot::gap").count(), 3, "{said}");
    assert!(said.contains("`values` is 0 at [2], and 1 more"), "{said}");
    assert!(said.contains("is -inf at [1]") && said.contains("is plotted over is 0 at [0]"), "{said}");
    assert_eq!(points(&of_class(&file(&place, "a.svg"), "curve", "points")[0]).len(), 2);
    assert_eq!(of_class(&file(&place, "b.svg"), "point", "cx").len(), 3);
    // A run's report lists them.
    assert!(file(&place, "report.html").contains("dscene::plot::gap"));
}

#[test]
fn plots_that_cannot_be_are_refused() {
    let place = Place::new();
    place.write("numbers.json", "{\"a\": [1, 2, 3], \"b\": [1, 2], \"none\": []}");
    let data = "let d = load_json(\"numbers.json\")\n";
    let with = |rest: &str| format!("{data}{rest}");
    refused(&place, &with("plot d.none"), "there is nothing to plot");
    refused(&place, &with("plot d.a over d.b to \"x.svg\""), "different lengths");
    refused(&place, &with("plot d.b[0] over d.a"), "different lengths");
    refused(&place, &with("plot d.a to \"x.svg\" { band: d.b }"), "does not fit what is plotted");
    refused(&place, &with("plot d.b to \"x.svg\" { band: [0.5, -1] }"), "[1] is -1");
    refused(
        &place,
        &with("plot d.a, d.b to \"x.svg\" { legend: [s for s in [\"a\", \"b\", \"c\"] if s != \"d\"] }"),
        "3 for 2",
    );
    refused(&place, &with("let kind = \"gif\"\nplot d.a to \"x.{kind}\""), "cannot be saved as `.gif`");
    place.write("r.txt", "");
    refused(&place, &with("plot d.a to \"../r.txt/x.svg\""), "cannot write");
}

const BRIGHT: &str = "
camera eye { position: [0, 0, -4], look_at: [0, 0, 0], fov: 45deg, film: [16, 16] }
param glow = 4
shape panel { mesh: sphere(), material: diffuse(reflectance: 0.5) }
light sky = constant(radiance: glow)
loss fit = mean(render(eye, spp: 1))
";

#[test]
fn a_picture_that_lacks_what_is_bright_says_so_once() {
    let place = Place::new();
    let said = run(
        &place,
        &format!(
            "{BRIGHT}
             optimize fit {{ steps: 4, using: sgd(lr: 0) every 1 {{ save render(eye, spp: 1) to \"f_{{step}}.png\" }} }}
             save render(eye, spp: 1) to \"a.exr\"
             save tonemap(render(eye, spp: 1)) to \"t.png\"
             save 0.2 * render(eye, spp: 1) to \"e.png\"
             save depth(eye) to \"depth.png\"
             save colormap(depth(eye)) to \"depth_colours.png\""
        ),
    );
    assert_eq!(said.matches("dscene::image::clipped").count(), 2, "{said}");
    let said = said.split_whitespace().filter(|w| *w != "│").collect::<Vec<&str>>().join(" ");
    assert!(said.contains("99 % of the pixels of `f_0.png` are clipped"), "{said}");
    assert!(said.contains("`tonemap(render(eye, spp: 1))` fits, or 0.2 times as much"), "{said}");
    assert!(said.contains("`colormap(depth(eye))` shows any range"), "{said}");
    assert!(file(&place, "report.html").contains("dscene::image::clipped"));
    let output = place.dsl(&["render", "p.dscene", "-o", "a.png"]);
    assert_code(&output, 0);
    assert!(stderr(&output).contains("dscene::image::clipped"), "{}", stderr(&output));
    let output = place.dsl(&["render", "p.dscene", "-o", "a.exr"]);
    assert!(!stderr(&output).contains("clipped"), "{}", stderr(&output));
}

/// NaN is neither bright nor dark, and no file of pixels for looking at has it.
#[test]
fn pixels_that_are_no_numbers_are_told_as_such() {
    let place = Place::new();
    let said = run(
        &place,
        "let a = image([[0, 1, 1], [1, 0, 4]]) / image([[1, 1, 1], [0, 0, 1]]) - image([[0, 2, 0], [0, 0, 0]])
         save a to \"a.png\"
         save a to \"a.hdr\"
         save a to \"a.exr\"
         save image([[0 / 0]]) to \"b.png\"",
    );
    let said = said.split_whitespace().filter(|w| *w != "│").collect::<Vec<&str>>().join(" ");
    let count = |words: &str| said.matches(words).count();
    assert_eq!((count("dscene::image::nan"), count("dscene::image::clipped")), (3, 3), "{said}");
    for words in [
        "the pixel [1, 1] of `a.png` is not a number (NaN), and black in the file",
        "50 % of the pixels of `a.png` are clipped",
        "the pixel [1, 1] of `a.hdr` is not a number",
        "a pixel of `a.hdr` is negative, -1, and black in the file",
        "the pixel [0, 1] of `a.hdr`",
        "the pixel [0, 0] of `b.png` is not a number",
    ] {
        assert!(said.contains(words), "{words}: {said}");
    }
}

/// What a browser makes of the SVG.
#[test]
fn a_browser_shows_a_plot() {
    let Some(mut browser) = Browser::wanted() else { return };
    let place = Place::new();
    run(
        &place,
        "let rates = [1, 10, 100, 1000]
         plot [0.1, 0.03, 0.001, 0.0001], [0.2, 0.1, 0.1, 0.09] over rates to \"e.svg\" { log: xy, band: [0.00005, 0.05], title: \"a < b\" }",
    );
    let mut page = browser.open_file(&place.path("r/e.svg"), (1280, 900), Scheme::Light);
    page.wait_for("document.querySelector('polyline')");
    assert_eq!(page.errors(), Vec::<String>::new());
    if let Some(folder) = std::env::var_os("DSCENE_SCREENSHOTS") {
        page.screenshot(&Path::new(&folder).join("plot.png"));
    }
    assert_eq!(page.number("document.querySelectorAll('polyline.curve').length"), 2.0);
    assert_eq!(page.text("document.querySelector('title').textContent"), "a < b");
    // All words are within the picture, and none lies upon another.
    let boxes = "[...document.querySelectorAll('text')].map((t) => t.getBoundingClientRect())";
    let inside = "(b) => b.left >= 0 && b.top >= 0 && b.right <= 640 && b.bottom <= 400";
    assert_eq!(page.number(&format!("{boxes}.filter((b) => !({inside})(b)).length")), 0.0);
    let meet = "p.right > q.left && q.right > p.left && p.bottom > q.top && q.bottom > p.top";
    let pairs = format!("((b) => b.flatMap((p, i) => b.slice(i + 1).filter((q) => {meet})).length)({boxes})");
    assert_eq!(page.number(&pairs), 0.0);
}
