//! Reading image files, with limits, and writing PNG.

use std::fmt::Display;
use std::fs::{self, File};
use std::io::{self, BufRead, BufReader, Cursor, Read, Seek};
use std::path::{Path, PathBuf};

use ::image::metadata::Orientation;
use ::image::{ColorType, DynamicImage, ImageDecoder, ImageError, ImageFormat, ImageReader};

use super::RgbaImage;
use super::exif::{is_sideways, orientation};
use crate::error::SceneError;

/// Max side of an image in pixels.
pub(crate) const MAX_SIDE: u32 = 16_384;
/// Max number of pixels of an image: 64 million take 1 GiB once decoded.
const MAX_PIXELS: u64 = 1 << 26;
/// Extensions of the formats that are read, in lower case.
const EXTENSIONS: [&str; 11] = ["png", "jpg", "jpeg", "jpe", "jfif", "webp", "tif", "tiff", "bmp", "ppm", "tga"];
/// Names of these formats.
const FORMATS: &str = "PNG, JPEG, WebP, TIFF, BMP, PPM or TGA";
/// Extensions of photographs that cameras, phones and programs write and that are not read.
const UNREAD: [&str; 19] = [
    "heic", "heif", "avif", "jxl", "jp2", "exr", "hdr", "gif", "dng", "cr2", "cr3", "nef", "arw", "raf", "orf", "rw2",
    "pef", "srw", "raw",
];

/// Bytes of an image, in a file or in memory: one type, as all decoders are compiled for each type of reader.
type Source<'a> = Box<dyn BufReadSeek + 'a>;

trait BufReadSeek: BufRead + Seek {}

impl<R: BufRead + Seek> BufReadSeek for R {}

/// Whether the file's name has the extension of an image format that is read, in any case.
pub fn is_image_name(path: &Path) -> bool {
    has_extension(path, &EXTENSIONS)
}

/// Whether the file's name has one of the `known` extensions, in any case.
pub(super) fn has_extension(path: &Path, known: &[&str]) -> bool {
    path.extension().is_some_and(|e| known.iter().any(|known| e.eq_ignore_ascii_case(known)))
}

/// Lists the images in `folder`, sorted by name; hidden files, such as macOS's `._IMG_1.png`, are passed over.
///
/// # Errors
/// The folder cannot be read.
pub fn list_images(folder: &Path) -> Result<Vec<PathBuf>, SceneError> {
    let io = |e| SceneError::io(folder, e);
    let entries = fs::read_dir(folder).map_err(io)?.map(|entry| Ok(entry.map_err(io)?.path()));
    let mut images = entries.collect::<Result<Vec<_>, SceneError>>()?;
    let hidden = |path: &Path| path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."));
    images.retain(|path| !hidden(path) && is_image_name(path) && path.is_file());
    images.sort();
    Ok(images)
}

/// Returns the image that `path` names, whatever the case or kind of its extension: `path` itself, else the first file
/// next to it of the same name with a known extension in place of its own, or added to it. `None` if there is none.
pub fn find_image(path: &Path) -> Option<PathBuf> {
    if path.is_file() {
        return Some(path.to_owned());
    }
    let is_image = is_image_name(path) || has_extension(path, &UNREAD);
    let stem = if is_image { path.file_stem() } else { path.file_name() }?.to_str()?;
    let with = |extension: &str| path.with_file_name(format!("{stem}.{extension}"));
    EXTENSIONS.iter().flat_map(|e| [with(e), with(&e.to_ascii_uppercase())]).find(|candidate| candidate.is_file())
}

/// Returns the `(width, height)` of the image in a file as it is shown, turned as its EXIF data state.
///
/// # Errors
/// The file is missing, unreadable, not an image, or larger than this crate reads.
pub fn dimensions(path: &Path) -> Result<(u32, u32), SceneError> {
    let (width, height) = stored_dimensions(path)?;
    Ok(if is_sideways(orientation(path)) { (height, width) } else { (width, height) })
}

/// Returns the `(width, height)` that the header of an image file states, before EXIF data turn the image.
///
/// # Errors
/// The file is missing, unreadable, not an image, or larger than this crate reads.
pub fn stored_dimensions(path: &Path) -> Result<(u32, u32), SceneError> {
    checked_dimensions(path, open(path)?)
}

/// Whether an image file states that it has an alpha channel.
///
/// # Errors
/// The file is missing, unreadable, not an image, or larger than this crate reads.
pub fn has_alpha(path: &Path) -> Result<bool, SceneError> {
    Ok(open(path)?.into_decoder().map_err(|e| decode_error(path, e))?.color_type().has_alpha())
}

