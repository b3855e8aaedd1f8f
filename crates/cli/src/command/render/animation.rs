use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, Result};
use image::codecs::gif::{GifEncoder, Repeat};
use image::{Delay, Frame, RgbImage, buffer::ConvertBuffer};

/// An animated GIF, written frame by frame under a temporary name until it is complete.
pub(super) struct Animation {
    path: PathBuf,
    part: PathBuf,
    encoder: GifEncoder<File>,
    delay: Delay,
}

impl Animation {
    pub(super) fn new(path: &Path, fps: f64) -> Result<Self> {
        let part = path.with_extension("gif.part");
        let file = File::create(&part).with_context(|| part.display().to_string())?;
        let mut encoder = GifEncoder::new_with_speed(file, 10);
        encoder.set_repeat(Repeat::Infinite)?;
        let delay = Delay::from_saturating_duration(Duration::from_secs_f64(1.0 / fps));
        Ok(Self { path: path.to_owned(), part, encoder, delay })
    }

    pub(super) fn add(&mut self, picture: &RgbImage) -> Result<()> {
        let frame = Frame::from_parts(picture.convert(), 0, 0, self.delay);
        self.encoder.encode_frame(frame).with_context(|| self.path.display().to_string())
    }

    pub(super) fn finish(self) -> Result<PathBuf> {
        drop(self.encoder);
        std::fs::rename(&self.part, &self.path).with_context(|| self.path.display().to_string())?;
        Ok(self.path)
    }
}
