//! Writes every kernel's complete WGSL, in every variant, into a folder, for compilers outside this process: `compose_shaders FOLDER`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use epipole_optimize::gpu::compose::{compose, variants};
use epipole_optimize::gpu::kernels::KERNELS;

fn main() -> ExitCode {
    let Some(folder) = std::env::args_os().nth(1).map(PathBuf::from) else {
        eprintln!("usage: compose_shaders FOLDER");
        return ExitCode::FAILURE;
    };
    match write(&folder) {
        Ok(count) => {
            println!("{count} shaders of {} kernels in {}", KERNELS.len(), folder.display());
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn write(folder: &Path) -> Result<usize, String> {
    let mut count = 0;
    for kernel in KERNELS {
        for variant in variants(kernel.file).map_err(|error| error.to_string())? {
            let name: String = [kernel.name].into_iter().chain(variant.flags()).collect::<Vec<_>>().join("-");
            let path = folder.join(format!("{name}.wgsl"));
            let text = compose(kernel.file, variant).map_err(|error| error.to_string())?;
            std::fs::write(&path, text).map_err(|error| format!("{}: {error}", path.display()))?;
            count += 1;
        }
    }
    Ok(count)
}
