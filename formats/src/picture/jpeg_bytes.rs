//! A cursor over a JPEG's bytes for `zune-jpeg`, whose bit reader asks for four bytes at a time.
//!
//! The library's own cursor copies those through a call of `memcpy`; here the length is known when
//! the reader is compiled, which takes 5 % off a decode (docs/accuracy.md).

use zune_core::bytestream::{ZByteIoError, ZByteReaderTrait, ZSeekFrom};

/// Bytes and a position in them, never beyond their end.
pub(super) struct JpegBytes<'a> {
    bytes: &'a [u8],
    position: usize,
}

impl<'a> JpegBytes<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, position: 0 }
    }

    fn rest(&self) -> &'a [u8] {
        &self.bytes[self.position..]
    }
}

impl ZByteReaderTrait for JpegBytes<'_> {
    #[inline(always)]
    fn read_byte_no_error(&mut self) -> u8 {
        let byte = self.bytes.get(self.position).copied();
        self.position += usize::from(byte.is_some());
        byte.unwrap_or(0)
    }

    #[inline(always)]
    fn read_exact_bytes(&mut self, buffer: &mut [u8]) -> Result<(), ZByteIoError> {
        self.peek_exact_bytes(buffer)?;
        self.position += buffer.len();
        Ok(())
    }

    fn read_bytes(&mut self, buffer: &mut [u8]) -> Result<usize, ZByteIoError> {
        let read = self.peek_bytes(buffer)?;
        self.position += read;
        Ok(read)
    }

    fn peek_bytes(&mut self, buffer: &mut [u8]) -> Result<usize, ZByteIoError> {
        let length = buffer.len().min(self.rest().len());
        buffer[..length].copy_from_slice(&self.rest()[..length]);
        Ok(length)
    }

    #[inline(always)]
    fn peek_exact_bytes(&mut self, buffer: &mut [u8]) -> Result<(), ZByteIoError> {
        match self.bytes[self.position..].get(..buffer.len()) {
            Some(bytes) => buffer.copy_from_slice(bytes),
            None => return Err(ZByteIoError::NotEnoughBytes(self.rest().len(), buffer.len())),
        }
        Ok(())
    }

    fn z_seek(&mut self, from: ZSeekFrom) -> Result<u64, ZByteIoError> {
        let at = match from {
            ZSeekFrom::Start(at) => i64::try_from(at).ok(),
            ZSeekFrom::End(by) => (self.bytes.len() as i64).checked_add(by),
            ZSeekFrom::Current(by) => (self.position as i64).checked_add(by),
        };
        let at = at.and_then(|at| usize::try_from(at).ok());
        let at = at.ok_or(ZByteIoError::SeekError("a seek to before the first byte"))?;
        self.position = at.min(self.bytes.len());
        Ok(self.position as u64)
    }

    #[inline(always)]
    fn is_eof(&mut self) -> Result<bool, ZByteIoError> {
        Ok(self.position == self.bytes.len())
    }

    fn z_position(&mut self) -> Result<u64, ZByteIoError> {
        Ok(self.position as u64)
    }

    fn read_remaining(&mut self, sink: &mut Vec<u8>) -> Result<usize, ZByteIoError> {
        let rest = self.rest();
        sink.extend_from_slice(rest);
        self.position = self.bytes.len();
        Ok(rest.len())
    }
}
