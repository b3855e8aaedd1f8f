//! The focal length that a photograph's EXIF data state.

use std::io::{BufRead, Seek};

use exif::{Exif, In, Reader, Tag};

/// The width of 35 mm film and its diagonal, in millimetres.
const FILM: f64 = 36.0;

/// The focal length of a JPEG, PNG, TIFF, WebP or HEIF, over the longer side of the picture: from `FocalLengthIn35mmFilm`, else from
/// `FocalLength` and `FocalPlaneXResolution`. `None` where there is no such data.
pub fn focal(file: &mut (impl BufRead + Seek)) -> Option<f64> {
    of(&Reader::new().read_from_container(file).ok()?)
}

fn of(data: &Exif) -> Option<f64> {
    let number = |tag: Tag| match &data.get_field(tag, In::PRIMARY)?.value {
        exif::Value::Rational(v) => v.first().map(|r| r.to_f64()),
        value => value.get_uint(0).map(f64::from),
    };
    let positive = |tag: Tag| number(tag).filter(|v| v.is_finite() && *v > 0.0);
    if let Some(film) = positive(Tag::FocalLengthIn35mmFilm) {
        return Some(film / FILM);
    }
    // Units of the resolution: inches or centimetres.
    let unit = match number(Tag::FocalPlaneResolutionUnit) {
        Some(3.0) => 10.0,
        _ => 25.4,
    };
    let longer = positive(Tag::PixelXDimension)?.max(positive(Tag::PixelYDimension)?);
    Some(positive(Tag::FocalLength)? * positive(Tag::FocalPlaneXResolution)? / unit / longer)
}
