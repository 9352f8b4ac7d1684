//! Pieces of what the user wrote, cut out of text that does not parse, so that advice can be given in their words.

/// The operand that ends before `end`: a name, a number, a string or something in brackets, with its dots, calls and indices.
pub fn operand_before(text: &str, end: usize) -> &str {
    let bytes = text.as_bytes();
    let end = text.get(..end).map_or(0, |t| t.trim_end().len());
    let mut at = end;
    loop {
        match at.checked_sub(1).and_then(|i| bytes.get(i)) {
            Some(b')' | b']') => match opening(bytes, at - 1) {
                Some(open) => at = open,
                None => break,
            },
            Some(b'"') => match text[..at - 1].rfind('"') {
                Some(open) => at = open,
                None => break,
            },
            Some(b'.') if at >= 2 && bytes[at - 2] == b'.' => break,
            Some(b) if b.is_ascii_alphanumeric() || matches!(b, b'_' | b'.') => at -= 1,
            Some(b'%') if at == end => at -= 1,
            _ => break,
        }
    }
    text.get(at..end).unwrap_or("")
}

/// The operand that begins at or after `start`, on the same line.
pub fn operand_after(text: &str, start: usize) -> &str {
    let rest = text.get(start..).unwrap_or("");
    let line = rest.split('\n').next().unwrap_or("");
    let start = start + (line.len() - line.trim_start().len());
    let bytes = text.as_bytes();
    let mut at = start + usize::from(bytes.get(start) == Some(&b'-'));
    loop {
        match bytes.get(at) {
            Some(b'(' | b'[') => match closing(text, at) {
                Some(close) => at = close + 1,
                None => break,
            },
            Some(b'"') => match text.get(at + 1..).and_then(|t| t.find('"')) {
                Some(close) => at += close + 2,
                None => break,
            },
            Some(b'.') if bytes.get(at + 1) == Some(&b'.') => break,
            Some(b) if b.is_ascii_alphanumeric() || matches!(b, b'_' | b'.' | b'%') => at += 1,
            _ => break,
        }
    }
    text.get(start..at).unwrap_or("")
}

/// What goes on from `start` to the end of the expression: a comma or bracket that is not its own, or the line's end.
pub fn expression_after(text: &str, start: usize) -> &str {
    let bytes = text.as_bytes();
    let mut at = start;
    while let Some(byte) = bytes.get(at) {
        match byte {
            b'(' | b'[' | b'{' => match closing(text, at) {
                Some(close) => at = close,
                None => break,
            },
            b')' | b']' | b'}' | b',' | b';' | b'\n' => break,
            _ => {}
        }
        at += 1;
    }
    text.get(start..at).unwrap_or("").trim()
}

/// The arguments of a call whose `(` is the next thing after `at`, and where its `)` is.
pub fn arguments(text: &str, at: usize) -> Option<(Vec<&str>, usize)> {
    let rest = text.get(at..)?;
    let open = at + (rest.len() - rest.trim_start_matches([' ', '\t']).len());
    if text.as_bytes().get(open) != Some(&b'(') {
        return None;
    }
    let close = closing(text, open)?;
    Some((parts(text.get(open + 1..close)?), close))
}

/// What commas outside of brackets and strings part.
pub fn parts(text: &str) -> Vec<&str> {
    let bytes = text.as_bytes();
    let (mut found, mut start, mut at) = (Vec::new(), 0, 0);
    while at < bytes.len() {
        match bytes[at] {
            b'(' | b'[' | b'{' => at = closing(text, at).unwrap_or(at),
            b'"' => at += text.get(at + 1..).and_then(|t| t.find('"')).map_or(0, |n| n + 1),
            b',' => {
                found.extend(text.get(start..at).map(str::trim));
                start = at + 1;
            }
            _ => {}
        }
        at += 1;
    }
    let last = text.get(start..).unwrap_or("").trim();
    if !last.is_empty() {
        found.push(last);
    }
    found
}

/// The innermost bracket that is open at an offset.
pub fn open_bracket(text: &str, at: usize) -> Option<(usize, u8)> {
    let mut open = Vec::new();
    let mut in_string = false;
    for (i, byte) in text.bytes().enumerate().take(at) {
        match byte {
            b'"' => in_string = !in_string,
            _ if in_string => {}
            b'(' | b'[' | b'{' => open.push((i, byte)),
            b')' | b']' | b'}' => {
                open.pop();
            }
            _ => {}
        }
    }
    open.pop()
}

/// Where the bracket at `open` is closed.
pub fn closing(text: &str, open: usize) -> Option<usize> {
    let mut depth = 0usize;
    let mut in_string = false;
    for (i, byte) in text.bytes().enumerate().skip(open) {
        match byte {
            b'"' => in_string = !in_string,
            _ if in_string => {}
            b'(' | b'[' | b'{' => depth += 1,
            b')' | b']' | b'}' => {
                depth = depth.checked_sub(1)?;
                if depth == 0 {
                    return Some(i);
                }
            }
            _ => {}
        }
    }
    None
}

/// Where the bracket that is closed at `close` was opened.
fn opening(bytes: &[u8], close: usize) -> Option<usize> {
    let mut depth = 0usize;
    for i in (0..=close).rev() {
        match bytes[i] {
            b')' | b']' | b'}' => depth += 1,
            b'(' | b'[' | b'{' => {
                depth -= 1;
                if depth == 0 {
                    return Some(i);
                }
            }
            _ => {}
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn operands_are_cut_out_of_broken_text() {
        let text = "let a = f(x, [1]).y && -g(\"a, b\")[2] + 1";
        let at = text.find("&&").unwrap();
        assert_eq!(operand_before(text, at), "f(x, [1]).y");
        assert_eq!(operand_after(text, at + 2), "-g(\"a, b\")[2]");
        assert_eq!(expression_after(text, at + 2), "-g(\"a, b\")[2] + 1");
        assert_eq!(operand_before("0..n ** 2", 5), "n");
        assert_eq!(operand_after("a..b", 1), "");
        assert_eq!(parts("a, f(b, c), \"d, e\","), ["a", "f(b, c)", "\"d, e\""]);
        assert_eq!(arguments("f (1, [2, 3]) + 1", 1), Some((vec!["1", "[2, 3]"], 12)));
        assert_eq!(open_bracket("f(a, [b", 7), Some((5, b'[')));
        for broken in ["", "(", ")", "\"", "é(", "(]"] {
            let _ = (operand_before(broken, broken.len()), operand_after(broken, 0), arguments(broken, 0));
        }
    }
}
