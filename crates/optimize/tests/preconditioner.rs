//! The products that the circuits of `scale.md` §2 take with and without the second level of the preconditioner.

mod common;

use common::{circuit, circuit_optimum, print_products, products_to};
use epipole_optimize::bundle::{self, Options, Preconditioner, Solver};
use epipole_optimize::lm::LmOptions;

/// `scale.md` §2 has 25 products to 1e-6 of the optimum at 200 images; 1.3 times as many are allowed.
const PRODUCTS_200: usize = 32;

fn options(preconditioner: Preconditioner) -> Options {
    let lm = LmOptions { relative_decrease_tolerance: 1e-7, ..LmOptions::default() };
    Options { lm, solver: Solver::PcgImplicit, preconditioner, ..Options::default() }
}

#[test]
fn a_circuit_of_200_images_takes_few_products_on_the_cpu() {
    let problem = circuit(200);
    let optimum = circuit_optimum(&problem);
    let two_level = bundle::solve(&mut problem.clone(), &options(Preconditioner::Auto), &mut ()).expect("good");
    print_products("two-level f64", &two_level, optimum, f64::NAN);
    let single =
        bundle::solve_with::<f32>(&mut problem.clone(), &options(Preconditioner::TwoLevel), &mut ()).expect("good");
    print_products("two-level f32", &single, optimum, f64::NAN);
    let plain = bundle::solve(&mut problem.clone(), &options(Preconditioner::SchurJacobi), &mut ()).expect("good");
    print_products("plain f64", &plain, optimum, f64::NAN);
    for report in [&two_level, &single] {
        assert!(products_to(report, optimum, 1e-6).is_some_and(|n| n <= PRODUCTS_200));
    }
    assert!(products_to(&plain, optimum, 1e-6).is_none_or(|n| n > 4 * PRODUCTS_200));
}

#[cfg(feature = "gpu")]
mod on_device {
    use epipole_optimize::bundle::gpu::GpuSystem;
    use epipole_optimize::lm::minimize;
    use pollster::block_on;

    use super::*;

    #[test]
    fn a_circuit_of_200_images_takes_as_few_on_the_device() {
        let Some(device) = common::device::device() else { return };
        let problem = circuit(200);
        let optimum = circuit_optimum(&problem);
        // Below 1e-6 single precision decides steps by noise, which is not what is counted here.
        let options = Options { lm: LmOptions::default(), ..options(Preconditioner::Auto) };
        let mut system = GpuSystem::new(&device, &problem, &options).expect("good");
        let report = block_on(minimize(&mut system, &options.lm, &mut ()));
        let counters = system.counters();
        println!("{counters:?}");
        print_products("two-level on the device", &report, optimum, f64::NAN);
        assert!((report.final_cost / optimum - 1.0).abs() < 1e-6);
        assert!(products_to(&report, optimum, 1e-6).is_some_and(|n| n <= PRODUCTS_200));
        // One for the start, one a step, one every second step; with a refused step among seven that is 2 an accepted one.
        assert!(counters.read_backs <= 1 + counters.steps + counters.steps.div_ceil(2), "{counters:?}");
        assert_eq!(counters.pcg_dispatches, 3 * counters.pcg_iterations);
    }
}
