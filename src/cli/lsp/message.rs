//! Messages on the wire: a head with the length, and JSON-RPC 2.0. What is no message is answered with the protocol's error and skipped, so
//! that one mistake of a client does not end the session.

use std::io::{BufRead, Read, Write};

use serde_json::{Value, json};

/// Longer messages are refused: no script is so long.
const LONGEST: u64 = 256 << 20;
/// A line of the head that is longer is none.
const LONGEST_LINE: u64 = 4096;

pub const PARSE_ERROR: i64 = -32700;
pub const INVALID_REQUEST: i64 = -32600;
pub const METHOD_NOT_FOUND: i64 = -32601;
pub const INVALID_PARAMS: i64 = -32602;
pub const INTERNAL_ERROR: i64 = -32603;
pub const NOT_INITIALIZED: i64 = -32002;
pub const REQUEST_CANCELLED: i64 = -32800;
pub const REQUEST_FAILED: i64 = -32803;

/// Why a request has no result.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    pub code: i64,
    pub message: String,
}

impl Failure {
    pub fn new(code: i64, message: impl Into<String>) -> Failure {
        Failure { code, message: message.into() }
    }
}

/// What a client sent.
#[derive(Clone, Debug, PartialEq)]
pub enum Incoming {
    Request {
        id: Value,
        method: String,
        params: Value,
    },
    Notification {
        method: String,
        params: Value,
    },
    /// The answer to a request of the server, which makes none whose answer it needs.
    Response,
    /// What is no message, with the id that its answer has.
    Malformed {
        id: Value,
        failure: Failure,
    },
}

/// The next message; `None` where the input ends.
pub fn read(input: &mut impl BufRead) -> Option<Incoming> {
    let malformed = |what: String| Incoming::Malformed { id: Value::Null, failure: Failure::new(PARSE_ERROR, what) };
    let length = match head(input)? {
        Ok(length) => length,
        Err(what) => return Some(malformed(what)),
    };
    if length > LONGEST {
        std::io::copy(&mut input.by_ref().take(length), &mut std::io::sink()).ok()?;
        return Some(malformed(format!("a message of {length} bytes is too long")));
    }
    let mut body = Vec::new();
    let read = input.by_ref().take(length).read_to_end(&mut body).ok()?;
    if (read as u64) < length {
        return None;
    }
    Some(match serde_json::from_slice::<Value>(&body) {
        Ok(message) => sort(message),
        Err(error) => malformed(format!("not JSON: {error}")),
    })
}

/// The length that a head says; `None` where the input ends.
fn head(input: &mut impl BufRead) -> Option<Result<u64, String>> {
    let mut length = None;
    let mut is_first = true;
    loop {
        let mut line = Vec::new();
        let count = input.by_ref().take(LONGEST_LINE).read_until(b'\n', &mut line).ok()?;
        if count == 0 {
            return None;
        }
        let text = String::from_utf8_lossy(&line);
        let text = text.trim();
        if text.is_empty() {
            // Empty lines between messages are skipped.
            if is_first {
                continue;
            }
            return Some(length.ok_or_else(|| "the head has no Content-Length".to_owned()).and_then(|l| l));
        }
        is_first = false;
        if let Some((name, value)) = text.split_once(':')
            && name.trim().eq_ignore_ascii_case("content-length")
        {
            let number = value.trim().parse::<u64>();
            length = Some(number.map_err(|_| format!("Content-Length is no number: {}", value.trim())));
        }
    }
}

fn sort(message: Value) -> Incoming {
    let invalid = |id: Value, what: &str| Incoming::Malformed { id, failure: Failure::new(INVALID_REQUEST, what) };
    let Value::Object(mut message) = message else {
        return invalid(Value::Null, "a message is a JSON object");
    };
    let id = message.remove("id");
    if id.as_ref().is_some_and(|id| !(id.is_number() || id.is_string() || id.is_null())) {
        return invalid(Value::Null, "an id is a number or a string");
    }
    match message.remove("method") {
        Some(Value::String(method)) => {
            let params = message.remove("params").unwrap_or(Value::Null);
            match id {
                Some(id) => Incoming::Request { id, method, params },
                None => Incoming::Notification { method, params },
            }
        }
        Some(_) => invalid(id.unwrap_or(Value::Null), "a method is a string"),
        None if message.contains_key("result") || message.contains_key("error") => Incoming::Response,
        None => invalid(id.unwrap_or(Value::Null), "a message has a method, a result or an error"),
    }
}

/// Writes a message.
pub fn write(out: &mut impl Write, message: &Value) -> std::io::Result<()> {
    let body = message.to_string();
    write!(out, "Content-Length: {}\r\n\r\n{body}", body.len())?;
    out.flush()
}

pub fn response(id: &Value, result: Result<Value, Failure>) -> Value {
    match result {
        Ok(result) => json!({"jsonrpc": "2.0", "id": id, "result": result}),
        Err(failure) => {
            json!({"jsonrpc": "2.0", "id": id, "error": {"code": failure.code, "message": failure.message}})
        }
    }
}

pub fn request(id: &str, method: &str, params: Value) -> Value {
    json!({"jsonrpc": "2.0", "id": id, "method": method, "params": params})
}

pub fn notification(method: &str, params: Value) -> Value {
    json!({"jsonrpc": "2.0", "method": method, "params": params})
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(bytes: &[u8]) -> Vec<Incoming> {
        let mut input = bytes;
        std::iter::from_fn(|| read(&mut input)).collect()
    }

    fn framed(body: &str) -> Vec<u8> {
        format!("Content-Length: {}\r\n\r\n{body}", body.len()).into_bytes()
    }

    #[test]
    fn what_is_no_message_does_not_hide_the_next_one() {
        let good = framed(r#"{"jsonrpc":"2.0","id":"a","method":"m","params":[1]}"#);
        let request = Incoming::Request { id: json!("a"), method: "m".into(), params: json!([1]) };
        let code = |incoming: &Incoming| match incoming {
            Incoming::Malformed { failure, .. } => failure.code,
            other => panic!("{other:?}"),
        };
        for (bad, wanted) in [
            (framed("{"), PARSE_ERROR),
            (framed("\u{fffd}"), PARSE_ERROR),
            (framed("[]"), INVALID_REQUEST),
            (framed("{}"), INVALID_REQUEST),
            (framed(r#"{"id":[],"method":"m"}"#), INVALID_REQUEST),
            (framed(r#"{"method":1}"#), INVALID_REQUEST),
            (b"Content-Length: x\r\n\r\n".to_vec(), PARSE_ERROR),
            (b"Content-Type: a\r\n\r\n".to_vec(), PARSE_ERROR),
            (b"\xff\xfe: 3\n\n".to_vec(), PARSE_ERROR),
        ] {
            let found = all(&[bad.as_slice(), &good].concat());
            assert_eq!(found.len(), 2, "{found:?}");
            assert_eq!((code(&found[0]), &found[1]), (wanted, &request));
        }
        assert_eq!(all(b""), []);
        assert_eq!(all(b"Content-Length: 10\r\n\r\n{"), [], "a message that is cut off is the end");
    }
}
