//! Float TIFF, and TIFF of whole numbers: one channel, stored, deflated or LZW, with any predictor.

use std::io::Cursor;

use tiff::ColorType;
use tiff::decoder::{Decoder, DecodingResult, Limits};

use super::raster::{MAX_PIXELS, Raster, check_size};
use crate::error::Problem;

/// Bytes of the largest sample.
const MAX_SAMPLE_BYTES: u64 = 8;

pub(super) fn parse(bytes: &[u8]) -> Result<Raster, Problem> {
    let wrong = |e: tiff::TiffError| Problem::WrongKind { expected: "a TIFF file", reason: e.to_string() };
    let mut limits = Limits::default();
    limits.decoding_buffer_size = (MAX_PIXELS * MAX_SAMPLE_BYTES) as usize;
    let mut decoder = Decoder::new(Cursor::new(bytes)).map_err(wrong)?.with_limits(limits);
    let (width, height) = decoder.dimensions().map_err(wrong)?;
    let color = decoder.colortype().map_err(wrong)?;
    if !matches!(color, ColorType::Gray(_)) {
        let reason = format!("it has {color:?} pixels, not one channel");
        return Err(Problem::WrongKind { expected: "a depth map", reason });
    }
    let pixels = check_size(width.into(), height.into(), color.bit_depth().div_ceil(8).into(), bytes.len() as u64)?;
    let (values, full_scale): (Vec<f32>, Option<f32>) = match decoder.read_image().map_err(wrong)? {
        DecodingResult::F16(v) => (v.into_iter().map(f32::from).collect(), None),
        DecodingResult::F32(v) => (v, None),
        DecodingResult::F64(v) => (v.into_iter().map(|v| v as f32).collect(), None),
        DecodingResult::U8(v) => (v.into_iter().map(f32::from).collect(), Some(u8::MAX.into())),
        DecodingResult::U16(v) => (v.into_iter().map(f32::from).collect(), Some(u16::MAX.into())),
        DecodingResult::U32(v) => (v.into_iter().map(|v| v as f32).collect(), Some(u32::MAX as f32)),
        DecodingResult::U64(v) => (v.into_iter().map(|v| v as f32).collect(), Some(u64::MAX as f32)),
        DecodingResult::I8(v) => (v.into_iter().map(f32::from).collect(), Some(i8::MAX.into())),
        DecodingResult::I16(v) => (v.into_iter().map(f32::from).collect(), Some(i16::MAX.into())),
        DecodingResult::I32(v) => (v.into_iter().map(|v| v as f32).collect(), Some(i32::MAX as f32)),
        DecodingResult::I64(v) => (v.into_iter().map(|v| v as f32).collect(), Some(i64::MAX as f32)),
    };
    if values.len() != pixels {
        return Err(Problem::Inconsistent(format!("{width} × {height} pixels, but {} values", values.len())));
    }
    Ok(Raster { width: width as usize, height: height as usize, values, full_scale })
}
