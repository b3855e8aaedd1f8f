//! Atomic writing of files, PNGs among them.

use std::fs::{self, File};
use std::io::Write;
use std::path::Path;
use std::process;
use std::sync::atomic::{AtomicU64, Ordering};

use image::codecs::png::PngEncoder;
use image::{DynamicImage, ImageResult, RgbImage};

use crate::error::ReportError;

/// Writes `bytes` to a temporary file and renames it to `path`: a reader sees the old file or the new one, never a part.
/// Missing folders are created; a link stays, and its target is replaced; a pipe or a device is written into.
///
/// # Errors
/// If the file cannot be written; an old file stays.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), ReportError> {
    static COUNTER: AtomicU64 = AtomicU64::new(0);
    let found = fs::canonicalize(path);
    let path = found.as_deref().unwrap_or(path);
    if fs::metadata(path).is_ok_and(|found| !found.is_file() && !found.is_dir()) {
        return fs::write(path, bytes).map_err(ReportError::io("write", path));
    }
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let unique = COUNTER.fetch_add(1, Ordering::Relaxed);
    let beside = path.with_file_name(format!(".{name}.{}.{unique}.tmp", process::id()));
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(ReportError::io("create", folder))?;
    }
    let written = File::create(&beside)
        .and_then(|mut file| file.write_all(bytes).and_then(|()| file.sync_all()))
        .and_then(|()| fs::rename(&beside, path));
    written.map_err(|reason| {
        let _ = fs::remove_file(&beside);
        ReportError::io("write", path)(reason)
    })
}

/// Writes a PNG, whole or not at all, and creates its folder if there is none.
pub fn save_png(picture: &RgbImage, path: &Path) -> Result<(), ReportError> {
    let mut png = Vec::new();
    picture.write_with_encoder(PngEncoder::new(&mut png)).map_err(ReportError::io("write", path))?;
    write_atomically(path, &png)
}

pub(crate) fn png_bytes(image: &DynamicImage) -> ImageResult<Vec<u8>> {
    let mut png = Vec::new();
    image.write_with_encoder(PngEncoder::new(&mut png))?;
    Ok(png)
}

#[cfg(all(test, unix))]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    #[test]
    fn links_and_devices_stay_what_they_are() {
        let folder = tempfile::tempdir().unwrap();
        let [file, link, device] = ["file", "link", "null"].map(|name| folder.path().join(name));
        fs::write(&file, "old").unwrap();
        symlink(&file, &link).unwrap();
        write_atomically(&link, b"new").unwrap();
        assert_eq!((fs::read(&file).unwrap().as_slice(), link.is_symlink()), (&b"new"[..], true));
        symlink("/dev/null", &device).unwrap();
        write_atomically(&device, b"new").unwrap();
        assert!(device.is_symlink() && !fs::metadata("/dev/null").unwrap().is_file());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3, "no temporary file is left");
    }
}
