//! Sends arbitrary frames over real sockets and reads the server's last message.

use std::net::{IpAddr, SocketAddr};
use std::time::Duration;

use anyhow::Context as _;
use futures_util::StreamExt as _;
use lodestream_client::net;
use lodestream_protocol::frame::{Frame, FrameReader, ServerFrame, encode_client};
use lodestream_protocol::message::{ClientMessage, Close, CloseCode, ServerMessage};
use lodestream_protocol::stream::{ALPN, CONTROL_STREAM};
use quinn::{Connection, ConnectionError, Endpoint, RecvStream};
use rand::Rng as _;
use rand_pcg::Pcg64Mcg;
use tokio::io::{AsyncRead, AsyncWrite, AsyncWriteExt as _};
use tokio::net::TcpSocket;
use tokio::sync::mpsc;
use tokio::time::timeout;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::tungstenite::client::IntoClientRequest as _;
use tokio_tungstenite::tungstenite::http::HeaderValue;
use tokio_tungstenite::tungstenite::http::header::SEC_WEBSOCKET_PROTOCOL;
use tokio_tungstenite::{WebSocketStream, client_async};

use super::damage;
use crate::served::Address;

/// Time to wait for the answer to the last ping before the client ends its stream: a server that waits for the rest of
/// a frame does not answer until then.
const UNTIL_END: Duration = Duration::from_millis(200);
/// One in so many WebSocket sessions has damage in the raw bytes instead of the messages.
const RAW_OF: u32 = 6;

/// Payload of the ping after all other frames.
const LAST_PING: u32 = 0xC0FF_EE00;

/// The server's last message.
#[derive(Debug)]
pub(super) enum Answer {
    /// Answer to the last ping: the session continues.
    Pong,
    /// `Close`.
    Close(Close),
    /// The connection ended without a message.
    End,
}

fn last_ping() -> anyhow::Result<Vec<u8>> {
    Ok(encode_client(&ClientMessage::Ping(LAST_PING))?)
}

/// The answer that a message stands for; `None` for messages that are not the last.
fn answer(message: ServerMessage) -> Option<Answer> {
    match message {
        ServerMessage::Close(close) => Some(Answer::Close(close)),
        ServerMessage::Pong(LAST_PING) => Some(Answer::Pong),
        _ => None,
    }
}

/// Runs a session over WebSocket.
pub(super) async fn over_websocket(
    server: Address,
    from: IpAddr,
    mut frames: Vec<Vec<u8>>,
    mut random: Pcg64Mcg,
) -> anyhow::Result<Answer> {
    let socket = TcpSocket::new_v4()?;
    socket.bind(SocketAddr::new(from, 0))?;
    let stream = socket.connect(server.http).await?;
    stream.set_nodelay(true)?;
    let mut request = format!("ws://{}/", server.http).into_client_request()?;
    request.headers_mut().insert(SEC_WEBSOCKET_PROTOCOL, HeaderValue::from_static(ALPN));
    let (mut socket, _) = client_async(request, stream).await?;
    frames.push(last_ping()?);
    let mut bytes = frames.iter().flat_map(|frame| carried(frame)).collect();
    if random.random_range(0..RAW_OF) == 0 {
        damage::bytes(&mut bytes, &[0x88, 0x80, 0, 0, 0, 0, 0x89, 0xFE, 0xFF, 0xFF], &mut random);
    }
    // A client that was refused already need not read the rest.
    let _ = socket.get_mut().write_all(&bytes).await;
    let mut told = timeout(UNTIL_END, last_answer(&mut socket)).await;
    if told.is_err() {
        let _ = socket.get_mut().shutdown().await;
        told = Ok(last_answer(&mut socket).await);
    }
    Ok(told?)
}

/// A frame as a client's binary WebSocket message, with a mask of zeros.
fn carried(frame: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0x82];
    match u16::try_from(frame.len()) {
        Ok(length @ 0..126) => bytes.push(0x80 | length as u8),
        Ok(length) => {
            bytes.push(0x80 | 126);
            bytes.extend(length.to_be_bytes());
        }
        Err(_) => {
            bytes.push(0x80 | 127);
            bytes.extend((frame.len() as u64).to_be_bytes());
        }
    }
    bytes.extend([0; 4]);
    bytes.extend(frame);
    bytes
}

async fn last_answer<S: AsyncRead + AsyncWrite + Unpin>(socket: &mut WebSocketStream<S>) -> Answer {
    while let Some(Ok(message)) = socket.next().await {
        let Message::Binary(bytes) = message else { continue };
        if let Ok(Some(ServerFrame::Message(message))) =
            Frame::parse(bytes).and_then(Frame::into_server_frame)
            && let Some(answer) = answer(message)
        {
            return answer;
        }
    }
    Answer::End
}

/// Runs a session over QUIC.
pub(super) async fn over_quic(
    server: Address,
    from: IpAddr,
    mut frames: Vec<Vec<u8>>,
) -> anyhow::Result<Answer> {
    let endpoint = Endpoint::client(SocketAddr::new(from, 0))?;
    let config = net::client_config(server.pin)?;
    let connection = endpoint.connect_with(config, server.quic, "localhost")?.await?;
    let mut control = connection.open_uni().await?;
    frames.push(last_ping()?);
    let mut bytes = vec![CONTROL_STREAM];
    bytes.extend(frames.concat());
    let _ = control.write_all(&bytes).await;
    let (heard, mut answers) = mpsc::channel(1);
    let listening = tokio::spawn(listen(connection.clone(), heard));
    let mut told = timeout(UNTIL_END, answers.recv()).await;
    if told.is_err() {
        let _ = control.finish();
        told = Ok(answers.recv().await);
    }
    connection.close(0_u32.into(), b"");
    listening.await.context("a reader of the server's streams panicked")?;
    Ok(told?.unwrap_or(Answer::End))
}

/// Reads the server's streams until the connection ends, and reports its last message.
async fn listen(connection: Connection, heard: mpsc::Sender<Answer>) {
    loop {
        match connection.accept_uni().await {
            Ok(stream) => drop(tokio::spawn(read_stream(stream, heard.clone()))),
            Err(ConnectionError::ApplicationClosed(close)) => {
                let code = CloseCode::from_number(close.error_code.into_inner());
                let reason = String::from_utf8_lossy(&close.reason).into_owned();
                let answer = code.map_or(Answer::End, |code| Answer::Close(Close::new(code, reason)));
                let _ = heard.try_send(answer);
                return;
            }
            Err(_) => return,
        }
    }
}

/// Reads a stream; blobs are discarded.
async fn read_stream(mut stream: RecvStream, heard: mpsc::Sender<Answer>) {
    let mut kind = [0];
    if stream.read_exact(&mut kind).await.is_err() {
        return;
    }
    let mut frames = FrameReader::new();
    while let Ok(Some(chunk)) = stream.read_chunk(1 << 16, true).await {
        if kind[0] != CONTROL_STREAM {
            continue;
        }
        frames.push(&chunk.bytes);
        while let Ok(Some(frame)) = frames.next_frame() {
            if let Ok(Some(ServerFrame::Message(message))) = frame.into_server_frame()
                && let Some(answer) = answer(message)
            {
                let _ = heard.try_send(answer);
            }
        }
    }
}
