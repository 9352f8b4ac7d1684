//! Web pages in headless Chromium, driven over its debugging pipe (Chrome DevTools Protocol: JSON messages that end with a zero byte).
//!
//! Only `.ci/run`, which installs Chromium, sets `DSCENE_BROWSER`; without it [`Browser::wanted`] is `None` and the tests say that they are
//! skipped. With it a browser that is missing is a failure.
#![allow(dead_code)]

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use base64::Engine as _;
use serde_json::{Value, json};
use tempfile::TempDir;

const PATIENCE: Duration = Duration::from_secs(120);

/// A browser process, which ends with this value.
pub struct Browser {
    child: Child,
    input: ChildStdin,
    messages: Receiver<Value>,
    last: u64,
    /// What pages have told, with the session of each.
    events: Vec<Value>,
    _profile: TempDir,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scheme {
    Light,
    Dark,
}

/// An open tab.
pub struct Page<'b> {
    browser: &'b mut Browser,
    session: String,
    target: String,
}

impl Browser {
    /// A browser if the tests of pages are asked for.
    pub fn wanted() -> Option<Browser> {
        if std::env::var_os("DSCENE_BROWSER").is_none() {
            eprintln!(
                "skipped: DSCENE_BROWSER=1 runs the tests of web pages; they need Chromium (`apt-get install chromium`)"
            );
            return None;
        }
        Some(Browser::start())
    }

    /// `CHROMIUM` names the program, by default `chromium`.
    pub fn start() -> Browser {
        let program = std::env::var("CHROMIUM").unwrap_or("chromium".into());
        let profile = tempfile::tempdir().unwrap();
        // The browser listens on file 3 and answers on file 4.
        let shell = "exec \"$0\" \"$@\" 3<&0 4>&1 0</dev/null 1>/dev/null";
        let flags = [
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--no-first-run",
            "--hide-scrollbars",
            "--remote-debugging-pipe",
        ];
        let mut child = Command::new("sh")
            .args(["-c", shell, &program])
            .args(flags)
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let (input, output) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
        let (sender, messages) = channel();
        std::thread::spawn(move || {
            read_messages(output, |message| sender.send(message).is_ok());
        });
        let mut browser = Browser { child, input, messages, last: 0, events: Vec::new(), _profile: profile };
        let missing = "no browser: install Chromium (`apt-get install chromium`), or name one by CHROMIUM";
        browser.call(None, "Browser.getVersion", json!({})).unwrap_or_else(|why| panic!("{missing} ({why})"));
        browser
    }

    /// Opens an address in a window of that size and waits until it is loaded.
    pub fn open(&mut self, url: &str, (width, height): (u32, u32), scheme: Scheme) -> Page<'_> {
        let target = self.call(None, "Target.createTarget", json!({ "url": "about:blank" })).unwrap();
        let target = target["targetId"].as_str().unwrap().to_owned();
        let attached =
            self.call(None, "Target.attachToTarget", json!({ "targetId": target, "flatten": true })).unwrap();
        let session = attached["sessionId"].as_str().unwrap().to_owned();
        let mut page = Page { browser: self, session, target };
        for domain in ["Page", "Runtime", "Log", "Network"] {
            page.call(&format!("{domain}.enable"), json!({}));
        }
        page.resize((width, height));
        let value = if scheme == Scheme::Dark { "dark" } else { "light" };
        let features = json!([{ "name": "prefers-color-scheme", "value": value }]);
        page.call("Emulation.setEmulatedMedia", json!({ "features": features }));
        page.call("Page.navigate", json!({ "url": url }));
        page.wait_for("document.readyState === 'complete' && location.href !== 'about:blank'");
        page
    }

    /// Opens a file.
    pub fn open_file(&mut self, path: &Path, size: (u32, u32), scheme: Scheme) -> Page<'_> {
        self.open(&format!("file://{}", path.canonicalize().unwrap().display()), size, scheme)
    }

    fn call(&mut self, session: Option<&str>, method: &str, params: Value) -> Result<Value, String> {
        self.last += 1;
        let mut message = json!({ "id": self.last, "method": method, "params": params });
        if let Some(session) = session {
            message["sessionId"] = json!(session);
        }
        let sent = self.input.write_all(format!("{message}\0").as_bytes()).and_then(|()| self.input.flush());
        sent.map_err(|e| format!("{method}: {e}"))?;
        loop {
            let message = self.messages.recv_timeout(PATIENCE).map_err(|e| format!("{method}: {e}"))?;
            match message["id"].as_u64() {
                Some(id) if id == self.last && message["error"].is_null() => return Ok(message["result"].clone()),
                Some(id) if id == self.last => return Err(format!("{method}: {}", message["error"])),
                Some(_) => {}
                None => self.events.push(message),
            }
        }
    }
}

