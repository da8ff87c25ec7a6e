//! A real browser, told what to do over WebDriver: Chromium with its own driver, both as Debian has them. What is asked
//! of it are a handful of requests, some of them Chromium's own, so they are made here.

use super::mosquitto::free_port;
use super::rig::Place;
use super::started::{PATIENCE, Started, until};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::process::Command;
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::Duration;

/// The key under which WebDriver names an element.
const ELEMENT: &str = "element-6066-11e4-a52e-4f735466cecf";
/// Longer than a control has to be held.
const HELD_MS: u64 = 900;
/// How far apart the largest and the smallest part of a saturated colour are, of 255.
const SATURATED_MIN: u8 = 64;
/// A browser starts on a machine that is busy with other tests.
const START_MAX: Duration = Duration::from_secs(60);

/// A browser with one window. It ends with its driver when this is dropped.
pub struct Browser {
    session: String,
    driver: SocketAddr,
    _process: Started,
    _place: Place,
    _turn: BrowserTurn,
}

/// The right to run one of the few browsers that this machine has room for.
struct BrowserTurn;

/// How many browsers run, and that one has ended.
static RUNNING: (Mutex<usize>, Condvar) = (Mutex::new(0), Condvar::new());

impl BrowserTurn {
    /// Waits until fewer browsers run than there are processors: each computes on one while it draws.
    fn wait() -> Self {
        let most = std::thread::available_parallelism().map_or(1, usize::from);
        let (running, ended) = &RUNNING;
        let running = running.lock().unwrap_or_else(PoisonError::into_inner);
        let mut running = ended
            .wait_while(running, |running| *running >= most)
            .unwrap_or_else(PoisonError::into_inner);
        *running += 1;
        Self
    }
}

impl Drop for BrowserTurn {
    fn drop(&mut self) {
        let (running, ended) = &RUNNING;
        *running.lock().unwrap_or_else(PoisonError::into_inner) -= 1;
        ended.notify_one();
    }
}

/// How the window is.
#[derive(Clone, Copy)]
pub struct Window {
    pub width: u32,
    pub height: u32,
    pub is_dark: bool,
}

impl Window {
    pub const DESKTOP: Self = Self {
        width: 1280,
        height: 900,
        is_dark: false,
    };
    pub const PHONE: Self = Self {
        width: 390,
        height: 844,
        is_dark: false,
    };
    /// The narrowest that has to do.
    pub const NARROW: Self = Self {
        width: 360,
        height: 740,
        is_dark: false,
    };

    pub fn dark(self) -> Self {
        Self {
            is_dark: true,
            ..self
        }
    }
}

impl Browser {
    /// Starts it with a profile of its own, which reaches nothing but this machine.
    pub fn start() -> Self {
        let turn = BrowserTurn::wait();
        let place = Place::new();
        // It wants one port of IPv6 and IPv4; what it takes for itself it takes of IPv6, where IPv4 may have it in use.
        let driver = SocketAddr::from((Ipv4Addr::LOCALHOST, free_port()));
        let mut command = Command::new("chromedriver");
        command.arg(format!("--port={}", driver.port()));
        let process = Started::new(command);
        process.wait_for("that it listens", |line| {
            line.contains("started successfully").then_some(())
        });
        let profile = format!("--user-data-dir={}", place.file("profile").display());
        let arguments = [
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-quic",
            "--disable-dev-shm-usage",
            "--no-first-run",
            "--disable-background-networking",
            "--disable-component-update",
            "--disable-sync",
            // The same letters on every screen, and smaller pictures.
            "--disable-lcd-text",
            "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
            &profile,
        ];
        let wanted = json!({
            "browserName": "chrome",
            "goog:chromeOptions": { "args": arguments },
            "goog:loggingPrefs": { "browser": "ALL", "performance": "ALL" },
        });
        let answer = ask(
            driver,
            "POST",
            "/session",
            &json!({ "capabilities": { "alwaysMatch": wanted } }),
            START_MAX,
        );
        let session = answer["sessionId"]
            .as_str()
            .unwrap_or_else(|| panic!("no session: {answer}"))
            .to_owned();
        Self {
            session,
            driver,
            _process: process,
            _place: place,
            _turn: turn,
        }
    }

    /// Opens a page.
    pub fn open(&self, url: &str) {
        self.post("/url", &json!({ "url": url }));
    }

    /// Loads the page anew.
    pub fn reload(&self) {
        self.post("/refresh", &json!({}));
    }

    /// Loads the page anew, with nothing kept of what was loaded before.
    pub fn reload_past_the_cache(&self) {
        self.chromium(
            "Network.setCacheDisabled",
            &json!({ "cacheDisabled": true }),
        );
        self.reload();
    }

    /// What a function with this body returns in the page.
    pub fn script(&self, body: &str) -> Value {
        self.post("/execute/sync", &json!({ "script": body, "args": [] }))
    }

    /// Waits until this expression holds in the page.
    pub fn wait(&self, expression: &str) {
        until(expression, PATIENCE, || {
            (self.script(&format!("return Boolean({expression})")) == true).then_some(())
        });
    }

