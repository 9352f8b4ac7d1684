//! Mesh and scene files: what a file says is done, or told once by name at the `load` that met it.

use std::f32::consts::FRAC_PI_2;

use dscene::image::Image;
use dscene::image::file::encode_png;
use dscene::mesh::Mesh;
use dscene::mesh::load::{
    Clear, Loaded, LoadedLightKind, LoadedMaterial, LoadedPart, LoadedProjection, Wanted, load, load_cameras,
};
use dscene::render::texture::Wrap;
use glam::{DVec3, Vec3, vec2, vec3};
use serde_json::{Value, json};

use crate::gltf::Builder;
use crate::place::{Place, assert_code, assert_diagnosed, stderr, stdout};

pub fn read(place: &Place, name: &str) -> Loaded {
    load(&place.path(name), Wanted::Scene).unwrap_or_else(|e| panic!("{e}"))
}

fn area(mesh: &Mesh) -> f32 {
    let triangle = |f: usize| {
        let [a, b, c] = mesh.triangle(f);
        (b - a).cross(c - a).length() / 2.0
    };
    (0..mesh.faces.len()).map(triangle).sum()
}

pub fn only(loaded: &Loaded) -> &LoadedPart {
    assert_eq!(loaded.parts.len(), 1);
    &loaded.parts[0]
}

/// A picture of one texel.
pub fn dot(texel: &[f32]) -> Vec<u8> {
    encode_png(&Image { width: 1, height: 1, channels: texel.len(), data: texel.to_vec() }).unwrap()
}

// ---- MTL -----------------------------------------------------------------------------------------------------------

const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n";

/// The material that an MTL file gives to a square, and what is told.
pub fn material(place: &Place, mtl: impl AsRef<[u8]>) -> (LoadedMaterial, Loaded) {
    place.write("m.mtl", mtl);
    place.write("a.obj", format!("mtllib m.mtl\n{SQUARE}usemtl m\nf 1/1 2/2 3/3 4/4\n"));
    let loaded = read(place, "a.obj");
    let material = only(&loaded).material.as_ref().expect("there is a material");
    ((**material).clone(), loaded)
}

#[test]
fn an_odd_line_of_a_material_loses_nothing_but_itself() {
    let place = Place::new();
    let (m, loaded) = material(&place, "newmtl m\nKd 0.5\nillum 2.0\nNs 6\nKe 0 0 2\n");
    assert_eq!((m.base_color, m.emissive, m.roughness), (Vec3::splat(0.5), vec3(0.0, 0.0, 2.0), 0.5f32.sqrt()));
    assert_eq!(loaded.warnings, Vec::<String>::new());
    let (m, loaded) =
        material(&place, "newmtl m\nKd 1 1\nNs abc\nillum 0.5\nfoo 3\nKe 1 2 3\nKd 0.1 0.2 0.3 # brown\n");
    assert_eq!((m.base_color, m.emissive), (vec3(0.1, 0.2, 0.3), vec3(1.0, 2.0, 3.0)));
    let expected = [
        "lines that cannot be understood are left out: `Kd 1 1` (line 2 of “m.mtl”), `Ns abc` (line 3 of “m.mtl”), \
         `illum 0.5` (line 4 of “m.mtl”)",
        "statements of materials are left out: `foo 3` (line 5 of “m.mtl”)",
    ];
    assert_eq!(loaded.warnings, expected);
}

#[test]
fn materials_mean_what_their_letters_say() {
    let place = Place::new();
    place.write("red dot.png", dot(&[1.0, 0.0, 0.0]));
    place.write("half.png", dot(&[0.5, 0.5, 0.5]));
    let of = |mtl: &str| material(&place, format!("\u{feff}newmtl m\n{mtl}"));
    // A blank in a name, and options before it; colours beside an image are mostly left at black.
    let (m, loaded) = of("Kd 0 0 0\nmap_Kd -s 2 3 -o 0.5 0.25 -clamp on red dot.png\n");
    assert_eq!(loaded.warnings, Vec::<String>::new());
    assert_eq!(m.base_color_texels().image.data, [1.0, 0.0, 0.0]);
    assert!(m.base_color_image.as_ref().unwrap().wrap == Wrap::Clamp);
    // (1, 1) in the file is (2.5, 3.25), which counted downwards is (2.5, −2.25).
    assert_eq!(only(&loaded).mesh.uvs.as_ref().unwrap()[2], vec2(2.5, -2.25));
    let opacity = |m: &LoadedMaterial| m.opacity.as_ref().map(|o| o.image.data[0]);
    assert_eq!(opacity(&of("d 0.25\n").0), Some(0.25));
    assert_eq!(opacity(&of("Tr 0.25\n").0), Some(0.75));
    assert_eq!(opacity(&of("d 1\nTr 1\n").0), None);
    let (m, _) = of("d 0.5\nmap_d half.png\nmap_Ke red dot.png\nPr 0.3\nPm 0.2\nKs 0.25 0.25 0.25\n");
    let mask = opacity(&m).unwrap();
    assert!((mask - 0.5 * 188.0 / 255.0).abs() < 1e-3, "a mask holds plain numbers: {mask}");
    assert_eq!(m.emissive_texels().unwrap().image.data, [1.0, 0.0, 0.0]);
    assert_eq!((m.roughness, m.metallic, m.specular), (0.3, 0.2, 0.5));
    assert!((of("Ni 2\n").0.specular - 1.0 / 9.0 / 0.04).abs() < 1e-5);
    assert_eq!(of("Ks 1 1 1\nillum 1\n").0.specular, 0.0);
    let (m, loaded) = of("norm half.png\n");
    assert_eq!(loaded.warnings, Vec::<String>::new());
    let normals = &m.normals.as_ref().unwrap().image;
    assert!(normals.channels == 3 && normals.data.iter().all(|x| (x - 188.0 / 255.0).abs() < 1e-3), "no colours");
    let (m, loaded) = of("Pc 0.5\nPcr 0.2\n");
    assert_eq!(loaded.warnings, Vec::<String>::new());
    assert_eq!(m.coat.map(|coat| (coat.weight, coat.roughness)), Some((0.5, 0.2)));
    assert_eq!(of("Pc 0\nPcr 0.2\n").0.coat, None);
    // Of glass only the index counts.
    let (m, loaded) = of("illum 7\nNi 1.33\nd 0.1\nnorm half.png\n");
    assert!(
        m.clear == Some(Clear::Body { ior: 1.33, absorption: Vec3::ZERO })
            && m.opacity.is_none()
            && m.normals.is_none(),
        "{m:?}"
    );
    let told = "glass (`illum` 4, 6, 7 and 9) is smooth and clear: its colour, roughness and images are left out: “m”";
    assert_eq!(loaded.warnings, [told]);
}

