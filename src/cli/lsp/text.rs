//! From the protocol's positions, lines and columns in UTF-16 or in bytes, to offsets of a text and back.

use serde_json::{Value, json};

/// What columns count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    Utf16,
    Utf8,
}

/// Where the lines of a text begin. A line ends with `\n`, `\r\n` or `\r`.
#[derive(Clone, Debug)]
pub struct Lines<'t> {
    text: &'t str,
    starts: Vec<usize>,
    encoding: Encoding,
}

impl<'t> Lines<'t> {
    pub fn new(text: &'t str, encoding: Encoding) -> Lines<'t> {
        let bytes = text.as_bytes();
        let mut starts = vec![0];
        for (i, byte) in bytes.iter().enumerate() {
            if *byte == b'\n' || *byte == b'\r' && bytes.get(i + 1) != Some(&b'\n') {
                starts.push(i + 1);
            }
        }
        Lines { text, starts, encoding }
    }

    /// The text of a line (from 0) without its end.
    fn line(&self, line: usize) -> &'t str {
        let start = self.starts.get(line).copied().unwrap_or(self.text.len());
        let end = self.starts.get(line + 1).copied().unwrap_or(self.text.len());
        self.text.get(start..end).unwrap_or("").trim_end_matches(['\n', '\r'])
    }

    /// Line and column, both from 0. What lies inside a character or beyond the end is moved back.
    pub fn place(&self, offset: usize) -> (usize, usize) {
        let mut offset = offset.min(self.text.len());
        while !self.text.is_char_boundary(offset) {
            offset -= 1;
        }
        let line = self.starts.partition_point(|start| *start <= offset).saturating_sub(1);
        let before = self.text.get(self.starts[line]..offset).unwrap_or("");
        let column = match self.encoding {
            Encoding::Utf8 => before.len(),
            Encoding::Utf16 => before.encode_utf16().count(),
        };
        (line, column)
    }

    pub fn position(&self, offset: usize) -> Value {
        let (line, character) = self.place(offset);
        json!({"line": line, "character": character})
    }

    pub fn range(&self, start: usize, end: usize) -> Value {
        json!({"start": self.position(start), "end": self.position(end)})
    }

    /// The offset of a position; columns beyond the end of a line mean its end, lines beyond the last one the end of the text.
    pub fn offset(&self, position: &Value) -> Option<usize> {
        let line = usize::try_from(position.get("line")?.as_u64()?).ok()?;
        let column = usize::try_from(position.get("character")?.as_u64()?).ok()?;
        let Some(&start) = self.starts.get(line) else { return Some(self.text.len()) };
        let text = self.line(line);
        let mut counted = 0;
        for (at, c) in text.char_indices() {
            let size = match self.encoding {
                Encoding::Utf8 => c.len_utf8(),
                Encoding::Utf16 => c.len_utf16(),
            };
            // A column inside a character means before it.
            if counted + size > column {
                return Some(start + at);
            }
            counted += size;
        }
        Some(start + text.len())
    }

    /// The offsets of a range, its end not before its start.
    pub fn offsets(&self, range: &Value) -> Option<(usize, usize)> {
        let start = self.offset(range.get("start")?)?;
        let end = self.offset(range.get("end")?)?;
        Some((start, end.max(start)))
    }
}

/// The path that a `file:` address names.
pub fn path_of(uri: &str) -> Option<std::path::PathBuf> {
    let rest = uri.strip_prefix("file://")?;
    // What stands before the path is a host: none, or this one.
    let path = &rest[rest.find('/')?..];
    let mut bytes = Vec::new();
    let mut at = path.bytes();
    while let Some(byte) = at.next() {
        if byte == b'%' {
            let digits = [at.next()?, at.next()?];
            bytes.push(u8::from_str_radix(std::str::from_utf8(&digits).ok()?, 16).ok()?);
        } else {
            bytes.push(byte);
        }
    }
    let path = String::from_utf8(bytes).ok()?;
    // `/C:/scene.dscene`
    let has_drive = path.as_bytes().get(2) == Some(&b':') && path.as_bytes()[1].is_ascii_alphabetic();
    Some(std::path::PathBuf::from(if has_drive && cfg!(windows) { &path[1..] } else { &path }))
}

/// The `file:` address of a path.
pub fn uri_of(path: &std::path::Path) -> String {
    let path = std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
    let text = crate::check::normal(&path).to_string_lossy().replace('\\', "/");
    let mut uri = String::from(if text.starts_with('/') { "file://" } else { "file:///" });
    for byte in text.bytes() {
        match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'/' | b'-' | b'_' | b'.' | b'~' => uri.push(char::from(byte)),
            _ => uri.push_str(&format!("%{byte:02X}")),
        }
    }
    uri
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_count_what_was_agreed_upon() {
        let text = "let é = \"😀\" + x\r\nlet b\rlet c\n";
        let x = text.find('x').unwrap();
        for (encoding, column) in [(Encoding::Utf16, 15), (Encoding::Utf8, 18)] {
            let lines = Lines::new(text, encoding);
            assert_eq!(lines.place(x), (0, column));
            assert_eq!(lines.offset(&json!({"line": 0, "character": column})), Some(x));
            assert_eq!(lines.place(text.find("b\r").unwrap()), (1, 4));
            assert_eq!(lines.place(text.find("c\n").unwrap()), (2, 4));
            let end = |line: usize| lines.offset(&json!({"line": line, "character": 999}));
            assert_eq!(end(0), text.find("\r\n"), "a column never lies behind the end of its line");
            assert_eq!((end(3), end(99)), (Some(text.len()), Some(text.len())));
        }
        let utf16 = Lines::new(text, Encoding::Utf16);
        let smile = text.find('😀').unwrap();
        assert_eq!(utf16.offset(&json!({"line": 0, "character": 10})), Some(smile), "inside of a character");
        assert_eq!(utf16.place(smile + 2), (0, 9));
        for broken in [json!(null), json!({"line": -1, "character": 0}), json!({"line": 0}), json!([1, 2])] {
            assert_eq!(utf16.offset(&broken), None, "{broken}");
        }
    }

    #[test]
    fn addresses_are_paths_and_back() {
        let path = std::path::Path::new("/a b/ü%c.dscene");
        assert_eq!(uri_of(path), "file:///a%20b/%C3%BC%25c.dscene");
        assert_eq!(path_of("file:///a%20b/%C3%BC%25c.dscene").as_deref(), Some(path));
        assert_eq!(path_of("file://localhost/x").as_deref(), Some(std::path::Path::new("/x")));
        for none in ["untitled:Untitled-1", "file:x", "file:///%zz", "file:///%f", ""] {
            assert_eq!(path_of(none), None, "{none}");
        }
    }
}
