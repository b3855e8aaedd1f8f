//! Connections of HTTP/1.1 with one request each, which has no body.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use http::{Request, Response, StatusCode};

/// Maximum number of open connections, each with a thread of its own; others wait.
const MAX_CONNECTIONS: usize = 256;
/// Maximum number of bytes and fields of a request's header.
const MAX_BYTES: usize = 8 << 10;
const MAX_FIELDS: usize = 64;
/// Time that a client may take to send its request, and to read more of the answer.
const PATIENCE: Duration = Duration::from_secs(5);
/// Number and length of the waits for a client to close the connection.
const LINGER: (usize, Duration) = (8, Duration::from_secs(1));
const PAUSE: Duration = Duration::from_millis(5);

/// Answers requests until the program ends. Clients that hang up are ignored.
pub(super) fn serve(socket: &TcpListener, answer: impl Fn(&Request<()>) -> Response<Vec<u8>> + Send + Sync + 'static) {
    let answer = Arc::new(answer);
    for stream in socket.incoming() {
        // Each open connection holds the function as well.
        while Arc::strong_count(&answer) > MAX_CONNECTIONS {
            thread::sleep(PAUSE);
        }
        let answer = answer.clone();
        let connect = |stream| thread::Builder::new().spawn(move || drop(respond(stream, &*answer)));
        if stream.and_then(connect).is_err() {
            // There are too many open files or threads; some of them will end.
            thread::sleep(PAUSE);
        }
    }
}

fn respond(mut stream: TcpStream, answer: &dyn Fn(&Request<()>) -> Response<Vec<u8>>) -> io::Result<()> {
    stream.set_nodelay(true)?;
    stream.set_write_timeout(Some(PATIENCE))?;
    let response = match read(&mut stream)? {
        Ok(request) => answer(&request),
        Err(status) => Response::builder().status(status).body(status.to_string().into_bytes()).unwrap_or_default(),
    };
    write(&mut stream, &response)?;
    // A connection that is closed with unread bytes is reset, and the answer is lost.
    stream.shutdown(Shutdown::Write)?;
    stream.set_read_timeout(Some(LINGER.1))?;
    let mut rest = [0; 8192];
    for _ in 0..LINGER.0 {
        if stream.read(&mut rest)? == 0 {
            break;
        }
    }
    Ok(())
}

/// Reads the request of a connection; a faulty request returns the status of the error.
fn read(stream: &mut TcpStream) -> io::Result<Result<Request<()>, StatusCode>> {
    let end = Instant::now() + PATIENCE;
    let (mut header, mut more) = (Vec::new(), [0; 1024]);
    loop {
        let left = end.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Ok(Err(StatusCode::REQUEST_TIMEOUT));
        }
        stream.set_read_timeout(Some(left))?;
        match stream.read(&mut more) {
            Ok(0) => return Err(ErrorKind::ConnectionAborted.into()),
            Ok(count) => header.extend(&more[..count]),
            Err(error) if [ErrorKind::WouldBlock, ErrorKind::TimedOut].contains(&error.kind()) => continue,
            Err(error) => return Err(error),
        }
        match parse(&header) {
            Ok(Some(request)) => return Ok(Ok(request)),
            Ok(None) if header.len() < MAX_BYTES => {}
            Ok(None) => return Ok(Err(StatusCode::REQUEST_HEADER_FIELDS_TOO_LARGE)),
            Err(status) => return Ok(Err(status)),
        }
    }
}

/// Parses the header of a request; `None` if there is more to come.
fn parse(header: &[u8]) -> Result<Option<Request<()>>, StatusCode> {
    let mut fields = [httparse::EMPTY_HEADER; MAX_FIELDS];
    let mut parsed = httparse::Request::new(&mut fields);
    match parsed.parse(header) {
        Ok(status) if status.is_partial() => return Ok(None),
        Ok(_) => {}
        Err(httparse::Error::TooManyHeaders) => return Err(StatusCode::REQUEST_HEADER_FIELDS_TOO_LARGE),
        Err(_) => return Err(StatusCode::BAD_REQUEST),
    }
    let mut request = Request::builder().method(parsed.method.unwrap_or_default()).uri(parsed.path.unwrap_or_default());
    for field in parsed.headers {
        request = request.header(field.name, field.value);
    }
    request.body(()).map(Some).map_err(|_| StatusCode::BAD_REQUEST)
}

fn write(stream: &mut TcpStream, response: &Response<Vec<u8>>) -> io::Result<()> {
    let mut header = format!("HTTP/1.1 {}\r\n", response.status()).into_bytes();
    let length = response.body().len().to_string();
    let own = [("content-length", length.as_bytes()), ("connection", b"close")];
    let given = response.headers().iter().map(|(name, value)| (name.as_str(), value.as_bytes()));
    for (name, value) in given.chain(own) {
        header.extend([name.as_bytes(), b": ", value, b"\r\n"].concat());
    }
    header.extend(b"\r\n");
    stream.write_all(&header)?;
    stream.write_all(response.body())
}
