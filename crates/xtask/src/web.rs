//! `cargo xtask web`: the engine as WebAssembly with what the page needs beside it, and how large it is.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;
use std::{env, fs};

use clap::Args;

use crate::error::Error;
use crate::process::{self, cargo, output, root, run, run_within, target_dir};

const TARGET: &str = "wasm32-unknown-unknown";
const PROFILE: &str = "web";
/// rustup can hang for minutes before it succeeds or gives up.
const RUSTUP_LIMIT: Duration = Duration::from_secs(180);
const NPM_LIMIT: Duration = Duration::from_secs(180);
/// SQLite is C: any clang that knows wasm compiles it, with its archiver.
const CLANGS: [(&str, &str); 4] =
    [("clang-19", "llvm-ar-19"), ("clang-18", "llvm-ar-18"), ("clang-16", "llvm-ar-16"), ("clang", "llvm-ar")];
/// Every browser with WebGPU has it, and those without since 2021 or 2023 (Safari 16.4).
const FEATURES: &str = "-Ctarget-feature=+simd128";
/// For link-time optimisation only: it sees all crates at once and would inline what their own builds left apart. At LLVM's 225
/// the module is a tenth larger and not faster.
const LINK_FLAGS: &str = "-Cllvm-args=-inline-threshold=5 -inlinehint-threshold=100";
/// What the compiler cannot do: functions of different crates that came out alike become one, stores and jumps that change nothing
/// go, and locals are numbered by use, which compresses better. Chosen by the compressed size: merging functions that are only
/// similar, shorter instructions or all of `-O2`, which takes a minute more, make the module smaller and its compressed form larger.
const OPT_PASSES: [&str; 6] = [
    "--duplicate-function-elimination",
    "--rse",
    "--remove-unused-brs",
    "--remove-unused-names",
    "--vacuum",
    "--reorder-locals",
];
/// A database is read, by a handful of plain queries: what else SQLite can do is left out, two fifths of its size. Undone first
/// is what sqlite-wasm-rs switches on. Schemas still parse with all that they declare; what the amalgamation's ready-made parser calls
/// (views, triggers, virtual tables, `ALTER`) cannot be left out, and databases in UTF-16 must stay readable.
const SQLITE_FLAGS: &str = "-USQLITE_ENABLE_FTS5 -USQLITE_ENABLE_RTREE -USQLITE_ENABLE_SESSION \
    -USQLITE_ENABLE_PREUPDATE_HOOK -USQLITE_ENABLE_MATH_FUNCTIONS -USQLITE_ENABLE_BYTECODE_VTAB \
    -USQLITE_ENABLE_DBPAGE_VTAB -USQLITE_ENABLE_DBSTAT_VTAB -USQLITE_ENABLE_STMTVTAB -USQLITE_ENABLE_UNLOCK_NOTIFY \
    -USQLITE_ENABLE_OFFSET_SQL_FUNC -USQLITE_ENABLE_UNKNOWN_SQL_FUNCTION -DSQLITE_OMIT_JSON \
    -DSQLITE_OMIT_AUTHORIZATION -DSQLITE_OMIT_COMPLETE -DSQLITE_OMIT_GET_TABLE -DSQLITE_OMIT_PROGRESS_CALLBACK \
    -DSQLITE_OMIT_TCL_VARIABLE -DSQLITE_OMIT_TRACE -DSQLITE_OMIT_DESERIALIZE -DSQLITE_OMIT_COMPILEOPTION_DIAGS \
    -DSQLITE_UNTESTABLE -DSQLITE_OMIT_LOCALTIME -DSQLITE_OMIT_INTROSPECTION_PRAGMAS \
    -DSQLITE_OMIT_XFER_OPT -DSQLITE_OMIT_LIKE_OPTIMIZATION -DSQLITE_OMIT_QUICKBALANCE -DSQLITE_OMIT_TRUNCATE_OPTIMIZATION \
    -USQLITE_ENABLE_API_ARMOR -USQLITE_ENABLE_COLUMN_METADATA -DSQLITE_OMIT_AUTOINCREMENT -DSQLITE_OMIT_AUTOMATIC_INDEX \
    -DSQLITE_OMIT_AUTOVACUUM -DSQLITE_OMIT_BETWEEN_OPTIMIZATION -DSQLITE_OMIT_CHECK -DSQLITE_OMIT_COMPOUND_SELECT \
    -DSQLITE_OMIT_EXPLAIN -DSQLITE_OMIT_FOREIGN_KEY -DSQLITE_OMIT_INTEGRITY_CHECK \
    -DSQLITE_OMIT_OR_OPTIMIZATION -DSQLITE_OMIT_UPSERT";
/// All that a first visit loads, compressed (issue 5).
const LIMIT_BYTES: u64 = 1_000_000;

#[derive(Args, Default)]
// `serve` takes these too, beside its own of the same name.
#[group(id = "build")]
pub(crate) struct Arguments {
    /// Leave out wasm-opt.
    #[arg(long)]
    quick: bool,
}

/// The module with the JavaScript around it, made by the build and never committed.
fn vendor() -> PathBuf {
    root().join("web/vendor")
}

/// What is served, made by [`pack`] and never committed.
pub(crate) fn dist() -> PathBuf {
    root().join("web/dist")
}

