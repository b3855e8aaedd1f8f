//! Poses of photographs, found by an installed COLMAP.

use std::collections::VecDeque;
use std::ffi::OsString;
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::mpsc;
use std::thread;

use infonerf_scene::SceneError;

/// The program, as it is looked for in the folders of PATH.
const PROGRAM: &str = "colmap";
/// Lines of the program's output that an error repeats.
const REPEATED: usize = 3;

/// Finds the poses of the photographs in the folder `images` with `program`, and writes them to `dir/sparse`. `progress` is
/// given the name of each step and each line that the program prints.
///
/// The settings are for few images: one lens for all with one coefficient of distortion (a few photographs do not tell more,
/// and the mapper then finds absurd ones, with most photographs left without a pose), affine-invariant features, guided exhaustive matching, and a mapper
/// that starts from pairs with little parallax.
///
/// # Errors
/// A step fails; or the photographs do not overlap enough for a reconstruction. Nothing is left of it then.
pub(super) fn pose(
    program: &Path,
    dir: &Path,
    images: &Path,
    mut progress: &mut impl FnMut(&str),
) -> Result<(), SceneError> {
    let (database, sparse) = (dir.join("colmap.db"), dir.join("sparse"));
    fs::create_dir_all(&sparse).map_err(|e| SceneError::io(&sparse, e))?;
    let done = steps(images, &database, &sparse).iter().try_for_each(|(step, arguments)| {
        progress(step);
        let mut help = String::new();
        // A program without help is given all options, and says itself what it does not know.
        let _ = run(program, step, &[step.into(), "-h".into()], &mut |line: &str| help += line);
        run(program, step, &accepted(arguments, &help), &mut progress)
    });
    let found = done.and_then(|()| {
        if crate::colmap::find(dir).is_some() {
            return Ok(());
        }
        let expected = "photographs that overlap enough to find their poses";
        Err(SceneError::malformed(images, expected, "colmap made no reconstruction of them"))
    });
    if found.is_err() {
        // Nothing is left that the next attempt would stumble over; what cannot be removed says so then.
        let _ = (fs::remove_dir_all(&sparse), fs::remove_file(&database));
    }
    found
}

/// Returns COLMAP's steps, each a name with its arguments.
fn steps(images: &Path, database: &Path, sparse: &Path) -> Vec<(&'static str, Vec<OsString>)> {
    let path = |p: &Path| p.as_os_str().to_owned();
    let with = |step: &str, paths: &[(&str, &Path)], options: &[&str]| {
        let paths = paths.iter().flat_map(|(name, p)| [OsString::from(format!("--{name}")), path(p)]);
        let mut arguments = vec![OsString::from(step)];
        arguments.extend(paths);
        arguments.extend(options.iter().map(OsString::from));
        arguments
    };
    vec![
        (
            "feature_extractor",
            with(
                "feature_extractor",
                &[("database_path", database), ("image_path", images)],
                &[
                    "--ImageReader.single_camera",
                    "1",
                    "--ImageReader.camera_model",
                    "SIMPLE_RADIAL",
                    "--SiftExtraction.use_gpu",
                    "0",
                    "--SiftExtraction.estimate_affine_shape",
                    "1",
                    "--SiftExtraction.domain_size_pooling",
                    "1",
                ],
            ),
        ),
        (
            "exhaustive_matcher",
            with(
                "exhaustive_matcher",
                &[("database_path", database)],
                &["--SiftMatching.use_gpu", "0", "--SiftMatching.guided_matching", "1"],
            ),
        ),
        (
            "mapper",
            with(
                "mapper",
                &[("database_path", database), ("image_path", images), ("output_path", sparse)],
                &[
                    "--Mapper.min_model_size",
                    "2",
                    "--Mapper.init_min_num_inliers",
                    "40",
                    "--Mapper.init_min_tri_angle",
                    "4",
                    "--Mapper.abs_pose_min_num_inliers",
                    "15",
                    "--Mapper.multiple_models",
                    "0",
                ],
            ),
        ),
    ]
}

