//! A page for a browser on this machine: a small server on 127.0.0.1 that only shows.
//!
//! # Not here
//!
//! What is shown: a simulation's room (`sim`), a run that is going on (`report`). Nothing can be changed from a page.
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
    /// There is nothing to be shown, because of this.
    #[error("there is nothing to be shown: {0}")]
    Nothing(&'static str),
    /// The system gives no thread.
    #[error("the page's server cannot be started")]
    Thread(#[from] io::Error),
}

/// What is shown at one address of the page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Shown {
    /// The page itself.
    Html(String),
    /// What it asks for.
    Json(String),
    /// There is no such address.
    Nothing,
    /// It cannot be shown now.
    Failed,
}

/// A page that is being served. Dropping it ends that.
#[derive(Debug)]
pub(crate) struct LocalPage {
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

impl LocalPage {
    /// Serves at a port of 127.0.0.1, 0 for any that is free; `show` is given path and query.
    ///
    /// # Errors
    ///
    /// [`PageError`]; nothing is served then.
    pub(crate) fn serve(
        port: u16,
        show: impl Fn(&str, &str) -> Shown + Send + 'static,
    ) -> Result<Self, PageError> {
        let failed = |message: String| PageError::Bind { port, message };
        let server = Server::http((Ipv4Addr::LOCALHOST, port)).map_err(|error| failed(error.to_string()))?;
        let address =
            server.server_addr().to_ip().ok_or_else(|| failed("no address was given".to_owned()))?;
        let server = Arc::new(Unshown(server));
        let served = Arc::clone(&server);
        let serve = move || {
            for request in served.0.incoming_requests() {
                answer(request, &show);
            }
        };
        let thread = std::thread::Builder::new().name("page".to_owned()).spawn(serve)?;
        Ok(Self { address, server, thread: Some(thread) })
    }

    /// Where the page is.
    pub(crate) fn url(&self) -> String {
        format!("http://{}/", self.address)
    }
}

impl Drop for LocalPage {
    fn drop(&mut self) {
        self.server.0.unblock();
        if let Some(thread) = self.thread.take() {
            // A server that has panicked has said so itself.
            let _ = thread.join();
        }
    }
}

fn answer(request: Request, show: &impl Fn(&str, &str) -> Shown) {
    let (path, query) = request.url().split_once('?').unwrap_or((request.url(), ""));
    let response = if !is_ours(&request) {
        text("text/plain", "this page is for its own machine\n").with_status_code(403)
    } else if *request.method() != Method::Get {
        text("text/plain", "nothing can be changed here\n").with_status_code(405)
    } else {
        match show(path, query) {
            Shown::Html(body) => text("text/html; charset=utf-8", &body),
            Shown::Json(body) => text("application/json", &body),
            Shown::Nothing => text("text/plain", "there is nothing here\n").with_status_code(404),
            Shown::Failed => text("text/plain", "there is nothing to be shown\n").with_status_code(500),
        }
    };
    // A browser that has gone away needs no answer.
    let _ = request.respond(response);
}

/// A value as JSON that may stand inside a script element: only `<` could end that.
pub(crate) fn inside_script(json: &str) -> String {
    json.replace('<', "\\u003c")
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

fn text(kind: &str, body: &str) -> Response<io::Cursor<Vec<u8>>> {
    let headers =
        [("Content-Type", kind), ("Cache-Control", "no-store"), ("X-Content-Type-Options", "nosniff")];
    let headers = headers.iter().filter_map(|(name, value)| Header::from_bytes(*name, *value).ok());
    headers.fold(Response::from_string(body), Response::with_header)
}
