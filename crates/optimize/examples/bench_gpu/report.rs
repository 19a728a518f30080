//! The figures of the benchmark, as a table and as JSON.

use epipole_optimize::bundle::Problem;
use epipole_optimize::bundle::gpu::measure::{Operator, Steps};
use epipole_optimize::gpu::Device;

/// All of it.
pub(crate) struct Report {
    adapter: String,
    software: bool,
    timestamps: bool,
    /// Bytes a second of the kernel that only reads.
    stream_bytes_per_second: f64,
    pub(crate) rows: Vec<Row>,
}

/// One problem.
pub(crate) struct Row {
    images: usize,
    points: usize,
    observations: usize,
    /// One application of the reduced operator.
    operator_ms: f64,
    operator_observations_per_second: f64,
    /// Bytes of the model (solver.md §6) over the time, and that over the stream's.
    operator_bytes_per_second: f64,
    share_of_stream: f64,
    lm_iterations: usize,
    accepted: usize,
    operator_applications: usize,
    lm_iteration_ms: f64,
    share_outside_operator: f64,
    dispatches_per_lm_iteration: f64,
    dispatches_per_pcg_iteration: f64,
    submissions_per_lm_iteration: f64,
    read_backs_per_lm_iteration: f64,
    resident_bytes_per_observation: f64,
    resident_bytes_total: u64,
}

impl Report {
    pub(crate) fn new(device: &Device, timestamps: bool, stream_bytes_per_second: f64) -> Self {
        let (adapter, software) = (device.description().to_string(), device.is_software());
        Self { adapter, software, timestamps, stream_bytes_per_second, rows: Vec::new() }
    }

    pub(crate) fn print_head(&self) {
        println!("{}", self.adapter);
        let clock = if self.timestamps { "the device's timestamps" } else { "wall time over many repetitions" };
        println!("times by {clock}; a kernel that only reads: {:.1} GB/s", self.stream_bytes_per_second * 1e-9);
        if self.software {
            println!("a software adapter computes on the processor: bandwidth is not what limits it");
        }
        println!();
        println!(
            "{:>9} {:>7} {:>9} | {:>9} {:>7} {:>6} {:>8} | {:>8} {:>8} | {:>8} {:>7} {:>6} | {:>6} {:>8}",
            "obs",
            "images",
            "points",
            "op ms",
            "Mobs/s",
            "GB/s",
            "stream %",
            "LM it ms",
            "outside%",
            "disp/LM",
            "per PCG",
            "reads",
            "B/obs",
            "MB"
        );
    }

    /// By hand: everything is a number but the adapter's name, and a crate for it would be built with every test.
    pub(crate) fn json(&self) -> String {
        let rows: Vec<String> = self.rows.iter().map(Row::json).collect();
        format!(
            "{{\n  \"adapter\": {:?},\n  \"software\": {},\n  \"timestamps\": {},\n  \
             \"stream_bytes_per_second\": {:e},\n  \"rows\": [\n    {}\n  ]\n}}\n",
            self.adapter,
            self.software,
            self.timestamps,
            self.stream_bytes_per_second,
            rows.join(",\n    ")
        )
    }
}

impl Row {
    pub(crate) fn new(problem: &Problem, operator: &Operator, steps: &Steps, stream: f64) -> Self {
        let (report, counters) = (&steps.report, &steps.counters);
        let observations = problem.observation_px.len();
        let seconds = operator.application.seconds;
        let bandwidth = operator.model_bytes as f64 / seconds;
        let iterations = report.iterations.max(1) as f64;
        Self {
            images: problem.cam_from_world.len(),
            points: problem.points.len(),
            observations,
            operator_ms: 1e3 * seconds,
            operator_observations_per_second: observations as f64 / seconds,
            operator_bytes_per_second: bandwidth,
            share_of_stream: bandwidth / stream,
            lm_iterations: report.iterations,
            accepted: report.accepted,
            operator_applications: report.inner_iterations,
            lm_iteration_ms: 1e3 * steps.seconds / iterations,
            share_outside_operator: steps.share_outside(operator),
            dispatches_per_lm_iteration: counters.dispatches as f64 / iterations,
            dispatches_per_pcg_iteration: counters.pcg_dispatches as f64 / counters.pcg_iterations.max(1) as f64,
            submissions_per_lm_iteration: counters.submissions as f64 / iterations,
            read_backs_per_lm_iteration: counters.read_backs as f64 / iterations,
            resident_bytes_per_observation: steps.resident_bytes.per_observation(),
            resident_bytes_total: steps.resident_bytes.total(),
        }
    }

    pub(crate) fn print(&self) {
        println!(
            "{:>9} {:>7} {:>9} | {:>9.3} {:>7.1} {:>6.2} {:>8.0} | {:>8.1} {:>8.0} | {:>8.0} {:>7.1} {:>6.1} | {:>6.1} {:>8.1}",
            self.observations,
            self.images,
            self.points,
            self.operator_ms,
            self.operator_observations_per_second * 1e-6,
            self.operator_bytes_per_second * 1e-9,
            100.0 * self.share_of_stream,
            self.lm_iteration_ms,
            100.0 * self.share_outside_operator,
            self.dispatches_per_lm_iteration,
            self.dispatches_per_pcg_iteration,
            self.read_backs_per_lm_iteration,
            self.resident_bytes_per_observation,
            self.resident_bytes_total as f64 * 1e-6,
        );
    }

    fn json(&self) -> String {
        let named = [
            ("images", self.images as f64),
            ("points", self.points as f64),
            ("observations", self.observations as f64),
            ("operator_ms", self.operator_ms),
            ("operator_observations_per_second", self.operator_observations_per_second),
            ("operator_bytes_per_second", self.operator_bytes_per_second),
            ("share_of_stream", self.share_of_stream),
            ("lm_iterations", self.lm_iterations as f64),
            ("accepted", self.accepted as f64),
            ("operator_applications", self.operator_applications as f64),
            ("lm_iteration_ms", self.lm_iteration_ms),
            ("share_outside_operator", self.share_outside_operator),
            ("dispatches_per_lm_iteration", self.dispatches_per_lm_iteration),
            ("dispatches_per_pcg_iteration", self.dispatches_per_pcg_iteration),
            ("submissions_per_lm_iteration", self.submissions_per_lm_iteration),
            ("read_backs_per_lm_iteration", self.read_backs_per_lm_iteration),
            ("resident_bytes_per_observation", self.resident_bytes_per_observation),
            ("resident_bytes_total", self.resident_bytes_total as f64),
        ];
        let pairs: Vec<String> = named.iter().map(|(name, value)| format!("\"{name}\": {value}")).collect();
        format!("{{ {} }}", pairs.join(", "))
    }
}
