//! The training images, and the pixels of them that a step learns from.

use std::sync::Arc;

use infonerf_ops::random::permuted;
use infonerf_render::{Noise, RandomStream};
use infonerf_scene::{Camera, Image, PixelAt, Scene, View};
use infonerf_schedule::Moment;

use crate::config::{Batch, TrainConfig};
use crate::pixels::{Pixels, central_half, crop};

/// The training images of a scene at every size that a run uses.
#[derive(Clone, Debug)]
pub(crate) struct TrainingImages {
    pub(crate) cameras: Arc<[Camera]>,
    /// Full size first.
    sizes: Vec<Images>,
}

/// Training images at one size.
#[derive(Clone, Debug)]
pub(crate) struct Images {
    /// Factor by which the images are smaller than at full size: the width of their pixels, in pixels of that size.
    pub(crate) factor: u32,
    /// Image of each view; at full size the scene's own.
    views: Vec<Arc<Image>>,
    /// Pixels that can be drawn; `None` if all can be drawn.
    valid: Option<ValidPixels>,
}

/// Indices of the valid pixels among all pixels of the training images, in ascending order.
#[derive(Clone, Debug)]
struct ValidPixels {
    /// Pixels of the whole images.
    whole: Vec<usize>,
    /// Pixels of the images' central halves; for a view without valid pixels there, all its valid pixels.
    central: Vec<usize>,
}

impl ValidPixels {
    /// Returns the squares of `factor` × `factor` pixels whose pixels are all valid; `None` if a view has no such square.
    fn of(views: &[View], factor: u32) -> Option<Self> {
        let image = &views[0].image;
        let (stride, width, height) = (image.width, image.width / factor, image.height / factor);
        let [columns, rows] = [width, height].map(|size| {
            let (first, count) = central_half(size);
            first..first + count
        });
        let (mut whole, mut central) = (Vec::new(), Vec::new());
        for (view_index, view) in views.iter().enumerate() {
            let is_valid = |&(x, y): &(u32, u32)| {
                let mut square = (0..factor * factor).map(|i| (x * factor + i % factor, y * factor + i / factor));
                view.valid.as_ref().is_none_or(|valid| square.all(|(x, y)| valid[(y * stride + x) as usize]))
            };
            let valid: Vec<_> = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).filter(is_valid).collect();
            if valid.is_empty() {
                return None;
            }
            let index_of =
                |&(x, y): &(u32, u32)| (view_index * height as usize + y as usize) * width as usize + x as usize;
            let is_central = |&(x, y): &(u32, u32)| columns.contains(&x) && rows.contains(&y);
            let has_centre = valid.iter().any(is_central);
            whole.extend(valid.iter().map(index_of));
            central.extend(valid.iter().filter(|&pixel| !has_centre || is_central(pixel)).map(index_of));
        }
        Some(Self { whole, central })
    }
}

impl TrainingImages {
    /// Returns the images of `scene` at full size, at which every view has a valid pixel, and box-filtered by each factor
    /// that `config` asks for and at which every view has one.
    pub(crate) fn new(scene: &Scene, config: &TrainConfig) -> Self {
        let (width, height) = (scene.train[0].image.width, scene.train[0].image.height);
        let is_partial = scene.train.iter().any(|view| view.valid.is_some());
        let factors = config.downscale_factors().filter(|&factor| factor <= width.min(height));
        let sized = |factor| {
            let valid = if is_partial { Some(ValidPixels::of(&scene.train, factor)?) } else { None };
            let views = scene.train.iter().map(|view| downscaled(&view.image, factor)).collect();
            Some(Images { factor, views, valid })
        };
        let sizes: Vec<Images> = factors.filter_map(sized).collect();
        assert!(sizes.first().is_some_and(|images| images.factor == 1), "every training view has a valid pixel");
        Self { cameras: scene.training_cameras().into(), sizes }
    }

    /// Returns the images that a run learns from at a moment; at full size if there are none of its size.
    pub(crate) fn at(&self, config: &TrainConfig, at: Moment) -> &Images {
        let factor = config.downscale.at(at).round().max(1.0) as u32;
        self.sizes.iter().find(|images| images.factor == factor).unwrap_or(&self.sizes[0])
    }

