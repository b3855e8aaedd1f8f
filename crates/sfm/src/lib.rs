//! Cameras and points from a few photographs of a scene that does not move: structure from motion.
//!
//! SIFT features (Lowe 2004) are matched between pairs of photographs. The relative pose that most matches of a pair
//! agree on comes from the five-point method and RANSAC. The reconstruction starts from a pair with many matches
//! under large angles; each further photograph is placed by the points that it sees (P3P and RANSAC), after which
//! bundle adjustment refines all poses, all points and the lens. The result does not depend on the number of threads.

mod bundle;
mod camera;
mod contradictions;
mod essential;
mod mapper;
mod matching;
mod p3p;
mod ransac;
mod reconstruction;
mod refine;
mod sift;
#[cfg(test)]
mod testing;
mod two_view;

pub use bundle::Point;
pub use camera::{Pose, SimpleRadial, ray};
pub use matching::max_matched_pairs;
pub use reconstruction::{NoReconstruction, Photograph, SparseModel, reconstruct};
pub use refine::{Refined, Uncertainty, refine};
pub use two_view::{ImageMatches, explains, verified_matches};
