//! Tables of text (`.csv`): rows of numbers or words, with or without a first row of names.

use std::io::Read;

use super::{Noted, Rounded};
use crate::memory;
use crate::tape::Tensor;

/// What a table turned out to be.
#[derive(Debug, PartialEq)]
pub enum Table {
    /// Numbers without names: `[rows, columns]`.
    Rows(Tensor),
    /// Columns by their names.
    Columns(Vec<(String, Column)>),
}

/// The cells of a column beneath its name, one for each row.
#[derive(Debug, PartialEq)]
pub enum Column {
    /// All are numbers; empty ones are NaN.
    Numbers(Vec<f64>),
    /// Some are not.
    Words(Vec<String>),
}

/// What parts the cells of a row.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Separator {
    Comma,
    Tab,
    /// Then numbers may have a comma before their fraction.
    Semicolon,
    /// As many blanks as one likes.
    Blanks,
}

impl Separator {
    /// By the first two rows: a semicolon parts numbers with commas, blanks part rows of numbers.
    fn of(text: &str) -> Separator {
        let mut rows = text.lines().filter(|line| !line.trim().is_empty() && !line.starts_with('#'));
        let (first, second) = (rows.next().unwrap_or_default(), rows.next());
        let are_numbers = |row: &str, by: Separator| {
            let cells: Vec<&str> = match by {
                Separator::Semicolon => row.split(';').map(str::trim).collect(),
                _ => row.split_whitespace().collect(),
            };
            cells.len() > 1 && cells.iter().all(|cell| by.number(cell).is_some())
        };
        // The first row may have names.
        let of_numbers = |by| are_numbers(first, by) || second.is_some_and(|row| are_numbers(row, by));
        match () {
            () if first.contains(';') && of_numbers(Separator::Semicolon) => Separator::Semicolon,
            () if first.contains(',') => Separator::Comma,
            () if first.contains(';') => Separator::Semicolon,
            () if first.contains('\t') => Separator::Tab,
            () if of_numbers(Separator::Blanks) => Separator::Blanks,
            () => Separator::Comma,
        }
    }

    /// A cell as a number; an empty one is not-a-number.
    fn number(self, cell: &str) -> Option<f64> {
        let with_comma = || (self == Separator::Semicolon && !cell.contains('.')).then(|| cell.replacen(',', ".", 1));
        match cell.parse() {
            Ok(number) => Some(number),
            Err(_) if cell.is_empty() => Some(f64::NAN),
            Err(_) => with_comma()?.parse().ok(),
        }
    }
}

/// The rows of a table, whose cells are texts.
fn rows(text: &str, by: Separator) -> Result<Vec<Vec<String>>, String> {
    let delimiter = match by {
        Separator::Comma => b',',
        Separator::Semicolon => b';',
        Separator::Tab => b'\t',
        Separator::Blanks => {
            let rows = text.lines().filter(|line| !line.trim().is_empty() && !line.starts_with('#'));
            let rows: Vec<Vec<String>> = rows.map(|row| row.split_whitespace().map(str::to_owned).collect()).collect();
            let length = rows.first().map_or(0, Vec::len);
            return match rows.iter().position(|row| row.len() != length) {
                Some(i) => Err(format!("row {} has {} cells, those before have {length}", i + 1, rows[i].len())),
                None => Ok(rows),
            };
        }
    };
    // A row of its own after the last: within a quotation that is not closed it is part of a cell, as is all that follows the mark.
    const END: &str = "\nthe end\n";
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .comment(Some(b'#'))
        .delimiter(delimiter)
        .trim(csv::Trim::All)
        .flexible(true)
        .from_reader(text.as_bytes().chain(END.as_bytes()));
    let mut rows: Vec<Vec<String>> = Vec::new();
    let mut uneven = None;
    let mut last = 0;
    for record in reader.records() {
        let record = record.map_err(|e| e.to_string())?;
        // A record begins after comments and empty lines, which its position does not know.
        last = record.position().map_or(0, |at| {
            let rest = text.get(at.byte() as usize..).unwrap_or_default();
            at.line() + rest.lines().take_while(|line| line.is_empty() || line.starts_with('#')).count() as u64
        });
        let length = rows.first().map_or(record.len(), Vec::len);
        if record.len() != length && uneven.is_none() {
            uneven = Some((rows.len(), format!("line {last} has {} cells, those before have {length}", record.len())));
        }
        rows.push(record.iter().map(str::to_owned).collect());
    }
    match rows.pop() {
        Some(row) if row == [END.trim()] => {}
        _ => {
            return Err(format!(
                "line {last}: a quotation mark is not closed, and all that follows it would be one cell"
            ));
        }
    }
    match uneven {
        Some((row, told)) if row < rows.len() => Err(told),
        _ => Ok(rows),
    }
}

