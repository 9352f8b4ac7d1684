//! What each format is read as.

use glam::vec3;

use super::*;

const OBJ: &str = "mtllib m.mtl\no quad\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 1\n\
    usemtl red\nf 1/1/1 2/2/1 3/3/1 4/4/1\no tri\nv 0 0 2\nf -1 1 2\n";
const MTL: &str = "newmtl red\nKd 1 0.5 0\nNs 0\nKe 0 0 2\nPm 0.25\nmap_Kd dot.png\n";

fn bytes_of(floats: &[f32]) -> Vec<u8> {
    floats.iter().flat_map(|f| f.to_le_bytes()).collect()
}

fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let group = |c: &[u8]| {
        let bits = c.iter().chain(&[0, 0]).take(3).fold(0u32, |acc, &b| acc << 8 | b as u32);
        let digit = |k: usize| if k <= c.len() { DIGITS[(bits >> (18 - 6 * k)) as usize & 63] as char } else { '=' };
        (0..4).map(digit).collect::<String>()
    };
    bytes.chunks(3).map(group).collect()
}

fn dot_png() -> Vec<u8> {
    let image = Image { width: 1, height: 1, channels: 3, data: vec![1.0, 0.5, 0.25] };
    crate::image::file::encode_png(&image).unwrap()
}

/// A triangle with everything, twice: once moved and mirrored.
fn gltf_json(buffer_uri: Option<&str>) -> (String, Vec<u8>) {
    let mut buffer = bytes_of(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]); // positions
    buffer.extend(bytes_of(&[0.0, 0.0, 1.0].repeat(3))); // normals, at 36
    buffer.extend(bytes_of(&[0.0, 0.25, 1.0, 0.0, 0.0, 1.0])); // uvs, at 72
    buffer.extend([255, 0, 0, 255, 0, 255, 0, 255, 0, 0, 255, 51]); // colours, at 96
    buffer.extend([0, 0, 1, 0, 2, 0, 0, 0]); // indices and padding, at 108
    let png = dot_png();
    let uri = buffer_uri.map(|u| format!("\"uri\":\"{u}\",")).unwrap_or_default();
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],
        "nodes":[{{"name":"root","mesh":0,"children":[1]}},{{"name":"child","mesh":0,"translation":[0,0,5],"scale":[-2,1,1]}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"NORMAL":1,"TEXCOORD_0":2,"COLOR_0":3}},"indices":4,"material":0}}]}}],
        "materials":[{{"name":"m","doubleSided":true,"emissiveFactor":[0,1,0],"pbrMetallicRoughness":{{"baseColorFactor":[0.5,1,1,1],
          "metallicFactor":0.5,"roughnessFactor":0.8,"baseColorTexture":{{"index":0}},"metallicRoughnessTexture":{{"index":0}}}}}}],
        "textures":[{{"source":0}}],"images":[{{"uri":"data:image/png;base64,{png}"}}],
        "buffers":[{{{uri}"byteLength":{length}}}],
        "bufferViews":[{{"buffer":0,"byteOffset":0,"byteLength":36}},{{"buffer":0,"byteOffset":36,"byteLength":36}},
          {{"buffer":0,"byteOffset":72,"byteLength":24}},{{"buffer":0,"byteOffset":96,"byteLength":12}},{{"buffer":0,"byteOffset":108,"byteLength":6}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}},
          {{"bufferView":1,"componentType":5126,"count":3,"type":"VEC3"}},{{"bufferView":2,"componentType":5126,"count":3,"type":"VEC2"}},
          {{"bufferView":3,"componentType":5121,"normalized":true,"count":3,"type":"VEC4"}},{{"bufferView":4,"componentType":5123,"count":3,"type":"SCALAR"}}]}}"#,
        png = base64(&png),
        length = buffer.len(),
    );
    (json, buffer)
}

fn gltf_file() -> Vec<u8> {
    let (_, buffer) = gltf_json(None);
    let uri = format!("data:application/octet-stream;base64,{}", base64(&buffer));
    gltf_json(Some(&uri)).0.into_bytes()
}

fn glb_file() -> Vec<u8> {
    let (mut json, buffer) = gltf_json(None);
    while json.len() % 4 != 0 {
        json.push(' ');
    }
    let mut file = b"glTF".to_vec();
    let length = 12 + 8 + json.len() + 8 + buffer.len();
    file.extend([2u32, length as u32, json.len() as u32].iter().flat_map(|v| v.to_le_bytes()));
    file.extend(b"JSON");
    file.extend(json.as_bytes());
    file.extend((buffer.len() as u32).to_le_bytes());
    file.extend(b"BIN\0");
    file.extend(&buffer);
    file
}

