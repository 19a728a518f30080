//! `cargo xtask serve`: builds the page and serves it, to this machine only.

use std::fs;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::{Component, Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use clap::Args;

use crate::error::Error;
use crate::web;

#[derive(Args)]
pub(crate) struct Arguments {
    /// Port; 0 takes a free one.
    #[arg(long, default_value_t = 8080)]
    port: u16,
    /// Serve the engine that was built before.
    #[arg(long)]
    no_build: bool,
    #[command(flatten)]
    build: web::Arguments,
}

/// Browsers open connections ahead of need; one that says nothing for so long is let go.
const PATIENCE: Duration = Duration::from_secs(20);
/// Request and headers of a browser are a kilobyte or two.
const MAX_HEAD_BYTES: u64 = 65_536;

pub(crate) fn run(arguments: &Arguments) -> Result<(), Error> {
    if arguments.no_build {
        web::pack()?;
    } else {
        web::build(&arguments.build)?;
    }
    let server = Server::new(arguments.port, web::dist())?;
    println!("Epipole is at http://{}", server.address);
    server.answer();
    Ok(())
}

/// Files of one folder for this machine's own browser. A thread a connection and a connection a request: nobody waits for
/// anybody, which servers with a pool of threads cannot say of browsers that open connections ahead.
pub(crate) struct Server {
    listener: TcpListener,
    folder: PathBuf,
    /// Where it listens.
    pub(crate) address: SocketAddr,
    is_over: AtomicBool,
}

impl Server {
    /// Listens on this machine's own address; port 0 takes a free one.
    pub(crate) fn new(port: u16, folder: PathBuf) -> Result<Self, Error> {
        let bind = move || {
            let listener = TcpListener::bind(("127.0.0.1", port))?;
            let address = listener.local_addr()?;
            Ok(Self { listener, folder, address, is_over: AtomicBool::new(false) })
        };
        bind().map_err(|e: io::Error| {
            Error::Missing(format!("port {port} cannot be used: {e}; choose another with --port"))
        })
    }

    /// Answers until [`Self::end`].
    pub(crate) fn answer(&self) {
        thread::scope(|scope| {
            for stream in self.listener.incoming() {
                if self.is_over.load(Ordering::Relaxed) {
                    break;
                }
                // A browser that went away is nobody's mistake.
                let _ = stream.map(|stream| scope.spawn(move || answer(stream, &self.folder)));
            }
        });
    }

    /// Lets [`Self::answer`] return.
    pub(crate) fn end(&self) {
        self.is_over.store(true, Ordering::Relaxed);
        // It looks up at the next connection.
        let _ = TcpStream::connect(self.address);
    }
}

fn answer(mut stream: TcpStream, folder: &Path) -> io::Result<()> {
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    let mut lines = BufReader::new(stream.try_clone()?.take(MAX_HEAD_BYTES)).lines();
    let Some(request) = lines.next().transpose()? else { return Ok(()) };
    // Headers say nothing that matters here; unread, closing the connection would throw the answer away.
    for line in lines {
        if line?.is_empty() {
            break;
        }
    }
    let mut words = request.split_whitespace();
    let (method, url) = (words.next().unwrap_or_default(), words.next().unwrap_or_default());
    let (status, kind, body) = match (method, local(folder, url)) {
        ("GET" | "HEAD", Some(path)) => ("200 OK", kind(&path), fs::read(&path)?),
        ("GET" | "HEAD", None) => ("404 Not Found", "text/plain", Vec::new()),
        _ => ("405 Method Not Allowed", "text/plain", Vec::new()),
    };
    // A page that is being worked on must not come from a cache.
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nCache-Control: no-cache\r\n\
         X-Content-Type-Options: nosniff\r\nConnection: close\r\n\r\n",
        body.len()
    );
    stream.write_all(head.as_bytes())?;
    if method != "HEAD" {
        stream.write_all(&body)?;
    }
    stream.flush()
}

/// The file of an address: one of the folder's, nothing else of this machine.
fn local(folder: &Path, url: &str) -> Option<PathBuf> {
    let path = url.split(['?', '#']).next()?.trim_start_matches('/');
    let path = if path.is_empty() { "index.html" } else { path };
    let plain = Path::new(path).components().all(|part| matches!(part, Component::Normal(_)));
    plain.then(|| folder.join(path)).filter(|path| path.is_file())
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
    use crate::process::root;

    #[test]
    fn a_silent_connection_holds_nobody_up() {
        let server = Server::new(0, root()).expect("a free port");
        thread::scope(|scope| {
            scope.spawn(|| server.answer());
            let silent: Vec<TcpStream> =
                (0..16).map(|_| TcpStream::connect(server.address).expect("a connection")).collect();
            for (request, status) in [
                ("GET / HTTP/1.1\r\nHost: a\r\n\r\n", "200"),
                ("GET /web/../Cargo.toml HTTP/1.1\r\n\r\n", "404"),
                ("POST / HTTP/1.1\r\n\r\n", "405"),
                ("\r\n\r\n", "405"),
            ] {
                let mut stream = TcpStream::connect(server.address).expect("a connection");
                stream.set_read_timeout(Some(Duration::from_secs(5))).expect("a limit");
                stream.write_all(request.as_bytes()).expect("sent");
                let mut answer = String::new();
                stream.read_to_string(&mut answer).expect("an answer in time");
                assert!(answer.starts_with(&format!("HTTP/1.1 {status}")), "{request}: {answer}");
            }
            drop(silent);
            server.end();
        });
    }

    #[test]
    fn only_files_of_the_folder_are_served() {
        assert!(local(&root(), "/").is_some_and(|path| path.ends_with("index.html")));
        let web = root().join("web");
        assert!(local(&web, "/app.js?v=1").is_some());
        for outside in ["/../Cargo.toml", "/styles/../../Cargo.toml", "//etc/passwd", "/styles", "/none.js"] {
            assert!(local(&web, outside).is_none(), "{outside}");
        }
    }
}
