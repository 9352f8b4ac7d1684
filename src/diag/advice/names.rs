//! What arguments, functions, types and colours are called elsewhere, and here.

/// The field or argument that `name` is called here, given what the callee has.
pub fn field(name: &str, known: &[&str]) -> Option<&'static str> {
    let candidates: &[&'static str] = match name.to_lowercase().as_str() {
        "albedo" | "kd" | "rho" | "diffuse_reflectance" | "base_colour" | "basecolor" => {
            &["reflectance", "diffuse", "base_color"]
        }
        "color" | "colour" => &["reflectance", "base_color", "radiance", "intensity", "irradiance", "diffuse"],
        "ks" | "specular_reflectance" => &["specular", "reflectance"],
        "alpha" => &["roughness", "opacity"],
        "eta" | "int_ior" | "refractive_index" | "index_of_refraction" | "n" => &["ior"],
        "dim" | "dims" | "axes" => &["axis"],
        "clearcoat" | "clearcoat_weight" | "coat_weight" => &["coat"],
        "clearcoat_roughness" => &["coat_roughness"],
        "sheen_color" | "sheen_colour" | "sheen_weight" | "sheen_tint" => &["sheen"],
        "anisotropic" | "anisotropy_strength" => &["anisotropy"],
        "anisotropy_rotation" => &["turn"],
        "bump" | "bump_map" | "height_map" => &["heights"],
        "mask" | "weights" => &["weight"],
        "glossiness" | "shininess" | "exponent" => &["roughness"],
        "normal" | "normal_texture" | "map" | "texture" => &["normals"],
        "opacity_map" | "alpha_map" | "coverage" | "transparency" => &["opacity"],
        "ies" | "ies_file" | "photometry" | "distribution" => &["profile"],
        "bsdf" | "brdf" | "shader" => &["material"],
        "geometry" | "shape" | "primitive" | "model" => &["mesh"],
        "lookat" | "target" | "center" | "at" | "focus_point" => &["look_at"],
        "origin" | "eye" | "pos" | "location" | "from" => &["position"],
        "window" | "region" | "crop_window" | "viewport" | "roi" => &["crop"],
        "rfilter" | "pixel_filter" | "reconstruction_filter" => &["filter"],
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
        "freeze" | "fixed" | "locked" => &["frozen"],
        "indices" | "triangles" | "tris" => &["faces"],
        "points" | "positions" | "verts" => &["vertices"],
        "texcoords" | "uv" | "st" => &["uvs"],
        "filename" | "file" => &["path", "source", "image"],
        "r" => &["radius"],
        "radius" => &["distance"],
        "w" => &["width"],
        "h" => &["height"],
        "width" | "height" => &["film"],
        "length" => &["depth", "height"],
        "segments" | "resolution_u" | "detail" | "level" | "levels" | "sides" => &["subdivisions"],
        "by" | "amount" | "vector" | "translation" => &["offset", "factor"],
        _ => &[],
    };
    candidates.iter().find(|c| known.contains(c)).copied()
}

/// What is set in a solver, not in `optimize`: the solver and its setting.
pub fn solver_setting(name: &str) -> Option<(&'static str, &'static str)> {
    Some(match name.to_lowercase().as_str() {
        "lr" | "learning_rate" | "rate" | "step_size" | "stepsize" => ("adam", "lr"),
        "beta1" | "beta_1" => ("adam", "beta1"),
        "beta2" | "beta_2" => ("adam", "beta2"),
        "epsilon" | "eps" => ("adam", "epsilon"),
        "momentum" => ("sgd", "momentum"),
        "nesterov" => ("sgd", "nesterov"),
        "damping" => ("levenberg_marquardt", "damping"),
        _ => return None,
    })
}

/// What to write in a stage or in `optimize` in place of a list of what stands still.
pub fn standing_still(name: &str) -> Option<&'static str> {
    let is_list = ["freeze", "frozen", "fixed", "locked", "except"].contains(&name.to_lowercase().as_str());
    is_list.then_some("say what moves, all else stands still: `over: […]`")
}

/// The functions of lights, those first that need the least.
pub const LIGHTS: [&str; 6] = ["constant", "directional", "point", "spot", "environment", "area"];

/// The light that has such an argument, which the fields of `light NAME { … }` (an area light) have not.
pub fn light_with(argument: &str) -> Option<&'static str> {
    Some(match argument {
        "position" | "intensity" | "profile" => "point",
        "direction" | "irradiance" => "directional",
        "cutoff" | "beam" => "spot",
        "image" | "rotation" => "environment",
        _ => return None,
    })
}

