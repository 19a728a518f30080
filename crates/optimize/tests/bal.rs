//! Real BAL problems to their known optima (9 parameters a camera, squared loss, every observation counts).

mod common;

use epipole_optimize::active::Activation;
use epipole_optimize::bundle::{self, Options};
use epipole_optimize::lm::{LmOptions, LmReport};

const PROBLEMS: [(&str, f64); 2] = [("problem-49-7776-pre.txt", 1.334424e4), ("problem-21-11315-pre.txt", 3.037864e4)];

fn tight(tolerance: f64) -> Options {
    let lm = LmOptions { max_iterations: 200, relative_decrease_tolerance: tolerance, ..LmOptions::default() };
    Options { lm, activation: Activation::All, ..Options::default() }
}

fn check(name: &str, report: &LmReport, optimum: f64, gap: f64) {
    let found = report.final_cost / optimum - 1.0;
    println!(
        "{name}: {:.7e}, gap {found:.1e}, {} iterations, {} rejected, {:?}",
        report.final_cost, report.iterations, report.rejected, report.termination
    );
    // Below as well: a cost under the optimum means that observations were lost.
    assert!(found.abs() < gap, "{name}: {found}");
}

#[test]
fn reaches_the_known_optima_in_f64() {
    for (name, optimum) in PROBLEMS {
        let Some(mut problem) = common::read_bal(name) else { return };
        let mut options = tight(1e-9);
        // 49-7776 ends in a valley flatter than 1e-8 of the diagonal: the default damping would stop there at +8e-7.
        options.lm.lambda_min = 1e-12;
        let report = bundle::solve(&mut problem, &options, &mut ()).expect("a good problem");
        check(name, &report, optimum, 3e-7);
        // Nothing is refused while the cost still falls by more than rounding.
        let spurious = report.history.windows(2).filter(|w| !w[0].accepted && w[1].accepted).count();
        assert_eq!(spurious, 0, "{:?}", report.history);
    }
}

#[test]
fn reaches_the_known_optima_in_f32() {
    for (name, optimum) in PROBLEMS {
        let Some(mut problem) = common::read_bal(name) else { return };
        let report = bundle::solve_with::<f32>(&mut problem, &tight(1e-7), &mut ()).expect("a good problem");
        check(name, &report, optimum, 1e-5);
        for record in report.history.iter().filter(|r| !r.accepted) {
            let gap = record.cost / optimum - 1.0;
            assert!(gap < 1e-5, "refused at a gap of {gap}: {record:?}");
        }
    }
}
