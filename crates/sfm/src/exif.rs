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

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use exif::{Field, Rational, Value, experimental::Writer};

    use super::*;

    fn stated(fields: &[(Tag, Value)]) -> Option<f64> {
        let fields: Vec<Field> =
            fields.iter().map(|(tag, value)| Field { tag: *tag, ifd_num: In::PRIMARY, value: value.clone() }).collect();
        let mut writer = Writer::new();
        fields.iter().for_each(|field| writer.push_field(field));
        let mut file = Cursor::new(Vec::new());
        writer.write(&mut file, false).unwrap();
        file.set_position(0);
        focal(&mut file)
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
        assert!((sensor(3, 1000).unwrap() - 50.0 * 100.0 / 6000.0).abs() < 1e-12);
        assert_eq!(stated(&[(Tag::FocalLength, ratio(50, 1))]), None);
        assert_eq!(stated(&[(Tag::FocalLengthIn35mmFilm, Value::Short(vec![0]))]), None);
        assert_eq!(focal(&mut Cursor::new(b"no picture")), None);
    }
}