/// The function around a material that says what elsewhere an argument of the material does.
pub fn around_material(argument: &str) -> Option<&'static str> {
    Some(match argument.to_lowercase().as_str() {
        "clearcoat" | "clearcoat_weight" | "clearcoat_roughness" | "coat" | "coat_weight" | "coat_roughness" => {
            "coated"
        }
        "sheen" | "sheen_color" | "sheen_colour" | "sheen_weight" | "sheen_tint" | "sheen_roughness" => "sheened",
        "anisotropy" | "anisotropic" | "anisotropy_strength" | "anisotropy_rotation" | "alpha_u" | "alpha_v" => {
            "brushed"
        }
        "normal" | "normals" | "normal_map" | "normal_texture" => "normal_map",
        "bump" | "bump_map" | "height_map" => "bump",
        "opacity" | "opacity_map" | "mask" | "cutout" => "mask",
        "one_sided" => "one_sided",
        _ => return None,
    })
}

/// What a light or a material has for an argument that it has not: a point with a profile is turned.
pub fn elsewhere(model: &str, argument: &str) -> Option<&'static str> {
    match (model, argument.to_lowercase().as_str()) {
        ("principled" | "diffuse" | "plastic", "transmission" | "spec_trans" | "translucency" | "transmittance") => {
            Some(
                "a `blend` with a frosted pane lets light through: `blend(…, thin_dielectric(tint: …, roughness: …), weight: …)`",
            )
        }
        ("point", "direction" | "aim" | "target" | "look_at" | "to" | "axis") => {
            Some("a `profile` is turned by `rotation: aim(…)`; light in a cone is a `spot`")
        }
        _ => None,
    }
}

/// Whether an argument is elsewhere the point at which a light is aimed, which here has a direction.
pub fn is_aim(light: &str, argument: &str) -> bool {
    let is_point = ["target", "look_at", "lookat", "aim", "to", "at"].contains(&argument.to_lowercase().as_str());
    matches!(light, "spot" | "directional") && is_point
}

/// The numbers of a colour that has a name elsewhere.
pub fn colour(name: &str) -> Option<&'static str> {
    Some(match name.to_lowercase().as_str() {
        "red" => "[1, 0, 0]",
        "green" | "lime" => "[0, 1, 0]",
        "blue" => "[0, 0, 1]",
        "white" => "[1, 1, 1]",
        "black" => "[0, 0, 0]",
        "gray" | "grey" => "[0.5, 0.5, 0.5]",
        "yellow" => "[1, 1, 0]",
        "cyan" | "aqua" => "[0, 1, 1]",
        "magenta" | "fuchsia" => "[1, 0, 1]",
        "orange" => "[1, 0.5, 0]",
        "purple" => "[0.5, 0, 0.5]",
        _ => return None,
    })
}

