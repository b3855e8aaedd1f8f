//! One picture of several fields' pictures.

use image::imageops::blur;
use image::{ImageBuffer, Luma, Rgb};

use crate::RenderedImage;
use crate::image::HIT;

type Picture = ImageBuffer<Rgb<f32>, Vec<f32>>;
type Energy = ImageBuffer<Luma<f32>, Vec<f32>>;

/// Blurs between which the bands of a picture lie, standard deviations in pixels.
const BANDS: [f32; 3] = [1.0, 2.0, 4.0];
/// Window over which a band's contrast is measured, over its blur.
const WINDOW: f32 = 2.0;
/// No contrast is raised more.
const MOST: f32 = 3.0;
/// Added to squared contrast, so that noise far below a level of 8 bits is nothing to match.
const FLAT: f32 = 1e-6;

/// The mean of `pictures`, each pixel's distance weighted by opacity, with its local contrast as in the pictures themselves.
///
/// # Panics
/// If there are no pictures, or they differ in size.
pub(crate) fn combine(mut pictures: Vec<RenderedImage>) -> RenderedImage {
    if pictures.len() == 1 {
        return pictures.remove(0);
    }
    let share = 1.0 / pictures.len() as f32;
    let pixels = pictures[0].rgb.len();
    let (mut acc, mut depth) = (vec![0f32; pixels], vec![0f32; pixels]);
    for picture in &pictures {
        for (((acc, depth), &a), &d) in acc.iter_mut().zip(&mut depth).zip(&picture.acc).zip(&picture.depth) {
            *acc += share * a;
            // Where a member hits nothing its distance counts for nothing.
            *depth += if d.is_finite() { share * a * d } else { 0.0 };
        }
    }
    let weight = |pixel: usize| {
        let seen = pictures.iter().filter(|picture| picture.depth[pixel].is_finite());
        seen.map(|picture| share * picture.acc[pixel]).sum::<f32>()
    };
    for (pixel, depth) in depth.iter_mut().enumerate() {
        *depth = if acc[pixel] > HIT { *depth / weight(pixel) } else { f32::INFINITY };
    }
    let counts = pictures.iter().skip(1).fold(pictures[0].counts, |mut sum, picture| {
        sum += picture.counts;
        sum
    });
    let (width, height) = (pictures[0].width, pictures[0].height);
    let rgb = blend(&pictures.iter().map(picture).collect::<Vec<_>>());
    RenderedImage { width, height, rgb: rgb.pixels().map(|pixel| pixel.0).collect(), depth, acc, counts }
}

fn picture(image: &RenderedImage) -> Picture {
    let numbers = image.rgb.as_flattened().to_vec();
    ImageBuffer::from_raw(image.width, image.height, numbers).expect("three numbers a pixel")
}

/// The mean of `pictures`, band by band with as much local contrast as they have on average.
///
/// Pictures that disagree on where an edge is have a blurred mean: nearer to the truth in squared error than any of them,
/// and with less detail than all of them. So each band of the mean, between two Gaussian blurs, is multiplied by
/// √(mean energy of the members' bands/energy of the mean's band) around each pixel, where that is above 1.
fn blend(pictures: &[Picture]) -> Picture {
    let mut members = pictures.to_vec();
    let mut mean = mean_of(&members);
    let mut out = ImageBuffer::new(mean.width(), mean.height());
    for sigma in BANDS {
        let window = WINDOW * sigma;
        let mut wanted: Energy = ImageBuffer::new(mean.width(), mean.height());
        for member in &mut members {
            let low = blur(member, sigma);
            let energy = energy(&difference(member, &low));
            add(&mut wanted, &energy);
            *member = low;
        }
        let low = blur(&mean, sigma);
        let band = difference(&mean, &low);
        let (wanted, present) = (blur(&wanted, window), blur(&energy(&band), window));
        let count = members.len() as f32;
        for (((out, band), wanted), present) in
            out.chunks_exact_mut(3).zip(band.chunks_exact(3)).zip(wanted.iter()).zip(present.iter())
        {
            let raise = ((wanted / count + FLAT) / (present + FLAT)).sqrt().clamp(1.0, MOST);
            for (out, band) in out.iter_mut().zip(band) {
                *out += raise * band;
            }
        }
        mean = low;
    }
    add(&mut out, &mean);
    out.iter_mut().for_each(|value: &mut f32| *value = value.clamp(0.0, 1.0));
    out
}

