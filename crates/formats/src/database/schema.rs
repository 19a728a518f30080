//! Which tables and columns a database really has: COLMAP has added, renamed and dropped some over ten years.

use rusqlite::Row;
use rusqlite::types::ValueRef;

use super::open::{Source, sqlite_error};
use crate::error::{FormatError, Location, Problem};

/// A table that exists, with its columns.
pub(crate) struct Table {
    pub(crate) name: String,
    columns: Vec<String>,
}

impl Table {
    /// The first of the named tables that exists.
    pub(crate) fn probe(source: &Source, names: &[&str]) -> Result<Option<Self>, FormatError> {
        for &name in names {
            let columns = columns(source, name).map_err(|e| sqlite_error(source.table(name), &e))?;
            if !columns.is_empty() {
                return Ok(Some(Self { name: name.to_owned(), columns }));
            }
        }
        Ok(None)
    }

    /// As [`Self::probe`], for a table without which nothing can be done.
    pub(crate) fn require(source: &Source, name: &str, advice: &str) -> Result<Self, FormatError> {
        Self::probe(source, &[name])?
            .ok_or_else(|| FormatError::invalid(source.table(name), Problem::MissingTable, advice))
    }

    /// Calls `each` with every row; `required` columns come first, then `optional` ones, NULL where they do not exist.
    pub(crate) fn for_each(
        &self,
        source: &Source,
        required: &[&'static str],
        optional: &[&'static str],
        mut each: impl FnMut(&Row<'_>) -> Result<(), FormatError>,
    ) -> Result<(), FormatError> {
        let has = |column: &str| self.columns.iter().any(|c| c.eq_ignore_ascii_case(column));
        if let Some(missing) = required.iter().find(|c| !has(c)) {
            return Err(FormatError::invalid(
                source.table(&self.name),
                Problem::MissingColumn(missing),
                "this is not a table COLMAP wrote; open and save the database with a recent COLMAP",
            ));
        }
        let mut selected: Vec<String> = required.iter().map(|c| format!("\"{c}\"")).collect();
        selected.extend(optional.iter().map(|c| if has(c) { format!("\"{c}\"") } else { "NULL".to_owned() }));
        let sql = format!("SELECT {} FROM \"{}\"", selected.join(", "), self.name);
        let fail = |e: rusqlite::Error| sqlite_error(source.table(&self.name), &e);
        let mut statement = source.connection.prepare(&sql).map_err(fail)?;
        let mut rows = statement.query([]).map_err(fail)?;
        while let Some(row) = rows.next().map_err(fail)? {
            each(row)?;
        }
        Ok(())
    }

    pub(crate) fn location(&self, source: &Source) -> Location {
        source.table(&self.name)
    }
}

fn columns(source: &Source, table: &str) -> rusqlite::Result<Vec<String>> {
    let mut statement = source.connection.prepare(&format!("PRAGMA table_info(\"{table}\")"))?;
    let names = statement.query_map([], |row| row.get::<_, String>(1))?;
    names.collect()
}

/// The value of a column; NULL where the row has none (an index past the columns is a mistake of the caller).
fn value<'a>(row: &'a Row<'_>, index: usize) -> ValueRef<'a> {
    row.get_ref(index).unwrap_or(ValueRef::Null)
}

fn wrong_type(column: &'static str, expected: &'static str, found: ValueRef<'_>) -> Problem {
    Problem::WrongType { column, expected, found: found.data_type().to_string() }
}

/// An integer; NULL is an error.
pub(crate) fn integer(row: &Row<'_>, index: usize, column: &'static str) -> Result<i64, Problem> {
    match value(row, index) {
        ValueRef::Integer(i) => Ok(i),
        other => Err(wrong_type(column, "an integer", other)),
    }
}

/// An integer, or `None` for NULL.
pub(crate) fn optional_integer(row: &Row<'_>, index: usize, column: &'static str) -> Result<Option<i64>, Problem> {
    match value(row, index) {
        ValueRef::Null => Ok(None),
        ValueRef::Integer(i) => Ok(Some(i)),
        other => Err(wrong_type(column, "an integer", other)),
    }
}

/// The bytes of a text.
pub(crate) fn text<'a>(row: &'a Row<'_>, index: usize, column: &'static str) -> Result<&'a [u8], Problem> {
    match value(row, index) {
        ValueRef::Text(bytes) => Ok(bytes),
        other => Err(wrong_type(column, "text", other)),
    }
}

/// A blob, or `None` for NULL.
pub(crate) fn blob<'a>(row: &'a Row<'_>, index: usize, column: &'static str) -> Result<Option<&'a [u8]>, Problem> {
    match value(row, index) {
        ValueRef::Null => Ok(None),
        ValueRef::Blob(bytes) => Ok(Some(bytes)),
        other => Err(wrong_type(column, "a blob", other)),
    }
}
