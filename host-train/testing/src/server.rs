//! A server of one file for tests: HTTP/1.1 with byte ranges, and, where a test wants it, bad manners.

use std::io::{BufRead, BufReader, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// An answer, before it is sent. A test may change it.
#[derive(Debug, Clone)]
pub struct FileAnswer {
    /// Status line, without the version: `206 Partial Content`.
    pub status: String,
    /// Header lines by name. `Content-Length` is added unless there is one.
    pub headers: Vec<(String, String)>,
    /// The bytes.
    pub body: Vec<u8>,
    /// Close the connection after so many bytes of the body.
    pub cut: Option<usize>,
    /// Wait before the answer.
    pub wait: Duration,
}

impl FileAnswer {
    /// Replaces a header, or removes it.
    pub fn set(&mut self, name: &str, value: Option<&str>) {
        self.headers.retain(|(known, _)| known != name);
        self.headers.extend(value.map(|value| (name.to_string(), value.to_string())));
    }
}

/// A running server. It ends when it is dropped.
#[derive(Debug)]
pub struct FileServer {
    address: SocketAddr,
    asked: Arc<Mutex<Vec<Range<usize>>>>,
    ends: Arc<AtomicBool>,
}

impl FileServer {
    /// Serves `content` at every path of a free port of this machine. `manners` may change an answer; it gets its number, counted from 0.
    ///
    /// # Panics
    /// If the machine has no free port.
    pub fn start(content: Vec<u8>, manners: impl Fn(usize, &mut FileAnswer) + Send + Sync + 'static) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
        let server =
            Self { address: listener.local_addr().expect("bound"), asked: Arc::default(), ends: Arc::default() };
        let (asked, ends) = (Arc::clone(&server.asked), Arc::clone(&server.ends));
        let (content, manners) = (Arc::new(content), Arc::new(manners));
        std::thread::spawn(move || {
            for stream in listener.incoming().flatten().take_while(|_| !ends.load(Ordering::SeqCst)) {
                let (asked, content, manners) = (Arc::clone(&asked), Arc::clone(&content), Arc::clone(&manners));
                // A client that leaves ends its thread.
                std::thread::spawn(move || serve(&stream, &content, &asked, &*manners));
            }
        });
        server
    }

    /// Returns the address of a file.
    #[must_use]
    pub fn url(&self, name: &str) -> String {
        format!("http://{}/{name}", self.address)
    }

    /// Returns the ranges that were asked for so far, bytes.
    #[must_use]
    pub fn asked(&self) -> Vec<Range<usize>> {
        self.asked.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Returns the number of bytes of the ranges that were asked for so far.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.asked().iter().map(ExactSizeIterator::len).sum()
    }
}

impl Drop for FileServer {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::SeqCst);
        // Wakes the thread that waits for connections.
        drop(TcpStream::connect(self.address));
    }
}

/// Answers the questions of a connection.
fn serve(
    stream: &TcpStream,
    content: &[u8],
    asked: &Mutex<Vec<Range<usize>>>,
    manners: &(impl Fn(usize, &mut FileAnswer) + ?Sized),
) -> Option<()> {
    let (mut reader, mut writer) = (BufReader::new(stream), stream);
    loop {
        let mut range = 0..content.len();
        loop {
            let mut line = String::new();
            if reader.read_line(&mut line).ok()? == 0 {
                return None;
            }
            if line.trim().is_empty() {
                break;
            }
            if let Some((first, last)) =
                line.to_ascii_lowercase().strip_prefix("range: bytes=").and_then(|text| text.split_once('-'))
            {
                let end = last.trim().parse::<usize>().ok()? + 1;
                range = first.parse().ok()?..end.min(content.len());
            }
        }
        let number = {
            let mut asked = asked.lock().unwrap_or_else(PoisonError::into_inner);
            asked.push(range.clone());
            asked.len() - 1
        };
        let mut answer = answer(content, &range);
        manners(number, &mut answer);
        std::thread::sleep(answer.wait);
        if !answer.headers.iter().any(|(name, _)| name == "Content-Length") {
            answer.set("Content-Length", Some(&answer.body.len().to_string()));
        }
        let lines: String = answer.headers.iter().map(|(name, value)| format!("{name}: {value}\r\n")).collect();
        write!(writer, "HTTP/1.1 {}\r\n{lines}\r\n", answer.status).ok()?;
        let sent = answer.cut.unwrap_or(answer.body.len());
        writer.write_all(&answer.body[..sent]).ok()?;
        if answer.cut.is_some() {
            return stream.shutdown(std::net::Shutdown::Both).ok();
        }
    }
}

/// Returns the answer of a server as it should be.
fn answer(content: &[u8], range: &Range<usize>) -> FileAnswer {
    let body = content.get(range.clone()).unwrap_or_default().to_vec();
    let (first, last, all) = (range.start, range.end.saturating_sub(1), content.len());
    let headers = [
        ("Content-Range", format!("bytes {first}-{last}/{all}")),
        ("Accept-Ranges", "bytes".into()),
        ("ETag", "\"one\"".into()),
        ("Last-Modified", "Sun, 30 Aug 2009 12:00:00 GMT".into()),
    ];
    let headers = headers.into_iter().map(|(name, value)| (name.to_string(), value)).collect();
    let (status, cut, wait) = ("206 Partial Content".into(), None, Duration::ZERO);
    FileAnswer { status, headers, body, cut, wait }
}
