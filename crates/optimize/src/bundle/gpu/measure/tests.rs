//! The small end of `cargo xtask bench gpu`, on whatever adapter there is.

use std::time::Instant;

use pollster::block_on;

use super::*;
use crate::common_for_tests as common;
use crate::gpu::tests::device;
use crate::lm::LmOptions;

#[test]
fn the_small_end_of_the_benchmark() {
    let Some(device) = device() else { return };
    let mut problem = common::ring(&common::bench_scene(30_000));
    common::perturb(&mut problem, 0.1, 0.01, 1);
    let observations = problem.observation_px.len();
    assert!((27_000..33_000).contains(&observations), "{observations}");
    let start = Instant::now();
    let clock = || start.elapsed().as_secs_f64();
    for timestamps in [false, true] {
        let timing = Timing { clock: &clock, timestamps, min_seconds: 0.1 };
        let stream = block_on(stream_bytes_per_second(&device, &timing)).expect("a live device");
        let lm = LmOptions { max_iterations: 3, relative_decrease_tolerance: 0.0, ..LmOptions::default() };
        let options = Options { lm, ..Options::default() };
        let operator = block_on(operator(&device, &problem, &options, &timing)).expect("a good problem");
        let steps = block_on(steps(&device, &problem, &options, &timing)).expect("a good problem");
        println!("{stream:.3e} B/s; {operator:?}; {:?}, {:?}", steps.counters, steps.resident_bytes);
        // Slower than a floppy disk or faster than any memory is an error of the measurement.
        for rate in [stream, operator.model_bytes as f64 / operator.application.seconds] {
            assert!((1e5..1e14).contains(&rate), "{rate}");
        }
        assert_eq!(operator.application.by_timestamps, timestamps && device.has_timestamps());
        let report = &steps.report;
        assert_eq!((report.iterations, report.rejected), (3, 0));
        assert!(report.final_cost < report.initial_cost);
        let share = steps.share_outside(&operator);
        assert!((0.0..1.0).contains(&share), "{share}");
        // The bounds: read-backs an accepted step, dispatches a PCG iteration, bytes an observation.
        let counters = steps.counters;
        assert!(counters.read_backs <= 2 * 3, "{counters:?}");
        assert!(counters.pcg_iterations >= report.inner_iterations as u64 && report.inner_iterations > 0);
        assert!(counters.pcg_dispatches <= 3 * counters.pcg_iterations, "{counters:?}");
        assert!(steps.resident_bytes.per_observation() <= 60.0, "{:?}", steps.resident_bytes);
    }
}