/// Whether a pixel of an image file is not opaque. A file without an alpha channel is not decoded.
///
/// # Errors
/// The file is missing, unreadable, not an image, or larger than this crate reads.
pub fn has_transparency(path: &Path) -> Result<bool, SceneError> {
    Ok(has_alpha(path)? && read_rgba(path)?.pixels.iter().any(|pixel| pixel[3] < 1.0))
}

/// Decodes an image of 8 or 16 bits a channel, grey or colour, with or without alpha, turned as its EXIF data state.
///
/// # Errors
/// The file is missing, unreadable, not an image, or larger than this crate reads.
pub fn read_rgba(path: &Path) -> Result<RgbaImage, SceneError> {
    read_rgba_turned(path, orientation(path))
}

/// Decodes an image like [`read_rgba`], but turns it by `turn` and not by its EXIF data.
///
/// # Errors
/// The file is missing, unreadable, not an image, or larger than this crate reads.
pub fn read_rgba_turned(path: &Path, turn: Orientation) -> Result<RgbaImage, SceneError> {
    decode(path, || open(path), turn)
}

/// Decodes the image that each reader from `open` reads from its start, and turns it by `turn`.
fn decode<'a>(
    path: &Path,
    open: impl Fn() -> Result<ImageReader<Source<'a>>, SceneError>,
    turn: Orientation,
) -> Result<RgbaImage, SceneError> {
    // Checked before memory is allocated: a header of a few bytes may claim any size.
    let (width, height) = checked_dimensions(path, open()?)?;
    let count = u64::from(width) * u64::from(height);
    if count > MAX_PIXELS {
        let what = "the number of pixels (ImageMagick halves the sides: `magick mogrify -resize 50% FILE`)";
        return Err(SceneError::TooLarge { path: path.into(), what, size: count, limit: MAX_PIXELS });
    }
    let reader = open()?;
    if reader.format() == Some(ImageFormat::Jpeg) {
        let mut bytes = Vec::new();
        reader.into_inner().read_to_end(&mut bytes).map_err(|e| SceneError::io(path, e))?;
        if !has_end_marker(&bytes) {
            return Err(decode_error(path, "the file is cut short"));
        }
    }
    let mut decoded = open()?.decode().map_err(|e| decode_error(path, e))?;
    decoded.apply_orientation(turn);
    let has_alpha = decoded.color().has_alpha();
    let (width, height) = (decoded.width(), decoded.height());
    let pixels = match decoded {
        DynamicImage::ImageRgba8(image) => image.pixels().map(|p| p.0.map(|v| f32::from(v) / 255.0)).collect(),
        other => other.into_rgba32f().pixels().map(|p| p.0).collect(),
    };
    Ok(RgbaImage { width, height, pixels, has_alpha })
}

/// Decodes an image in memory like [`read_rgba`], but without EXIF data. Errors name `path`.
///
/// # Errors
/// The bytes are not an image, or larger than this crate reads.
pub fn decode_bytes(path: &Path, bytes: &[u8]) -> Result<RgbaImage, SceneError> {
    decode(path, || guessed(path, Box::new(Cursor::new(bytes))), Orientation::NoTransforms)
}

/// Returns the error about a photograph in a format that is not read, such as HEIC or DNG; `None` for other files.
pub fn unread_format(path: &Path) -> Option<SceneError> {
    let extension = path.extension()?.to_str()?;
    let convert = format!("such as with ImageMagick: `magick mogrify -format jpg *.{extension}`");
    let reason = format!("{} is not read; convert it, {convert}", extension.to_ascii_uppercase());
    has_extension(path, &UNREAD).then(|| SceneError::malformed(path, FORMATS, reason))
}

fn open(path: &Path) -> Result<ImageReader<Source<'static>>, SceneError> {
    let fault = |source: io::Error| match source.kind() {
        io::ErrorKind::NotFound => SceneError::NotFound { path: path.into(), expected: "an image".into() },
        _ => SceneError::io(path, source),
    };
    // Opening a pipe would wait for somebody to write into it.
    if !fs::metadata(path).map_err(fault)?.is_file() {
        return Err(SceneError::malformed(path, "an image", "it is no regular file"));
    }
    // A capture may name GIF files; in a folder of photographs they are pictures of another kind.
    if let Some(error) = unread_format(path).filter(|_| !has_extension(path, &["gif"])) {
        return Err(error);
    }
    guessed(path, Box::new(BufReader::new(File::open(path).map_err(fault)?)))
}