/// Reads a table. Cells are parted by commas, or by semicolons or tabs if the first row has no comma, or by blanks between numbers; where
/// semicolons part numbers these may have a decimal comma. Lines that begin with `#` are comments. A first row with a word in it has the
/// columns' names. Empty cells among numbers are not-a-number. Told is that integers are rounded.
pub fn decode(bytes: &[u8]) -> Result<Noted<Table>, String> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    // A cell of one digit becomes a string and then a number.
    memory::ask(bytes.len() as u64 * 40).map_err(|e| e.to_string())?;
    let text = std::str::from_utf8(bytes).map_err(|e| {
        let line = bytes[..e.valid_up_to()].iter().filter(|b| **b == b'\n').count() + 1;
        format!("line {line} is not valid UTF-8: tables are read in this encoding only")
    })?;
    let by = Separator::of(text);
    let number = |cell: &str| by.number(cell);
    let rows = rows(text, by)?;
    let Some(first) = rows.first() else { return Err("the table is empty".to_owned()) };
    let columns = first.len();
    let named = first.iter().any(|cell| number(cell).is_none());
    let mut rounded = Rounded::default();
    if !named && rows.iter().flatten().all(|cell| number(cell).is_some()) {
        let data = rows.iter().flatten().filter_map(|cell| number(cell)).collect();
        (0..columns).try_for_each(|c| faithful(&rows, c, 0, &number, &mut rounded))?;
        let table = Table::Rows(Tensor { shape: vec![rows.len(), columns], data });
        return Ok((table, rounded.note().into_iter().collect()));
    }
    if !named {
        let place = rows.iter().position(|r| r.iter().any(|c| number(c).is_none())).unwrap_or(0);
        let word = rows[place].iter().find(|c| number(c).is_none()).map_or("", String::as_str);
        return Err(format!("row {} has “{word}” among numbers, and the first row has no names", place + 1));
    }
    let mut out: Vec<(String, Column)> = Vec::new();
    for (c, name) in first.iter().enumerate() {
        let cells = || rows[1..].iter().map(|row| row[c].as_str());
        let numbers: Option<Vec<f64>> = cells().map(&number).collect();
        let column = match numbers {
            Some(numbers) => {
                faithful(&rows, c, 1, &number, &mut rounded)?;
                Column::Numbers(numbers)
            }
            None => Column::Words(cells().map(str::to_owned).collect()),
        };
        let name = field_name(name, c);
        if out.iter().any(|(known, _)| *known == name) {
            return Err(format!("two columns are named “{name}”"));
        }
        out.push((name, column));
    }
    Ok((Table::Columns(out), rounded.note().into_iter().collect()))
}

/// Looks through the cells of a column of numbers, from the first row with some, for what no double holds: fails for a number beyond the
/// largest, which would be infinite.
fn faithful(
    rows: &[Vec<String>],
    column: usize,
    first: usize,
    number: &impl Fn(&str) -> Option<f64>,
    rounded: &mut Rounded,
) -> Result<(), String> {
    for (i, row) in rows.iter().enumerate().skip(first) {
        let cell = &row[column];
        // The word for infinity has no digits.
        if cell.contains(|c: char| c.is_ascii_digit()) && number(cell).is_some_and(f64::is_infinite) {
            return Err(format!("row {} has “{cell}”, which is beyond the largest number, 1.8e308", i + 1));
        }
        rounded.see(cell, || format!("in row {}", i + 1));
    }
    Ok(())
}

/// The text of a table: rows of cells, the first with the names if there are any.
pub fn encode(names: Option<&[&str]>, rows: &[Vec<String>]) -> Result<Vec<u8>, String> {
    let mut writer = csv::WriterBuilder::new().from_writer(Vec::new());
    let failed = |e: csv::Error| e.to_string();
    if let Some(names) = names {
        writer.write_record(names).map_err(failed)?;
    }
    for row in rows {
        writer.write_record(row).map_err(failed)?;
    }
    writer.into_inner().map_err(|e| e.to_string())
}