    /// The text that is seen of an element.
    pub fn text(&self, css: &str) -> String {
        let text = self.get(&format!("/element/{}/text", self.element(css)));
        text.as_str().unwrap().to_owned()
    }

    /// Waits until a part of what is seen of an element is this.
    pub fn wait_for_text(&self, css: &str, part: &str) {
        until(&format!("{part} in {css}"), PATIENCE, || {
            self.text(css).contains(part).then_some(())
        });
    }

    /// Whether somebody who looks at the page sees the element.
    pub fn is_seen(&self, css: &str) -> bool {
        self.get(&format!("/element/{}/displayed", self.element(css))) == true
    }

    /// Clicks an element as a mouse does: what lies above it gets the click.
    pub fn click(&self, css: &str) {
        self.post(&format!("/element/{}/click", self.element(css)), &json!({}));
    }

    /// Types into an element in place of what stands there.
    pub fn fill(&self, css: &str, text: &str) {
        let element = self.element(css);
        self.post(&format!("/element/{element}/clear"), &json!({}));
        self.post(
            &format!("/element/{element}/value"),
            &json!({ "text": text }),
        );
    }

    /// Holds the mouse down on an element.
    pub fn hold(&self, css: &str) {
        let origin = json!({ ELEMENT: self.element(css) });
        // Only what is in the window can be pointed at.
        self.script(&format!(
            "document.querySelector({css:?}).scrollIntoView({{ block: 'center' }})"
        ));
        let moves = json!([
            { "type": "pointerMove", "duration": 0, "origin": origin, "x": 0, "y": 0 },
            { "type": "pointerDown", "button": 0 },
            { "type": "pause", "duration": HELD_MS },
            { "type": "pointerUp", "button": 0 },
        ]);
        self.post(
            "/actions",
            &json!({ "actions": [{ "type": "pointer", "id": "mouse", "actions": moves }] }),
        );
    }

    /// Holds a key down, or presses it if `held_ms` is 0.
    pub fn key(&self, key: &str, held_ms: u64) {
        let moves = json!([
            { "type": "keyDown", "value": key },
            { "type": "pause", "duration": held_ms },
            { "type": "keyUp", "value": key },
        ]);
        self.post(
            "/actions",
            &json!({ "actions": [{ "type": "key", "id": "keys", "actions": moves }] }),
        );
    }

    /// Gives the window another size and scheme of colours.
    pub fn resize(
        &self,
        Window {
            width,
            height,
            is_dark,
        }: Window,
    ) {
        let size = json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500 });
        self.chromium("Emulation.setDeviceMetricsOverride", &size);
        let scheme = if is_dark { "dark" } else { "light" };
        let features = json!([{ "name": "prefers-color-scheme", "value": scheme }]);
        self.chromium(
            "Emulation.setEmulatedMedia",
            &json!({ "features": features }),
        );
    }

    /// As a person with a touch pad or a phone sees it, until the window is another one.
    pub fn hide_scroll_bars(&self) {
        self.chromium("Emulation.setScrollbarsHidden", &json!({ "hidden": true }));
    }

    /// A picture of what is in the window, as PNG.
    pub fn picture(&self) -> Vec<u8> {
        unpacked(self.get("/screenshot").as_str().unwrap())
    }

    /// The shares of the window whose pixels are saturated: of all of it, and of what is not inside this element.
    pub fn saturated(&self, css: &str) -> (f64, f64) {
        let picture = self.get("/screenshot");
        let shares = self.script(&format!(
            "const bytes = Uint8Array.from(atob({picture}), (it) => it.charCodeAt(0)); \
             const {{ left, right, top, bottom }} = document.querySelector({css:?}).getBoundingClientRect(); \
             return createImageBitmap(new Blob([bytes])).then((image) => {{ \
             const {{ width, height }} = image; const context = new OffscreenCanvas(width, height).getContext('2d'); \
             context.drawImage(image, 0, 0); const {{ data }} = context.getImageData(0, 0, width, height); \
             let [all, outside] = [0, 0]; \
             for (let at = 0; at < width * height; at += 1) {{ const rgb = data.slice(at * 4, at * 4 + 3); \
             if (Math.max(...rgb) - Math.min(...rgb) < {SATURATED_MIN}) continue; all += 1; \
             const [x, y] = [at % width, Math.floor(at / width)]; \
             if (x < Math.floor(left) || x >= Math.ceil(right) || y < Math.floor(top) || y >= Math.ceil(bottom)) outside += 1; }} \
             return [all / width / height, outside / width / height]; }})"
        ));
        (shares[0].as_f64().unwrap(), shares[1].as_f64().unwrap())
    }

    /// What the page and the browser have complained of since this was last asked.
    pub fn complaints(&self) -> Vec<String> {
        let log = self.post("/se/log", &json!({ "type": "browser" }));
        let entries = log.as_array().unwrap().iter();
        let is_bad = |entry: &&Value| entry["level"] == "SEVERE" || entry["level"] == "WARNING";
        entries
            .filter(is_bad)
            .map(|entry| entry["message"].to_string())
            .collect()
    }

    /// The hosts, with their ports, that the page has asked for anything since this was last asked.
    pub fn hosts(&self) -> BTreeSet<String> {
        let log = self.post("/se/log", &json!({ "type": "performance" }));
        let message =
            |entry: &Value| serde_json::from_str::<Value>(entry["message"].as_str()?).ok();
        let messages = log.as_array().unwrap().iter().filter_map(message);
        let urls = messages.filter_map(|it| {
            Some(
                it["message"]["params"]["request"]["url"]
                    .as_str()?
                    .to_owned(),
            )
        });
        // Its own icons and pages come from no host: which they are differs between versions.
        let own = |url: &String| {
            ["data:", "chrome:", "chrome-untrusted:"]
                .iter()
                .any(|scheme| url.starts_with(scheme))
        };
        urls.filter(|url| !own(url))
            .map(|url| host(&url).to_owned())
            .collect()
    }

    fn element(&self, css: &str) -> String {
        let found = self.post(
            "/element",
            &json!({ "using": "css selector", "value": css }),
        );
        found[ELEMENT].as_str().unwrap().to_owned()
    }

    /// One of the browser's own measurements of the page.
    pub fn metric(&self, name: &str) -> f64 {
        self.chromium("Performance.enable", &json!({}));
        let metrics = self.post(
            "/goog/cdp/execute",
            &json!({ "cmd": "Performance.getMetrics", "params": {} }),
        );
        let found = metrics["metrics"]
            .as_array()
            .unwrap()
            .iter()
            .find(|it| it["name"] == name);
        found.unwrap_or_else(|| panic!("no {name}: {metrics}"))["value"]
            .as_f64()
            .unwrap()
    }

    fn chromium(&self, command: &str, parameters: &Value) {
        self.post(
            "/goog/cdp/execute",
            &json!({ "cmd": command, "params": parameters }),
        );
    }

    fn get(&self, path: &str) -> Value {
        ask(
            self.driver,
            "GET",
            &format!("/session/{}{path}", self.session),
            &Value::Null,
            PATIENCE,
        )
    }

    fn post(&self, path: &str, body: &Value) -> Value {
        ask(
            self.driver,
            "POST",
            &format!("/session/{}{path}", self.session),
            body,
            PATIENCE,
        )
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        // A driver that is killed leaves its browser behind, so that is closed first. This may run in a panic.
        let path = format!("/session/{}", self.session);
        let _ = request(self.driver, "DELETE", &path, "", PATIENCE);
    }
}

