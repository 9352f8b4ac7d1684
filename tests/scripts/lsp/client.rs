//! A small editor: it speaks the protocol with the built program, and fails if an answer does not come within two minutes.

use std::collections::VecDeque;
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::place::Place;

const PATIENCE: Duration = Duration::from_secs(120);

pub struct Editor {
    child: Child,
    input: Option<ChildStdin>,
    messages: Receiver<Value>,
    /// Messages that arrived while others were waited for.
    kept: VecDeque<Value>,
    asked: u64,
}

impl Editor {
    /// A server in a folder, not yet initialized.
    pub fn start(place: &Place) -> Editor {
        let mut child = Command::new(assert_cmd::cargo::cargo_bin!("dsl"))
            .arg("lsp")
            .current_dir(place.folder.path())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut output = BufReader::new(child.stdout.take().unwrap());
        let (sender, messages) = channel();
        std::thread::spawn(move || {
            while let Some(message) = read(&mut output) {
                if sender.send(message).is_err() {
                    return;
                }
            }
        });
        let input = child.stdin.take();
        Editor { child, input, messages, kept: VecDeque::new(), asked: 0 }
    }

    /// A server that was initialized by a client with these capabilities.
    pub fn initialized(place: &Place, capabilities: Value) -> Editor {
        let mut editor = Editor::start(place);
        editor.result("initialize", json!({"capabilities": capabilities, "trace": "messages"}));
        editor.notify("initialized", json!({}));
        editor
    }

    /// Sends bytes as they are.
    pub fn raw(&mut self, bytes: &[u8]) {
        let input = self.input.as_mut().expect("the input is open");
        input.write_all(bytes).and_then(|()| input.flush()).expect("the server reads");
    }

    pub fn framed(message: &Value) -> Vec<u8> {
        let body = message.to_string();
        format!("Content-Length: {}\r\n\r\n{body}", body.len()).into_bytes()
    }

    pub fn send(&mut self, message: &Value) {
        self.raw(&Editor::framed(message));
    }

    pub fn notify(&mut self, method: &str, params: Value) {
        self.send(&json!({"jsonrpc": "2.0", "method": method, "params": params}));
    }

    /// Sends a request; its id.
    pub fn ask(&mut self, method: &str, params: Value) -> Value {
        self.asked += 1;
        self.send(&json!({"jsonrpc": "2.0", "id": self.asked, "method": method, "params": params}));
        json!(self.asked)
    }

    /// Sends a request; the whole answer.
    pub fn request(&mut self, method: &str, params: Value) -> Value {
        let id = self.ask(method, params);
        self.answer(&id)
    }

    pub fn answer(&mut self, id: &Value) -> Value {
        self.next(&format!("an answer to {id}"), |m| m.get("method").is_none() && m["id"] == *id)
    }

    /// Sends a request that is answered without an error; its result.
    #[track_caller]
    pub fn result(&mut self, method: &str, params: Value) -> Value {
        let answer = self.request(method, params);
        assert!(answer.get("error").is_none(), "{method}: {answer}");
        answer["result"].clone()
    }

    /// Sends a request that is refused; the error's code and message.
    #[track_caller]
    pub fn refused(&mut self, method: &str, params: Value) -> (i64, String) {
        let answer = self.request(method, params);
        let error = answer.get("error").unwrap_or_else(|| panic!("{method} was not refused: {answer}"));
        (error["code"].as_i64().unwrap(), error["message"].as_str().unwrap().to_owned())
    }

    /// The next message of a kind; others are kept.
    #[track_caller]
    pub fn next(&mut self, what: &str, fits: impl Fn(&Value) -> bool) -> Value {
        if let Some(at) = self.kept.iter().position(&fits) {
            return self.kept.remove(at).unwrap();
        }
        let start = Instant::now();
        loop {
            match self.messages.recv_timeout(PATIENCE.saturating_sub(start.elapsed())) {
                Ok(message) if fits(&message) => return message,
                Ok(message) => self.kept.push_back(message),
                Err(RecvTimeoutError::Timeout) => panic!("no {what} within two minutes; came: {:?}", self.kept),
                Err(RecvTimeoutError::Disconnected) => panic!("the server has ended without {what}: {:?}", self.kept),
            }
        }
    }

