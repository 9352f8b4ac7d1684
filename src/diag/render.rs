//! Diagnostics as text (by miette) and as JSON.

use std::fmt;

use miette::{GraphicalReportHandler, GraphicalTheme, LabeledSpan, NamedSource, SourceCode};
use serde_json::{Value, json};

use super::{Diagnostic, Severity};
use crate::source::{SourceFile, SourceId, SourceMap, Span};

/// How diagnostics are drawn.
#[derive(Clone, Copy, Debug)]
pub struct RenderOptions {
    /// Whether escape sequences colour it.
    pub color: bool,
    /// Columns to which text is wrapped.
    pub width: usize,
}

impl RenderOptions {
    /// No colour, 80 columns: for files, pipes and tests.
    pub fn plain() -> RenderOptions {
        RenderOptions { color: false, width: 80 }
    }
}

/// One diagnostic with its snippets.
pub fn render(diagnostic: &Diagnostic, sources: &SourceMap, options: RenderOptions) -> String {
    let theme = if options.color { GraphicalTheme::unicode() } else { GraphicalTheme::unicode_nocolor() };
    let handler = GraphicalReportHandler::new_themed(theme).with_width(options.width).with_links(false);
    let report = Report::new(diagnostic, sources);
    let mut out = String::new();
    if handler.render_report(&mut out, &report).is_err() {
        // A snippet that cannot be drawn must not cost the message.
        out = format!("{}: {}\n", diagnostic.code, diagnostic.message);
    }
    let mut out: String = out.lines().map(|l| format!("{}\n", l.trim_end())).collect();
    if out.starts_with('\n') {
        out.remove(0);
    }
    out
}

/// All diagnostics, one after the other.
pub fn render_all(diagnostics: &[Diagnostic], sources: &SourceMap, options: RenderOptions) -> String {
    let texts: Vec<String> = diagnostics.iter().map(|d| render(d, sources, options)).collect();
    texts.join("\n")
}

/// `FILE:LINE:COLUMN: error[CODE]: MESSAGE (HELP)`, as editors and `grep` read it.
pub fn to_line(diagnostic: &Diagnostic, sources: &SourceMap) -> String {
    let place = diagnostic.span().map_or(String::new(), |span| {
        let position = sources.position(span);
        format!("{}:{}:{}: ", sources.name(span.source), position.line, position.column)
    });
    let severity = diagnostic.severity.word();
    let helps = if diagnostic.helps.is_empty() { String::new() } else { format!(" ({})", diagnostic.helps.join("; ")) };
    let line = format!("{place}{severity}[{}]: {}{helps}", diagnostic.code, diagnostic.message);
    line.split_whitespace().collect::<Vec<&str>>().join(" ")
}

/// `{"code", "severity", "message", "labels": [{"file", "start", "end", "text"}], "help": […]}` with positions
/// `{"line", "column", "offset"}`: lines and columns count from 1, offsets are bytes from 0.
pub fn to_json(diagnostic: &Diagnostic, sources: &SourceMap) -> Value {
    let place = |span: Span, offset: u32| {
        let position = sources.position(Span { start: offset, end: offset, ..span });
        json!({"line": position.line, "column": position.column, "offset": offset})
    };
    let labels: Vec<Value> = diagnostic
        .labels
        .iter()
        .map(|l| {
            json!({
                "file": sources.name(l.span.source),
                "start": place(l.span, l.span.start),
                "end": place(l.span, l.span.end),
                "text": l.text,
            })
        })
        .collect();
    json!({
        "code": diagnostic.code,
        "severity": diagnostic.severity.word(),
        "message": diagnostic.message,
        "labels": labels,
        "help": diagnostic.helps,
    })
}

/// miette's view of a diagnostic: labels of the first label's file; those of other files follow as related notes.
struct Report {
    code: Option<&'static str>,
    severity: miette::Severity,
    message: String,
    source: Option<NamedSource<Excerpt>>,
    labels: Vec<LabeledSpan>,
    help: Option<String>,
    related: Vec<Report>,
}