/// Makes a reader for the format that the first bytes of `source` show, or TGA, in which they show nothing, by its name.
fn guessed<'a>(path: &Path, source: Source<'a>) -> Result<ImageReader<Source<'a>>, SceneError> {
    let mut reader = ImageReader::new(source);
    if has_extension(path, &["tga"]) {
        reader.set_format(ImageFormat::Tga);
    }
    reader.with_guessed_format().map_err(|error| SceneError::io(path, error))
}

/// Returns the `(width, height)` that the header of an image states, or an error if a side is too long.
fn checked_dimensions(path: &Path, reader: ImageReader<Source<'_>>) -> Result<(u32, u32), SceneError> {
    let (width, height) = reader.into_dimensions().map_err(|e| decode_error(path, e))?;
    let (size, limit) = (u64::from(width.max(height)), u64::from(MAX_SIDE));
    if size > limit {
        return Err(SceneError::TooLarge { path: path.into(), what: "the longest image side in pixels", size, limit });
    }
    Ok((width, height))
}

/// Whether a JPEG file has an end marker behind the start of its first scan. Decoders take what a cut file lacks as grey.
fn has_end_marker(jpeg: &[u8]) -> bool {
    const START_OF_SCAN: u8 = 0xDA;
    const END_OF_IMAGE: [u8; 2] = [0xFF, 0xD9];
    let mut rest = jpeg.get(2..).unwrap_or_default();
    // A segment has a marker and a length; its data may contain a thumbnail, which is a JPEG image itself.
    while let [0xFF, marker, high, low, ..] = *rest
        && marker != START_OF_SCAN
    {
        let length = if marker == 0xFF { 1 } else { 2 + usize::from(u16::from_be_bytes([high, low])) };
        rest = rest.get(length..).unwrap_or_default();
    }
    rest.windows(2).any(|pair| pair == END_OF_IMAGE)
}

fn decode_error(path: &Path, error: impl Display) -> SceneError {
    let mut head = Vec::new();
    let is_read = File::open(path).is_ok_and(|file| file.take(12).read_to_end(&mut head).is_ok());
    let reason = match &head[..] {
        [] if is_read => "the file is empty".to_owned(),
        [_, _, _, _, b'f', b't', b'y', b'p', ..] => "it holds HEIC or AVIF data; convert it".to_owned(),
        b"version http" => "it is a pointer of Git LFS; `git lfs pull` fetches the image".to_owned(),
        _ => error.to_string(),
    };
    SceneError::malformed(path, format!("a complete {FORMATS} image"), reason)
}

