//! A real browser in a person's hands, over its DevTools protocol: keys, sizes, dark and light,
//! pictures.
//!
//! The protocol comes over a pipe (`--remote-debugging-pipe`): JSON with a zero behind each message
//! (<https://chromedevtools.github.io/devtools-protocol/>).

use std::io::{BufRead as _, BufReader, Write as _};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tempfile::TempDir;

use super::pass_over;

/// Nothing in a browser takes this long on any machine.
const LONG: Duration = Duration::from_secs(90);

/// A page in a browser of its own.
pub struct Tab {
    browser: Child,
    to: ChildStdin,
    from: Receiver<Value>,
    session: Option<String>,
    next: u64,
    _profile: TempDir,
}

impl Tab {
    /// Opens a page in a window of this size; `None`, and said, without a browser.
    pub fn open(url: &str, size: (u32, u32)) -> Option<Self> {
        Self::open_by(&mut Command::new("sh"), url, size)
    }

    /// The same by a shell of the caller's, be it in a network of its own.
    pub fn open_by(shell: &mut Command, url: &str, size: (u32, u32)) -> Option<Self> {
        let profile = tempfile::tempdir().unwrap();
        // The shell puts the pipes where the browser expects them.
        let script = "exec chromium --headless --no-sandbox --disable-gpu --no-first-run \
                      --disable-background-networking --disable-component-update --disable-sync \
                      --disable-dev-shm-usage --remote-debugging-pipe --user-data-dir=\"$0\" \
                      3<&0 4>&1 </dev/null >/dev/null";
        if Command::new("chromium").arg("--version").output().is_err() {
            pass_over("a browser (chromium)");
            return None;
        }
        let mut browser = shell
            .args(["-c", script])
            .arg(profile.path())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let (to, out) = (browser.stdin.take().unwrap(), browser.stdout.take().unwrap());
        let (send, from) = channel();
        std::thread::spawn(move || {
            for message in BufReader::new(out).split(0).map_while(Result::ok) {
                let Ok(message) = serde_json::from_slice(&message) else { return };
                if send.send(message).is_err() {
                    return;
                }
            }
        });
        let mut tab = Self { browser, to, from, session: None, next: 0, _profile: profile };
        let target = tab.call("Target.createTarget", json!({ "url": "about:blank" }));
        let attach = json!({ "targetId": target["targetId"], "flatten": true });
        let session = tab.call("Target.attachToTarget", attach);
        tab.session = Some(session["sessionId"].as_str().unwrap().to_owned());
        tab.size(size);
        tab.call("Page.navigate", json!({ "url": url }));
        Some(tab)
    }

    #[track_caller]
    fn call(&mut self, method: &str, parameters: Value) -> Value {
        self.next += 1;
        let mut message = json!({ "id": self.next, "method": method, "params": parameters });
        if let Some(session) = &self.session {
            message["sessionId"] = json!(session);
        }
        self.to.write_all(format!("{message}\0").as_bytes()).unwrap();
        loop {
            let answer = self.from.recv_timeout(LONG).expect("the browser says nothing");
            if answer["id"] == self.next {
                assert!(answer["error"].is_null(), "{method}: {answer}");
                return answer["result"].clone();
            }
        }
    }

    /// What an expression is in the page; a promise is waited for.
    #[track_caller]
    pub fn eval(&mut self, expression: &str) -> Value {
        let parameters =
            json!({ "expression": expression, "awaitPromise": true, "returnByValue": true });
        let result = self.call("Runtime.evaluate", parameters);
        assert!(result["exceptionDetails"].is_null(), "{expression}: {result}");
        result["result"]["value"].clone()
    }

    /// Waits until an expression is true in the page, or something; what it is then.
    #[track_caller]
    pub fn until(&mut self, expression: &str) -> Value {
        let begun = Instant::now();
        let guarded = format!("(() => {{ try {{ return {expression} }} catch {{ }} }})()");
        loop {
            let value = self.eval(&guarded);
            if !matches!(&value, Value::Null | Value::Bool(false)) && value != json!("") {
                return value;
            }
            if begun.elapsed() > LONG {
                panic!("in vain: {expression}\n{}", self.eval("document.body.innerText"));
            }
            std::thread::sleep(Duration::from_millis(40));
        }
    }

