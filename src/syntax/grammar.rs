//! The readers of `grammar/dscene.pest`: a fast one of right statements, made by `grammar/build.rs`, and pest's, which says what is wrong.

#![allow(missing_docs)]

use pest::Parser as _;
use pest::error::Error;
use pest_derive::Parser;

/// pest's parser.
#[derive(Parser)]
#[grammar = "../grammar/dscene.pest"]
struct Grammar;

/// A rule that matched, its place, and behind it the list what matched within it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Node {
    rule: Rule,
    start: u32,
    end: u32,
    /// The node after all that are within this one.
    next: u32,
}

/// Reads a text by a rule into `nodes`, whose memory is used again; or says where and why it stopped.
pub fn read<'t>(rule: Rule, text: &'t str, nodes: &'t mut Vec<Node>) -> Result<Pair<'t>, Box<Error<Rule>>> {
    nodes.clear();
    let mut reader = Reader { text: text.as_bytes(), at: 0, nodes };
    let is_read = match rule {
        Rule::line => fast::line(&mut reader),
        _ => fast::statement(&mut reader),
    };
    if is_read && text.len() < u32::MAX as usize {
        return Ok(Pair { nodes, text, at: 0 });
    }
    Err(Box::new(Grammar::parse(rule, text).err().unwrap_or_else(|| {
        let variant = pest::error::ErrorVariant::ParsingError { positives: Vec::new(), negatives: Vec::new() };
        Error::new_from_pos(variant, pest::Position::from_start(text))
    })))
}

/// Whether both readers find the same in a text, or both refuse it.
pub fn agree(rule: Rule, text: &str) -> bool {
    fn list(pairs: pest::iterators::Pairs<Rule>, nodes: &mut Vec<Node>) {
        for pair in pairs {
            let (at, span) = (nodes.len(), pair.as_span());
            nodes.push(Node { rule: pair.as_rule(), start: span.start() as u32, end: span.end() as u32, next: 0 });
            list(pair.into_inner(), nodes);
            nodes[at].next = nodes.len() as u32;
        }
    }
    let (mut ours, mut theirs) = (Vec::new(), Vec::new());
    let is_read = read(rule, text, &mut ours).is_ok();
    match Grammar::parse(rule, text) {
        Ok(pairs) => list(pairs, &mut theirs),
        Err(_) => return !is_read,
    }
    is_read && ours == theirs
}

/// A rule that matched.
#[derive(Clone, Copy)]
pub struct Pair<'t> {
    nodes: &'t [Node],
    text: &'t str,
    at: u32,
}

impl<'t> Pair<'t> {
    #[inline]
    fn node(&self) -> Node {
        self.nodes[self.at as usize]
    }

    #[inline]
    pub fn as_rule(&self) -> Rule {
        self.node().rule
    }

    /// Where it begins, in bytes of the text.
    #[inline]
    pub fn start(&self) -> usize {
        self.node().start as usize
    }

    #[inline]
    pub fn as_str(&self) -> &'t str {
        let node = self.node();
        &self.text[node.start as usize..node.end as usize]
    }

    /// Its text without white space at the end, which rules whose last parts may be missing can have.
    #[inline]
    pub fn trimmed(&self) -> &'t str {
        let text = self.as_str();
        if text.bytes().next_back().is_some_and(|b| b.is_ascii_graphic()) { text } else { text.trim_end() }
    }

    /// What matched within it, one after another.
    #[inline]
    pub fn into_inner(self) -> Pairs<'t> {
        Pairs { nodes: self.nodes, text: self.text, at: self.at + 1, end: self.node().next }
    }
}

/// Rules that matched one after another.
#[derive(Clone)]
pub struct Pairs<'t> {
    nodes: &'t [Node],
    text: &'t str,
    at: u32,
    end: u32,
}

impl<'t> Pairs<'t> {
    #[inline]
    pub fn peek(&self) -> Option<Pair<'t>> {
        (self.at < self.end).then_some(Pair { nodes: self.nodes, text: self.text, at: self.at })
    }

    /// How many are still to come.
    pub fn len(&self) -> usize {
        self.clone().count()
    }
}

impl<'t> Iterator for Pairs<'t> {
    type Item = Pair<'t>;

    #[inline]
    fn next(&mut self) -> Option<Pair<'t>> {
        let pair = self.peek()?;
        self.at = pair.node().next;
        Some(pair)
    }
}

/// A text, how far it is read, and what was found. Every function that reads tells whether it did, and changes nothing if not.
///
/// What all rules call is always inlined: whether the compiler does so by itself depends on how it cuts the crate into parts, and a call at each
/// byte doubles the time.
struct Reader<'t> {
    text: &'t [u8],
    at: usize,
    nodes: &'t mut Vec<Node>,
}

/// A place to return to.
#[derive(Clone, Copy)]
struct Mark {
    at: usize,
    nodes: usize,
}

impl Reader<'_> {
    #[inline(always)]
    fn mark(&self) -> Mark {
        Mark { at: self.at, nodes: self.nodes.len() }
    }

    /// Returns, as from what did not match.
    #[inline(always)]
    fn back(&mut self, mark: Mark) -> bool {
        self.at = mark.at;
        self.nodes.truncate(mark.nodes);
        false
    }

    /// Begins the node of a rule.
    #[inline(always)]
    fn open(&mut self, rule: Rule) -> usize {
        let at = self.at as u32;
        self.nodes.push(Node { rule, start: at, end: at, next: 0 });
        self.nodes.len() - 1
    }

    #[inline(always)]
    fn close(&mut self, node: usize) -> bool {
        let (end, next) = (self.at as u32, self.nodes.len() as u32);
        let node = &mut self.nodes[node];
        (node.end, node.next) = (end, next);
        true
    }

    #[inline(always)]
    fn cancel(&mut self, node: usize) -> bool {
        self.nodes.truncate(node);
        false
    }

    /// A node of nothing.
    fn note(&mut self, rule: Rule) -> bool {
        let node = self.open(rule);
        self.close(node)
    }

    #[inline(always)]
    fn next_is(&self, is: impl Fn(u8) -> bool) -> bool {
        self.text.get(self.at).is_some_and(|b| is(*b))
    }

    #[inline(always)]
    fn one(&mut self, is: impl Fn(u8) -> bool) -> bool {
        let found = self.next_is(is);
        self.at += usize::from(found);
        found
    }

    #[inline(always)]
    fn many(&mut self, is: impl Fn(u8) -> bool) -> bool {
        while self.next_is(&is) {
            self.at += 1;
        }
        true
    }

    #[inline(always)]
    fn text(&mut self, text: &str) -> bool {
        let found = self.text[self.at..].starts_with(text.as_bytes());
        self.at += if found { text.len() } else { 0 };
        found
    }

    /// One character of any kind.
    fn any(&mut self) -> bool {
        let found = self.at < self.text.len();
        self.at += usize::from(found);
        self.many(|b| (0x80..0xc0).contains(&b)) && found
    }

    fn begins(&self) -> bool {
        self.at == 0
    }

    fn ends(&self) -> bool {
        self.at == self.text.len()
    }
}

/// A function for each rule of the grammar, and each way in which it is called.
#[allow(clippy::all, clippy::pedantic, unused_parens, unused_braces, unused_mut, non_snake_case)]
mod fast {
    use super::{Reader, Rule};

    include!(concat!(env!("OUT_DIR"), "/reader.rs"));

    pub(super) fn statement(s: &mut Reader) -> bool {
        statement_spaced(s)
    }

    pub(super) fn line(s: &mut Reader) -> bool {
        line_spaced(s)
    }
}
