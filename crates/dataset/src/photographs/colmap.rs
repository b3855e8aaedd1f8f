//! Poses of photographs, found by an installed COLMAP.

use std::collections::{HashSet, VecDeque};
use std::ffi::OsString;
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

use infonerf_scene::SceneError;
use infonerf_scene::image::stored_dimensions;

use super::OVERLAPPING;
use crate::capture::{list_photographs, mask_of, read_stored_mask};
use crate::colmap::{Reconstruction, models};
use crate::files::{file_name, make_folder, write_file, write_mask};

pub(super) const PROGRAM: &str = "colmap";
/// Option, with a space at its end, that rejects photographs of another size than the first.
const ONE_LENS: &str = "ImageReader.single_camera=1 ";
/// Steps: name, number of paths that it takes, and options.
const STEPS: [(&str, usize, &str); 3] = [
    (
        "feature_extractor",
        2,
        "ImageReader.single_camera=1 ImageReader.camera_model=SIMPLE_RADIAL SiftExtraction.use_gpu=0 \
         SiftExtraction.estimate_affine_shape=1 SiftExtraction.domain_size_pooling=1",
    ),
    ("exhaustive_matcher", 1, "SiftMatching.use_gpu=0 SiftMatching.guided_matching=1"),
    (
        "mapper",
        3,
        "Mapper.min_model_size=2 Mapper.init_min_num_inliers=40 Mapper.init_min_tri_angle=4 \
         Mapper.abs_pose_min_num_inliers=15 Mapper.multiple_models=0",
    ),
];
/// Number of last lines of the program's output in an error.
const REPEATED: usize = 3;

/// Finds the poses of the photographs in the folder `images` with `program`, and leaves them in `work/sparse`.
/// `progress` receives the name of each step and each line that the program prints.
///
/// The settings are for few images: affine-invariant features, guided exhaustive matching, and a mapper that starts
/// from pairs with little parallax. All images share one lens if they have one size. A lens has one distortion coefficient:
/// with more, the mapper fits absurd lenses to few photographs and leaves most of them without a pose. Subfolders of
/// `images` are not read. Features count within the masks of the capture, which is in the folder that contains `work`.
pub(super) fn find(
    program: &Path,
    work: &Path,
    images: &Path,
    mut progress: &mut impl FnMut(&str),
) -> Result<Reconstruction, SceneError> {
    let (database, sparse) = (work.join("colmap.db"), work.join("sparse"));
    let _ = fs::remove_dir_all(work);
    make_folder(&sparse)?;
    let (photographs, list) = (list_photographs(images)?, work.join("photographs.txt"));
    write_file(&list, photographs.iter().map(|path| file_name(path) + "\n").collect::<String>())?;
    let (dir, masks) = (work.parent().unwrap_or(images), work.join("masks"));
    for path in &photographs {
        let Some(mask) = mask_of(dir, path) else { continue };
        make_folder(&masks)?;
        let counts = read_stored_mask(path, &mask)?;
        let file = masks.join(file_name(path) + ".png");
        write_mask(&file, stored_dimensions(path)?, |pixel| counts[pixel as usize])?;
    }
    let sizes = photographs.iter().map(|path| stored_dimensions(path)).collect::<Result<HashSet<_>, _>>()?;
    for (step, count, options) in STEPS {
        progress(step);
        let mut help = String::new();
        // A program that prints no help gets all options and reports unknown ones itself.
        let _ = run(program, step, &["-h".into()], &mut |line: &str| help += line);
        let options = if sizes.len() > 1 { options.replace(ONE_LENS, "") } else { options.into() };
        let mut all = arguments((step, count, options.as_str()), [&database, images, &sparse], &help);
        if step == STEPS[0].0 {
            if masks.is_dir() {
                all.extend(["--ImageReader.mask_path".into(), masks.clone().into_os_string()]);
            }
            all.extend(["--image_list_path".into(), list.clone().into_os_string()]);
        }
        run(program, step, &all, &mut progress)?;
    }
    if models(work).is_empty() {
        return Err(SceneError::malformed(images, OVERLAPPING, "colmap made no reconstruction of them"));
    }
    Reconstruction::read(work)
}