    /// Clicks on the button, the link or the label with this text, with the pointer; within the
    /// element that a selector names.
    #[track_caller]
    pub fn click(&mut self, within: &str, text: &str) {
        let (within, text) = (json!(within), json!(text));
        let place = self.until(&format!(
            "(() => {{ const found = [...document.querySelector({within})\
             .querySelectorAll('button, a, label, summary')]\
             .find((one) => one.textContent.trim().startsWith({text})); \
             found.scrollIntoView({{ block: 'center', behavior: 'instant' }}); \
             const box = found.getBoundingClientRect(); \
             return [box.x + box.width / 2, box.y + box.height / 2]; }})()"
        ));
        for kind in ["mousePressed", "mouseReleased"] {
            let event = json!({
                "type": kind, "x": place[0], "y": place[1], "button": "left", "clickCount": 1,
            });
            self.call("Input.dispatchMouseEvent", event);
        }
    }

    /// Presses a key, by its name in the browser.
    pub fn key(&mut self, key: &str) {
        let (code, text) = match key {
            "Enter" => (13, Some("\r")),
            "Tab" => (9, None),
            "Escape" => (27, None),
            " " => (32, Some(" ")),
            other => panic!("{other}"),
        };
        let mut event = json!({
            "type": "keyDown", "key": key, "windowsVirtualKeyCode": code,
            "code": if key == " " { "Space" } else { key },
        });
        if let Some(text) = text {
            event["text"] = json!(text);
        }
        self.call("Input.dispatchKeyEvent", event.clone());
        event["type"] = json!("keyUp");
        self.call("Input.dispatchKeyEvent", event);
    }

    /// Types a text.
    pub fn text(&mut self, text: &str) {
        self.call("Input.insertText", json!({ "text": text }));
    }

    /// Goes by Tab, with the keyboard alone, to the element whose text or label begins with this
    /// one.
    #[track_caller]
    pub fn tab_to(&mut self, text: &str) {
        for _ in 0..200 {
            self.key("Tab");
            let at = self.eval(
                "(document.activeElement.getAttribute('aria-label') \
                 ?? document.activeElement.textContent).trim()",
            );
            if at.as_str().unwrap().starts_with(text) {
                return;
            }
        }
        panic!("no way to {text} with Tab");
    }

    /// The window's size.
    pub fn size(&mut self, (width, height): (u32, u32)) {
        let size = json!({
            "width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600,
        });
        self.call("Emulation.setDeviceMetricsOverride", size);
    }

    /// What the system's setting for dark pages is.
    pub fn scheme(&mut self, scheme: &str) {
        let features = json!([{ "name": "prefers-color-scheme", "value": scheme }]);
        self.call("Emulation.setEmulatedMedia", json!({ "features": features }));
    }

    /// Keeps a picture to be looked at, if `ONBRICK_PICTURES` names a folder.
    pub fn picture(&mut self, name: &str) {
        let Some(folder) = std::env::var_os("ONBRICK_PICTURES") else { return };
        let shot = self.call("Page.captureScreenshot", json!({ "format": "png" }));
        let bytes = decoded(shot["data"].as_str().unwrap());
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(Path::new(&folder).join(format!("{name}.png")), bytes).unwrap();
    }
}

impl Drop for Tab {
    fn drop(&mut self) {
        let _ = self.browser.kill();
        let _ = self.browser.wait();
    }
}

/// Base 64.
fn decoded(text: &str) -> Vec<u8> {
    let digit = |sign: u8| match sign {
        b'A'..=b'Z' => u32::from(sign - b'A'),
        b'a'..=b'z' => u32::from(sign - b'a') + 26,
        b'0'..=b'9' => u32::from(sign - b'0') + 52,
        b'+' => 62,
        _ => 63,
    };
    let plain = text.trim_end_matches('=').as_bytes();
    plain
        .chunks(4)
        .flat_map(|part| {
            let number = part.iter().fold(0, |number, sign| number << 6 | digit(*sign));
            let bytes = (number << (6 * (4 - part.len()))).to_be_bytes();
            bytes[1..part.len()].to_vec()
        })
        .collect()
}
