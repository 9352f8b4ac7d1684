//! One request of HTTP/1.1: read within bounds of size and time, and judged by where it comes from.
//!
//! `httparse` reads the head. A whole server of another crate would not do: the small ones leave no way to bound the time that a client may
//! take to read or write (tiny_http 0.12 is also the last of 2022), the large ones bring an asynchronous runtime.

use std::io::{self, Read};
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// Bounds of what a client may send, and in which time.
const MOST_HEAD: usize = 8 << 10;
const MOST_BODY: usize = 64 << 10;
const MOST_HEADERS: usize = 64;
const PATIENCE: Duration = Duration::from_secs(3);

pub struct Request {
    pub method: String,
    /// Without the query.
    pub path: String,
    headers: Vec<(String, Vec<u8>)>,
    /// What was read beyond the head.
    rest: Vec<u8>,
    deadline: Instant,
}

/// The status of a request that is not answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refused(pub u16);

impl Request {
    /// Reads the head.
    pub fn read(stream: &mut TcpStream) -> Result<Request, Refused> {
        let deadline = Instant::now() + PATIENCE;
        let mut bytes = Vec::new();
        loop {
            if let Some(request) = parsed(&bytes, deadline)? {
                return Ok(request);
            }
            if bytes.len() >= MOST_HEAD {
                return Err(Refused(431));
            }
            read_more(stream, &mut bytes, MOST_HEAD, deadline)?;
        }
    }

    /// The one header of that name; `None` if there are none or several.
    pub fn header(&self, name: &str) -> Option<&str> {
        let mut found = self.headers.iter().filter(|(n, _)| n.eq_ignore_ascii_case(name));
        let (_, value) = found.next()?;
        if found.next().is_some() { None } else { std::str::from_utf8(value).ok() }
    }

    fn has(&self, name: &str) -> bool {
        self.headers.iter().any(|(n, _)| n.eq_ignore_ascii_case(name))
    }

    /// Whether the browser itself was sent to one of these addresses: not by a name that somebody else made to mean this machine, and not
    /// by a page from elsewhere.
    pub fn is_for(&self, port: u16) -> bool {
        let is_own =
            |host: &str| [format!("127.0.0.1:{port}"), format!("localhost:{port}")].contains(&host.to_lowercase());
        let from_own = |origin: &str| origin.strip_prefix("http://").is_some_and(is_own);
        self.header("host").is_some_and(is_own) && (!self.has("origin") || self.header("origin").is_some_and(from_own))
    }

    /// The path below the one whose first part is the token.
    pub fn below(&self, token: &str) -> Option<&str> {
        let rest = self.path.strip_prefix('/')?;
        let (first, below) = rest.split_once('/').map_or((rest, ""), |(first, _)| (first, &rest[first.len()..]));
        is_same(first.as_bytes(), token.as_bytes()).then_some(below)
    }

    pub fn body(&mut self, stream: &mut TcpStream) -> Result<Vec<u8>, Refused> {
        if self.has("transfer-encoding") {
            return Err(Refused(411));
        }
        let length: usize = self.header("content-length").and_then(|n| n.parse().ok()).ok_or(Refused(411))?;
        if length > MOST_BODY {
            return Err(Refused(413));
        }
        let mut bytes = std::mem::take(&mut self.rest);
        while bytes.len() < length {
            read_more(stream, &mut bytes, length, self.deadline)?;
        }
        bytes.truncate(length);
        Ok(bytes)
    }
}

fn parsed(bytes: &[u8], deadline: Instant) -> Result<Option<Request>, Refused> {
    let mut headers = [httparse::EMPTY_HEADER; MOST_HEADERS];
    let mut head = httparse::Request::new(&mut headers);
    match head.parse(bytes) {
        Ok(httparse::Status::Partial) => Ok(None),
        Ok(httparse::Status::Complete(length)) => Ok(Some(Request {
            method: head.method.unwrap_or_default().to_owned(),
            path: head.path.unwrap_or_default().split('?').next().unwrap_or_default().to_owned(),
            headers: head.headers.iter().map(|h| (h.name.to_owned(), h.value.to_vec())).collect(),
            rest: bytes.get(length..).unwrap_or_default().to_vec(),
            deadline,
        })),
        Err(httparse::Error::TooManyHeaders) => Err(Refused(431)),
        Err(_) => Err(Refused(400)),
    }
}

