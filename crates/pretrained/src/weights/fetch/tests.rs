//! Tests of downloads, from a server on this machine.

use std::io::{BufRead, BufReader};
use std::net::TcpListener;
use std::thread::JoinHandle;

use super::*;

/// LPIPS heads by rule; `tests/files.py` made them.
const FILE: &[u8] = include_bytes!("../../../tests/heads.pth");

enum Answer {
    File,
    /// Sends the requested part, but closes the connection after this number of bytes.
    Cut(usize),
    Whole,
    /// Sends the rest of the file from another byte than requested.
    Elsewhere,
    Other(&'static [u8]),
    Status(&'static str),
}

/// Starts a server that publishes `file`, gives these answers and ends; its thread returns the `Range` of each request.
fn serve(file: &[u8], answers: Vec<Answer>) -> (KnownWeights, WeightFolder, JoinHandle<Vec<Option<String>>>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}/models/heads-12345678.pth", listener.local_addr().unwrap());
    let answer = move |answer: Answer| {
        let (mut stream, _) = listener.accept().unwrap();
        let head = BufReader::new(stream.try_clone().unwrap()).lines().map(Result::unwrap);
        let head: Vec<String> = head.take_while(|line| !line.is_empty()).map(|line| line.to_lowercase()).collect();
        let range = head.iter().find_map(|line| line.strip_prefix("range: ")).map(str::to_owned);
        let start = range.as_ref().map_or(0, |range| range["bytes=".len()..].trim_end_matches('-').parse().unwrap());
        let ok = |body: &[u8]| (format!("200 OK\r\nContent-Length: {}", body.len()), body.to_vec());
        let rest = |start: usize| {
            let rest = FILE[start..].to_vec();
            let range = format!("Content-Range: bytes {start}-{}/{}", FILE.len() - 1, FILE.len());
            (format!("206 Partial Content\r\nContent-Length: {}\r\n{range}", rest.len()), rest)
        };
        let kept = if let Answer::Cut(count) = answer { count } else { usize::MAX };
        let (head, body) = match answer {
            Answer::File | Answer::Cut(_) if start > 0 => rest(start),
            Answer::File | Answer::Cut(_) | Answer::Whole => ok(FILE),
            Answer::Elsewhere => rest(start + 1),
            Answer::Other(body) => ok(body),
            Answer::Status(status) => (format!("{status}\r\nContent-Length: 0"), vec![]),
        };
        write!(stream, "HTTP/1.1 {head}\r\nConnection: close\r\n\r\n").unwrap();
        // The client may have closed the connection already.
        let _ = stream.write_all(&body[..kept.min(body.len())]);
        range
    };
    let server = std::thread::spawn(move || answers.into_iter().map(answer).collect());
    (published(url, file), WeightFolder::new(), server)
}

/// Describes the heads of LPIPS as if `file` were published at `url`.
fn published(url: String, file: &[u8]) -> KnownWeights {
    let heads = KnownWeights::named("lpips-alex-heads").unwrap();
    let [url, sha256] = [url, format!("{:x}", Sha256::digest(file))].map(|text| &*text.leak());
    KnownWeights { url, sha256, bytes: file.len() as u64, ..*heads }
}

struct WeightFolder(tempfile::TempDir);

impl WeightFolder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn fetch(&self, weights: &KnownWeights) -> Result<PathBuf, String> {
        Store::in_folder(self.0.path()).fetch_file(weights, &mut |_| {}).map_err(|error| error.to_string())
    }

    fn part(&self) -> PathBuf {
        self.0.path().join("heads-12345678.pth.part")
    }

    fn files(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.0.path()).unwrap();
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    }
}

const KEPT: &str = "lpips-alex-heads.safetensors";

#[test]
fn fetch_reports_progress_and_leaves_only_the_weights() {
    let (weights, folder, server) = serve(FILE, vec![Answer::File]);
    let mut reports = Vec::new();
    let store = Store::in_folder(folder.0.path().join("new"));
    let path = store.fetch_file(&weights, &mut |progress| reports.push(progress)).unwrap();
    let total = FILE.len() as u64;
    assert_eq!(reports[0], DownloadProgress { weights: "lpips-alex-heads", done: 0, total });
    assert_eq!(reports.last().unwrap().done, total);
    assert!(WeightFile::read(&path).unwrap().check("lin4.model.1.weight", &[1, 256, 1, 1]).is_ok());
    assert_eq!(std::fs::read_dir(folder.0.path().join("new")).unwrap().count(), 1);
    assert_eq!(server.join().unwrap(), [None]);
}

