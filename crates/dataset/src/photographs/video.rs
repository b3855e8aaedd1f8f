//! Photographs extracted from a video by the `ffmpeg` program.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use infonerf_scene::SceneError;
use infonerf_scene::image::list_images;

use super::{MIN_IMAGES, program};
use crate::files::{file_name, make_folder, write_file};

/// Max number of frames that are taken from a video.
const MAX_TAKEN: usize = 24;
/// Min number of frames of the video per frame that is taken.
const MIN_STRETCH: usize = 8;
/// Side, in pixels, of the grey frames whose sharpness is compared; frames of any shape are squeezed to a square.
const SIDE: usize = 640;
/// File below the folder of frames that names their video.
const SOURCE: &str = "video.txt";
const LOG: &str = "ffmpeg.log";
/// Transfer functions of HDR videos: HLG and PQ.
const HDR: [&str; 2] = ["arib-std-b67", "smpte2084"];
/// Filters from HDR to the colours of a screen, with a comma at their end. Some HDR videos do not state that they are in BT.2020.
const TONE_MAPPING: &str = "setparams=color_primaries=bt2020:colorspace=bt2020nc,zscale=t=linear:npl=100,tonemap=hable,\
                            zscale=p=bt709:t=bt709:m=bt709:r=pc,";

/// Takes the sharpest frame of each of up to 24 equal stretches of the file `video`, and writes them as PNG files to
/// the folder `dir`. Does nothing if this video's frames are there. `progress` receives a line for each step.
///
/// # Errors
/// `ffmpeg` is not on PATH or cannot read the video, the video is too short, `dir` has frames of another video, or a file
/// cannot be written.
pub fn video_frames(video: &Path, dir: &Path, mut progress: impl FnMut(&str)) -> Result<(), SceneError> {
    let name = video.display();
    let length = fs::metadata(video).map_err(|e| SceneError::io(video, e))?.len();
    let source = format!("{}\n{length} bytes\n", file_name(video));
    if dir.is_dir() {
        let known = fs::read_to_string(dir.join(SOURCE)).unwrap_or_default();
        // Earlier versions wrote the path as it was typed.
        if known.rsplit('/').next() != Some(source.as_str()) {
            let reason = format!("it is of `{}`; remove it, or give another --out", known.trim().replace('\n', ", "));
            return Err(SceneError::malformed(dir, format!("frames of {name}"), reason));
        }
        progress(&format!("{name}: {} frames are in {}", list_images(dir)?.len(), dir.display()));
        return Ok(());
    }
    let Some(ffmpeg) = program("ffmpeg", std::env::var_os("PATH")) else {
        let reason = "ffmpeg is not on PATH; install it, or give a folder of photographs";
        return Err(SceneError::malformed(video, "the ffmpeg program to take the video apart", reason));
    };
    let partial = dir.with_added_extension("partial");
    let _ = fs::remove_dir_all(&partial);
    make_folder(&partial)?;
    progress(&format!("{name}: looking for sharp frames with ffmpeg"));
    let toned = tone_mapping(&ffmpeg, video, &mut progress);
    let kept = |(count, picks): (usize, Vec<usize>)| {
        let last = list_images(&partial)?.len();
        if last != picks.len() {
            let expected = format!("ffmpeg to write {} frames", picks.len());
            return Err(SceneError::malformed(video, expected, format!("it wrote {last}")));
        }
        write_file(&partial.join(SOURCE), source)?;
        let _ = fs::remove_file(partial.join(LOG));
        fs::rename(&partial, dir).map_err(|e| SceneError::io(dir, e))?;
        let numbers = picks.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
        progress(&format!(
            "{name}: {count} frames, of which the sharpest of each of {last} equal stretches is taken (counted from 0: \
             {numbers}): {} to {last:03}.png",
            dir.join("001.png").display()
        ));
        Ok(())
    };
    take(&ffmpeg, video, &partial, toned).and_then(kept).inspect_err(|_| drop(fs::remove_dir_all(&partial)))
}

