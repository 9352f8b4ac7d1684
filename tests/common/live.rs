//! A program with a live page, spoken to over plain TCP.
#![allow(dead_code)]

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, ChildStdout};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::place::Place;

/// No wait is as long as this, unless something is wrong.
const LONG: Duration = Duration::from_secs(120);

/// A program with a page.
pub struct Server {
    pub child: Child,
    pub out: BufReader<ChildStdout>,
    pub port: u16,
    /// `/TOKEN`
    pub root: String,
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// What came back: status, head and body.
pub struct Answer {
    pub status: u16,
    pub head: String,
    pub body: Vec<u8>,
}

impl Server {
    pub fn start(place: &Place, arguments: &[&str]) -> Server {
        let mut child = place.start(&[arguments, &["--threads", "2", "--quiet"]].concat());
        let out = BufReader::new(child.stdout.take().unwrap());
        Server::of(child, out)
    }

    /// A program that is about to say where its page is.
    pub fn of(child: Child, mut out: BufReader<ChildStdout>) -> Server {
        let mut line = String::new();
        out.read_line(&mut line).unwrap();
        let address = line.trim().strip_prefix("live at http://127.0.0.1:").unwrap_or_else(|| panic!("{line:?}"));
        let (port, root) = address.trim_end_matches('/').split_once('/').unwrap();
        let (port, root) = (port.parse().unwrap(), format!("/{root}"));
        Server { child, out, port, root }
    }

    pub fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        stream.set_read_timeout(Some(LONG)).unwrap();
        stream
    }

    /// Sends bytes as they are.
    pub fn raw(&self, request: &[u8]) -> Answer {
        let mut stream = self.connect();
        // The server may close before it has read all.
        let _ = stream.write_all(request);
        let mut bytes = Vec::new();
        let _ = stream.read_to_end(&mut bytes);
        let end = bytes.windows(4).position(|w| w == b"\r\n\r\n").map_or(bytes.len(), |i| i + 4);
        let head = String::from_utf8_lossy(&bytes[..end]).into_owned();
        let status = head.split(' ').nth(1).and_then(|s| s.parse().ok()).unwrap_or(0);
        Answer { status, head, body: bytes[end..].to_vec() }
    }

    pub fn host(&self) -> String {
        format!("Host: 127.0.0.1:{}\r\n", self.port)
    }

    pub fn get(&self, path: &str) -> Answer {
        self.raw(format!("GET {}{path} HTTP/1.1\r\n{}\r\n", self.root, self.host()).as_bytes())
    }

    pub fn post(&self, order: &Value) -> u16 {
        let body = order.to_string();
        let head = format!(
            "POST {}/do HTTP/1.1\r\n{}Content-Type: application/json\r\nContent-Length: {}\r\n\r\n",
            self.root,
            self.host(),
            body.len()
        );
        self.raw(format!("{head}{body}").as_bytes()).status
    }

    pub fn order(&self, order: Value) {
        assert_eq!(self.post(&order), 204, "{order}");
    }

    pub fn events(&self) -> Events {
        let mut stream = self.connect();
        write!(stream, "GET {}/events HTTP/1.1\r\n{}\r\n", self.root, self.host()).unwrap();
        Events { lines: BufReader::new(stream) }
    }
}

pub struct Events {
    lines: BufReader<TcpStream>,
}

impl Events {
    /// The next event; signs of life are none.
    #[track_caller]
    pub fn next(&mut self) -> Option<(String, Value)> {
        let begun = Instant::now();
        let mut topic = String::new();
        loop {
            assert!(begun.elapsed() < LONG, "no event");
            let mut line = String::new();
            if self.lines.read_line(&mut line).unwrap() == 0 {
                return None;
            }
            if let Some(name) = line.strip_prefix("event: ") {
                topic = name.trim().to_owned();
            } else if let Some(data) = line.strip_prefix("data: ") {
                return Some((topic, serde_json::from_str(data).unwrap()));
            }
        }
    }

    /// The next event of a topic that is as wanted.
    #[track_caller]
    pub fn until(&mut self, topic: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        let begun = Instant::now();
        let mut last = Value::Null;
        while begun.elapsed() < LONG {
            let Some((name, value)) = self.next() else { panic!("the end, before the wanted {topic}: {last}") };
            if name == topic && wanted(&value) {
                return value;
            }
            if name == topic || name == "diagnostics" {
                last = value;
            }
        }
        panic!("no wanted {topic}: {last}");
    }

    #[track_caller]
    pub fn phase(&mut self, wanted: &str) {
        self.until("phase", |phase| phase == wanted);
    }
}
