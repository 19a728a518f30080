//! `cargo xtask shaders`: every kernel through both compilers, Naga (natively) and Tint (in headless Chromium).

use std::path::PathBuf;
use std::process::Command;
use std::time::Duration;

use clap::Args;

use crate::error::Error;
use crate::process::{self, cargo, output, root, run_within, target_dir};

/// The driver of the browser; newer ones within this major version are fine.
const PLAYWRIGHT: &str = "playwright-core@1";
/// Chromium on SwiftShader compiles all kernels in seconds; beyond this it hangs.
const BROWSER_LIMIT: Duration = Duration::from_secs(180);
const NPM_LIMIT: Duration = Duration::from_secs(180);
/// What is built with wgpu, always the whole workspace: for another set of packages cargo would build most dependencies
/// once more. The tool that writes wasm's JavaScript is apart, only the page needs it.
pub(crate) const WITH_GPU: [&str; 6] = ["--locked", "--workspace", "--exclude", "epipole-bindgen", "--features", "gpu"];
const BROWSERS: [&str; 3] = ["/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome"];

#[derive(Args)]
pub(crate) struct Arguments {
    /// Only what needs no browser.
    #[arg(long)]
    no_browser: bool,
    /// Path of Chromium, where it is not in one of the usual places.
    #[arg(long)]
    chromium: Option<PathBuf>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Error> {
    let naga = [&["test"], &WITH_GPU[..], &["--lib", "gpu::tests::shaders"]].concat();
    process::run(&mut cargo(&naga), "mend the shader or its row in `gpu/kernels.rs`")?;
    if arguments.no_browser {
        println!("LEFT OUT: Chromium's compiler, as asked");
        return Ok(());
    }
    compile_in_browser(arguments.chromium.as_ref())
}

fn compile_in_browser(chromium_asked: Option<&PathBuf>) -> Result<(), Error> {
    let folder = target_dir().join("shaders");
    // Left from kernels that no longer exist, files would be compiled again.
    if folder.exists() {
        std::fs::remove_dir_all(&folder).map_err(|source| Error::Io { path: folder.clone(), source })?;
    }
    std::fs::create_dir_all(&folder).map_err(|source| Error::Io { path: folder.clone(), source })?;
    process::run(&mut cargo(&[&["build"], &WITH_GPU[..], &["--example", "compose_shaders"]].concat()), "")?;
    process::run(Command::new(target_dir().join("debug/examples/compose_shaders")).arg(&folder), "")?;
    let chromium = chromium(chromium_asked)?;
    let modules = playwright()?;
    let mut node = Command::new("node");
    node.arg(root().join("crates/xtask/js/compile_shaders.mjs")).arg(&folder).arg(chromium).current_dir(modules);
    run_within(&mut node, BROWSER_LIMIT, "mend the shader: Tint is stricter than Naga")
}

/// As part of the tests: Naga has had its turn there, and a machine without Chromium or npm leaves the rest out, loudly.
pub(crate) fn run_in_tests() -> Result<(), Error> {
    let missing = match (usual_chromium(), output("npm", &["--version"])) {
        (None, _) => "Chromium (`cargo xtask setup` installs it on Debian)",
        (_, None) => "npm (on Debian `apt-get install npm`)",
        (Some(_), Some(_)) => return compile_in_browser(None),
    };
    println!("LEFT OUT: no shader was compiled by Chromium's Tint, there is no {missing}");
    Ok(())
}

pub(crate) fn usual_chromium() -> Option<PathBuf> {
    BROWSERS.iter().map(PathBuf::from).find(|path| path.exists())
}

pub(crate) fn chromium(asked: Option<&PathBuf>) -> Result<PathBuf, Error> {
    asked.cloned().or_else(usual_chromium).ok_or_else(|| {
        let advice = "install it (on Debian `apt-get install -y --no-install-recommends chromium`), name it with \
                      --chromium, or pass --no-browser";
        Error::Missing(format!("there is no Chromium; {advice}"))
    })
}

/// A folder from which node finds playwright-core, in the target folder: it is a tool, not a part of the project.
pub(crate) fn playwright() -> Result<PathBuf, Error> {
    let folder = target_dir().join("playwright");
    if !folder.join("node_modules/playwright-core").exists() {
        if output("npm", &["--version"]).is_none() {
            return Err(Error::Missing("there is no npm; install node 20 or newer, or pass --no-browser".into()));
        }
        std::fs::create_dir_all(&folder).map_err(|source| Error::Io { path: folder.clone(), source })?;
        let mut npm = Command::new("npm");
        npm.args(["install", "--no-audit", "--no-fund", "--prefix", ".", PLAYWRIGHT]).current_dir(&folder);
        run_within(&mut npm, NPM_LIMIT, "the npm registry must be reachable once, or pass --no-browser")?;
    }
    Ok(folder)
}