fn ply_file(format: &str) -> Vec<u8> {
    let mut file = format!(
        "ply\nformat {format} 1.0\ncomment a quad\nelement vertex 4\nproperty float x\nproperty float y\nproperty double z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nproperty float s\nproperty float t\n\
         element other 1\nproperty list uchar short n\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    )
    .into_bytes();
    let corners = [[0.0f32, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    if format == "ascii" {
        for [x, y] in corners {
            file.extend(format!("{x} {y} 3 255 0 188 {x} {y}\n").bytes());
        }
        file.extend(b"2 7 8\n4 0 1 2 3\n");
        return file;
    }
    let big = format.contains("big");
    let mut push = |bytes: &[u8]| {
        let mut bytes = bytes.to_vec();
        if big {
            bytes.reverse();
        }
        file.extend(bytes);
    };
    for [x, y] in corners {
        push(&x.to_le_bytes());
        push(&y.to_le_bytes());
        push(&3f64.to_le_bytes());
        [255u8, 0, 188].iter().for_each(|&c| push(&[c]));
        push(&x.to_le_bytes());
        push(&y.to_le_bytes());
    }
    push(&[2]);
    [7i16, 8].iter().for_each(|i| push(&i.to_le_bytes()));
    push(&[4]);
    (0..4i32).for_each(|i| push(&i.to_le_bytes()));
    file
}

fn stl_file() -> Vec<u8> {
    let mut file = vec![b' '; 80];
    file.extend(2u32.to_le_bytes());
    for triangle in [[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0f32]] {
        file.extend(bytes_of(&[0.0, 0.0, 1.0]));
        file.extend(bytes_of(&triangle));
        file.extend([0, 0]);
    }
    file
}

fn read(bytes: &[u8], extension: &str) -> Result<Loaded, String> {
    decode_mesh(bytes, extension, Path::new("no-such-folder"), "part", Wanted::Scene)
}

#[test]
fn obj_with_its_material() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.obj"), OBJ).unwrap();
    std::fs::write(folder.path().join("m.mtl"), MTL).unwrap();
    std::fs::write(folder.path().join("dot.png"), dot_png()).unwrap();
    let loaded = load(&folder.path().join("a.obj"), Wanted::Scene).unwrap();
    assert_eq!(loaded.warnings, Vec::<String>::new());
    assert_eq!(loaded.parts.len(), 2);
    let quad = &loaded.parts[0];
    assert_eq!((quad.name.as_str(), quad.mesh.faces.len(), quad.mesh.vertices.len()), ("quad", 2, 4));
    assert_eq!(quad.mesh.normals.as_ref().unwrap()[0], Vec3::Z);
    assert_eq!(quad.mesh.uvs.as_ref().unwrap()[0], vec2(0.0, 1.0));
    let material = quad.material.as_ref().unwrap();
    assert_eq!((material.metallic, material.roughness, material.emissive), (0.25, 1.0, vec3(0.0, 0.0, 2.0)));
    let texels = material.base_color_texels();
    assert!((texels.image.data[1] - 0.25).abs() < 0.01, "{texels:?}");
    assert_eq!(loaded.parts[1].mesh.faces.len(), 1);
    assert_eq!(loaded.merged().unwrap().0.faces.len(), 3);
    // Without its material file the shape is still there.
    std::fs::remove_file(folder.path().join("m.mtl")).unwrap();
    let loaded = load(&folder.path().join("a.obj"), Wanted::Scene).unwrap();
    assert_eq!(loaded.warnings, ["material file “m.mtl”: there is no such file or folder"]);
}

#[test]
fn obj_indices_may_differ_by_attribute() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvt 0 0\nvt 1 1\nf 1/1 2/1 3/1\nf 2/2 4/2 3/2\n";
    let mesh = read(text.as_bytes(), "obj").unwrap().parts.remove(0).mesh;
    assert_eq!((mesh.vertices.len(), mesh.faces.len()), (6, 2));
    assert_eq!(mesh.uvs.unwrap().iter().filter(|uv| **uv == vec2(1.0, 0.0)).count(), 3);
}

#[test]
fn ply_in_three_formats() {
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        let mesh = read(&ply_file(format), "ply").unwrap().parts.remove(0).mesh;
        assert_eq!(mesh.vertices[2], vec3(1.0, 1.0, 3.0), "{format}");
        assert_eq!(mesh.faces, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(mesh.uvs.unwrap()[2], vec2(1.0, 0.0));
        let color = mesh.colors.unwrap()[0];
        assert!((color - vec3(1.0, 0.0, 0.503)).length() < 0.01, "{color}");
    }
}

#[test]
fn stl_binary_and_ascii() {
    let mesh = read(&stl_file(), "stl").unwrap().parts.remove(0).mesh;
    assert_eq!((mesh.vertices.len(), mesh.faces.len()), (4, 2));
    let text = "solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1e0 0\nendloop\nendfacet\nendsolid\n";
    let mesh = read(text.as_bytes(), "stl").unwrap().parts.remove(0).mesh;
    assert_eq!((mesh.vertices.len(), mesh.faces.len()), (3, 1));
}

#[test]
fn gltf_and_glb_hold_the_same() {
    let loaded = read(&gltf_file(), "gltf").unwrap();
    assert_eq!(read(&glb_file(), "glb").unwrap(), loaded);
    assert_eq!(loaded.warnings, Vec::<String>::new());
    let [root, child] = loaded.parts.as_slice() else { panic!("{} parts", loaded.parts.len()) };
    assert_eq!((root.name.as_str(), child.name.as_str()), ("root", "child"));
    assert_eq!(root.mesh.vertices[1], Vec3::X);
    assert_eq!(child.mesh.vertices[1], vec3(-2.0, 0.0, 5.0));
    // Mirrored: the faces were turned so that normal and winding still agree.
    for part in [root, child] {
        let [a, b, c] = part.mesh.triangle(0);
        assert!((b - a).cross(c - a).dot(part.mesh.normals.as_ref().unwrap()[0]) > 0.0);
    }
    assert_eq!(root.mesh.uvs.as_ref().unwrap()[0], vec2(0.0, 0.25));
    assert_eq!(root.mesh.colors.as_ref().unwrap()[1], vec3(0.0, 1.0, 0.0));
    let material = root.material.as_ref().unwrap();
    assert!(Arc::ptr_eq(material, child.material.as_ref().unwrap()));
    let texels = material.base_color_texels();
    assert!((texels.image.data[0] - 0.5).abs() < 0.01 && (texels.image.data[1] - 0.5).abs() < 0.01);
    // Roughness is the green channel, metallicity the blue one, both as plain numbers.
    assert!((material.roughness_texels().image.data[0] - 0.8 * 188.0 / 255.0).abs() < 1e-3);
    assert!((material.metallic_texels().image.data[0] - 0.5 * 137.0 / 255.0).abs() < 1e-3);
    assert_eq!(material.emissive_texels().unwrap().image.data, [0.0, 1.0, 0.0]);
}

#[test]
fn errors_say_what_is_wrong() {
    let message = |bytes: &[u8], extension: &str| read(bytes, extension).unwrap_err();
    let missing = message(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "obj");
    assert_eq!(missing, "line 4 of the OBJ file: there is no vertex 9; there are 3");
    assert_eq!(
        message(b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "obj"),
        "vertex 0 (counted from 0) is not finite: [0, 0, NaN]"
    );
    let huge = b"ply\nformat ascii 1.0\nelement vertex 99999999\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    assert_eq!(message(huge, "ply"), "the PLY file promises 99999999 of “vertex” but is too short for them");
    assert_eq!(message(b"", "ply"), "the PLY header has no end");
    let text = String::from_utf8(ply_file("ascii")).unwrap().replace("4 0 1 2 3", "4 0 1 2 4");
    assert_eq!(message(text.as_bytes(), "ply"), "face 0 uses vertex 4, but the mesh has 4 vertices (0 to 3)");
    assert_eq!(message(&stl_file()[..100], "stl"), "the STL file promises 2 triangles but is too short for them");
    let looped = String::from_utf8(gltf_file()).unwrap().replace(r#""translation":[0,0,5]"#, r#""children":[0]"#);
    assert_eq!(message(looped.as_bytes(), "gltf"), "node 0 of the glTF file has two parents");
    let long = String::from_utf8(gltf_file()).unwrap().replace(
        r#""componentType":5126,"count":3,"type":"VEC2""#,
        r#""componentType":5126,"count":300000000,"type":"VEC2""#,
    );
    assert_eq!(message(long.as_bytes(), "gltf"), "accessor 2 of the glTF file reaches beyond its buffer view");
    let text = load(Path::new("a.fbx"), Wanted::Scene).unwrap_err().to_string();
    assert_eq!(
        text,
        "a.fbx: files ending in “.fbx” hold no mesh that can be read here; supported are .obj, .ply, .gltf, .glb, .stl"
    );
    let text = load(Path::new("nowhere/a.obj"), Wanted::Scene).unwrap_err().to_string();
    assert_eq!(text, "nowhere/a.obj: there is no such file or folder");
    assert_eq!(read(b"# nothing\n", "obj").unwrap().warnings, ["the file holds no triangle"]);
}

#[test]
fn damaged_files_never_panic() {
    let files = [
        (OBJ.as_bytes().to_vec(), "obj"),
        (ply_file("ascii"), "ply"),
        (ply_file("binary_little_endian"), "ply"),
        (ply_file("binary_big_endian"), "ply"),
        (stl_file(), "stl"),
        (gltf_file(), "gltf"),
        (glb_file(), "glb"),
    ];
    let mut state = 777u64;
    let mut next = |n: usize| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) as usize % n
    };
    let mut accepted = 0;
    for (file, extension) in files {
        for round in 0..3000 {
            let mut bytes = file.clone();
            for _ in 0..1 + round % 3 {
                let at = next(bytes.len());
                bytes[at] = match next(4) {
                    0 => [0, 255, 127, 128][next(4)],
                    1 => b"0123456789-"[next(11)],
                    2 => b" \n/.{}[],:e\""[next(12)],
                    _ => bytes[next(bytes.len())],
                };
            }
            if round % 6 == 0 {
                bytes.truncate(next(bytes.len()));
            }
            if let Ok(loaded) = read(&bytes, extension) {
                loaded.parts.iter().for_each(|p| p.mesh.validate().unwrap());
                accepted += 1;
            }
        }
    }
    assert!(accepted > 100, "the damage was meant to go unnoticed at times: {accepted}");
}
