//! Answers of the server to good and bad requests.

use std::fs;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use crate::common::{TINY, device, plan, serve, train};
use http::Response;
use infonerf_view::{Server, TrainingControl};
use serde_json::Value;

/// Sends a request with additional headers through an independent client.
fn request(method: &str, address: SocketAddr, path: &str, headers: &[(&str, &str)]) -> Response<Vec<u8>> {
    let agent = ureq::Agent::from(ureq::config::Config::builder().http_status_as_error(false).build());
    let built = http::Request::builder().method(method).uri(format!("http://{address}{path}"));
    let built = headers.iter().fold(built, |built, (name, value)| built.header(*name, *value));
    agent.run(built.body(()).unwrap()).unwrap().map(|mut body| body.read_to_vec().unwrap())
}

fn get(address: SocketAddr, path: &str) -> (u16, Vec<u8>) {
    let answer = request("GET", address, path, &[]);
    (answer.status().as_u16(), answer.into_body())
}

fn json(address: SocketAddr, path: &str) -> Value {
    let (status, body) = get(address, path);
    assert_eq!(status, 200, "{path}: {}", String::from_utf8_lossy(&body));
    serde_json::from_slice(&body).unwrap()
}

fn connect(address: SocketAddr) -> TcpStream {
    let stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    stream
}

/// Sends the bytes of a request, and returns the status of the answer.
fn status(address: SocketAddr, request: &str) -> u16 {
    let mut stream = connect(address);
    stream.write_all(request.as_bytes()).unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    answer[9..12].parse().unwrap()
}

#[test]
fn only_the_servers_own_page_pauses_and_stops_training() {
    let folder = tempfile::tempdir().unwrap();
    let training = TrainingControl::default();
    let address = serve(folder.path(), Some(training.clone()));
    let post = |path: &str, headers: &[(&str, &str)]| request("POST", address, path, headers).status().as_u16();
    assert!(!training.is_watched(Duration::from_secs(60)));
    assert_eq!(json(address, "/training"), serde_json::json!({ "paused": false, "stopped": false }));
    assert!(training.is_watched(Duration::from_secs(60)));
    let page = String::from_utf8(get(address, "/").1).unwrap();
    let token = page.split_once("name=\"infonerf-token\" content=\"").unwrap().1.split_once('"').unwrap().0;
    let held = ("x-infonerf-token", token);
    let own = format!("http://{address}");
    // Without the token, with another token, or with the token from another page, commands are refused.
    for headers in [
        &[][..],
        &[("x-infonerf-token", "page")],
        &[("x-infonerf-token", &"0".repeat(32))],
        &[held, ("origin", "http://evil.example")],
        &[held, ("origin", "null")],
        &[held, ("origin", "http://localhost:1")],
        &[held, ("origin", &own.replace("http:", "https:"))],
        &[held, ("host", "evil.example")],
        &[held, ("host", &format!("evil.example:{}", address.port()))],
        &[held, ("host", "127.0.0.1:1")],
        &[held, ("sec-fetch-site", "cross-site")],
        &[held, ("sec-fetch-site", "same-site")],
    ] {
        for path in ["/pause", "/stop"] {
            assert_eq!(post(path, headers), 403, "{path} {headers:?}");
        }
    }
    assert_eq!(get(address, "/pause").0, 405);
    assert!(!training.is_paused() && !training.is_stopped());
    assert_eq!(post("/pause", &[held, ("origin", &own), ("sec-fetch-site", "same-origin")]), 200);
    assert!(training.is_paused());
    post("/resume", &[held]);
    post("/stop", &[held, ("host", &format!("localhost:{}", address.port()))]);
    assert!(!training.is_paused() && training.is_stopped());
    training.end();
    let alone = serve(folder.path(), None);
    assert_eq!((json(address, "/training"), json(alone, "/training")), (Value::Null, Value::Null));
}

#[test]
fn other_pages_neither_read_nor_frame_the_page() {
    let (_folder, address) = stand_in();
    let port = address.port();
    let status = |headers: &[(&str, &str)]| request("GET", address, "/runs", headers).status().as_u16();
    for (name, value, expected) in [
        ("host", &*format!("[::1]:{port}"), 200),
        ("host", "localhost", 403),
        ("origin", "http://evil.example", 403),
        ("sec-fetch-site", "cross-site", 403),
        ("sec-fetch-site", "none", 200),
    ] {
        assert_eq!(status(&[(name, value)]), expected, "{name}: {value}");
    }
    let page = request("GET", address, "/", &[("sec-fetch-site", "cross-site")]);
    assert_eq!(page.status(), 200, "a link on another page may lead here");
    assert!(page.headers()["content-security-policy"].to_str().unwrap().contains("frame-ancestors 'none'"));
    assert_eq!(page.headers()["x-frame-options"], "DENY");
    assert!(!page.headers().contains_key("access-control-allow-origin"));
}

