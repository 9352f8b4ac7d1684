//! `dsl lsp`: the language server, JSON-RPC on standard input and output.
//!
//! One thread reads, one answers. Everything that has arrived is taken in before anything is answered: changes of a text make it
//! another text and nothing more, so that the text is checked once for all changes that were waiting, and never as it was.

mod documents;
mod message;
mod navigate;
mod publish;
mod requests;
mod runs;
mod show;
mod text;
mod workspace;
mod write;

use std::collections::{HashSet, VecDeque};
use std::io::{self, BufReader};
use std::panic::AssertUnwindSafe;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError, TryRecvError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use serde_json::{Value, json};

use documents::Documents;
use message::{Failure, Incoming};
use text::Encoding;

use crate::image::file::READABLE;
use crate::mesh::load::EXTENSIONS;

/// A text is checked once nothing has arrived for so long.
const QUIET: Duration = Duration::from_millis(30);

/// Ended by `exit` without `shutdown`, or because the client went away.
const EXIT_UNASKED: u8 = 1;

/// Where messages go, each as a whole, from whichever thread.
type Output = Arc<dyn Fn(&Value) + Send + Sync>;

pub(crate) fn run() -> u8 {
    let (sender, receiver) = channel();
    let reader = std::thread::Builder::new().name("reader".to_owned()).spawn(move || {
        let mut input = BufReader::new(io::stdin().lock());
        while let Some(incoming) = message::read(&mut input) {
            if sender.send(incoming).is_err() {
                return;
            }
        }
    });
    if let Err(error) = reader {
        super::out::error_line(&format!("cannot start a thread: {error}"));
        return EXIT_UNASKED;
    }
    let output = |message: &Value| {
        let mut bytes = Vec::new();
        // Writing to memory does not fail, and a client that went away is noticed by the reader.
        let _ = message::write(&mut bytes, message);
        super::out::print(&String::from_utf8_lossy(&bytes));
    };
    Server { starts_programs: true, ..Server::new(receiver, Arc::new(output)) }.serve()
}

/// A whole session over these bytes, as if all of them had arrived at once: what the server sends, in order. It starts no programs.
pub fn session(mut input: &[u8]) -> Vec<Value> {
    let (sender, receiver) = channel();
    while let Some(incoming) = message::read(&mut input) {
        // The receiver is still there.
        let _ = sender.send(incoming);
    }
    drop(sender);
    let sent = Arc::new(Mutex::new(Vec::new()));
    let collected = sent.clone();
    let output = move |message: &Value| collected.lock().unwrap_or_else(PoisonError::into_inner).push(message.clone());
    let mut server = Server::new(receiver, Arc::new(output));
    server.serve();
    // What nobody waits for any more is told all the same, so that every text is looked at.
    while let Some(uri) = server.documents.untold() {
        server.publish(&uri);
    }
    let mut sent = sent.lock().unwrap_or_else(PoisonError::into_inner);
    std::mem::take(&mut *sent)
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Started,
    Initialized,
    ShutDown,
}

pub(crate) struct Server {
    receiver: Receiver<Incoming>,
    output: Output,
    /// Whether `dscene.run` and its like are carried out.
    starts_programs: bool,
    /// What has arrived and is not answered yet.
    waiting: VecDeque<Incoming>,
    /// Requests among them that the client does not want answered any more.
    cancelled: HashSet<String>,
    is_input_over: bool,
    phase: Phase,
    encoding: Encoding,
    /// Whether the client wants to know what the server does.
    is_traced: bool,
    /// Whether the client tells of files that change, once it is asked to.
    can_watch: bool,
    /// Whether the client opens a file that it is asked to show.
    can_show: bool,
    documents: Documents,
    /// Those that the client has opened.
    folders: Vec<PathBuf>,
}

impl Server {
    fn new(receiver: Receiver<Incoming>, output: Output) -> Server {
        Server {
            receiver,
            output,
            starts_programs: false,
            waiting: VecDeque::new(),
            cancelled: HashSet::new(),
            is_input_over: false,
            phase: Phase::Started,
            encoding: Encoding::Utf16,
            is_traced: false,
            can_watch: false,
            can_show: false,
            documents: Documents::default(),
            folders: Vec::new(),
        }
    }

    /// Until the client says `exit` or goes away; the exit code.
    fn serve(&mut self) -> u8 {
        loop {
            self.take_in();
            let Some(incoming) = self.waiting.pop_front() else {
                if self.is_input_over {
                    return EXIT_UNASKED;
                }
                self.wait();
                continue;
            };
            match incoming {
                Incoming::Notification { method, .. } if method == "exit" => {
                    return if self.phase == Phase::ShutDown { 0 } else { EXIT_UNASKED };
                }
                Incoming::Notification { method, params } => self.notified(&method, &params),
                Incoming::Request { id, method, params } => {
                    let result = match self.cancelled.remove(&id.to_string()) {
                        true => Err(Failure::new(message::REQUEST_CANCELLED, "cancelled by the client")),
                        false => self.answer(&method, &params),
                    };
                    self.send(&message::response(&id, result));
                }
                Incoming::Malformed { id, failure } => self.send(&message::response(&id, Err(failure))),
                Incoming::Response => {}
            }
        }
    }

    /// Takes in all that has arrived.
    fn take_in(&mut self) {
        loop {
            match self.receiver.try_recv() {
                Ok(incoming) => self.took(incoming),
                Err(TryRecvError::Empty) => return,
                Err(TryRecvError::Disconnected) => {
                    self.is_input_over = true;
                    return;
                }
            }
        }
    }

