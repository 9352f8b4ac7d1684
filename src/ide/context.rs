//! Where in a text the cursor stands: behind a dot, at an argument, in a block. Only words and brackets are looked at, because what is
//! being written can seldom be read.

use super::lexical::{Token, TokenKind, tokens};
use super::wanted::Wanted;
use crate::syntax::snippet::operand_before;
use crate::syntax::{KINDS, is_reserved, statement_ranges, statement_words};

/// A place in a text, with what of a word is written before it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Context<'t> {
    /// Where the word, number or text begins that is being written.
    pub start: usize,
    pub prefix: &'t str,
    pub place: Place<'t>,
    /// Where the statement around begins.
    pub statement: usize,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place<'t> {
    /// In a comment, or where a new name is given.
    Nothing,
    /// In a string: the file that an import names, or an argument of a call.
    Text {
        is_import: bool,
        call: Option<Call<'t>>,
    },
    /// Behind the digits of a number.
    Number {
        digits: &'t str,
    },
    /// Behind the dot of a value.
    Field {
        base: &'t str,
    },
    /// The first word of a statement.
    Statement,
    /// Behind `import`.
    Module,
    Type,
    /// In the brackets of a call.
    Argument(Call<'t>),
    /// In the braces of a block.
    Block(Block<'t>),
    /// In the braces of a record of which something is known.
    Record(Record<'t>),
    Value,
}

/// A call that the cursor stands in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Call<'t> {
    /// `sphere`, `studio.floor`.
    pub callee: &'t str,
    /// How many arguments stand before the one at the cursor, with the one that comes from a pipe.
    pub before: usize,
    /// The names of arguments that the call has, wherever they stand.
    pub given: Vec<&'t str>,
    /// The name of the argument at the cursor.
    pub named: Option<&'t str>,
    /// Whether nothing of the argument is written but the word at the cursor: it may become a name.
    pub is_fresh: bool,
}

/// A record that the cursor stands in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Record<'t> {
    pub wanted: Wanted<'t>,
    /// The field whose value is being written.
    pub named: Option<&'t str>,
    pub given: Vec<&'t str>,
}

/// Braces that the cursor stands in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Block<'t> {
    pub owner: Owner<'t>,
    /// The field whose value is being written.
    pub named: Option<&'t str>,
    pub given: Vec<&'t str>,
}

/// Whose braces they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Owner<'t> {
    /// `camera eye { … }`
    Kind(&'t str),
    Optimize,
    Stage,
    Every,
    Then,
    Param,
    Plot,
    Report,
    Sweep,
    With,
    /// A function's or a `let`'s.
    Body,
}

/// Where the cursor stands.
pub fn context(text: &str, offset: usize) -> Context<'_> {
    let all = tokens(text);
    let statement = statement_ranges(text).into_iter().rev().find(|range| range.start <= offset);
    let statement = statement.map_or(0, |range| range.start);
    let first = all.partition_point(|t| t.start < statement);
    let end = all.partition_point(|t| t.start < offset).max(first);
    // The token that the cursor is in, or ends at.
    let here = all[first..end].last().copied().filter(|t| t.end >= offset);
    let reader = |end: usize| Reader { text, tokens: &all[first..], end: end - first };
    let (start, place) = match here {
        Some(t) if t.kind == TokenKind::Comment && (t.end > offset || t.text(text).starts_with("//")) => {
            (offset, Place::Nothing)
        }
        Some(t) if t.kind == TokenKind::String && !is_closed(t.text(text), offset - t.start) => {
            (t.start + 1, reader(end - 1).text())
        }
        Some(t) if t.kind == TokenKind::Number && t.text(text).starts_with('#') => (offset, Place::Nothing),
        Some(t) if t.kind == TokenKind::Number => {
            let number = t.text(text);
            let digits = number.find(|c: char| c.is_ascii_alphabetic() || c == '%').unwrap_or(number.len());
            (t.start, Place::Number { digits: &number[..digits] })
        }
        Some(t) if t.kind == TokenKind::Word => (t.start, reader(end - 1).place()),
        _ => (offset, reader(end).place()),
    };
    Context { start, prefix: text.get(start..offset).unwrap_or(""), place, statement }
}