fn read_messages(output: ChildStdout, mut each: impl FnMut(Value) -> bool) {
    let mut output = BufReader::new(output);
    let mut bytes = Vec::new();
    while output.read_until(0, &mut bytes).is_ok_and(|n| n > 0) {
        bytes.pop_if(|last| *last == 0);
        if serde_json::from_slice(&bytes).is_ok_and(|message| !each(message)) {
            break;
        }
        bytes.clear();
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.call(None, "Browser.close", json!({}));
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Page<'_> {
    fn call(&mut self, method: &str, params: Value) -> Value {
        let session = self.session.clone();
        self.browser.call(Some(&session), method, params).unwrap()
    }

    /// The value of a JavaScript expression, or what its promise becomes.
    #[track_caller]
    pub fn eval(&mut self, expression: &str) -> Value {
        let params = json!({ "expression": expression, "awaitPromise": true, "returnByValue": true });
        let found = self.call("Runtime.evaluate", params);
        assert!(found["exceptionDetails"].is_null(), "{expression}: {}", found["exceptionDetails"]);
        found["result"]["value"].clone()
    }

    #[track_caller]
    pub fn text(&mut self, expression: &str) -> String {
        self.eval(expression).as_str().unwrap_or_else(|| panic!("{expression} is no text")).to_owned()
    }

    #[track_caller]
    pub fn number(&mut self, expression: &str) -> f64 {
        self.eval(expression).as_f64().unwrap_or_else(|| panic!("{expression} is no number"))
    }

    /// Waits until an expression is true.
    #[track_caller]
    pub fn wait_for(&mut self, expression: &str) {
        let begun = Instant::now();
        while self.eval(&format!("Boolean({expression})")) != json!(true) {
            assert!(begun.elapsed() < PATIENCE, "never true: {expression}; errors: {:?}", self.errors());
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    pub fn resize(&mut self, (width, height): (u32, u32)) {
        let params = json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": false });
        self.call("Emulation.setDeviceMetricsOverride", params);
    }

    /// `mouseMoved`, `mousePressed` or `mouseReleased`, with the left button.
    pub fn mouse(&mut self, kind: &str, x: f64, y: f64) {
        let button = if kind == "mouseMoved" { "none" } else { "left" };
        let params = json!({ "type": kind, "x": x, "y": y, "button": button, "clickCount": 1 });
        self.call("Input.dispatchMouseEvent", params);
    }

    /// Clicks the middle of the first element that a selector finds.
    #[track_caller]
    pub fn click(&mut self, selector: &str) {
        let find = format!(
            "(() => {{ const e = document.querySelector({selector:?}); e.scrollIntoView({{ block: 'center' }}); \
             const r = e.getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2]; }})()"
        );
        let at = self.eval(&find);
        let (x, y) = (at[0].as_f64().unwrap(), at[1].as_f64().unwrap());
        self.mouse("mousePressed", x, y);
        self.mouse("mouseReleased", x, y);
    }

    fn events(&self, method: &str) -> Vec<Value> {
        let own = |e: &&Value| e["sessionId"] == json!(self.session) && e["method"] == json!(method);
        self.browser.events.iter().filter(own).map(|e| e["params"].clone()).collect()
    }

    /// Exceptions that nothing caught, and errors in the console.
    pub fn errors(&self) -> Vec<String> {
        let thrown = self.events("Runtime.exceptionThrown").into_iter().map(|e| e["exceptionDetails"].to_string());
        let said = self.events("Runtime.consoleAPICalled").into_iter().filter(|e| e["type"] == "error");
        let logged = self.events("Log.entryAdded").into_iter().filter(|e| e["entry"]["level"] == "error");
        thrown.chain(said.map(|e| e["args"].to_string())).chain(logged.map(|e| e["entry"].to_string())).collect()
    }

    /// The addresses that the page has asked for, but for those of what it holds itself.
    pub fn requests(&self) -> Vec<String> {
        let asked = self.events("Network.requestWillBeSent").into_iter();
        let urls = asked.filter_map(|e| e["request"]["url"].as_str().map(str::to_owned));
        urls.filter(|url| !url.starts_with("data:") && !url.starts_with("blob:")).collect()
    }

    /// How much wider than the window the page is, in pixels.
    pub fn overflow(&mut self) -> f64 {
        self.number("document.documentElement.scrollWidth - document.documentElement.clientWidth")
    }

    /// A PNG of the whole page.
    pub fn screenshot(&mut self, path: &Path) {
        let found = self.call("Page.captureScreenshot", json!({ "captureBeyondViewport": true }));
        let bytes = base64::engine::general_purpose::STANDARD.decode(found["data"].as_str().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
}

impl Drop for Page<'_> {
    fn drop(&mut self) {
        let _ = self.browser.call(None, "Target.closeTarget", json!({ "targetId": self.target }));
    }
}