    /// Draws `rays` pixels for the step at `at`. Also returns the colour of each.
    pub(crate) fn draw(&self, config: &TrainConfig, rays: usize, at: Moment, noise: Noise) -> (Pixels, Vec<[f32; 3]>) {
        let images = self.at(config, at);
        let indices = images.indices(config, rays, at.step, noise);
        let [stride, area] = images.stride_and_area();
        let scale = images.factor as f32;
        let position = |&index: &usize| {
            let (x, y) = ((index % area) % stride, (index % area) / stride);
            PixelAt { view: index / area, x: (x as f32 + 0.5) * scale, y: (y as f32 + 0.5) * scale }
        };
        let pixels = Pixels { cameras: self.cameras.clone(), at: indices.iter().map(position).collect(), width: scale };
        (pixels, indices.iter().map(|index| images.views[index / area].rgb[index % area]).collect())
    }
}

impl Images {
    /// Returns the numbers of pixels in a row and in an image.
    fn stride_and_area(&self) -> [usize; 2] {
        [self.views[0].width as usize, self.views[0].rgb.len()]
    }

    /// Draws the indices of `rays` pixels among all pixels of the training images.
    fn indices(&self, config: &TrainConfig, rays: usize, step: usize, noise: Noise) -> Vec<usize> {
        let [(left, columns), (top, rows)] =
            [self.views[0].width, self.views[0].height].map(|size| crop(config, step, size));
        let [stride, area] = self.stride_and_area();
        let [view, column, row] =
            [RandomStream::View, RandomStream::Column, RandomStream::Row].map(|stream| noise.child(stream));
        let drawable = self.valid.as_ref().map(|valid| match step < config.precrop_steps {
            true => valid.central.as_slice(),
            false => valid.whole.as_slice(),
        });
        let place = |image: usize, x: usize, y: usize| image * area + (top + y) * stride + left + x;
        match (config.batch, drawable) {
            (Batch::Pixels, Some(drawable)) => {
                (0..rays).map(|ray| drawable[row.below(ray, 0, drawable.len())]).collect()
            }
            (Batch::Pixels, None) => {
                let image = |ray| view.below(ray, 0, self.views.len());
                let draw = |ray| place(image(ray), column.below(ray, 0, columns), row.below(ray, 0, rows));
                (0..rays).map(draw).collect()
            }
            (Batch::Image | Batch::HeldOut, drawable) => {
                let image = view.below(0, 0, self.views.len());
                let drawable = drawable.map(|all| {
                    let before = |end: usize| all.partition_point(|&index| index < end);
                    &all[before(image * area)..before((image + 1) * area)]
                });
                let pixels = drawable.map_or(columns * rows, <[usize]>::len);
                let index = |pixel: usize| match drawable {
                    Some(drawable) => drawable[pixel],
                    None => place(image, pixel % columns, pixel / columns),
                };
                (0..rays.min(pixels)).map(|ray| index(permuted(column.bits(), ray, pixels))).collect()
            }
        }
    }
}

