//! Integers of files that no double is equal to, as identifiers are at times.

/// The first of the integers of a file that were rounded, with its place in words.
#[derive(Debug, Default, PartialEq)]
pub struct Rounded {
    first: Option<String>,
    count: usize,
}

impl Rounded {
    /// Looks at a number as it is written. Only integers count: of a fraction nobody expects all digits.
    pub fn see(&mut self, written: &str, place: impl FnOnce() -> String) {
        // Fifteen digits are exact in every double.
        if written.len() <= 15 {
            return;
        }
        let digits = written.strip_prefix(['-', '+']).unwrap_or(written);
        if digits.len() <= 15 || !digits.bytes().all(|b| b.is_ascii_digit()) {
            return;
        }
        let digits = digits.trim_start_matches('0');
        let Ok(taken) = digits.parse::<f64>() else { return };
        // The shortest digits that mean this double are what programs write of it; the other text is its exact value.
        if digits.is_empty() || taken.to_string() == digits || format!("{taken:.0}") == digits {
            return;
        }
        self.count += 1;
        let sign = if written.starts_with('-') { "-" } else { "" };
        self.first.get_or_insert_with(|| format!("{sign}{digits} {}, taken as {sign}{taken:.0}", place()));
    }

    /// The sentence about them, if there are any.
    pub fn note(self) -> Option<String> {
        let first = self.first?;
        Some(match self.count {
            1 => format!("an integer beyond 2^53 is rounded: {first}"),
            n => format!("{n} integers beyond 2^53 are rounded; the first is {first}"),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_integers_that_no_double_equals_are_rounded() {
        let note = |numbers: &[&str]| {
            let mut rounded = Rounded::default();
            numbers.iter().enumerate().for_each(|(i, x)| rounded.see(x, || format!("in row {i}")));
            rounded.note()
        };
        let large = (1_u64 << 60).to_string();
        let written = 1.234_567_890_123_456_7e30_f64.to_string();
        let exact = ["9007199254740992", "9007199254740994", &large, &written, "1e300", "0.1234567890123456789", "7"];
        assert_eq!(note(&exact), None);
        assert_eq!(note(&["0000000000000000000", "-00000000000000000012", "1e17", "abcdefabcdefabcdef"]), None);
        let one = "an integer beyond 2^53 is rounded: 9007199254740993 in row 1, taken as 9007199254740992";
        assert_eq!(note(&["1", "9007199254740993"]).as_deref(), Some(one));
        let two = "2 integers beyond 2^53 are rounded; the first is -123456789012345678901 in row 0, taken as \
                   -123456789012345683968";
        assert_eq!(note(&["-123456789012345678901", "36893488147419103231"]).as_deref(), Some(two));
    }
}
