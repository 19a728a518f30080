//! SQLite over anything that can be read by ranges: a `File` of a browser tab is never copied whole into memory.
//!
//! Each opened database gets a virtual file system of its own, registered under a unique name and taken away with it.
// SQLite's interface for file systems is a table of C functions; `rsqlite-vfs` fills it in and asks for promises that the
// compiler cannot check. They are written at each place.
#![allow(unsafe_code)]

use std::collections::{BTreeMap, VecDeque};
use std::rc::Rc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use rsqlite_vfs::{
    AccessMode, LockLevel, OpenAccess, OpenOptions, OpenRequest, OpenedFile, OsCallback, RegisterVfsError,
    SQLiteIoMethods, SQLiteVfs, SyncOptions, VfsError, VfsErrorCode, VfsFile, VfsRegistration, VfsResult, VfsStore,
    register_vfs,
};

/// Bytes that can be read from any place.
pub trait RangedBytes {
    /// Length, bytes.
    fn len(&self) -> u64;

    /// Whether there is nothing in it.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Fills `out` from `offset` on; `offset + out.len()` is at most [`Self::len`].
    ///
    /// # Errors
    /// Whatever kept the bytes from being read, for instance a file that changed since it was chosen.
    fn read_at(&self, offset: u64, out: &mut [u8]) -> std::io::Result<()>;
}

/// Bytes fetched at a time: a page of SQLite has 4 KiB, and a call into the browser for each takes longer than the copy.
const BLOCK_BYTES: u64 = 1 << 18;
/// Blocks kept: reading a table touches its own pages and, now and then, inner ones far away.
const KEPT_BLOCKS: usize = 16;

/// Files by name.
pub(super) struct Files(BTreeMap<String, Rc<dyn RangedBytes>>);

/// A file as SQLite has opened it, with the blocks it read last.
pub(super) struct Handle {
    bytes: Rc<dyn RangedBytes>,
    blocks: VecDeque<(u64, Vec<u8>)>,
}

impl Handle {
    fn block(&mut self, index: u64) -> VfsResult<&[u8]> {
        if let Some(found) = self.blocks.iter().position(|(k, _)| *k == index) {
            self.blocks.swap(0, found);
        } else {
            let start = index * BLOCK_BYTES;
            let mut data = vec![0; BLOCK_BYTES.min(self.bytes.len() - start) as usize];
            self.bytes
                .read_at(start, &mut data)
                .map_err(|e| VfsError::new(VfsErrorCode::IoRead, e.to_string().into()))?;
            self.blocks.truncate(KEPT_BLOCKS - 1);
            self.blocks.push_front((index, data));
        }
        Ok(&self.blocks[0].1)
    }
}

/// Nothing is ever written: a refusal, should SQLite try.
fn read_only<T>() -> VfsResult<T> {
    Err(VfsError::new(VfsErrorCode::ReadOnly, "the database is only read".into()))
}

impl VfsFile for Handle {
    fn read(&mut self, out: &mut [u8], offset: u64) -> VfsResult<usize> {
        let available = self.bytes.len().saturating_sub(offset).min(out.len() as u64) as usize;
        let mut done = 0;
        while done < available {
            let at = offset + done as u64;
            let data = &self.block(at / BLOCK_BYTES)?[(at % BLOCK_BYTES) as usize..];
            let count = data.len().min(available - done);
            out[done..done + count].copy_from_slice(&data[..count]);
            done += count;
        }
        Ok(done)
    }

    fn write(&mut self, _: &[u8], _: u64) -> VfsResult<()> {
        read_only()
    }

    fn truncate(&mut self, _: u64) -> VfsResult<()> {
        read_only()
    }

    fn sync(&mut self, _: SyncOptions) -> VfsResult<()> {
        Ok(())
    }

    fn size(&self) -> VfsResult<u64> {
        Ok(self.bytes.len())
    }

    // One connection has the file to itself.
    fn lock(&mut self, _: LockLevel) -> VfsResult<()> {
        Ok(())
    }

    fn unlock(&mut self, _: LockLevel) -> VfsResult<()> {
        Ok(())
    }

    fn check_reserved_lock(&self) -> VfsResult<bool> {
        Ok(false)
    }
}

struct Store;

impl VfsStore for Store {
    type File = Handle;
    type AppData = Files;

    fn open_file(files: &Files, request: OpenRequest<'_>) -> VfsResult<OpenedFile<Handle>> {
        let name = request.filename.map_or("", |name| name.path());
        let bytes = files.0.get(name).cloned().ok_or_else(|| {
            VfsError::new(VfsErrorCode::CantOpen, format!("there is no {name:?} beside the database").into())
        })?;
        Ok(OpenedFile { file: Handle { bytes, blocks: VecDeque::new() }, access: OpenAccess::ReadOnly })
    }

    fn close_file(_: &Files, _: Option<&str>, _: Handle, _: OpenOptions) -> VfsResult<()> {
        Ok(())
    }

    fn access(files: &Files, name: &str, mode: AccessMode) -> VfsResult<bool> {
        Ok(mode != AccessMode::ReadWrite && files.0.contains_key(name))
    }

    fn full_pathname(_: &Files, name: &str) -> VfsResult<String> {
        Ok(name.to_owned())
    }

    fn delete_file(_: &Files, _: &str, _: bool) -> VfsResult<()> {
        read_only()
    }
}

struct IoMethods;

impl SQLiteIoMethods for IoMethods {
    type Store = Store;
}

/// What SQLite asks of an operating system; reading takes none of it.
struct Os;

impl OsCallback for Os {
    fn sleep(&self, _: Duration) {}

    fn random(&self, _: &mut [u8]) -> usize {
        0
    }

    fn epoch_timestamp_in_ms(&self) -> VfsResult<i64> {
        Err(VfsError::new(VfsErrorCode::Error, "no clock".into()))
    }
}

struct Vfs;

impl SQLiteVfs<IoMethods> for Vfs {
    type Os = Os;

    fn os(_: &Files) -> &Os {
        &Os
    }
}

/// A file system that SQLite knows under a name, until it is dropped. Connections must be closed before.
pub(super) struct Registered {
    pub(super) name: String,
    registration: Option<VfsRegistration<Files>>,
}

/// Every registration has its own name, so that no two can be mistaken for one another.
static NEXT: AtomicU64 = AtomicU64::new(0);

impl Registered {
    pub(super) fn new(
        files: impl IntoIterator<Item = (String, Rc<dyn RangedBytes>)>,
    ) -> Result<Self, RegisterVfsError> {
        let name = format!("epipole-{}", NEXT.fetch_add(1, Ordering::Relaxed));
        let files = Files(files.into_iter().collect());
        // SAFETY: `Vfs`, `IoMethods` and `Store` use the default callbacks, whose layout and types agree by construction.
        // The name is unique in the process. `Rc` makes this type stay on one thread, and so its connections.
        let registration = unsafe { register_vfs::<IoMethods, Vfs>(&name, files, false) }?;
        Ok(Self { name, registration: Some(registration) })
    }
}

impl Drop for Registered {
    fn drop(&mut self) {
        if let Some(registration) = self.registration.take() {
            // SAFETY: the owner closes its only connection first (field order in `Source`); nobody else knows the name.
            // A refusal leaves the registration in place, which costs a few bytes and nothing else.
            let _ = unsafe { registration.unregister() };
        }
    }
}
