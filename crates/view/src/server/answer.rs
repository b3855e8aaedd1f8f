use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use http::{Method, Request, Response, StatusCode};
use infonerf_report::{EVENTS_FILE, Events, StepEvent, picture_names};
use serde_json::{Value, json};

use super::control::{COMMANDS, TrainingControl};
use super::fields::Fields;
use super::guard::{Guard, TOKEN};
use super::runs::{Roots, first_field};
use crate::page;

const IMAGE_FOLDERS: [&str; 4] = ["test", "truth", "depth", "error"];
const MAX_POINTS: usize = 400;
/// Content policy: the page may load only from this server and run only its own script, and no page may frame it.
const POLICY: &str = "default-src 'none'; connect-src 'self'; img-src 'self' data:; style-src 'unsafe-inline'; \
                      script-src 'unsafe-inline'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

pub(super) struct Answers {
    pub(super) roots: Roots,
    pub(super) fields: Fields,
    pub(super) guard: Guard,
    pub(super) control: Option<TrainingControl>,
}

impl Answers {
    /// Answers a request. [`Roots`] defines the names of runs.
    pub(super) fn to(&self, request: &Request<()>) -> Response<Vec<u8>> {
        let (path, query) = (request.uri().path(), request.uri().query().unwrap_or_default());
        if let Some(reason) = self.guard.refusal(request, path == "/") {
            return text(StatusCode::FORBIDDEN, &reason);
        }
        let is_command = COMMANDS.contains(&path);
        let method = if is_command { Method::POST } else { Method::GET };
        if *request.method() != method {
            return text(StatusCode::METHOD_NOT_ALLOWED, &format!("expected {method}"));
        }
        if is_command && !self.guard.has_token(request) {
            return text(StatusCode::FORBIDDEN, &format!("{TOKEN}: expected the page's token"));
        }
        let value = |wanted: &str| {
            let mut pairs = form_urlencoded::parse(query.as_bytes());
            pairs.find(|(key, _)| key == wanted).map(|(_, value)| value.into_owned())
        };
        let folder = value("run").and_then(|run| self.roots.resolve(&run));
        let answered = match path {
            "/" => Some(answer(StatusCode::OK, "text/html; charset=utf-8", page::live(&self.guard.token))),
            "/runs" => Some(json_answer(&self.roots.list())),
            "/training" => Some(json_answer(&self.control.as_ref().map_or(Value::Null, TrainingControl::state))),
            _ if is_command => self.control.as_ref().map(|control| {
                control.apply(path);
                json_answer(&control.state())
            }),
            "/field" => folder.map(|folder| match self.fields.package(&folder) {
                Ok(package) => answer(StatusCode::OK, "application/json", package.to_string()),
                Err(error) => text(StatusCode::CONFLICT, &format!("{error:#}")),
            }),
            "/work" => folder.map(|folder| json_answer(&self.fields.work(&folder).into())),
            "/progress" => folder.map(|folder| json_answer(&progress(&folder))),
            "/picture" => folder.zip(value("kind").zip(value("name"))).and_then(|(folder, (kind, name))| {
                let bytes = fs::read(image(&folder, &kind, &name)?).ok()?;
                Some(answer(StatusCode::OK, "image/png", bytes))
            }),
            _ => None,
        };
        answered.unwrap_or_else(|| text(StatusCode::NOT_FOUND, "not found"))
    }
}

/// Returns the path of the image `name` of a kind, if the run in `folder` has it.
fn image(folder: &Path, kind: &str, name: &str) -> Option<PathBuf> {
    let is_plain = !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || "-_".contains(c));
    let known = is_plain && IMAGE_FOLDERS.contains(&kind);
    let path = known.then(|| folder.join(kind).join(format!("{name}.png")).canonicalize().ok())??;
    path.starts_with(folder).then_some(path)
}

/// Collects curves of the first field's training, each point the mean over a range of steps: the total loss, its terms
/// and PSNR; and the test views that have a render and a truth.
fn progress(run: &Path) -> Value {
    let steps = Events::read(&first_field(run).join(EVENTS_FILE)).unwrap_or_default().steps;
    let chunks: Vec<&[StepEvent]> = steps.chunks(steps.len().div_ceil(MAX_POINTS).max(1)).collect();
    let curve = |of: &dyn Fn(&StepEvent) -> Option<f64>| -> Vec<Option<f64>> {
        let mean = |chunk: &&[StepEvent]| {
            let values: Vec<f64> = chunk.iter().filter_map(of).collect();
            (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
        };
        chunks.iter().map(mean).collect()
    };
    let names: BTreeSet<&String> = steps.iter().flat_map(|step| step.losses.keys()).collect();
    let terms: BTreeMap<_, _> = names.iter().map(|&name| (name, curve(&|s| s.losses.get(name).copied()))).collect();
    let views = &picture_names(&run.join("test")) & &picture_names(&run.join("truth"));
    json!({
        "steps": chunks.iter().filter_map(|chunk| chunk.last()).map(|step| step.step).collect::<Vec<_>>(),
        "loss": curve(&|step| step.loss),
        "terms": terms,
        "psnr": curve(&|step| step.psnr),
        "views": views,
    })
}

fn json_answer(value: &Value) -> Response<Vec<u8>> {
    answer(StatusCode::OK, "application/json", value.to_string())
}

fn text(status: StatusCode, words: &str) -> Response<Vec<u8>> {
    answer(status, "text/plain; charset=utf-8", words)
}

fn answer(status: StatusCode, kind: &str, body: impl Into<Vec<u8>>) -> Response<Vec<u8>> {
    let response = Response::builder()
        .status(status)
        .header("content-type", kind)
        .header("content-security-policy", POLICY)
        .header("x-frame-options", "DENY")
        .header("cross-origin-resource-policy", "same-origin")
        .header("x-content-type-options", "nosniff")
        .header("cache-control", "no-store")
        .body(body.into());
    response.unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_are_thinned_out() {
        let folder = tempfile::tempdir().unwrap();
        let line = |step: usize| {
            let terms = if step > 500 { r#"{"rgb":2.0,"kl":-0.5}"# } else { r#"{"rgb":1.0}"# };
            format!("{{\"event\":\"step\",\"step\":{step},\"loss\":-{step},\"losses\":{terms},\"psnr\":null}}\n")
        };
        fs::write(folder.path().join("metrics.jsonl"), (1..=1000).map(line).collect::<String>()).unwrap();
        let found = progress(folder.path());
        assert_eq!((found["steps"].as_array().unwrap().len(), &found["steps"][0]), (334, &json!(3.0)));
        // Values of 0 and less are kept; a term has no value before it begins.
        assert_eq!((&found["loss"][0], &found["psnr"][0]), (&json!(-2.0), &Value::Null));
        let terms = &found["terms"];
        assert_eq!((&terms["rgb"][0], &terms["kl"][0], &terms["kl"][333]), (&json!(1.0), &Value::Null, &json!(-0.5)));
    }
}
