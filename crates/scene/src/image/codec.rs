//! Reading image files, with limits.

use std::io::{self, BufRead, BufReader, Cursor, Seek};
use std::{fs::File, path::Path};

use ::image::{DynamicImage, ImageDecoder, ImageError, ImageReader, Limits};

use super::RgbaImage;
use crate::SceneError;

/// The longest side that is read, in pixels.
const LONGEST_SIDE: u32 = 16_384;
/// The most pixels that are read: 64 million take 1 GiB once decoded.
const MOST_PIXELS: u64 = 1 << 26;
const EXPECTED: &str = "a complete PNG or JPEG image";

/// The `(width, height)` that the header of an image file states.
///
/// # Errors
/// The file is missing, unreadable, not an image, or larger than this crate reads.
pub fn dimensions(path: &Path) -> Result<(u32, u32), SceneError> {
    let size = open(path)?.into_dimensions().map_err(|e| decode_error(path, e))?;
    check_side(path, size)?;
    Ok(size)
}

/// Whether an image file says that it has an alpha channel.
///
/// # Errors
/// The file is missing, unreadable, not an image, or larger than this crate reads.
pub fn has_alpha(path: &Path) -> Result<bool, SceneError> {
    let decoder = open(path)?.into_decoder().map_err(|e| decode_error(path, e))?;
    Ok(decoder.color_type().has_alpha())
}

/// Decodes a PNG or JPEG, 8 or 16 bits a channel, grey or colour, with or without alpha.
///
/// # Errors
/// The file is missing, unreadable, not an image, or larger than this crate reads.
pub fn read_rgba(path: &Path) -> Result<RgbaImage, SceneError> {
    let size = dimensions(path)?;
    decode(path, open(path)?, size)
}

/// Decodes the file at `path`, whose header states `size`.
fn decode(
    path: &Path,
    mut reader: ImageReader<impl BufRead + Seek>,
    size: (u32, u32),
) -> Result<RgbaImage, SceneError> {
    check_pixels(path, size)?;
    let mut limits = Limits::default();
    limits.max_image_width = Some(LONGEST_SIDE);
    limits.max_image_height = Some(LONGEST_SIDE);
    reader.limits(limits);
    let decoded = reader.decode().map_err(|e| decode_error(path, e))?;
    let has_alpha = decoded.color().has_alpha();
    let (width, height) = (decoded.width(), decoded.height());
    let pixels = match decoded {
        DynamicImage::ImageRgba8(image) => image.pixels().map(|p| p.0.map(unit_u8)).collect(),
        other => other.into_rgba32f().pixels().map(|p| p.0).collect(),
    };
    Ok(RgbaImage { width, height, pixels, has_alpha })
}

/// [`read_rgba`] of bytes in memory; `path` is what errors name.
///
/// # Errors
/// The bytes are not an image, or larger than this crate reads.
pub fn decode_bytes(path: &Path, bytes: &[u8]) -> Result<RgbaImage, SceneError> {
    let reader = || {
        let guessed = ImageReader::new(Cursor::new(bytes)).with_guessed_format();
        guessed.map_err(|source| SceneError::io(path, source))
    };
    let size = reader()?.into_dimensions().map_err(|e| decode_error(path, e))?;
    check_side(path, size)?;
    decode(path, reader()?, size)
}

fn unit_u8(v: u8) -> f32 {
    f32::from(v) / 255.0
}

/// Whether the file's name says that it is a HEIC, as telephones make them.
pub fn is_heic(path: &Path) -> bool {
    path.extension().is_some_and(|e| ["heic", "heif"].iter().any(|heic| e.eq_ignore_ascii_case(heic)))
}

/// What to do with a HEIC, which is not read.
pub fn heic_error(path: &Path) -> SceneError {
    let reason = "HEIC is not read; convert it, such as with ImageMagick: `magick mogrify -format jpg *.heic`";
    SceneError::malformed(path, "PNG or JPEG", reason)
}