/// Takes means over squares of `factor` × `factor` pixels; the rest at the right and lower edges is cut off. With factor 1, the
/// image is shared and not copied.
fn downscaled(image: &Arc<Image>, factor: u32) -> Arc<Image> {
    if factor == 1 {
        return image.clone();
    }
    let share = 1.0 / (factor * factor) as f32;
    let square = |x: u32, y: u32| {
        let mut sum = [0.0; 3];
        for (dx, dy) in (0..factor).flat_map(|dy| (0..factor).map(move |dx| (dx, dy))) {
            let at = ((y * factor + dy) * image.width + x * factor + dx) as usize;
            sum.iter_mut().zip(image.rgb[at]).for_each(|(sum, value)| *sum += value * share);
        }
        sum
    };
    let (width, height) = (image.width / factor, image.height / factor);
    let rgb = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| square(x, y)).collect();
    Image { width, height, rgb, alpha: None }.into()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use infonerf_scene::ViewRegion;

    use super::*;
    use crate::config::{Config, Preset};
    use crate::pixels::{rotation, unseen_camera};
    use crate::testing::knot;

    /// Checks every kind of batch, size and crop; a view whose centre is invalid is drawn from elsewhere.
    #[test]
    fn invalid_pixels_are_never_drawn() {
        let mut scene = knot(2, 16);
        // The left half of the first view but one pixel, and the last rows of the second.
        let valid = |view: usize, x: usize, y: usize| if view == 0 { x < 8 && (x, y) != (6, 6) } else { y >= 14 };
        for (index, view) in scene.train.iter_mut().enumerate() {
            view.valid = Some((0..256).map(|i| valid(index, i % 16, i / 16)).collect());
        }
        for batch in ["pixels", "image"] {
            let settings = [&format!("train.batch={batch}"), "train.downscale={steps=[[0.0,2],[0.5,4],[0.9,1]]}"];
            let config = Config::of(Preset::Paper, settings).unwrap().train;
            let config = TrainConfig { precrop_steps: 30, ..config };
            let images = TrainingImages::new(&scene, &config);
            assert_eq!(images.sizes.iter().map(|images| images.factor).collect::<Vec<_>>(), [1, 2]);
            let mut drawn = [0; 2];
            for step in 0..60 {
                let at = Moment { step, progress: if step % 2 == 0 { 0.0 } else { 1.0 } };
                let noise = Noise::new(0, step as u64, RandomStream::SeenRays);
                let (seen, _) = images.draw(&config, 20, at, noise);
                let half = seen.width / 2.0;
                for PixelAt { view, x, y } in seen.at {
                    let corners = [(x - half, y - half), (x + half - 1.0, y + half - 1.0)];
                    assert!(corners.iter().all(|&(x, y)| valid(view, x as usize, y as usize)), "{view} {x} {y}");
                    assert!(view == 1 || step >= 30 || (4.0..12.0).contains(&x) && (4.0..12.0).contains(&y));
                    drawn[view] += 1;
                }
            }
            assert!(drawn.iter().all(|&count| count > 100), "{drawn:?}");
        }
    }

    /// Checks that the first steps draw from central halves alone, and that a batch of one image takes each pixel once.
    #[test]
    fn first_steps_draw_from_the_central_half() {
        let scene = knot(2, 16);
        for (batch, count) in [("pixels", 100), ("image", 64)] {
            let settings = [format!("train.batch={batch}"), "train.precrop_steps=10".to_owned()];
            let config = Config::of(Preset::Paper, settings).unwrap().train;
            let images = TrainingImages::new(&scene, &config);
            let [first, later] = [9, 10].map(|step| {
                let noise = Noise::new(0, step as u64, RandomStream::SeenRays);
                images.draw(&config, 100, Moment { step, progress: 0.0 }, noise).0.at
            });
            let is_central = |at: &PixelAt| (4.0..12.0).contains(&at.x) && (4.0..12.0).contains(&at.y);
            assert!(first.iter().all(is_central) && !later.iter().all(is_central), "{batch}");
            assert_eq!((first.len(), later.len()), (count, 100));
            for pixels in [first, later].iter().filter(|_| batch == "image") {
                let distinct: BTreeSet<_> = pixels.iter().map(|at| (at.view, at.x as u32, at.y as u32)).collect();
                assert_eq!(distinct.len(), pixels.len());
                assert!(pixels.iter().all(|at| at.view == pixels[0].view));
            }
        }
    }

    /// Checks that smaller images hold means of squares, and that cones of all kinds of rays are as wide as their pixels.
    #[test]
    fn smaller_images_have_wider_cones() {
        let scene = knot(2, 16);
        let downscale = "train.downscale={steps=[[0.0,4],[0.25,2],[0.5,50],[0.75,1]]}";
        let config = Config::of(Preset::Paper, [downscale]).unwrap().train;
        let images = TrainingImages::new(&scene, &config);
        let cameras = scene.training_cameras();
        let region = ViewRegion::new(&cameras);
        let noise = Noise::new(0, 0, RandomStream::SeenRays);
        let camera = unseen_camera(&scene, &region, &config, noise);
        let centre = cameras[0].ray(8.0, 8.0).radius;
        // No image is 50 times smaller: the full size is used.
        for (progress, width) in [(0.1, 4.0), (0.3, 2.0), (0.6, 1.0), (1.0, 1.0)] {
            let at = Moment { step: 0, progress };
            assert_eq!(images.at(&config, at).factor as f32, width);
            let (seen, colors) = images.draw(&config, 8, at, noise);
            for (&PixelAt { view, x, y }, color) in seen.at.iter().zip(colors) {
                let image = &scene.train[view].image;
                let square = |at: f32| (at - width / 2.0) as usize..(at + width / 2.0) as usize;
                let pixels = square(y).flat_map(|row| square(x).map(move |column| 16 * row + column));
                let sum = pixels.fold([0.0; 3], |sum, at| [0, 1, 2].map(|c| sum[c] + image.rgb[at][c]));
                assert!((0..3).all(|c| (color[c] - sum[c] / (width * width)).abs() < 1e-5), "{color:?} {sum:?}");
            }
            let near = seen.neighbours(rotation(&config.neighbours, noise), &config.neighbours, &region);
            let unseen = Pixels::draw(camera.clone(), 8, width, &config, 0, noise);
            for ray in [seen.rays(), near, unseen.rays()].concat() {
                let ratio = ray.radius / centre;
                assert!(ratio > 0.8 * width && ratio <= 1.0001 * width, "{ratio} at {progress}");
            }
        }
    }
}
