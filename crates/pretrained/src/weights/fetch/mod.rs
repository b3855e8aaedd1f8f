use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use sha2::{Digest, Sha256};
use ureq::http::StatusCode;
use ureq::{Agent, Body, http::Response};

use super::{KNOWN_WEIGHTS, KnownWeights, Store, WeightsError};
use crate::file::WeightFile;

/// Progress of a download.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DownloadProgress {
    /// Name of the weights.
    pub weights: &'static str,
    /// Bytes that have arrived.
    pub done: u64,
    /// Bytes of the file.
    pub total: u64,
}

type Report<'a> = &'a mut dyn FnMut(DownloadProgress);

const CHUNK: usize = 64 * 1024;
/// Time limit for accepting a connection, and for beginning an answer.
const TIMEOUT: Duration = Duration::from_secs(30);

impl Store {
    /// Downloads the weights called `name` and their companions, unless they are present: verifies the checksum of each file
    /// and keeps its needed tensors, as [`Store::import`] does. An interrupted download resumes. Returns the files.
    ///
    /// # Errors
    /// If no weights have this name, a file does not arrive or is another one, or the folder cannot be written.
    pub fn fetch(&self, name: &str, progress: &mut dyn FnMut(DownloadProgress)) -> Result<Vec<PathBuf>, WeightsError> {
        let unknown = |name: &str| {
            let known = KNOWN_WEIGHTS.iter().map(|weights| weights.name).collect::<Vec<_>>().join(", ");
            WeightsError(format!("no weights are called `{name}`; known: {known}"))
        };
        let named = |name: &str| KnownWeights::named(name).ok_or_else(|| unknown(name));
        let companions = named(name)?.companions;
        let fetched = |name: &&str| {
            let weights = named(name)?;
            self.find(weights).map_or_else(|| self.fetch_file(weights, progress), Ok)
        };
        [name].iter().chain(companions).map(fetched).collect()
    }

    /// Downloads the file of `weights`, and returns the path of the needed tensors.
    fn fetch_file(&self, weights: &KnownWeights, progress: Report<'_>) -> Result<PathBuf, WeightsError> {
        let folder = &self.folders()[0];
        std::fs::create_dir_all(folder).map_err(|error| WeightsError::io(folder, &error))?;
        let part = folder.join(format!("{}.part", weights.published_file()));
        download(weights, &part, progress)?;
        let found = sha256(&part)?;
        if found != weights.sha256 {
            std::fs::remove_file(&part).map_err(|error| WeightsError::io(&part, &error))?;
            let (url, expected) = (weights.url, weights.sha256);
            let fault = format!("{url}: wrong checksum: SHA-256 is {found}, expected {expected}; nothing was kept");
            return Err(WeightsError(fault));
        }
        let tensors = WeightFile::read(&part).map_err(WeightsError)?;
        let path = self.keep(weights, &tensors)?;
        drop(tensors);
        std::fs::remove_file(&part).map_err(|error| WeightsError::io(&part, &error))?;
        Ok(path)
    }
}

/// Downloads the file `part` from where it ends to its full length.
fn download(weights: &KnownWeights, part: &Path, progress: Report<'_>) -> Result<(), WeightsError> {
    let kept = std::fs::metadata(part).map_or(0, |metadata| metadata.len());
    if kept == weights.bytes {
        return Ok(());
    }
    let KnownWeights { url, bytes: total, .. } = *weights;
    // A partial file that is too long belongs to another download.
    let (response, mut done) = open(url, if kept < total { kept } else { 0 })?;
    if let Some(found) = response.body().content_length().map(|rest| done + rest).filter(|all| *all != total) {
        return Err(WeightsError(format!("{url}: the server offers {found} bytes, expected {total}")));
    }

    let file = OpenOptions::new().create(true).write(true).append(done > 0).truncate(done == 0).open(part);
    let mut file = file.map_err(|error| WeightsError::io(part, &error))?;
    let mut body = response.into_body().into_reader();
    let mut chunk = vec![0; CHUNK];
    while done < total {
        progress(DownloadProgress { weights: weights.name, done, total });
        // A broken connection counts as one that ends early: the partial file stays, and the next attempt resumes there.
        let count = body.read(&mut chunk).unwrap_or(0);
        if count == 0 {
            let kept = format!("{done} of {total} bytes; what has arrived is kept; try again to resume");
            return Err(WeightsError(format!("{url}: the connection ended after {kept}")));
        }
        file.write_all(&chunk[..count]).map_err(|error| WeightsError::io(part, &error))?;
        done += count as u64;
    }
    progress(DownloadProgress { weights: weights.name, done, total });
    Ok(())
}

/// Requests the file from byte `start` on, or all of it if the server cannot resume; returns the answer and its first byte.
fn open(url: &str, start: u64) -> Result<(Response<Body>, u64), WeightsError> {
    let config = Agent::config_builder()
        .http_status_as_error(false)
        .timeout_connect(Some(TIMEOUT))
        .timeout_recv_response(Some(TIMEOUT));
    let mut request = Agent::new_with_config(config.build()).get(url);
    if start > 0 {
        request = request.header("Range", format!("bytes={start}-"));
    }
    let connection = |cause: ureq::Error| {
        let way_out = "without a network, `infonerf weights import FILE` takes a copy";
        WeightsError(format!("no connection to {url}: {cause}; {way_out}"))
    };
    let response = request.call().map_err(connection)?;
    let range = response.headers().get("content-range").and_then(|range| range.to_str().ok());
    let goes_on = start > 0 && range.is_some_and(|range| range.starts_with(&format!("bytes {start}-")));
    match response.status() {
        StatusCode::OK => Ok((response, 0)),
        StatusCode::PARTIAL_CONTENT if goes_on => Ok((response, start)),
        _ if start > 0 => open(url, 0),
        status => Err(WeightsError(format!("{url}: the server answered with HTTP status {}", status.as_u16()))),
    }
}

fn sha256(path: &Path) -> Result<String, WeightsError> {
    let mut sum = Sha256::new();
    let copied = File::open(path).and_then(|mut file| std::io::copy(&mut file, &mut sum));
    copied.map_err(|error| WeightsError::io(path, &error))?;
    Ok(format!("{:x}", sum.finalize()))
}

#[cfg(test)]
mod tests;
