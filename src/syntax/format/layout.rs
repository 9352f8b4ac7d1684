//! The layout algebra: documents with places where a line may break, and their printing within a width (after Wadler, “A prettier
//! printer”, 2003). Printing is iterative and looks at most one line ahead, so deep and long documents cost no stack and linear time.

use std::slice;

/// Lines have at most so many columns, where the text has places to break them.
pub const WIDTH: usize = 100;

const INDENT: usize = 2;

/// A piece of a text to lay out.
#[derive(Debug)]
pub enum Doc<'t> {
    Text(&'t str),
    /// A blank, but for where a line begins.
    Space,
    /// Where a line breaks if its group does; otherwise the text.
    Line(&'static str),
    /// Begins a line, if none was just begun.
    Fresh,
    /// An empty line, if a line was just begun.
    Blank,
    /// Nothing but a line's end may follow a comment that ends its line.
    Comment {
        text: &'t str,
        ends_line: bool,
    },
    /// What stands there in a group on one line, or in one that is broken.
    Choice {
        flat: &'static str,
        broken: &'static str,
    },
    /// On one line if it fits there, and otherwise with a break at each `Line` in it (but not in groups within).
    Group(Group<'t>),
    /// What follows a `=`: on its line if it fits there, else whole on the next line, else broken from its own line on.
    Hang(Group<'t>),
    /// Broken lines are indented.
    Nest(Vec<Doc<'t>>),
    /// A list of numbers, or of lists of them.
    Rows(Rows<'t>),
}

#[derive(Debug)]
pub struct Group<'t> {
    pub docs: Vec<Doc<'t>>,
    /// It begins with a bracket and ends with it.
    pub is_bracket: bool,
    pub is_broken: bool,
}

/// Items in square brackets: on one line if they fit there, else as many a line as fit. Commas follow items, not comments.
#[derive(Debug)]
pub struct Rows<'t> {
    pub items: Vec<Doc<'t>>,
    /// Each item has a line.
    pub is_column: bool,
    pub is_broken: bool,
}

impl<'t> Doc<'t> {
    pub fn group(docs: Vec<Doc<'t>>) -> Doc<'t> {
        let is_broken = docs.iter().any(Doc::breaks);
        Doc::Group(Group { docs, is_bracket: false, is_broken })
    }

    pub fn bracket(docs: Vec<Doc<'t>>, is_broken: bool) -> Doc<'t> {
        let is_broken = is_broken || docs.iter().any(Doc::breaks);
        Doc::Group(Group { docs, is_bracket: true, is_broken })
    }

    pub fn rows(items: Vec<Doc<'t>>, is_column: bool) -> Doc<'t> {
        // A row that takes several lines stands alone.
        let is_column = is_column || items.iter().any(|item| !item.is_comment() && item.breaks());
        let is_broken = is_column || items.iter().any(Doc::breaks);
        Doc::Rows(Rows { items, is_column, is_broken })
    }

    /// Whether it cannot stand on one line: all groups around it break too.
    fn breaks(&self) -> bool {
        match self {
            Doc::Fresh => true,
            Doc::Comment { text, ends_line } => *ends_line || text.contains('\n'),
            Doc::Group(group) | Doc::Hang(group) => group.is_broken,
            Doc::Rows(rows) => rows.is_broken,
            Doc::Nest(docs) => docs.iter().any(Doc::breaks),
            Doc::Text(_) | Doc::Space | Doc::Line(_) | Doc::Blank | Doc::Choice { .. } => false,
        }
    }

    fn is_comment(&self) -> bool {
        matches!(self, Doc::Comment { .. } | Doc::Fresh | Doc::Blank)
    }
}

/// What is still to be printed at one level.
#[derive(Clone, Debug)]
enum Frame<'d, 't> {
    Docs { rest: slice::Iter<'d, Doc<'t>>, indent: usize, is_broken: bool },
    Rows { rest: slice::Iter<'d, Doc<'t>>, indent: usize, is_broken: bool, is_column: bool, state: RowsState },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum RowsState {
    /// Nothing but comments was printed.
    Empty,
    /// The last item lacks its comma.
    Item,
    /// The last item has its comma; a comment followed.
    Comma,
}

#[derive(Debug, Default)]
pub struct Printer {
    pub out: String,
    column: usize,
    /// A line was begun, and its indentation is not written yet.
    is_fresh: bool,
    /// A comment waits for the end of its line.
    is_ending: bool,
}

impl Printer {
    pub fn new(capacity: usize) -> Printer {
        Printer { out: String::with_capacity(capacity), is_fresh: true, ..Printer::default() }
    }

    pub fn print(&mut self, docs: &[Doc]) {
        let mut stack = vec![Frame::Docs { rest: docs.iter(), indent: 0, is_broken: true }];
        while let Some(top) = stack.last_mut() {
            match top {
                Frame::Docs { rest, indent, is_broken } => {
                    let (indent, is_broken) = (*indent, *is_broken);
                    match rest.next() {
                        Some(doc) => self.doc(doc, indent, is_broken, &mut stack),
                        None => drop(stack.pop()),
                    }
                }
                Frame::Rows { rest, indent, is_broken, is_column, state } => {
                    let (indent, is_broken, is_column, before) = (*indent, *is_broken, *is_column, *state);
                    let Some(item) = rest.next() else {
                        stack.pop();
                        self.end_of_rows(indent, is_broken, before);
                        continue;
                    };
                    let is_comment = item.is_comment();
                    *state = match (is_comment, before) {
                        (true, RowsState::Item) => RowsState::Comma,
                        (true, before) => before,
                        (false, _) => RowsState::Item,
                    };
                    let goes_on = !is_comment || rest.as_slice().iter().any(|item| !item.is_comment());
                    if before == RowsState::Item && (is_broken || goes_on) {
                        self.text(",", indent);
                    }
                    match item {
                        // It belongs to what follows, not to the bracket.
                        Doc::Comment { ends_line: false, .. }
                            if is_column || is_broken && before == RowsState::Empty =>
                        {
                            self.fresh()
                        }
                        _ if is_comment => {}
                        _ => self.before_item(item, indent + INDENT, is_broken, is_column),
                    }
                    stack.push(Frame::Docs { rest: slice::from_ref(item).iter(), indent: indent + INDENT, is_broken });
                }
            }
        }
    }

    fn doc<'d, 't>(&mut self, doc: &'d Doc<'t>, indent: usize, is_broken: bool, stack: &mut Vec<Frame<'d, 't>>) {
        match doc {
            Doc::Text(text) => self.text(text, indent),
            Doc::Space if self.is_fresh || self.is_ending => {}
            Doc::Space => self.text(" ", indent),
            Doc::Line(_) if is_broken => self.newline(),
            Doc::Line(flat) => self.text(flat, indent),
            Doc::Fresh => self.fresh(),
            Doc::Blank => self.blank(),
            Doc::Comment { text, ends_line } => {
                let is_apart = self.out.ends_with(' ') || !ends_line && self.out.ends_with(['(', '[']);
                if !self.is_fresh && !self.is_ending && !is_apart {
                    self.text(" ", indent);
                }
                self.text(text, indent);
                self.is_ending = *ends_line;
            }
            Doc::Choice { flat, broken } => self.text(if is_broken { broken } else { flat }, indent),
            Doc::Nest(docs) => stack.push(Frame::Docs { rest: docs.iter(), indent: indent + INDENT, is_broken }),
            Doc::Group(group) => {
                let inside = Frame::Docs { rest: group.docs.iter(), indent, is_broken: false };
                let is_broken = group.is_broken || is_broken && !self.fits(inside, stack, 0);
                stack.push(Frame::Docs { rest: group.docs.iter(), indent, is_broken });
            }
            Doc::Hang(group) => {
                let frame = |indent, is_broken| Frame::Docs { rest: group.docs.iter(), indent, is_broken };
                // With the blank before it.
                let is_whole = !group.is_broken && (!is_broken || self.fits(frame(indent, false), stack, 1));
                if !is_whole && !group.is_broken && self.fits_on_next_line(frame(indent + INDENT, false), stack) {
                    self.newline();
                    stack.push(frame(indent + INDENT, false));
                } else {
                    self.text(" ", indent);
                    stack.push(frame(indent, !is_whole));
                }
            }
            Doc::Rows(rows) => {
                self.text("[", indent);
                let frame = |is_broken| Frame::Rows {
                    rest: rows.items.iter(),
                    indent,
                    is_broken,
                    is_column: rows.is_column,
                    state: RowsState::Empty,
                };
                let is_broken = rows.is_broken || is_broken && !self.fits(frame(false), stack, 0);
                stack.push(frame(is_broken));
            }
        }
    }

    /// What stands between the items of a list of numbers.
    fn before_item(&mut self, item: &Doc, indent: usize, is_broken: bool, is_column: bool) {
        if self.is_fresh || self.is_ending {
            return;
        }
        let is_first = self.out.ends_with('[');
        let rest = Frame::Docs { rest: slice::from_ref(item).iter(), indent, is_broken: false };
        match is_broken {
            true if is_first => self.newline(),
            // A comment that it begins with.
            true if is_column && self.out.ends_with("*/") => self.text(" ", indent),
            // With the blank before it and the comma behind it.
            true if is_column || !self.fits(rest, &[], 2) => self.newline(),
            _ if is_first => {}
            _ => self.text(" ", indent),
        }
    }

    fn end_of_rows(&mut self, indent: usize, is_broken: bool, state: RowsState) {
        if is_broken {
            if state == RowsState::Item {
                self.text(",", indent);
            }
            self.fresh();
        }
        self.text("]", indent);
    }

    fn text(&mut self, text: &str, indent: usize) {
        if text.is_empty() {
            return;
        }
        if self.is_ending {
            self.newline();
        }
        if self.is_fresh {
            self.out.extend(std::iter::repeat_n(' ', indent));
            self.column = indent;
            self.is_fresh = false;
        }
        self.out.push_str(text);
        match text.rfind('\n') {
            Some(at) => self.column = columns(&text[at + 1..]),
            None => self.column += columns(text),
        }
    }

    fn newline(&mut self) {
        self.is_ending = false;
        if !self.is_fresh {
            self.out.truncate(self.out.trim_end_matches(' ').len());
            self.out.push('\n');
            self.is_fresh = true;
        }
    }

    fn fresh(&mut self) {
        if self.is_ending || !self.is_fresh {
            self.newline();
        }
    }

    fn blank(&mut self) {
        if self.is_ending {
            self.newline();
        }
        if self.is_fresh && !self.out.is_empty() && !self.out.ends_with("\n\n") {
            self.out.push('\n');
        }
    }

    fn fits_on_next_line(&mut self, inside: Frame, behind: &[Frame]) -> bool {
        let was_fresh = std::mem::replace(&mut self.is_fresh, true);
        let fits = self.fits(inside, behind, 0);
        self.is_fresh = was_fresh;
        fits
    }

    /// Whether what is `inside`, and what follows it up to where the next line may break, fits into the rest of the line, of which `taken`
    /// columns are left.
    fn fits(&self, inside: Frame, behind: &[Frame], taken: usize) -> bool {
        let (Frame::Docs { indent, .. } | Frame::Rows { indent, .. }) = inside;
        // A line that has nothing in it yet begins with its indentation.
        let column = if self.is_fresh { indent } else { self.column };
        let Some(mut left) = WIDTH.checked_sub(column + taken) else { return false };
        let mut stack = vec![inside];
        let mut behind = behind.iter().rev();
        loop {
            let Some(top) = stack.last_mut() else {
                let Some(next) = behind.next() else { return true };
                stack.push(next.clone());
                continue;
            };
            let width = match top {
                Frame::Docs { rest, is_broken, .. } => {
                    let is_broken = *is_broken;
                    match rest.next() {
                        None => {
                            stack.pop();
                            0
                        }
                        Some(Doc::Text(text)) => columns(text),
                        Some(Doc::Space) => 1,
                        Some(Doc::Line(_) | Doc::Fresh) if is_broken => return true,
                        Some(Doc::Line(flat)) => flat.len(),
                        Some(Doc::Fresh | Doc::Comment { ends_line: true, .. }) => return true,
                        Some(Doc::Comment { text, .. }) => match text.split_once('\n') {
                            Some((first, _)) => return columns(first) < left,
                            None => columns(text) + 1,
                        },
                        Some(Doc::Blank) => 0,
                        Some(Doc::Choice { flat, broken }) => if is_broken { broken } else { flat }.len(),
                        Some(Doc::Nest(docs)) => {
                            stack.push(Frame::Docs { rest: docs.iter(), indent: 0, is_broken });
                            0
                        }
                        Some(Doc::Hang(_)) if is_broken => return true,
                        Some(Doc::Hang(group)) => {
                            stack.push(Frame::Docs { rest: group.docs.iter(), indent: 0, is_broken });
                            1
                        }
                        // What follows may break where it likes.
                        Some(Doc::Group(group)) => {
                            stack.push(Frame::Docs { rest: group.docs.iter(), indent: 0, is_broken });
                            0
                        }
                        Some(Doc::Rows(_)) if is_broken => return left > 0,
                        Some(Doc::Rows(rows)) => {
                            stack.push(Frame::Rows {
                                rest: rows.items.iter(),
                                indent: 0,
                                is_broken: false,
                                is_column: false,
                                state: RowsState::Empty,
                            });
                            1
                        }
                    }
                }
                Frame::Rows { is_broken: true, .. } => return true,
                Frame::Rows { rest, state, .. } => match rest.next() {
                    None => {
                        stack.pop();
                        1
                    }
                    // It vanishes where all stands on one line.
                    Some(Doc::Blank) => 0,
                    Some(item) => {
                        let separator = if *state == RowsState::Empty { 0 } else { 2 };
                        *state = RowsState::Item;
                        stack.push(Frame::Docs { rest: slice::from_ref(item).iter(), indent: 0, is_broken: false });
                        separator
                    }
                },
            };
            let Some(rest) = left.checked_sub(width) else { return false };
            left = rest;
        }
    }
}

fn columns(text: &str) -> usize {
    if text.is_ascii() { text.len() } else { text.chars().count() }
}