#[test]
fn material_libraries_may_be_late_many_or_missing() {
    let place = Place::new();
    place.write("my lib.mtl", "newmtl a b\nKd 1 0 0\n");
    place.write("x.mtl", "newmtl x\nKd 0 1 0\n");
    place.write("y.mtl", "newmtl x\nKd 0 0 0\nnewmtl y\nKd 0 0 1\n");
    let faces = "usemtl a b\nf 1 2 3\nusemtl x\nf 1 2 3\nusemtl y\nf 1 2 3\nusemtl\nf 1 2 3\nusemtl z\nf 1 2 3\n";
    place.write("a.obj", format!("{SQUARE}{faces}mtllib my lib.mtl\nmtllib x.mtl y.mtl\n"));
    let loaded = read(&place, "a.obj");
    let colors: Vec<Option<Vec3>> = loaded.parts.iter().map(|p| p.material.as_ref().map(|m| m.base_color)).collect();
    assert_eq!(colors, [Some(Vec3::X), Some(Vec3::Y), Some(Vec3::Z), None, None]);
    let expected = ["materials are defined twice, and the first counts: “x”", "materials are not defined: “z”"];
    assert_eq!(loaded.warnings, expected);
    place.write("b.obj", format!("mtllib none.mtl\n{SQUARE}usemtl a\nf 1 2 3\n"));
    assert_eq!(read(&place, "b.obj").warnings, ["material file “none.mtl”: there is no such file or folder"]);
}

// ---- OBJ -----------------------------------------------------------------------------------------------------------

#[test]
fn obj_text_comes_in_many_spellings() {
    let place = Place::new();
    place.write("lf.obj", "\u{feff}o thing\nv 0 0 0\nv 1 0 0 # corner\nv 0 1 0\nvt 0.5\nf -3/1 -2/1 \\\n -1/1\n");
    let loaded = read(&place, "lf.obj");
    assert_eq!((only(&loaded).name.as_str(), area(&only(&loaded).mesh)), ("thing", 0.5));
    assert_eq!(only(&loaded).mesh.uvs.as_ref().unwrap()[0], vec2(0.5, 1.0));
    place.write("cr.obj", b"# caf\xe9 \\\ro caf\xe9\rv 0 0 0\rv 1 0 0\rv 0 1 0\rv nan 0 0\rf 1 2 3\r");
    let loaded = read(&place, "cr.obj");
    assert_eq!((only(&loaded).name.as_str(), area(&only(&loaded).mesh)), ("café", 0.5));
    assert_eq!(loaded.warnings, Vec::<String>::new(), "a vertex that nothing uses may be anything");
    place.write("odd.obj", format!("{SQUARE}f 1 2 3\nl 1 2\ncurv 0 1 2\np 1\nbevel on\n"));
    let expected = [
        "points and lines are left out: line 10, line 12",
        "statements are left out: `curv` (line 11), `bevel` (line 13)",
    ];
    assert_eq!(read(&place, "odd.obj").warnings, expected);
    for (text, told) in [
        ("v 1 1 1 0.5", "weights and opacities of vertices and third texture coordinates are left out: `v` (line 9)"),
        (
            "v 1 1 1 0 0 1 0.5",
            "weights and opacities of vertices and third texture coordinates are left out: `v` (line 9)",
        ),
        ("vt 0 0 0.5", "weights and opacities of vertices and third texture coordinates are left out: `vt` (line 9)"),
        ("s smooth", "smoothing groups that are no number are taken as off: `s smooth` (line 9)"),
    ] {
        place.write("odd.obj", format!("{SQUARE}{text}\nf 1 2 3\n"));
        assert_eq!(read(&place, "odd.obj").warnings, [told]);
    }
    place.write("even.obj", format!("{SQUARE}v 1 1 1 1\nv 1 1 1 0 0 1 1\nvt 0 0 0\ns off\nf 1 2 3\n"));
    assert_eq!(read(&place, "even.obj").warnings, Vec::<String>::new());
    place.write("dark.obj", "v 0 0 0 -1 0 1\nv 1 0 0 1 1 1\nv 0 1 0 1 1 1\nf 1 2 3\n");
    let loaded = read(&place, "dark.obj");
    assert_eq!(only(&loaded).mesh.colors.as_ref().unwrap()[0], Vec3::Z);
    assert_eq!(loaded.warnings, ["colours of vertices below 0 are raised to it: “dark”"]);
    for (text, message) in [
        ("f 1 2 7", "line 9 of the OBJ file: there is no vertex 7; there are 4"),
        ("f 1 2 -5", "line 9 of the OBJ file: there is no vertex -5; there are 4"),
        ("f 1/9 2/1 3/1", "line 9 of the OBJ file: there is no texture coordinate 9; there are 4"),
        ("f 1 2", "line 9 of the OBJ file: a face of 2 corners"),
        ("v 1 x 2", "line 9 of the OBJ file: “x” is no number"),
        ("f 1 2 a", "line 9 of the OBJ file: “a” is no index"),
    ] {
        let path = place.write("bad.obj", format!("{SQUARE}{text}\n"));
        let found = load(&path, Wanted::Mesh).unwrap_err().to_string();
        assert!(found.ends_with(message), "{text}: {found}");
    }
}

#[test]
fn concave_polygons_are_not_fans() {
    let place = Place::new();
    place.write("a.obj", "v -1 0 0\nv 0 0.2 0\nv 1 0 0\nv 0 1 0\nf 1 2 3 4\n");
    assert!((area(&only(&read(&place, "a.obj")).mesh) - 0.8).abs() < 1e-6);
    let header = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
                  element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    place.write("a.ply", format!("{header}-1 0 0\n0 0.2 0\n1 0 0\n0 1 0\n4 0 1 2 3\n"));
    assert!((area(&only(&read(&place, "a.ply")).mesh) - 0.8).abs() < 1e-6);
}