fn mean_of(pictures: &[Picture]) -> Picture {
    let mut mean = ImageBuffer::new(pictures[0].width(), pictures[0].height());
    for picture in pictures {
        add(&mut mean, picture);
    }
    mean.iter_mut().for_each(|value| *value /= pictures.len() as f32);
    mean
}

fn add<P: image::Pixel<Subpixel = f32>>(sum: &mut ImageBuffer<P, Vec<f32>>, other: &ImageBuffer<P, Vec<f32>>) {
    sum.iter_mut().zip(other.iter()).for_each(|(sum, value)| *sum += value);
}

fn difference(a: &Picture, b: &Picture) -> Picture {
    let numbers = a.iter().zip(b.iter()).map(|(a, b)| a - b).collect();
    ImageBuffer::from_raw(a.width(), a.height(), numbers).expect("as many numbers as before")
}

/// Mean of the channels' squares.
fn energy(band: &Picture) -> Energy {
    let numbers = band.pixels().map(|pixel| pixel.0.iter().map(|x| x * x).sum::<f32>() / 3.0).collect();
    ImageBuffer::from_raw(band.width(), band.height(), numbers).expect("one number a pixel")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Counts;

    const SIZE: u32 = 40;

    /// An edge at column `x`, of a surface at distance `depth`.
    fn edge(x: u32, depth: f32) -> RenderedImage {
        let pixels = (0..SIZE * SIZE).map(|pixel| pixel % SIZE < x);
        RenderedImage {
            width: SIZE,
            height: SIZE,
            rgb: pixels.clone().map(|inside| if inside { [0.2, 0.4, 0.1] } else { [1.0; 3] }).collect(),
            depth: pixels.clone().map(|inside| if inside { depth } else { f32::INFINITY }).collect(),
            acc: pixels.map(|inside| if inside { 1.0 } else { 0.0 }).collect(),
            counts: Counts::default(),
        }
    }

    /// Mean size of the steps between neighbours of a row.
    fn detail(rgb: &[[f32; 3]]) -> f32 {
        let squares =
            rgb.chunks_exact(SIZE as usize).flat_map(|row| row.windows(2)).map(|two| (two[1][0] - two[0][0]).powi(2));
        squares.sum::<f32>().sqrt()
    }

    #[test]
    fn equal_pictures_stay_as_they_are() {
        let combined = combine(vec![edge(20, 3.0), edge(20, 3.0)]);
        for (got, want) in combined.rgb.iter().zip(&edge(20, 3.0).rgb) {
            assert!(got.iter().zip(want).all(|(got, want)| (got - want).abs() < 1e-4), "{got:?} for {want:?}");
        }
        assert_eq!(combined.depth, edge(20, 3.0).depth);
    }

    #[test]
    fn contrast_is_between_the_mean_and_the_members() {
        let members = [edge(18, 2.0), edge(20, 2.0), edge(23, 4.0)];
        let combined = combine(members.to_vec());
        let mean: Vec<[f32; 3]> = (0..combined.rgb.len())
            .map(|pixel| [0, 1, 2].map(|c| members.iter().map(|member| member.rgb[pixel][c]).sum::<f32>() / 3.0))
            .collect();
        let (blurred, raised, sharp) = (detail(&mean), detail(&combined.rgb), detail(&members[0].rgb));
        assert!(1.2 * blurred < raised && raised < 1.05 * sharp, "{blurred}, {raised}, {sharp}");
        assert!(combined.rgb.as_flattened().iter().all(|value| (0.0..=1.0).contains(value)));
        // Two of three see the surface at column 19: opaque enough to have a distance, which is theirs.
        assert_eq!((combined.depth[0], combined.depth[21]), ((2.0 + 2.0 + 4.0) / 3.0, f32::INFINITY));
        assert!((combined.depth[19] - 3.0).abs() < 1e-6);
    }
}