/// Reads what there is, up to `most` bytes in all.
fn read_more(stream: &mut TcpStream, bytes: &mut Vec<u8>, most: usize, deadline: Instant) -> Result<(), Refused> {
    let left = deadline.saturating_duration_since(Instant::now());
    if left.is_zero() || stream.set_read_timeout(Some(left)).is_err() {
        return Err(Refused(408));
    }
    let mut buffer = [0; 4096];
    let room = buffer.len().min(most.saturating_sub(bytes.len()));
    match stream.read(&mut buffer[..room]) {
        Ok(0) => Err(Refused(400)),
        Ok(n) => {
            bytes.extend_from_slice(&buffer[..n]);
            Ok(())
        }
        Err(e) if e.kind() == io::ErrorKind::Interrupted => Ok(()),
        Err(_) => Err(Refused(408)),
    }
}

/// Compares secrets in a time that does not depend on where they differ.
fn is_same(a: &[u8], b: &[u8]) -> bool {
    a.len() == b.len() && std::hint::black_box(a.iter().zip(b).fold(0, |found, (a, b)| found | (a ^ b))) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(text: &str) -> Option<Request> {
        parsed(text.as_bytes(), Instant::now()).ok().flatten()
    }

    #[test]
    fn only_own_addresses_are_answered() {
        for (lines, expected) in [
            ("Host: 127.0.0.1:3000", true),
            ("host: LOCALHOST:3000", true),
            ("Host: 127.0.0.1:3000\r\nOrigin: http://127.0.0.1:3000", true),
            ("Host: 127.0.0.1", false),
            ("Host: 127.0.0.1:3001", false),
            ("Host: evil.example:3000", false),
            ("Host: 127.0.0.1:3000\r\nHost: evil.example", false),
            ("Host: 127.0.0.1:3000\r\nOrigin: http://evil.example", false),
            ("Host: 127.0.0.1:3000\r\nOrigin: null", false),
            ("Accept: */*", false),
        ] {
            let found = request(&format!("GET / HTTP/1.1\r\n{lines}\r\n\r\n")).unwrap();
            assert_eq!(found.is_for(3000), expected, "{lines}");
        }
    }

    #[test]
    fn the_token_is_the_first_part_of_the_path() {
        let below = |path: &str| {
            let found = request(&format!("GET {path} HTTP/1.1\r\n\r\n")).unwrap();
            found.below("abc").map(str::to_owned)
        };
        for (path, expected) in [("/abc/", Some("/")), ("/abc/x/y?q=/abc/", Some("/x/y")), ("/abc", Some(""))] {
            assert_eq!(below(path).as_deref(), expected, "{path}");
        }
        for path in ["/", "/ab/", "/abcd/", "/abd/", "//abc/", "/x/abc/", "*", "http://127.0.0.1/abc/"] {
            assert_eq!(below(path), None, "{path}");
        }
    }

    #[test]
    fn heads_are_read_piece_by_piece() {
        let whole = "POST /t/do HTTP/1.1\r\nContent-Length: 2\r\n\r\n{}";
        for end in 0..whole.len() - 2 {
            assert!(parsed(&whole.as_bytes()[..end], Instant::now()).unwrap().is_none());
        }
        assert_eq!(request(whole).unwrap().rest, b"{}");
        assert_eq!(parsed(b"nonsense\r\n\r\n", Instant::now()).err(), Some(Refused(400)));
        let many = format!("GET / HTTP/1.1\r\n{}\r\n", "A: b\r\n".repeat(MOST_HEADERS + 1));
        assert_eq!(parsed(many.as_bytes(), Instant::now()).err(), Some(Refused(431)));
    }
}
