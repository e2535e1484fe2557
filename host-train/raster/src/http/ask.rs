//! Questions to a server: byte ranges, with time-outs, and again after failures that may pass. Every answer is checked: that it has the bytes that
//! were asked for, and that they are of the same version of the file as those before.

use elunar_base::{Error, Result, read};
use std::io::{self, ErrorKind, Read};
use std::ops::Range;
use std::path::Path;
use std::time::Duration;
use ureq::http::{HeaderMap, Response, header};
use ureq::tls::{PemItem, RootCerts, TlsConfig, parse_pem};
use ureq::{Agent, Body};

/// Names a file with the certificates that are trusted, PEM, in place of those in the program: as OpenSSL, curl and GDAL have it.
const CERTIFICATES: &str = "SSL_CERT_FILE";

/// How long a server may take, and how often it is asked.
#[derive(Debug, Clone, Copy)]
pub(super) struct Patience {
    /// Longest time until there is a connection.
    pub(super) connect: Duration,
    /// Longest time without a byte of an answer.
    pub(super) answer: Duration,
    /// Questions, the first one included.
    pub(super) tries: u32,
    /// Pause before the second question. It doubles from then on.
    pub(super) pause: Duration,
}

impl Patience {
    /// Our choice.
    pub(super) const USUAL: Self = Self {
        connect: Duration::from_secs(10),
        answer: Duration::from_secs(30),
        tries: 4,
        pause: Duration::from_millis(500),
    };
}

/// What tells one version of a file from another.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Version {
    /// Bytes of the whole file.
    pub(super) length: u64,
    /// The strong entity tag, with its quotes.
    etag: Option<String>,
    /// `Last-Modified`.
    modified: Option<String>,
}

impl Version {
    fn new(headers: &HeaderMap, length: u64) -> Self {
        let text = |name| headers.get(name).and_then(|value| value.to_str().ok()).map(str::to_string);
        Self {
            length,
            etag: text(header::ETAG).filter(|etag| !etag.starts_with("W/")),
            modified: text(header::LAST_MODIFIED),
        }
    }

    /// Returns what the server says of the version, the strong entity tag before the time; `None` if it says neither.
    pub(super) fn mark(&self) -> Option<String> {
        let named = |name: &str, value: &Option<String>| value.as_ref().map(|value| format!("{name} {value}"));
        named("ETag", &self.etag).or_else(|| named("Last-Modified", &self.modified))
    }
}

/// A server that has a file.
pub(super) struct Server {
    agent: Agent,
    url: String,
    patience: Patience,
}

impl Server {
    /// Prepares questions about a file. None is asked.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for an address with a user or a password, [`Error::Io`] if the user's certificates cannot be read.
    pub(super) fn new(path: &Path, patience: Patience) -> Result<Self> {
        let url = path.to_str().unwrap_or_default().to_string();
        let host = url.split_once("://").map_or("", |(_, rest)| rest.split('/').next().unwrap_or_default());
        if host.contains('@') {
            return Err(Error::unsupported(path, "an address without user and password expected: the DTM states it"));
        }
        let mut config = Agent::config_builder()
            .http_status_as_error(false)
            .https_only(url.get(..6).is_some_and(|scheme| scheme.eq_ignore_ascii_case("https:")))
            .timeout_connect(Some(patience.connect))
            .timeout_recv_response(Some(patience.answer))
            .timeout_per_read(Some(patience.answer))
            .user_agent(concat!(env!("CARGO_PKG_NAME"), "/", env!("CARGO_PKG_VERSION")))
            .accept_encoding("identity");
        if let Some(file) = std::env::var_os(CERTIFICATES) {
            config = config.tls_config(TlsConfig::builder().root_certs(certificates(Path::new(&file))?).build());
        }
        Ok(Self { agent: config.build().new_agent(), url, patience })
    }

    /// Returns the bytes of a range, up to the end of the file, and the version of the file, which must be `known` if one is.
    ///
    /// # Errors
    /// [`ErrorKind::NotFound`] or [`ErrorKind::PermissionDenied`] as the server says, [`ErrorKind::Unsupported`] if it does not serve ranges,
    /// [`ErrorKind::ConnectionAborted`] if the file changed; others after the last try.
    pub(super) fn bytes(&self, range: &Range<u64>, known: Option<&Version>) -> io::Result<(Version, Vec<u8>)> {
        let mut pause = self.patience.pause;
        for left in (0..self.patience.tries).rev() {
            match self.ask(range, known) {
                Err(error) if left > 0 && may_pass(error.kind()) => std::thread::sleep(pause),
                Err(error) if may_pass(error.kind()) => {
                    let tries = self.patience.tries;
                    return Err(io::Error::new(error.kind(), format!("{error} (asked {tries} times)")));
                }
                done => return done,
            }
            pause *= 2;
        }
        Err(failed(ErrorKind::TimedOut, "not asked"))
    }

