//! Access by the operator's program or URL.

use std::collections::VecDeque;
use std::net::IpAddr;
use std::sync::Mutex;

use futures_util::future::BoxFuture;
use lodestream_protocol::message::CloseCode;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpListener;
use tokio::time::{Instant, sleep};

use super::scenes::{at, get, hello_for, two};
use super::tokens::{in_s, token, with_header};
use super::*;
use crate::auth::access::Access;
use crate::auth::grant::{Grant, TokenError};
use crate::auth::hook::{Hook, HookError, Introspect, IntrospectionRequest, IntrospectionResponse};
use crate::auth::hook_url::Authorization;
use crate::session::admission_settings::AdmissionSettings;
use crate::session::scenes::Scenes;

/// Tokens and scenes of the requests received.
type ReceivedRequests = Vec<(String, Option<String>)>;

/// A backend that gives scripted responses, the last one repeatedly, and records the requests.
#[derive(Clone, Default)]
struct Script {
    answers: Arc<Mutex<VecDeque<Result<String, HookError>>>>,
    takes: Duration,
    received: Arc<Mutex<ReceivedRequests>>,
    /// Concurrent requests: now, and the maximum.
    concurrent: Arc<Mutex<(usize, usize)>>,
}

impl Script {
    fn saying(answers: impl IntoIterator<Item = Result<String, HookError>>) -> Self {
        Self { answers: Arc::new(Mutex::new(answers.into_iter().collect())), ..Self::default() }
    }

    fn received(&self) -> ReceivedRequests {
        self.received.lock().unwrap().clone()
    }

    fn access(&self) -> AdmissionSettings {
        let hook = Hook::new("a script".into(), self.clone()).with_cache_ttl(Duration::from_secs(3600));
        AdmissionSettings {
            access: Some(Arc::new(Access::Hook { hook, authorization: None })),
            ..AdmissionSettings::default()
        }
    }

    fn state(&self, scenes: impl Into<Scenes>) -> Arc<ServerState> {
        ServerState::with_admission(scenes, SessionSettings::default(), self.access())
    }

    /// A server of one scene.
    fn one(&self) -> Arc<ServerState> {
        let scene: Arc<dyn lodestream_protocol::source::SceneSource> =
            Arc::new(MemoryScene::new(1, 100, 1000));
        self.state(scene)
    }
}

impl Introspect for Script {
    fn introspect(
        &self,
        question: IntrospectionRequest,
    ) -> BoxFuture<'static, Result<IntrospectionResponse, HookError>> {
        let script = self.clone();
        Box::pin(async move {
            script.received.lock().unwrap().push((question.token, question.scene));
            {
                let mut concurrent = script.concurrent.lock().unwrap();
                concurrent.0 += 1;
                concurrent.1 = concurrent.1.max(concurrent.0);
            }
            sleep(script.takes).await;
            script.concurrent.lock().unwrap().0 -= 1;
            let mut answers = script.answers.lock().unwrap();
            let answer = if answers.len() > 1 { answers.pop_front() } else { answers.front().cloned() };
            IntrospectionResponse::parse(answer.unwrap()?.as_bytes())
        })
    }
}