#[test]
fn interrupted_downloads_resume() {
    let (weights, folder, server) = serve(FILE, vec![Answer::Cut(1000), Answer::Cut(2000), Answer::File]);
    for done in [1000, 3000] {
        let kept = format!("{done} of {} bytes; what has arrived is kept; try again to resume", FILE.len());
        assert_eq!(folder.fetch(&weights), Err(format!("{}: the connection ended after {kept}", weights.url)));
        assert_eq!(std::fs::read(folder.part()).unwrap(), FILE[..done]);
    }
    folder.fetch(&weights).unwrap();
    assert_eq!(folder.files(), [KEPT]);
    let ranges = [None, Some("bytes=1000-".to_owned()), Some("bytes=3000-".to_owned())];
    assert_eq!(server.join().unwrap(), ranges);
}

#[test]
fn partial_files_are_completed_or_replaced() {
    let (some, twice) = (&FILE[..500], [FILE, FILE].concat());
    let cases = [
        (some, vec![Answer::Whole]),
        (some, vec![Answer::Elsewhere, Answer::File]),
        (some, vec![Answer::Status("416 No"), Answer::File]),
        (&twice, vec![Answer::File]),
        (FILE, vec![]),
    ];
    for (part, answers) in cases {
        let (weights, folder, server) = serve(FILE, answers);
        std::fs::write(folder.part(), part).unwrap();
        folder.fetch(&weights).unwrap();
        assert_eq!(folder.files(), [KEPT]);
        server.join().unwrap();
    }
}

#[test]
fn refusals_are_one_line_and_keep_nothing() {
    let length = FILE.len();
    let checksum = format!("wrong checksum: SHA-256 is {:x}, expected 00ff; nothing was kept", Sha256::digest(FILE));
    for (answer, expected) in [
        (Answer::File, checksum),
        (Answer::Status("404 Not Found"), "the server answered with HTTP status 404".to_owned()),
        (Answer::Other(b"<html>"), format!("the server offers 6 bytes, expected {length}")),
    ] {
        let (weights, folder, server) = serve(FILE, vec![answer]);
        let weights = KnownWeights { sha256: "00ff", ..weights };
        assert_eq!(folder.fetch(&weights), Err(format!("{}: {expected}", weights.url)));
        assert_eq!(folder.files(), [""; 0]);
        server.join().unwrap();
    }
}

#[test]
fn missing_connection_is_one_line_that_names_import() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}/heads-12345678.pth", listener.local_addr().unwrap());
    drop(listener);
    let error = WeightFolder::new().fetch(&published(url.clone(), FILE)).unwrap_err();
    assert!(error.starts_with(&format!("no connection to {url}: ")), "{error}");
    assert!(error.contains("weights import FILE") && !error.contains('\n'), "{error}");
}

#[test]
#[cfg(target_os = "linux")]
fn full_disk_is_one_line() {
    let (weights, folder, server) = serve(FILE, vec![Answer::File]);
    std::os::unix::fs::symlink("/dev/full", folder.part()).unwrap();
    assert_eq!(folder.fetch(&weights), Err(format!("no space left in {}", folder.0.path().display())));
    server.join().unwrap();
}

#[test]
fn other_tensors_are_refused() {
    const OTHER: &[u8] = b"\x08\0\0\0\0\0\0\0{}      ";
    let (weights, folder, server) = serve(OTHER, vec![Answer::Other(OTHER)]);
    let error = folder.fetch(&weights).unwrap_err();
    assert!(error.ends_with("no tensor `lin0.model.1.weight`, expected F32 [1, 64, 1, 1]"), "{error}");
    server.join().unwrap();
}

#[test]
fn present_weights_are_not_fetched_again() {
    let folder = WeightFolder::new();
    let store = Store::in_folder(folder.0.path());
    for name in ["lpips-vgg", "lpips-vgg-heads"] {
        std::fs::write(folder.0.path().join(KnownWeights::named(name).unwrap().file()), b"").unwrap();
    }
    let paths = store.fetch("lpips-vgg", &mut |_| panic!("nothing is downloaded")).unwrap();
    assert_eq!(paths.len(), 2);
    let error = store.fetch("squeeze", &mut |_| {}).unwrap_err().to_string();
    assert!(error.starts_with("no weights are called `squeeze`; known: lpips-alex, lpips-alex-heads,"), "{error}");
}
