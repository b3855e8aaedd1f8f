//! Cameras and points from a few photographs of a scene that does not move: structure from motion.
//!
//! SIFT features of each photograph are matched among all pairs; the relative pose on which most matches of a pair agree
//! comes from five points and RANSAC. From the pair with many matches under a large angle on, photographs are placed one by
//! one by the points that they see (P3P and RANSAC), and after each all is adjusted together, the lens too.
//! The same photographs give the same result, on any number of threads.

mod bundle;
mod camera;
mod essential;
mod mapper;
mod matching;
mod p3p;
mod pairs;
mod polynomial;
mod ransac;
mod reconstruction;
mod refine;
mod scale_space;
mod sift;
#[cfg(test)]
mod testing;
mod tracks;
mod triangulate;
mod two_view;

pub use bundle::Point;
pub use camera::{Pose, SimpleRadial};
pub use pairs::{ImageMatches, explains, verified_matches};
pub use reconstruction::{Photograph, SfmSettings, SparseModel, reconstruct};
pub use refine::{Posed, Refined, Uncertainty, refine};
