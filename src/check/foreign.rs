//! What other systems call our things, for "did you mean"; and what is planned but not there.

use crate::diag::Diagnostic;
use crate::source::Span;

/// The field or argument that `name` is called here, given what the callee has.
pub fn field(name: &str, known: &[&str]) -> Option<&'static str> {
    let candidates: &[&'static str] = match name.to_lowercase().as_str() {
        "albedo" | "kd" | "rho" | "diffuse_reflectance" | "base_colour" | "basecolor" => {
            &["reflectance", "diffuse", "base_color"]
        }
        "color" | "colour" => &["reflectance", "base_color", "radiance", "intensity", "irradiance", "diffuse"],
        "ks" | "specular_reflectance" => &["specular", "reflectance"],
        "alpha" => &["roughness", "opacity"],
        "glossiness" | "shininess" | "exponent" => &["roughness"],
        "opacity_map" | "alpha_map" | "coverage" | "transparency" => &["opacity"],
        "bsdf" | "brdf" | "shader" => &["material"],
        "geometry" | "shape" | "primitive" | "model" => &["mesh"],
        "lookat" | "target" | "center" | "at" | "focus_point" => &["look_at"],
        "origin" | "eye" | "pos" | "location" | "from" => &["position"],
        "sensor" | "resolution" | "size" | "pixels" | "image_size" => &["film", "camera"],
        "fovy" | "field_of_view" | "angle" | "fov_y" => &["fov"],
        "fovx" => &["fov_x"],
        "cutoff_angle" | "outer_angle" | "outer_cone_angle" | "cone_angle" => &["cutoff"],
        "beam_width" | "inner_angle" | "inner_cone_angle" => &["beam"],
        "aperture_radius" | "lens_radius" => &["aperture"],
        "focus_distance" | "focal_distance" | "focus_depth" => &["focus"],
        "distortion_params" | "dist_coeffs" | "radial_distortion" | "lens_distortion" => &["distortion"],
        "shutter_open" | "shutter_close" | "exposure" => &["shutter"],
        "type" | "projection" | "model_type" => &["kind"],
        "to_world" | "matrix" | "pose" => &["transform"],
        "emission" | "power" | "intensity" | "energy" | "strength" | "le" => &["radiance", "intensity", "irradiance"],
        "emitters" | "lamps" => &["lights"],
        "objects" | "meshes" => &["shapes"],
        "samples" | "sample_count" | "samples_per_pixel" | "num_samples" => &["spp"],
        "max_depth" | "depth" | "bounces" | "maxdepth" => &["max_bounces"],
        "learning_rate" | "rate" | "step_size" | "stepsize" => &["lr"],
        "beta_1" => &["beta1"],
        "beta_2" => &["beta2"],
        "eps" => &["epsilon"],
        "optimizer" | "optimiser" | "with" | "solver" | "method" => &["using"],
        "iterations" | "epochs" | "iters" | "max_steps" => &["steps"],
        "params" | "parameters" | "wrt" | "variables" => &["over"],
        "indices" | "triangles" | "tris" => &["faces"],
        "points" | "positions" | "verts" => &["vertices"],
        "texcoords" | "uv" | "st" => &["uvs"],
        "filename" | "file" => &["path", "source", "image"],
        "r" => &["radius"],
        "w" => &["width"],
        "h" => &["height"],
        "length" => &["depth", "height"],
        "segments" | "resolution_u" | "detail" | "level" | "levels" | "sides" => &["subdivisions"],
        "by" | "amount" | "vector" | "translation" => &["offset", "factor"],
        _ => &[],
    };
    candidates.iter().find(|c| known.contains(c)).copied()
}

/// The light that has such an argument, which the fields of `light NAME { … }` (an area light) have not.
pub fn light_with(argument: &str) -> Option<&'static str> {
    Some(match argument {
        "position" | "intensity" => "point",
        "direction" | "irradiance" => "directional",
        "cutoff" | "beam" => "spot",
        "image" | "rotation" => "environment",
        _ => return None,
    })
}

