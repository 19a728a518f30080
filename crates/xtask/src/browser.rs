//! `cargo xtask browser`: the real page with the real engine in headless Chromium, driven by the specs in `tests/browser`.

use std::fs;
use std::path::PathBuf;
use std::process::Command;
use std::thread;
use std::time::Duration;

use clap::Args;

use crate::error::Error;
use crate::process::{self, cargo, output, root, run_within, target_dir};
use crate::serve::Server;
use crate::shaders::{self, WITH_GPU};
use crate::web;

/// Everything at once on two cores; beyond this a browser hangs.
const LIMIT: Duration = Duration::from_secs(900);
const TYPES_LIMIT: Duration = Duration::from_secs(120);

#[derive(Args, Default)]
pub(crate) struct Arguments {
    /// Only specs whose file name contains one of these.
    specs: Vec<String>,
    /// Test the engine that was built before.
    #[arg(long)]
    no_build: bool,
    /// Renew the README's picture of the page, `docs/page.png`.
    #[arg(long)]
    picture: bool,
    /// Path of Chromium, where it is not in one of the usual places.
    #[arg(long)]
    chromium: Option<PathBuf>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Error> {
    let chromium = shaders::chromium(arguments.chromium.as_ref())?;
    if arguments.no_build {
        web::pack()?;
    } else {
        web::build(&web::Arguments::default())?;
    }
    let mut types = Command::new("node");
    types.arg(web::modules().join("typescript/bin/tsc")).arg("-p").arg(root().join("web"));
    run_within(&mut types, TYPES_LIMIT, "mend the types in `web`")?;
    // The same selection as the tests', so that nothing is built twice; the specs compare the page with the program.
    let programs = ["--bin", "epipole", "--bin", "epipole-fixtures"];
    process::run(&mut cargo(&[&["build"], &WITH_GPU[..], &programs[..]].concat()), "")?;
    let out = target_dir().join("browser");
    fs::create_dir_all(&out).map_err(|source| Error::Io { path: out.clone(), source })?;
    let specs = specs(&arguments.specs)?;
    let server = Server::new(0, web::dist())?;
    let mut node = Command::new("node");
    node.args(["--test", "--test-concurrency=1", "--test-reporter=spec"]).args(specs);
    node.env("EPIPOLE_PAGE", format!("http://{}/", server.address));
    node.env("EPIPOLE_CHROMIUM", chromium).env("EPIPOLE_OUT", &out);
    node.env("EPIPOLE_PROGRAM", target_dir().join("debug/epipole"));
    node.env("EPIPOLE_FIXTURES", target_dir().join("debug/epipole-fixtures"));
    let shared = root().join("../shared/data");
    if shared.is_dir() {
        node.env("EPIPOLE_SHARED", shared);
    }
    if arguments.picture {
        node.env("EPIPOLE_PICTURE", root().join("docs/page.png"));
    }
    thread::scope(|scope| {
        scope.spawn(|| server.answer());
        let advice = "what the page looked like is in the folder `browser` of the target folder";
        let result = run_within(&mut node, LIMIT, advice);
        server.end();
        result
    })
}

/// The spec files, those asked for or all.
fn specs(asked: &[String]) -> Result<Vec<PathBuf>, Error> {
    let folder = root().join("tests/browser");
    let io = |source| Error::Io { path: folder.clone(), source };
    let entries: Result<Vec<_>, _> = fs::read_dir(&folder).map_err(io)?.collect();
    let mut specs: Vec<PathBuf> = entries.map_err(io)?.into_iter().map(|entry| entry.path()).collect();
    specs.retain(|path| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.ends_with(".spec.mjs") && (asked.is_empty() || asked.iter().any(|part| name.contains(part.as_str())))
    });
    specs.sort();
    if specs.is_empty() {
        return Err(Error::Missing(format!("no spec in {} has such a name", folder.display())));
    }
    Ok(specs)
}

/// What a machine lacks that the page's tests need.
pub(crate) fn missing() -> Option<&'static str> {
    match (shaders::usual_chromium(), output("npm", &["--version"])) {
        (None, _) => Some("Chromium (`cargo xtask setup` installs it on Debian)"),
        (_, None) => Some("npm (on Debian `apt-get install npm`)"),
        (Some(_), Some(_)) => None,
    }
}

impl Arguments {
    /// All specs, with the page as it was built last.
    pub(crate) fn built() -> Self {
        Self { no_build: true, ..Self::default() }
    }
}
