//! Chromium without a window, driven by its devtools protocol: one browser with one tab per test.

use std::io::{BufRead as _, BufReader};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use data_encoding::BASE64;
use futures_util::{SinkExt as _, StreamExt as _};
use serde_json::{Value, json};
use tokio::net::TcpStream;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream, connect_async};

/// Time limit of an answer; far above what it needs.
const LIMIT: Duration = Duration::from_secs(120);
/// Interval of polls for a condition in the page.
const POLL: Duration = Duration::from_millis(100);
/// Names under which the browser is installed.
const NAMES: [&str; 3] = ["chromium", "chromium-browser", "google-chrome"];
/// Flags of all tabs.
const FLAGS: [&str; 6] = [
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu-sandbox",
    "--remote-debugging-port=0",
    "--no-first-run",
    "--enable-unsafe-swiftshader",
];
/// WebGPU drawn by the browser's own software driver, in a canvas.
pub(crate) const WEBGPU: &[&str] = &[
    "--enable-unsafe-webgpu",
    "--enable-features=Vulkan",
    "--use-webgpu-adapter=swiftshader",
    "--use-vulkan=swiftshader",
    "--use-angle=vulkan",
    "--ignore-gpu-blocklist",
];
/// WebGL drawn by the same driver, which does not show WebGPU's canvases with these flags.
pub(crate) const WEBGL: &[&str] = &["--use-angle=swiftshader"];

/// WebGPU and WebGL, of which only the latter's canvases are shown.
pub(crate) const WEBGPU_AND_WEBGL: &[&str] = &[
    "--enable-unsafe-webgpu",
    "--enable-features=Vulkan",
    "--use-webgpu-adapter=swiftshader",
    "--use-vulkan=swiftshader",
    "--use-angle=swiftshader",
    "--ignore-gpu-blocklist",
];

/// A tab.
pub(crate) struct Tab {
    runtime: tokio::runtime::Runtime,
    socket: WebSocketStream<MaybeTlsStream<TcpStream>>,
    session: Value,
    next: u64,
    /// Console messages, uncaught errors, and errors that the browser reports, such as a policy's violations.
    pub(crate) console: Vec<String>,
    browser: Child,
    _profile: tempfile::TempDir,
}

fn program() -> Option<&'static str> {
    NAMES.into_iter().find(|name| {
        let version =
            Command::new(name).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status();
        version.is_ok_and(|status| status.success())
    })
}

impl Tab {
    /// Opens a browser with an empty tab of a size, [`WEBGPU`] or [`WEBGL`]; `None` if no browser is installed.
    pub(crate) fn open([width, height]: [u32; 2], graphics: &[&str]) -> Option<Self> {
        let profile = tempfile::tempdir().unwrap();
        let mut browser = Command::new(program()?)
            .args(FLAGS)
            .args(graphics)
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .arg("about:blank")
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(browser.stderr.take().unwrap()).lines().map_while(Result::ok);
        let url = lines.find_map(|line| line.strip_prefix("DevTools listening on ").map(str::to_owned));
        let url = url.expect("the browser prints the address of its devtools");
        // Its log must be read on, or it would block.
        std::thread::spawn(move || lines.for_each(drop));
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        let (socket, _) = runtime.block_on(connect_async(url)).unwrap();
        let (session, console) = (Value::Null, Vec::new());
        let mut tab = Self { runtime, socket, session, next: 0, console, browser, _profile: profile };
        let target = tab.call("Target.createTarget", json!({ "url": "about:blank" }));
        let attached = json!({ "targetId": target["targetId"], "flatten": true });
        tab.session = tab.call("Target.attachToTarget", attached)["sessionId"].clone();
        tab.resize([width, height], 1.0);
        for domain in ["Runtime", "Log", "Page"] {
            tab.call(&format!("{domain}.enable"), json!({}));
        }
        Some(tab)
    }

    /// Changes the size of the page, in CSS pixels, and the device's pixels for each.
    pub(crate) fn resize(&mut self, [width, height]: [u32; 2], scale: f64) {
        let metrics =
            json!({ "width": width, "height": height, "deviceScaleFactor": scale, "mobile": false });
        self.call("Emulation.setDeviceMetricsOverride", metrics);
    }

