//! Compaction on a device: what counts lies first, nothing is lost, and the two orders still refer to each other.

use pollster::block_on;

use crate::active::Activation;
use crate::bundle::Options;
use crate::bundle::gpu::records::OUT;
use crate::bundle::gpu::{GpuSystem, Residency};
use crate::common_for_tests::extraction::out_of_sight;
use crate::gpu::tests::device;
use crate::lm::System;

#[test]
fn compaction_moves_what_counts_to_the_front_and_loses_nothing() {
    let Some(device) = device() else { return };
    let problem = out_of_sight();
    let options = Options { activation: Activation::Truncated { residual_limit_px: 60.0 }, ..Options::default() };
    for residency in [Residency::default(), Residency { chunk_observations: 1000 }] {
        let mut system = GpuSystem::with_residency(&device, &problem, &options, &residency).expect("a good problem");
        system.membership.compact_share = 0.0;
        let active = block_on(system.refresh(&mut ())).active;
        block_on(system.linearize(&mut ()));
        let mut counted = 0;
        for (chunk, buffers) in system.layout.chunks.iter().zip(&system.resident.chunks) {
            let (points, observations) = (chunk.points.len(), chunk.by_point.len());
            let words = |buffer, count| block_on(device.download::<u32>(buffer, count)).expect("a live device");
            let tracks = words(&buffers.tracks, 2 * points + 1);
            let by_point = words(&buffers.by_point, 2 * observations);
            let by_image = words(&buffers.by_image, 4 * observations);
            let image_order = words(&buffers.image_order, observations);
            let pixels = words(&buffers.pixels, 2 * observations);
            let segments = words(&buffers.segments, 4 * chunk.segments.len());
            for p in 0..points {
                let (start, end, counts_to) =
                    (tracks[p] as usize, tracks[p + 1] as usize, tracks[points + 1 + p] as usize);
                let (mut found, mut wanted) = (Vec::new(), Vec::new());
                for o in start..end {
                    assert_eq!(by_point[2 * o] & OUT == 0, o < counts_to, "point {p}");
                    found.push((by_point[2 * o] & !OUT, pixels[2 * o], pixels[2 * o + 1]));
                    let [x, y] = chunk.pixels[o].map(f32::to_bits);
                    wanted.push((chunk.by_point[o], x, y));
                    let place = image_order[o] as usize;
                    assert_eq!((by_image[4 * place] as usize, by_image[4 * place + 2] as usize), (p, o));
                    assert_eq!(by_image[4 * place + 1], by_point[2 * o + 1], "weights in both orders");
                }
                found.sort_unstable();
                wanted.sort_unstable();
                assert_eq!(found, wanted, "point {p}");
                counted += counts_to - start;
            }
            for (s, segment) in chunk.segments.iter().enumerate() {
                let counts_to = segments[4 * s + 2];
                for place in segment[1]..segment[2] {
                    let weight = f32::from_bits(by_image[4 * place as usize + 1]);
                    assert_eq!(weight != 0.0, place < counts_to, "segment {s}");
                    let o = by_image[4 * place as usize + 2] as usize;
                    assert_eq!(by_point[2 * o] & !OUT, segment[0], "an observation left its image");
                }
            }
        }
        assert!(counted == active && active < problem.observation_px.len(), "{counted} {active}");
    }
}

#[test]
fn a_step_is_the_same_compacted_or_not() {
    let Some(device) = device() else { return };
    let problem = out_of_sight();
    let options = Options { activation: Activation::Truncated { residual_limit_px: 60.0 }, ..Options::default() };
    let step = |share: f64| {
        let mut system = GpuSystem::new(&device, &problem, &options).expect("a good problem");
        system.membership.compact_share = share;
        block_on(async {
            let active = system.refresh(&mut ()).await.active;
            assert!(active < problem.observation_px.len() * 3 / 4, "nothing is out");
            system.linearize(&mut ()).await;
            let step = system.solve(1e-4, &mut ()).await.expect("a solution");
            let decrease = system.try_step().await.decrease;
            system.accept().await;
            let after = system.refresh(&mut ()).await;
            (step.predicted_decrease, decrease, after.cost, after.active)
        })
    };
    let (plain, compact) = (step(1.0), step(0.0));
    println!("{plain:?} {compact:?}");
    assert!((compact.0 / plain.0 - 1.0).abs() < 1e-5 && (compact.1 / plain.1 - 1.0).abs() < 1e-5);
    assert!((compact.2 / plain.2 - 1.0).abs() < 1e-4 && compact.3.abs_diff(plain.3) <= 2);
}
