//! Writes every kernel's complete WGSL into a folder, for compilers outside this process: `compose_shaders FOLDER`.

use std::path::PathBuf;
use std::process::ExitCode;

use epipole_optimize::gpu::compose::compose;
use epipole_optimize::gpu::kernels::KERNELS;

fn main() -> ExitCode {
    let Some(folder) = std::env::args_os().nth(1).map(PathBuf::from) else {
        eprintln!("usage: compose_shaders FOLDER");
        return ExitCode::FAILURE;
    };
    for kernel in KERNELS {
        let path = folder.join(format!("{}.wgsl", kernel.name));
        let text = compose(kernel.file).map_err(|error| error.to_string());
        if let Err(error) = text.and_then(|text| std::fs::write(&path, text).map_err(|error| error.to_string())) {
            eprintln!("{}: {error}", path.display());
            return ExitCode::FAILURE;
        }
    }
    println!("{} kernels in {}", KERNELS.len(), folder.display());
    ExitCode::SUCCESS
}
