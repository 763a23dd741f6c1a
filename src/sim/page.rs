//! The live page: a simulation in a browser on this machine.
//!
//! A small server on 127.0.0.1 gives `page.html` with the room inside, and [`View`](super::View)s as JSON at `/state?since=N`, which the page
//! asks for seven times a second. Each question lets the time pass that has gone by on the simulation's clock, so that a simulation in
//! real time goes on although nobody reads a file.
//!
//! The page draws on a canvas and says at it what it draws: `data-time`, `data-x`, `data-y`, `data-heading` of the first
//! robot, `data-moved` since the page was opened, `data-walls`, `data-robots`, `data-echoes`, `data-faults`.
//!
//! # Not here
//!
//! Nothing can be changed from the page, and it loads nothing from elsewhere; its own policy forbids it.
//!
//! # What we count on
//!
//! Whoever may open a port of this machine may look. Questions by another host name than this machine's are refused, so that a foreign
//! page in the same browser cannot ask.

use std::io;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::thread::JoinHandle;

use tiny_http::{Header, Method, Request, Response, Server};

use super::Simulation;

const TEMPLATE: &str = include_str!("page.html");

/// The page cannot be shown.
#[derive(Debug, thiserror::Error)]
pub enum PageError {
    /// Choose another port, or 0 for any.
    #[error("the page cannot be served at 127.0.0.1:{port}: {message}")]
    Bind {
        /// The port that was asked for.
        port: u16,
        /// What the system said.
        message: String,
    },
    /// There is no world to be shown.
    #[error("this simulation has no world to be shown")]
    NoWorld,
    /// The system gives no thread.
    #[error("the page's server cannot be started")]
    Thread(#[from] io::Error),
}

/// A page that is being served. Dropping it ends that.
#[derive(Debug)]
pub struct Page {
    address: SocketAddr,
    server: Arc<Unshown>,
    thread: Option<JoinHandle<()>>,
}

/// The server, which has nothing to show of itself.
struct Unshown(Server);

impl std::fmt::Debug for Unshown {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Server")
    }
}

impl Page {
    /// Serves a simulation's page at a port of 127.0.0.1, 0 for any that is free, and begins to watch it.
    ///
    /// # Errors
    ///
    /// [`PageError`]; nothing is served then.
    pub fn serve(simulation: &Simulation, port: u16) -> Result<Self, PageError> {
        let room = simulation.room().ok_or(PageError::NoWorld)?;
        let failed = |message: String| PageError::Bind { port, message };
        let server = Server::http((Ipv4Addr::LOCALHOST, port)).map_err(|error| failed(error.to_string()))?;
        let address =
            server.server_addr().to_ip().ok_or_else(|| failed("no address was given".to_owned()))?;
        let server = Arc::new(Unshown(server));
        simulation.watch();
        // JSON inside a script element: only `<` could end it.
        let room = serde_json::to_string(&room).map_err(|error| failed(error.to_string()))?;
        let page = TEMPLATE.replace("\"@ROOM@\"", &room.replace('<', "\\u003c"));
        let (served, simulation) = (Arc::clone(&server), simulation.clone());
        let serve = move || {
            for request in served.0.incoming_requests() {
                answer(request, &page, &simulation);
            }
        };
        let thread = std::thread::Builder::new().name("page".to_owned()).spawn(serve)?;
        Ok(Self { address, server, thread: Some(thread) })
    }

    /// Where the page is.
    #[must_use]
    pub fn url(&self) -> String {
        format!("http://{}/", self.address)
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        self.server.0.unblock();
        if let Some(thread) = self.thread.take() {
            // A server that has panicked has said so itself.
            let _ = thread.join();
        }
    }
}

fn answer(request: Request, page: &str, simulation: &Simulation) {
    let (path, query) = request.url().split_once('?').unwrap_or((request.url(), ""));
    let response = if !is_ours(&request) {
        text("text/plain", "this page is for its own machine\n").with_status_code(403)
    } else if *request.method() != Method::Get {
        text("text/plain", "nothing can be changed here\n").with_status_code(405)
    } else {
        match path {
            "/" => text("text/html; charset=utf-8", page),
            "/state" => state(query, simulation),
            _ => text("text/plain", "there is nothing here\n").with_status_code(404),
        }
    };
    // A browser that has gone away needs no answer.
    let _ = request.respond(response);
}

/// True where the browser thinks that it talks to this machine.
fn is_ours(request: &Request) -> bool {
    let host = request.headers().iter().find(|header| header.field.equiv("Host"));
    host.is_some_and(|host| {
        let host = host.value.as_str();
        let name = host.rsplit_once(':').map_or(host, |(name, _)| name);
        matches!(name, "127.0.0.1" | "localhost")
    })
}

fn state(query: &str, simulation: &Simulation) -> Response<io::Cursor<Vec<u8>>> {
    let since = query.strip_prefix("since=").and_then(|number| number.parse().ok()).unwrap_or(0);
    let view = simulation.view(since).and_then(|view| serde_json::to_string(&view).ok());
    match view {
        Some(json) => text("application/json", &json),
        None => text("text/plain", "there is nothing to be shown\n").with_status_code(500),
    }
}

fn text(kind: &str, body: &str) -> Response<io::Cursor<Vec<u8>>> {
    let headers =
        [("Content-Type", kind), ("Cache-Control", "no-store"), ("X-Content-Type-Options", "nosniff")];
    let headers = headers.iter().filter_map(|(name, value)| Header::from_bytes(*name, *value).ok());
    headers.fold(Response::from_string(body), Response::with_header)
}