/// The function that `name` is called here.
pub fn function(name: &str) -> Option<&'static str> {
    Some(match name.to_lowercase().as_str() {
        "lambertian" | "lambert" | "matte" => "diffuse",
        "metal" | "roughconductor" | "ggx" => "conductor",
        "velvet" | "fabric" => "cloth",
        "sheen" | "charlie" | "fuzz" | "dust" => "sheened",
        "clearcoat" | "clear_coat" | "coat" | "varnish" | "lacquer" => "coated",
        "anisotropic" | "ward" | "grooves" => "brushed",
        "normalmap" | "normal_texture" | "normals_map" => "normal_map",
        "blendbsdf" | "blend_bsdf" | "mix_shader" | "mix_material" | "mixture" => "blend",
        "bumpmap" | "bump_map" | "height_map" => "bump",
        "sun_sky" | "daylight" | "hosek" | "preetham" | "nishita" => "sunsky",
        "cutout" | "alpha_mask" | "opacity_mask" => "mask",
        "plane" | "quad" | "rect" | "square" => "rectangle",
        "box" => "cube",
        "envmap" | "environment_map" | "infinite" | "ibl" => "environment",
        "emitter" | "area_light" | "arealight" => "area",
        "sun" | "distant" => "directional",
        "ambient" | "ambient_light" | "ambientlight" | "hemisphere" => "constant",
        "pointlight" | "point_light" | "goniometric" | "projector" | "ies" => "point",
        "load_ies" | "read_ies" | "ies_profile" | "photometry" => "load_profile",
        "perspective" | "sensor" | "pinhole" => "camera",
        "obj" | "ply" | "load_mesh" | "load_obj" | "import_mesh" => "load",
        "imread" | "read_image" | "open" => "load_image",
        "load_csv" | "read_csv" | "loadtxt" | "genfromtxt" | "read_table" => "load_table",
        "load_npy" | "read_npy" | "fromfile" => "load_array",
        "read_json" => "load_json",
        "bitmap" | "image_texture" => "texture",
        "gaussian" | "gaussian_blur" => "blur",
        "average" | "avg" => "mean",
        "maximum" | "fmax" => "max",
        "minimum" | "fmin" => "min",
        "fabs" | "absolute" => "abs",
        "ceiling" => "ceil",
        "sgn" | "signum" => "sign",
        "magnitude" => "norm",
        "normalise" | "normalized" | "normalised" | "unit_vector" => "normalize",
        "sorted" => "sort",
        "any_of" => "any",
        "all_of" => "all",
        "isnan" => "is_nan",
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
        "contact_sheet" | "make_grid" | "image_grid" | "tile" | "subplots" => "montage",
        "false_color" | "false_colour" | "falsecolor" | "colormap_image" | "cmap" | "apply_colormap" => "colormap",
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
        "l2_loss" | "mean_squared_error" | "mse_loss" | "mseloss" => "mse",
        "l1_loss" | "mae" | "l1loss" => "l1",
        "smooth_l1_loss" | "smooth_l1" | "huber_loss" => "huber",
        "texture2d" | "texture_sample" | "texture_lookup" => "sample",
        "ico_sphere" => "icosphere",
        "load_objs_as_meshes" | "load_ply" | "read_triangle_mesh" => "load",
        "numel" => "len",
        "spheregeometry" | "uv_sphere" => "sphere",
        "boxgeometry" => "cube",
        "planegeometry" => "rectangle",
        "cylindergeometry" => "cylinder",
        "torusgeometry" => "torus",
        "perspectivecamera" | "fovperspectivecameras" | "perspectivecameras" => "camera",
        "pointlights" => "point",
        "directionallight" | "directionallights" => "directional",
        "meshstandardmaterial" | "meshphysicalmaterial" => "principled",
        "meshlambertmaterial" | "meshbasicmaterial" => "diffuse",
        "iou" | "jaccard" | "dice" | "iou_loss" | "dice_loss" => "silhouette_iou",
        "lpips" | "lpips_loss" | "perceptual_loss" => "perceptual_error",
        "flip_loss" | "nvflip" => "flip_error",
        "bce" | "binary_cross_entropy" => "cross_entropy",
        "tv" | "tv_loss" => "total_variation",
        "edge_energy" | "edge_loss" | "mesh_edge_loss" => "edge_length_energy",
        "mesh_laplacian_smoothing" | "laplacian_loss" => "laplacian_energy",
        "mesh_normal_consistency" => "normal_consistency",
        "gradient_descent" => "sgd",
        "backward" | "gradients" => "grad",
        "move" | "shift" => "translate",
        "turn" => "rotate",
        "length_of" | "size" | "count" => "len",
        _ => return None,
    })
}

/// What is written in a `plot` for a field with that name.
pub fn plot_setting(name: &str) -> Option<&'static str> {
    Some(match name.to_lowercase().as_str() {
        "logx" | "log_x" | "semilogx" => "log: x",
        "logy" | "log_y" | "semilogy" | "yscale" | "scale" | "log_scale" | "logarithmic" => "log: y",
        "loglog" | "log_log" => "log: xy",
        "error" | "errors" | "yerr" | "std" | "error_band" | "errorbar" | "ci" => "band: …",
        "names" | "labels" | "label" => "legend: […]",
        "xlabel" | "x_title" | "xtitle" | "x_axis" | "x" => "x_label: \"…\"",
        "ylabel" | "y_title" | "ytitle" | "y_axis" | "y" => "y_label: \"…\"",
        "figsize" | "resolution" | "width" | "height" => "size: [640, 400]",
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
        "tensor" | "ndarray" => "scalar[]",
        "bsdf" | "brdf" => "material",
        "emitter" => "light",
        "sensor" => "camera",
        "quaternion" | "quat" => "rotation",
        _ => return None,
    })
}
