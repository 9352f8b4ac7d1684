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
const TABLE: [(&[Place], &str, &str); 23] = [
    (
        &[Place::Optimize, Place::Stage],
        "over",
        "What moves: one param, or a list of them and of their parts. Without it, every param that reaches the loss and is not frozen.",
    ),
    (&[Place::Optimize, Place::Stage], "using", "The solver and its settings: `adam(lr: 0.02)`."),
    (&[Place::Optimize, Place::Stage], "steps", "The number of steps."),
    (&[Place::Optimize], "stop_when", "Ends before the last step once this is true: `loss < 1e-4`, `converged()`."),
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
    (&[Place::Optimize, Place::Stage], "max_bounces", "The number of scattering events of every render of the loss."),
    (
        &[Place::Optimize, Place::Stage],
        "control_variates",
        "Whether steps learn from one another, where noise would bias a loss.",
    ),
    (&[Place::Param], "lr", "A factor of the solver's rate, for this param."),
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
    }
}
