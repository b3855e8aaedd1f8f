//! Depth maps of posed photographs by plane-sweep stereo.
//!
//! For each view, the views beside it are warped onto surfaces of constant disparity (Collins 1996), compared with it by
//! normalised cross-correlation over windows, smoothed by semi-global matching (Hirschmüller 2008), and what two views do
//! not agree on is dropped. Only the photographs and their cameras are used.
//!
//! ```
//! use infonerf_scene::{SceneRequest, SceneSource, ViewSelection, load};
//! use infonerf_stereo::{Settings, depth_maps};
//!
//! let train = ViewSelection::Seed { seed: 0, count: 3 };
//! let request = SceneRequest { train, image_size: Some(48), ..SceneRequest::default() };
//! let scene = load(&SceneSource::Procedural("room".into()), &request)?;
//! let maps = depth_maps(&scene, &Settings::default());
//! assert_eq!(maps.len(), 3);
//! let agreed: usize = maps.iter().map(|map| map.matched()).sum();
//! assert!(agreed > 100, "{agreed}");
//! # Ok::<(), infonerf_scene::SceneError>(())
//! ```

mod agreement;
mod correlation;
mod grey;
mod map;
mod neighbours;
mod semi_global;
mod sweep;

use infonerf_scene::{Camera, Scene};

use crate::grey::Grey;
use crate::sweep::Sweep;

pub use map::DepthMap;

/// What a search is made with.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// The longest side of the images that are compared, in pixels; larger ones are averaged down.
    pub size: u32,
    /// Views that each view is compared with, at most.
    pub neighbours: usize,
    /// Candidate depths per ray, at most.
    pub planes: usize,
    /// Half the side of the windows that are compared, in pixels.
    pub window: usize,
    /// How far two views may disagree on where a point is, in steps between planes.
    pub tolerance: f32,
}

impl Default for Settings {
    fn default() -> Self {
        Self { size: 252, neighbours: 4, planes: 192, window: 3, tolerance: 1.5 }
    }
}

/// The depth of each training view of `scene`, in their order; nothing is matched in a view that no other one is close to.
pub fn depth_maps(scene: &Scene, settings: &Settings) -> Vec<DepthMap> {
    let images: Vec<Grey> = scene.train.iter().map(|view| Grey::of(&view.image, settings.size)).collect();
    let cameras: Vec<Camera> = scene
        .train
        .iter()
        .zip(&images)
        .map(|(view, image)| view.camera.resized(image.width as u32, image.height as u32))
        .collect();
    let pairs: Vec<Vec<usize>> =
        (0..cameras.len()).map(|view| neighbours::of(scene, &cameras, view, settings.neighbours)).collect();
    let maps: Vec<DepthMap> = (0..cameras.len())
        .map(|view| {
            let sweep = Sweep::new(scene, &cameras, view, &pairs[view], settings.planes);
            let others: Vec<_> = pairs[view].iter().map(|&other| (&images[other], &cameras[other])).collect();
            let costs = sweep.costs(&images[view], &others, settings.window);
            let labels = semi_global::labels(&costs, sweep.planes(), &images[view]);
            sweep.depths(&labels)
        })
        .collect();
    agreement::agreed(&maps, &cameras, &pairs, settings.tolerance)
}
