//! One file for each term.

pub(crate) mod distortion;
pub(crate) mod entropy;
pub(crate) mod kl;
pub(crate) mod latent;
pub(crate) mod mask;
pub(crate) mod opacity_prior;
pub(crate) mod photometric;
pub(crate) mod semantic;
pub(crate) mod silhouette;
pub(crate) mod stereo;
pub(crate) mod tv;