fn yes() -> Result<String, HookError> {
    Ok(r#"{"active":true}"#.into())
}

fn no() -> Result<String, HookError> {
    Ok(r#"{"active":false,"exp":4102444800,"scene":"*"}"#.into())
}

fn broken() -> Result<String, HookError> {
    Err(HookError::HttpStatus(500))
}

const UNAUTHORISED: u16 = 4000 + CloseCode::Unauthorised.number();
const BUSY: u16 = 4000 + CloseCode::Busy.number();

#[tokio::test(start_paused = true)]
async fn an_accepted_token_gives_a_session() {
    let script = Script::saying([yes()]);
    let state = script.one();
    let mut first = with_header(&state, "open sesame").await.unwrap();
    first.is_welcome().await;
    let mut second = Client::in_memory(&state).await;
    second.send(&token("open sesame, too".into())).await;
    second.is_welcome().await;
    second.send(&hello()).await;
    assert_eq!(second.read_blobs(1).await.len(), 1);
    let memory = Some("memory".to_owned());
    let expected = [("open sesame".to_owned(), memory.clone()), ("open sesame, too".to_owned(), memory)];
    assert_eq!(script.received(), expected);
    // Without a token there is no request.
    let mut third = Client::in_memory(&state).await;
    third.send(&hello()).await;
    assert_eq!(third.refused_at_once().await.0, UNAUTHORISED);
    assert_eq!(script.received().len(), 2);
}

#[tokio::test(start_paused = true)]
async fn a_refused_token_is_final_and_an_unverified_one_may_be_retried() {
    for (said, code, status) in [
        (no(), UNAUTHORISED, "401"),
        (Ok(format!(r#"{{"active":true,"exp":{}}}"#, in_s(-100))), UNAUTHORISED, "401"),
        (Ok(r#"{"active":true,"scene":"other"}"#.into()), UNAUTHORISED, "401"),
        (Ok(r#"{"active":true,"weight":0}"#.into()), UNAUTHORISED, "401"),
        (broken(), BUSY, "503"),
        (Ok(r#"{"scene":"*"}"#.into()), BUSY, "503"),
        (Ok("yes".into()), BUSY, "503"),
    ] {
        let state = Script::saying([said.clone()]).one();
        let mut client = Client::in_memory(&state).await;
        client.send(&token("t".into())).await;
        assert_eq!(client.refused_at_once().await.0, code, "{said:?}");
        let refused = with_header(&state, "t").await.err().unwrap();
        assert!(refused.contains(status), "{said:?}: {refused}");
        let metrics = state.render_metrics();
        let unknown = if code == BUSY { 2 } else { 0 };
        assert!(metrics.contains(&format!("lodestream_access_unknown_total {unknown}\n")), "{metrics}");
        assert!(metrics.contains(&format!("lodestream_tokens_refused_total {}\n", 2 - unknown)), "{metrics}");
        assert_eq!(state.metrics().bytes_sent(), 0);
    }
    assert!(CloseCode::Busy.worth_retrying());
}

#[tokio::test(start_paused = true)]
async fn a_request_times_out() {
    let script = Script { takes: Duration::from_secs(3600), ..Script::saying([yes()]) };
    let state = script.one();
    let started = Instant::now();
    let mut client = Client::in_memory(&state).await;
    client.send(&token("t".into())).await;
    assert_eq!(client.refused_at_once().await.0, BUSY);
    assert_eq!(started.elapsed().as_secs(), 5);
}

#[tokio::test(start_paused = true)]
async fn equal_requests_are_sent_once_and_few_at_a_time() {
    let script = Script { takes: Duration::from_secs(1), ..Script::saying([yes()]) };
    let state = script.one();
    let mut clients = Vec::new();
    for number in 0..60 {
        let from = SocketAddr::from(([10, 0, 0, number % 30], 4000));
        let mut client = Client::from(from, &state).await.unwrap();
        client.send(&token("the same".into())).await;
        clients.push(client);
    }
    for client in &mut clients {
        client.is_welcome().await;
    }
    // Thirty addresses with two sessions each: a response may depend on the address.
    assert_eq!(script.received().len(), 30);
    assert_eq!(script.concurrent.lock().unwrap().1, 16);
    // The response is reused for a while.
    let again = async || {
        let mut client = Client::from(SocketAddr::from(([10, 0, 0, 0], 4000)), &state).await.unwrap();
        client.send(&token("the same".into())).await;
        client.is_welcome().await;
    };
    again().await;
    assert_eq!(script.received().len(), 30);
    // But not for another request.
    let mut client = Client::from(SocketAddr::from(([10, 0, 0, 0], 4000)), &state).await.unwrap();
    client.send(&token("another".into())).await;
    client.is_welcome().await;
    assert_eq!(script.received().len(), 31);
}

#[tokio::test(start_paused = true)]
async fn a_request_names_the_scene_and_a_response_grants_no_other() {
    let script = Script::saying([yes()]);
    let state = script.state(two());
    // Named by the URL, or by Hello, for which verification waits.
    let mut client = at(&state, "/two").await.unwrap();
    client.send(&token("t".into())).await;
    assert_eq!(client.welcome().await.scene.name, "two");
    let mut client = at(&state, "/").await.unwrap();
    client.send(&token("t".into())).await;
    client.send(&hello_for("one")).await;
    assert_eq!(client.welcome().await.scene.name, "one");
    let of = |scene: &str| ("t".to_owned(), Some(scene.to_owned()));
    assert_eq!(script.received(), [of("two"), of("one")]);
    // A client that names no scene learns no names.
    let mut client = at(&state, "/").await.unwrap();
    client.send(&token("t".into())).await;
    client.send(&hello_for("")).await;
    assert_eq!(client.closed().await.1, "the address must name a scene, as in ws://HOST:PORT/NAME");
    // The list holds the scenes in the response, here none.
    let list = get(&state, "/scenes", Some("t")).await;
    assert!(list.contains("200") && !list.contains("\"one\"") && !list.contains("\"two\""), "{list}");
    let script = Script::saying([Ok(r#"{"active":true,"scene":["two","three"]}"#.into())]);
    let list = get(&script.state(two()), "/scenes", Some("t")).await;
    assert!(list.contains("\"two\"") && !list.contains("\"one\""), "{list}");
    assert_eq!(script.received(), [("t".to_owned(), None)]);
}

/// Runs a session that sends a second token after 20 s; returns when and why it ended, and the number of requests.
async fn ends_after(answers: [Result<String, HookError>; 4]) -> (u64, CloseCode, usize) {
    let script = Script::saying(answers);
    let state = script.one();
    let mut client = with_header(&state, "first").await.unwrap();
    client.send(&hello()).await;
    let (started, mut pings) = (Instant::now(), 0);
    loop {
        tokio::select! {
            frame = client.next() => {
                if let ServerFrame::Message(ServerMessage::Close(close)) = frame.expect("no Close") {
                    return (started.elapsed().as_secs(), close.code, script.received().len());
                }
            }
            () = sleep(Duration::from_secs(5)) => {
                pings += 1;
                client.send(&ClientMessage::Ping(pings)).await;
                if pings == 4 {
                    client.send(&token("second".into())).await;
                }
            }
        }
    }
}

#[tokio::test(start_paused = true)]
async fn a_session_continues_while_its_next_token_is_not_verified() {
    let until = |seconds| Ok(format!(r#"{{"active":true,"exp":{}}}"#, in_s(seconds)));
    // Each expiry has 30 s of leeway. Verified at the third attempt; tokens' clock is not paused.
    let (after, code, asked) = ends_after([until(60), broken(), broken(), until(120)]).await;
    assert!((140..=182).contains(&after) && code == CloseCode::Unauthorised, "{after} s, {code:?}");
    assert_eq!(asked, 4);
    // Never verified: the session ends with its first token.
    let (after, code, asked) = ends_after([until(60), broken(), broken(), broken()]).await;
    assert!((80..=95).contains(&after) && code == CloseCode::Unauthorised, "{after} s, {code:?}");
    assert!(asked > 10, "{asked}");
    // Refused: the session ends at once.
    let (after, code, _) = ends_after([until(60), no(), no(), no()]).await;
    assert!((20..=21).contains(&after) && code == CloseCode::Unauthorised, "{after} s, {code:?}");
}

fn question(token: &str) -> IntrospectionRequest {
    IntrospectionRequest {
        token: token.into(),
        scene: Some("memory".into()),
        address: IpAddr::from(Ipv4Addr::LOCALHOST),
    }
}

/// A shell script as a program. `install` writes it: a file that this process has open for writing is briefly inherited by
/// children of other tests, and cannot be executed meanwhile.
#[cfg(unix)]
fn program(script: &str) -> (tempfile::TempDir, std::path::PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let (text, path) = (folder.path().join("text"), folder.path().join("hook"));
    std::fs::write(&text, format!("#!/bin/sh\n{script}\n")).unwrap();
    let written = std::process::Command::new("install").args(["-m", "700"]).args([&text, &path]).status();
    assert!(written.unwrap().success());
    (folder, path)
}

/// Verifies a token by a shell script.
#[cfg(unix)]
async fn verify_by_script(script: &str) -> Result<Grant, TokenError> {
    let (_folder, path) = program(script);
    let hook = Hook::from_command(&path).unwrap().with_timeout(REAL_TIME_LIMIT);
    hook.verify(question("o\"pen\nsesame")).await
}

#[cfg(unix)]
#[tokio::test]
async fn a_program_reads_one_line_and_answers_with_claims() {
    let line = r#"{"token":"o\\"pen\\nsesame","scene":"memory","client_address":"127.0.0.1"}"#;
    let checks = format!("read -r line; [ \"$line\" = '{}' ] || exit 3\n", line.replace("\\\\", "\\"));
    let granted = |answer: &str| format!("{checks}printf '%s' '{answer}'");
    let grant =
        verify_by_script(&granted(r#"{"active":true,"weight":3,"rate":4000000,"sub":"ali"}"#)).await.unwrap();
    assert_eq!((grant.weight.get(), grant.rate_bits_per_s), (3, Some(4_000_000)));
    assert!(grant.allows("memory") && !grant.allows("other"));
    assert_eq!(grant.subject.as_deref(), Some("ali"));
    assert_eq!(verify_by_script(&granted(r#"{"active":false}"#)).await.unwrap_err(), TokenError::Refused);
    // Scripts that do not read, write too much, fail or write nothing.
    assert!(verify_by_script(r#"echo '{"active":true}'"#).await.is_ok());
    for bad in [
        "head -c 200000 /dev/zero",
        "head -c 200000 /dev/zero >&2; exit 1",
        "echo '{\"active\":true}'; exit 1",
        "true",
        "echo '{\"active\":\"true\"}'",
        "kill -9 $$",
    ] {
        assert_eq!(verify_by_script(bad).await.unwrap_err(), TokenError::Unavailable, "{bad}");
    }
    let none = Hook::from_command(std::path::Path::new("/nowhere/at/all")).unwrap_err();
    assert!(format!("{none:#}").contains("--access-command /nowhere/at/all"), "{none:#}");
}

/// After a timeout no process is left running.
#[cfg(unix)]
#[tokio::test]
async fn a_program_is_killed_after_its_timeout() {
    let elsewhere = tempfile::tempdir().unwrap();
    let pid = elsewhere.path().join("pid");
    let (_folder, path) = program(&format!("echo $$ > {}\nexec sleep 600", pid.display()));
    let hook = Hook::from_command(&path).unwrap().with_timeout(Duration::from_secs(1));
    // On a busy machine the program may not have started within the timeout: repeat.
    let pid = loop {
        assert_eq!(hook.verify(question("t")).await.unwrap_err(), TokenError::Unavailable);
        if let Ok(pid) = std::fs::read_to_string(&pid).unwrap_or_default().trim().parse::<i32>() {
            break rustix::process::Pid::from_raw(pid).unwrap();
        }
    };
    tokio::time::timeout(REAL_TIME_LIMIT, async {
        while rustix::process::test_kill_process(pid).is_ok() {
            sleep(Duration::from_millis(10)).await;
        }
    })
    .await
    .unwrap();
}

/// A server that gives one response per connection, and records the requests.
async fn scripted_server(answers: Vec<String>) -> (url::Url, Arc<Mutex<Vec<String>>>) {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).await.unwrap();
    let url = format!("http://{}/introspect", listener.local_addr().unwrap()).parse().unwrap();
    let requests = Arc::new(Mutex::new(Vec::new()));
    let note = Arc::clone(&requests);
    tokio::spawn(async move {
        for answer in answers {
            let (mut stream, _) = listener.accept().await.unwrap();
            let mut request = Vec::new();
            while !request.ends_with(b"127.0.0.1") {
                let mut some = [0; 4096];
                let count = stream.read(&mut some).await.unwrap();
                assert!(count > 0, "{}", String::from_utf8_lossy(&request));
                request.extend_from_slice(&some[..count]);
            }
            note.lock().unwrap().push(String::from_utf8(request).unwrap());
            let _ = stream.write_all(answer.as_bytes()).await;
        }
    });
    (url, requests)
}

fn ok(body: &str) -> String {
    let length = body.len();
    format!("HTTP/1.1 200 OK\r\nConnection: close\r\nContent-Length: {length}\r\n\r\n{body}")
}

#[tokio::test]
async fn a_url_is_queried_as_an_introspection_endpoint() {
    let elsewhere =
        "HTTP/1.1 307 x\r\nConnection: close\r\nLocation: /elsewhere\r\nContent-Length: 0\r\n\r\n";
    let chunks = format!("10000\r\n{}\r\n", "x".repeat(0x10000)).repeat(3);
    let endless =
        format!("HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\nConnection: close\r\n\r\n{chunks}");
    let answers = vec![
        ok(r#"{"active":true,"scene":"*","client_id":"l238j323ds-23ij4","username":"jdoe"}"#),
        ok(r#"{"active":false}"#),
        elsewhere.to_owned(),
        endless,
        ok("<html>"),
        "HTTP/1.1 401 x\r\nConnection: close\r\nContent-Length: 0\r\n\r\n".to_owned(),
    ];
    let (url, requests) = scripted_server(answers).await;
    let secret = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(secret.path(), "Bearer 23410913-abewfq.123483\n").unwrap();
    let authorization = Authorization::from_file(secret.path()).unwrap();
    let hook = Hook::from_url(&url, Some(authorization)).unwrap().with_timeout(REAL_TIME_LIMIT);
    assert!(hook.verify(question("a&b c")).await.unwrap().allows("anything"));
    let first = requests.lock().unwrap()[0].clone();
    let (head, form) = first.split_once("\r\n\r\n").unwrap();
    assert_eq!(form, "token=a%26b+c&scene=memory&client_address=127.0.0.1");
    let head = head.to_ascii_lowercase();
    for line in [
        "post /introspect http/1.1",
        "authorization: bearer 23410913-abewfq.123483",
        "content-type: application/x-www-form-urlencoded",
        "accept: application/json",
    ] {
        assert!(head.contains(line), "{line} of {head}");
    }
    assert_eq!(hook.verify(question("2")).await.unwrap_err(), TokenError::Refused);
    for bad in 3..=6 {
        assert_eq!(hook.verify(question(&bad.to_string())).await.unwrap_err(), TokenError::Unavailable);
    }
    assert_eq!(requests.lock().unwrap().len(), 6, "no redirect is followed");
    // No server.
    assert_eq!(hook.verify(question("7")).await.unwrap_err(), TokenError::Unavailable);
}

#[test]
fn unusable_urls_and_authorizations_are_refused() {
    for (url, why) in [("ftp://host/", "http or https"), ("https://a:b@host/", "--access-authorization")] {
        let refused = Hook::from_url(&url.parse().unwrap(), None).unwrap_err().to_string();
        assert!(refused.contains(why) && !refused.contains("a:b"), "{refused}");
    }
    let file = tempfile::NamedTempFile::new().unwrap();
    for bad in ["", "secret", " secret", "Bearer a\u{7}b"] {
        std::fs::write(file.path(), bad).unwrap();
        assert!(Authorization::from_file(file.path()).is_err(), "{bad}");
    }
}

#[tokio::test]
async fn a_response_is_reused_up_to_its_maximum_staleness() {
    let script = Script::saying([yes()]);
    let hook = Hook::new("a script".into(), script.clone()).with_cache_ttl(Duration::from_millis(1));
    for asked in 1..=3 {
        hook.verify(question("t")).await.unwrap();
        assert_eq!(script.received().len(), asked);
        sleep(Duration::from_millis(20)).await;
    }
}
