//! The fields that are no arguments of a function: of `optimize` and its stages, of params and of plots.

/// What has such fields.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    Optimize,
    Stage,
    Param,
    Plot,
}

/// Where a field stands, its name and what it is.
const TABLE: [(&[Place], &str, &str); 24] = [
    (
        &[Place::Optimize, Place::Stage],
        "over",
        "What moves: one param, or a list of them and of their parts. Without it, every param that reaches the loss and is not frozen.",
    ),
    (&[Place::Optimize, Place::Stage], "using", "The solver and its settings: `adam(lr: 0.02)`."),
    (&[Place::Optimize, Place::Stage], "steps", "The number of steps."),
    (
        &[Place::Optimize, Place::Stage],
        "stop_when",
        "Ends a stage before its last step once this is true: `loss < 1e-4`, `converged()`. The next one follows; the last one ends the whole.",
    ),
    (&[Place::Optimize], "starts", "Draws the params this many times within their bounds, and goes on with the best."),
    (&[Place::Optimize], "heat", "Steps that each of the `starts` takes before they are compared."),
    (&[Place::Optimize, Place::Stage], "clip", "Gradients that are longer than this are shortened to it."),
    (
        &[Place::Optimize, Place::Stage],
        "spp",
        "Samples a pixel of every render of the loss: a number, or `auto(error: 5%)`.",
    ),
    (
        &[Place::Optimize, Place::Stage],
        "film_scale",
        "Scales the images that are rendered: 0.5 halves their width and height.",
    ),
    (
        &[Place::Optimize, Place::Stage],
        "blur",
        "Smooths what losses such as `mse` compare: the standard deviation of a Gaussian, in pixels, which may be a schedule.",
    ),
    (&[Place::Optimize, Place::Stage], "max_bounces", "The number of scattering events of every render of the loss."),
    (
        &[Place::Optimize, Place::Stage],
        "control_variates",
        "Whether steps learn from one another, where noise would bias a loss.",
    ),
    (&[Place::Param], "lr", "A factor of the solver's rate, for this param. Solvers of least squares have none."),
    (&[Place::Param], "scale", "The length of a typical change of this param: steps are counted in it."),
    (
        &[Place::Param],
        "space",
        "The coordinates in which it is optimised: `interior` (bounds are never reached), `positive` (logarithms) or `unit` (directions).",
    ),
    (&[Place::Param], "precondition", "How steps of neighbouring numbers go together: `laplacian(mesh)`, `pyramid()`."),
    (&[Place::Param], "frozen", "Whether it stays as it is unless `over` names it."),
    (&[Place::Plot], "log", "The axes that are logarithmic: `x`, `y` or `xy`."),
    (&[Place::Plot], "band", "Half the height of a band around the curve, such as a standard error."),
    (&[Place::Plot], "title", "What stands above the plot."),
    (&[Place::Plot], "x_label", "What stands at the x axis."),
    (&[Place::Plot], "y_label", "What stands at the y axis."),
    (&[Place::Plot], "legend", "The names of the curves."),
    (&[Place::Plot], "size", "Width and height in pixels."),
];

/// The fields of a place with what they are.
pub fn fields(place: Place) -> impl Iterator<Item = (&'static str, &'static str)> {
    TABLE.iter().filter(move |(places, ..)| places.contains(&place)).map(|(_, name, doc)| (*name, *doc))
}

/// What a field is.
pub fn doc(name: &str) -> Option<&'static str> {
    TABLE.iter().find(|(_, n, _)| *n == name).map(|(.., doc)| *doc)
}

/// What a statement, or a part of `optimize`, does.
const STATEMENTS: [(&str, &str); 26] = [
    ("test", "Holds what `dsl test` expects of the declarations of the file: `test \"name\" { expect … }`."),
    (
        "import",
        "Brings the declarations of a file, `import \"lib.dscene\"`, or of a module, under a name if there is one: `as lib`.",
    ),
    ("let", "Names a value."),
    ("param", "Names a number that is unknown: `optimize` finds it, and derivatives may be taken with respect to it."),
    ("fn", "Declares a function."),
    ("optimize", "Moves params until a loss is small."),
    ("save", "Writes a value into a file: `save render(eye) to \"eye.png\"`."),
    ("print", "Shows values."),
    ("plot", "Draws curves, on the terminal or into a file."),
    ("expect", "Fails the run if a condition does not hold."),
    ("sweep", "Runs what is in its braces for every combination of values."),
    ("report", "Says which columns the table of a sweep has."),
    ("camera", "Declares who looks."),
    ("material", "Declares how a surface reflects light."),
    ("texture", "Declares an image over a surface."),
    ("mesh", "Declares a triangle mesh."),
    ("shape", "Declares a mesh with its material, a part of the scene."),
    ("light", "Declares a light, a part of the scene."),
    ("medium", "Declares what light passes through."),
    ("scene", "Declares a scene in place of the file's own."),
    ("integrator", "Declares how all renders of the file compute light."),
    ("loss", "Names a number that is to be small."),
    ("stage", "A part of an `optimize` with settings of its own."),
    ("every", "Actions after each so many steps."),
    ("then", "What is declared anew where a stage ends."),
    ("native", "Declares a function of the library that is written in Rust."),
];

/// What a statement does; nothing for other words.
pub fn statement_doc(word: &str) -> &'static str {
    STATEMENTS.iter().find(|(w, _)| *w == word).map_or("", |(_, doc)| doc)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check;

    #[test]
    fn every_field_that_the_checker_knows_is_told() {
        let told = |place| fields(place).map(|(name, _)| name).collect::<Vec<&str>>();
        let mut optimize = told(Place::Optimize);
        let mut known = check::actions::OPTIMIZE.to_vec();
        optimize.sort_unstable();
        known.sort_unstable();
        assert_eq!(optimize, known);
        let mut stage = told(Place::Stage);
        let mut known = check::stages::STAGE.to_vec();
        stage.sort_unstable();
        known.sort_unstable();
        assert_eq!(stage, known);
        assert_eq!(told(Place::Param), check::params::SETTINGS);
        assert_eq!(told(Place::Plot), check::plot::SETTINGS);
        for word in crate::syntax::statement_words() {
            assert!(!statement_doc(word).is_empty(), "{word}");
        }
    }
}