/// Returns the arguments of a step: its paths, and the options that `help` lists. COLMAP 3.12 renamed the groups of
/// options that are not specific to SIFT, so both names are looked for.
fn arguments((_, count, options): (&str, usize, &str), paths: [&Path; 3], help: &str) -> Vec<OsString> {
    let named = ["--database_path", "--image_path", "--output_path"].into_iter().zip(paths).take(count);
    let mut all: Vec<OsString> = named.flat_map(|(name, path)| [name.into(), path.into()]).collect();
    for (name, value) in options.split(' ').filter_map(|option| option.split_once('=')) {
        let moved = name.replace("SiftExtraction.", "FeatureExtraction.").replace("SiftMatching.", "FeatureMatching.");
        let names = [format!("--{moved}"), format!("--{name}")];
        let known = if help.contains("--") { names.iter().find(|name| help.contains(*name)) } else { names.last() };
        all.extend(known.into_iter().flat_map(|name| [name.into(), OsString::from(value)]));
    }
    all
}

/// Runs one step without a display, and passes each line that it prints to `progress`.
fn run(program: &Path, step: &str, arguments: &[OsString], progress: &mut impl FnMut(&str)) -> Result<(), SceneError> {
    let io = |e| SceneError::io(program, e);
    let (output, input) = std::io::pipe().map_err(io)?;
    let mut child = Command::new(program)
        .arg(step)
        .args(arguments)
        .env("QT_QPA_PLATFORM", "offscreen")
        .stdin(Stdio::null())
        .stdout(input.try_clone().map_err(io)?)
        .stderr(input)
        .spawn()
        .map_err(io)?;
    let mut last = VecDeque::new();
    for line in BufReader::new(output).split(b'\n').map_while(Result::ok) {
        let line = String::from_utf8_lossy(&line).trim_end().to_owned();
        if !line.is_empty() {
            progress(&line);
            last.truncate(REPEATED - 1);
            last.push_front(line);
        }
    }
    let status = child.wait().map_err(io)?;
    if status.success() {
        return Ok(());
    }
    let reason = format!("{status}: {}", last.into_iter().rev().collect::<Vec<_>>().join("; "));
    Err(SceneError::malformed(program, format!("`{step}` to succeed"), reason))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_are_those_of_the_installed_version() {
        let paths = ["my.colmap.db", "images", "sparse"].map(Path::new);
        let names = |help: &str| arguments(STEPS[1], paths, help);
        for group in ["SiftMatching", "FeatureMatching"] {
            let option = format!("--{group}.use_gpu");
            assert_eq!(names(&format!("{option} arg")), ["--database_path", "my.colmap.db", &option, "0"]);
        }
        assert_eq!(names("").len(), 6, "without help, all");
    }

    /// Runs a script in place of COLMAP that prints its arguments and the list of photographs, and fails at the mapper.
    #[cfg(unix)]
    #[test]
    fn steps_run_and_their_lines_are_handed_on() {
        use std::os::unix::fs::PermissionsExt;
        let guard = tempfile::tempdir().unwrap();
        let (dir, program) = (guard.path(), guard.path().join("colmap"));
        let script = "#!/bin/sh\necho run $*\necho oops >&2\nfor last; do :; done\n\
                      case $last in *.txt) cat $last;; esac\n[ $1 != mapper ]\n";
        fs::write(&program, script).unwrap();
        fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
        let mut seen = Vec::new();
        for (step, ..) in &STEPS[..2] {
            run(&program, step, &[], &mut |line: &str| seen.push(line.to_owned())).unwrap();
        }
        seen.sort();
        assert_eq!(seen, ["oops", "oops", "run exhaustive_matcher", "run feature_extractor"]);
        let text = run(&program, "mapper", &[], &mut |_: &str| {}).unwrap_err().to_string();
        assert!(text.contains("`mapper` to succeed") && text.contains("oops") && !text.contains('\n'), "{text}");
        // Neither masks nor subfolders are photographs; those of one size share a lens.
        fs::create_dir(dir.join("masks")).unwrap();
        for width in [8, 9] {
            for (name, width) in [("a.png", 8), ("b c.png", width), ("a_mask.png", 8), ("masks/a.png", 8)] {
                image::RgbImage::new(width, 8).save(dir.join(name)).unwrap();
            }
            let mut lines = String::new();
            find(&program, &dir.join("work"), dir, &mut |line: &str| lines += &format!("{line}\n")).unwrap_err();
            assert!(lines.contains("oops\na.png\nb c.png\nexhaustive_matcher"), "{lines}");
            assert_eq!(lines.contains("single_camera 1"), width == 8, "{lines}");
            assert!(lines.contains(&format!("mask_path {} ", dir.join("work/masks").display())), "{lines}");
            assert!(dir.join("work/masks/a.png.png").is_file() && !dir.join("work/masks/b c.png.png").exists());
        }
    }
}