/// A finished run's package is read again by another server, until there is a newer checkpoint.
#[test]
fn run_is_followed_while_it_trains_and_kept_when_it_has_ended() {
    let out = tempfile::tempdir().unwrap();
    let plan = plan("infonerf", TINY);
    let folder = train(out.path(), &plan, Some(2));
    let address = serve(out.path(), None);
    let (status, page) = get(address, "/");
    assert!(status == 200 && page.starts_with(b"<!doctype html>"));
    let run = "0%2Ffast-losses%2Fcrane%2Finfonerf%2Fseed0";
    let before = json(address, "/runs");
    assert_eq!(before[0]["run"], "0/fast-losses/crane/infonerf/seed0");
    assert_eq!(before[0]["state"], "training");
    let field = json(address, &format!("/field?run={run}"));
    assert_eq!(field["note"], "2 steps");
    assert_eq!(field["cameras"].as_array().unwrap().len(), 4);
    assert_eq!(json(address, &format!("/progress?run={run}"))["steps"].as_array().unwrap().len(), 2);

    train(out.path(), &plan, None);
    let after = json(address, "/runs");
    assert_eq!(after[0]["state"], "finished");
    assert_ne!(after[0]["stamp"], before[0]["stamp"]);
    let field = json(address, &format!("/field?run={run}"));
    assert_eq!(field["note"], "4 steps");
    let progress = json(address, &format!("/progress?run={run}"));
    assert_eq!(progress["terms"]["rgb"].as_array().unwrap().len(), 4);
    assert_eq!(progress["views"], serde_json::json!(["000", "001"]));
    let (status, image) = get(address, &format!("/picture?run={run}&kind=truth&name=001"));
    assert!(status == 200 && image.starts_with(b"\x89PNG"));

    let file = folder.join("viewer.json");
    let text = fs::read_to_string(&file).unwrap();
    let (line, package) = text.split_once('\n').unwrap();
    assert_eq!(serde_json::from_str::<Value>(package).unwrap(), field);
    fs::write(&file, format!("{line}\n{{\"note\":\"kept\"}}")).unwrap();
    assert_eq!(json(serve(&folder, None), "/field?run=0/.")["note"], "kept");
    let manifest = folder.join("checkpoint/manifest.json");
    fs::write(&manifest, fs::read(&manifest).unwrap()).unwrap();
    assert_eq!(json(serve(&folder, None), "/field?run=0/.")["note"], "4 steps");
}

/// A run whose checkpoint takes long to read does not delay other runs, and its work is named.
#[cfg(unix)]
#[test]
fn runs_are_packed_independently() {
    let out = tempfile::tempdir().unwrap();
    let [slow, quick] = ["factored", "infonerf"].map(|variant| {
        let folder = train(out.path(), &plan(variant, TINY), None);
        (format!("0/{}", folder.strip_prefix(out.path()).unwrap().display()), folder)
    });
    let manifest = slow.1.join("checkpoint/manifest.json");
    fs::remove_file(&manifest).unwrap();
    assert!(std::process::Command::new("mkfifo").arg(&manifest).status().unwrap().success());
    let address = serve(out.path(), None);
    let path = format!("/field?run={}", slow.0);
    let waiting = std::thread::spawn(move || get(address, &path));
    let start = Instant::now();
    while json(address, &format!("/work?run={}", slow.0)) != "Reading the field" {
        assert!(start.elapsed() < Duration::from_secs(60), "the work has no name");
        std::thread::sleep(Duration::from_millis(20));
    }
    assert_eq!(json(address, &format!("/field?run={}", quick.0))["note"], "4 steps");
    assert!(!waiting.is_finished());
    // Closing the pipe ends the reading.
    drop(fs::OpenOptions::new().write(true).open(&manifest).unwrap());
    waiting.join().unwrap();
}

#[test]
fn fields_of_other_kinds_are_baked() {
    let out = tempfile::tempdir().unwrap();
    let nerf = "field={kind=\"nerf\",layers=1,width=8,skip=0,position_frequencies=2,direction_frequencies=1,\
                density=\"softplus\",detail=1.0}";
    let others = TINY.split(' ').filter(|setting| !setting.starts_with("field."));
    let settings: Vec<&str> = others.chain([nerf, "loss.tv.weight=0"]).collect();
    let plan = plan("factored", &settings.join(" "));
    // The field is baked coarsely while it trains.
    let folder = train(out.path(), &plan, Some(2));
    let address = serve(&folder, None);
    let live = json(address, "/field?run=0/.");
    assert_eq!(live["voxels"], 96);
    assert_eq!(live["note"], "2 steps; an approximation of the field, baked to 96 voxels along its box");
    assert_eq!(live["cameras"].as_array().unwrap().len(), 4);
    train(out.path(), &plan, None);
    let finished = json(address, "/field?run=0/.");
    assert!(finished["voxels"].as_u64().unwrap() > 96 && finished["note"].as_str().unwrap().starts_with("4 steps"));
}

