//! The server of the page, for this machine only: it listens on 127.0.0.1, and what lacks the token of the address gets nothing.
//!
//! Each connection has a thread of its own, which bounds the time of everything that it waits for; there are few of them. A client that
//! reads slowly or not at all holds up its own thread and nothing else.

use std::io::{self, Read, Write};
use std::net::{Ipv4Addr, Shutdown, TcpListener, TcpStream};
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::hub::{FAREWELL, Hub, Order};
use super::request::{Refused, Request};
use crate::diag::Diagnostic;

/// Most connections at a time. A browser has six.
const MOST_CONNECTIONS: usize = 64;
/// Ports that are tried.
const PORTS: u16 = 1000;
/// What a client may take to read what it is sent.
const PATIENCE: Duration = Duration::from_secs(5);
/// An event stream without news says that it is still there: this is how a client that has gone is noticed.
const SIGN_OF_LIFE: Duration = Duration::from_secs(5);

const PAGE: &[(&str, &str, &str)] = &[
    ("/", "text/html; charset=utf-8", include_str!("page/index.html")),
    ("/page.css", "text/css; charset=utf-8", include_str!("page/page.css")),
    ("/view.js", "text/javascript; charset=utf-8", include_str!("page/view.js")),
    ("/page.js", "text/javascript; charset=utf-8", include_str!("page/page.js")),
];

/// What every answer says: nothing is kept, nothing is loaded from elsewhere, nobody may frame it or learn its address.
const HEADERS: &str = "Cache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\n\
    Content-Security-Policy: default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; \
    base-uri 'none'; form-action 'none'; frame-ancestors 'none'\r\nConnection: close\r\n";

struct Site {
    port: u16,
    token: String,
    hub: Arc<Hub>,
}

/// Starts the server at the first free port from `first` on; returns the address of the page.
pub fn start(first: u16, hub: &Arc<Hub>) -> Result<String, Diagnostic> {
    let (listener, port) = listen(first)?;
    let token = token()?;
    let address = format!("http://127.0.0.1:{port}/{token}/");
    let site = Arc::new(Site { port, token, hub: hub.clone() });
    let accept = move || {
        for stream in listener.incoming().flatten() {
            if site.hub.is_over() {
                return;
            }
            admit(stream, &site);
        }
    };
    match std::thread::Builder::new().name("page".into()).spawn(accept) {
        Ok(_) => Ok(address),
        Err(e) => Err(Diagnostic::error("dscene::live::thread", format!("cannot start a thread for the page: {e}"))),
    }
}

fn listen(first: u16) -> Result<(TcpListener, u16), Diagnostic> {
    let last = first.saturating_add(PORTS);
    let mut why = None;
    for port in first..=last {
        match TcpListener::bind((Ipv4Addr::LOCALHOST, port)) {
            Ok(listener) => {
                let port = listener.local_addr().map_or(port, |address| address.port());
                return Ok((listener, port));
            }
            Err(e) => why = Some(e),
        }
    }
    let why = why.map_or(String::new(), |e| format!(": {e}"));
    let message = format!("none of the ports {first} to {last} of this machine can be listened on{why}");
    Err(Diagnostic::error("dscene::live::port", message).help("name another one, such as `--port 8000`"))
}

/// 128 bits of the system's randomness.
fn token() -> Result<String, Diagnostic> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes).map_err(|e| {
        Diagnostic::error("dscene::live::token", format!("the system gives no random numbers for the address: {e}"))
    })?;
    Ok(bytes.iter().map(|b| format!("{b:02x}")).collect())
}

fn admit(stream: TcpStream, site: &Arc<Site>) {
    let Some(connection) = site.hub.connect(MOST_CONNECTIONS) else { return };
    let site = site.clone();
    // Without a thread the connection is closed, and its count goes with it.
    let _ = std::thread::Builder::new().name("connection".into()).stack_size(256 << 10).spawn(move || {
        let _counted = connection;
        let mut stream = stream;
        let _ = stream.set_write_timeout(Some(PATIENCE));
        let _ = stream.set_nodelay(true);
        let served = serve(&mut stream, &site);
        if let Ok(Err(Refused(status))) = served {
            let _ = answer(&mut stream, status, "", &[]);
        }
        finish(&mut stream);
    });
}

