//! Data files: JSON, tables and arrays, as values of the language.

use std::sync::Arc;

use crate::data::{Noted, ies, npy, table};
use crate::files::read_bytes;
use crate::stop;
use crate::tape::{Tensor, Var};

use super::files::{reading, tell};
use super::value::Value;
use super::{Args, Native, NativeError, Result, json};

pub(super) const TABLE: &[(&str, Native)] = &[
    ("load_json", |a| read(a, 0, json::decode)),
    ("load_table", |a| match read(a, 0, table::decode)? {
        table::Table::Rows(rows) => Ok(Value::tensor(rows)),
        table::Table::Columns(columns) => {
            let value = |column| match column {
                table::Column::Numbers(numbers) => Value::tensor(Tensor::vector(numbers)),
                table::Column::Words(words) => Value::list(words.into_iter().map(Value::str).collect()),
            };
            Ok(Value::Record(Arc::new(columns.into_iter().map(|(n, c)| (n, value(c))).collect())))
        }
    }),
    ("load_profile", |a| Ok(Value::Image(load_profile(a, 0)?))),
    ("load_array", |a| Ok(Value::tensor(read(a, 0, npy::decode)?))),
];

/// Reads the file that an argument names and decodes its bytes with `decode`. Warns about what of it is not done.
fn read<T: Send + 'static>(a: &Args, index: usize, decode: fn(&[u8]) -> Result<Noted<T>, String>) -> Result<T> {
    let path = a.path(index)?;
    let _work = reading(&path);
    let from = path.clone();
    let decoded = stop::apart(move || decode(&read_bytes(&from)?));
    let (value, notes) =
        decoded.map_err(|e| NativeError::at(index, format!("{}: {e}", a.string(index).unwrap_or_default())))?;
    tell(a, index, &path, notes);
    Ok(value)
}

/// Whether a file is a photometric one, by its ending.
pub(super) fn is_photometric(path: &str) -> bool {
    path.rsplit_once('.').is_some_and(|(_, ending)| ending.eq_ignore_ascii_case("ies"))
}

/// The map of the photometric file that an argument names. Warns about what of it is not done.
pub(super) fn load_profile(a: &Args, index: usize) -> Result<Var> {
    let map = read(a, index, |bytes| {
        let luminaire = ies::decode(bytes)?;
        Ok((luminaire.map()?, luminaire.notes))
    })?;
    Ok(Var::constant(map))
}
