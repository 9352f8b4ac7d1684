//! Tables of text (`.csv`): rows of numbers or words, with or without a first row of names.

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

#[derive(Debug, PartialEq)]
pub enum Column {
    Numbers(Vec<f64>),
    Words(Vec<String>),
}

/// Reads a table. Cells are parted by commas, or by semicolons or tabs if the first row has no comma; lines that begin with `#` are
/// comments. A first row with a word in it has the columns' names. Empty cells among numbers are not-a-number.
pub fn decode(bytes: &[u8]) -> Result<Table, String> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    // A cell of one digit becomes a string and then a number.
    memory::ask(bytes.len() as u64 * 40).map_err(|e| e.to_string())?;
    let first = bytes.split(|b| *b == b'\n').find(|l| !l.is_empty() && l[0] != b'#').unwrap_or_default();
    let delimiter = [b',', b';', b'\t'].into_iter().find(|d| first.contains(d)).unwrap_or(b',');
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .comment(Some(b'#'))
        .delimiter(delimiter)
        .trim(csv::Trim::All)
        .from_reader(bytes);
    let mut rows: Vec<Vec<String>> = Vec::new();
    for record in reader.byte_records() {
        let record = record.map_err(|e| match e.kind() {
            csv::ErrorKind::UnequalLengths { pos, expected_len, len } => {
                let line = pos.as_ref().map_or(0, csv::Position::line);
                format!("line {line} has {len} cells, those before have {expected_len}")
            }
            _ => e.to_string(),
        })?;
        rows.push(record.iter().map(|cell| String::from_utf8_lossy(cell).into_owned()).collect());
    }
    let Some(first) = rows.first() else { return Err("the table is empty".to_owned()) };
    let columns = first.len();
    let named = first.iter().any(|cell| number(cell).is_none());
    if !named && rows.iter().flatten().all(|cell| number(cell).is_some()) {
        let data = rows.iter().flatten().filter_map(|cell| number(cell)).collect();
        return Ok(Table::Rows(Tensor { shape: vec![rows.len(), columns], data }));
    }
    if !named {
        let place = rows.iter().position(|r| r.iter().any(|c| number(c).is_none())).unwrap_or(0);
        let word = rows[place].iter().find(|c| number(c).is_none()).map_or("", String::as_str);
        return Err(format!("row {} has “{word}” among numbers, and the first row has no names", place + 1));
    }
    let mut out: Vec<(String, Column)> = Vec::new();
    for (c, name) in first.iter().enumerate() {
        let cells = || rows[1..].iter().map(|row| row[c].as_str());
        let numbers: Option<Vec<f64>> = cells().map(number).collect();
        let column = match numbers {
            Some(numbers) => Column::Numbers(numbers),
            None => Column::Words(cells().map(str::to_owned).collect()),
        };
        let name = field_name(name, c);
        if out.iter().any(|(known, _)| *known == name) {
            return Err(format!("two columns are named “{name}”"));
        }
        out.push((name, column));
    }
    Ok(Table::Columns(out))
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

fn number(cell: &str) -> Option<f64> {
    if cell.is_empty() { Some(f64::NAN) } else { cell.parse().ok() }
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
            Ok(Table::Columns(columns)) => columns,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn rows_of_numbers_are_an_array() {
        let rows = |text: &str| match decode(text.as_bytes()) {
            Ok(Table::Rows(t)) => (t.shape, t.data),
            other => panic!("{other:?}"),
        };
        let expected = (vec![2, 3], vec![1.0, 2.5, -3e4, 4.0, 5.0, 6.0]);
        for text in ["1,2.5,-3e4\n4,5,6\n", "1; 2.5 ;-3e4\r\n4;5;6", "# made by hand\n1\t2.5\t-3e4\n\n4\t5\t6\n"] {
            assert_eq!(rows(text), expected, "{text:?}");
        }
        assert_eq!(rows("7").1, [7.0]);
    }

    #[test]
    fn a_row_of_names_makes_columns() {
        let found = columns("\u{feff}name, wave length (nm), 2nd\n\"a, b\", 400, 1\nc, 500,\n");
        assert_eq!(found[0], ("name".to_owned(), Column::Words(vec!["a, b".to_owned(), "c".to_owned()])));
        assert_eq!(found[1], ("wave_length__nm".to_owned(), Column::Numbers(vec![400.0, 500.0])));
        assert_eq!(found[2].0, "_2nd");
        assert!(matches!(&found[2].1, Column::Numbers(n) if n[0] == 1.0 && n[1].is_nan()));
    }

    #[test]
    fn errors_name_the_line() {
        let error = |text: &str| decode(text.as_bytes()).unwrap_err();
        assert_eq!(error("1,2\n3\n"), "line 2 has 1 cells, those before have 2");
        assert_eq!(error("1,2\n3,x\n"), "row 2 has “x” among numbers, and the first row has no names");
        assert_eq!(error(""), "the table is empty");
        assert_eq!(error("a,a\n1,2\n"), "two columns are named “a”");
    }
}