/// Answers a request, or says with which status it is refused. Errors are those of a client that has gone.
fn serve(stream: &mut TcpStream, site: &Site) -> io::Result<Result<(), Refused>> {
    let mut request = match Request::read(stream) {
        Ok(request) => request,
        Err(refused) => return Ok(Err(refused)),
    };
    let Some(path) = request.below(&site.token).filter(|_| request.is_for(site.port)).map(str::to_owned) else {
        return Ok(Err(Refused(403)));
    };
    match (request.method.as_str(), path.as_str()) {
        ("GET", "") => {
            let location = format!("Location: /{}/\r\n", site.token);
            answer(stream, 308, &location, &[])?;
        }
        ("GET", "/events") => events(stream, &site.hub)?,
        ("GET", "/picture" | "/derivative") => match site.hub.png(&path[1..]) {
            Some(png) => answer(stream, 200, "Content-Type: image/png\r\n", &png)?,
            None => return Ok(Err(Refused(404))),
        },
        ("POST", "/do") => {
            // Browsers send this type from elsewhere only where they were allowed to, which they are not.
            if request.header("content-type") != Some("application/json") {
                return Ok(Err(Refused(415)));
            }
            let body = match request.body(stream) {
                Ok(body) => body,
                Err(refused) => return Ok(Err(refused)),
            };
            let Ok(order) = serde_json::from_slice::<Order>(&body) else { return Ok(Err(Refused(400))) };
            if !site.hub.ask(order) {
                return Ok(Err(Refused(503)));
            }
            answer(stream, 204, "", &[])?;
        }
        ("GET", path) => match PAGE.iter().find(|(name, ..)| *name == path) {
            Some((_, kind, text)) => answer(stream, 200, &format!("Content-Type: {kind}\r\n"), text.as_bytes())?,
            None => return Ok(Err(Refused(404))),
        },
        _ => return Ok(Err(Refused(405))),
    }
    Ok(Ok(()))
}

fn answer(stream: &mut TcpStream, status: u16, headers: &str, body: &[u8]) -> io::Result<()> {
    let reason = match status {
        200 => "OK",
        204 => "No Content",
        308 => "Permanent Redirect",
        403 => "Forbidden",
        _ => "Refused",
    };
    let length = if status == 204 { String::new() } else { format!("Content-Length: {}\r\n", body.len()) };
    let head = format!("HTTP/1.1 {status} {reason}\r\n{HEADERS}{headers}{length}\r\n");
    write(stream, &[head.as_bytes(), body].concat())
}

/// Everything that happens, as server-sent events, until the client or the program ends.
fn events(stream: &mut TcpStream, hub: &Arc<Hub>) -> io::Result<()> {
    let _page = hub.page();
    write(stream, format!("HTTP/1.1 200 OK\r\n{HEADERS}Content-Type: text/event-stream\r\n\r\n").as_bytes())?;
    let mut seen = 0;
    while let Some((version, news)) = hub.news(seen, SIGN_OF_LIFE) {
        seen = version;
        let events: String = news.iter().map(|(topic, data)| format!("event: {topic}\ndata: {data}\n\n")).collect();
        let sign = if events.is_empty() { ": still here\n\n" } else { &events };
        write(stream, sign.as_bytes())?;
    }
    write(stream, b"event: end\ndata: {}\n\n")?;
    // The page closes the connection once it has fetched what it was told of.
    drain(stream, FAREWELL);
    Ok(())
}

/// Writes all of it, unless that takes too long.
fn write(stream: &mut TcpStream, mut bytes: &[u8]) -> io::Result<()> {
    let deadline = Instant::now() + PATIENCE;
    while !bytes.is_empty() {
        if Instant::now() > deadline {
            return Err(io::ErrorKind::TimedOut.into());
        }
        match stream.write(bytes) {
            Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
            Ok(n) => bytes = &bytes[n..],
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
    Ok(())
}

/// Closes a connection so that the answer arrives even if the client is still sending.
fn finish(stream: &mut TcpStream) {
    let _ = stream.shutdown(Shutdown::Write);
    drain(stream, Duration::from_millis(500));
}

/// Reads and drops what a client still sends, until it closes the connection or the time is over.
fn drain(stream: &mut TcpStream, patience: Duration) {
    let deadline = Instant::now() + patience;
    let mut buffer = [0; 4096];
    loop {
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() || stream.set_read_timeout(Some(left)).is_err() {
            return;
        }
        match stream.read(&mut buffer) {
            Ok(n) if n > 0 => {}
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            _ => return,
        }
    }
}
