//! `cargo xtask setup`: what the build needs beyond cargo, installed if missing and said either way.

use std::process::Command;
use std::time::Duration;

use crate::error::Error;
use crate::process::{self, output, run_within};
use crate::shaders;

/// The oldest compiler that builds the workspace (its edition 2024 code uses 1.95's library).
const MIN_RUST: (u32, u32) = (1, 95);

/// rustup can hang for minutes before it succeeds or gives up.
const RUSTUP_LIMIT: Duration = Duration::from_secs(180);

/// A step says what it found or did.
type Step = fn() -> Result<String, Error>;

const STEPS: [(&str, Step); 6] = [
    ("Rust compiler", rust_compiler),
    ("rustfmt and clippy", rust_components),
    ("C compiler (for SQLite)", c_compiler),
    ("Vulkan on the processor (for the WebGPU tests)", software_vulkan),
    ("Chromium (its compiler must take every shader, too)", chromium),
    ("crates", crates),
];

pub(crate) fn run() -> Result<(), Error> {
    for (name, step) in STEPS {
        println!("{name}: {}", step()?);
    }
    println!("ready: `cargo build --release` builds, `cargo xtask test` tests");
    Ok(())
}

fn rust_compiler() -> Result<String, Error> {
    let found = output("rustc", &["--version"]).unwrap_or_else(|| "none".into());
    match version(&found) {
        Some(version) if version >= MIN_RUST => Ok(found),
        _ => Err(Error::Missing(format!(
            "rustc {}.{} or newer is needed, found {found}; run `rustup toolchain install {}.{}.0` and \
             `rustup default {}.{}.0`",
            MIN_RUST.0, MIN_RUST.1, MIN_RUST.0, MIN_RUST.1, MIN_RUST.0, MIN_RUST.1
        ))),
    }
}

/// Major and minor of `rustc 1.95.0 (…)`.
fn version(text: &str) -> Option<(u32, u32)> {
    let mut numbers = text.split_whitespace().nth(1)?.split('.');
    Some((numbers.next()?.parse().ok()?, numbers.next()?.parse().ok()?))
}

fn rust_components() -> Result<String, Error> {
    let present =
        || output("cargo", &["fmt", "--version"]).is_some() && output("cargo", &["clippy", "--version"]).is_some();
    if present() {
        return Ok("present".into());
    }
    let advice =
        "run `rustup component add rustfmt clippy` where there is a network; only `cargo xtask test` needs them";
    // Once more on failure: the first try often only warms a cache.
    let add =
        || run_within(Command::new("rustup").args(["component", "add", "rustfmt", "clippy"]), RUSTUP_LIMIT, advice);
    match add().or_else(|_| add()) {
        Ok(()) => Ok("installed".into()),
        Err(e) => Ok(format!("NOT PRESENT: {e}")),
    }
}

fn c_compiler() -> Result<String, Error> {
    let compiler = || output("cc", &["--version"]).and_then(|text| text.lines().next().map(str::to_string));
    if let (Some(found), true) = (compiler(), has_c_headers()) {
        return Ok(found);
    }
    let advice = "install a C compiler with its headers, on Debian `sudo apt-get install build-essential`";
    if output("id", &["-u"]).as_deref() != Some("0") || output("apt-get", &["--version"]).is_none() {
        return Err(Error::Missing(format!("there is no working C compiler `cc`; {advice}")));
    }
    apt(&["update"], advice)?;
    apt(&["install", "-y", "--no-install-recommends", "build-essential"], advice)?;
    compiler()
        .map(|found| format!("installed: {found}"))
        .ok_or_else(|| Error::Missing(format!("`cc` is still missing after installing build-essential; {advice}")))
}

/// A compiler without the C library's headers passes `--version` and fails on the first file.
fn has_c_headers() -> bool {
    let preprocess = "printf '#include <stdio.h>\\n' | cc -E -x c - -o /dev/null";
    output("sh", &["-c", preprocess]).is_some()
}

/// Mesa's lavapipe: where no GPU is, the WebGPU kernels run on it. Nothing else needs it, so its absence is no error.
fn software_vulkan() -> Result<String, Error> {
    let present = || {
        let drivers = std::fs::read_dir("/usr/share/vulkan/icd.d").into_iter().flatten().flatten();
        drivers.into_iter().any(|entry| entry.file_name().to_string_lossy().contains("lvp"))
    };
    if present() {
        return Ok("present".into());
    }
    let advice = "on Debian `sudo apt-get install mesa-vulkan-drivers libvulkan1`";
    Ok(optional(&["mesa-vulkan-drivers", "libvulkan1"], "the WebGPU tests leave themselves out", advice))
}

/// A second compiler for the shaders, stricter than Naga: 100 MB, a quarter of a minute to unpack. Nothing else needs it.
fn chromium() -> Result<String, Error> {
    if let Some(path) = shaders::usual_chromium() {
        return Ok(path.display().to_string());
    }
    let advice = "on Debian `sudo apt-get install --no-install-recommends chromium`";
    Ok(optional(&["chromium"], "`cargo xtask test` leaves Chromium's compiler out", advice))
}

/// Installs packages that the build can do without, and says what is missing where that fails.
fn optional(packages: &[&str], without: &str, advice: &str) -> String {
    let missing = format!("NOT PRESENT: {without}; {advice}");
    if output("id", &["-u"]).as_deref() != Some("0") || output("apt-get", &["--version"]).is_none() {
        return missing;
    }
    let install = [&["install", "-y", "--no-install-recommends"], packages].concat();
    match apt(&["update"], advice).and_then(|()| apt(&install, advice)) {
        Ok(()) => "installed".into(),
        Err(_) => missing,
    }
}

fn apt(arguments: &[&str], advice: &str) -> Result<(), Error> {
    process::run(Command::new("apt-get").args(arguments).env("DEBIAN_FRONTEND", "noninteractive"), advice)
}

fn crates() -> Result<String, Error> {
    let advice = "crates.io must be reachable once";
    let mut fetch = process::cargo(&["fetch", "--locked", "--quiet"]);
    // Without a target cargo fetches every platform's crates.
    let version = output("rustc", &["-vV"]).unwrap_or_default();
    if let Some(host) = version.lines().find_map(|line| line.strip_prefix("host: ")) {
        fetch.args(["--target", host]);
    }
    process::run(&mut fetch, advice)?;
    Ok("fetched as Cargo.lock says".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_read_and_compared() {
        assert_eq!(version("rustc 1.95.0 (59807616e 2026-04-14)"), Some((1, 95)));
        assert_eq!(version("rustc 2.0.0-nightly"), Some((2, 0)));
        assert_eq!(version("none"), None);
        assert!(version("rustc 1.94.1 (x)") < Some(MIN_RUST));
    }
}
