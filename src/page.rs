//! A page for a browser on this machine: a small server on 127.0.0.1 that shows, and takes what its
//! own page posts where the server wants that.
//!
//! # Not here
//!
//! What is shown, and what is done with what is posted (`report::live`, `cli`).
//!
//! # What we count on
//!
//! A request for another host name than this machine's is refused, so that a foreign page in the
//! same browser cannot ask. A POST must carry a header of ours (`OWN`), which a foreign page may
//! not send without a preflight request, and that is refused; and where the browser says which page
//! it comes from (`Origin`), that is this one. What a page loads, frames and asks is the server's
//! own (`POLICY`), and no script stands in the page itself.
//!
//! Every user that may open a port of this machine may look, unless the page has a token: then all
//! of its addresses begin with that, and there is nothing at any other.

use std::borrow::Cow;
use std::io::{self, Write as _};
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::thread::JoinHandle;

use tiny_http::{Method, Request, Server};

use crate::threads::spawn;

/// The page cannot be shown.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
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

/// What a text of a page is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Html,
    Style,
    Script,
    Json,
    Svg,
}

impl Kind {
    /// As the browser is told.
    fn media_type(self) -> &'static str {
        match self {
            Self::Html => "text/html; charset=utf-8",
            Self::Style => "text/css; charset=utf-8",
            Self::Script => "text/javascript; charset=utf-8",
            Self::Json => "application/json",
            Self::Svg => "image/svg+xml",
        }
    }
}

