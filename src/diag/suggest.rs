//! "Did you mean": case-insensitive matches first, then the nearest spelling.

/// The candidate that `name` was probably meant to be: equal but for case and underscores, else
/// within an edit distance of max(1, length / 3).
pub fn suggest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let plain = |s: &str| s.replace('_', "").to_lowercase();
    let wanted = plain(name);
    let limit = (name.chars().count() / 3).max(1);
    let mut best: Option<(usize, &str)> = None;
    for candidate in candidates {
        if candidate == name {
            continue;
        }
        let distance = if plain(candidate) == wanted {
            0
        } else {
            strsim::damerau_levenshtein(&name.to_lowercase(), &candidate.to_lowercase())
        };
        // Of a name of one letter nothing would be left.
        let similar = distance <= limit && distance < name.chars().count();
        if similar && best.is_none_or(|(d, _)| distance < d) {
            best = Some((distance, candidate));
        }
    }
    best.map(|(_, candidate)| candidate)
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
