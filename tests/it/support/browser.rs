//! A real browser: what it makes of a page, and a person's hand in it.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Command, Stdio};
use std::sync::mpsc::{Sender, channel};
use std::time::Duration;

use serde_json::Value;

use super::pass_over;

/// How long a hand may take on a busy machine.
const PATIENCE: Duration = Duration::from_secs(180);

/// A browser without a window, with a profile of its own.
fn chromium(profile: &tempfile::TempDir, (width, height): (u32, u32)) -> Command {
    let mut command = Command::new("chromium");
    command
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"])
        .args(["--disable-background-networking", "--disable-component-update", "--disable-sync"])
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(format!("--window-size={width},{height}"));
    command
}

/// What a browser makes of a page; `None` without a browser.
pub fn browse(url: &str, extra: &[&str]) -> Option<String> {
    let profile = tempfile::tempdir().unwrap();
    let mut command = chromium(&profile, (800, 640));
    match command.arg("--virtual-time-budget=4000").args(extra).arg(url).output() {
        Ok(output) if output.status.success() => {
            Some(String::from_utf8_lossy(&output.stdout).into_owned())
        }
        Ok(output) => panic!("{}", String::from_utf8_lossy(&output.stderr)),
        Err(_) => {
            pass_over("a browser (chromium)");
            None
        }
    }
}

/// A number among a page's `data-` attributes.
pub fn number(dom: &str, name: &str) -> f64 {
    let start =
        dom.find(&format!(" data-{name}=\"")).unwrap_or_else(|| panic!("no {name} in {dom}"));
    dom[start + name.len() + 8..].split('"').next().unwrap().parse().unwrap()
}

/// What a script has of a person's: it waits, points, clicks, and says at the end what it saw.
const HAND: &str = "
    const until = (holds) => new Promise((done, fail) => {
        const begun = performance.now();
        const look = () => {
            let value = null;
            try { value = holds(); } catch { /* not there yet */ }
            if (value) done(value);
            else if (performance.now() - begun < 60000) setTimeout(look, 30);
            else fail(`in vain: ${holds} ${JSON.stringify(document.querySelector('canvas')?.dataset)}`);
        };
        look();
    });
    const pointer = (kind, target, x, y) => target.dispatchEvent(new PointerEvent(kind, {
        bubbles: true, pointerId: 7, pointerType: 'mouse', clientX: x, clientY: y }));
    const click = (selector) => document.querySelector(selector).click();
    const report = (value) => fetch('/result', { method: 'POST', body: JSON.stringify(value) });";

/// Does on a page, in a window of this size, be it a phone's, what a script does, and returns what
/// it reports; `None` without a browser. The script is in the page and knows its names.
pub fn act(url: &str, window: (u32, u32), extra: &[&str], script: &str) -> Option<Value> {
    let (send, results) = channel();
    let address = with_script(url, act_of(script), window, send);
    let profile = tempfile::tempdir().unwrap();
    let mut command = chromium(&profile, (1400, 1000));
    let browser = command
        .args(extra)
        .arg(address)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    let Ok(mut browser) = browser.spawn() else {
        pass_over("a browser (chromium)");
        return None;
    };
    let result = results.recv_timeout(PATIENCE);
    browser.kill().unwrap();
    browser.wait().unwrap();
    let result = result.unwrap_or_else(|_| panic!("no report within {PATIENCE:?}: {script}"));
    let result: Value = serde_json::from_str(&result).unwrap();
    assert!(!result.is_string(), "{result}");
    Some(result)
}

/// A script with its hand; what it fails at is reported as a text.
fn act_of(script: &str) -> String {
    format!(
        "(async () => {{ {HAND} try {{ {script} }} catch (failure) {{ report(String(failure)); }} \
         }})();"
    )
}