/// What is shown at one address of the page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Shown {
    /// The page itself, its parts, or what it asks for.
    Text(Kind, Cow<'static, str>),
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

impl Shown {
    /// A part that is in the program.
    pub(crate) fn part(parts: &[(&str, Kind, &'static str)], path: &str) -> Self {
        let part = parts.iter().find(|(place, ..)| *place == path);
        part.map_or(Self::Nothing, |(_, kind, text)| Self::Text(*kind, Cow::Borrowed(text)))
    }

    /// What the page asks for.
    pub(crate) fn json(json: String) -> Self {
        Self::Text(Kind::Json, Cow::Owned(json))
    }
}

/// What a browser asks of a page.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Asked<'a> {
    /// Behind the token, such as `/state`.
    pub(crate) path: &'a str,
    /// What stands behind the `?`.
    pub(crate) query: &'a str,
    /// What it posts, where it does.
    pub(crate) posted: Option<&'a str>,
}

/// Where a page is served.
#[derive(Debug, Clone, Default)]
pub(crate) struct Place {
    /// A port of 127.0.0.1, 0 for any that is free.
    pub(crate) port: u16,
    /// What all addresses of the page begin with: letters and digits that cannot be guessed.
    pub(crate) token: Option<String>,
    /// No post is longer, bytes.
    pub(crate) most_posted: u64,
}

/// The header that the page's own script sends with what it posts.
const OWN: &str = "X-Onbrick";

/// What a page may load, frame and ask: what comes from its own server, and pictures that it has
/// made itself. No script and no style sheet stands in the page.
const POLICY: &str = "default-src 'none'; style-src 'self'; script-src 'self'; connect-src 'self'; \
     img-src 'self' data:; frame-src 'self'; frame-ancestors 'self'; base-uri 'none'; \
     form-action 'none'";

/// A page that is being served. Dropping it ends that.
pub struct LocalPage {
    port: u16,
    url: String,
    server: Arc<Server>,
    threads: Vec<JoinHandle<()>>,
}

crate::printable::debug_by!(LocalPage, url);

/// As many requests are answered at a time, so that one that takes its time, such as a picture,
/// holds up no other.
const THREADS: usize = 3;

impl LocalPage {
    /// Serves what `answer` has for each request.
    ///
    /// # Errors
    ///
    /// [`PageError`]; nothing is served then.
    pub(crate) fn serve(
        place: &Place,
        answer: impl Fn(Asked<'_>) -> Shown + Send + Sync + 'static,
    ) -> Result<Self, PageError> {
        let Place { port, most_posted, .. } = *place;
        let failed = |message: String| PageError::Bind { port, message };
        let server =
            Server::http((Ipv4Addr::LOCALHOST, port)).map_err(|error| failed(error.to_string()))?;
        let address = server
            .server_addr()
            .to_ip()
            .ok_or_else(|| failed("no address was given".to_owned()))?;
        let server = Arc::new(server);
        let below = place.token.as_ref().map_or_else(String::new, |token| format!("/{token}"));
        let url = format!("http://{address}{below}/");
        let mut page =
            Self { port: address.port(), url, server: Arc::clone(&server), threads: Vec::new() };
        let answer = Arc::new(answer);
        for _ in 0..THREADS {
            let (served, answer, below) = (Arc::clone(&server), Arc::clone(&answer), below.clone());
            let serve = move || {
                for mut request in served.incoming_requests() {
                    let shown = shown(&mut request, address, &below, most_posted, &*answer);
                    // A browser that has gone away needs no answer.
                    let _ = respond(request, shown);
                }
            };
            let thread = spawn("page", serve)?;
            page.threads.push(thread);
        }
        Ok(page)
    }

    /// The port of 127.0.0.1 that it has.
    #[must_use]
    pub(crate) fn port(&self) -> u16 {
        self.port
    }

    /// Where the page is.
    #[must_use]
    pub fn url(&self) -> &str {
        &self.url
    }
}

impl Drop for LocalPage {
    fn drop(&mut self) {
        // One wakes one.
        self.threads.iter().for_each(|_| self.server.unblock());
        for thread in self.threads.drain(..) {
            // A panic of the server has been reported already.
            let _ = thread.join();
        }
    }
}

/// What is shown to a request; none where it is no business of this page.
fn shown(
    request: &mut Request,
    address: SocketAddr,
    below: &str,
    most_posted: u64,
    answer: &impl Fn(Asked<'_>) -> Shown,
) -> Option<Shown> {
    if !is_ours(request, address) {
        return None;
    }
    let url = request.url().to_owned();
    let (path, query) = url.split_once('?').unwrap_or((&url, ""));
    let Some(path) = path.strip_prefix(below) else { return Some(Shown::Nothing) };
    if !path.starts_with('/') {
        return Some(Shown::Nothing);
    }
    let is_own = request.headers().iter().any(|header| header.field.equiv(OWN));
    let posted = match request.method() {
        Method::Get => None,
        Method::Post if is_own => match posted(request, most_posted) {
            Some(text) => Some(text),
            None => return Some(Shown::Failed),
        },
        _ => return Some(Shown::Fixed),
    };
    Some(answer(Asked { path, query, posted: posted.as_deref() }))
}

/// Answers, and has the browser close the connection: the server keeps a thread for each that is
/// open, and when several come at once, its pool (of 0.12) lets some wait until one of these is
/// closed.
fn respond(request: Request, shown: Option<Shown>) -> io::Result<()> {
    const PLAIN: &str = "text/plain; charset=utf-8";
    let plain = |status: &'static str, text: &str| (status, PLAIN, text.as_bytes().to_vec().into());
    let (status, kind, body): (&str, &str, Cow<'_, [u8]>) = match &shown {
        None => plain("403 Forbidden", "this page is for its own machine\n"),
        Some(Shown::Text(kind, text)) => ("200 OK", kind.media_type(), text.as_bytes().into()),
        Some(Shown::Png(bytes)) => ("200 OK", "image/png", bytes.into()),
        Some(Shown::Nothing) => plain("404 Not Found", "there is nothing here\n"),
        Some(Shown::Failed) => plain("500 Internal Server Error", "there is nothing to be shown\n"),
        Some(Shown::Fixed) => plain("405 Method Not Allowed", "nothing can be changed here\n"),
        Some(Shown::Done) => plain("200 OK", "done\n"),
        Some(Shown::Refused(why)) => plain("400 Bad Request", &format!("{why}\n")),
    };
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nConnection: close\r\n\
         Cache-Control: no-store\r\nContent-Security-Policy: {POLICY}\r\n\
         Referrer-Policy: no-referrer\r\nX-Content-Type-Options: nosniff\r\n\r\n",
        body.len()
    );
    let mut writer = request.into_writer();
    writer.write_all(&[head.as_bytes(), &body].concat())?;
    writer.flush()
}

/// The text that was posted; none where it is too long, or no text.
fn posted(request: &mut Request, most: u64) -> Option<String> {
    let mut body = String::new();
    let mut some = io::Read::take(request.as_reader(), most + 1);
    io::Read::read_to_string(&mut some, &mut body).ok()?;
    Some(body).filter(|body| u64::try_from(body.len()).is_ok_and(|length| length <= most))
}

/// A value as JSON that may stand inside a script element: only `<` could end that.
pub(crate) fn inside_script(json: &str) -> String {
    json.replace('<', "\\u003c")
}

/// True where the browser thinks that it talks to this machine, and says of no other page that it
/// asks.
fn is_ours(request: &Request, address: SocketAddr) -> bool {
    let header = |name: &'static str| {
        let found = request.headers().iter().find(|header| header.field.equiv(name));
        found.map(|header| header.value.as_str())
    };
    let is_ours = |host: &str| {
        let name = host.rsplit_once(':').map_or(host, |(name, _)| name);
        matches!(name, "127.0.0.1" | "localhost")
    };
    let is_this = |origin: &str| {
        let port = address.port();
        ["127.0.0.1", "localhost"].iter().any(|name| origin == format!("http://{name}:{port}"))
    };
    header("Host").is_some_and(is_ours) && header("Origin").is_none_or(is_this)
}
