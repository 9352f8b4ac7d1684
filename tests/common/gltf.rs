//! Builds small glTF files.
#![allow(dead_code)]

use serde_json::{Value, json};

/// A file in the making: a buffer that grows, and the JSON around it.
pub struct Builder {
    pub json: Value,
    buffer: Vec<u8>,
}

impl Builder {
    pub fn new() -> Builder {
        let json = json!({
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [], "meshes": [],
            "bufferViews": [], "accessors": []
        });
        Builder { json, buffer: Vec::new() }
    }

    /// Appends to a list of the file; gives the number of the new entry.
    pub fn add(&mut self, list: &str, value: Value) -> usize {
        let root = self.json.as_object_mut().unwrap();
        let list = root.entry(list).or_insert_with(|| json!([])).as_array_mut().unwrap();
        list.push(value);
        list.len() - 1
    }

    pub fn view(&mut self, bytes: &[u8]) -> usize {
        while !self.buffer.len().is_multiple_of(4) {
            self.buffer.push(0);
        }
        let offset = self.buffer.len();
        self.buffer.extend(bytes);
        self.add("bufferViews", json!({"buffer": 0, "byteOffset": offset, "byteLength": bytes.len()}))
    }

    /// An accessor of floats: `kind` is `VEC3` or the like.
    pub fn floats(&mut self, kind: &str, numbers: &[f32]) -> usize {
        let width = match kind {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            _ => 16,
        };
        let bytes: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
        let view = self.view(&bytes);
        let count = numbers.len() / width;
        self.add("accessors", json!({"bufferView": view, "componentType": 5126, "count": count, "type": kind}))
    }

    /// An accessor of bytes, normalized or not.
    pub fn bytes(&mut self, kind: &str, width: usize, numbers: &[u8], normalized: bool) -> usize {
        let view = self.view(numbers);
        let count = numbers.len() / width;
        let accessor =
            json!({"bufferView": view, "componentType": 5121, "count": count, "type": kind, "normalized": normalized});
        self.add("accessors", accessor)
    }

    /// The triangle (0,0,0), (1,0,0), (0,1,0) with more attributes, as a mesh.
    pub fn triangle(&mut self, attributes: Value, primitive: Value) -> usize {
        let positions = self.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        let mut all = json!({"POSITION": positions});
        all.as_object_mut().unwrap().extend(attributes.as_object().unwrap().clone());
        let mut whole = json!({"attributes": all});
        whole.as_object_mut().unwrap().extend(primitive.as_object().unwrap().clone());
        self.add("meshes", json!({"primitives": [whole]}))
    }

    /// The file with its buffer within, percent-encoded.
    pub fn text(&self) -> String {
        let mut json = self.json.clone();
        let data: String = self.buffer.iter().map(|b| format!("%{b:02X}")).collect();
        let uri = format!("data:application/octet-stream,{data}");
        json["buffers"] = json!([{"byteLength": self.buffer.len(), "uri": uri}]);
        json.to_string()
    }

    /// The same as GLB.
    pub fn glb(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        json["buffers"] = json!([{"byteLength": self.buffer.len()}]);
        let mut text = json.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut buffer = self.buffer.clone();
        buffer.resize(buffer.len().next_multiple_of(4), 0);
        let mut file = b"glTF".to_vec();
        for number in [2, (28 + text.len() + buffer.len()) as u32, text.len() as u32] {
            file.extend(number.to_le_bytes());
        }
        file.extend(b"JSON");
        file.extend(text);
        file.extend((buffer.len() as u32).to_le_bytes());
        file.extend(b"BIN\0");
        file.extend(buffer);
        file
    }
}
