use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use sha2::{Digest, Sha256};
use ureq::http::StatusCode;
use ureq::{Agent, Body, http::Response};

use super::{KnownWeights, Store, WeightsError};
use crate::WeightFile;

/// How far a download is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// What is downloaded.
    pub weights: &'static str,
    /// Bytes that have arrived.
    pub done: u64,
    /// Bytes of the file.
    pub total: u64,
}

const CHUNK: usize = 64 * 1024;
/// How long a server may take to accept a connection, and to begin its answer.
const PATIENCE: Duration = Duration::from_secs(30);

impl Store {
    /// Downloads the weights called `name` and their companions, unless they are here already: checks the sum of each file
    /// and keeps what is needed of it in the first folder, as [`Store::import`] does. A download that was cut off resumes
    /// where it ended. Gives the files.
    ///
    /// # Errors
    /// [`WeightsError::Unknown`], and as [`Store::fetch_file`].
    pub fn fetch(&self, name: &str, progress: &mut dyn FnMut(Progress)) -> Result<Vec<PathBuf>, WeightsError> {
        let named =
            |name: &str| KnownWeights::named(name).ok_or_else(|| WeightsError::Unknown { name: name.to_owned() });
        let companions = named(name)?.companions;
        let fetched = |name: &&str| {
            let weights = named(name)?;
            self.find(weights).map_or_else(|| self.fetch_file(weights, progress), Ok)
        };
        [name].iter().chain(companions).map(fetched).collect()
    }

    /// Downloads one file.
    ///
    /// # Errors
    /// [`WeightsError::Connection`], [`WeightsError::Status`], [`WeightsError::Length`], [`WeightsError::Truncated`],
    /// [`WeightsError::Checksum`], [`WeightsError::NoSpace`], or [`WeightsError::File`] if the folder cannot be written.
    pub fn fetch_file(
        &self,
        weights: &KnownWeights,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<PathBuf, WeightsError> {
        let folder = self.target();
        std::fs::create_dir_all(folder).map_err(|error| WeightsError::io(folder, &error))?;
        let part = folder.join(format!("{}.part", weights.published_file()));
        download(weights, &part, progress)?;
        let found = sha256(&part)?;
        if found != weights.sha256 {
            remove(&part)?;
            let (url, expected) = (weights.url.to_owned(), weights.sha256.to_owned());
            return Err(WeightsError::Checksum { url, found, expected });
        }
        let tensors = WeightFile::read(&part).map_err(|cause| WeightsError::File { path: part.clone(), cause })?;
        let path = self.keep(weights, &tensors, &part)?;
        drop(tensors);
        remove(&part)?;
        Ok(path)
    }
}

/// Brings the file `part` to its full length, from where it ends.
fn download(weights: &KnownWeights, part: &Path, progress: &mut dyn FnMut(Progress)) -> Result<(), WeightsError> {
    let kept = std::fs::metadata(part).map_or(0, |metadata| metadata.len());
    if kept == weights.bytes {
        return Ok(());
    }
    // A part that is too long is none.
    let (response, mut done) = open(weights.url, if kept < weights.bytes { kept } else { 0 })?;
    if let Some(found) = response.body().content_length().map(|rest| done + rest).filter(|all| *all != weights.bytes) {
        return Err(WeightsError::Length { url: weights.url.to_owned(), found, expected: weights.bytes });
    }

    let file = OpenOptions::new().create(true).write(true).append(done > 0).truncate(done == 0).open(part);
    let mut file = file.map_err(|error| WeightsError::io(part, &error))?;
    let mut body = response.into_body().into_reader();
    let mut chunk = vec![0; CHUNK];
    while done < weights.bytes {
        progress(Progress { weights: weights.name, done, total: weights.bytes });
        // A connection that breaks is one that ends early: what has arrived stays, and the next attempt resumes there.
        let count = body.read(&mut chunk).unwrap_or(0);
        if count == 0 {
            return Err(WeightsError::Truncated { url: weights.url.to_owned(), done, total: weights.bytes });
        }
        file.write_all(&chunk[..count]).map_err(|error| WeightsError::io(part, &error))?;
        done += count as u64;
    }
    progress(Progress { weights: weights.name, done, total: weights.bytes });
    Ok(())
}

/// The answer with the file from byte `start` on, or with all of it where the server cannot do that; and its first byte.
fn open(url: &str, start: u64) -> Result<(Response<Body>, u64), WeightsError> {
    let config = Agent::config_builder()
        .http_status_as_error(false)
        .timeout_connect(Some(PATIENCE))
        .timeout_recv_response(Some(PATIENCE));
    let mut request = Agent::new_with_config(config.build()).get(url);
    if start > 0 {
        request = request.header("Range", format!("bytes={start}-"));
    }
    let connection = |error: ureq::Error| WeightsError::Connection { url: url.to_owned(), cause: error.to_string() };
    let response = request.call().map_err(connection)?;
    let range = response.headers().get("content-range").and_then(|range| range.to_str().ok());
    let goes_on = start > 0 && range.is_some_and(|range| range.starts_with(&format!("bytes {start}-")));
    match response.status() {
        StatusCode::OK => Ok((response, 0)),
        StatusCode::PARTIAL_CONTENT if goes_on => Ok((response, start)),
        _ if start > 0 => open(url, 0),
        status => Err(WeightsError::Status { url: url.to_owned(), status: status.as_u16() }),
    }
}

/// SHA-256 of a file, in hexadecimal digits.
fn sha256(path: &Path) -> Result<String, WeightsError> {
    let io = |error: std::io::Error| WeightsError::io(path, &error);
    let mut file = File::open(path).map_err(io)?;
    let (mut sum, mut chunk) = (Sha256::new(), vec![0; CHUNK]);
    loop {
        match file.read(&mut chunk).map_err(io)? {
            0 => break,
            count => sum.update(&chunk[..count]),
        }
    }
    Ok(sum.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
}

fn remove(path: &Path) -> Result<(), WeightsError> {
    std::fs::remove_file(path).map_err(|error| WeightsError::io(path, &error))
}

#[cfg(test)]
mod tests;