fn open(path: &Path) -> Result<ImageReader<BufReader<File>>, SceneError> {
    let fault = |source: io::Error| match source.kind() {
        io::ErrorKind::NotFound => SceneError::NotFound { path: path.into(), expected: "a PNG or JPEG image".into() },
        _ => SceneError::io(path, source),
    };
    // Opening a pipe would wait for somebody to write into it.
    if !std::fs::metadata(path).map_err(fault)?.is_file() {
        return Err(SceneError::malformed(path, "a PNG or JPEG image", "it is no regular file"));
    }
    if is_heic(path) {
        return Err(heic_error(path));
    }
    let file = File::open(path).map_err(fault)?;
    ImageReader::new(BufReader::new(file)).with_guessed_format().map_err(|source| SceneError::io(path, source))
}

fn check_side(path: &Path, (width, height): (u32, u32)) -> Result<(), SceneError> {
    let longest = width.max(height);
    if longest > LONGEST_SIDE {
        return Err(SceneError::TooLarge {
            path: path.into(),
            what: "the longest image side in pixels",
            size: u64::from(longest),
            limit: u64::from(LONGEST_SIDE),
        });
    }
    Ok(())
}

/// A header of a few bytes may claim any size: what it claims is checked before it is allocated.
fn check_pixels(path: &Path, (width, height): (u32, u32)) -> Result<(), SceneError> {
    let size = u64::from(width) * u64::from(height);
    if size > MOST_PIXELS {
        return Err(SceneError::TooLarge { path: path.into(), what: "the number of pixels", size, limit: MOST_PIXELS });
    }
    Ok(())
}

fn decode_error(path: &Path, error: ImageError) -> SceneError {
    SceneError::malformed(path, EXPECTED, error)
}

#[cfg(test)]
mod tests {
    use super::super::png::write_png;
    use super::*;
    use ::image::ColorType;
    use std::fs;

    #[test]
    fn truncated_png_is_an_error() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("cut.png");
        let bytes: Vec<u8> = (0..64 * 64 * 4).map(|i| (i * 7 % 251) as u8).collect();
        write_png(&path, 64, 64, &bytes, ColorType::Rgba8).unwrap();
        let whole = fs::read(&path).unwrap();
        for keep in [0, 4, 20, whole.len() / 2, whole.len() - 20] {
            fs::write(&path, &whole[..keep]).unwrap();
            let error = read_rgba(&path).unwrap_err().to_string();
            assert!(error.contains("cut.png") && !error.contains('\n'), "{keep}: {error}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn what_is_no_image_file_is_refused_unread() {
        let dir = tempfile::tempdir().unwrap();
        let pipe = dir.path().join("pipe.png");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        for path in [pipe.as_path(), dir.path()] {
            assert!(read_rgba(path).unwrap_err().to_string().ends_with("it is no regular file"));
        }
        let phone = dir.path().join("IMG_1.HEIC");
        fs::write(&phone, "ftypheic").unwrap();
        assert!(
            dimensions(&phone)
                .unwrap_err()
                .to_string()
                .contains("IMG_1.HEIC: expected PNG or JPEG: HEIC is not read; convert it")
        );
    }

    #[test]
    fn huge_header_is_refused_before_decoding() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("huge.png");
        write_png(&path, LONGEST_SIDE + 1, 1, &vec![0; LONGEST_SIDE as usize + 1], ColorType::L8).unwrap();
        assert!(matches!(read_rgba(&path), Err(SceneError::TooLarge { .. })));
    }

    #[test]
    fn sixteen_bits_and_grey_are_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("deep.png");
        let deep = ::image::ImageBuffer::<::image::Rgba<u16>, _>::from_vec(1, 1, vec![65_535u16, 0, 32_768, 13_107]);
        deep.unwrap().save(&path).unwrap();
        let [r, g, b, a] = read_rgba(&path).unwrap().pixels[0];
        assert_eq!((r, g), (1.0, 0.0));
        assert!((b - 32_768.0 / 65_535.0).abs() < 1e-6 && (a - 0.2).abs() < 1e-6);

        write_png(&path, 1, 1, &[51], ColorType::L8).unwrap();
        let grey = read_rgba(&path).unwrap();
        assert!(!grey.has_alpha);
        for (found, expected) in grey.pixels[0].into_iter().zip([0.2, 0.2, 0.2, 1.0]) {
            assert!((found - expected).abs() < 1e-6, "{found}");
        }
    }
}