#[test]
fn smoothing_groups_and_single_normals_are_kept() {
    let place = Place::new();
    // Two faces at a right angle along the edge of vertices 1 and 2, and a third that is flat.
    let corners = "v 0 0 0\nv 0 1 0\nv 1 0 0\nv 0 0 1\nv 0 0 -1\n";
    place.write("a.obj", format!("{corners}s 1\nf 1 3 2\nf 1 2 4\ns off\nf 2 1 5\n"));
    let mesh = &read(&place, "a.obj").parts[0].mesh;
    let normals = mesh.normals.as_ref().unwrap();
    let of = |face: usize, corner: usize| normals[mesh.faces[face][corner] as usize];
    let mean = (vec3(0.0, 0.0, 1.0) + vec3(1.0, 0.0, 0.0)).normalize();
    assert!((of(0, 0).abs() - mean).length() < 1e-6 && of(0, 0) == of(1, 0), "{}", of(0, 0));
    assert_eq!(of(2, 0).abs(), Vec3::X, "flat as it is asked to be");
    // Some with normals and uvs, some without: nothing is lost, and what is made up is told.
    place.write("b.obj", format!("{SQUARE}vn 0 1 0\nf 1/1/1 2/2/1 3/3/1\nf 1 3 4\n"));
    let loaded = read(&place, "b.obj");
    let mesh = &only(&loaded).mesh;
    let normals = mesh.normals.as_ref().unwrap();
    assert_eq!((normals[mesh.faces[0][0] as usize], normals[mesh.faces[1][0] as usize]), (Vec3::Y, Vec3::Z));
    assert_eq!(loaded.warnings, ["some faces have no texture coordinates and get [0, 0]: “b”"]);
}

#[test]
fn parts_merged_keep_what_only_some_have() {
    let place = Place::new();
    place.write("a.obj", format!("{SQUARE}vn 0 1 0\no a\nf 1//1 2//1 3//1\no b\nv 2 0 0 1 0 0\nf 1 5 4\n"));
    let (mesh, warnings) = read(&place, "a.obj").merged().unwrap();
    let normals = mesh.normals.unwrap();
    assert_eq!((normals[mesh.faces[0][0] as usize], normals[mesh.faces[1][0] as usize]), (Vec3::Y, Vec3::Z));
    let colors = mesh.colors.unwrap();
    assert_eq!((colors[mesh.faces[0][0] as usize], colors[mesh.faces[1][1] as usize]), (Vec3::ONE, Vec3::X));
    assert_eq!(warnings, Vec::<String>::new());
}

// ---- PLY -----------------------------------------------------------------------------------------------------------

const XYZ: &str = "property float x\nproperty float y\nproperty float z\n";

#[test]
fn ply_is_read_line_by_line() {
    let place = Place::new();
    let faces = "element face 2\nproperty list uchar int vertex_indices\nend_header\n";
    let header = format!("ply\nformat ascii 1.0\nelement vertex 4\n{XYZ}{faces}");
    // Every vertex has numbers that the header does not name.
    place.write("a.ply", format!("{header}0 0 0 9 9\n1 0 0 9 9\n1 1 0 9\n0 1 0\n\n3 0 1 2\n3 0 2 3\n"));
    let loaded = read(&place, "a.ply");
    assert_eq!((area(&only(&loaded).mesh), only(&loaded).mesh.vertices[3]), (1.0, Vec3::Y));
    let told = "lines have more numbers than the header says, which are left out: \
                “vertex” in line 10, “vertex” in line 11, “vertex” in line 12";
    assert_eq!(loaded.warnings, [told]);
    let path = place.write("b.ply", format!("{header}0 0 0\n1 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n"));
    let found = load(&path, Wanted::Mesh).unwrap_err().to_string();
    assert!(found.ends_with("line 11 of the PLY file has too few numbers"), "{found}");
    // An unused vertex may be anything, and line ends may be a lone carriage return.
    let text = format!("{header}0 0 0\n1 0 0\n1 1 0\nnan nan nan\n3 0 1 2\n3 0 1 2\n").replace('\n', "\r");
    place.write("c.ply", text);
    let loaded = read(&place, "c.ply");
    assert_eq!((only(&loaded).mesh.vertices.len(), area(&only(&loaded).mesh)), (3, 1.0));
}

#[test]
fn ply_strips_and_texture_coordinates_of_corners() {
    let place = Place::new();
    let corners = "0 0 0\n1 0 0\n0 1 0\n1 1 0\n";
    let strips = "element tristrips 1\nproperty list int int vertex_indices\nend_header\n";
    place
        .write("a.ply", format!("ply\nformat ascii 1.0\nelement vertex 4\n{XYZ}{strips}{corners}8 0 1 2 3 -1 2 1 3\n"));
    let loaded = read(&place, "a.ply");
    assert_eq!(only(&loaded).mesh.faces, [[0, 1, 2], [2, 1, 3], [2, 1, 3]]);
    let faces =
        "element face 2\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\nend_header\n";
    let rows = "3 0 1 2 6 0 0 1 0 0 1\n3 1 3 2 6 0.5 0 1 1 0 1\n";
    let header = format!("ply\nformat ascii 1.0\ncomment TextureFile dot.png\nelement vertex 4\n{XYZ}{faces}");
    place.write("b.ply", format!("{header}{corners}{rows}"));
    place.write("dot.png", dot(&[0.0, 1.0, 0.0]));
    let loaded = read(&place, "b.ply");
    let mesh = &only(&loaded).mesh;
    let uv = |face: usize, corner: usize| mesh.uvs.as_ref().unwrap()[mesh.faces[face][corner] as usize];
    assert_eq!((uv(0, 1), uv(1, 0), uv(0, 2)), (vec2(1.0, 1.0), vec2(0.5, 1.0), vec2(0.0, 0.0)));
    assert_eq!(mesh.vertices.len(), 5, "vertex 1 is doubled, vertex 2 is not");
    assert_eq!(only(&loaded).material.as_ref().unwrap().base_color_texels().image.data, [0.0, 1.0, 0.0]);
}

#[test]
fn ply_colours_are_bytes_or_linear() {
    let place = Place::new();
    let color = |kind: &str, row: &str| {
        let colors = ["red", "green", "blue"].map(|c| format!("property {kind} {c}\n")).concat();
        let faces = "element face 1\nproperty list uchar int vertex_indices\nend_header\n";
        let rows = format!("0 0 0 {row}\n1 0 0 {row}\n0 1 0 {row}\n3 0 1 2\n");
        place.write("a.ply", format!("ply\nformat ascii 1.0\nelement vertex 3\n{XYZ}{colors}{faces}{rows}"));
        let loaded = read(&place, "a.ply");
        (only(&loaded).mesh.colors.as_ref().unwrap()[0], loaded.warnings)
    };
    let half = 0.21586;
    let near = |found: Vec3, expected: Vec3| assert!((found - expected).length() < 1e-4, "{found}");
    near(color("uchar", "255 128 0").0, vec3(1.0, half, 0.0));
    near(color("float", "1 0.5 0").0, vec3(1.0, 0.5, 0.0));
    let (found, warnings) = color("float", "255 128 0");
    near(found, vec3(1.0, half, 0.0));
    assert_eq!(warnings, ["the vertex colours are whole numbers up to 255, and are taken to be bytes in sRGB"]);
    near(color("float", "2.5 1 0").0, vec3(2.5, 1.0, 0.0));
}

