//! A page in headless Chromium, driven by the DevTools protocol over a pipe: JSON that ends with a NUL.

#![allow(clippy::unwrap_used, reason = "a helper fails as its test does")]

use crate::chromium;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

/// How long an answer may take.
const PATIENCE: Duration = Duration::from_secs(60);

/// A browser with one page.
pub(crate) struct Browser {
    child: Child,
    input: ChildStdin,
    messages: Receiver<Value>,
    session: Option<String>,
    calls: u64,
    /// Errors on the page's console, exceptions and failed loads since the last page was opened.
    pub(crate) complaints: Vec<String>,
}

impl Browser {
    /// Starts Chromium (or what `CHROMIUM` names) with its profile in `folder`; says why where it can't.
    pub(crate) fn start(folder: &Path) -> Result<Self, String> {
        let name = chromium::program();
        Command::new(&name)
            .arg("--version")
            .output()
            .map_err(|error| format!("{} can't be run: {error}", name.to_string_lossy()))?;
        // The protocol is spoken over descriptors 3 and 4, which a shell makes of the first two.
        let mut child = Command::new("sh")
            .args(["-c", r#"exec "$0" "$@" 3<&0 4>&1 </dev/null >/dev/null 2>&1"#])
            .arg(&name)
            .args(["--headless=new", "--no-sandbox", "--remote-debugging-pipe"])
            .args(["--use-angle=swiftshader", "--enable-unsafe-swiftshader"])
            .arg(format!("--user-data-dir={}", folder.join("profile").display()))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|error| format!("sh can't be run: {error}"))?;
        let (input, output) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
        let (sender, messages) = channel();
        std::thread::spawn(move || {
            for message in BufReader::new(output).split(0) {
                let Ok(message) = message else { return };
                if sender.send(serde_json::from_slice(&message).unwrap()).is_err() {
                    return;
                }
            }
        });
        let mut browser = Self { child, input, messages, session: None, calls: 0, complaints: Vec::new() };
        let target = browser.call("Target.createTarget", &json!({ "url": "about:blank" }));
        let target = json!({ "targetId": target["targetId"], "flatten": true });
        let session = browser.call("Target.attachToTarget", &target);
        browser.session = session["sessionId"].as_str().map(str::to_owned);
        for domain in ["Page.enable", "Runtime.enable", "Log.enable"] {
            browser.call(domain, &json!({}));
        }
        Ok(browser)
    }

    /// Calls a method of the protocol.
    #[track_caller]
    pub(crate) fn call(&mut self, method: &str, parameters: &Value) -> Value {
        self.calls += 1;
        let id = self.calls;
        let mut message = json!({ "id": id, "method": method, "params": parameters });
        if let Some(session) = &self.session {
            message["sessionId"] = json!(session);
        }
        let mut bytes = message.to_string().into_bytes();
        bytes.push(0);
        self.input.write_all(&bytes).unwrap();
        loop {
            let message = self.messages.recv_timeout(PATIENCE).unwrap_or_else(|e| panic!("{method}: {e}"));
            if message["id"] == id {
                assert!(message["error"].is_null(), "{method}: {message}");
                return message["result"].clone();
            }
            self.note(&message);
        }
    }

    fn note(&mut self, message: &Value) {
        let complains = match message["method"].as_str() {
            Some("Runtime.exceptionThrown") => true,
            Some("Runtime.consoleAPICalled") => message["params"]["type"] == "error",
            Some("Log.entryAdded") => message["params"]["entry"]["level"] == "error",
            _ => false,
        };
        if complains {
            self.complaints.push(message["params"].to_string());
        }
    }

    /// The value of an expression on the page; promises are waited for.
    #[track_caller]
    pub(crate) fn value(&mut self, expression: &str) -> Value {
        let parameters = json!({ "expression": expression, "returnByValue": true, "awaitPromise": true });
        let result = self.call("Runtime.evaluate", &parameters);
        assert!(result["exceptionDetails"].is_null(), "{expression}: {result}");
        result["result"]["value"].clone()
    }

    /// Opens a report from its file and waits until it says that it is ready.
    #[track_caller]
    pub(crate) fn open(&mut self, page: &Path, query: &str) {
        self.complaints.clear();
        let address = format!("file://{}{query}", page.display());
        self.call("Page.navigate", &json!({ "url": address }));
        let address = json!(address);
        let ready =
            format!("document.documentElement?.dataset.ready === 'true' && location.href === {address}");
        let start = Instant::now();
        while self.value(&ready) != true {
            let verdict = "document.getElementById('verdict')?.textContent";
            assert!(start.elapsed() < PATIENCE, "{} {:?}", self.value(verdict), self.complaints);
            std::thread::sleep(Duration::from_millis(50));
        }
        self.settle();
    }

    /// Waits until what was asked for is drawn.
    #[track_caller]
    pub(crate) fn settle(&mut self) {
        self.value(
            "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(true))))",
        );
    }

    /// A view of `width` x `height` pixels.
    pub(crate) fn resize(&mut self, width: usize, height: usize) {
        let view = json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500 });
        self.call("Emulation.setDeviceMetricsOverride", &view);
        self.settle();
    }

    /// Where a place of the element `id`, 0 to 1 from its left and top, is in the view, once it is scrolled there.
    #[track_caller]
    pub(crate) fn place(&mut self, id: &str, at: [f64; 2]) -> [f64; 2] {
        let script = format!(
            "(() => {{ const e = document.getElementById('{id}'); e.scrollIntoView({{ block: 'center' }});
            const box = e.getBoundingClientRect(); return [box.left, box.top, box.width, box.height]; }})()"
        );
        let found = self.value(&script);
        let of = |i: usize| found[i].as_f64().unwrap();
        [of(0) + at[0] * of(2), of(1) + at[1] * of(3)]
    }

    /// Presses the mouse at the first place of the element `id`, moves over the others and lets go at the last.
    #[track_caller]
    pub(crate) fn drag(&mut self, id: &str, path: &[[f64; 2]]) {
        let places: Vec<[f64; 2]> = path.iter().map(|at| self.place(id, *at)).collect();
        self.mouse("mousePressed", places[0], 1);
        for place in &places[1..] {
            self.mouse("mouseMoved", *place, 1);
        }
        self.mouse("mouseReleased", places[places.len() - 1], 1);
        self.settle();
    }

    #[track_caller]
    fn mouse(&mut self, kind: &str, [x, y]: [f64; 2], clicks: usize) {
        let held = if kind == "mouseReleased" { 0 } else { 1 };
        let event =
            json!({ "type": kind, "x": x, "y": y, "button": "left", "buttons": held, "clickCount": clicks });
        self.call("Input.dispatchMouseEvent", &event);
    }

    /// Clicks `clicks` times at a place of the element `id`.
    #[track_caller]
    pub(crate) fn click(&mut self, id: &str, at: [f64; 2], clicks: usize) {
        let place = self.place(id, at);
        for click in 1..=clicks {
            self.mouse("mousePressed", place, click);
            self.mouse("mouseReleased", place, click);
        }
        self.settle();
    }

    /// Presses a key on what has the focus.
    #[track_caller]
    pub(crate) fn key(&mut self, key: &str) {
        for kind in ["keyDown", "keyUp"] {
            self.call("Input.dispatchKeyEvent", &json!({ "type": kind, "key": key, "code": key }));
        }
        self.settle();
    }

    /// R, G, B of all pixels of the canvas or picture `id`, rows from the top.
    #[track_caller]
    pub(crate) fn codes(&mut self, id: &str) -> Vec<u8> {
        let script = format!(
            "(() => {{ const e = document.getElementById('{id}'); const c = document.createElement('canvas');
            c.width = e.naturalWidth ?? e.width; c.height = e.naturalHeight ?? e.height;
            const x = c.getContext('2d'); x.drawImage(e, 0, 0);
            return Array.from(x.getImageData(0, 0, c.width, c.height).data).filter((_, i) => i % 4 < 3).join(' '); }})()"
        );
        let text = self.value(&script);
        text.as_str().unwrap().split(' ').map(|code| code.parse().unwrap()).collect()
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
