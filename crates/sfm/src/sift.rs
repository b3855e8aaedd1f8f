//! Scale-invariant features (Lowe 2004) with RootSIFT descriptors (Arandjelović and Zisserman 2012).

use std::f32::consts::TAU;

use glam::DVec2;
use infonerf_scene::image::GreyImage;
use nalgebra::{Matrix3, Vector3};

/// Number of values per descriptor: 4 × 4 cells of 8 orientations.
pub(crate) const LENGTH: usize = CELLS * CELLS * BINS;
const CELLS: usize = 4;
const BINS: usize = 8;
const SCALES: usize = 3;
/// Blur of the first image of each octave, in its pixels.
const SIGMA: f32 = 1.6;
/// Assumed blur of a photograph, in its pixels.
const CAMERA_SIGMA: f32 = 0.5;
/// Min absolute value of an extremum of the difference of Gaussians; smaller ones are noise.
const CONTRAST: f32 = 0.005;
/// Max ratio of principal curvatures; larger ones are edges.
const EDGE: f32 = 10.0;
/// Min side of an octave in pixels.
const MIN_SIDE: usize = 16;
/// Width, in pixels, of the border in which there are no features.
const BORDER: usize = 5;
/// Number of bins of the histogram of orientations.
const ANGLES: usize = 36;
/// Min ratio of a peak of that histogram to the highest one at which it is an orientation too; two are used at most.
const PEAK: f32 = 0.8;
/// Max longest side, in pixels, of photographs that are doubled first.
const DOUBLED: usize = 1024;

#[derive(Clone, Debug, Default)]
pub(crate) struct Features {
    /// Positions in pixels, by decreasing contrast; the centre of the first pixel is (0.5, 0.5).
    pub(crate) pixels: Vec<DVec2>,
    /// Descriptors of unit length, [`LENGTH`] values each.
    pub(crate) descriptors: Vec<f32>,
}