impl Report {
    fn new(diagnostic: &Diagnostic, sources: &SourceMap) -> Report {
        let main = diagnostic.span().map(|s| s.source);
        let mut others: Vec<SourceId> = Vec::new();
        for label in &diagnostic.labels {
            if Some(label.span.source) != main && !others.contains(&label.span.source) {
                others.push(label.span.source);
            }
        }
        let related = others.iter().map(|&id| Report {
            code: None,
            severity: miette::Severity::Advice,
            message: format!("see also {}", sources.name(id)),
            source: source_of(sources, id),
            labels: labels_in(diagnostic, sources, id),
            help: None,
            related: Vec::new(),
        });
        Report {
            code: Some(diagnostic.code),
            severity: match diagnostic.severity {
                Severity::Error => miette::Severity::Error,
                Severity::Warning => miette::Severity::Warning,
                Severity::Advice => miette::Severity::Advice,
            },
            message: diagnostic.message.clone(),
            source: main.and_then(|id| source_of(sources, id)),
            labels: main.map_or_else(Vec::new, |id| labels_in(diagnostic, sources, id)),
            help: (!diagnostic.helps.is_empty()).then(|| diagnostic.helps.join("\n")),
            related: related.collect(),
        }
    }
}

fn source_of(sources: &SourceMap, id: SourceId) -> Option<NamedSource<Excerpt>> {
    sources.get(id).map(|f| NamedSource::new(&f.name, Excerpt(f.clone())))
}

fn labels_in(diagnostic: &Diagnostic, sources: &SourceMap, id: SourceId) -> Vec<LabeledSpan> {
    let Some(file) = sources.get(id) else { return Vec::new() };
    let mut labels = Vec::new();
    for (i, label) in diagnostic.labels.iter().enumerate().filter(|(_, l)| l.span.source == id) {
        let (start, end) = fit(file, label.span);
        let text = (!label.text.is_empty()).then(|| label.text.clone());
        labels.push(if i == 0 {
            LabeledSpan::new_primary_with_span(text, (start, end - start))
        } else {
            LabeledSpan::new_with_span(text, (start, end - start))
        });
    }
    labels
}

/// A span made to fit: inside the text, on character boundaries, at most one line long, not past the last line's text.
fn fit(file: &SourceFile, span: Span) -> (usize, usize) {
    let text = &file.text;
    let mut start = (span.start as usize).min(text.len());
    // The end of the file is drawn behind the last visible character.
    if start == text.len() {
        start = text.trim_end().len();
    }
    while !text.is_char_boundary(start) {
        start -= 1;
    }
    let mut end = (span.end as usize).clamp(start, text.len());
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    if let Some(newline) = text[start..end].find('\n') {
        end = start + text[start..start + newline].trim_end().len();
    }
    (start, end.max(start))
}

/// A file as miette reads it. Lines longer than what fits a screen are cut around the label.
#[derive(Debug)]
struct Excerpt(std::sync::Arc<SourceFile>);