/// An address at which the page has a script at its end, in a file as the page's policy wants it;
/// what that posts to `/result` is handed on.
///
/// A window of a browser is never as narrow as a phone, a frame in it is.
fn with_script(
    url: &str,
    script: String,
    (width, height): (u32, u32),
    results: Sender<String>,
) -> String {
    let served = url.trim_start_matches("http://");
    let (served, path) = served.split_at(served.find('/').unwrap());
    let (served, path) = (served.to_owned(), path.to_owned());
    let frame = format!(
        "HTTP/1.0 200 OK\r\nContent-Type: text/html\r\n\r\n<!DOCTYPE html>\
         <meta name=\"color-scheme\" content=\"light dark\"><body style=\"margin:0\">\
         <iframe src=\"{path}\" style=\"border:0;width:{width}px;height:{height}px\"></iframe>"
    );
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let Ok(stream) = stream else { return };
            // A browser opens connections that it may never use.
            let to = Page { served: served.clone(), path: path.clone() };
            let (script, results, frame) = (script.clone(), results.clone(), frame.clone());
            std::thread::spawn(move || pass_on(stream, &to, &script, &frame, &results));
        }
    });
    format!("http://{address}/frame")
}

/// The page that is acted on: its server and its path.
struct Page {
    served: String,
    path: String,
}

/// Passes one request on. The browser asks for no second one where it is told to close.
fn pass_on(
    mut stream: TcpStream,
    Page { served, path }: &Page,
    script: &str,
    frame: &str,
    results: &Sender<String>,
) -> Option<()> {
    stream.set_read_timeout(Some(Duration::from_secs(5))).ok()?;
    let mut request = Vec::new();
    let mut byte = [0];
    while !request.ends_with(b"\r\n\r\n") {
        if stream.read(&mut byte).ok()? == 0 {
            return None;
        }
        request.push(byte[0]);
    }
    let head = String::from_utf8_lossy(&request).into_owned();
    let value = |name: &str| {
        let line = head.lines().find(|line| line.to_lowercase().starts_with(name))?;
        Some(line[name.len()..].trim().to_owned())
    };
    let length = value("content-length:").map_or(0, |length| length.parse().unwrap());
    let mut body = vec![0; length];
    stream.read_exact(&mut body).ok()?;
    let first = head.lines().next()?;
    if first.starts_with("GET /frame ") {
        return stream.write_all(frame.as_bytes()).ok();
    }
    if first.starts_with("GET /hand.js ") {
        let head = "HTTP/1.0 200 OK\r\nContent-Type: text/javascript\r\n\r\n";
        return stream.write_all(format!("{head}{script}").as_bytes()).ok();
    }
    if first.starts_with("POST /result ") {
        let _ = results.send(String::from_utf8(body).unwrap());
        return stream.write_all(b"HTTP/1.1 204 No Content\r\nConnection: close\r\n\r\n").ok();
    }
    let own = value("x-onbrick:").map_or(String::new(), |own| format!("X-Onbrick: {own}\r\n"));
    // In the older version no answer comes in pieces.
    let older = first.replace("HTTP/1.1", "HTTP/1.0");
    let head = format!(
        "{older}\r\nHost: {served}\r\n{own}Content-Length: {length}\r\nConnection: close\r\n\r\n"
    );
    let mut to = TcpStream::connect(served).ok()?;
    to.write_all(&[head.as_bytes(), &body].concat()).ok()?;
    let mut answer = Vec::new();
    let _ = to.read_to_end(&mut answer);
    if first.starts_with(&format!("GET {} ", path.split('#').next()?)) {
        let text = String::from_utf8(answer).unwrap();
        let (head, page) = text.split_once("\r\n\r\n").unwrap();
        let policy = head.lines().find(|line| line.starts_with("Content-Security-Policy:"))?;
        let page = page.replace("</head>", "<script src=\"/hand.js\" defer></script></head>");
        answer = format!(
            "HTTP/1.1 200 OK\r\nContent-Type: text/html; charset=utf-8\r\n{policy}\r\n\
             Connection: close\r\n\r\n{page}"
        )
        .into_bytes();
    }
    stream.write_all(&answer).ok()
}
