//! One file for each term; those on a field's own parameters share one.

pub(crate) mod entropy;
pub(crate) mod kl;
pub(crate) mod opacity_prior;
pub(crate) mod penalties;
pub(crate) mod photometric;
pub(crate) mod semantic;
pub(crate) mod silhouette;
pub(crate) mod stereo;
