//! What kernels read and wrote, as files: the same kernels can then run elsewhere and be compared (`cargo xtask
//! experiments` runs them in Chromium, whose compiler is Tint).

use std::fmt::Write as _;
use std::path::PathBuf;

use crate::bundle::gpu::GpuSystem;
use crate::gpu::compose::compose;
use crate::gpu::kernels::{Access, BUNDLE, Kernel};
use crate::gpu::split_groups;

/// The folder that traces go to; none are written where it is not set.
const FOLDER: &str = "EPIPOLE_KERNEL_TRACES";

/// A run of a kernel.
pub(super) struct Trace {
    path: PathBuf,
    kernel: Kernel,
    /// By binding: bytes in hexadecimal before the run.
    before: Vec<String>,
}

impl Trace {
    /// Before the run; `None` unless traces are wanted.
    pub(super) fn begin(system: &GpuSystem<'_>, kernel: &str, label: &str) -> Option<Self> {
        let folder = PathBuf::from(std::env::var_os(FOLDER)?);
        let kernel = *BUNDLE.iter().find(|k| k.name == kernel)?;
        let path = (0..).map(|k| folder.join(format!("{}-{label}{k}.json", kernel.name))).find(|p| !p.exists())?;
        Some(Self { path, kernel, before: contents(system, &kernel) })
    }

    /// After it. `exact` is what the first column of the sums should add up to, where that is of interest.
    pub(super) fn end(self, system: &GpuSystem<'_>, exact: Option<f64>) {
        let (groups, ..) = system.resident.bound(&self.kernel).expect("a kernel of the table");
        let [x, y] = split_groups(groups).expect("fits");
        let wgsl = compose(self.kernel.file, system.layout.variant).expect("listed");
        let wgsl = wgsl.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n").replace('\t', "\\t");
        let exact = exact.map_or("null".into(), |value| format!("{value:e}"));
        let mut text = format!(
            "{{\"kernel\":\"{}\",\"groups\":[{x},{y}],\"exact\":{exact},\"wgsl\":\"{wgsl}\",\"buffers\":[",
            self.kernel.name
        );
        let after = contents(system, &self.kernel);
        for (k, ((binding, before), after)) in self.kernel.bindings.iter().zip(&self.before).zip(&after).enumerate() {
            let (comma, name) = (if k > 0 { "," } else { "" }, binding.name);
            let kind = match binding.access {
                Access::Uniform => "uniform",
                Access::Read => "read",
                Access::Write => "write",
            };
            let after = if binding.access == Access::Write { after } else { "" };
            write!(
                text,
                "{comma}{{\"name\":\"{name}\",\"kind\":\"{kind}\",\"before\":\"{before}\",\"after\":\"{after}\"}}"
            )
            .expect("memory");
        }
        std::fs::write(&self.path, text + "]}").expect("a folder that can be written to");
    }
}

fn contents(system: &GpuSystem<'_>, kernel: &Kernel) -> Vec<String> {
    let (_, bindings, params) = system.resident.bound(kernel).expect("a kernel of the table");
    let hex = |words: &[u32]| -> String { words.iter().map(|w| format!("{w:08x}")).collect() };
    let one = |(part, binding): (&wgpu::BufferBinding<'_>, &crate::gpu::kernels::Binding)| {
        if binding.access == Access::Uniform {
            return hex(&params);
        }
        let words = part.buffer.size() as usize / 4;
        let all: Vec<u32> = pollster::block_on(system.device().download(part.buffer, words)).expect("a live device");
        let first = part.offset as usize / 4;
        hex(&all[first..part.size.map_or(words, |bytes| first + bytes.get() as usize / 4)])
    };
    bindings.iter().zip(kernel.bindings).map(one).collect()
}
