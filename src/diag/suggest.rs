//! "Did you mean": case-insensitive matches first, then the nearest spelling.

use std::collections::HashMap;

/// The candidate that `name` was probably meant to be: equal but for case and underscores, else
/// within an edit distance of max(1, length / 3).
pub fn suggest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let wanted = Spelling::new(name);
    let mut best: Option<(usize, &str)> = None;
    for candidate in candidates.into_iter().filter(|c| *c != name) {
        let limit = best.map_or(usize::MAX, |(d, _)| d);
        if let Some(distance) = wanted.distance(&Spelling::new(candidate), limit, &mut usize::MAX.clone()) {
            best = Some((distance, candidate));
        }
    }
    best.map(|(_, candidate)| candidate)
}

/// Names that are looked through again and again, in alphabetical order.
#[derive(Debug, Default)]
pub struct Names {
    all: Vec<(String, Spelling)>,
    /// By spelling without case and underscores: the first of them.
    plain: HashMap<String, usize>,
}

impl Names {
    pub fn new<'a>(names: impl IntoIterator<Item = &'a str>) -> Names {
        let mut all: Vec<(String, Spelling)> =
            names.into_iter().map(|name| (name.to_owned(), Spelling::new(name))).collect();
        all.sort_unstable_by(|a, b| a.0.cmp(&b.0));
        let mut plain = HashMap::new();
        for (i, (_, spelling)) in all.iter().enumerate() {
            plain.entry(spelling.plain()).or_insert(i);
        }
        Names { all, plain }
    }

    /// What [`suggest`] finds among them. Looking through all of them takes from `budget`; with nothing left, only names that
    /// differ in case and underscores are found: of ten thousand names that are not declared, nobody reads each advice.
    pub fn nearest(&self, name: &str, budget: &mut usize) -> Option<&str> {
        let wanted = Spelling::new(name);
        if let Some(&same) = self.plain.get(&wanted.plain())
            && self.all[same].0 != name
        {
            return Some(&self.all[same].0);
        }
        if *budget < self.all.len() {
            return None;
        }
        *budget -= self.all.len();
        let mut best: Option<(usize, &str)> = None;
        for (candidate, spelling) in self.all.iter().filter(|(c, _)| c != name) {
            let limit = best.map_or(usize::MAX, |(d, _)| d);
            if let Some(distance) = wanted.distance(spelling, limit, budget) {
                best = Some((distance, candidate));
            }
        }
        best.map(|(_, candidate)| candidate)
    }
}

/// A name as it is compared: without case, with what tells quickly that two are not alike.
#[derive(Debug)]
struct Spelling {
    lower: String,
    length: usize,
    underscores: usize,
    /// One bit for each letter that it has.
    letters: u64,
}

impl Spelling {
    /// What comparing two names letter by letter costs, in glances at a name.
    const COMPARISON: usize = 100;

    fn new(name: &str) -> Spelling {
        let lower = name.to_lowercase();
        let (mut length, mut letters) = (0, 0);
        for c in lower.chars() {
            length += 1;
            letters |= 1 << (u32::from(c) % 64);
        }
        let underscores = lower.bytes().filter(|b| *b == b'_').count();
        Spelling { lower, length, underscores, letters }
    }

    fn plain(&self) -> String {
        self.lower.replace('_', "")
    }

    /// The edit distance to another name, if that is similar and nearer than `limit`.
    fn distance(&self, other: &Spelling, limit: usize, budget: &mut usize) -> Option<usize> {
        let same = self.lower.len().abs_diff(other.lower.len()) <= self.underscores.max(other.underscores)
            && self.plain() == other.plain();
        if same {
            return (limit > 0).then_some(0);
        }
        // Of a name of one letter nothing would be left.
        let most = (self.length / 3).max(1).min(self.length.saturating_sub(1)).min(limit.saturating_sub(1));
        let missing = (self.letters & !other.letters).count_ones().max((other.letters & !self.letters).count_ones());
        if self.length.abs_diff(other.length) > most || missing as usize > most || *budget < Spelling::COMPARISON {
            return None;
        }
        *budget -= Spelling::COMPARISON;
        let distance = strsim::damerau_levenshtein(&self.lower, &other.lower);
        (distance <= most).then_some(distance)
    }
}

/// A help text: the nearest spelling, else the list of what exists (if that is short enough to read).
pub fn did_you_mean<'a>(
    name: &str,
    what: &str,
    candidates: impl IntoIterator<Item = &'a str> + Clone,
) -> Option<String> {
    if let Some(found) = suggest(name, candidates.clone()) {
        return Some(format!("did you mean `{found}`?"));
    }
    let mut all: Vec<&str> = candidates.into_iter().collect();
    all.sort_unstable();
    all.dedup();
    if all.is_empty() || all.len() > 24 {
        return None;
    }
    let list: Vec<String> = all.iter().map(|c| format!("`{c}`")).collect();
    Some(format!("{what}: {}", list.join(", ")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn case_comes_before_distance() {
        assert_eq!(suggest("Lookat", ["lookas", "look_at"]), Some("look_at"));
        assert_eq!(suggest("positon", ["position", "up"]), Some("position"));
        assert_eq!(suggest("w", ["x", "y"]), None);
        assert_eq!(suggest("xyzzy", ["position", "up"]), None);
        assert_eq!(did_you_mean("q", "the fields are", ["ab", "cd"]), Some("the fields are: `ab`, `cd`".into()));
    }
}
