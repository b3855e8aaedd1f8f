//! Density level at which the surface is extracted.

use infonerf_scene::{Camera, resized_dimensions};

use crate::ExportError;
use crate::volume::Volume;

/// Number of rays along the longer side of each camera's image, and of samples per ray.
const RAYS: u32 = 32;
const SAMPLES: usize = 384;
/// Number of rays per query of the volume, which bounds the memory.
const CHUNK: usize = 512;
/// Ratio of successive densities that are tried. The first is half opaque over the box's side, the last over `FINEST` of it.
const FACTOR: f32 = 1.15;
const FINEST: f32 = 1.0 / 2000.0;
/// Share of the box's longest side at which distances are truncated.
const TRUNCATION: f32 = 0.05;
/// Ratio to the minimum error up to which densities count as equally good.
const ERROR_RATIO: f32 = 1.02;

/// Depths at which the light of a ray is absorbed.
struct RayDepths {
    /// Distance at which half of the light is left (median depth); `None` if less than half is absorbed.
    depth: Option<f32>,
    /// Densities that exceed all densities before them, each with its distance.
    peaks: Vec<(f32, f32)>,
    opacity: f32,
}

/// Finds the density σ of the isosurface that looks most like `volume` to `cameras`, 1/scene unit.
///
/// A ray that is at least half opaque, `∫σ dt ≥ ln 2`, should meet the surface at its median depth; any other ray should miss
/// the surface. The error of a density is the mean over rays of the distance between the point where σ first reaches it and the
/// median depth. Distances are truncated at 5 % of the box, which is also the error of a wrong miss or hit. The middle one of
/// the densities that are about as good as the best is returned. So the density depends on the field, and not on the voxels
/// that the surface is extracted from.
///
/// # Errors
/// If no ray is half opaque.
pub fn surface_density(volume: &dyn Volume, cameras: &[Camera]) -> Result<f32, ExportError> {
    let rays = ray_depths(volume, cameras);
    if rays.iter().all(|ray| ray.depth.is_none()) {
        let most = rays.iter().map(|ray| ray.opacity).fold(0.0, f32::max);
        return Err(ExportError(format!(
            "the field has no surface: of all rays of the training cameras the most opaque has opacity {most:.2}, \
             expected at least 0.5; train it longer"
        )));
    }
    let side = volume.bounds().size().max_element();
    let limit = TRUNCATION * side;
    let first = std::f32::consts::LN_2 / side;
    let rising = std::iter::successors(Some(first), |d| Some(d * FACTOR));
    let densities: Vec<f32> = rising.take_while(|d| d * FINEST <= first).collect();
    let error = |&density: &f32| {
        let of_ray = |ray: &RayDepths| {
            let met = ray.peaks.iter().find(|(sigma, _)| *sigma >= density).map(|(_, t)| *t);
            match (met, ray.depth) {
                (Some(met), Some(depth)) => (met - depth).abs().min(limit),
                (None, None) => 0.0,
                _ => limit,
            }
        };
        rays.iter().map(of_ray).sum::<f32>()
    };
    let errors: Vec<f32> = densities.iter().map(error).collect();
    let least = errors.iter().copied().fold(f32::INFINITY, f32::min);
    let good: Vec<f32> =
        densities.into_iter().zip(errors).filter(|(_, error)| *error <= ERROR_RATIO * least).map(|(d, _)| d).collect();
    Ok(good[good.len() / 2])
}

/// Finds the depths of rays of all cameras within the volume's box.
fn ray_depths(volume: &dyn Volume, cameras: &[Camera]) -> Vec<RayDepths> {
    let bounds = volume.bounds();
    let of_camera = |camera: &Camera| {
        let (width, height) = resized_dimensions(camera.width, camera.height, RAYS);
        let camera = camera.resized(width, height);
        (0..width * height).map(move |i| camera.ray((i % width) as f32 + 0.5, (i / width) as f32 + 0.5))
    };
    let rays = cameras.iter().flat_map(of_camera);
    let crossing = rays.filter_map(|ray| Some((ray, bounds.intersect(&ray).filter(|(near, far)| far > near)?)));
    let crossing: Vec<_> = crossing.map(|(ray, (near, far))| (ray, near, (far - near) / SAMPLES as f32)).collect();
    let of_chunk = |rays: &[_]| -> Vec<RayDepths> {
        let at = |&(ray, near, step): &(infonerf_scene::Ray, f32, f32)| {
            (0..SAMPLES).map(move |i| ray.origin + (near + (i as f32 + 0.5) * step) * ray.direction)
        };
        let densities = volume.density(&rays.iter().flat_map(at).collect::<Vec<_>>());
        let each = rays.iter().zip(densities.chunks_exact(SAMPLES));
        each.map(|(&(_, near, step), sigma)| depths_of(near, step, sigma)).collect()
    };
    crossing.chunks(CHUNK).flat_map(of_chunk).collect()
}

