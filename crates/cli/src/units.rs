//! Times, sizes and folders on the command line.

use std::path::{Path, PathBuf};
use std::time::Duration;

use indicatif::HumanDuration;
use parse_size::Config;

/// Parses a time above 0 with its unit, such as `90s`, `1500ms` or `1h 30m`.
pub(crate) fn parse_time(text: &str) -> Result<Duration, String> {
    let time = humantime::parse_duration(text).ok().filter(|time| !time.is_zero());
    time.ok_or_else(|| "expected a time above 0 with its unit, such as 60s or 5m".to_owned())
}

/// Refuses the file `out` if it has another extension than `expected`.
pub(crate) fn check_extension(out: &Path, expected: &str) -> anyhow::Result<()> {
    let fits = out.extension().is_none_or(|found| found.eq_ignore_ascii_case(expected));
    anyhow::ensure!(fits, "--out {}: expected a file name that ends in .{expected}", out.display());
    Ok(())
}

/// Parses a size such as `8G` into mebibytes; a number without a unit is in mebibytes too.
pub(crate) fn parse_mebibytes(text: &str) -> Result<u64, String> {
    let parser = Config::new().with_binary().with_default_factor(1 << 20);
    let size = parser.parse_size(text).ok().map(|bytes| bytes >> 20).filter(|size| *size > 0);
    size.ok_or_else(|| "expected a size of at least 1M, such as 8G or 500M".to_owned())
}

/// Parses the path of a folder that is there or can be created.
pub(crate) fn parse_folder(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match path.ancestors().find(|part| part.exists() && !part.is_dir()) {
        _ if text.is_empty() => Err("expected a folder, such as . for the current one".to_owned()),
        Some(file) => Err(format!("expected a folder, and {} is a file", file.display())),
        None => Ok(path),
    }
}

/// Formats the total time of `runs` that take `seconds` each, such as `about 5 minutes on two cores`.
pub(crate) fn expected_time(seconds: f64, runs: usize) -> String {
    let whole = Duration::from_secs_f64(seconds * runs as f64);
    format!("about {} on two cores", HumanDuration(whole))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_no_folder() {
        let folder = tempfile::tempdir().unwrap();
        let (file, new) = (folder.path().join("file"), folder.path().join("no/such/runs"));
        std::fs::write(&file, "").unwrap();
        let error = Err(format!("expected a folder, and {} is a file", file.display()));
        for (path, expected) in [(&file, error.clone()), (&file.join("runs"), error), (&new, Ok(new.clone()))] {
            assert_eq!(parse_folder(&path.display().to_string()), expected);
        }
        assert!(parse_folder("").is_err());
    }

    #[test]
    fn times_have_a_unit_and_sizes_are_binary() {
        for (text, seconds) in [("60s", 60.0), ("1500ms", 1.5), ("0.5h", 1800.0), ("1h 30m", 5400.0)] {
            assert_eq!(parse_time(text).map(|time| time.as_secs_f64()), Ok(seconds), "{text}");
        }
        for (text, mebibytes) in [("8G", 8192), ("8GiB", 8192), ("500M", 500), ("1.5G", 1536), ("64", 64)] {
            assert_eq!(parse_mebibytes(text), Ok(mebibytes), "{text}");
        }
        for text in ["", "s", "G", "0", "0s", "0G", "-1s", "nan", "5 parsecs", "8X", "1K", "99999999999999999999h"] {
            assert!(parse_time(text).is_err() && parse_mebibytes(text).is_err(), "{text}");
        }
    }
}