    fn took(&mut self, incoming: Incoming) {
        if let Incoming::Notification { method, params } = &incoming
            && method == "$/cancelRequest"
        {
            let id = params.get("id").unwrap_or(&Value::Null).to_string();
            let is_waiting = |w: &Incoming| matches!(w, Incoming::Request { id: i, .. } if *i == id);
            if self.waiting.iter().any(is_waiting) {
                self.cancelled.insert(id);
            }
            return;
        }
        self.waiting.push_back(incoming);
    }

    /// Waits for a message; if there is none for a while, tells what is wrong with a text.
    fn wait(&mut self) {
        let Some(uri) = self.documents.untold() else {
            match self.receiver.recv() {
                Ok(incoming) => self.took(incoming),
                Err(_) => self.is_input_over = true,
            }
            return;
        };
        match self.receiver.recv_timeout(QUIET) {
            Ok(incoming) => self.took(incoming),
            Err(RecvTimeoutError::Timeout) => self.publish(&uri),
            Err(RecvTimeoutError::Disconnected) => self.is_input_over = true,
        }
    }

    fn send(&self, message: &Value) {
        (self.output)(message);
    }

    fn answer(&mut self, method: &str, params: &Value) -> Result<Value, Failure> {
        match (self.phase, method) {
            (Phase::Started, "initialize") => return Ok(self.initialize(params)),
            (Phase::Started, _) => {
                return Err(Failure::new(message::NOT_INITIALIZED, format!("`{method}` before `initialize`")));
            }
            (_, "initialize") => return Err(Failure::new(message::INVALID_REQUEST, "initialized already")),
            (Phase::ShutDown, _) => return Err(Failure::new(message::INVALID_REQUEST, "shut down already")),
            (Phase::Initialized, "shutdown") => {
                self.phase = Phase::ShutDown;
                return Ok(Value::Null);
            }
            (Phase::Initialized, _) => {}
        }
        // A panic is our fault and is told on standard error; the editor goes on with everything else.
        std::panic::catch_unwind(AssertUnwindSafe(|| self.request(method, params)))
            .unwrap_or_else(|_| Err(Failure::new(message::INTERNAL_ERROR, "a fault of dscene; please report it")))
    }

    fn initialize(&mut self, params: &Value) -> Value {
        self.phase = Phase::Initialized;
        let offered = params.pointer("/capabilities/general/positionEncodings").and_then(Value::as_array);
        let has_utf8 = offered.is_some_and(|all| all.iter().any(|e| e == "utf-8"));
        self.encoding = if has_utf8 { Encoding::Utf8 } else { Encoding::Utf16 };
        self.is_traced = params.get("trace").is_some_and(|t| t == "messages" || t == "verbose");
        let watching = params.pointer("/capabilities/workspace/didChangeWatchedFiles/dynamicRegistration");
        self.can_watch = watching == Some(&Value::Bool(true));
        self.can_show = params.pointer("/capabilities/window/showDocument/support") == Some(&Value::Bool(true));
        self.note_folders(params);
        let mut capabilities = requests::capabilities();
        capabilities["positionEncoding"] = json!(if has_utf8 { "utf-8" } else { "utf-16" });
        json!({
            "capabilities": capabilities,
            "serverInfo": {"name": "dscene", "version": env!("CARGO_PKG_VERSION")},
        })
    }

    fn notified(&mut self, method: &str, params: &Value) {
        if self.phase != Phase::Initialized {
            return;
        }
        let uri = params.pointer("/textDocument/uri").and_then(Value::as_str).unwrap_or("");
        let version = || params.pointer("/textDocument/version").cloned().unwrap_or(Value::Null);
        match method {
            "initialized" if self.can_watch => {
                // What scripts import and read: the client tells when others change it.
                let others = ["dscene", "mtl", "bin", "npy", "npz", "csv", "txt", "json", "safetensors"];
                let endings = [&others[..], &READABLE, &EXTENSIONS].concat().join(",");
                let watchers = json!([{"globPattern": format!("**/*.{{{endings}}}")}]);
                let method = "workspace/didChangeWatchedFiles";
                let asked = json!({"id": method, "method": method, "registerOptions": {"watchers": watchers}});
                let params = json!({"registrations": [asked]});
                self.send(&message::request(method, "client/registerCapability", params));
            }
            "textDocument/didOpen" => {
                if let Some(text) = params.pointer("/textDocument/text").and_then(Value::as_str) {
                    self.documents.open(uri, text.to_owned(), version());
                }
            }
            "textDocument/didChange" => {
                let changes = params.get("contentChanges").and_then(Value::as_array);
                let changes = changes.map_or(&[][..], Vec::as_slice);
                if let Err(why) = self.documents.change(uri, version(), changes, self.encoding) {
                    self.send(&message::notification("window/logMessage", json!({"type": 1, "message": why})));
                }
            }
            "textDocument/didClose" => {
                self.documents.close(uri);
                let nothing = json!({"uri": uri, "diagnostics": []});
                self.send(&message::notification("textDocument/publishDiagnostics", nothing));
            }
            "textDocument/didSave" | "workspace/didChangeWatchedFiles" => self.documents.touched_all(),
            "$/setTrace" => self.is_traced = params.get("value").is_some_and(|t| t == "messages" || t == "verbose"),
            // Others tell what is not needed here.
            _ => {}
        }
    }
}