/// The value of the driver's answer. An error is one of the test.
fn ask(driver: SocketAddr, method: &str, path: &str, body: &Value, patience: Duration) -> Value {
    let body = if body.is_null() {
        String::new()
    } else {
        body.to_string()
    };
    let (status, mut answer) = request(driver, method, path, &body, patience)
        .unwrap_or_else(|| panic!("no answer to {method} {path} {body}"));
    assert_eq!(status, 200, "{method} {path} {body}: {answer}");
    answer["value"].take()
}

fn request(
    driver: SocketAddr,
    method: &str,
    path: &str,
    body: &str,
    patience: Duration,
) -> Option<(u16, Value)> {
    let mut stream = TcpStream::connect(driver).ok()?;
    stream.set_read_timeout(Some(patience)).ok()?;
    let length = body.len();
    let head =
        format!("{method} {path} HTTP/1.1\r\nHost: {driver}\r\nContent-Type: application/json");
    write!(stream, "{head}\r\nContent-Length: {length}\r\n\r\n{body}").ok()?;
    let (mut reader, mut line, mut status, mut length) =
        (BufReader::new(stream), String::new(), 0, 0);
    while reader.read_line(&mut line).ok()? > 2 {
        let lower = line.to_ascii_lowercase();
        if let Some(rest) = lower.strip_prefix("http/1.1 ") {
            status = rest.split(' ').next()?.parse().ok()?;
        } else if let Some(rest) = lower.strip_prefix("content-length:") {
            length = rest.trim().parse().ok()?;
        }
        line.clear();
    }
    let mut answer = vec![0; length];
    reader.read_exact(&mut answer).ok()?;
    Some((status, serde_json::from_slice(&answer).ok()?))
}

/// Host and port of a URL.
fn host(url: &str) -> &str {
    let rest = url.split_once("://").map_or(url, |(_, rest)| rest);
    rest.split(['/', '?', '#']).next().unwrap_or(rest)
}

/// Bytes from their base64.
fn unpacked(text: &str) -> Vec<u8> {
    const DIGITS: &[u8] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3);
    let (mut held, mut bits) = (0_usize, 0);
    for digit in text
        .bytes()
        .filter_map(|byte| DIGITS.iter().position(|it| *it == byte))
    {
        (held, bits) = (((held << 6) | digit) & 0xFFFF, bits + 6);
        if bits >= 8 {
            bits -= 8;
            bytes.push(u8::try_from(held >> bits & 0xFF).unwrap());
        }
    }
    bytes
}
