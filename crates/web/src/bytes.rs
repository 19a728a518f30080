//! A file of the tab, read by ranges and synchronously: only a worker may, and this is one.

use epipole_formats::RangedBytes;
use js_sys::Uint8Array;
use web_sys::{File, FileReaderSync};

/// A chosen or dropped file. Its bytes stay where they are until they are asked for.
pub(crate) struct TabFile {
    file: File,
    reader: FileReaderSync,
}

impl TabFile {
    pub(crate) fn new(file: File) -> Result<Self, String> {
        let reader = FileReaderSync::new().map_err(|_| "files can be read in a worker only".to_owned())?;
        Ok(Self { file, reader })
    }

    /// The whole file.
    pub(crate) fn read(&self) -> std::io::Result<Vec<u8>> {
        let mut out = vec![0; self.len() as usize];
        self.read_at(0, &mut out)?;
        Ok(out)
    }
}

impl RangedBytes for TabFile {
    fn len(&self) -> u64 {
        self.file.size() as u64
    }

    fn read_at(&self, offset: u64, out: &mut [u8]) -> std::io::Result<()> {
        let failed = |what: &str| std::io::Error::other(format!("{what}: it may have been changed or moved"));
        let end = offset + out.len() as u64;
        let slice = self
            .file
            .slice_with_f64_and_f64(offset as f64, end as f64)
            .map_err(|_| failed("the file cannot be sliced"))?;
        let buffer =
            self.reader.read_as_array_buffer(&slice).map_err(|_| failed("the file cannot be read any more"))?;
        let bytes = Uint8Array::new(&buffer);
        if bytes.length() as usize != out.len() {
            return Err(failed("the file is shorter than it was"));
        }
        bytes.copy_to(out);
        Ok(())
    }
}