/// Returns the arguments with the options that `help` lists, under the names that this version of COLMAP has for them:
/// 3.12 moved what is not SIFT's own to groups of other names. Options that it does not have at all are left to their
/// defaults.
fn accepted(arguments: &[OsString], help: &str) -> Vec<OsString> {
    const MOVED: [(&str, &str); 2] = [("SiftExtraction.", "FeatureExtraction."), ("SiftMatching.", "FeatureMatching.")];
    let mut kept = Vec::new();
    let mut rest = arguments.iter();
    while let Some(argument) = rest.next() {
        let name = argument.to_string_lossy();
        if !name.starts_with("--") || !name.contains('.') || !help.contains("--") {
            kept.push(argument.clone());
            continue;
        }
        let value = rest.next();
        let names = MOVED.iter().map(|(old, new)| name.replace(old, new)).chain([name.to_string()]);
        if let (Some(known), Some(value)) = (names.into_iter().find(|n| help.contains(n.as_str())), value) {
            kept.extend([known.into(), value.clone()]);
        }
    }
    kept
}

/// Returns the program in the first folder of `path` that has it.
pub(super) fn program(path: Option<OsString>) -> Option<PathBuf> {
    let name = format!("{PROGRAM}{}", std::env::consts::EXE_SUFFIX);
    std::env::split_paths(&path?).map(|folder| folder.join(&name)).find(|p| p.is_file())
}

/// Runs one step, handing on every line that it prints. Without a screen.
fn run(program: &Path, step: &str, arguments: &[OsString], progress: &mut impl FnMut(&str)) -> Result<(), SceneError> {
    let io = |e| SceneError::io(program, e);
    let mut child = Command::new(program)
        .args(arguments)
        .env("QT_QPA_PLATFORM", "offscreen")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(io)?;
    let (sender, lines) = mpsc::channel();
    let streams: [Option<Box<dyn std::io::Read + Send>>; 2] =
        [child.stdout.take().map(|s| Box::new(s) as _), child.stderr.take().map(|s| Box::new(s) as _)];
    for stream in streams.into_iter().flatten() {
        let sender = sender.clone();
        thread::spawn(move || {
            let lines = BufReader::new(stream).split(b'\n').map_while(Result::ok);
            // The receiver is there until both streams have ended.
            lines.for_each(|line| drop(sender.send(String::from_utf8_lossy(&line).trim_end().to_owned())));
        });
    }
    drop(sender);
    let mut last = VecDeque::new();
    for line in lines.iter().filter(|line| !line.is_empty()) {
        progress(&line);
        last.push_back(line);
        if last.len() > REPEATED {
            last.pop_front();
        }
    }
    let status = child.wait().map_err(io)?;
    if status.success() {
        return Ok(());
    }
    let reason = format!("{status}: {}", last.into_iter().collect::<Vec<_>>().join("; "));
    Err(SceneError::malformed(program, format!("`{step}` to succeed"), reason))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_are_those_of_the_installed_version() {
        let all = steps(Path::new("images"), Path::new("my.colmap.db"), Path::new("sparse"));
        let names = |help: &str| -> Vec<String> {
            accepted(&all[1].1, help).iter().map(|a| a.to_string_lossy().into_owned()).collect()
        };
        let old = ["exhaustive_matcher", "--database_path", "my.colmap.db", "--SiftMatching.use_gpu", "0"];
        assert_eq!(names("--SiftMatching.use_gpu arg"), old);
        let new = ["exhaustive_matcher", "--database_path", "my.colmap.db", "--FeatureMatching.use_gpu", "0"];
        assert_eq!(names("--FeatureMatching.use_gpu arg"), new);
        assert_eq!(names("").len(), 7, "without help, all");
    }

    /// A stand-in that prints its step and fails at the mapper.
    #[cfg(unix)]
    #[test]
    fn steps_run_and_their_lines_are_handed_on() {
        use std::os::unix::fs::PermissionsExt;
        let guard = tempfile::tempdir().unwrap();
        let program = guard.path().join("colmap");
        fs::write(&program, "#!/bin/sh\necho \"run $1\"\necho oops >&2\n[ \"$1\" != mapper ]\n").unwrap();
        fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
        let all = steps(Path::new("images"), Path::new("colmap.db"), Path::new("sparse"));
        let mut seen = Vec::new();
        for (step, arguments) in &all[..2] {
            run(&program, step, arguments, &mut |line: &str| seen.push(line.to_owned())).unwrap();
        }
        seen.sort();
        assert_eq!(seen, ["oops", "oops", "run exhaustive_matcher", "run feature_extractor"]);
        let (step, arguments) = &all[2];
        let text = run(&program, step, arguments, &mut |_: &str| {}).unwrap_err().to_string();
        assert!(text.contains("`mapper` to succeed") && text.contains("oops") && !text.contains('\n'), "{text}");
    }
}