/// Returns [`TONE_MAPPING`] for an HDR video, and nothing for others. Warns if ffprobe or the filters are not there.
fn tone_mapping(ffmpeg: &Path, video: &Path, progress: &mut impl FnMut(&str)) -> &'static str {
    let printed = |command: &mut Command| Some(String::from_utf8_lossy(&command.output().ok()?.stdout).into_owned());
    let mut input = OsString::from("file:");
    input.push(video);
    let asked = ["-v", "error", "-select_streams", "v:0", "-show_entries", "stream=color_transfer", "-of", "csv=p=0"];
    let transfer = printed(Command::new("ffprobe").args(asked).arg(input));
    let filters = || printed(Command::new(ffmpeg).args(["-hide_banner", "-filters"])).unwrap_or_default();
    let reason = match transfer {
        Some(transfer) if !HDR.iter().any(|name| transfer.contains(*name)) => return "",
        Some(_) if filters().contains(" zscale ") => return TONE_MAPPING,
        Some(_) => "this ffmpeg has no zscale filter",
        None => "ffprobe is not on PATH to tell whether it is HDR",
    };
    progress(&format!("{}: {reason}: colours of an HDR video will look flat", video.display()));
    ""
}

/// Writes the frames that are taken, after the filters `toned`, to `partial` with 8 bits a channel; returns the number of
/// frames of the video, and which were taken.
fn take(ffmpeg: &Path, video: &Path, partial: &Path, toned: &str) -> Result<(usize, Vec<usize>), SceneError> {
    let small = format!("scale={SIDE}:{SIDE},format=gray");
    let mut child = start(ffmpeg, video, partial, &small, &["-f", "rawvideo", "-"])?;
    let (mut frame, mut sharpness) = (vec![0; SIDE * SIDE], Vec::new());
    if let Some(mut output) = child.stdout.take() {
        while output.read_exact(&mut frame).is_ok() {
            sharpness.push(gradient_energy(&frame, SIDE));
        }
    }
    finish(child, video, partial)?;
    let picks = sharpest(&sharpness);
    if picks.len() < MIN_IMAGES {
        let expected = format!("a video of {} frames or more", MIN_IMAGES * MIN_STRETCH);
        return Err(SceneError::malformed(video, expected, format!("it has {}", sharpness.len())));
    }
    let terms: Vec<String> = picks.iter().map(|pick| format!("eq(n,{pick})")).collect();
    let filter = format!("select='{}',{toned}format=rgb24", terms.join("+"));
    finish(start(ffmpeg, video, partial, &filter, &["%03d.png"])?, video, partial)?;
    Ok((sharpness.len(), picks))
}

/// Starts ffmpeg in `partial` with a filter. Consecutive timestamps make it write each frame exactly once.
fn start(ffmpeg: &Path, video: &Path, partial: &Path, filter: &str, output: &[&str]) -> Result<Child, SceneError> {
    let whole = video.canonicalize().map_err(|e| SceneError::io(video, e))?;
    let log = File::create(partial.join(LOG)).map_err(|e| SceneError::io(partial, e))?;
    let mut input = OsString::from("file:");
    input.push(whole);
    Command::new(ffmpeg)
        .current_dir(partial)
        .args(["-v", "error", "-nostdin", "-y", "-i"])
        .arg(input)
        .args(["-map", "0:v:0", "-vf", &format!("{filter},settb=1/25,setpts=N"), "-r", "25"])
        .args(output)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(log)
        .spawn()
        .map_err(|e| SceneError::io(ffmpeg, e))
}

fn finish(mut child: Child, video: &Path, partial: &Path) -> Result<(), SceneError> {
    let status = child.wait().map_err(|e| SceneError::io(video, e))?;
    if status.success() {
        return Ok(());
    }
    let log = fs::read(partial.join(LOG)).unwrap_or_default();
    let log = String::from_utf8_lossy(&log);
    let last = log.lines().last().unwrap_or_default();
    let reason = if log.contains("matches no streams") { "it has no picture track" } else { last };
    Err(SceneError::malformed(video, "a video that ffmpeg reads", format!("ffmpeg: {status}: {reason}")))
}