/// Makes a folder that looks like a run, with a secret outside of it, and serves it.
fn stand_in() -> (tempfile::TempDir, SocketAddr) {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("runs/a");
    fs::create_dir_all(run.join("test")).unwrap();
    fs::write(run.join("config.toml"), "").unwrap();
    fs::write(run.join("test/000.png"), "image").unwrap();
    fs::write(folder.path().join("config.toml"), "secret").unwrap();
    fs::create_dir(folder.path().join("test")).unwrap();
    fs::write(folder.path().join("test/000.png"), "secret").unwrap();
    let address = serve(&folder.path().join("runs"), None);
    (folder, address)
}

#[test]
fn nothing_outside_the_folder_is_served() {
    let (folder, address) = stand_in();
    assert_eq!(get(address, "/picture?run=0/a&kind=test&name=000"), (200, b"image".to_vec()));
    #[cfg(unix)]
    std::os::unix::fs::symlink(folder.path().join("test/000.png"), folder.path().join("runs/a/test/001.png")).unwrap();
    let outside = format!("0/{}", folder.path().display());
    let runs = ["0/..", "0/a/../..", "0/%2e%2e", "0", "1/a", "-1/.", "a", &outside];
    let names = ["../../../test/000", "001", "000.png", "", "%00"];
    let paths = "/config.toml /../config.toml /..%2fconfig.toml //etc/passwd /field /field?run=0/.. /progress?run=0/.. \
                 /picture?run=0/a&kind=../../test&name=000 /picture?run=0/a&kind=checkpoint&name=000";
    let paths = paths.split(' ').map(str::to_owned);
    let paths = paths.chain(runs.map(|run| format!("/picture?run={run}&kind=test&name=000")));
    for path in paths.chain(names.map(|name| format!("/picture?run=0/a&kind=test&name={name}"))) {
        let (status, said) = get(address, &path);
        assert!((400..500).contains(&status), "{path}: {status}");
        assert!(!String::from_utf8_lossy(&said).contains("secret"), "{path}");
    }
}

#[test]
fn other_methods_and_malformed_requests_are_refused() {
    let (_folder, address) = stand_in();
    let host = format!("Host: {address}\r\n");
    for (request, expected) in [
        (format!("GET /runs HTTP/1.1\r\n{host}\r\n"), 200),
        (format!("GET http://{address}/runs HTTP/1.1\r\n{host}\r\n"), 200),
        (format!("GET http://evil.example/runs HTTP/1.1\r\n{host}\r\n"), 403),
        (format!("GET /runs HTTP/1.1\r\n{host}Host: evil.example\r\n\r\n"), 403),
        ("GET /runs HTTP/1.1\r\n\r\n".into(), 403),
        (format!("POST /runs HTTP/1.1\r\n{host}Content-Length: 4\r\n\r\nbody"), 405),
        (format!("GET /runs HTTP/1.1\r\n{host}{}\r\n", "A: b\r\n".repeat(100)), 431),
        ("nonsense\r\n\r\n".into(), 400),
        ("GET / HTTP/9.9\r\n\r\n".into(), 400),
    ] {
        assert_eq!(status(address, &request), expected, "{request}");
    }
}

#[test]
fn header_of_ten_megabytes_is_cut_off() {
    let (_folder, address) = stand_in();
    let mut stream = connect(address);
    stream.write_all(format!("GET /runs HTTP/1.1\r\nHost: {address}\r\n").as_bytes()).unwrap();
    let line = format!("X: {}\r\n", "x".repeat(1 << 10));
    // The server closes the connection before it has read the whole header.
    let sent = (0..10_000).take_while(|_| stream.write_all(line.as_bytes()).is_ok()).count();
    assert!(sent < 10_000, "all of it was read");
    assert_eq!(get(address, "/runs").0, 200);
}

#[test]
fn server_answers_after_a_thousand_connections() {
    let (_folder, address) = stand_in();
    // In waves, as client and server share one process's limit of open files.
    for _ in 0..4 {
        let mut wave: Vec<TcpStream> = (0..250).map(|_| connect(address)).collect();
        for stream in wave.iter_mut().take(100) {
            // The client sends a request, and closes the connection before the answer.
            stream.write_all(format!("GET / HTTP/1.1\r\nHost: {address}\r\n\r\n").as_bytes()).unwrap();
        }
    }
    assert_eq!(get(address, "/runs").0, 200);
    // While other clients send nothing, requests are answered within their timeout.
    let silent: Vec<TcpStream> = (0..300).map(|_| connect(address)).collect();
    let start = Instant::now();
    assert_eq!(get(address, "/runs").0, 200);
    assert!(start.elapsed() < Duration::from_secs(12), "{:?}", start.elapsed());
    drop(silent);
}

#[test]
fn error_names_an_address_in_use() {
    let folder = tempfile::tempdir().unwrap();
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap();
    let error = Server::start(&[folder.path().to_owned()], address, device(), None).err().expect("an error");
    assert!(error.to_string().starts_with(&address.to_string()), "{error}");
}