    /// Makes the tab that of a phone: a screen of this size, and fingers.
    pub(crate) fn be_a_phone(&mut self, [width, height]: [u32; 2], scale: f64) {
        let metrics = json!({
            "width": width, "height": height, "screenWidth": width, "screenHeight": height,
            "deviceScaleFactor": scale, "mobile": true,
        });
        self.call("Emulation.setDeviceMetricsOverride", metrics);
        self.call("Emulation.setTouchEmulationEnabled", json!({ "enabled": true, "maxTouchPoints": 5 }));
    }

    /// The whole page as it is shown, as a PNG.
    pub(crate) fn screenshot(&mut self) -> Vec<u8> {
        let shot = self.call("Page.captureScreenshot", json!({ "format": "png" }));
        BASE64.decode(shot["data"].as_str().expect("a picture").as_bytes()).unwrap()
    }

    /// Calls a method and waits for its result.
    pub(crate) fn call(&mut self, method: &str, parameters: Value) -> Value {
        self.next += 1;
        let id = self.next;
        let mut request = json!({ "id": id, "method": method, "params": parameters });
        if !self.session.is_null() {
            request["sessionId"] = self.session.clone();
        }
        let Self { runtime, socket, console, .. } = self;
        let answer = runtime.block_on(async {
            tokio::time::timeout(LIMIT, async {
                socket.send(Message::text(request.to_string())).await.unwrap();
                loop {
                    let message = socket.next().await.expect("the browser is open").unwrap();
                    let Message::Text(text) = message else { continue };
                    let answer: Value = serde_json::from_str(&text).unwrap();
                    if answer["id"] == id {
                        return answer;
                    }
                    note(&answer, console);
                }
            })
            .await
        });
        let answer = answer.unwrap_or_else(|_| panic!("{method} was not answered"));
        assert!(answer["error"].is_null(), "{method}: {}", answer["error"]);
        answer["result"].clone()
    }

    /// Opens an address.
    pub(crate) fn navigate(&mut self, url: &str) {
        let result = self.call("Page.navigate", json!({ "url": url }));
        assert!(result["errorText"].is_null(), "{url}: {result}");
    }

    /// The value of an expression, awaited.
    pub(crate) fn evaluate(&mut self, expression: &str) -> Value {
        let call = json!({ "expression": expression, "awaitPromise": true, "returnByValue": true });
        let result = self.call("Runtime.evaluate", call);
        assert!(result["exceptionDetails"].is_null(), "{expression}: {}", result["exceptionDetails"]);
        result["result"]["value"].clone()
    }

    /// Waits until an expression's value satisfies a condition, and returns that value.
    pub(crate) fn wait(&mut self, what: &str, expression: &str, holds: impl Fn(&Value) -> bool) -> Value {
        let begun = Instant::now();
        loop {
            let value = self.evaluate(expression);
            if holds(&value) {
                return value;
            }
            assert!(
                begun.elapsed() < LIMIT,
                "{what}: {value}\n{:#?}",
                self.console.iter().take(9).collect::<Vec<_>>()
            );
            std::thread::sleep(POLL);
        }
    }
}

/// Keeps a console message or an uncaught error.
fn note(event: &Value, console: &mut Vec<String>) {
    let parameters = &event["params"];
    match event["method"].as_str() {
        Some("Runtime.consoleAPICalled") => {
            let texts = parameters["args"].as_array().into_iter().flatten();
            let text: Vec<String> = texts.map(|argument| argument["value"].to_string()).collect();
            console.push(format!("{}: {}", parameters["type"], text.join(" ")));
        }
        Some("Runtime.exceptionThrown") => console.push(parameters["exceptionDetails"].to_string()),
        // The browser itself asks for an icon; its warnings are advice.
        Some("Log.entryAdded") => {
            let entry = &parameters["entry"];
            let (text, url) = (&entry["text"], &entry["url"]);
            if entry["level"] == "error" && !url.as_str().is_some_and(|url| url.ends_with("/favicon.ico")) {
                console.push(format!("{}: {text} {url}", entry["source"]));
            }
        }
        _ => {}
    }
}

impl Drop for Tab {
    fn drop(&mut self) {
        // Ends the child that this test started, and with it the browser's own processes.
        let _ = self.browser.kill();
        let _ = self.browser.wait();
    }
}