pub(crate) fn build(arguments: &Arguments) -> Result<(), Error> {
    target()?;
    let (clang, archiver) = clang()?;
    let mut build = cargo(&["rustc", "--locked", "-p", "epipole-web", "--target", TARGET, "--profile", PROFILE]);
    build.args(["--", LINK_FLAGS]);
    build.env("CC_wasm32_unknown_unknown", clang).env("AR_wasm32_unknown_unknown", archiver);
    // Flags of the native build must not leak into this one.
    let flags: Vec<String> = [FEATURES.to_string()].into_iter().chain(anonymous_sources()).collect();
    build.env_remove("RUSTFLAGS").env("CARGO_ENCODED_RUSTFLAGS", flags.join("\x1f"));
    build.env("SQLITE_WASM_RS_FLAGS", SQLITE_FLAGS);
    run(&mut build, "")?;
    let folder = vendor();
    fs::create_dir_all(&folder).map_err(|source| Error::Io { path: folder.clone(), source })?;
    let module = target_dir().join(TARGET).join(PROFILE).join("epipole_web.wasm");
    let mut bindgen = cargo(&["run", "--locked", "-p", "epipole-bindgen", "--"]);
    run(bindgen.arg(&module).arg(&folder), "")?;
    packages()?;
    let wasm = folder.join("epipole_web_bg.wasm");
    if !arguments.quick {
        // No feature flags: the module says itself what it uses, and more is refused by browsers.
        let small = folder.join("small.wasm.tmp");
        let mut opt = Command::new("node");
        opt.arg(modules().join("binaryen/bin/wasm-opt")).args(OPT_PASSES).arg("-o").arg(&small).arg(&wasm);
        run(&mut opt, "")?;
        fs::rename(&small, &wasm).map_err(|source| Error::Io { path: wasm.clone(), source })?;
    }
    pack()?;
    report()
}

/// Puts together what is served, from the page's modules as they are now and the engine as it was built last. It takes less than
/// a second, so that whoever serves or tests without building does it too.
pub(crate) fn pack() -> Result<(), Error> {
    packages()?;
    let mut script = Command::new("node");
    script.arg(root().join("crates/xtask/js/pack.mjs")).arg(root());
    run(&mut script, "`cargo xtask web` builds the engine, where that is what is missing")
}

/// Panics name their file: without where this machine keeps the crates, so that every machine makes the same module.
fn anonymous_sources() -> Vec<String> {
    let home = env::var("CARGO_HOME").unwrap_or_else(|_| format!("{}/.cargo", env::var("HOME").unwrap_or_default()));
    let registries = fs::read_dir(Path::new(&home).join("registry/src")).into_iter().flatten().flatten();
    let mut folders: Vec<String> = registries.map(|folder| folder.path().display().to_string()).collect();
    folders.sort();
    folders.into_iter().map(|folder| format!("--remap-path-prefix={folder}/=")).collect()
}

/// The npm packages of `web/package.json`.
pub(crate) fn modules() -> PathBuf {
    root().join("web/node_modules")
}

pub(crate) fn packages() -> Result<(), Error> {
    if ["uplot", "esbuild", "playwright-core"].iter().all(|package| modules().join(package).exists()) {
        return Ok(());
    }
    if output("npm", &["--version"]).is_none() {
        return Err(Error::Missing("there is no npm; install node 20 or newer".into()));
    }
    let mut npm = Command::new("npm");
    npm.args(["ci", "--no-audit", "--no-fund"]).current_dir(root().join("web"));
    run_within(&mut npm, NPM_LIMIT, "the npm registry must be reachable once")
}

fn target() -> Result<(), Error> {
    let present = || {
        let sysroot = output("rustc", &["--print", "sysroot"]).unwrap_or_default();
        Path::new(&sysroot).join("lib/rustlib").join(TARGET).exists()
    };
    if present() {
        return Ok(());
    }
    let advice = "where no target can be downloaded, Debian's rustc-web and rust-web-src build it from source \
                  (shared/toolchain.md)";
    println!("the compiler cannot make WebAssembly yet: asking rustup, which can take minutes");
    let add = || run_within(Command::new("rustup").args(["target", "add", TARGET]), RUSTUP_LIMIT, advice);
    add().or_else(|_| add())
}

/// A clang for SQLite, installed where this is Debian and we may.
fn clang() -> Result<(&'static str, &'static str), Error> {
    let find = || {
        let there = |(clang, archiver): &&(&str, &str)| {
            output(clang, &["--version"]).is_some() && output(archiver, &["--version"]).is_some()
        };
        CLANGS.iter().find(there).copied()
    };
    if let Some(found) = find() {
        return Ok(found);
    }
    let advice = "on Debian `sudo apt-get install --no-install-recommends clang-19 llvm-19`";
    let missing = || Error::Missing(format!("SQLite needs clang and llvm-ar to become WebAssembly; {advice}"));
    if output("id", &["-u"]).as_deref() != Some("0") || output("apt-get", &["--version"]).is_none() {
        return Err(missing());
    }
    let apt = |arguments: &[&str]| {
        process::run(Command::new("apt-get").args(arguments).env("DEBIAN_FRONTEND", "noninteractive"), advice)
    };
    apt(&["update"])?;
    apt(&["install", "-y", "--no-install-recommends", "clang-19", "llvm-19"])?;
    find().ok_or_else(missing)
}

/// Sizes of everything a first visit loads, as it is and compressed.
fn report() -> Result<(), Error> {
    let script = root().join("crates/xtask/js/page_size.mjs");
    let sizes = output("node", &[&script.to_string_lossy(), &dist().to_string_lossy()])
        .ok_or_else(|| Error::Missing("node could not measure the page".into()))?;
    println!("{sizes}");
    let total = sizes.lines().last().and_then(|line| line.split_whitespace().last()?.parse::<u64>().ok()).unwrap_or(0);
    if total == 0 || total > LIMIT_BYTES {
        return Err(Error::Missing(format!("the page takes {total} bytes compressed; it may take {LIMIT_BYTES}")));
    }
    Ok(())
}
