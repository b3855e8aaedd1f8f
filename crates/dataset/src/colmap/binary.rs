//! COLMAP's binary files, little endian.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DVec2, DVec3};
use infonerf_scene::SceneError;

use super::camera::{MODELS, known};
use super::{ColmapCamera, ColmapImage, pose};

/// Longest name of an image, in bytes.
const MAX_NAME: usize = 4096;
/// The id that stands for no point.
const NONE: u64 = u64::MAX;

pub(crate) fn cameras(path: &Path, bytes: &[u8]) -> Result<BTreeMap<u32, ColmapCamera>, SceneError> {
    let mut bytes = Bytes { path, rest: bytes };
    let mut cameras = BTreeMap::new();
    for _ in 0..bytes.u64()? {
        let id = bytes.u32()?;
        let place = format!("camera {id}");
        let model = bytes.u32()? as usize;
        let count = MODELS.get(model).map_or(0, |m| m.1.len());
        if count == 0 {
            return Err(SceneError::field(path, place, known(), format!("number {model}")));
        }
        let (width, height) = (bytes.side()?, bytes.side()?);
        let parameters = (0..count).map(|_| bytes.f64()).collect::<Result<_, _>>()?;
        cameras.insert(id, ColmapCamera::new(path, &place, model, (width, height), parameters)?);
    }
    bytes.end()?;
    Ok(cameras)
}

pub(crate) fn images(path: &Path, bytes: &[u8]) -> Result<Vec<ColmapImage>, SceneError> {
    let mut bytes = Bytes { path, rest: bytes };
    let mut images = Vec::new();
    for _ in 0..bytes.u64()? {
        let id = bytes.u32()?;
        let quaternion = bytes.numbers()?;
        let translation = bytes.numbers()?;
        let camera = bytes.u32()?;
        let name = bytes.name()?;
        let pose = pose(path, &format!("image {id}"), quaternion, translation)?;
        let mut observations = Vec::new();
        for _ in 0..bytes.u64()? {
            let [x, y] = bytes.numbers()?;
            let point = bytes.u64()?;
            if point != NONE {
                observations.push((DVec2::new(x, y), point));
            }
        }
        images.push(ColmapImage { id, name, camera, pose, observations });
    }
    bytes.end()?;
    Ok(images)
}

pub(crate) fn points(path: &Path, bytes: &[u8]) -> Result<BTreeMap<u64, DVec3>, SceneError> {
    let mut bytes = Bytes { path, rest: bytes };
    let mut points = BTreeMap::new();
    for _ in 0..bytes.u64()? {
        let id = bytes.u64()?;
        let point = DVec3::from(bytes.numbers::<3>()?);
        // Colour and error.
        bytes.take(3 + 8)?;
        let track = bytes.u64()?;
        bytes.take(usize::try_from(track).ok().and_then(|n| n.checked_mul(8)).unwrap_or(usize::MAX))?;
        if point.is_finite() {
            points.insert(id, point);
        }
    }
    bytes.end()?;
    Ok(points)
}

/// The rest of a file.
struct Bytes<'a> {
    path: &'a Path,
    rest: &'a [u8],
}

impl<'a> Bytes<'a> {
    fn fault(&self, reason: impl std::fmt::Display) -> SceneError {
        SceneError::malformed(self.path, "a binary file of a COLMAP reconstruction", reason)
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], SceneError> {
        let Some((taken, rest)) = self.rest.split_at_checked(count) else {
            return Err(self.fault("it ends early"));
        };
        self.rest = rest;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], SceneError> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N)?);
        Ok(array)
    }

    fn u32(&mut self) -> Result<u32, SceneError> {
        self.array().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Result<u64, SceneError> {
        self.array().map(u64::from_le_bytes)
    }

    fn f64(&mut self) -> Result<f64, SceneError> {
        self.array().map(f64::from_le_bytes)
    }

    fn numbers<const N: usize>(&mut self) -> Result<[f64; N], SceneError> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = self.f64()?;
        }
        Ok(numbers)
    }

    /// Returns an image side; one that is too large for any is 0, which is refused later.
    fn side(&mut self) -> Result<u32, SceneError> {
        Ok(u32::try_from(self.u64()?).unwrap_or(0))
    }

    /// Reads text up to a zero byte.
    fn name(&mut self) -> Result<String, SceneError> {
        let Some(length) = self.rest.iter().take(MAX_NAME).position(|&b| b == 0) else {
            return Err(self.fault("it ends early, within an image's name"));
        };
        let name = String::from_utf8_lossy(self.take(length)?).into_owned();
        self.take(1)?;
        Ok(name)
    }

    fn end(&self) -> Result<(), SceneError> {
        if self.rest.is_empty() {
            Ok(())
        } else {
            Err(self.fault(format!("{} more bytes than it says", self.rest.len())))
        }
    }
}