/// Encodes 8-bit pixels as PNG.
pub(super) fn write_png(path: &Path, width: u32, height: u32, data: &[u8], color: ColorType) -> Result<(), SceneError> {
    let expected = usize::from(color.bytes_per_pixel()) * width as usize * height as usize;
    if width == 0 || height == 0 || data.len() != expected {
        let expected = format!("{expected} bytes for {width}×{height} pixels");
        return Err(SceneError::malformed(path, expected, format!("{} bytes", data.len())));
    }
    ::image::save_buffer_with_format(path, data, width, height, color, ImageFormat::Png).map_err(|error| match error {
        ImageError::IoError(source) => SceneError::io(path, source),
        other => SceneError::malformed(path, "an image that PNG can hold", other),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_files_are_refused_with_their_names() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("bad.png");
        let refusal = |path: &Path| read_rgba(path).unwrap_err().to_string();
        let bytes: Vec<u8> = (0..64 * 64 * 4).map(|i| (i * 7 % 251) as u8).collect();
        write_png(&path, 64, 64, &bytes, ColorType::Rgba8).unwrap();
        let whole = fs::read(&path).unwrap();
        for keep in [0, 4, 20, whole.len() / 2, whole.len() - 20] {
            fs::write(&path, &whole[..keep]).unwrap();
            let error = refusal(&path);
            assert!(error.contains("bad.png") && !error.contains('\n'), "{keep}: {error}");
            assert_eq!(error.ends_with("the file is empty"), keep == 0, "{error}");
        }
        let jpeg = dir.path().join("bad.jpg");
        ::image::save_buffer(&jpeg, &bytes[..64 * 64 * 3], 64, 64, ColorType::Rgb8).unwrap();
        let whole = fs::read(&jpeg).unwrap();
        // A segment with a thumbnail, which has an end marker, and data behind the image, as phones write them.
        let thumbnail = [0xFF, 0xE1, 0, 6, 0xFF, 0xD8, 0xFF, 0xD9];
        let phone = [&whole[..2], &thumbnail, &whole[2..], b"video"].concat();
        fs::write(&jpeg, &phone).unwrap();
        assert_eq!(read_rgba(&jpeg).unwrap().pixels.len(), 64 * 64);
        fs::write(&jpeg, &phone[..phone.len() / 2]).unwrap();
        let cut = format!("bad.jpg: expected a complete {FORMATS} image: the file is cut short");
        assert!(refusal(&jpeg).ends_with(&cut));
        write_png(&path, MAX_SIDE + 1, 1, &vec![0; MAX_SIDE as usize + 1], ColorType::L8).unwrap();
        assert!(matches!(read_rgba(&path), Err(SceneError::TooLarge { .. })), "refused before it is decoded");
        assert!(refusal(dir.path()).ends_with("it is no regular file"));
        #[cfg(unix)]
        {
            let pipe = dir.path().join("pipe.png");
            assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
            assert!(refusal(&pipe).ends_with("it is no regular file"));
        }
        for (bytes, reason) in
            [(&b"\0\0\0\x18ftypheic"[..], "HEIC or AVIF data"), (b"version https://git-lfs", "Git LFS")]
        {
            fs::write(&jpeg, bytes).unwrap();
            assert!(refusal(&jpeg).contains(reason), "{reason}");
        }
        let raw = dir.path().join("DSCF1.RAF");
        fs::write(&raw, "FUJI").unwrap();
        let expected = format!("DSCF1.RAF: expected {FORMATS}: RAF is not read; convert it");
        assert!(refusal(&raw).contains(&expected));
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
        let [r, g, b, a] = grey.pixels[0];
        assert!(!grey.has_alpha && (r - 0.2).abs() < 1e-6 && (r, r, 1.0) == (g, b, a), "{:?}", grey.pixels);
    }

    /// Reads a JPEG of 16 × 8 pixels, black on the left, with orientation 6: shown upright it is 8 × 16, black above.
    #[test]
    fn images_are_turned_as_exif_states() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("side.jpg");
        let pixels: Vec<u8> = (0..16 * 8).map(|i| if i % 16 < 8 { 0 } else { 255 }).collect();
        ::image::save_buffer(&path, &pixels, 16, 8, ColorType::L8).unwrap();
        assert_eq!(dimensions(&path).unwrap(), (16, 8));
        // An EXIF segment with the orientation, directly after the first marker.
        let mut bytes = fs::read(&path).unwrap();
        let mut segment = b"\xff\xe1\x00\x22Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".to_vec();
        segment.extend([6, 0, 0, 0, 0, 0, 0, 0]);
        bytes.splice(2..2, segment);
        fs::write(&path, bytes).unwrap();
        assert_eq!((dimensions(&path).unwrap(), stored_dimensions(&path).unwrap()), ((8, 16), (16, 8)));
        let image = read_rgba(&path).unwrap();
        assert_eq!((image.width, image.height), (8, 16));
        assert!(image.pixels[3][0] < 0.1 && image.pixels[8 * 12 + 3][0] > 0.9);
    }

    #[test]
    fn images_are_found_whatever_their_extension() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        for name in ["a.JPG", "b.png", "r_0.5.png", "._a.JPG", "w.webp", "Thumbs.db", "c.jfif"] {
            fs::write(at(name), "").unwrap();
        }
        let found = |name: &str| find_image(&at(name)).map(|path| path.file_name().unwrap().to_owned());
        let files = [("a.jpg", "a.JPG"), ("a", "a.JPG"), ("b.jpg", "b.png"), ("r_0.5", "r_0.5.png"), ("w", "w.webp")];
        files.iter().for_each(|(name, file)| assert_eq!(found(name).unwrap(), *file));
        assert_eq!(found("none.png"), None);
        let listed = list_images(dir.path()).unwrap();
        assert_eq!(listed, ["a.JPG", "b.png", "c.jfif", "r_0.5.png", "w.webp"].map(at));
    }

    #[test]
    fn other_formats_than_png_and_jpeg_are_read() {
        let dir = tempfile::tempdir().unwrap();
        for extension in ["webp", "tiff", "bmp", "ppm", "tga"] {
            let path = dir.path().join(format!("a.{extension}"));
            let pixels = ::image::RgbImage::from_fn(3, 2, |x, y| ::image::Rgb([40 * x as u8, 90 * y as u8, 7]));
            pixels.save(&path).unwrap();
            let [r, g, _, _] = read_rgba(&path).unwrap().pixels[5];
            assert!((r - 80.0 / 255.0).abs() < 1e-6 && (g - 90.0 / 255.0).abs() < 1e-6, "{extension}");
        }
    }
}