/// Whether a piece of a string has ended before `at`.
fn is_closed(piece: &str, at: usize) -> bool {
    at == piece.len() && piece.len() > 1 && piece.ends_with(['"', '{'])
}

/// What stands before the word at the cursor.
#[derive(Clone, Copy)]
struct Reader<'t, 'a> {
    text: &'t str,
    /// From the first word of the statement to the end of the text.
    tokens: &'a [Token],
    /// How many of them stand before the word at the cursor.
    end: usize,
}

impl<'t> Reader<'t, '_> {
    fn word(&self, i: usize) -> &'t str {
        self.tokens.get(i).map_or("", |t| t.text(self.text))
    }

    fn is_word(&self, i: usize) -> bool {
        self.tokens.get(i).is_some_and(|t| t.kind == TokenKind::Word)
    }

    /// The brackets that are open at the cursor, outermost first.
    fn open(&self) -> Vec<usize> {
        let mut open = Vec::new();
        for i in 0..self.end {
            match self.word(i) {
                "(" | "[" | "{" if self.tokens[i].kind == TokenKind::Sign => open.push(i),
                ")" | "]" | "}" if self.tokens[i].kind == TokenKind::Sign => {
                    open.pop();
                }
                _ => {}
            }
        }
        open
    }

    fn text(&self) -> Place<'t> {
        let is_import = self.end == 1 && self.word(0) == "import";
        let call = self.open().last().filter(|open| self.word(**open) == "(").and_then(|open| self.call(*open));
        Place::Text { is_import, call }
    }

    fn place(&self) -> Place<'t> {
        let Some(last) = self.end.checked_sub(1) else { return Place::Statement };
        let (previous, before) = (self.word(last), self.word(last.wrapping_sub(1)));
        if previous == "." && before != "." {
            return Place::Field { base: operand_before(self.text, self.tokens[last].start) };
        }
        match previous {
            "import" => return Place::Module,
            "as" if self.word(0) == "import" => return Place::Nothing,
            _ => {}
        }
        let open = self.open();
        let Some(&bracket) = open.last() else { return self.outside(previous) };
        match self.word(bracket) {
            "(" if self.is_head(bracket) => match self.argument_name(bracket) {
                Some(_) => Place::Type,
                None => Place::Nothing,
            },
            "(" => self.call(bracket).map_or(Place::Value, Place::Argument),
            "{" => {
                let (named, given) = (self.field(bracket), self.given(bracket));
                match self.wanted(bracket) {
                    Some(wanted) => Place::Record(Record { wanted, named, given }),
                    None => Place::Block(Block { owner: self.owner(bracket), named, given }),
                }
            }
            _ => Place::Value,
        }
    }

    /// Outside of all brackets.
    fn outside(&self, previous: &str) -> Place<'t> {
        let first = self.word(0);
        let names = matches!(first, "let" | "param" | "loss" | "fn" | "native") || KINDS.contains(&first);
        if names && self.end == 1 {
            return Place::Nothing;
        }
        // `let x: `, `fn f(…): `
        let has_value = (0..self.end).any(|i| self.word(i) == "=");
        if names && !has_value && previous == ":" {
            return Place::Type;
        }
        let begins_line = self.tokens.get(self.end - 1).is_some_and(|t| {
            let end = self.tokens.get(self.end).map_or(self.text.len(), |t| t.start);
            self.text.get(t.end..end).is_some_and(|gap| gap.contains('\n'))
        });
        if begins_line && self.is_complete(previous) { Place::Statement } else { Place::Value }
    }

    /// Whether an expression may end with this.
    fn is_complete(&self, last: &str) -> bool {
        let goes_on = matches!(last, "with" | "in" | "to" | "over" | "if" | "then" | "else" | "and" | "or" | "not");
        let is_sign = last.chars().all(|c| !(c.is_alphanumeric() || "_\")]}%".contains(c)));
        !(goes_on || is_sign)
    }

    /// Whether a bracket holds the parameters of a function that is being declared.
    fn is_head(&self, bracket: usize) -> bool {
        bracket >= 2 && self.is_word(bracket - 1) && self.word(bracket - 2) == "fn"
    }

    /// Where the arguments or fields behind a bracket begin that stand before the cursor.
    fn parts(&self, bracket: usize) -> Vec<usize> {
        let mut depth = 0_usize;
        let mut starts = vec![bracket + 1];
        for i in bracket + 1..self.end {
            match self.word(i) {
                "(" | "[" | "{" => depth += 1,
                ")" | "]" | "}" => depth = depth.saturating_sub(1),
                "," if depth == 0 => starts.push(i + 1),
                _ => {}
            }
        }
        starts
    }

    /// `name:` before the cursor, in the argument that is being written.
    fn argument_name(&self, bracket: usize) -> Option<&'t str> {
        let start = *self.parts(bracket).last()?;
        (start + 1 < self.end && self.is_word(start) && self.word(start + 1) == ":").then(|| self.word(start))
    }

    /// All names that are given in a bracket, before the cursor and behind it, up to where it is closed.
    fn given(&self, bracket: usize) -> Vec<&'t str> {
        let mut depth = 0_usize;
        let mut names = Vec::new();
        for i in bracket + 1..self.tokens.len() {
            match self.word(i) {
                "(" | "[" | "{" => depth += 1,
                ")" | "]" | "}" if depth == 0 => break,
                ")" | "]" | "}" => depth -= 1,
                ":" if depth == 0 && self.is_word(i - 1) => names.push(self.word(i - 1)),
                // The bracket is not closed, and another statement begins.
                word if self.begins_statement(i, word) => break,
                _ => {}
            }
        }
        names
    }

    fn begins_statement(&self, i: usize, word: &str) -> bool {
        let start = self.tokens[i].start;
        let at_margin = start == 0 || self.text.as_bytes().get(start - 1) == Some(&b'\n');
        at_margin && i >= self.end && statement_words().any(|w| w == word)
    }

    fn call(&self, bracket: usize) -> Option<Call<'t>> {
        let mut first = bracket.checked_sub(1).filter(|i| self.is_word(*i))?;
        let name = self.tokens[first];
        if is_reserved(name.text(self.text)) {
            return None;
        }
        if first >= 2 && self.word(first - 1) == "." && self.is_word(first - 2) {
            first -= 2;
        }
        let callee = self.text.get(self.tokens[first].start..name.end)?;
        let is_piped = first >= 2 && self.word(first - 1) == ">" && self.word(first - 2) == "|";
        let parts = self.parts(bracket);
        Some(Call {
            callee,
            before: parts.len() - 1 + usize::from(is_piped),
            given: self.given(bracket),
            named: self.argument_name(bracket),
            is_fresh: parts.last() == Some(&self.end),
        })
    }

    /// What is known of the value that begins with a brace or a bracket.
    fn wanted(&self, at: usize) -> Option<Wanted<'t>> {
        let before = Reader { end: at, ..*self };
        let previous = self.word(at.checked_sub(1)?);
        let open = before.open().last().copied();
        match (previous, open.map(|open| self.word(open))) {
            ("(" | "," | ":", Some("(")) if open.is_none_or(|open| !self.is_head(open)) => {
                before.call(open?).map(Wanted::Argument)
            }
            ("[" | ",", Some("[")) => {
                let first = before.first_item(open?).map(Wanted::Like);
                match self.wanted(open?) {
                    Some(list) => Some(Wanted::Item(Box::new(list), first.map(Box::new))),
                    None => first,
                }
            }
            (":", Some("{")) => match self.owner(open?) {
                Owner::With => Some(Wanted::Like(self.word(at - 2))),
                _ => Some(Wanted::Field(Box::new(self.wanted(open?)?), self.word(at - 2))),
            },
            ("=", _) if matches!(self.word(at.wrapping_sub(2)), "=" | "!") => {
                Some(Wanted::Like(operand_before(self.text, self.tokens[at - 2].start)))
            }
            ("=", _) => before.annotation_before(at - 1).map(Wanted::Annotation),
            _ => None,
        }
    }

    /// The first item of a list, if the cursor is behind it.
    fn first_item(&self, bracket: usize) -> Option<&'t str> {
        let second = *self.parts(bracket).get(1)?;
        self.text.get(self.tokens[bracket].end..self.tokens[second - 1].start)
    }

    /// The type between a new name and its `=`.
    fn annotation_before(&self, equals: usize) -> Option<&'t str> {
        let named = (0..equals).rev().find(|i| matches!(self.word(*i), "let" | "param"))?;
        let colon = named + 2;
        let text = (self.word(colon) == ":").then(|| self.text.get(self.tokens[colon].end..self.tokens[equals].start));
        text?.map(str::trim)
    }

    /// The last `name:` in braces before the cursor, unless its value is complete.
    fn field(&self, bracket: usize) -> Option<&'t str> {
        let mut depth = 0_usize;
        let mut named = None;
        for i in bracket + 1..self.end {
            match self.word(i) {
                "(" | "[" | "{" => depth += 1,
                ")" | "]" | "}" => depth = depth.saturating_sub(1),
                ":" if depth == 0 && self.is_word(i - 1) => named = Some((i, self.word(i - 1))),
                "," if depth == 0 => named = None,
                _ => {}
            }
        }
        let is_open = |colon: usize| colon + 1 == self.end || !self.is_complete(self.word(self.end - 1));
        named.filter(|(colon, _)| is_open(*colon)).map(|(_, name)| name)
    }

    /// Whose braces begin at a token: the nearest word before them that may have some.
    fn owner(&self, brace: usize) -> Owner<'t> {
        let mut depth = 0_usize;
        for i in (0..brace).rev() {
            match self.word(i) {
                ")" | "]" | "}" => depth += 1,
                // A function's parameters stand in brackets of their own; an opening one ends what the braces belong to.
                "(" | "[" | "{" if depth == 0 => break,
                "(" | "[" | "{" => depth -= 1,
                _ if depth > 0 || !self.is_word(i) => {}
                "with" => return Owner::With,
                "stage" => return Owner::Stage,
                "every" => return Owner::Every,
                "then" if brace == i + 1 => return Owner::Then,
                "optimize" => return Owner::Optimize,
                "param" => return Owner::Param,
                "plot" => return Owner::Plot,
                "report" => return Owner::Report,
                "sweep" => return Owner::Sweep,
                word if KINDS.contains(&word) && i + 2 == brace => return Owner::Kind(word),
                _ => {}
            }
        }
        Owner::Body
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(marked: &str) -> (String, String) {
        let is_pipe = |at: &usize| marked[at + 1..].starts_with('>');
        let offset = marked.match_indices('|').map(|(at, _)| at).find(|at| !is_pipe(at)).unwrap();
        let text = format!("{}{}", &marked[..offset], &marked[offset + 1..]);
        let found = context(&text, offset);
        let shown = match &found.place {
            Place::Argument(call) => format!(
                "argument {} of {} named {:?} given {:?}{}",
                call.before,
                call.callee,
                call.named,
                call.given,
                if call.is_fresh { " fresh" } else { "" }
            ),
            Place::Block(block) => format!("block {:?} named {:?} given {:?}", block.owner, block.named, block.given),
            Place::Record(record) => {
                let wanted = shown_record(&record.wanted);
                format!("record {wanted} named {:?} given {:?}", record.named, record.given)
            }
            Place::Field { base } => format!("field of {base}"),
            Place::Number { digits } => format!("number {digits}"),
            Place::Text { is_import, call } => {
                format!("text {is_import} of {:?}", call.as_ref().map(|c| c.callee))
            }
            other => format!("{other:?}"),
        };
        (found.prefix.to_owned(), shown)
    }

    fn shown_record(wanted: &Wanted) -> String {
        match wanted {
            Wanted::Argument(call) => {
                let which = call.named.map_or(call.before.to_string(), str::to_owned);
                format!("Argument {which} of {}", call.callee)
            }
            Wanted::Annotation(text) => (*text).to_owned(),
            Wanted::Like(value) => format!("like {value}"),
            Wanted::Field(of, name) => format!("{name} of {}", shown_record(of)),
            Wanted::Item(list, first) => {
                let first = first.as_ref().map_or(String::new(), |first| format!(" or {}", shown_record(first)));
                format!("item of {}{first}", shown_record(list))
            }
        }
    }

    #[test]
    fn places_are_told_by_what_stands_before_them() {
        for (marked, prefix, place) in [
            ("le|", "le", "Statement"),
            ("let a = 1\npa|", "pa", "Statement"),
            ("let a = 1 +\n  pa|", "pa", "Value"),
            ("let a|", "a", "Nothing"),
            ("let a = re|", "re", "Value"),
            ("let a: sc|", "sc", "Type"),
            ("fn f(x: v|", "v", "Type"),
            ("fn f(x|", "x", "Nothing"),
            ("fn f(x: vec3, y|) = x", "y", "Nothing"),
            ("import |", "", "Module"),
            ("import \"li|", "li", "text true of None"),
            ("let a = load(\"a/b|\")", "a/b", "text false of Some(\"load\")"),
            ("let a = \"x|\"", "x", "text false of None"),
            ("let a = \"n is {n|}\"", "n", "Value"),
            ("// le|", "", "Nothing"),
            ("let a = 1 // re|\nlet b = 2", "", "Nothing"),
            ("let a = 45de|", "45de", "number 45"),
            ("let a = lamp.ra|", "ra", "field of lamp"),
            ("let a = f(x, [1])[0].|", "", "field of f(x, [1])[0]"),
            ("let a = 0..|", "", "Value"),
            ("let a = sphere(ra|", "ra", "argument 0 of sphere named None given [] fresh"),
            (
                "let a = sphere(radius: |, x: 2)\nlet b = f(y: 1)",
                "",
                "argument 0 of sphere named Some(\"radius\") given [\"radius\", \"x\"]",
            ),
            ("let a = m |> translate(|", "", "argument 1 of translate named None given [] fresh"),
            ("let a = studio.floor(1, 2 + |", "", "argument 1 of studio.floor named None given []"),
            ("let a = sphere(\nlet b = f(y: 1)|", "", "Value"),
            ("camera eye { f|", "f", "block Kind(\"camera\") named None given []"),
            (
                "camera eye {\n  fov: 45deg\n  po|\n  film: [1, 2]\n}",
                "po",
                "block Kind(\"camera\") named None given [\"fov\", \"film\"]",
            ),
            ("camera eye { kind: or|", "or", "block Kind(\"camera\") named Some(\"kind\") given [\"kind\"]"),
            ("camera eye { fov: 2 * |", "", "block Kind(\"camera\") named Some(\"fov\") given [\"fov\"]"),
            ("optimize l { s|", "s", "block Optimize named None given []"),
            ("optimize l { stage a { s|", "s", "block Stage named None given []"),
            ("optimize l { stage a { then { |", "", "block Then named None given []"),
            ("optimize l { every 5 { |", "", "block Every named None given []"),
            ("param a = 1 in 0..1 { l|", "l", "block Param named None given []"),
            ("let b = render(eye) with { la|", "la", "block With named None given []"),
            ("let b = render(eye) with { a: f(1), b: |", "", "block With named Some(\"b\") given [\"a\", \"b\"]"),
            ("fn f(x) {\n  let a = 1\n  |", "", "block Body named None given []"),
            ("plot a { |", "", "block Plot named None given []"),
            ("let a = far({ c|", "c", "record Argument 0 of far named None given []"),
            ("let a = far(2, view: { cam: eye, |", "", "record Argument view of far named None given [\"cam\"]"),
            ("let a = far({ cam: ey|", "ey", "record Argument 0 of far named Some(\"cam\") given [\"cam\"]"),
            ("let a = far([{ a: 1 }, { |", "", "record item of Argument 0 of far or like { a: 1 } named None given []"),
            ("let a: { x: scalar, y: vec3 } = { |", "", "record { x: scalar, y: vec3 } named None given []"),
            ("fn f(x) {\n  let a: { x: scalar } = { |", "", "record { x: scalar } named None given []"),
            ("let a = [{ x: 1, y: [2, 3] }, { |", "", "record like { x: 1, y: [2, 3] } named None given []"),
            ("let a = far({ pose: { |", "", "record pose of Argument 0 of far named None given []"),
            ("let b = s with { view: { |", "", "record like view named None given []"),
            ("expect view == { |", "", "record like view named None given []"),
            ("let a = { |", "", "block Body named None given []"),
            ("let a = x => { |", "", "block Body named None given []"),
            ("fn far(view: { |", "", "block Body named None given []"),
        ] {
            assert_eq!(at(marked), (prefix.to_owned(), place.to_owned()), "{marked}");
        }
    }
}
