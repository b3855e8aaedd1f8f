//! Radiance fields as Burn modules: from positions and directions to density and colour.
//!
//! [`Field`] is the trait by which samplers, losses, occupancy grids and the trainer use a field: a field of another
//! crate implements it and is trained like those of this crate. [`RadianceField`] is any of the fields that config files
//! can name ([`FieldConfig`]); `list.rs` has the one list of them.
//!
//! Colour is computed only on request: the unseen rays of the entropy loss need density alone.
//!
//! ```
//! use burn::tensor::{Device, Tensor};
//! use infonerf_field::{Extent, Field, FieldConfig, FieldSetup, Points, RadianceField};
//! use infonerf_schedule::Moment;
//!
//! let config: FieldConfig = toml::from_str(
//!     "kind = 'nerf'\nlayers = 2\nwidth = 16\nskip = 2\nposition_frequencies = 4\ndirection_frequencies = 2\n\
//!      density = 'softplus'\ndetail = 1.0",
//! )
//! .unwrap();
//! let device = Device::flex();
//! let setup = FieldSetup { bounds: [[-1.0; 3], [1.0; 3]], seed: 0, device: &device, body: None };
//! let field = RadianceField::new(&config, &setup)?;
//! let positions = Tensor::from_floats([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]], &device);
//! let points = Points::scattered(positions, Extent::Ball { variance: 1e-4 });
//! let sampled = field.evaluate(&points, true, Moment::END);
//! assert_eq!(sampled.sigma.dims(), [2]);
//! assert_eq!(sampled.color.unwrap().dims(), [2, 3]);
//! # Ok::<(), infonerf_schedule::Fault>(())
//! ```

mod check;
mod detail;
mod factored;
mod field;
mod hash;
mod init;
mod list;
mod mip;
mod mlp;
mod nerf;
mod neural_body;
mod neural_volumes;
mod pixel;
mod points;

pub use factored::{FactoredConfig, FactoredField};
pub use field::{
    BodyVertices, Field, FieldFile, FieldSetup, FieldSpec, FieldTraits, Footprint, Penalty, SourceImages, SourceView,
    Sources, density_gradient,
};
pub use hash::{HashConfig, HashGrid};
pub use list::{FieldConfig, RadianceField};
pub use mip::{MipConfig, MipNerf};
pub use nerf::{DensityActivation, NerfConfig, NerfMlp};
pub use neural_body::{NeuralBody, NeuralBodyConfig};
pub use neural_volumes::{CodeEncoderConfig, NeuralVolumes, NeuralVolumesConfig};
pub use pixel::{EncoderConfig, PixelNerf, PixelNerfConfig};
pub use points::{Extent, FieldOutput, Points};
