//! Opening somebody else's database without touching it, whatever its journal mode.

use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use rusqlite::config::DbConfig;
use rusqlite::{Connection, ErrorCode, OpenFlags};
use tempfile::TempDir;

use super::ranged::{RangedBytes, Registered};
use crate::error::{FormatError, Location, Problem};

/// First bytes of every SQLite 3 file (source: sqlite.org/fileformat2.html §1.3).
const MAGIC: &[u8; 16] = b"SQLite format 3\0";
/// Length of the file header.
const HEADER_BYTES: usize = 100;
/// The database's name inside its own virtual file system.
const FILE: &str = "database.db";

/// A database that can be read.
pub(crate) struct Source {
    pub(crate) connection: Connection,
    /// The person's file, for messages.
    pub(crate) path: PathBuf,
    /// Holds the copy when the database could not be read in place.
    _copy: Option<TempDir>,
    /// Where the bytes come from when there is no file; dropped after the connection.
    _ranges: Option<Registered>,
}

impl Source {
    /// Opens `path` read-only.
    ///
    /// Without a `-wal` sidecar the file is opened as immutable, which needs no lock file and works on read-only media.
    /// With one it is opened in place; where that needs files that may not be created, both are copied first.
    pub(crate) fn open(path: &Path) -> Result<Self, FormatError> {
        let has_wal = fs::metadata(with_suffix(path, "-wal")).is_ok_and(|m| m.len() > 0);
        check_header(path, has_wal)?;
        let mut source = if !has_wal {
            Self { connection: connect(path, true)?, path: path.to_owned(), _copy: None, _ranges: None }
        } else {
            match connect(path, false).and_then(|connection| probe(&connection, path).map(|()| connection)) {
                Ok(connection) => Self { connection, path: path.to_owned(), _copy: None, _ranges: None },
                Err(_) => Self::open_copy(path)?,
            }
        };
        source.harden();
        probe(&source.connection, path)?;
        Ok(source)
    }

    /// Opens a database that is read by ranges, with its write-ahead log where there is one. `name` is for messages.
    pub(crate) fn open_ranged(
        name: &Path,
        database: Rc<dyn RangedBytes>,
        wal: Option<Rc<dyn RangedBytes>>,
    ) -> Result<Self, FormatError> {
        let wal = wal.filter(|wal| !wal.is_empty());
        let mut header = vec![0; HEADER_BYTES.min(database.len() as usize)];
        database.read_at(0, &mut header).map_err(|source| FormatError::io(name, source))?;
        check_start(name, database.len(), &header, wal.is_some())?;
        let fail = |e: &dyn std::fmt::Display| {
            let advice = "reload the page and try again";
            FormatError::invalid(Location::file(name), Problem::Sqlite(e.to_string()), advice)
        };
        let has_wal = wal.is_some();
        let files = [Some((FILE.to_owned(), database)), wal.map(|wal| (format!("{FILE}-wal"), wal))];
        let ranges = Registered::new(files.into_iter().flatten()).map_err(|e| fail(&e))?;
        let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX | OpenFlags::SQLITE_OPEN_URI;
        let uri = if has_wal { format!("file:{FILE}") } else { format!("file:{FILE}?immutable=1") };
        let connection = Connection::open_with_flags_and_vfs(uri, flags, ranges.name.as_str())
            .map_err(|e| sqlite_error(Location::file(name), &e))?;
        if has_wal {
            // The index of the log then lives in memory instead of a shared file.
            connection
                .pragma_update(None, "locking_mode", "EXCLUSIVE")
                .map_err(|e| sqlite_error(Location::file(name), &e))?;
        }
        let mut source = Self { connection, path: name.to_owned(), _copy: None, _ranges: Some(ranges) };
        source.harden();
        probe(&source.connection, name)?;
        Ok(source)
    }

    fn open_copy(path: &Path) -> Result<Self, FormatError> {
        let folder = tempfile::tempdir().map_err(|source| FormatError::io(&std::env::temp_dir(), source))?;
        let copy = folder.path().join("database.db");
        for (from, to) in [(path.to_owned(), copy.clone()), (with_suffix(path, "-wal"), with_suffix(&copy, "-wal"))] {
            fs::copy(&from, to).map_err(|source| FormatError::io(&from, source))?;
        }
        let flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let connection =
            Connection::open_with_flags(&copy, flags).map_err(|e| sqlite_error(Location::file(path), &e))?;
        Ok(Self { connection, path: path.to_owned(), _copy: Some(folder), _ranges: None })
    }

    /// Settings for untrusted files; each only adds checks, so a refusal changes nothing.
    fn harden(&mut self) {
        let _ = self.connection.set_db_config(DbConfig::SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, true);
        let _ = self.connection.set_db_config(DbConfig::SQLITE_DBCONFIG_DEFENSIVE, true);
        let _ = self.connection.set_db_config(DbConfig::SQLITE_DBCONFIG_TRUSTED_SCHEMA, false);
        let _ = self.connection.pragma_update(None, "cell_size_check", true);
    }

