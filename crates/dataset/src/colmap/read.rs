//! Files of a reconstruction: the same values in the same order in binary files (little endian) and in text.

use std::collections::BTreeMap;
use std::fmt::Display;
use std::iter::{self, Enumerate};
use std::path::Path;
use std::str::{FromStr, Lines};

use glam::{DVec2, DVec3};
use infonerf_scene::SceneError;

use super::camera::{MODELS, known, model_name};
use super::{ColmapCamera, ColmapImage, pose};

/// Longest name of an image, in bytes.
const MAX_NAME: usize = 4096;
const EARLY: &str = "it ends early";

/// The values of a file, one after the other.
pub(crate) struct Values<'a> {
    path: &'a Path,
    source: Source<'a>,
}

enum Source<'a> {
    /// Rest of the file, and the number of records in it.
    Binary { rest: &'a [u8], records: u64 },
    /// Remaining lines, number (from 1) of the current line, and its rest without spaces at both ends.
    Text { lines: Enumerate<Lines<'a>>, number: usize, line: &'a str },
}

pub(crate) fn cameras(mut values: Values<'_>) -> Result<BTreeMap<u32, ColmapCamera>, SceneError> {
    let mut cameras = BTreeMap::new();
    while values.next_record()? {
        let id = values.number(u32::from_le_bytes)?;
        let place = values.place(format!("camera {id}"));
        let model = values.model()?;
        let size = (values.side()?, values.side()?);
        let names = MODELS[model].1.iter();
        let parameters = names.map(|_| values.number(f64::from_le_bytes)).collect::<Result<_, _>>()?;
        if let Source::Text { line, .. } = values.source
            && !line.is_empty()
        {
            return Err(values.fault("no more numbers than the model has", format!("`{line}`")));
        }
        cameras.insert(id, ColmapCamera::new(values.path, &place, model, size, parameters)?);
    }
    Ok(cameras)
}

pub(crate) fn images(mut values: Values<'_>) -> Result<Vec<ColmapImage>, SceneError> {
    let mut images = Vec::new();
    while values.next_record()? {
        let id = values.number(u32::from_le_bytes)?;
        let (quaternion, translation) = (values.numbers()?, values.numbers()?);
        let (camera, name) = (values.number(u32::from_le_bytes)?, values.name()?);
        let pose = pose(values.path, &values.place(format!("image {id}")), quaternion, translation)?;
        let mut observations = Vec::new();
        for _ in 0..values.observations()? {
            let pixel = DVec2::from(values.numbers::<2>()?);
            // −1, or the same bits without a sign, stands for no point.
            let point = u64::try_from(values.number(|bytes| i128::from(i64::from_le_bytes(bytes)))?);
            observations.extend(point.ok().filter(|point| *point < u64::MAX).map(|point| (pixel, point)));
        }
        images.push(ColmapImage { id, name, camera, pose, observations });
    }
    Ok(images)
}

pub(crate) fn points(mut values: Values<'_>) -> Result<BTreeMap<u64, DVec3>, SceneError> {
    let mut points = BTreeMap::new();
    while values.next_record()? {
        let (id, point) = (values.u64()?, DVec3::from(values.numbers::<3>()?));
        values.skip_track()?;
        if point.is_finite() {
            points.insert(id, point);
        }
    }
    Ok(points)
}

impl<'a> Values<'a> {
    pub fn binary(path: &'a Path, bytes: &'a [u8]) -> Result<Self, SceneError> {
        let start = Self { path, source: Source::Binary { rest: bytes, records: 0 } };
        let (count, rest) = bytes.split_first_chunk().ok_or_else(|| start.fault("", EARLY))?;
        Ok(Self { path, source: Source::Binary { rest, records: u64::from_le_bytes(*count) } })
    }

    pub fn text(path: &'a Path, text: &'a str) -> Self {
        let lines = text.trim_start_matches('\u{feff}').lines().enumerate();
        Self { path, source: Source::Text { lines, number: 0, line: "" } }
    }

    /// Begins the next record; `false` at the end of the file.
    fn next_record(&mut self) -> Result<bool, SceneError> {
        match &mut self.source {
            Source::Binary { rest: [], records: 0 } => Ok(false),
            Source::Binary { rest, records: 0 } => {
                let more = rest.len();
                Err(self.fault("", format!("{more} more bytes than it says")))
            }
            Source::Binary { records, .. } => {
                *records -= 1;
                Ok(true)
            }
            Source::Text { .. } => Ok(iter::from_fn(|| self.next_line()).any(|words| words > 0)),
        }
    }

