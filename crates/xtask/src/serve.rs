//! `cargo xtask serve`: builds the page and serves it, to this machine only.

use std::fs::File;
use std::path::{Component, Path, PathBuf};
use std::thread;

use clap::Args;
use tiny_http::{Header, Method, Request, Response, Server, StatusCode};

use crate::error::Error;
use crate::process::root;
use crate::web;

#[derive(Args)]
pub(crate) struct Arguments {
    /// Port; 0 takes a free one.
    #[arg(long, default_value_t = 8080)]
    port: u16,
    /// Serve what was built before.
    #[arg(long)]
    no_build: bool,
    #[command(flatten)]
    build: web::Arguments,
}

/// Requests answered at once: a browser opens six connections.
pub(crate) const THREADS: usize = 6;

pub(crate) fn run(arguments: &Arguments) -> Result<(), Error> {
    if !arguments.no_build {
        web::build(&arguments.build)?;
    }
    let server = listen(arguments.port)?;
    println!("Epipole is at http://{}", server.server_addr());
    thread::scope(|scope| {
        for _ in 0..THREADS {
            scope.spawn(|| answer_all(&server));
        }
    });
    Ok(())
}

/// A server on this machine's own address; port 0 takes a free one.
pub(crate) fn listen(port: u16) -> Result<Server, Error> {
    Server::http(("127.0.0.1", port))
        .map_err(|e| Error::Missing(format!("port {port} cannot be used: {e}; choose another with --port")))
}

/// Answers until the server is unblocked; any number of threads may.
pub(crate) fn answer_all(server: &Server) {
    while let Ok(request) = server.recv() {
        // A browser that went away is nobody's mistake.
        let _ = answer(request);
    }
}

fn answer(request: Request) -> std::io::Result<()> {
    let refuse = |request: Request, code: u16| request.respond(Response::empty(StatusCode(code)));
    if !matches!(request.method(), Method::Get | Method::Head) {
        return refuse(request, 405);
    }
    let Some(path) = local(request.url()) else { return refuse(request, 404) };
    let Ok(file) = File::open(&path) else { return refuse(request, 404) };
    let header = |name: &str, value: &str| Header::from_bytes(name, value);
    let mut response = Response::from_file(file);
    // A page that is being worked on must not come from a cache.
    for (name, value) in
        [("Content-Type", kind(&path)), ("Cache-Control", "no-cache"), ("X-Content-Type-Options", "nosniff")]
    {
        if let Ok(header) = header(name, value) {
            response.add_header(header);
        }
    }
    request.respond(response)
}

/// The file of an address: the page, its modules, nothing else of this machine.
fn local(url: &str) -> Option<PathBuf> {
    let path = url.split(['?', '#']).next()?.trim_start_matches('/');
    let path = if path.is_empty() { "index.html" } else { path };
    let plain = Path::new(path).components().all(|part| matches!(part, Component::Normal(_)));
    let served = path == "index.html" || (path.starts_with("web/") && !path.starts_with("web/node_modules"));
    (plain && served).then(|| root().join(path)).filter(|path| path.is_file())
}

fn kind(path: &Path) -> &'static str {
    match path.extension().and_then(|e| e.to_str()).unwrap_or_default() {
        "html" => "text/html; charset=utf-8",
        "js" | "mjs" => "text/javascript; charset=utf-8",
        "css" => "text/css; charset=utf-8",
        "svg" => "image/svg+xml",
        "wasm" => "application/wasm",
        "json" => "application/json",
        _ => "application/octet-stream",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_page_is_served() {
        assert!(local("/").is_some_and(|path| path.ends_with("index.html")));
        assert!(local("/web/app.js?v=1").is_some());
        for outside in
            ["/Cargo.toml", "/web/../Cargo.toml", "//etc/passwd", "/web/node_modules/uplot/package.json", "/web"]
        {
            assert!(local(outside).is_none(), "{outside}");
        }
    }
}
