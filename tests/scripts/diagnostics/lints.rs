//! Targets that are hard to match, and fields that files lack.

use super::{Case, SCENE};

pub const CASES: &[Case] = &[
    Case {
        name: "noisy_targets",
        prelude: SCENE,
        script: "\
camera side { position: [4, 1, 0], look_at: [0, 0, 0], fov: 45deg, film: [64, 64] }
let photos = [render(v, spp: 8) for v in [eye, side]] with { size: 0.5 }
loss all = mean([l1(blur(render(v, spp: 32), 2), blur(t, 2)) for v, t in zip([eye, side], photos)])
// allow(noisy_target): to show it
let coarse = render(eye, spp: 1) with { size: 0.5 }
loss shown = mse(render(eye, spp: 2), coarse)",
        wanted: &[("dscene::lint::noisy_target", "render(v, spp: 8)", "`spp: 512`")],
    },
    Case {
        name: "clipped_targets",
        prelude: SCENE,
        script: "\
let photo = load_image(\"docs/book/src/pictures/cornell.png\")
param exposure = 1
loss bright = mse(exposure * render(eye, spp: 4), photo)
loss fine = mse(min(exposure * render(eye, spp: 4), 1), photo)",
        wanted: &[(
            "dscene::lint::clipped_target",
            "\"docs/book/src/pictures/cornell.png\"",
            "min(exposure * render(eye, spp: 4), 1)",
        )],
    },
    Case {
        name: "fields_that_a_file_lacks",
        prelude: "",
        script: "\
let data = load_json(\"docs/book/scripts/cookbook/transforms.json\")
print data.camera_angel_x, [f.transform_matrx for f in data.frames], data.frames[0].transform_matrix",
        wanted: &[
            ("dscene::lint::missing_field", "camera_angel_x", "did you mean `camera_angle_x`?"),
            ("dscene::lint::missing_field", "transform_matrx", "did you mean `transform_matrix`?"),
        ],
    },
    Case {
        name: "angles_of_a_file",
        prelude: "",
        script: "\
let data = load_json(\"docs/book/scripts/cookbook/transforms.json\")
camera eye { fov_x: data.camera_angle_x, film: [8, 8] }
print data.camera_angle_x < 90deg, cos(data.camera_angle_x * 1rad)",
        wanted: &[
            ("dscene::lint::missing_unit", "data.camera_angle_x", "`data.camera_angle_x * 1rad`"),
            ("dscene::lint::missing_unit", "data.camera_angle_x", "`data.camera_angle_x * 1deg`"),
        ],
    },
];