/// Finds the depths of a ray through densities in the middle of intervals of length `step`, from `near` on.
fn depths_of(near: f32, step: f32, densities: &[f32]) -> RayDepths {
    let (mut tau, mut depth, mut peaks) = (0.0, None, Vec::<(f32, f32)>::new());
    for (i, &sigma) in densities.iter().enumerate() {
        let t = near + (i as f32 + 0.5) * step;
        if sigma > peaks.last().map_or(0.0, |(densest, _)| *densest) {
            peaks.push((sigma, t));
        }
        tau += sigma * step;
        if depth.is_none() && tau >= std::f32::consts::LN_2 {
            depth = Some(t);
        }
    }
    RayDepths { depth, peaks, opacity: -(-tau).exp_m1() }
}

#[cfg(test)]
mod tests {
    use infonerf_procedural::train_cameras;

    use super::*;
    use crate::chamfer::chamfer;
    use crate::grid::DensityGrid;
    use crate::surface::Surface;
    use crate::volume::testing::Ball;

    /// Ball of fog that thickens over a fifth of the radius.
    const FUZZY: Ball = Ball { radius: 1.0, sharpness: 12.0 };

    #[test]
    fn the_surface_is_where_light_is_stopped() {
        let cameras = train_cameras(32);
        let level = surface_density(&FUZZY, &cameras).unwrap();
        let meets = |camera: &Camera, i: u32| {
            let ray = camera.ray((i % 32) as f32 + 0.5, (i / 32) as f32 + 0.5);
            FUZZY.bounds().intersect(&ray).is_some_and(|(near, far)| near < far)
        };
        let crossing: usize = cameras.iter().map(|c| (0..32 * 32).filter(|&i| meets(c, i)).count()).sum();
        assert_eq!(ray_depths(&FUZZY, &cameras).len(), crossing);
        // Half of the light of a ray through the centre is left at this radius.
        let points: Vec<_> = (0..4000).map(|i| glam::Vec3::X * (3.0 - i as f32 * 1e-3)).collect();
        let depth = depths_of(0.0, 1e-3, &FUZZY.density(&points)).depth.unwrap();
        let (found, expected) = (FUZZY.radius_at(level), 3.0 - depth);
        assert!((found - expected).abs() < 0.05, "density {level}: {found} for {expected}");
    }

    /// With a density that grows with the resolution, such as that of a half-opaque voxel, the surface would shrink.
    #[test]
    fn finer_voxels_are_never_worse() {
        let level = surface_density(&FUZZY, &train_cameras(32)).unwrap();
        let radius = FUZZY.radius_at(level);
        let truth: Vec<_> = FUZZY.surface(96).sample(20_000).iter().map(|p| radius * p.normalize()).collect();
        let distance = |resolution| {
            let surface = Surface::extract(&DensityGrid::sample(&FUZZY, resolution, level).unwrap()).unwrap();
            chamfer(&surface.sample(20_000), &truth).unwrap().mean()
        };
        let distances = [8, 16, 32, 64].map(distance);
        assert!(distances.windows(2).all(|pair| pair[1] < 1.02 * pair[0]), "{distances:?}");
    }

    #[test]
    fn fog_that_stops_too_little_has_no_surface() {
        let mist = Ball { radius: 0.5, sharpness: 0.2 };
        let text = surface_density(&mist, &train_cameras(16)).unwrap_err().to_string();
        assert!(text.contains("no surface") && text.contains("expected at least 0.5"), "{text}");
        assert!(!text.contains('\n'), "{text}");
    }
}
