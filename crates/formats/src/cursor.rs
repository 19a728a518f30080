//! Little-endian reading from a slice that never runs past its end.

use crate::error::Problem;

/// A position in untrusted bytes.
#[derive(Clone, Debug)]
pub(crate) struct Cursor<'a> {
    bytes: &'a [u8],
    position: usize,
}

impl<'a> Cursor<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, position: 0 }
    }

    pub(crate) fn remaining(&self) -> usize {
        self.bytes.len() - self.position
    }

    fn truncated(&self, wanted: u64) -> Problem {
        let expected = (self.position as u64).saturating_add(wanted);
        Problem::Truncated { expected, found: self.bytes.len() as u64 }
    }

    pub(crate) fn take(&mut self, count: usize) -> Result<&'a [u8], Problem> {
        let rest = &self.bytes[self.position..];
        let taken = rest.get(..count).ok_or_else(|| self.truncated(count as u64))?;
        self.position += count;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Problem> {
        let mut out = [0; N];
        out.copy_from_slice(self.take(N)?);
        Ok(out)
    }

    pub(crate) fn u8(&mut self) -> Result<u8, Problem> {
        self.array::<1>().map(|[b]| b)
    }

    pub(crate) fn u32(&mut self) -> Result<u32, Problem> {
        self.array().map(u32::from_le_bytes)
    }

    pub(crate) fn i32(&mut self) -> Result<i32, Problem> {
        self.array().map(i32::from_le_bytes)
    }

    pub(crate) fn u64(&mut self) -> Result<u64, Problem> {
        self.array().map(u64::from_le_bytes)
    }

    pub(crate) fn f64(&mut self) -> Result<f64, Problem> {
        self.array().map(f64::from_le_bytes)
    }

    pub(crate) fn f64s<const N: usize>(&mut self) -> Result<[f64; N], Problem> {
        let mut out = [0.0; N];
        for value in &mut out {
            *value = self.f64()?;
        }
        Ok(out)
    }

    /// A count of records of at least `record_bytes` each, checked against the bytes that are left, so that it may be
    /// used to reserve memory.
    pub(crate) fn count(&mut self, record_bytes: usize) -> Result<usize, Problem> {
        let count = self.u64()?;
        self.check_count(count, record_bytes)
    }

    /// As [`Self::count`], for a count of 32 bits.
    pub(crate) fn count_u32(&mut self, record_bytes: usize) -> Result<usize, Problem> {
        let count = u64::from(self.u32()?);
        self.check_count(count, record_bytes)
    }

    fn check_count(&self, count: u64, record_bytes: usize) -> Result<usize, Problem> {
        let bytes = count.saturating_mul(record_bytes as u64);
        if bytes > self.remaining() as u64 {
            return Err(self.truncated(bytes));
        }
        Ok(count as usize)
    }

    /// Bytes up to a zero byte, which is consumed.
    pub(crate) fn zero_terminated(&mut self) -> Result<&'a [u8], Problem> {
        let rest = &self.bytes[self.position..];
        let length = rest.iter().position(|&b| b == 0).ok_or_else(|| self.truncated(rest.len() as u64 + 1))?;
        self.position += length + 1;
        Ok(&rest[..length])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_count_larger_than_the_file_is_refused() {
        let mut bytes = u64::MAX.to_le_bytes().to_vec();
        bytes.extend([0; 16]);
        assert!(matches!(Cursor::new(&bytes).count(8), Err(Problem::Truncated { .. })));
        let mut two = Cursor::new(&[2, 0, 0, 0, 0, 0, 0, 0, 1, 2]);
        assert_eq!(two.count(1), Ok(2));
        assert_eq!(two.take(2), Ok(&[1u8, 2][..]));
        assert!(two.u8().is_err());
    }
}
