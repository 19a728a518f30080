//! OpenEXR: the depth channel of the first layer that has one, as renderers and data sets write it.

use std::io::Cursor;

use exr::meta::MetaData;
use exr::prelude::{ReadChannels, ReadLayers, read};

use super::raster::{Raster, check_size};
use crate::error::Problem;

/// Names of depth channels, without the layer's name before the last dot, best first.
const NAMES: [&str; 5] = ["Z", "depth", "V", "Y", "R"];

/// Bytes of the largest sample.
const SAMPLE_BYTES: u64 = 4;

pub(super) fn parse(bytes: &[u8]) -> Result<Raster, Problem> {
    let wrong = |reason: String| Problem::WrongKind { expected: "an OpenEXR file with depths", reason };
    let fail = |e: exr::error::Error| wrong(e.to_string());
    // The sizes first: the reader reserves by them.
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(fail)?;
    for header in &meta.headers {
        let size = header.layer_size;
        let channels = header.channels.list.len() as u64;
        check_size(size.0 as u64, size.1 as u64, SAMPLE_BYTES.saturating_mul(channels), bytes.len() as u64)?;
    }
    let image = read().no_deep_data().largest_resolution_level().all_channels().all_layers().all_attributes();
    let image = image.non_parallel().from_buffered(Cursor::new(bytes)).map_err(fail)?;
    let channels = || image.layer_data.iter().flat_map(|layer| layer.channel_data.list.iter().map(move |c| (layer, c)));
    let named = |wanted: &str| {
        channels().find(|(_, channel)| {
            let name = channel.name.to_string();
            name.rsplit('.').next().is_some_and(|last| last.eq_ignore_ascii_case(wanted))
        })
    };
    let only = || (channels().count() == 1).then(|| channels().next()).flatten();
    let (layer, channel) = NAMES.iter().find_map(|name| named(name)).or_else(only).ok_or_else(|| {
        let names: Vec<String> = channels().take(8).map(|(_, c)| c.name.to_string()).collect();
        wrong(format!("of its channels [{}] none is named {}", names.join(", "), NAMES.join(", ")))
    })?;
    let values: Vec<f32> = channel.sample_data.values_as_f32().collect();
    let (width, height) = (layer.size.0, layer.size.1);
    if width.checked_mul(height) != Some(values.len()) {
        return Err(wrong("its depth channel has fewer samples than the image pixels".into()));
    }
    Ok(Raster { width, height, values, full_scale: None })
}