    fn ask(&self, range: &Range<u64>, known: Option<&Version>) -> io::Result<(Version, Vec<u8>)> {
        let asked = format!("bytes={}-{}", range.start, range.end.saturating_sub(1));
        let mut response = self.agent.get(&self.url).header(header::RANGE, asked).call().map_err(refusal)?;
        check_status(&response)?;
        let (found, length) = content_range(response.headers())?;
        let version = Version::new(response.headers(), length);
        if let Some(known) = known.filter(|known| **known != version) {
            let text = |version: &Version| format!("{} bytes, {}", version.length, version.mark().unwrap_or_default());
            let what =
                format!("the file changed while it was read: {} expected, found {}", text(known), text(&version));
            return Err(failed(ErrorKind::ConnectionAborted, &what));
        }
        let expected = range.start..range.end.min(length);
        if found != expected {
            let what = format!("bytes {expected:?} expected from the server, found {found:?}");
            return Err(failed(ErrorKind::Unsupported, &what));
        }
        let count = expected.end.saturating_sub(expected.start);
        let mut bytes = vec![];
        let read = response.body_mut().as_reader().take(count + 1).read_to_end(&mut bytes);
        // The library says why as text alone.
        let read =
            read.map_err(|error| failed(ErrorKind::ConnectionReset, &format!("the answer ended early: {error}")))?;
        if read as u64 == count {
            return Ok((version, bytes));
        }
        Err(failed(ErrorKind::ConnectionReset, &format!("{count} bytes expected from the server, {read} found")))
    }
}

/// Reads certificates.
fn certificates(path: &Path) -> Result<RootCerts> {
    let pem = read::bytes(path, read::MOST_SETTINGS_BYTES)?;
    let found = parse_pem(&pem).filter_map(|item| match item {
        Ok(PemItem::Certificate(certificate)) => Some(certificate),
        _ => None,
    });
    Ok(found.collect::<Vec<_>>().into())
}

/// Returns whether a failure of this kind may pass.
fn may_pass(kind: ErrorKind) -> bool {
    !matches!(
        kind,
        ErrorKind::NotFound | ErrorKind::PermissionDenied | ErrorKind::Unsupported | ErrorKind::ConnectionAborted
    )
}

fn failed(kind: ErrorKind, what: &str) -> io::Error {
    io::Error::new(kind, what)
}

/// Converts the library's errors.
fn refusal(error: ureq::Error) -> io::Error {
    let kind = match &error {
        ureq::Error::Timeout(_) => ErrorKind::TimedOut,
        ureq::Error::Io(_) | ureq::Error::Protocol(_) | ureq::Error::HostNotFound | ureq::Error::ConnectionFailed => {
            ErrorKind::ConnectionReset
        }
        _ => ErrorKind::Unsupported,
    };
    failed(kind, &error.to_string())
}

/// Refuses all answers but those with a range.
fn check_status(response: &Response<Body>) -> io::Result<()> {
    let status = response.status();
    let kind = match status.as_u16() {
        206 => return Ok(()),
        200 => {
            let what = "a server of byte ranges expected, found one that sends whole files";
            return Err(failed(ErrorKind::Unsupported, what));
        }
        404 | 410 => ErrorKind::NotFound,
        401 | 403 | 407 => ErrorKind::PermissionDenied,
        // Behind the end of the file.
        416 => ErrorKind::ConnectionAborted,
        408 | 425 | 429 | 500..=599 => ErrorKind::ConnectionReset,
        _ => ErrorKind::Unsupported,
    };
    Err(failed(kind, &format!("the server answers {status}")))
}

/// Returns the range of an answer, and the length of the whole file.
fn content_range(headers: &HeaderMap) -> io::Result<(Range<u64>, u64)> {
    let text = headers.get(header::CONTENT_RANGE).and_then(|value| value.to_str().ok()).unwrap_or_default();
    let parsed = || {
        let (range, length) = text.strip_prefix("bytes ")?.split_once('/')?;
        let (first, last) = range.split_once('-')?;
        let end = last.parse::<u64>().ok()?.checked_add(1)?;
        Some((first.parse().ok()?..end, length.parse().ok()?))
    };
    let unknown = || failed(ErrorKind::Unsupported, &format!("Content-Range with a length expected, found {text:?}"));
    let is_plain = headers.get(header::CONTENT_ENCODING).is_none_or(|value| value == "identity");
    if is_plain { parsed().ok_or_else(unknown) } else { Err(failed(ErrorKind::Unsupported, "an encoded answer found")) }
}
