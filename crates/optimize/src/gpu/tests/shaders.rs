//! Every shader is valid, stays within WebGPU's default limits, and is what the table says.

use naga::valid::{Capabilities, ValidationFlags, Validator};
use naga::{AddressSpace, Module, StorageAccess};

use crate::gpu::compose::{SOURCES, compose, files, variants};
use crate::gpu::kernels::{Access, KERNELS, Kernel};
use crate::gpu::{GpuError, Variant, split_groups};

/// WebGPU's default limits.
const STORAGE_BUFFERS: usize = 8;
const INVOCATIONS: u32 = 256;
const WORKGROUP_BYTES: u32 = 16_384;

/// Every kernel in every variant in which its text can differ.
fn all() -> impl Iterator<Item = (&'static Kernel, Variant)> {
    let of = |kernel: &'static Kernel| {
        variants(kernel.file).expect("sound conditions").into_iter().map(move |v| (kernel, v))
    };
    KERNELS.iter().flat_map(of)
}

fn parse(file: &str, variant: Variant) -> Module {
    let text = compose(file, variant).expect("all imports are listed");
    let module =
        naga::front::wgsl::parse_str(&text).unwrap_or_else(|e| panic!("{}", e.emit_to_string_with_path(&text, file)));
    let mut validator = Validator::new(ValidationFlags::all(), Capabilities::empty());
    validator.validate(&module).unwrap_or_else(|e| panic!("{}", e.emit_to_string_with_path(&text, file)));
    module
}

#[test]
fn every_kernel_is_valid_and_as_the_table_says() {
    for (kernel, variant) in all() {
        let module = parse(kernel.file, variant);
        let entries: Vec<_> = module.entry_points.iter().filter(|e| e.name == kernel.name).collect();
        assert_eq!(entries.len(), 1, "{}: one entry point of that name", kernel.name);
        assert_eq!(entries[0].workgroup_size, [kernel.workgroup_size, 1, 1], "{}", kernel.name);
        let mut found: Vec<_> = module
            .global_variables
            .iter()
            .filter_map(|(_, variable)| {
                let binding = variable.binding.as_ref()?;
                assert_eq!(binding.group, 0, "{}", kernel.name);
                let access = match variable.space {
                    AddressSpace::Uniform => Access::Uniform,
                    AddressSpace::Storage { access } if access.contains(StorageAccess::STORE) => Access::Write,
                    AddressSpace::Storage { .. } => Access::Read,
                    space => panic!("{}: unexpected {space:?}", kernel.name),
                };
                Some((binding.binding, variable.name.clone().unwrap_or_default(), access))
            })
            .collect();
        found.sort_by_key(|f| f.0);
        let listed: Vec<_> =
            kernel.bindings.iter().zip(0..).map(|(b, slot)| (slot, b.name.to_string(), b.access)).collect();
        assert_eq!(found, listed, "{}", kernel.name);
    }
}

#[test]
fn every_kernel_fits_the_default_limits() {
    for (kernel, variant) in all() {
        let storage = kernel.bindings.iter().filter(|b| b.access != Access::Uniform).count();
        assert!(storage <= STORAGE_BUFFERS, "{}: {storage} storage buffers", kernel.name);
        assert!(kernel.workgroup_size <= INVOCATIONS, "{}", kernel.name);
        let module = parse(kernel.file, variant);
        let mut layouter = naga::proc::Layouter::default();
        layouter.update(module.to_ctx()).expect("a valid module");
        let workgroup = module.global_variables.iter().filter(|(_, v)| v.space == AddressSpace::WorkGroup);
        let bytes: u32 = workgroup.map(|(_, v)| layouter[v.ty].size).sum();
        assert!(bytes <= WORKGROUP_BYTES, "{}: {bytes} bytes of workgroup memory", kernel.name);
    }
}

#[test]
fn every_file_is_used_and_unknown_imports_are_errors() {
    let used: Vec<String> = all().flat_map(|(k, variant)| files(k.file, variant).expect("listed")).collect();
    for (path, _) in SOURCES {
        assert!(used.iter().any(|file| file == path), "no kernel uses {path}");
    }
    let once = compose("common/reduce.wgsl", Variant::default()).expect("listed");
    assert_eq!(once.matches("fn linear_group").count(), 1);
    let none = compose("none.wgsl", Variant::default());
    assert_eq!(none, Err(GpuError::UnknownShader { file: "none.wgsl".into() }));
}

#[test]
fn no_kernel_tests_for_nan_by_comparison() {
    // Fast-math compilers drop `x != x` (source: solver.md §1.5).
    for (path, source) in SOURCES {
        assert!(!source.contains("isNan") && !source.contains("x != x"), "{path}");
    }
}

/// Lines of a shader that declare a variable in a loop and leave its value to the compiler.
fn unwritten_in_loops(source: &str) -> Vec<&str> {
    let (mut depth, mut loops, mut found) = (0i32, Vec::new(), Vec::new());
    for line in source.lines() {
        let code = line.split("//").next().unwrap_or_default().trim();
        if !loops.is_empty() && code.starts_with("var ") && code.ends_with(';') && !code.contains('=') {
            found.push(code);
        }
        if ["for ", "while ", "loop "].iter().any(|word| code.starts_with(word)) {
            loops.push(depth);
        }
        depth += code.matches('{').count() as i32 - code.matches('}').count() as i32;
        while loops.last().is_some_and(|&outside| depth <= outside) {
            loops.pop();
        }
    }
    found
}

#[test]
fn variables_in_loops_are_written_in_every_round() {
    // Chromium 148 leaves them what they were (docs/gpu-experiments.md).
    for (path, source) in SOURCES {
        assert_eq!(unwritten_in_loops(source), [""; 0], "{path}");
    }
    let source = "fn f() {\n var a: f32;\n for (;;) {\n  var b: f32;\n  var c = 0.0;\n }\n var d: f32;\n}";
    assert_eq!(unwritten_in_loops(source), ["var b: f32;"]);
}

#[test]
fn splits_cover_all_groups_within_the_limit() {
    for groups in [1, 64, 65_535, 65_536, 69_632, 1_000_003, 65_535 * 65_535] {
        let [x, y] = split_groups(groups).expect("fits");
        assert!(x <= 65_535 && y <= 65_535);
        let covered = u64::from(x) * u64::from(y);
        assert!(covered >= groups && covered - groups < u64::from(y), "{groups}: {x} × {y}");
    }
    assert!(split_groups(65_535 * 65_535 + 1).is_err());
}