/// Returns the sum of squared differences between neighbouring pixels, which blur lowers.
fn gradient_energy(grey: &[u8], width: usize) -> u64 {
    let square = |(a, b): (&u8, &u8)| u64::from(a.abs_diff(*b)).pow(2);
    let along = grey.chunks(width).flat_map(|row| row.iter().zip(&row[1..])).map(square).sum::<u64>();
    along + grey.iter().zip(&grey[width..]).map(square).sum::<u64>()
}

/// Returns the index of the max value in each of up to [`MAX_TAKEN`] equal stretches of at least [`MIN_STRETCH`].
fn sharpest(values: &[u64]) -> Vec<usize> {
    let count = (values.len() / MIN_STRETCH).min(MAX_TAKEN);
    let bound = |i: usize| i * values.len() / count;
    (0..count).filter_map(|i| (bound(i)..bound(i + 1)).max_by_key(|&frame| values[frame])).collect()
}

/// Returns the folder of the frames of `video` below the folder for results `out`: the video's name without extension, in
/// which `_` replaces what some file system does not allow.
pub fn video_folder(video: &Path, out: &Path) -> PathBuf {
    let name = video.file_stem().unwrap_or_default().to_string_lossy();
    let name = name.replace(|c: char| c.is_control() || r#"\<>:"|?*"#.contains(c), "_");
    out.join("frames").join(name.trim_end_matches(['.', ' ']))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_stretch_gives_its_sharpest_frame() {
        let checkers: Vec<u8> = (0..16).map(|i| (i + i / 4) % 2 * 200).collect();
        let ramp: Vec<u8> = (0..16).map(|i| i % 4 * 60).collect();
        assert_eq!(gradient_energy(&checkers, 4), 24 * 200 * 200);
        assert_eq!(gradient_energy(&ramp, 4), 12 * 60 * 60);
        let mut values = vec![1; 20];
        (values[3], values[9], values[10], values[19]) = (5, 7, 6, 9);
        assert_eq!(sharpest(&values), [9, 19]);
        assert_eq!(sharpest(&values[..15]).len(), 1);
        assert_eq!((sharpest(&[2; 500]).len(), sharpest(&[])), (MAX_TAKEN, Vec::new()));
    }

    #[test]
    fn frames_of_hdr_videos_have_eight_bits() {
        let guard = tempfile::tempdir().unwrap();
        let [video, frames, other] = ["hdr.mkv", "frames.a", "frames.partial"].map(|name| guard.path().join(name));
        fs::create_dir(&other).unwrap();
        let picture = "testsrc2=s=64x48:d=1,format=yuv420p10le,setparams=color_trc=arib-std-b67";
        let encode = ["-v", "error", "-f", "lavfi", "-i", picture, "-c:v", "ffv1", "-color_trc", "arib-std-b67"];
        let Ok(_) = Command::new("ffmpeg").args(encode).arg(&video).status() else {
            return eprintln!("skipped: ffmpeg is not on PATH");
        };
        let mut lines = String::new();
        video_frames(&video, &frames, |line| lines += line).unwrap();
        assert!(other.is_dir(), "frames of another video");
        let depth = image::open(frames.join("001.png")).unwrap().color();
        let is_toned = tone_mapping(Path::new("ffmpeg"), &video, &mut |_: &str| {}) == TONE_MAPPING;
        assert_eq!((depth, is_toned), (image::ColorType::Rgb8, !lines.contains("look flat")), "{lines}");
    }

    #[test]
    fn a_video_is_known_by_name_and_length() {
        let guard = tempfile::tempdir().unwrap();
        let (video, frames) = (guard.path().join("walk.mp4"), guard.path().join("frames"));
        fs::write(&video, "film").unwrap();
        fs::create_dir(&frames).unwrap();
        for typed in ["walk.mp4", "./walk.mp4"] {
            fs::write(frames.join(SOURCE), format!("{typed}\n4 bytes\n")).unwrap();
            video_frames(&video, &frames, |_| {}).unwrap();
        }
        let named = video_folder(Path::new("films/12:30 .mp4"), Path::new("runs"));
        assert_eq!(named, Path::new("runs/frames/12_30"));
        fs::write(&video, "other film").unwrap();
        let text = video_frames(&video, &frames, |_| {}).unwrap_err().to_string();
        assert!(text.contains("it is of `./walk.mp4, 4 bytes`; remove it"), "{text}");
    }
}