    pub(crate) fn table(&self, table: &str) -> Location {
        Location::table(&self.path, table)
    }
}

fn connect(path: &Path, immutable: bool) -> Result<Connection, FormatError> {
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX | OpenFlags::SQLITE_OPEN_URI;
    let absolute = std::path::absolute(path).map_err(|source| FormatError::io(path, source))?;
    let mut uri = String::from("file:");
    for &byte in absolute.as_os_str().as_encoded_bytes() {
        match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'/' | b'.' | b'-' | b'_' | b'~' => uri.push(byte as char),
            _ => uri.push_str(&format!("%{byte:02X}")),
        }
    }
    uri.push_str(if immutable { "?mode=ro&immutable=1" } else { "?mode=ro" });
    Connection::open_with_flags(uri, flags).map_err(|e| sqlite_error(Location::file(path), &e))
}

/// SQLite opens lazily: reading the schema is what shows whether the file can be read.
fn probe(connection: &Connection, path: &Path) -> Result<(), FormatError> {
    connection
        .query_row("SELECT count(*) FROM sqlite_master", [], |row| row.get::<_, i64>(0))
        .map(|_| ())
        .map_err(|e| sqlite_error(Location::file(path), &e))
}

fn check_header(path: &Path, has_wal: bool) -> Result<(), FormatError> {
    let io = |source| FormatError::io(path, source);
    let mut file = fs::File::open(path).map_err(io)?;
    let metadata = file.metadata().map_err(io)?;
    let invalid = |problem, advice: &str| FormatError::invalid(Location::file(path), problem, advice);
    if metadata.is_dir() {
        let problem = Problem::WrongKind { expected: "a COLMAP database", reason: "it is a folder".into() };
        return Err(invalid(problem, "give the path of the database.db file"));
    }
    let mut header = Vec::with_capacity(HEADER_BYTES);
    file.by_ref().take(HEADER_BYTES as u64).read_to_end(&mut header).map_err(io)?;
    check_start(path, metadata.len(), &header, has_wal)
}

/// Refuses what cannot be a whole database by its length and first bytes.
fn check_start(path: &Path, length: u64, header: &[u8], has_wal: bool) -> Result<(), FormatError> {
    let invalid = |problem, advice: &str| FormatError::invalid(Location::file(path), problem, advice);
    if length == 0 {
        return Err(invalid(Problem::Empty, "create the database with `colmap feature_extractor` or copy it again"));
    }
    let start = &header[..header.len().min(MAGIC.len())];
    if start != &MAGIC[..start.len()] {
        let reason = "it does not begin with SQLite's mark".into();
        let problem = Problem::WrongKind { expected: "an SQLite database", reason };
        return Err(invalid(problem, "give the path of the database.db file that COLMAP wrote"));
    }
    if header.len() < HEADER_BYTES {
        let problem = Problem::Truncated { expected: HEADER_BYTES as u64, found: header.len() as u64 };
        return Err(invalid(problem, "copy the file again"));
    }
    // Page size and count stand at 16 and 28; the count holds only if the change counter (24) equals the version it
    // was valid for (92), and pages may still sit in a write-ahead log.
    let page_bytes = match u16::from_be_bytes([header[16], header[17]]) {
        1 => 65_536,
        n => u64::from(n),
    };
    let pages = u64::from(u32::from_be_bytes([header[28], header[29], header[30], header[31]]));
    let expected = pages * page_bytes;
    if !has_wal && header[24..28] == header[92..96] && expected > length {
        let problem = Problem::Truncated { expected, found: length };
        return Err(invalid(problem, "copy the file again, with its -wal file if there is one"));
    }
    Ok(())
}

/// SQLite's failure with the advice that fits its kind.
pub(crate) fn sqlite_error(location: Location, error: &rusqlite::Error) -> FormatError {
    let advice = match error.sqlite_error_code() {
        Some(ErrorCode::NotADatabase) => {
            "the file is not an SQLite database or is encrypted; give COLMAP's database.db"
        }
        Some(ErrorCode::DatabaseCorrupt) => {
            "the database is damaged; copy it again, or rescue it with `sqlite3 database.db .recover`"
        }
        Some(ErrorCode::DatabaseBusy | ErrorCode::DatabaseLocked) => {
            "close the program that writes to it and try again"
        }
        Some(ErrorCode::CannotOpen | ErrorCode::PermissionDenied) => "check that the file may be read",
        _ => "check the file with `sqlite3 database.db 'PRAGMA integrity_check'`",
    };
    FormatError::invalid(location, Problem::Sqlite(error.to_string()), advice)
}

pub(crate) fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    PathBuf::from(name)
}