/// Finds the `max_features` features of `image` with highest contrast, at pixels that `mask` (row-major) allows.
pub(crate) fn features(image: &GreyImage, mask: Option<&[bool]>, max_features: usize) -> Features {
    let counts = |pixel: DVec2| mask.is_none_or(|mask| mask[pixel.y as usize * image.width + pixel.x as usize]);
    let (mut base, mut spacing) = first_level(image);
    let mut found = Vec::new();
    while base.width.min(base.height) >= MIN_SIDE {
        let octave = Octave::new(base);
        for extremum in octave.extrema() {
            let pixel = (DVec2::new(extremum.x.into(), extremum.y.into())) * spacing + 0.5;
            if !counts(pixel) {
                continue;
            }
            let level = &octave.levels[extremum.level];
            for angle in orientations(level, &extremum) {
                found.push((extremum.contrast, pixel, descriptor(level, &extremum, angle)));
            }
        }
        base = halved(&octave.levels[SCALES]);
        spacing *= 2.0;
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.truncate(max_features);
    let mut features = Features::default();
    for (_, pixel, descriptor) in found {
        features.pixels.push(pixel);
        features.descriptors.extend(descriptor);
    }
    features
}

/// Returns the first image of the first octave, with a blur of [`SIGMA`], and its pixel spacing in pixels of `image`.
fn first_level(image: &GreyImage) -> (GreyImage, f64) {
    let double = image.width.max(image.height) <= DOUBLED;
    let (base, sigma) = if double { (doubled(image), 2.0 * CAMERA_SIGMA) } else { (image.clone(), CAMERA_SIGMA) };
    (blurred(&base, (SIGMA * SIGMA - sigma * sigma).sqrt()), if double { 0.5 } else { 1.0 })
}

/// Images of one size with increasing blur, and their differences.
struct Octave {
    levels: Vec<GreyImage>,
    differences: Vec<GreyImage>,
}

/// A feature within an octave, in its pixels.
struct Extremum {
    x: f32,
    y: f32,
    /// Blur at which it is extremal.
    sigma: f32,
    /// Index of the blurred image whose blur is closest to `sigma`.
    level: usize,
    contrast: f32,
}

impl Octave {
    fn new(base: GreyImage) -> Self {
        let sigma = |level: usize| SIGMA * 2f32.powf(level as f32 / SCALES as f32);
        let mut levels = vec![base];
        for i in 1..SCALES + 3 {
            levels.push(blurred(&levels[i - 1], (sigma(i).powi(2) - sigma(i - 1).powi(2)).sqrt()));
        }
        let difference = |pair: &[GreyImage]| {
            let values = pair[1].values.iter().zip(&pair[0].values).map(|(a, b)| a - b).collect();
            GreyImage { values, ..pair[1] }
        };
        Self { differences: levels.windows(2).map(difference).collect(), levels }
    }

    fn extrema(&self) -> Vec<Extremum> {
        let (width, height) = (self.levels[0].width, self.levels[0].height);
        let mut found = Vec::new();
        for s in 1..=SCALES {
            for y in BORDER..height.saturating_sub(BORDER) {
                for x in BORDER..width.saturating_sub(BORDER) {
                    if self.is_extremal(s, x, y) {
                        found.extend(self.refined(s, x, y));
                    }
                }
            }
        }
        found
    }

    /// Whether the difference of Gaussians at a pixel is above or below all 26 around it.
    fn is_extremal(&self, s: usize, x: usize, y: usize) -> bool {
        let value = self.differences[s].at(x, y);
        if value.abs() < 0.5 * CONTRAST {
            return false;
        }
        let width = self.levels[0].width;
        let sign = value.signum();
        self.differences[s - 1..=s + 1].iter().enumerate().all(|(ds, image)| {
            (y - 1..=y + 1).all(|row| {
                let at = row * width + x;
                let values = &image.values[at - 1..=at + 1];
                values.iter().enumerate().all(|(dx, v)| (ds, row, dx) == (1, y, 1) || sign * v < sign * value)
            })
        })
    }

    /// Returns the extremum of the quadratic through adjacent values; `None` if it is weak, on an edge, or does not converge.
    fn refined(&self, mut s: usize, mut x: usize, mut y: usize) -> Option<Extremum> {
        let (width, height) = (self.levels[0].width, self.levels[0].height);
        for _ in 0..5 {
            let at = |dx: isize, dy: isize, ds: isize| {
                self.differences[s.wrapping_add_signed(ds)].at(x.wrapping_add_signed(dx), y.wrapping_add_signed(dy))
            };
            let value = at(0, 0, 0);
            let unit = [(1, 0, 0), (0, 1, 0), (0, 0, 1)];
            let derivative =
                |i: usize| 0.5 * (at(unit[i].0, unit[i].1, unit[i].2) - at(-unit[i].0, -unit[i].1, -unit[i].2));
            let bend = |i: usize, j: usize| {
                let ((ax, ay, az), (bx, by, bz)) = (unit[i], unit[j]);
                if i == j {
                    return at(ax, ay, az) + at(-ax, -ay, -az) - 2.0 * value;
                }
                let (p, m) = ((ax + bx, ay + by, az + bz), (ax - bx, ay - by, az - bz));
                0.25 * (at(p.0, p.1, p.2) + at(-p.0, -p.1, -p.2) - at(m.0, m.1, m.2) - at(-m.0, -m.1, -m.2))
            };
            let gradient = Vector3::from_fn(|i, _| derivative(i));
            let hessian = Matrix3::from_fn(bend);
            let step = -(hessian.lu().solve(&gradient)?);
            if step.amax() < 0.5 {
                let contrast = (value + 0.5 * gradient.dot(&step)).abs();
                let trace = hessian[(0, 0)] + hessian[(1, 1)];
                let det = hessian[(0, 0)] * hessian[(1, 1)] - hessian[(0, 1)].powi(2);
                let on_edge = det <= 0.0 || trace * trace * EDGE >= (EDGE + 1.0).powi(2) * det;
                let scale = s as f32 + step.z;
                let (x, y) = (x as f32 + step.x, y as f32 + step.y);
                let (sigma, level) = (SIGMA * 2f32.powf(scale / SCALES as f32), scale.round() as usize);
                return (contrast >= CONTRAST && !on_edge).then_some(Extremum { x, y, sigma, level, contrast });
            }
            let moved = |v: usize, by: f32, least: usize, most: usize| {
                let to = v as f32 + by.round();
                (to >= least as f32 && to <= most as f32).then_some(to as usize)
            };
            x = moved(x, step.x, BORDER, width - 1 - BORDER)?;
            y = moved(y, step.y, BORDER, height - 1 - BORDER)?;
            s = moved(s, step.z, 1, SCALES)?;
        }
        None
    }
}

/// Calls `visit` with offset, magnitude and angle of the gradient at each pixel within `radius` of the feature.
fn gradients(image: &GreyImage, at: &Extremum, radius: f32, mut visit: impl FnMut(f32, f32, f32, f32)) {
    let range = |centre: f32, size: usize| {
        let first = (centre - radius).ceil().max(1.0) as usize;
        first..=((centre + radius).floor().max(0.0) as usize).min(size - 2)
    };
    for y in range(at.y, image.height) {
        for x in range(at.x, image.width) {
            let dx = image.at(x + 1, y) - image.at(x - 1, y);
            let dy = image.at(x, y + 1) - image.at(x, y - 1);
            visit(x as f32 - at.x, y as f32 - at.y, dx.hypot(dy), dy.atan2(dx));
        }
    }
}

/// Returns the one or two dominant directions of the gradients around a feature.
fn orientations(image: &GreyImage, at: &Extremum) -> Vec<f32> {
    let sigma = 1.5 * at.sigma;
    let mut histogram = [0f32; ANGLES];
    gradients(image, at, 3.0 * sigma, |dx, dy, magnitude, angle| {
        let bin = (angle.rem_euclid(TAU) / TAU * ANGLES as f32) as usize % ANGLES;
        histogram[bin] += magnitude * (-0.5 * (dx * dx + dy * dy) / (sigma * sigma)).exp();
    });
    let beside = |h: &[f32; ANGLES], i: usize| (h[(i + ANGLES - 1) % ANGLES], h[(i + 1) % ANGLES]);
    for _ in 0..2 {
        let rough = histogram;
        for (i, value) in histogram.iter_mut().enumerate() {
            let (left, right) = beside(&rough, i);
            *value = 0.25 * left + 0.5 * rough[i] + 0.25 * right;
        }
    }
    let highest = histogram.iter().copied().fold(0.0, f32::max);
    let peak = |i: usize| {
        let (left, right) = beside(&histogram, i);
        let value = histogram[i];
        (value >= PEAK * highest && value > left && value >= right).then(|| {
            let shift = 0.5 * (left - right) / (left - 2.0 * value + right);
            (value, (i as f32 + 0.5 + shift) / ANGLES as f32 * TAU)
        })
    };
    let mut peaks: Vec<(f32, f32)> = (0..ANGLES).filter_map(peak).collect();
    peaks.sort_by(|a, b| b.0.total_cmp(&a.0));
    peaks.into_iter().take(2).map(|(_, angle)| angle).collect()
}

/// Returns histograms of gradients in 4 × 4 cells turned by `angle`, scaled to sum 1, their square roots taken (RootSIFT).
fn descriptor(image: &GreyImage, at: &Extremum, angle: f32) -> [f32; LENGTH] {
    let cell = 3.0 * at.sigma;
    let (sin, cos) = angle.sin_cos();
    let mut histogram = [0f32; LENGTH];
    let half = CELLS as f32 / 2.0;
    gradients(image, at, cell * 2f32.sqrt() * (half + 0.5), |dx, dy, magnitude, direction| {
        let (u, v) = ((cos * dx + sin * dy) / cell, (cos * dy - sin * dx) / cell);
        let weight = magnitude * (-0.5 * (u * u + v * v) / (half * half)).exp();
        let (column, row) = (u + half - 0.5, v + half - 0.5);
        if column.min(row) <= -1.0 || column.max(row) >= CELLS as f32 {
            return;
        }
        let bin = (direction - angle).rem_euclid(TAU) / TAU * BINS as f32;
        let share = |value: f32, i: f32| 1.0 - (value - i).abs();
        for r in [row.floor(), row.floor() + 1.0] {
            for c in [column.floor(), column.floor() + 1.0] {
                if r < 0.0 || c < 0.0 || r >= CELLS as f32 || c >= CELLS as f32 {
                    continue;
                }
                for b in [bin.floor(), bin.floor() + 1.0] {
                    let index = (r as usize * CELLS + c as usize) * BINS + b as usize % BINS;
                    histogram[index] += weight * share(row, r) * share(column, c) * share(bin, b);
                }
            }
        }
    });
    let length = histogram.iter().map(|v| v * v).sum::<f32>().sqrt().max(f32::MIN_POSITIVE);
    histogram.iter_mut().for_each(|v| *v = v.min(0.2 * length));
    let sum = histogram.iter().sum::<f32>().max(f32::MIN_POSITIVE);
    histogram.map(|v| (v / sum).sqrt())
}

/// Convolves `image` with a Gaussian of `sigma` pixels; the border is repeated.
fn blurred(image: &GreyImage, sigma: f32) -> GreyImage {
    let radius = (4.0 * sigma).ceil() as usize;
    let kernel: Vec<f32> =
        (0..=2 * radius).map(|i| (-0.5 * ((i as f32 - radius as f32) / sigma).powi(2)).exp()).collect();
    let sum: f32 = kernel.iter().sum();
    let (width, height) = (image.width, image.height);
    let mut across = vec![0.0; width * height];
    let mut padded = vec![0.0; width + 2 * radius];
    for (row, out) in image.values.chunks_exact(width).zip(across.chunks_exact_mut(width)) {
        padded[..radius].fill(row[0]);
        padded[radius..radius + width].copy_from_slice(row);
        padded[radius + width..].fill(row[width - 1]);
        for (i, k) in kernel.iter().enumerate() {
            add_scaled(out, &padded[i..i + width], k / sum);
        }
    }
    let mut values = vec![0.0; width * height];
    for (y, out) in values.chunks_exact_mut(width).enumerate() {
        for (i, k) in kernel.iter().enumerate() {
            let from = (y + i).saturating_sub(radius).min(height - 1) * width;
            add_scaled(out, &across[from..from + width], k / sum);
        }
    }
    GreyImage { width, height, values }
}

fn halved(image: &GreyImage) -> GreyImage {
    let (width, height) = (image.width / 2, image.height / 2);
    let values = (0..width * height).map(|i| image.at(2 * (i % width), 2 * (i / width))).collect();
    GreyImage { width, height, values }
}

/// Doubles the size: pixel `2 x` of the result is pixel `x`; pixels between are means.
fn doubled(image: &GreyImage) -> GreyImage {
    let (width, height) = (2 * image.width, 2 * image.height);
    let value = |i: usize| {
        let (x, y) = (i % width, i / width);
        let (right, below) = (x.div_ceil(2).min(image.width - 1), y.div_ceil(2).min(image.height - 1));
        let (x, y) = (x / 2, y / 2);
        0.25 * (image.at(x, y) + image.at(right, y) + image.at(x, below) + image.at(right, below))
    };
    GreyImage { width, height, values: (0..width * height).map(value).collect() }
}

fn add_scaled(out: &mut [f32], values: &[f32], factor: f32) {
    out.iter_mut().zip(values).for_each(|(o, v)| *o += factor * v);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(side: usize, value: impl Fn(f32, f32) -> f32) -> GreyImage {
        let middle = (side / 2) as f32;
        let at = |i: usize| value((i % side) as f32 - middle, (i / side) as f32 - middle);
        GreyImage { width: side, height: side, values: (0..side * side).map(at).collect() }
    }

    fn middle(image: &GreyImage) -> Extremum {
        let at = (image.width / 2) as f32;
        Extremum { x: at, y: at, sigma: 2.0, level: 0, contrast: 1.0 }
    }

    /// Checks that the camera's blur of 0.5 pixels, or 1 after doubling, and the added blur combine to [`SIGMA`].
    #[test]
    fn the_first_level_has_the_blur_of_an_octave() {
        for (side, before) in [(65, 2.0 * CAMERA_SIGMA), (DOUBLED + 1, CAMERA_SIGMA)] {
            let (base, spacing) = first_level(&image(side, |x, y| if (x, y) == (0.0, 0.0) { 1.0 } else { 0.0 }));
            let centre = ((side / 2) as f64 / spacing) as usize;
            let row: Vec<f32> = (0..base.width).map(|x| base.at(x, centre)).collect();
            let sum: f32 = row.iter().sum();
            let variance: f32 = row.iter().zip(0..).map(|(v, x)| v / sum * (x as f32 - centre as f32).powi(2)).sum();
            // Interpolation by doubling adds a variance of 0.5 square pixels.
            let interpolated = if spacing < 1.0 { 0.5 } else { 0.0 };
            let added = SIGMA * SIGMA - before * before;
            assert!((variance - interpolated - added).abs() < 0.03, "{side}: {variance} {added}");
        }
    }

    #[test]
    fn the_orientation_is_that_of_near_gradients_interpolated_between_bins() {
        let found = |value: &dyn Fn(f32, f32) -> f32| -> Vec<f32> {
            let image = image(61, value);
            orientations(&image, &middle(&image)).iter().map(|angle| angle.to_degrees()).collect()
        };
        let ramp = found(&|x, y| 0.01 * (x + y));
        assert!(ramp.len() == 1 && (ramp[0] - 45.0).abs() < 0.1, "{ramp:?}");
        // Within 3 pixels of the middle gradients point right, farther away left, where there are more.
        let turned = found(&|x, _| 0.01 * if x.abs() < 3.0 { x } else { x.signum() * (6.0 - x.abs()) });
        assert!(turned.len() == 1 && turned[0] < 10.0, "{turned:?}");
        // 45° near the middle, 55° farther away.
        let between =
            found(&|x, y| 0.01 * (y + if x.abs() < 3.0 { x } else { x.signum() * (3.0 + 0.7 * (x.abs() - 3.0)) }));
        assert!(between.len() == 1 && (46.0..50.0).contains(&between[0]), "{between:?}");
    }

    #[test]
    fn descriptors_count_gradients_relative_to_the_orientation() {
        let (image, mut corners) = (image(61, |x, y| 0.01 * (x + y)), Vec::new());
        for (angle, bin) in [(0.0, 1), (45.0, 0), (90.0, 7), (-45.0, 2)] {
            let found = descriptor(&image, &middle(&image), f32::to_radians(angle));
            for cell in found.chunks_exact(BINS) {
                let most = (0..BINS).max_by(|a, b| cell[*a].total_cmp(&cell[*b])).unwrap();
                assert_eq!(most, bin, "{angle}: {cell:?}");
            }
            assert!((found.iter().map(|v| v * v).sum::<f32>() - 1.0).abs() < 1e-5);
            corners.push(found[bin]);
        }
        // The corners of the turned cells are within reach, too.
        assert!(corners.iter().all(|corner| (corner - corners[0]).abs() < 1e-3), "{corners:?}");
    }
}
