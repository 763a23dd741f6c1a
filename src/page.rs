//! A page for a browser on this machine: a small server on 127.0.0.1 that shows, and takes what its
//! own page posts where the server wants that.
//!
//! # Not here
//!
//! What is shown, and what is done with what is posted (`report::live`).
//!
//! # What we count on
//!
//! Every user that may open a port of this machine may look. A request for another host name than
//! this machine's is refused, so that a foreign page in the same browser cannot ask. A POST must
//! carry a header of ours (`OWN`), which a foreign page may not send without a preflight request,
//! and that is refused.

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
    /// A picture in it.
    Png(Vec<u8>),
    /// There is no such address.
    Nothing,
    /// It cannot be understood.
    Failed,
    /// Nothing can be changed there.
    Fixed,
    /// What was posted was done.
    Done,
    /// What was posted was not done, and why.
    Refused(String),
}

/// The header that the page's own script sends with what it posts.
const OWN: &str = "X-Onbrick";

/// No post is longer, bytes.
const MOST_POSTED: u64 = 4096;

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
    /// Serves at a port of 127.0.0.1, 0 for any that is free. `show` is given path and query;
    /// `take` is given path and text of what the page posts.
    ///
    /// # Errors
    ///
    /// [`PageError`]; nothing is served then.
    pub(crate) fn serve(
        port: u16,
        show: impl Fn(&str, &str) -> Shown + Send + 'static,
        take: impl Fn(&str, &str) -> Shown + Send + 'static,
    ) -> Result<Self, PageError> {
        let failed = |message: String| PageError::Bind { port, message };
        let server =
            Server::http((Ipv4Addr::LOCALHOST, port)).map_err(|error| failed(error.to_string()))?;
        let address = server
            .server_addr()
            .to_ip()
            .ok_or_else(|| failed("no address was given".to_owned()))?;
        let server = Arc::new(Unshown(server));
        let served = Arc::clone(&server);
        let serve = move || {
            for request in served.0.incoming_requests() {
                answer(request, &show, &take);
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
            // A panic of the server has been reported already.
            let _ = thread.join();
        }
    }
}

fn answer(
    mut request: Request,
    show: &impl Fn(&str, &str) -> Shown,
    take: &impl Fn(&str, &str) -> Shown,
) {
    let url = request.url().to_owned();
    let (path, query) = url.split_once('?').unwrap_or((&url, ""));
    let is_own = request.headers().iter().any(|header| header.field.equiv(OWN));
    let shown = match request.method() {
        _ if !is_ours(&request) => None,
        Method::Get => Some(show(path, query)),
        Method::Post if is_own => {
            Some(posted(&mut request).map_or(Shown::Failed, |text| take(path, &text)))
        }
        _ => Some(Shown::Fixed),
    };
    let plain = |body: &str, status: u16| text("text/plain", body).with_status_code(status);
    let response = match shown {
        None => plain("this page is for its own machine\n", 403),
        Some(Shown::Html(body)) => text("text/html; charset=utf-8", &body),
        Some(Shown::Json(body)) => text("application/json", &body),
        Some(Shown::Png(bytes)) => typed("image/png", Response::from_data(bytes)),
        Some(Shown::Nothing) => plain("there is nothing here\n", 404),
        Some(Shown::Failed) => plain("there is nothing to be shown\n", 500),
        Some(Shown::Fixed) => plain("nothing can be changed here\n", 405),
        Some(Shown::Done) => plain("done\n", 200),
        Some(Shown::Refused(why)) => plain(&format!("{why}\n"), 400),
    };
    // A browser that has gone away needs no answer.
    let _ = request.respond(response);
}

/// The text that was posted; none where it is too long, or no text.
fn posted(request: &mut Request) -> Option<String> {
    let mut body = String::new();
    let mut most = io::Read::take(request.as_reader(), MOST_POSTED + 1);
    io::Read::read_to_string(&mut most, &mut body).ok()?;
    Some(body).filter(|body| u64::try_from(body.len()).is_ok_and(|length| length <= MOST_POSTED))
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
    typed(kind, Response::from_string(body))
}

fn typed(kind: &str, response: Response<io::Cursor<Vec<u8>>>) -> Response<io::Cursor<Vec<u8>>> {
    let headers = [
        ("Content-Type", kind),
        ("Cache-Control", "no-store"),
        ("X-Content-Type-Options", "nosniff"),
    ];
    let headers = headers.iter().filter_map(|(name, value)| Header::from_bytes(*name, *value).ok());
    headers.fold(response, Response::with_header)
}
