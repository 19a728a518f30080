//! What can be wrong with a file, said once for errors and warnings: where, what, and what to do.

use std::fmt;
use std::path::{Path, PathBuf};

/// A value together with what was left out while reading it.
#[derive(Clone, Debug)]
pub struct Loaded<T> {
    /// What was read.
    pub value: T,
    /// What was dropped or mended, in the order of the file.
    pub warnings: Vec<FormatWarning>,
}

/// A place in a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Location {
    /// The file or folder.
    pub path: PathBuf,
    /// The table of a database, or the part of a model (`images.bin` speaks for itself and has none).
    pub table: Option<String>,
    /// The row: an id, a pair of ids, or a line.
    pub row: Option<String>,
}

impl Location {
    /// The file as a whole.
    pub fn file(path: &Path) -> Self {
        Self { path: path.to_owned(), table: None, row: None }
    }

    /// A table of a database.
    pub fn table(path: &Path, table: &str) -> Self {
        Self { path: path.to_owned(), table: Some(table.to_owned()), row: None }
    }

    /// A row of this table or file.
    pub fn row(mut self, row: impl Into<String>) -> Self {
        self.row = Some(row.into());
        self
    }
}

impl fmt::Display for Location {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.path.display())?;
        if let Some(table) = &self.table {
            write!(f, ", table {table}")?;
        }
        if let Some(row) = &self.row {
            write!(f, ", {row}")?;
        }
        Ok(())
    }
}

/// What is wrong at a [`Location`].
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Problem {
    /// The file has no bytes.
    #[error("the file is empty")]
    Empty,
    /// The file ends too early.
    #[error("the file is cut off: it has {found} of {expected} bytes")]
    Truncated {
        /// Bytes the content asks for, at least.
        expected: u64,
        /// Bytes there are.
        found: u64,
    },
    /// Bytes follow the last record.
    #[error("{0} bytes follow the last record")]
    TrailingBytes(u64),
    /// Not the kind of file that was expected.
    #[error("this is not {expected}: {reason}")]
    WrongKind {
        /// What it should be.
        expected: &'static str,
        /// Why it is not.
        reason: String,
    },
    /// A table does not exist.
    #[error("the table is missing")]
    MissingTable,
    /// A column does not exist.
    #[error("the column `{0}` is missing")]
    MissingColumn(&'static str),
    /// A file of a model does not exist.
    #[error("the file {0} is missing")]
    MissingFile(String),
    /// A value is of the wrong type.
    #[error("`{column}` is {found}, not {expected}")]
    WrongType {
        /// Which value.
        column: &'static str,
        /// What it should be.
        expected: &'static str,
        /// What it is.
        found: String,
    },
    /// A blob does not have the size its row announces.
    #[error("`{column}` has {found} bytes, not {expected}")]
    BlobLength {
        /// Which blob.
        column: &'static str,
        /// Bytes it should have.
        expected: u128,
        /// Bytes it has.
        found: u64,
    },
    /// A number is outside what it may be.
    #[error("{what} is {found}, not {expected}")]
    OutOfRange {
        /// Which number.
        what: String,
        /// What it is.
        found: String,
        /// What it may be.
        expected: String,
    },
    /// A number is NaN or infinite.
    #[error("{0} is not finite")]
    NotFinite(String),
    /// A camera model that is not known here.
    #[error("unknown camera model {0}")]
    UnknownCameraModel(String),
    /// Something refers to what does not exist.
    #[error("{what} {id} does not exist")]
    Dangling {
        /// What is referred to.
        what: &'static str,
        /// Its id.
        id: String,
    },
    /// The same key twice.
    #[error("{what} {key} occurs more than once")]
    Duplicate {
        /// What should be unique.
        what: &'static str,
        /// The key.
        key: String,
    },
    /// Two parts of the input contradict each other.
    #[error("{0}")]
    Inconsistent(String),
    /// A line of text that cannot be understood.
    #[error("cannot read {what} from `{found}`")]
    Syntax {
        /// What should stand there.
        what: &'static str,
        /// What stands there (cut to a readable length).
        found: String,
    },
    /// Nothing is there to work with.
    #[error("there are no {0}")]
    Nothing(&'static str),
    /// Further problems of the same kind.
    #[error("{0} more problems of this kind")]
    More(usize),
    /// SQLite's own words.
    #[error("SQLite says: {0}")]
    Sqlite(String),
}

/// Something that was dropped or mended; reading went on.
#[derive(Clone, Debug, PartialEq)]
pub struct FormatWarning {
    /// Where.
    pub location: Location,
    /// What is wrong.
    pub problem: Problem,
    /// What was done about it and what a person can do.
    pub consequence: String,
}

impl fmt::Display for FormatWarning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}; {}", self.location, self.problem, self.consequence)
    }
}

