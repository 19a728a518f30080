//! Grey PNG: depths in 16 bits as sensors and data sets store them, confidences in 8 or 16.

use std::io::Cursor;

use png::{BitDepth, ColorType, Decoder, Limits};

use super::raster::{Raster, check_size};
use crate::error::Problem;

/// Bytes the decoder may hold beside the pixels: its window, chunks and rows.
const DECODER_BYTES: usize = 1 << 26;

pub(super) fn parse(bytes: &[u8]) -> Result<Raster, Problem> {
    let wrong = |reason: String| Problem::WrongKind { expected: "a grey PNG file", reason };
    let mut decoder = Decoder::new_with_limits(Cursor::new(bytes), Limits { bytes: DECODER_BYTES });
    decoder.ignore_checksums(false);
    let mut reader = decoder.read_info().map_err(|e| wrong(e.to_string()))?;
    let info = reader.info();
    let (width, height) = (info.width, info.height);
    let sample_bytes = match (info.color_type, info.bit_depth) {
        (ColorType::Grayscale, BitDepth::Sixteen) => 2,
        (ColorType::Grayscale, BitDepth::Eight) => 1,
        (color, depth) => {
            return Err(wrong(format!("it has {color:?} pixels with {} bits a channel, not 16-bit grey", depth as u8)));
        }
    };
    check_size(width.into(), height.into(), sample_bytes, bytes.len() as u64)?;
    let length = reader.output_buffer_size().ok_or_else(|| wrong("its size is impossible".into()))?;
    let mut samples = vec![0; length];
    let frame = reader.next_frame(&mut samples).map_err(|e| wrong(e.to_string()))?;
    samples.truncate(frame.buffer_size());
    let (values, full_scale) = if sample_bytes == 1 {
        (samples.iter().map(|&v| f32::from(v)).collect(), u16::from(u8::MAX))
    } else {
        (samples.chunks_exact(2).map(|v| f32::from(u16::from_be_bytes([v[0], v[1]]))).collect(), u16::MAX)
    };
    Ok(Raster { width: width as usize, height: height as usize, values, full_scale: Some(full_scale.into()) })
}
