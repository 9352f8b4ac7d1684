//! Tables for the terminal.

/// Columns as wide as they need to be; the first is text, the others are right-aligned.
pub fn text_table(head: &[String], rows: &[Vec<String>]) -> String {
    let width = |column: usize| {
        let cells = std::iter::once(head).chain(rows.iter().map(Vec::as_slice)).filter_map(|row| row.get(column));
        cells.map(|cell| cell.chars().count()).max().unwrap_or_default()
    };
    let widths: Vec<usize> = (0..head.len()).map(width).collect();
    let line = |row: &[String]| {
        let cell = |(column, width): (usize, &usize)| {
            let text = row.get(column).map_or("", String::as_str);
            if column == 0 { format!("{text:<width$}") } else { format!("{text:>width$}") }
        };
        let cells: Vec<String> = widths.iter().enumerate().map(cell).collect();
        cells.join("  ").trim_end().to_owned()
    };
    std::iter::once(head).chain(rows.iter().map(Vec::as_slice)).map(|row| line(row) + "\n").collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_line_up() {
        let cells = |text: &str| text.split(' ').map(str::to_owned).collect::<Vec<String>>();
        let table = text_table(&cells("run loss"), &[cells("ä 0.25"), cells("long 1"), cells("x")]);
        assert_eq!(table, "run   loss\nä     0.25\nlong     1\nx\n");
    }
}
