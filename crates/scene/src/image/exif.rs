//! Orientation and focal length that cameras write into image files (EXIF).

use std::fs::File;
use std::io::{BufRead, BufReader, Seek};
use std::path::Path;

use ::image::metadata::Orientation;
use exif::{In, Reader, Tag, Value};

use super::codec::has_extension;

/// Width of a frame of 35 mm film in millimetres.
pub const FILM_WIDTH: f64 = 36.0;
/// Min ratio of the longer to the shorter side of the images that cameras write, and the relative tolerance of ratios.
const MIN_RATIO: f64 = 4.0 / 3.0;
const RATIO_TOLERANCE: f64 = 0.02;
/// Extensions of the formats in which cameras write EXIF.
const WITH_EXIF: [&str; 7] = ["jpg", "jpeg", "jpe", "jfif", "tif", "tiff", "webp"];

/// Returns the orientation that the EXIF data of the image in `path` state; no transform without such data.
pub fn orientation(path: &Path) -> Orientation {
    let stated = || {
        let data = Reader::new().read_from_container(&mut BufReader::new(File::open(path).ok()?)).ok()?;
        let value = data.get_field(Tag::Orientation, In::PRIMARY)?.value.get_uint(0)?;
        Orientation::from_exif(u8::try_from(value).ok()?)
    };
    has_extension(path, &WITH_EXIF).then(stated).flatten().unwrap_or(Orientation::NoTransforms)
}

/// Returns the number of clockwise quarter turns of `orientation`; `None` if it mirrors.
pub fn quarter_turns(orientation: Orientation) -> Option<u8> {
    match orientation {
        Orientation::NoTransforms => Some(0),
        Orientation::Rotate90 => Some(1),
        Orientation::Rotate180 => Some(2),
        Orientation::Rotate270 => Some(3),
        _ => None,
    }
}

/// Whether `orientation` exchanges width and height.
pub(super) fn is_sideways(orientation: Orientation) -> bool {
    use Orientation::{Rotate90, Rotate90FlipH, Rotate270, Rotate270FlipH};
    matches!(orientation, Rotate90 | Rotate270 | Rotate90FlipH | Rotate270FlipH)
}

/// Returns the focal length of a JPEG, PNG, TIFF, WebP or HEIF divided by the longer side of the image: from
/// `FocalLengthIn35mmFilm`, else from `FocalLength` and `FocalPlaneXResolution`. `None` without such data, and if the image of
/// `size` is cropped: the ratio of its sides is not that of `PixelXDimension` and `PixelYDimension`, or below 4 : 3.
pub fn focal_length(file: &mut (impl BufRead + Seek), size: (u32, u32)) -> Option<f64> {
    let data = Reader::new().read_from_container(file).ok()?;
    let number = |tag: Tag| match &data.get_field(tag, In::PRIMARY)?.value {
        Value::Rational(v) => v.first().map(|r| r.to_f64()),
        value => value.get_uint(0).map(f64::from),
    };
    let positive = |tag: Tag| number(tag).filter(|v| v.is_finite() && *v > 0.0);
    let ratio = |x: f64, y: f64| x.max(y) / x.min(y);
    let (sides, shown) =
        (positive(Tag::PixelXDimension).zip(positive(Tag::PixelYDimension)), ratio(size.0.into(), size.1.into()));
    let is_cropped = sides.is_some_and(|(x, y)| (shown / ratio(x, y) - 1.0).abs() > RATIO_TOLERANCE);
    if is_cropped || shown < MIN_RATIO * (1.0 - RATIO_TOLERANCE) {
        return None;
    }
    if let Some(film) = positive(Tag::FocalLengthIn35mmFilm) {
        return Some(film / FILM_WIDTH);
    }
    // The resolution counts pixels per unit: a centimetre, millimetre or micrometre, else an inch.
    let millimetres = match number(Tag::FocalPlaneResolutionUnit) {
        Some(3.0) => 10.0,
        Some(4.0) => 1.0,
        Some(5.0) => 1e-3,
        _ => 25.4,
    };
    let longer = sides.map(|(x, y)| x.max(y))?;
    Some(positive(Tag::FocalLength)? * positive(Tag::FocalPlaneXResolution)? / millimetres / longer)
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use exif::{Field, Rational, experimental::Writer};

    use super::*;

    fn stated_at(size: (u32, u32), fields: &[(Tag, Value)]) -> Option<f64> {
        let field = |(tag, value): &(Tag, Value)| Field { tag: *tag, ifd_num: In::PRIMARY, value: value.clone() };
        let fields: Vec<Field> = fields.iter().map(field).collect();
        let mut writer = Writer::new();
        fields.iter().for_each(|field| writer.push_field(field));
        let mut file = Cursor::new(Vec::new());
        writer.write(&mut file, false).unwrap();
        file.set_position(0);
        focal_length(&mut file, size)
    }

    fn stated(fields: &[(Tag, Value)]) -> Option<f64> {
        stated_at((3000, 2000), fields)
    }

    #[test]
    fn focal_lengths_over_the_longer_side() {
        let ratio = |num, denom| Value::Rational(vec![Rational { num, denom }]);
        let film = (Tag::FocalLengthIn35mmFilm, Value::Short(vec![27]));
        assert_eq!(stated(std::slice::from_ref(&film)), Some(0.75));
        // 50 mm at 4000 pixels per inch, of 6000 × 4000 pixels; 1000 per centimetre.
        let sensor = |unit, resolution| {
            stated(&[
                (Tag::FocalLength, ratio(50, 1)),
                (Tag::FocalPlaneXResolution, ratio(resolution, 1)),
                (Tag::FocalPlaneResolutionUnit, Value::Short(vec![unit])),
                (Tag::PixelXDimension, Value::Long(vec![6000])),
                (Tag::PixelYDimension, Value::Long(vec![4000])),
            ])
        };
        assert!((sensor(2, 4000).unwrap() - 50.0 * 4000.0 / 25.4 / 6000.0).abs() < 1e-12);
        for (unit, resolution) in [(3, 1000), (4, 100)] {
            assert!((sensor(unit, resolution).unwrap() - 50.0 * 100.0 / 6000.0).abs() < 1e-12);
        }
        assert_eq!(stated(&[(Tag::FocalLength, ratio(50, 1))]), None);
        assert_eq!(stated(&[(Tag::FocalLengthIn35mmFilm, Value::Short(vec![0]))]), None);
        assert_eq!(focal_length(&mut Cursor::new(b"no image"), (4, 3)), None);
        // Cropped images: a square, and one that is wider than EXIF data state.
        let film_of = |x, y| {
            [film.clone(), (Tag::PixelXDimension, Value::Long(vec![x])), (Tag::PixelYDimension, Value::Long(vec![y]))]
        };
        assert_eq!(stated_at((3000, 3000), std::slice::from_ref(&film)), None);
        for (size, focal) in [((1500, 2000), Some(0.75)), ((2000, 1495), Some(0.75)), ((2000, 1333), None)] {
            assert_eq!(stated_at(size, &film_of(4000, 3000)), focal, "{size:?}");
        }
    }

    #[test]
    fn orientations_are_clockwise_quarter_turns() {
        let turns = [1, 6, 3, 8, 2, 5].map(|value| quarter_turns(Orientation::from_exif(value).unwrap()));
        assert_eq!(turns, [Some(0), Some(1), Some(2), Some(3), None, None]);
    }
}