    /// Messages of a method that have come and were not asked for.
    pub fn seen(&self, method: &str) -> Vec<&Value> {
        self.kept.iter().filter(|m| m["method"] == method).collect()
    }

    /// Opens a text, whether there is a file or not; its address.
    pub fn open(&mut self, place: &Place, name: &str, text: &str) -> String {
        let uri = address(place, name);
        let document = json!({"uri": uri, "languageId": "dscene", "version": 1, "text": text});
        self.notify("textDocument/didOpen", json!({"textDocument": document}));
        uri
    }

    /// Replaces all of a text.
    pub fn change(&mut self, uri: &str, version: u64, text: &str) {
        let document = json!({"uri": uri, "version": version});
        self.notify("textDocument/didChange", json!({"textDocument": document, "contentChanges": [{"text": text}]}));
    }

    /// What is wrong with a version of a text.
    #[track_caller]
    pub fn diagnostics(&mut self, uri: &str, version: u64) -> Vec<Value> {
        let found = self.next(&format!("diagnostics of version {version}"), |m| {
            m["method"] == "textDocument/publishDiagnostics"
                && m["params"]["uri"] == uri
                && m["params"]["version"] == version
        });
        found["params"]["diagnostics"].as_array().unwrap().clone()
    }

    /// A request about the place that `|` marks in a text, which is opened without it.
    #[track_caller]
    pub fn at(&mut self, place: &Place, method: &str, marked: &str) -> Value {
        let (text, position) = cursor(marked);
        let uri = self.open(place, "at.dscene", &text);
        self.result(method, json!({"textDocument": {"uri": uri}, "position": position}))
    }

    /// `shutdown` and `exit`; the exit code.
    pub fn end(mut self) -> i32 {
        self.result("shutdown", Value::Null);
        self.notify("exit", Value::Null);
        self.exit_code()
    }

    pub fn exit_code(&mut self) -> i32 {
        drop(self.input.take());
        let start = Instant::now();
        while start.elapsed() < PATIENCE {
            if let Some(status) = self.child.try_wait().unwrap() {
                return status.code().unwrap_or(-1);
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        panic!("the server does not end");
    }
}

impl Drop for Editor {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The address of a file of a folder.
pub fn address(place: &Place, name: &str) -> String {
    format!("file://{}", place.path(name).display())
}

/// A text without its `|`, and where that was, in UTF-16.
pub fn cursor(marked: &str) -> (String, Value) {
    let at = marker(marked).expect("a `|` marks the place");
    let before = &marked[..at];
    let line = before.matches('\n').count();
    let column = before.rsplit('\n').next().unwrap().encode_utf16().count();
    (format!("{before}{}", &marked[at + 1..]), json!({"line": line, "character": column}))
}

/// Where the first `|` is that begins no `|>`.
pub fn marker(marked: &str) -> Option<usize> {
    marked.match_indices('|').map(|(at, _)| at).find(|at| !marked[at + 1..].starts_with('>'))
}

fn read(output: &mut impl BufRead) -> Option<Value> {
    let mut length = 0;
    loop {
        let mut line = String::new();
        output.read_line(&mut line).ok().filter(|n| *n > 0)?;
        match line.trim().strip_prefix("Content-Length: ") {
            Some(n) => length = n.parse().unwrap(),
            None if line.trim().is_empty() => break,
            None => panic!("not the protocol: {line:?}"),
        }
    }
    let mut body = vec![0; length];
    output.read_exact(&mut body).ok()?;
    Some(serde_json::from_slice(&body).expect("what the server writes is JSON"))
}