// ---- STL -----------------------------------------------------------------------------------------------------------

#[test]
fn stl_in_capitals_in_parts_and_with_a_misleading_header() {
    let place = Place::new();
    let facet = |z: u8| {
        format!(
            "FACET NORMAL 0 0 1\n OUTER LOOP\n  VERTEX 0 0 {z}\n  VERTEX 1 0 {z}\n  VERTEX 0 1 {z}\n ENDLOOP\nENDFACET\n"
        )
    };
    place.write("a.stl", format!("SOLID one\n{}ENDSOLID one\nsolid\n{}endsolid\n", facet(0), facet(2)));
    let loaded = read(&place, "a.stl");
    let names: Vec<&str> = loaded.parts.iter().map(|p| p.name.as_str()).collect();
    assert_eq!((names, loaded.parts[1].mesh.vertices[0].z), (vec!["one", "a"], 2.0));
    let mut binary = b"solid but binary".to_vec();
    binary.resize(80, b' ');
    binary.extend(1u32.to_le_bytes());
    for number in [0.0f32, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0] {
        binary.extend(number.to_le_bytes());
    }
    binary.extend([0, 0x80]);
    place.write("b.stl", &binary);
    let loaded = read(&place, "b.stl");
    assert_eq!(area(&only(&loaded).mesh), 0.5);
    assert_eq!(loaded.warnings, ["the colours of the triangles are left out"]);
    binary.extend([0, 0]);
    place.write("c.stl", &binary);
    assert_eq!(area(&only(&read(&place, "c.stl")).mesh), 0.5, "with bytes behind it");
}

// ---- glTF ----------------------------------------------------------------------------------------------------------

#[test]
fn gltf_with_a_mark_and_without_bounds_and_as_glb() {
    let place = Place::new();
    let mut file = Builder::new();
    let mesh = file.triangle(json!({}), json!({}));
    file.add("nodes", json!({"mesh": mesh, "name": "t", "translation": [0, 0, 3]}));
    file.add("scenes", json!({"name": "empty"}));
    place.write("a.gltf", format!("\u{feff}{}", file.text()));
    let loaded = read(&place, "a.gltf");
    assert_eq!(only(&loaded).mesh.vertices[1], vec3(1.0, 0.0, 3.0));
    assert_eq!(loaded.warnings, ["scenes beside the default one are left out: “empty”"]);
    place.write("a.glb", file.glb());
    assert_eq!(read(&place, "a.glb"), loaded);
    // A header that promises less than itself.
    let mut short = file.glb();
    short[8..12].copy_from_slice(&4u32.to_le_bytes());
    let path = place.write("b.glb", &short);
    let _ = load(&path, Wanted::Mesh);
}

#[test]
fn morph_targets_have_their_default_weights() {
    let place = Place::new();
    let mut file = Builder::new();
    let up = file.floats("VEC3", &[0.0, 0.0, 2.0].repeat(3));
    let right = file.floats("VEC3", &[4.0, 0.0, 0.0].repeat(3));
    let mesh = file.triangle(json!({}), json!({"targets": [{"POSITION": up}, {"POSITION": right}]}));
    file.json["meshes"][mesh]["weights"] = json!([0.5, 0.25]);
    file.add("nodes", json!({"mesh": mesh, "children": [1]}));
    file.add("nodes", json!({"mesh": mesh, "weights": [1, 0]}));
    place.write("a.gltf", file.text());
    let loaded = read(&place, "a.gltf");
    let first: Vec<Vec3> = loaded.parts.iter().map(|p| p.mesh.vertices[0]).collect();
    assert_eq!(first, [vec3(1.0, 0.0, 1.0), vec3(0.0, 0.0, 2.0)]);
    assert_eq!(loaded.warnings, Vec::<String>::new());
}

#[test]
fn skins_stand_as_their_joints_do() {
    let place = Place::new();
    let mut file = Builder::new();
    // Vertices 0 and 1 follow one joint each; vertex 2 follows both alike.
    let joints = file.bytes("VEC4", 4, &[0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0], false);
    let weights = file.floats("VEC4", &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.5, 0.5, 0.0, 0.0]);
    let normals = file.floats("VEC3", &[0.0, 0.0, 1.0].repeat(3));
    let attributes = json!({"JOINTS_0": joints, "WEIGHTS_0": weights, "NORMAL": normals});
    let mesh = file.triangle(attributes, json!({}));
    let mut bind = [[0.0f32; 16]; 2];
    for matrix in &mut bind {
        (0..4).for_each(|i| matrix[5 * i] = 1.0);
    }
    // The first joint was bound at (0, 0, 1).
    bind[0][14] = -1.0;
    let bind = file.floats("MAT4", &bind.concat());
    let turn = [(FRAC_PI_2 / 2.0).sin(), 0.0, 0.0, (FRAC_PI_2 / 2.0).cos()];
    file.add("nodes", json!({"mesh": mesh, "skin": 0, "translation": [100, 0, 0], "children": [1, 2]}));
    file.add("nodes", json!({"translation": [-100, 0, 4]}));
    file.add("nodes", json!({"translation": [-100, 0, 0], "rotation": turn}));
    file.add("skins", json!({"joints": [1, 2], "inverseBindMatrices": bind}));
    place.write("a.gltf", file.text());
    let loaded = read(&place, "a.gltf");
    let mesh = &only(&loaded).mesh;
    // The node's own transform, (100, 0, 0), counts for the joints, which are its children, but not for the mesh.
    let expected = [vec3(0.0, 0.0, 3.0), vec3(1.0, 0.0, 0.0), (vec3(0.0, 1.0, 3.0) + vec3(0.0, 0.0, 1.0)) / 2.0];
    for (found, expected) in mesh.vertices.iter().zip(expected) {
        assert!((*found - expected).length() < 1e-5, "{found} is not {expected}");
    }
    assert!((mesh.normals.as_ref().unwrap()[1] - vec3(0.0, -1.0, 0.0)).length() < 1e-5);
    assert_eq!(loaded.warnings, Vec::<String>::new());
}

