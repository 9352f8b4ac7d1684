//! Materials by the names and in the places that other tools have for them.

use super::Case;

pub const CASES: &[Case] = &[
    Case {
        name: "around_materials",
        prelude: "",
        script: "\
material a = principled(base_color: 0.5, clearcoat: 1)
material b = plastic(diffuse: 0.5, bump: image([[0, 1]]))
material c = diffuse(opacity: 0.5)
material d = conductor(roughness: 0.2, anisotropy: 0.5)",
        wanted: &[
            ("dscene::call::unknown_argument", "clearcoat", "`coated(principled(base_color: 0.5), coat: 1)`"),
            ("dscene::call::unknown_argument", "bump", "`bump(plastic(diffuse: 0.5), heights: image([[0, 1]]))`"),
            ("dscene::call::unknown_argument", "opacity", "`mask(diffuse(), opacity: 0.5)`"),
            ("dscene::call::unknown_argument", "anisotropy", "`brushed(conductor(roughness: 0.2), anisotropy: 0.5)`"),
        ],
    },
    Case {
        name: "what_lets_light_through",
        prelude: "",
        script: "\
material a = principled(base_color: 0.5, transmission: 0.4)
material b = blend(diffuse(), thin_dielectric(), weight: 0.4)",
        wanted: &[
            ("dscene::call::unknown_argument", "transmission", "thin_dielectric(tint: …, roughness: …)"),
            ("dscene::value::refused", "thin_dielectric()", "`thin_dielectric(roughness: 0, …)` can be blended"),
        ],
    },
    Case {
        name: "blends",
        prelude: "",
        script: "\
let rusty = blend(conductor(), diffuse(), weight: 0.5)
print rusty.reflectance, rusty.b.reflectance
material a = mix_shader(conductor(), diffuse())
material b = blend(conductor(), 0.5)
material c = blend(conductor(), diffuse(), weight: 2)",
        wanted: &[
            ("dscene::name::field", "reflectance", "it has: `a`, `b`, `weight`"),
            ("dscene::name::unknown", "mix_shader", "did you mean `blend`?"),
            ("dscene::type::mismatch", "0.5", "diffuse(reflectance: 0.5)"),
            ("dscene::value::range", "2", ""),
        ],
    },
    Case {
        name: "masks_by_other_names",
        prelude: "",
        script: "\
material a = mask(diffuse(reflectance: 0.5), alpha: 0.5)
material b = cutout(diffuse(), opacity: 0.5)
material c = mask(diffuse())
material d = mask(0.5, opacity: 0.5)
material e = mask(diffuse(), opacity: image([[0.5]]))",
        wanted: &[
            ("dscene::call::unknown_argument", "alpha", "did you mean `opacity`?"),
            ("dscene::name::unknown", "cutout", "did you mean `mask`?"),
            ("dscene::call::missing", "mask", ""),
            ("dscene::type::mismatch", "0.5", "diffuse(reflectance: 0.5)"),
            ("dscene::type::mismatch", "image([[0.5]])", "texture(image([[0.5]]))"),
        ],
    },
];
