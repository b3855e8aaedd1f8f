//! Requests and what is answered.

use std::collections::BTreeSet;
use std::fs;
use std::net::IpAddr;
use std::path::{Path, PathBuf};

use infonerf_experiment::OpenDevice;
use infonerf_report::Events;
use oxhttp::model::{Body, Method, Request, Response, StatusCode};
use serde_json::{Value, json};

use super::control::TrainingControl;
use super::fields::Fields;
use super::routes::Route;
use super::runs::{first_field, list, resolve};
use crate::page;

/// Points of a curve at most.
const MOST_POINTS: usize = 400;
/// A request that changes something has this header. Pages of other sites cannot send it: a browser asks first whether they
/// may, and is not told so.
const OWN_PAGE: &str = "x-infonerf";
/// What the page may load and run: itself, and what this server answers.
const POLICY: &str = "default-src 'none'; connect-src 'self'; img-src 'self' data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'";

/// What the server knows.
pub(super) struct Answers {
    root: PathBuf,
    fields: Fields,
    /// Whether only this machine is answered.
    local: bool,
    /// Of the training beside the server.
    control: Option<TrainingControl>,
}

impl Answers {
    /// Answers about the runs below `root`, a canonical path.
    pub(super) fn new(root: PathBuf, device: OpenDevice, local: bool, control: Option<TrainingControl>) -> Self {
        Self { root, fields: Fields::new(device), local, control }
    }

    /// The answer to a request.
    pub(super) fn to(&self, request: &Request<Body>) -> Response<Body> {
        let uri = request.uri();
        if self.local && !uri.host().is_some_and(is_local) {
            return text(StatusCode::FORBIDDEN, "expected a request to this machine by its own name");
        }
        let nothing = || text(StatusCode::NOT_FOUND, "nothing of this name");
        let route = Route::of(uri.path(), uri.query().unwrap_or_default());
        let method = if matches!(route, Some(Route::Command(_))) { Method::POST } else { Method::GET };
        if *request.method() != method {
            return text(StatusCode::METHOD_NOT_ALLOWED, &format!("expected {method}"));
        }
        match route {
            None => nothing(),
            Some(Route::Command(command)) => match &self.control {
                Some(_) if !request.headers().contains_key(OWN_PAGE) => {
                    text(StatusCode::FORBIDDEN, "expected a request of this server's own page")
                }
                Some(control) => {
                    control.apply(command);
                    json_answer(&control.state())
                }
                None => nothing(),
            },
            Some(Route::Training) => json_answer(&self.control.as_ref().map_or(Value::Null, TrainingControl::state)),
            Some(Route::Page) => answer(StatusCode::OK, "text/html; charset=utf-8", page::live()),
            Some(Route::Runs) => json_answer(&list(&self.root)),
            Some(Route::Field { run }) => self.in_run(&run, |folder| match self.fields.package(folder) {
                Ok(package) => answer(StatusCode::OK, "application/json", package.to_string()),
                Err(error) => text(StatusCode::CONFLICT, &format!("{error:#}")),
            }),
            Some(Route::Progress { run }) => self.in_run(&run, |folder| json_answer(&progress(folder))),
            Some(Route::Picture { run, kind, name }) => self.in_run(&run, |folder| {
                let path = folder.join(kind).join(format!("{name}.png")).canonicalize();
                let inside = path.ok().filter(|path| path.starts_with(folder));
                let bytes = inside.and_then(|path| fs::read(path).ok());
                bytes.map_or_else(nothing, |bytes| answer(StatusCode::OK, "image/png", bytes))
            }),
        }
    }

    fn in_run(&self, run: &str, of: impl Fn(&Path) -> Response<Body>) -> Response<Body> {
        resolve(&self.root, run)
            .map_or_else(|| text(StatusCode::NOT_FOUND, "no run of this name"), |folder| of(&folder))
    }
}

/// Whether a request names this machine as such.
fn is_local(host: &str) -> bool {
    let address = host.trim_start_matches('[').trim_end_matches(']').parse::<IpAddr>();
    host.eq_ignore_ascii_case("localhost") || address.is_ok_and(|address| address.is_loopback())
}

/// Loss and PSNR of the first field's training, thinned out, and the test views that can be compared.
fn progress(run: &Path) -> Value {
    let steps = Events::read(&first_field(run).join("metrics.jsonl")).unwrap_or_default().steps;
    let mut points: Vec<Value> = Vec::new();
    for chunk in steps.chunks(steps.len().div_ceil(MOST_POINTS).max(1)) {
        let mean = |of: fn(&infonerf_report::Step) -> Option<f64>| {
            let values: Vec<f64> = chunk.iter().filter_map(of).collect();
            (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
        };
        points.push(json!([chunk[chunk.len() - 1].step, mean(|step| step.loss), mean(|step| step.psnr)]));
    }
    let views: Vec<String> = pictures(&run.join("test")).intersection(&pictures(&run.join("truth"))).cloned().collect();
    json!({ "points": points, "views": views })
}

/// Stems of the PNG files in a folder.
fn pictures(folder: &Path) -> BTreeSet<String> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let stem = |name: String| name.strip_suffix(".png").map(str::to_owned);
    entries.filter_map(|entry| stem(entry.file_name().into_string().ok()?)).collect()
}

fn json_answer(value: &Value) -> Response<Body> {
    answer(StatusCode::OK, "application/json", value.to_string())
}

fn text(status: StatusCode, words: &str) -> Response<Body> {
    answer(status, "text/plain; charset=utf-8", words.to_owned())
}

fn answer(status: StatusCode, kind: &str, body: impl Into<Body>) -> Response<Body> {
    let response = Response::builder()
        .status(status)
        .header("content-type", kind)
        .header("content-security-policy", POLICY)
        .header("x-content-type-options", "nosniff")
        .header("cache-control", "no-store")
        .body(body.into());
    response.unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_this_machine() {
        for host in ["localhost", "LOCALHOST", "127.0.0.1", "127.8.8.8", "[::1]"] {
            assert!(is_local(host), "{host}");
        }
        for host in ["", "example.com", "localhost.example.com", "192.168.0.1", "0.0.0.0", "[::]"] {
            assert!(!is_local(host), "{host}");
        }
    }

    #[test]
    fn curves_are_thinned_out() {
        let folder = tempfile::tempdir().unwrap();
        let line = |step: usize| format!("{{\"event\":\"step\",\"step\":{step},\"loss\":{step},\"psnr\":null}}\n");
        fs::write(folder.path().join("metrics.jsonl"), (1..=1000).map(line).collect::<String>()).unwrap();
        let progress = progress(folder.path());
        let points = progress["points"].as_array().unwrap();
        assert_eq!((points.len(), &points[0]), (334, &json!([3.0, 2.0, null])));
    }
}
