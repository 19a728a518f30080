//! A real device: transfers, dispatches in two dimensions, sums, limits and loss.

use pollster::block_on;

use super::device;
use crate::gpu::kernels::{PROBE, REDUCE, STREAM_READ};
use crate::gpu::{GpuError, Pipelines};

#[test]
fn dispatches_beyond_one_dimension_reach_every_group_once() {
    let Some(device) = device() else { return };
    let count = 70_001u32;
    let pipelines = Pipelines::new(&device, &[PROBE]).expect("compiles");
    let params = device.uniform("params", &[count, 0, 0, 0]).expect("a buffer");
    let groups = device.zeroed("groups", u64::from(count) * 4).expect("a buffer");
    let bound = pipelines.bind(&device, &PROBE, &[&params, &groups]).expect("binds");
    let mut encoder = device.encoder();
    bound.dispatch(&mut encoder, u64::from(count)).expect("fits");
    device.submit(encoder);
    let found: Vec<u32> = block_on(device.download(&groups, count as usize)).expect("a live device");
    assert!(found.iter().zip(1..).all(|(&a, b)| a == b));
}

#[test]
fn sums_are_exact_where_floats_are_and_repeat_to_the_bit() {
    let Some(device) = device() else { return };
    let (count, span) = (10_007usize, 300usize);
    // Whole numbers in the first column: every order of summation is exact. Fractions in the second.
    let rows: Vec<[f32; 8]> = (0..count)
        .map(|i| [(i % 97) as f32, 0.1 / (i + 1) as f32, 1.0, 0.0, -1.0, 2.0, 0.5, (i % 1013) as f32])
        .collect();
    let groups = count.div_ceil(span);
    let pipelines = Pipelines::new(&device, &[REDUCE]).expect("compiles");
    let params = device.uniform("params", &[count as u32, span as u32, 0, 0]).expect("a buffer");
    let input = device.storage("rows", &rows).expect("a buffer");
    let output = device.zeroed("sums", groups as u64 * 32).expect("a buffer");
    let bound = pipelines.bind(&device, &REDUCE, &[&params, &input, &output]).expect("binds");
    let run = || {
        let mut encoder = device.encoder();
        bound.dispatch(&mut encoder, groups as u64).expect("fits");
        device.submit(encoder);
        block_on(device.download::<[f32; 8]>(&output, groups)).expect("a live device")
    };
    let sums = run();
    assert_eq!(sums, run());
    let total = |k: usize| sums.iter().map(|s| f64::from(s[k])).sum::<f64>();
    let exact = |k: usize| rows.iter().map(|r| f64::from(r[k])).sum::<f64>();
    for k in [0, 2, 3, 4, 5, 6] {
        assert_eq!(total(k), exact(k), "column {k}");
    }
    assert!((total(1) / exact(1) - 1.0).abs() < 1e-6, "{} {}", total(1), exact(1));
    assert_eq!(sums.iter().map(|s| s[7]).fold(0.0, f32::max), 1012.0);
}

#[test]
fn too_large_a_buffer_is_an_error_that_names_it() {
    let Some(device) = device() else { return };
    let bytes = device.max_binding_bytes() + 4;
    let error = device.zeroed("points", bytes).expect_err("beyond the limit");
    assert!(matches!(error, GpuError::BufferTooLarge { buffer: "points", .. }), "{error}");
    assert!(device.check().is_ok());
}

#[test]
fn a_lost_device_is_a_typed_error_everywhere() {
    let Some(device) = device() else { return };
    let buffer = device.storage("data", &[1u32, 2, 3]).expect("a buffer");
    assert_eq!(block_on(device.download::<u32>(&buffer, 3)), Ok(vec![1, 2, 3]));
    device.destroy();
    assert!(matches!(block_on(device.download::<u32>(&buffer, 3)), Err(GpuError::Lost { .. })));
    assert!(matches!(device.zeroed("more", 64), Err(GpuError::Lost { .. })));
    assert!(matches!(Pipelines::new(&device, &[PROBE]), Err(GpuError::Lost { .. })));
}

#[test]
fn the_stream_is_read_once_and_timed() {
    let Some(device) = device() else { return };
    // Not a multiple of what a workgroup reads.
    let count = 300_001usize;
    let groups = count.div_ceil(256 * 16);
    let data: Vec<[f32; 4]> = (0..count).map(|i| [(i % 7) as f32, 1.0, 0.0, -((i % 3) as f32)]).collect();
    let pipelines = Pipelines::new(&device, &[STREAM_READ]).expect("compiles");
    let params = device.uniform("stream params", &[count as u32, 0, 0, 0]).expect("a buffer");
    let stream = device.storage("stream", &data).expect("a buffer");
    let sums = device.zeroed("sums", groups as u64 * 16).expect("a buffer");
    let bound = pipelines.bind(&device, &STREAM_READ, &[&params, &stream, &sums]).expect("binds");
    device.start_timing();
    let mut encoder = device.encoder();
    for _ in 0..3 {
        bound.dispatch(&mut encoder, groups as u64).expect("fits");
    }
    device.submit(encoder);
    let found: Vec<[f32; 4]> = block_on(device.download(&sums, groups)).expect("a live device");
    for k in 0..4 {
        let exact: f64 = data.iter().map(|v| f64::from(v[k])).sum();
        assert_eq!(found.iter().map(|v| f64::from(v[k])).sum::<f64>(), exact, "column {k}");
    }
    let times = block_on(device.finish_timing()).expect("a live device");
    match device.has_timestamps() {
        true => {
            let [time] = times[..] else { panic!("one kernel: {times:?}") };
            assert_eq!((time.kernel, time.dispatches), ("stream_read", 3));
            // 14 MB take longer than a nanosecond and less than a minute.
            assert!(time.seconds > 1e-9 && time.seconds < 60.0, "{time:?}");
        }
        false => assert!(times.is_empty()),
    }
    // Off again: nothing is timed.
    let mut encoder = device.encoder();
    bound.dispatch(&mut encoder, groups as u64).expect("fits");
    device.submit(encoder);
    assert_eq!(block_on(device.finish_timing()), Ok(Vec::new()));
}