impl SourceCode for Excerpt {
    fn read_span<'a>(
        &'a self,
        span: &miette::SourceSpan,
        before: usize,
        after: usize,
    ) -> Result<Box<dyn miette::SpanContents<'a> + 'a>, miette::MietteError> {
        const LONGEST_LINE: usize = 400;
        let file = &self.0;
        let offset = span.offset().min(file.text.len());
        let at = file.position(u32::try_from(offset).unwrap_or(u32::MAX));
        let last = file.position(u32::try_from(offset + span.len()).unwrap_or(u32::MAX)).line;
        let long = |line: usize| file.line(line).is_none_or(|(text, _)| text.len() > LONGEST_LINE);
        if before == 0 && after == 0 {
            // Asked for the place alone, for the header.
            let end = (offset + span.len()).min(file.text.len()).min(offset + LONGEST_LINE);
            let data = file.text.as_bytes().get(offset..end).unwrap_or(&[]);
            let (line, column) = (at.line - 1, at.column - 1);
            return Ok(Box::new(miette::MietteSpanContents::new(data, (offset, end - offset).into(), line, column, 1)));
        }
        let mut first_line = at.line;
        while first_line > 1 && at.line - first_line < before && !long(first_line - 1) {
            first_line -= 1;
        }
        let mut last_line = last;
        while last_line - last < after && !long(last_line + 1) {
            last_line += 1;
        }
        let (mut start, mut column) = (file.line(first_line).map_or(0, |(_, s)| s), 0);
        let mut end = file.line(last_line).map_or(file.text.len(), |(t, s)| s + t.len());
        let mut line = first_line - 1;
        if long(at.line) {
            // Only a window of a very long line.
            let boundary = |mut i: usize| {
                i = i.min(file.text.len());
                while !file.text.is_char_boundary(i) {
                    i -= 1;
                }
                i
            };
            let line_start = file.line(at.line).map_or(0, |(_, s)| s);
            start = boundary(offset.saturating_sub(30)).max(line_start);
            end = boundary((offset + span.len().min(60) + 20).min(end.max(start)));
            column = start - line_start;
            line = at.line - 1;
        }
        let end = end.max(start).max((offset + span.len()).min(file.text.len()).min(start + 2 * LONGEST_LINE));
        let data = file.text.as_bytes().get(start..end).unwrap_or(&[]);
        let count = data.iter().filter(|b| **b == b'\n').count() + 1;
        Ok(Box::new(miette::MietteSpanContents::new(data, (start, end - start).into(), line, column, count)))
    }
}

impl fmt::Debug for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for Report {}

impl miette::Diagnostic for Report {
    fn code<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        self.code.map(|c| Box::new(c) as Box<dyn fmt::Display>)
    }

    fn severity(&self) -> Option<miette::Severity> {
        Some(self.severity)
    }

    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        self.help.as_ref().map(|h| Box::new(h) as Box<dyn fmt::Display>)
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        self.source.as_ref().map(|s| s as &dyn SourceCode)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        (!self.labels.is_empty())
            .then(|| Box::new(self.labels.iter().cloned()) as Box<dyn Iterator<Item = LabeledSpan>>)
    }

    fn related<'a>(&'a self) -> Option<Box<dyn Iterator<Item = &'a dyn miette::Diagnostic> + 'a>> {
        (!self.related.is_empty())
            .then(|| Box::new(self.related.iter().map(|r| r as &dyn miette::Diagnostic)) as Box<dyn Iterator<Item = _>>)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_label_of_another_file_is_shown_and_long_lines_are_cut() {
        let mut sources = SourceMap::new();
        let a = sources.add("a.dscene", None, format!("let a = {}\nlet b = 2\n", "[".repeat(5000)));
        let b = sources.add("b.dscene", None, "let c = 3\n");
        let d = Diagnostic::error("dscene::test", "something")
            .label(Span::new(a, 3000, 3001), "here")
            .label(Span::new(b, 4, 5), "and there")
            .help("do this");
        let text = render(&d, &sources, RenderOptions::plain());
        assert!(text.contains("here") && text.contains("and there") && text.contains("help: do this"), "{text}");
        assert!(text.contains("b.dscene:1:5"), "{text}");
        assert!(text.lines().all(|l| l.chars().count() <= 120), "{text}");
        let json = to_json(&d, &sources);
        assert_eq!(json["labels"][1]["start"]["column"], 5);
        assert_eq!(json["severity"], "error");
    }

    #[test]
    fn spans_at_and_past_the_end_are_drawn() {
        for text in ["", "\n", "let a", "let a\n\n\n", "é"] {
            let mut sources = SourceMap::new();
            let a = sources.add("a.dscene", None, text);
            for (s, e) in [(0, 0), (0, 1), (1, 1), (4, 9), (50, 60)] {
                let d = Diagnostic::error("dscene::test", "wrong").label(Span::new(a, s, e), "here");
                assert!(render(&d, &sources, RenderOptions::plain()).contains("wrong"));
            }
        }
    }
}
