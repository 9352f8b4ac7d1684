//! Numbers of files that no double is equal to: long integers, as identifiers are at times, and what is so small that it is taken as 0.

/// The first of the numbers of a file that were rounded, with its place in words.
#[derive(Debug, Default, PartialEq)]
pub struct Rounded {
    first: Option<String>,
    count: usize,
    /// The same of those that are not 0 and were taken as that.
    first_lost: Option<String>,
    lost: usize,
}

impl Rounded {
    /// Looks at a number as it is written. Of fractions nobody expects all digits, but that they are not 0.
    pub fn see(&mut self, written: &str, place: impl FnOnce() -> String) {
        if is_lost(written) {
            self.lost += 1;
            self.first_lost.get_or_insert_with(|| format!("{written} {}", place()));
            return;
        }
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

    /// The sentences about them, if there are any.
    pub fn note(self) -> Option<String> {
        let rounded = self.first.map(|first| match self.count {
            1 => format!("an integer beyond 2^53 is rounded: {first}"),
            n => format!("{n} integers beyond 2^53 are rounded; the first is {first}"),
        });
        let lost = self.first_lost.map(|first| match self.lost {
            1 => format!("a number below the smallest, 4.9e-324, is taken as 0: {first}"),
            n => format!("{n} numbers below the smallest, 4.9e-324, are taken as 0; the first is {first}"),
        });
        let both: Vec<String> = rounded.into_iter().chain(lost).collect();
        (!both.is_empty()).then(|| both.join("; "))
    }
}

/// Whether a number is written that is not 0, but so small that it is read as that.
fn is_lost(written: &str) -> bool {
    // Without an exponent it takes hundreds of zeros.
    let exponent = written.find(['e', 'E']);
    if exponent.is_none() && written.len() <= 300 {
        return false;
    }
    let digits = &written[..exponent.unwrap_or(written.len())];
    // Some countries write a comma before fractions.
    let is_number = digits.bytes().all(|b| b.is_ascii_digit() || b"+-.,".contains(&b));
    is_number
        && digits.bytes().any(|b| matches!(b, b'1'..=b'9'))
        && written.replace(',', ".").parse::<f64>().is_ok_and(|x| x == 0.0)
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

    #[test]
    fn what_is_not_0_and_becomes_that_is_told() {
        let note = |numbers: &[&str]| {
            let mut rounded = Rounded::default();
            numbers.iter().enumerate().for_each(|(i, x)| rounded.see(x, || format!("in row {i}")));
            rounded.note()
        };
        let zeros = "0".repeat(400);
        let kept =
            ["4.9e-324", "0e-400", "-0.0E-999", &format!("0.{zeros}"), "1e-300", "e-400", "1e-4x", "name-1e-400"];
        assert_eq!(note(&kept), None);
        let one = "a number below the smallest, 4.9e-324, is taken as 0: -1e-400 in row 1";
        assert_eq!(note(&["1", "-1e-400"]).as_deref(), Some(one));
        let tiny = format!("0.{zeros}1");
        let two = "2 numbers below the smallest, 4.9e-324, are taken as 0; the first is 1,5E-400 in row 0";
        assert_eq!(note(&["1,5E-400", &tiny]).as_deref(), Some(two));
    }
}