#[test]
fn samplers_are_honoured_or_told() {
    let place = Place::new();
    place.write("dot.png", dot(&[1.0, 0.0, 0.0]));
    let look = |sampler: Value| {
        let mut file = Builder::new();
        file.add("images", json!({"uri": "dot.png"}));
        file.add("samplers", sampler);
        file.add("textures", json!({"source": 0, "sampler": 0}));
        file.add("materials", json!({"name": "m", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
        let mesh = file.triangle(json!({}), json!({"material": 0}));
        file.add("nodes", json!({"mesh": mesh}));
        place.write("a.gltf", file.text());
        let loaded = read(&place, "a.gltf");
        let image = only(&loaded).material.as_ref().unwrap().base_color_image.clone().unwrap();
        (image.wrap, image.nearest, loaded.warnings)
    };
    assert_eq!(look(json!({})), (Wrap::Repeat, false, vec![]));
    assert_eq!(look(json!({"wrapS": 33071, "wrapT": 33071, "magFilter": 9728})), (Wrap::Clamp, true, vec![]));
    assert_eq!(look(json!({"wrapS": 33648, "wrapT": 33648, "minFilter": 9984})), (Wrap::Mirror, false, vec![]));
    let told = "images that go on along one side in another way than along the other are repeated along both: “m”";
    for (s, t) in [(33648, 10497), (33071, 10497), (33071, 33648)] {
        assert_eq!(look(json!({"wrapS": s, "wrapT": t})), (Wrap::Repeat, false, vec![told.into()]));
    }
}

#[test]
fn lights_and_emitters_of_gltf() {
    let place = Place::new();
    let mut file = Builder::new();
    let lights = json!([
        {"type": "point", "name": "bulb", "color": [1, 0.5, 0], "intensity": 4, "range": 10},
        {"type": "directional", "intensity": 3},
        {"type": "spot", "intensity": 2, "spot": {"innerConeAngle": 0.2, "outerConeAngle": 0.6}},
        {"type": "spot", "name": "edge", "spot": {"innerConeAngle": 0.6, "outerConeAngle": 0.6}}
    ]);
    file.json["extensions"] = json!({"KHR_lights_punctual": {"lights": lights}});
    file.json["extensionsUsed"] = json!(["KHR_lights_punctual", "KHR_materials_unlit"]);
    file.json["extensionsRequired"] = json!(["KHR_lights_punctual", "KHR_made_up"]);
    file.add(
        "materials",
        json!({"name": "lamp", "emissiveFactor": [0, 1, 0.5],
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 4}}}),
    );
    file.add(
        "materials",
        json!({"name": "sign", "doubleSided": true, "extensions": {"KHR_materials_unlit": {}},
        "pbrMetallicRoughness": {"baseColorFactor": [0.2, 0.4, 0.6, 1]}}),
    );
    let (lamp, sign) =
        (file.triangle(json!({}), json!({"material": 0})), file.triangle(json!({}), json!({"material": 1})));
    // Looks along −z; turned by −90° about x that is −y.
    let turn = [-(FRAC_PI_2 / 2.0).sin(), 0.0, 0.0, (FRAC_PI_2 / 2.0).cos()];
    file.add("nodes", json!({"mesh": lamp, "children": [1, 2, 3, 4, 5], "scale": [2, 2, 2]}));
    for light in 0..4 {
        let extensions = json!({"KHR_lights_punctual": {"light": light}});
        file.add("nodes", json!({"translation": [1, 2, 3], "rotation": turn, "extensions": extensions}));
    }
    file.add("nodes", json!({"mesh": sign}));
    place.write("a.gltf", file.text());
    let loaded = read(&place, "a.gltf");
    let [bulb, sun, spot, edge] = loaded.lights.as_slice() else { panic!("{} lights", loaded.lights.len()) };
    assert_eq!((bulb.kind, bulb.intensity), (LoadedLightKind::Point, vec3(4.0, 2.0, 0.0)));
    assert_eq!(bulb.position, DVec3::new(2.0, 4.0, 6.0));
    assert_eq!((sun.kind, sun.intensity), (LoadedLightKind::Directional, Vec3::splat(3.0)));
    assert!((sun.direction - DVec3::NEG_Y).length() < 1e-6, "{}", sun.direction);
    assert_eq!(spot.kind, LoadedLightKind::Spot { beam: f64::from(0.2f32), cutoff: f64::from(0.6f32) });
    assert!(matches!(edge.kind, LoadedLightKind::Spot { beam, cutoff } if beam < cutoff));
    let materials: Vec<&LoadedMaterial> = loaded.parts.iter().map(|p| p.material.as_deref().unwrap()).collect();
    assert_eq!(materials[0].emissive, vec3(0.0, 4.0, 2.0));
    assert_eq!((materials[1].emissive, materials[1].base_color), (vec3(0.2, 0.4, 0.6), Vec3::ZERO));
    let expected = [
        "the file requires extensions that are not supported: KHR_made_up",
        "unlit materials (KHR_materials_unlit) shine with their colour: “sign”",
        "the range of lights is left out: they fall off with the square of the distance: “bulb”",
        "cones of light with a sharp edge get a narrow soft one: “edge”",
    ];
    let mut told = loaded.warnings.clone();
    told.sort_by_key(|t| expected.iter().position(|e| e == t));
    assert_eq!(told, expected);
    // In the language they are lights as any other.
    let script = "let s = load_scene(\"a.gltf\")\ncamera eye { position: [2, 4.5, 6], look_at: [2, 0, 6], up: [0, 0, 1], fov: 0.1deg, film: [1, 1] }\n\
                  let floor = shape(mesh: rectangle(width: 8, depth: 8) |> translate([2, 3, 6]), material: diffuse(reflectance: 1))\n\
                  let lit = render(eye, scene: scene(shapes: [floor], lights: [load_lights(\"a.gltf\")[2]]), max_bounces: 1)\n";
    place.write("s.dscene", script);
    let value = |expression: &str| {
        let output = place.dsl(&["eval", "s.dscene", expression, "--json"]);
        assert_code(&output, 0);
        serde_json::from_str::<Value>(&stdout(&output)).unwrap()["value"].clone()
    };
    assert_eq!(value("len(s.lights)"), 6.0);
    assert_eq!(value("s.lights[2].intensity"), json!([4.0, 2.0, 0.0]));
    assert_eq!(value("s.lights[3].irradiance"), json!([3.0, 3.0, 3.0]));
    // One unit below the bulb, 4 W/sr on a white floor.
    let lit = value("mean(lit.r)").as_f64().unwrap();
    assert!((lit - 4.0 / std::f64::consts::PI).abs() < 1e-3, "{lit}");
}

/// A normal map with its scale, and a body of glass; what else glass has is told.
#[test]
fn normal_maps_and_glass_of_gltf() {
    let place = Place::new();
    place.write("lean.png", dot(&[0.75, 0.5, 1.0]));
    let mut file = Builder::new();
    file.add("images", json!({"uri": "lean.png"}));
    file.add("textures", json!({"source": 0}));
    // (Without a `metallicFactor` a material of glTF is metal, which lets nothing through.)
    let glass = |name: &str, mut pbr: serde_json::Value, thickness: f64| {
        pbr["metallicFactor"] = json!(0);
        json!({"name": name, "pbrMetallicRoughness": pbr, "extensions": {
            "KHR_materials_transmission": {"transmissionFactor": 1}, "KHR_materials_ior": {"ior": 1.4},
            "KHR_materials_volume": {"thicknessFactor": thickness}}})
    };
    file.add("materials", json!({"name": "leather", "normalTexture": {"index": 0, "scale": 2}}));
    file.add("materials", glass("ball", json!({"roughnessFactor": 0}), 1.0));
    let mut bottle = glass("bottle", json!({"roughnessFactor": 0.2, "baseColorFactor": [0.5, 1, 1, 1]}), 1.0);
    let volume = &mut bottle["extensions"]["KHR_materials_volume"];
    (volume["attenuationDistance"], volume["attenuationColor"]) = (json!(0.5), json!([0.25, 0.5, 1]));
    file.add("materials", bottle);
    file.add("materials", glass("pane", json!({"roughnessFactor": 0}), 0.0));
    file.add(
        "materials",
        glass("frosted pane", json!({"roughnessFactor": 0.4, "baseColorFactor": [0.5, 1, 1, 1]}), 0.0),
    );
    for material in 0..5 {
        let mesh = file.triangle(json!({}), json!({"material": material}));
        file.add("nodes", json!({"mesh": mesh}));
    }
    file.json["scenes"] = json!([{"nodes": [0, 1, 2, 3, 4]}]);
    place.write("a.gltf", file.text());
    let loaded = read(&place, "a.gltf");
    let told = [
        "the surface of glass is clear: its colour, its metal and the images beside that of its roughness are left out: “bottle”",
        "without texture coordinates an image is shown on every face anew, and a normal map or an anisotropy is left out: “a”",
    ];
    assert_eq!(loaded.warnings, told);
    let material = |i: usize| loaded.parts[i].material.clone().unwrap();
    let normals = material(0).normals.clone().unwrap().image.data.clone();
    // The file's numbers are 225, 188 and 255 (of the colours 0.75, 0.5 and 1), and the normal is inclined twice as much.
    let normal = (vec3(225.0, 188.0, 255.0) / 255.0 * 2.0 - 1.0) * vec3(2.0, 2.0, 1.0);
    let expected = 0.5 + 0.5 * normal.normalize();
    assert!(Vec3::from_slice(&normals).distance(expected) < 0.005, "{normals:?} instead of {expected}");
    let body = |absorption| Some(Clear::Body { ior: 1.4, absorption });
    let clear = [0, 1, 3, 4].map(|i| material(i).clear);
    assert_eq!(clear, [None, body(Vec3::ZERO), Some(Clear::Pane(1.4)), Some(Clear::Pane(1.4))]);
    // Of light that has gone 0.5 far, a quarter of the red, half of the green and all of the blue are left.
    let Some(Clear::Body { absorption, .. }) = material(2).clear else { panic!("no body") };
    assert_eq!([1, 2, 3, 4].map(|i| material(i).roughness), [0.0, 0.2, 0.0, 0.4]);
    assert!((absorption - vec3(4f32.ln() / 0.5, 2f32.ln() / 0.5, 0.0)).length() < 1e-5, "{absorption}");
}

/// Of a file and of the language; the highlight of `principled` is subtracted, being the same.
#[test]
fn vertex_colours_multiply_the_base_colour() {
    let place = Place::new();
    place.write("dot.png", dot(&[0.5, 1.0, 1.0]));
    place.write("s.dscene", "camera eye { position: [0, 0, 1], look_at: [0, 0, 0], fov: 0.1deg, film: [1, 1] }\n");
    let value = |expression: &str| {
        let output = place.dsl(&["eval", "s.dscene", expression, "--json"]);
        assert_code(&output, 0);
        serde_json::from_str::<Value>(&stdout(&output)).unwrap()["value"].as_f64().unwrap()
    };
    let albedo = |colors: &[u8], base: Value| {
        let mut file = Builder::new();
        let colors = file.bytes("VEC4", 4, colors, true);
        file.add("images", json!({"uri": "dot.png"}));
        file.add("textures", json!({"source": 0}));
        file.add("materials", json!({"doubleSided": true, "pbrMetallicRoughness": base}));
        let mesh = file.triangle(json!({"COLOR_0": colors}), json!({"material": 0}));
        file.add("nodes", json!({"mesh": mesh, "translation": [-0.25, -0.25, 0]}));
        place.write("a.gltf", file.text());
        value("mean(albedo(eye, scene: load_scene(\"a.gltf\")).r)")
    };
    let factor = json!({"baseColorFactor": [0.5, 1, 1, 1], "metallicFactor": 0});
    let image = json!({"baseColorTexture": {"index": 0}, "metallicFactor": 0});
    let black = albedo(&[0, 0, 0, 255].repeat(3), factor.clone());
    for (base, half) in [(factor, 0.5), (image, f64::from(188.0f32 / 255.0).powf(2.2))] {
        let same = albedo(&[51, 0, 0, 255].repeat(3), base.clone()) - black;
        assert!((same - 0.2 * half).abs() < 0.01, "{same}: 0.2 times {half}");
        // At a quarter of both edges the corners weigh 1/2, 1/4 and 1/4.
        let varying = albedo(&[102, 0, 0, 255, 204, 0, 0, 255, 0, 0, 0, 255], base) - black;
        assert!((varying - 0.4 * half).abs() < 0.01, "{varying}: 0.4 times {half}");
    }
    // A product is linear in either factor: its derivative by a texel is the colour there, and the other way round.
    let script = "camera eye { position: [0, 0, 1], look_at: [0, 0, 0], fov: 0.1deg, film: [1, 1] }\n\
        param texel = 0.5\nparam corner: color = [0.4, 0.2, 0.6]\nlight l = constant(1)\n\
        shape s { mesh: mesh(vertices: [[-1, -1, 0], [1, -1, 0], [0, 1, 0]], faces: [[0, 1, 2]], colors: [corner, [0, 0, 0], [0.8, 0.8, 0.8]]),\n\
          material: diffuse(reflectance: vertex_color(times: texture([[texel]]))) }\n\
        loss z = mean(render(eye, spp: 4096).r)\n";
    place.write("s.dscene", script);
    let output = place.dsl(&["grad", "s.dscene", "--json"]);
    assert_code(&output, 0);
    let found: Value = serde_json::from_str(&stdout(&output)).unwrap();
    // At the middle the corners weigh 1/4, 1/4 and 1/2.
    let (texel, corner) = (&found["wrt"]["texel"]["mean"], &found["wrt"]["corner"]["mean"][0]);
    let (texel, corner) = (texel.as_f64().unwrap(), corner.as_f64().unwrap());
    assert!((texel - 0.5).abs() < 3e-3, "{texel}");
    assert!((corner / texel - 0.25).abs() < 1e-4, "{corner} and {texel} come from the same paths");
    assert_eq!(value("mean(s.material.reflectance.texels)"), 0.5);
}

#[test]
fn vertex_colours_multiply_what_unlit_surfaces_show() {
    let place = Place::new();
    place.write("s.dscene", "camera eye { position: [0, 0, 1], look_at: [0, 0, 0], fov: 0.1deg, film: [1, 1] }\n");
    let shown = |colors: &[u8]| {
        let mut file = Builder::new();
        let colors = file.bytes("VEC4", 4, colors, true);
        let extensions = json!({"KHR_materials_unlit": {}, "KHR_materials_sheen": {"sheenColorFactor": [1, 1, 1]}});
        let base = json!({"baseColorFactor": [0.5, 1, 1, 1]});
        file.add("materials", json!({"doubleSided": true, "pbrMetallicRoughness": base, "extensions": extensions}));
        let mesh = file.triangle(json!({"COLOR_0": colors}), json!({"material": 0}));
        file.add("nodes", json!({"mesh": mesh, "translation": [-0.25, -0.25, 0]}));
        place.write("a.gltf", file.text());
        // The lamp before it lights nothing: an unlit surface does not reflect.
        let scene = "scene(shapes: [], lights: [load_scene(\"a.gltf\").lights[0], point(position: [0, 0, 0.5])])";
        let output =
            place.dsl(&["eval", "s.dscene", &format!("mean(render(eye, scene: {scene}, spp: 16).r)"), "--json"]);
        assert_code(&output, 0);
        serde_json::from_str::<Value>(&stdout(&output)).unwrap()["value"].as_f64().unwrap()
    };
    assert!((shown(&[51, 0, 0, 255].repeat(3)) - 0.5 * 0.2).abs() < 1e-3);
    // At a quarter of both edges the corners weigh 1/2, 1/4 and 1/4.
    let varying = shown(&[102, 0, 0, 255, 204, 0, 0, 255, 0, 0, 0, 255]);
    assert!((varying - 0.5 * 0.4).abs() < 2e-3, "{varying}");
}

#[test]
fn cameras_of_gltf_look_where_they_should() {
    let place = Place::new();
    let mut file = Builder::new();
    file.add("cameras", json!({"type": "perspective", "perspective": {"yfov": 0.5, "aspectRatio": 2, "znear": 0.1}}));
    file.add(
        "cameras",
        json!({"type": "orthographic", "orthographic": {"xmag": 3, "ymag": 1.5, "znear": 0, "zfar": 9}}),
    );
    let turn = [0.0, (FRAC_PI_2 / 2.0).sin(), 0.0, (FRAC_PI_2 / 2.0).cos()];
    file.add("nodes", json!({"camera": 0, "name": "eye", "translation": [5, 0, 0], "rotation": turn, "children": [1]}));
    file.add("nodes", json!({"camera": 1, "translation": [0, 0, -1]}));
    place.write("a.gltf", file.text());
    let (cameras, warnings) = load_cameras(&place.path("a.gltf")).unwrap();
    assert_eq!(warnings, Vec::<String>::new());
    assert_eq!((cameras[0].name.as_str(), cameras[0].position), ("eye", DVec3::new(5.0, 0.0, 0.0)));
    assert!((cameras[0].forward - DVec3::NEG_X).length() < 1e-6 && (cameras[0].up - DVec3::Y).length() < 1e-6);
    assert_eq!(cameras[0].projection, LoadedProjection::Perspective { fov: 0.5 });
    assert!((cameras[1].position - DVec3::new(4.0, 0.0, 0.0)).length() < 1e-6);
    assert_eq!((cameras[1].projection, cameras[1].aspect), (LoadedProjection::Orthographic { height: 3.0 }, Some(2.0)));
    // A square of size 1 at the origin, seen from 5 away, is 1 / (2 · 5 · tan(0.25)) of the image high.
    let script = "shape s { mesh: rectangle(width: 1, depth: 1) |> rotate(z: -90deg) }\n\
                  camera eye = load_cameras(\"a.gltf\")[0]\nlet flat = load_cameras(\"a.gltf\", film: [64, 64])[1]\n";
    place.write("s.dscene", script);
    let value = |expression: &str| {
        let output = place.dsl(&["eval", "s.dscene", expression, "--json"]);
        assert_code(&output, 0);
        serde_json::from_str::<Value>(&stdout(&output)).unwrap()["value"].clone()
    };
    assert_eq!(value("eye.film"), json!([512.0, 256.0]));
    let side = 1.0 / (10.0 * 0.25f64.tan());
    let seen = value("mean(alpha(eye))").as_f64().unwrap();
    assert!((seen - side * side / 2.0).abs() < 1e-3, "{seen}");
    let seen = value("mean(alpha(flat, spp: 16))").as_f64().unwrap();
    assert!((seen - 1.0 / 9.0).abs() < 2e-3, "{seen}");
    place.write("b.obj", "v 0 0 0\n");
    let output = place.dsl(&["eval", "s.dscene", "load_cameras(\"b.obj\")"]);
    assert_diagnosed(&output);
    assert!(stderr(&output).contains(".obj files hold no cameras"), "{}", stderr(&output));
}

// ---- memory --------------------------------------------------------------------------------------------------------

/// Small files that ask for gigabytes end with a diagnostic at the expression, before the memory is taken.
#[test]
fn sizes_are_known_before_memory_is_taken() {
    let place = Place::new();
    // Four million vertices that are nowhere in the file, shown by 31 nodes.
    let mut file = Builder::new();
    let (at, with) = (file.view(&[0, 0, 0, 0]), file.view(&[0; 12]));
    let sparse =
        json!({"count": 1, "indices": {"bufferView": at, "componentType": 5125}, "values": {"bufferView": with}});
    file.add("accessors", json!({"componentType": 5126, "count": 4_000_000, "type": "VEC3", "sparse": sparse}));
    file.add("meshes", json!({"primitives": [{"attributes": {"POSITION": 0}}]}));
    for node in 0..31 {
        let children: Vec<usize> = if node == 0 { (1..31).collect() } else { vec![] };
        file.add("nodes", if node == 0 { json!({"mesh": 0, "children": children}) } else { json!({"mesh": 0}) });
    }
    place.write("sparse.gltf", file.text());
    // Twenty thousand nodes that show twenty thousand faces each.
    let mut file = Builder::new();
    let indices = file.bytes("SCALAR", 1, &[0, 1, 2].repeat(20_000), false);
    let mesh = file.triangle(json!({}), json!({"indices": indices}));
    file.add("nodes", json!({"mesh": mesh, "children": (1..20_000).collect::<Vec<_>>()}));
    for _ in 1..20_000 {
        file.add("nodes", json!({"mesh": mesh}));
    }
    place.write("many.gltf", file.text());
    place.write("s.dscene", "let x = 1\n");
    for file in ["sparse.gltf", "many.gltf"] {
        for native in ["load", "load_scene"] {
            let expression = format!("{native}(\"{file}\")");
            let output = place.dsl(&["eval", "s.dscene", &expression, "--memory", "1GB"]);
            assert_diagnosed(&output);
            let error = stderr(&output).replace('\n', " ");
            assert!(error.contains("triangles") && error.contains(native), "{error}");
        }
    }
}

// ---- told by the command line --------------------------------------------------------------------------------------

const GLASSY: &str = "mtllib m.mtl\nv -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nusemtl m\nf 1 2 3 4\n";

fn glassy() -> Place {
    let place = Place::new();
    place.write("a.obj", GLASSY);
    place.write("m.mtl", "newmtl m\nKd 0.5\nbump dents.png\n");
    let script = "param h = 1\nlet room = load_scene(\"a.obj\")\nlet again = load_scene(\"a.obj\")\n\
                  camera eye { position: [0, 3, 1], look_at: [0, 0, 0], film: [4, 4] }\n\
                  shape s = load_shapes(\"a.obj\")\nlight l = constant(h)\nloss z = mean(render(eye))\n";
    place.write("s.dscene", script);
    place
}

#[test]
fn every_command_tells_it_once_where_the_file_is_loaded() {
    let place = glassy();
    let told = "a.obj: parts of materials are left out: bump of “m”";
    let flat = |text: &str| text.split_whitespace().filter(|w| *w != "│").collect::<Vec<_>>().join(" ");
    for arguments in [
        &["eval", "s.dscene", "z + mean(z)"][..],
        &["render", "s.dscene", "-o", "out.png"],
        &["grad", "s.dscene"],
        &["run", "s.dscene", "--steps", "2"],
    ] {
        if arguments[0] == "run" {
            let text = std::fs::read_to_string(place.path("s.dscene")).unwrap();
            place.write("s.dscene", format!("{text}optimize z {{ using: sgd(lr: 0.01), steps: 2 }}\nprint z\n"));
        }
        let output = place.dsl(arguments);
        assert_code(&output, 0);
        let text = flat(&stderr(&output));
        assert_eq!(text.matches(told).count(), 1, "{arguments:?}: {text}");
        assert!(text.contains("shape s = load_shapes(\"a.obj\")"), "{arguments:?}: {text}");
    }
    let output = place
        .command(&["repl"])
        .write_stdin("let a = load_scene(\"a.obj\")\na.shapes\nlen(a.shapes)\n")
        .output()
        .unwrap();
    let text = flat(&(stderr(&output) + &stdout(&output)));
    assert_eq!(text.matches(told).count(), 1, "{text}");
    // The mesh alone has no use for a material.
    let output = place.dsl(&["eval", "s.dscene", "load(\"a.obj\")"]);
    assert_eq!(stderr(&output).trim(), "");
}

#[test]
fn warnings_are_objects_where_errors_are() {
    let place = glassy();
    place.write("s.dscene", "print len(load_shapes(\"a.obj\"))\n");
    let output = place.dsl(&["run", "s.dscene", "--json"]);
    assert_code(&output, 0);
    let all = stdout(&output) + &stderr(&output);
    let objects: Vec<Value> = all.lines().filter_map(|l| serde_json::from_str(l).ok()).collect();
    let told = objects.iter().filter(|o| o.to_string().contains("bump of “m”")).count();
    assert_eq!(told, 1, "{all}");
}

/// What cannot be read again is not written.
#[test]
fn a_mesh_that_is_not_finite_is_not_written() {
    let folder = tempfile::tempdir().unwrap();
    for (value, ending) in [
        ("sphere() |> scale(1e39)", "ply"),
        ("sphere() |> scale(1e39)", "obj"),
        ("sphere() |> scale(1e39)", "glb"),
        ("[sphere(), cube() |> translate([1e39, 0, 0])]", "glb"),
    ] {
        let script = format!("save {value} to \"m.{ending}\"\n");
        std::fs::write(folder.path().join("s.dscene"), &script).unwrap();
        let mut command = assert_cmd::Command::cargo_bin("dsl").unwrap();
        let command = command.current_dir(folder.path()).args(["run", "s.dscene", "--out", "o", "--force"]);
        let output = command.output().unwrap();
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        let text = text.split_whitespace().filter(|w| *w != "│").collect::<Vec<&str>>().join(" ");
        assert_eq!(output.status.code(), Some(1), "{script}{text}");
        assert!(text.contains("the mesh cannot be written: vertex 0") && text.contains("3.4e38"), "{script}{text}");
        assert!(!folder.path().join("o").join(format!("m.{ending}")).exists(), "{script}");
    }
}