/// The function that `name` is called here.
pub fn function(name: &str) -> Option<&'static str> {
    Some(match name.to_lowercase().as_str() {
        "lambertian" | "lambert" | "matte" => "diffuse",
        "metal" | "roughconductor" | "ggx" => "conductor",
        "cutout" | "alpha_mask" | "opacity_mask" => "mask",
        "plane" | "quad" | "rect" | "square" => "rectangle",
        "box" => "cube",
        "envmap" | "environment_map" | "infinite" | "sky" | "ibl" => "environment",
        "emitter" | "area_light" | "arealight" => "area",
        "sun" | "distant" => "directional",
        "pointlight" | "point_light" => "point",
        "perspective" | "sensor" | "pinhole" => "camera",
        "obj" | "ply" | "load_mesh" | "load_obj" | "import_mesh" => "load",
        "imread" | "read_image" | "open" => "load_image",
        "bitmap" | "image_texture" => "texture",
        "gaussian" | "gaussian_blur" => "blur",
        "average" | "avg" => "mean",
        "stddev" | "standard_deviation" => "std",
        "var" => "variance",
        "quantile" => "percentile",
        "clip" | "saturate" => "clamp",
        "fmod" | "modulo" | "remainder" => "mod",
        "select" | "cond" | "ifelse" => "where",
        "inv" | "invert" => "inverse",
        "det" => "determinant",
        "quat" => "quaternion",
        "cat" | "append" | "hstack" | "vstack" | "concatenate" => "concat",
        "grid_sample" | "bilinear" => "sample",
        "linear_to_srgb" => "to_srgb",
        "srgb_to_linear" => "from_srgb",
        "bbox" | "bounding_box" | "aabb" => "bounds",
        "chamfer_distance" => "chamfer",
        "center_of_mass" | "barycenter" => "centroid",
        "project_points" | "world_to_screen" => "project",
        "lerp" => "mix",
        "ln" => "log",
        "sqr" | "square_root" => "sqrt",
        "arcsin" => "asin",
        "arccos" => "acos",
        "arctan" => "atan",
        "arctan2" => "atan2",
        "l2_loss" | "mean_squared_error" => "mse",
        "l1_loss" | "mae" => "l1",
        "gradient_descent" => "sgd",
        "backward" | "gradients" => "grad",
        "move" | "shift" => "translate",
        "turn" => "rotate",
        "length_of" | "size" | "count" => "len",
        _ => return None,
    })
}

/// The type that `name` is called here.
pub fn type_name(name: &str) -> Option<&'static str> {
    Some(match name.to_lowercase().as_str() {
        "float" | "double" | "real" | "f32" | "f64" | "num" => "scalar",
        "integer" | "i32" | "usize" => "int",
        "boolean" => "bool",
        "str" | "text" => "string",
        "rgb" | "colour" | "spectrum" => "color",
        "point3" | "vector3" | "float3" | "vector" | "point" => "vec3",
        "point2" | "float2" | "vector2" => "vec2",
        "matrix" | "mat" => "mat4",
        "bsdf" | "brdf" => "material",
        "emitter" => "light",
        "sensor" => "camera",
        "quaternion" | "quat" => "rotation",
        _ => return None,
    })
}

/// What the language will have and this version has not.
pub fn is_planned(name: &str) -> bool {
    const FUNCTIONS: &str = "dielectric plastic emissive blend normal_map bump motion decimate unwrap \
                             lbfgs gauss_newton levenberg_marquardt classifier laplacian medium";
    const FIELDS: &str = "focal sensor_width crop filter";
    FUNCTIONS.split_whitespace().chain(FIELDS.split_whitespace()).any(|planned| planned == name)
}

/// Something that is planned was used.
pub fn unavailable(name: &str, span: Span) -> Diagnostic {
    Diagnostic::error("dscene::feature::unavailable", format!("`{name}` is not available yet"))
        .label(span, "not in this version")
}
