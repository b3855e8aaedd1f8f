//! Frames as an animated GIF, and as a film by an installed `ffmpeg`.

use std::fs::File;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use anyhow::{Context, Result, bail};
use clap::ValueEnum;
use image::codecs::gif::{GifEncoder, Repeat};
use image::{Delay, Frame, RgbImage, buffer::ConvertBuffer};

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum VideoName {
    /// H.264, which everything plays.
    Mp4,
    /// VP9, free of patents.
    Webm,
}

/// The program, as it is looked for in the folders of PATH.
const PROGRAM: &str = "ffmpeg";
/// H.264 and VP9 with halved chroma want even sides: a row or column of black is added where one is odd.
const EVEN: &str = "pad=ceil(iw/2)*2:ceil(ih/2)*2";

/// An animated GIF, written frame by frame.
///
/// Its file has another name until it is whole.
pub(super) struct Animation {
    path: PathBuf,
    part: PathBuf,
    encoder: GifEncoder<File>,
    delay: Delay,
}

impl Animation {
    /// Returns an animation of `fps` frames per second that repeats for ever.
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

    /// Ends the animation and returns its path.
    pub(super) fn finish(self) -> Result<PathBuf> {
        drop(self.encoder);
        std::fs::rename(&self.part, &self.path).with_context(|| self.path.display().to_string())?;
        Ok(self.path)
    }
}

impl VideoName {
    /// Returns the extension, and the options of the codec.
    fn encoding(self) -> (&'static str, &'static [&'static str]) {
        match self {
            Self::Mp4 => ("mp4", &["-c:v", "libx264", "-crf", "18", "-movflags", "+faststart"]),
            Self::Webm => ("webm", &["-c:v", "libvpx-vp9", "-crf", "24", "-b:v", "0"]),
        }
    }

    /// Checks that there is an `ffmpeg`.
    pub(super) fn check(self) -> Result<()> {
        let (extension, _) = self.encoding();
        match Command::new(PROGRAM).arg("-version").stdin(Stdio::null()).output() {
            Ok(_) => Ok(()),
            Err(error) if error.kind() == ErrorKind::NotFound => bail!(
                "--video {extension}: expected `{PROGRAM}` in a folder of PATH; without --video there is an animated GIF"
            ),
            Err(error) => bail!("--video {extension}: {PROGRAM}: {error}"),
        }
    }

    /// Makes a film of the frames in `folder`, and returns its path.
    pub(super) fn write(self, folder: &Path, name: &str, fps: f64) -> Result<PathBuf> {
        let (extension, codec) = self.encoding();
        let part = format!("{name}.part.{extension}");
        let output = Command::new(PROGRAM)
            .current_dir(folder)
            .args(["-y", "-loglevel", "error", "-framerate", &fps.to_string(), "-i", "%04d.png", "-vf", EVEN])
            .args(codec)
            .args(["-pix_fmt", "yuv420p"])
            // Not an option or a protocol, whatever the path's file is called.
            .arg(format!("./{part}"))
            .stdin(Stdio::null())
            .output()
            .with_context(|| PROGRAM.to_owned())?;
        let path = folder.join(format!("{name}.{extension}"));
        if !output.status.success() {
            let said = String::from_utf8_lossy(&output.stderr);
            let last = said.lines().rfind(|line| !line.trim().is_empty()).unwrap_or("it said nothing");
            bail!("{}: {PROGRAM}: {last}", path.display());
        }
        std::fs::rename(folder.join(part), &path).with_context(|| path.display().to_string())?;
        Ok(path)
    }
}