    /// Begins the next line of text that is no comment, and returns its number of words.
    fn next_line(&mut self) -> Option<usize> {
        let Source::Text { lines, number, line } = &mut self.source else { return None };
        let (index, next) = lines.find(|(_, line)| !line.trim_start().starts_with('#'))?;
        (*number, *line) = (index + 1, next.trim());
        Some(line.split_whitespace().count())
    }

    fn fault(&self, expected: &str, found: impl Display) -> SceneError {
        if let Source::Binary { .. } = self.source {
            return SceneError::malformed(self.path, "a binary file of a COLMAP reconstruction", found);
        }
        SceneError::field(self.path, self.place(String::new()), expected, found)
    }

    /// Returns the place of a record for errors: the line of text, or `name`.
    fn place(&self, name: String) -> String {
        if let Source::Text { number, .. } = self.source { format!("line {number}") } else { name }
    }

    fn word<T: FromStr>(&mut self) -> Result<T, SceneError> {
        let Source::Text { line, .. } = &mut self.source else { return Err(self.fault("", EARLY)) };
        let (word, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        *line = rest.trim_start();
        if word.is_empty() {
            return Err(self.fault("the values of a COLMAP reconstruction", "too few words"));
        }
        // Some programs write whole numbers as 400.0.
        let parsed = word.parse::<T>().or_else(|_| word.trim_end_matches(".0").parse());
        parsed.map_err(|_| self.fault("a number of a COLMAP reconstruction", format!("`{word}`")))
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], SceneError> {
        if let Source::Binary { rest, .. } = &mut self.source
            && let Some((taken, left)) = rest.split_at_checked(count)
        {
            *rest = left;
            return Ok(taken);
        }
        Err(self.fault("", EARLY))
    }

    /// Returns a number: `N` bytes of a binary file, or a word of text.
    fn number<T: FromStr, const N: usize>(&mut self, from_bytes: fn([u8; N]) -> T) -> Result<T, SceneError> {
        if let Source::Text { .. } = self.source {
            return self.word();
        }
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.take(N)?);
        Ok(from_bytes(bytes))
    }

    fn u64(&mut self) -> Result<u64, SceneError> {
        self.number(u64::from_le_bytes)
    }

    fn numbers<const N: usize>(&mut self) -> Result<[f64; N], SceneError> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = self.number(f64::from_le_bytes)?;
        }
        Ok(numbers)
    }

    /// Returns an image side, or 0 if it does not fit `u32`; 0 is an error later.
    fn side(&mut self) -> Result<u32, SceneError> {
        Ok(u32::try_from(self.u64()?).unwrap_or(0))
    }

    /// Returns the index of a supported model in [`MODELS`].
    fn model(&mut self) -> Result<usize, SceneError> {
        let (model, found) = if let Source::Text { .. } = self.source {
            let name: String = self.word()?;
            (MODELS.iter().position(|model| model.0.eq_ignore_ascii_case(&name)), name)
        } else {
            let number = self.number(u32::from_le_bytes)? as usize;
            (Some(number), model_name(number))
        };
        let is_known = |model: &usize| MODELS.get(*model).is_some_and(|model| !model.1.is_empty());
        let place = self.place("model".into());
        model.filter(is_known).ok_or_else(|| SceneError::field(self.path, place, known(), found))
    }

    /// Returns an image's name: up to a zero byte, or the rest of the line.
    fn name(&mut self) -> Result<String, SceneError> {
        let length = match &self.source {
            Source::Text { line: "", .. } => return Err(self.fault("the name of an image", "none")),
            Source::Text { line, .. } => return Ok((*line).to_owned()),
            Source::Binary { rest, .. } => rest.iter().take(MAX_NAME).position(|&byte| byte == 0),
        };
        let length = length.ok_or_else(|| self.fault("", "it ends early, within an image's name"))?;
        Ok(String::from_utf8_lossy(&self.take(length + 1)?[..length]).into_owned())
    }

    /// Returns the number of observations of an image, which come next; in text they are a line of their own.
    fn observations(&mut self) -> Result<u64, SceneError> {
        if let Source::Binary { .. } = self.source {
            return self.u64();
        }
        let count = self.next_line().unwrap_or(0);
        if !count.is_multiple_of(3) {
            let expected = "positions and points seen there (x, y, number, and so on), or a blank line";
            return Err(self.fault(expected, format!("{count} numbers")));
        }
        Ok(count as u64 / 3)
    }

    /// Skips the colour, error and track of a point.
    fn skip_track(&mut self) -> Result<(), SceneError> {
        if let Source::Text { .. } = self.source {
            return (0..4).try_for_each(|_| self.word::<String>().map(drop));
        }
        self.take(3 + 8)?;
        let track = usize::try_from(self.u64()?).ok().and_then(|count| count.checked_mul(8));
        self.take(track.unwrap_or(usize::MAX)).map(drop)
    }
}
