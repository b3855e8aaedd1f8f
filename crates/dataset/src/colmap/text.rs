//! COLMAP's text files.

use std::collections::BTreeMap;
use std::path::Path;
use std::str::FromStr;

use glam::{DVec2, DVec3};
use infonerf_scene::SceneError;

use super::camera::{MODELS, known};
use super::{ColmapCamera, ColmapImage, pose};

fn lines<'a>(path: &'a Path, text: &'a str) -> impl Iterator<Item = TextLine<'a>> {
    let text = text.trim_start_matches('\u{feff}');
    let line =
        move |(i, text): (usize, &'a str)| TextLine { path, number: i + 1, words: text.split_whitespace().collect() };
    text.lines().enumerate().filter(|(_, line)| !line.trim_start().starts_with('#')).map(line)
}

pub(crate) fn cameras(path: &Path, text: &str) -> Result<BTreeMap<u32, ColmapCamera>, SceneError> {
    let mut cameras = BTreeMap::new();
    for line in lines(path, text).filter(|line| !line.words.is_empty()) {
        let expected = "a camera: number, model, width, height, parameters";
        let id: u32 = line.word(0, expected)?;
        let name: String = line.word(1, expected)?;
        let Some(model) = MODELS.iter().position(|m| m.0 == name && !m.1.is_empty()) else {
            return Err(line.fault(known(), name));
        };
        let size = (line.word(2, expected)?, line.word(3, expected)?);
        let count = MODELS[model].1.len();
        if line.words.len() != 4 + count {
            let expected = format!("{count} numbers after the size, as {name} has them");
            return Err(line.fault(expected, line.words.len().saturating_sub(4)));
        }
        let parameters = (4..4 + count).map(|i| line.word(i, expected)).collect::<Result<_, _>>()?;
        cameras.insert(id, ColmapCamera::new(path, &line.place(), model, size, parameters)?);
    }
    Ok(cameras)
}

pub(crate) fn images(path: &Path, text: &str) -> Result<Vec<ColmapImage>, SceneError> {
    let mut images = Vec::new();
    let mut lines = lines(path, text);
    while let Some(line) = lines.next() {
        // Of the two lines of an image only the second may be empty.
        if line.words.is_empty() {
            continue;
        }
        let expected = "an image: number, quaternion, translation, camera, name";
        let id = line.word(0, expected)?;
        let mut numbers = [0.0; 7];
        for (i, number) in numbers.iter_mut().enumerate() {
            *number = line.word(1 + i, expected)?;
        }
        let [w, x, y, z, tx, ty, tz] = numbers;
        let camera = line.word(8, expected)?;
        if line.words.len() < 10 {
            return Err(line.fault(expected, "no name"));
        }
        let name = line.words[9..].join(" ");
        let pose = pose(path, &line.place(), [w, x, y, z], [tx, ty, tz])?;
        let observations = match lines.next() {
            Some(line) => observations(&line)?,
            None => Vec::new(),
        };
        images.push(ColmapImage { id, name, camera, pose, observations });
    }
    Ok(images)
}

fn observations(line: &TextLine<'_>) -> Result<Vec<(DVec2, u64)>, SceneError> {
    let expected = "positions and points seen there: x, y, number, and so on";
    if !line.words.len().is_multiple_of(3) {
        return Err(line.fault(expected, format!("{} numbers", line.words.len())));
    }
    let mut seen = Vec::new();
    for i in (0..line.words.len()).step_by(3) {
        let point: i64 = line.word(i + 2, expected)?;
        if let Ok(point) = u64::try_from(point) {
            seen.push((DVec2::new(line.word(i, expected)?, line.word(i + 1, expected)?), point));
        }
    }
    Ok(seen)
}

pub(crate) fn points(path: &Path, text: &str) -> Result<BTreeMap<u64, DVec3>, SceneError> {
    let mut points = BTreeMap::new();
    for line in lines(path, text).filter(|line| !line.words.is_empty()) {
        let expected = "a point: number, position, colour, error, track";
        if line.words.len() < 8 {
            return Err(line.fault(expected, format!("{} words", line.words.len())));
        }
        let point = DVec3::new(line.word(1, expected)?, line.word(2, expected)?, line.word(3, expected)?);
        if point.is_finite() {
            points.insert(line.word(0, expected)?, point);
        }
    }
    Ok(points)
}

struct TextLine<'a> {
    path: &'a Path,
    number: usize,
    words: Vec<&'a str>,
}

impl TextLine<'_> {
    fn place(&self) -> String {
        format!("line {}", self.number)
    }

    fn word<T: FromStr>(&self, index: usize, expected: &str) -> Result<T, SceneError> {
        let word = self.words.get(index).ok_or_else(|| self.fault(expected, "too few words"))?;
        word.parse().map_err(|_| self.fault(expected, format!("`{word}`")))
    }

    fn fault(&self, expected: impl Into<String>, found: impl std::fmt::Display) -> SceneError {
        SceneError::field(self.path, self.place(), expected, found)
    }
}