/// A column's name as a field: what no name of the language has becomes `_`.
fn field_name(cell: &str, column: usize) -> String {
    let name: String = cell.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    let name = name.trim_matches('_');
    match name.chars().next() {
        None => format!("column_{column}"),
        Some(c) if c.is_ascii_digit() => format!("_{name}"),
        Some(_) => name.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn columns(text: &str) -> Vec<(String, Column)> {
        match decode(text.as_bytes()) {
            Ok((Table::Columns(columns), _)) => columns,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn rows_of_numbers_are_an_array() {
        let rows = |text: &str| match decode(text.as_bytes()) {
            Ok((Table::Rows(t), _)) => (t.shape, t.data),
            other => panic!("{other:?}"),
        };
        let expected = (vec![2, 3], vec![1.0, 2.5, -3e4, 4.0, 5.0, 6.0]);
        for text in ["1,2.5,-3e4\n4,5,6\n", "1; 2.5 ;-3e4\r\n4;5;6", "# made by hand\n1\t2.5\t-3e4\n\n4\t5\t6\n"] {
            assert_eq!(rows(text), expected, "{text:?}");
        }
        assert_eq!(rows("7").1, [7.0]);
        // As other countries and NumPy's `savetxt` write them.
        for text in ["1,0;2,5;-3e4\n4;5;6\n", "1.0 2.5  -3e4\n 4 5 6 \n", "1;2.5;-3e4\n4;5;6,0"] {
            assert_eq!(rows(text), expected, "{text:?}");
        }
    }

    #[test]
    fn a_row_of_names_makes_columns() {
        let found = columns("\u{feff}name, wave length (nm), 2nd\n\"a, b\", 400, 1\nc, 500,\n");
        assert_eq!(found[0], ("name".to_owned(), Column::Words(vec!["a, b".to_owned(), "c".to_owned()])));
        assert_eq!(found[1], ("wave_length__nm".to_owned(), Column::Numbers(vec![400.0, 500.0])));
        assert_eq!(found[2].0, "_2nd");
        let prices = columns("name;price\nMüller;1,5\nMaier;2\n");
        assert_eq!(prices[1], ("price".to_owned(), Column::Numbers(vec![1.5, 2.0])));
        let places = columns("x  y\n1 2\n3 4\n");
        assert_eq!(places[1], ("y".to_owned(), Column::Numbers(vec![2.0, 4.0])));
        let words = columns("wave length\n400\n500\n");
        assert_eq!(words[0], ("wave_length".to_owned(), Column::Numbers(vec![400.0, 500.0])));
        assert!(matches!(&found[2].1, Column::Numbers(n) if n[0] == 1.0 && n[1].is_nan()));
    }

    #[test]
    fn errors_name_the_line() {
        let error = |text: &str| decode(text.as_bytes()).unwrap_err();
        assert_eq!(error("1,2\n3\n"), "line 2 has 1 cells, those before have 2");
        assert_eq!(error("1,2\n3,x\n"), "row 2 has “x” among numbers, and the first row has no names");
        assert_eq!(error(""), "the table is empty");
        assert_eq!(error("1 2\n3\n"), "row 2 has 1 cells, those before have 2");
        let open = |line: usize| {
            format!("line {line}: a quotation mark is not closed, and all that follows it would be one cell")
        };
        assert_eq!(error("1,2\n\"3,4\n5,6\n"), open(2));
        assert_eq!(error("x,y\n1,\"abc\n2,d\n3,e\n"), open(2));
        assert_eq!(error("x;y\n1;a\n# 2\n3;\"e"), open(4));
        assert_eq!(error("name\n\"a\nb"), open(2));
        let closed = columns("x,y\n1,\"a \"\"b\"\"\nc\"\n2,5\"\n#\"");
        assert_eq!(closed[1].1, Column::Words(vec!["a \"b\"\nc".to_owned(), "5\"".to_owned()]));
        assert_eq!(columns("the end\n1\n")[0].1, Column::Numbers(vec![1.0]));
        assert_eq!(error("x,y\n1,2\n3,-1e400\n"), "row 3 has “-1e400”, which is beyond the largest number, 1.8e308");
        assert_eq!(error("1 1e400\n3 4\n"), "row 1 has “1e400”, which is beyond the largest number, 1.8e308");
        assert_eq!(columns("commit,n\n12e4567,-inf\nab,2\n")[1].1, Column::Numbers(vec![f64::NEG_INFINITY, 2.0]));
        let notes = |text: &str| decode(text.as_bytes()).unwrap().1;
        let told = ["an integer beyond 2^53 is rounded: 9007199254740993 in row 2, taken as 9007199254740992"];
        assert_eq!(notes("id,n\n9007199254740993,1\n"), told);
        assert_eq!(notes("1,2\n3,9007199254740993\n"), told);
        assert!(notes("id\n9007199254740993\nx\n").is_empty(), "words keep their digits");
        assert!(decode(b"a,b\nM\xfcller,1\n").unwrap_err().contains("line 2 is not valid UTF-8"));
        assert_eq!(error("a,a\n1,2\n"), "two columns are named “a”");
    }
}
