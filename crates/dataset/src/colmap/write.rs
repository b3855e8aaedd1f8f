//! Writing COLMAP's binary files.

use std::collections::BTreeMap;
use std::path::Path;

use infonerf_scene::SceneError;

use super::{Reconstruction, world_to_camera};
use crate::files::{make_folder, write_file};

impl Reconstruction {
    /// Writes `cameras.bin`, `images.bin` and `points3D.bin` to `dir`, which is made; `colour` is that of a point.
    ///
    /// # Errors
    /// The system refuses.
    pub fn write(&self, dir: &Path, colour: impl Fn(u64) -> [u8; 3]) -> Result<(), SceneError> {
        make_folder(dir)?;
        write_file(&dir.join("cameras.bin"), self.cameras())?;
        write_file(&dir.join("images.bin"), self.images())?;
        write_file(&dir.join("points3D.bin"), self.points(colour))
    }

    fn cameras(&self) -> Vec<u8> {
        let mut out = (self.cameras.len() as u64).to_le_bytes().to_vec();
        for (id, camera) in &self.cameras {
            out.extend(id.to_le_bytes());
            out.extend((camera.model as i32).to_le_bytes());
            out.extend(u64::from(camera.width).to_le_bytes());
            out.extend(u64::from(camera.height).to_le_bytes());
            out.extend(numbers(&camera.parameters));
        }
        out
    }

    fn images(&self) -> Vec<u8> {
        let mut out = (self.images.len() as u64).to_le_bytes().to_vec();
        for image in &self.images {
            let (quaternion, translation) = world_to_camera(&image.pose);
            out.extend(image.id.to_le_bytes());
            out.extend(numbers(&quaternion).chain(numbers(&translation)));
            out.extend(image.camera.to_le_bytes());
            out.extend(image.name.bytes().chain([0]));
            out.extend((image.observations.len() as u64).to_le_bytes());
            for (pixel, point) in &image.observations {
                out.extend(numbers(&pixel.to_array()));
                out.extend(point.to_le_bytes());
            }
        }
        out
    }

    fn points(&self, colour: impl Fn(u64) -> [u8; 3]) -> Vec<u8> {
        // Of each point, who sees it (image, index of the observation), and how far from where it falls.
        let mut tracks: BTreeMap<u64, (Vec<[u32; 2]>, f64)> = BTreeMap::new();
        for image in &self.images {
            let camera = self.camera(image);
            for (index, (pixel, id)) in image.observations.iter().enumerate() {
                let (track, error) = tracks.entry(*id).or_default();
                track.push([image.id, index as u32]);
                let falls = self.points.get(id).and_then(|point| camera.as_ref()?.project_f64(*point));
                *error += falls.map_or(0.0, |falls| falls.distance(*pixel));
            }
        }
        let mut out = (self.points.len() as u64).to_le_bytes().to_vec();
        for (id, position) in &self.points {
            let (track, error) = tracks.get(id).cloned().unwrap_or_default();
            out.extend(id.to_le_bytes());
            out.extend(numbers(&position.to_array()));
            out.extend(colour(*id));
            out.extend((error / track.len().max(1) as f64).to_le_bytes());
            out.extend((track.len() as u64).to_le_bytes());
            out.extend(track.as_flattened().iter().flat_map(|v| v.to_le_bytes()));
        }
        out
    }
}

fn numbers(values: &[f64]) -> impl Iterator<Item = u8> {
    values.iter().flat_map(|v| v.to_le_bytes())
}