/// Reading or writing failed as a whole.
#[derive(Debug, thiserror::Error)]
pub enum FormatError {
    /// The operating system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// Its reason.
        source: std::io::Error,
    },
    /// The content is unusable.
    #[error("{location}: {problem}; {advice}")]
    Invalid {
        /// Where.
        location: Box<Location>,
        /// What is wrong.
        problem: Box<Problem>,
        /// What to do.
        advice: String,
    },
}

impl FormatError {
    /// The content is unusable.
    pub fn invalid(location: Location, problem: Problem, advice: impl Into<String>) -> Self {
        Self::Invalid { location: Box::new(location), problem: Box::new(problem), advice: advice.into() }
    }

    /// The operating system refused.
    pub fn io(path: &Path, source: std::io::Error) -> Self {
        Self::Io { path: path.to_owned(), source }
    }
}

impl From<FormatWarning> for FormatError {
    /// For a warning that turns out to leave nothing to work with.
    fn from(warning: FormatWarning) -> Self {
        Self::invalid(warning.location, warning.problem, warning.consequence)
    }
}

/// Warnings kept per table and kind of problem: a file with a million bad rows should still be readable for a person.
const MAX_PER_KIND: usize = 10;

/// Collects warnings, at most [`MAX_PER_KIND`] of a kind in full.
#[derive(Debug, Default)]
pub(crate) struct Warnings {
    list: Vec<FormatWarning>,
    /// Per kind (discriminant and table): how many there were, and the place and consequence of the last one.
    counts: Vec<(std::mem::Discriminant<Problem>, Option<String>, usize, FormatWarning)>,
}

impl Warnings {
    pub(crate) fn push(&mut self, location: Location, problem: Problem, consequence: impl Into<String>) {
        let kind = std::mem::discriminant(&problem);
        let warning = FormatWarning { location, problem, consequence: consequence.into() };
        let count = match self.counts.iter_mut().find(|(k, table, ..)| *k == kind && *table == warning.location.table) {
            Some((_, _, count, last)) => {
                *count += 1;
                if *count > MAX_PER_KIND {
                    *last = warning.clone();
                }
                *count
            }
            None => {
                self.counts.push((kind, warning.location.table.clone(), 1, warning.clone()));
                1
            }
        };
        if count <= MAX_PER_KIND {
            self.list.push(warning);
        }
    }

    /// The first warning, if any.
    pub(crate) fn first(&self) -> Option<&FormatWarning> {
        self.list.first()
    }

    /// All of them, with one line for each kind that had too many.
    pub(crate) fn finish(mut self) -> Vec<FormatWarning> {
        for (_, table, count, last) in self.counts {
            if count > MAX_PER_KIND {
                let location = Location { path: last.location.path, table, row: None };
                let consequence = format!(
                    "the last one: {}: {}; {}",
                    last.location.row.unwrap_or_default(),
                    last.problem,
                    last.consequence
                );
                self.list.push(FormatWarning { location, problem: Problem::More(count - MAX_PER_KIND), consequence });
            }
        }
        self.list
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_problems_of_a_kind_are_counted_not_listed() {
        let mut warnings = Warnings::default();
        for row in 0..1000 {
            let location = Location::table(Path::new("a.db"), "matches").row(format!("pair {row}"));
            warnings.push(location, Problem::NotFinite("x".into()), "dropped");
        }
        warnings.push(Location::file(Path::new("a.db")), Problem::Empty, "ignored");
        let list = warnings.finish();
        assert_eq!(list.len(), MAX_PER_KIND + 2);
        let last = list.last().expect("the summary");
        assert_eq!(last.problem, Problem::More(990));
        assert!(last.to_string().contains("pair 999"), "{last}");
    }
}
