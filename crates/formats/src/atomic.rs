//! Files appear complete or not at all: written under a temporary name beside their place, then renamed.

use std::fs;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use tempfile::{Builder, NamedTempFile, TempDir};

use crate::error::FormatError;

/// Large enough that the number of system calls does not matter.
const BUFFER_BYTES: usize = 1 << 20;

/// Writes a file atomically: whatever goes wrong, `path` holds either its old content or all of the new.
///
/// # Errors
/// Whatever `write` returns, and [`FormatError::Io`] when the folder cannot be written to.
pub fn atomic_write<F>(path: &Path, write: F) -> Result<(), FormatError>
where
    F: FnOnce(&mut dyn Write) -> Result<(), FormatError>,
{
    let io = |source| FormatError::io(path, source);
    let file = temporary_file(path)?;
    let mut writer = BufWriter::with_capacity(BUFFER_BYTES, file);
    write(&mut writer)?;
    let file = writer.into_inner().map_err(|e| io(e.into_error()))?;
    file.as_file().sync_all().map_err(io)?;
    file.persist(path).map_err(|e| io(e.error))?;
    Ok(())
}

/// An empty file beside `path`, gone when dropped.
pub(crate) fn temporary_file(path: &Path) -> Result<NamedTempFile, FormatError> {
    let mut builder = Builder::new();
    builder.prefix(".epipole-");
    // The crate's default is for secrets (owner only); a result has the permissions of any other file.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.tempfile_in(parent(path)).map_err(|source| FormatError::io(path, source))
}

/// A folder beside `path`, gone when dropped.
pub(crate) fn temporary_folder(path: &Path) -> Result<TempDir, FormatError> {
    let mut builder = Builder::new();
    builder.prefix(".epipole-");
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o777));
    builder.tempdir_in(parent(path)).map_err(|source| FormatError::io(path, source))
}

fn parent(path: &Path) -> PathBuf {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.to_owned(),
        _ => PathBuf::from("."),
    }
}

/// Makes `folder` hold exactly `fresh` (names of files in `staged`) of all `managed` names; other files stay.
///
/// A folder that does not exist appears in one rename. In one that exists, the old files step aside first and come
/// back if anything fails.
pub(crate) fn replace_files(
    staged: TempDir,
    folder: &Path,
    managed: &[&str],
    fresh: &[&str],
) -> Result<(), FormatError> {
    let io = |source| FormatError::io(folder, source);
    if !folder.exists() {
        let staged = staged.keep();
        return fs::rename(&staged, folder).map_err(|source| {
            // Nothing half-written stays; the rename's own failure is what the caller should hear of.
            let _ = fs::remove_dir_all(&staged);
            io(source)
        });
    }
    let aside = temporary_folder(folder)?;
    let mut moved: Vec<(PathBuf, PathBuf)> = Vec::new();
    let result = (|| -> std::io::Result<()> {
        for name in managed {
            let old = folder.join(name);
            if fs::symlink_metadata(&old).is_ok() {
                let place = aside.path().join(name);
                fs::rename(&old, &place)?;
                moved.push((place, old));
            }
        }
        for name in fresh {
            let (from, to) = (staged.path().join(name), folder.join(name));
            fs::rename(&from, &to)?;
            moved.push((from, to));
        }
        Ok(())
    })();
    if result.is_err() {
        for (now, before) in moved.iter().rev() {
            // Fresh files go back into the staging folder, old ones into their places.
            let (from, to) = if now.starts_with(staged.path()) { (before, now) } else { (now, before) };
            let _ = fs::rename(from, to);
        }
    }
    result.map_err(io)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_no_litter() {
        let dir = tempfile::tempdir().expect("temp dir");
        let path = dir.path().join("a.txt");
        atomic_write(&path, |w| w.write_all(b"old").map_err(|e| FormatError::io(Path::new("x"), e))).expect("write");
        let failed = atomic_write(&path, |w| {
            w.write_all(b"half").map_err(|e| FormatError::io(Path::new("x"), e))?;
            Err(FormatError::io(Path::new("x"), std::io::Error::other("stop")))
        });
        assert!(failed.is_err());
        assert_eq!(fs::read(&path).expect("read"), b"old");
        assert_eq!(fs::read_dir(dir.path()).expect("list").count(), 1);
    }

    #[test]
    fn replacing_keeps_foreign_files_and_removes_stale_ones() {
        let dir = tempfile::tempdir().expect("temp dir");
        let folder = dir.path().join("model");
        fs::create_dir(&folder).expect("mkdir");
        fs::write(folder.join("notes"), b"mine").expect("write");
        fs::write(folder.join("stale"), b"old").expect("write");
        fs::write(folder.join("a"), b"old").expect("write");
        let staged = temporary_folder(&folder).expect("stage");
        fs::write(staged.path().join("a"), b"new").expect("write");
        replace_files(staged, &folder, &["a", "stale"], &["a"]).expect("replace");
        assert_eq!(fs::read(folder.join("a")).expect("read"), b"new");
        assert!(folder.join("notes").exists() && !folder.join("stale").exists());
        assert_eq!(fs::read_dir(dir.path()).expect("list").count(), 1);
    }

    #[test]
    fn a_failed_replacement_puts_the_old_files_back() {
        let dir = tempfile::tempdir().expect("temp dir");
        let folder = dir.path().join("model");
        fs::create_dir(&folder).expect("mkdir");
        fs::write(folder.join("a"), b"old").expect("write");
        let staged = temporary_folder(&folder).expect("stage");
        fs::write(staged.path().join("a"), b"new").expect("write");
        assert!(replace_files(staged, &folder, &["a", "b"], &["a", "b"]).is_err(), "b was never staged");
        assert_eq!(fs::read(folder.join("a")).expect("read"), b"old");
        assert_eq!(fs::read_dir(dir.path()).expect("list").count(), 1);
    }
}
