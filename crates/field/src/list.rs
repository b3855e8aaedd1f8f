//! The fields that config files can name.

use std::fmt;

use burn::module::Module;
use burn::tensor::Tensor;
use infonerf_ops::HostField;
use infonerf_schedule::{Fault, Moment};
use serde::{Deserialize, Serialize};

use crate::factored::{FactoredConfig, FactoredField};
use crate::field::{Field, FieldFile, FieldSetup, FieldSpec, FieldTraits, Footprint, Penalty, Sources};
use crate::hash::{HashConfig, HashGrid};
use crate::mip::{MipConfig, MipNerf};
use crate::nerf::{NerfConfig, NerfMlp};
use crate::neural_body::{NeuralBody, NeuralBodyConfig};
use crate::neural_volumes::{NeuralVolumes, NeuralVolumesConfig};
use crate::pixel::{PixelNerf, PixelNerfConfig};
use crate::points::{FieldOutput, Points};

/// Defines [`FieldConfig`] and [`RadianceField`] from a list of fields: one line per field, with its name, its config and
/// its module. The name in lower case is its `field.kind`.
macro_rules! fields {
    ($($(#[$doc:meta])* $name:ident($config:ty => $field:ty),)*) => {
        /// Kind and sizes of the field to train.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(tag = "kind", rename_all = "lowercase")]
        pub enum FieldConfig {
            $($(#[$doc])* $name($config),)*
        }

        /// Any of the fields that config files can name.
        #[derive(Module, Debug)]
        #[allow(clippy::large_enum_variant, reason = "a model holds one or two of them")]
        pub enum RadianceField {
            $($(#[$doc])* $name($field),)*
        }

        impl fmt::Display for FieldConfig {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                match self { $(Self::$name(config) => config.fmt(f),)* }
            }
        }

        impl FieldSpec for FieldConfig {
            type Field = RadianceField;

            fn validate(&self) -> Result<(), Fault> {
                match self { $(Self::$name(config) => config.validate(),)* }
            }

            fn build(&self, setup: &FieldSetup<'_>) -> Result<RadianceField, Fault> {
                Ok(match self { $(Self::$name(config) => RadianceField::$name(config.build(setup)?),)* })
            }

            fn footprint(&self) -> Footprint {
                match self { $(Self::$name(config) => config.footprint(),)* }
            }

            fn traits(&self) -> FieldTraits {
                match self { $(Self::$name(config) => config.traits(),)* }
            }

            fn coarse(&self) -> Option<Self> {
                match self { $(Self::$name(config) => config.coarse().map(Self::$name),)* }
            }

            fn files(&mut self) -> Vec<FieldFile<'_>> {
                match self { $(Self::$name(config) => config.files(),)* }
            }
        }

        impl Field for RadianceField {
            fn evaluate(&self, points: &Points, color: bool, at: Moment) -> FieldOutput {
                match self { $(Self::$name(field) => field.evaluate(points, color, at),)* }
            }

            fn on_host(&self, at: Moment) -> Option<HostField> {
                match self { $(Self::$name(field) => field.on_host(at),)* }
            }

            fn conditioned(&self, sources: &Sources, seed: Option<u64>) -> Self {
                match self { $(Self::$name(field) => Self::$name(field.conditioned(sources, seed)),)* }
            }

            fn penalty(&self, name: Penalty) -> Option<Tensor<1>> {
                match self { $(Self::$name(field) => field.penalty(name),)* }
            }
        }
    };
}

fields! {
    /// The MLP of NeRF.
    Nerf(NerfConfig => NerfMlp),
    /// The MLP of mip-NeRF.
    Mip(MipConfig => MipNerf),
    /// Planes and lines with a tiny MLP.
    Factored(FactoredConfig => FactoredField),
    /// A multi-resolution hash grid with a small MLP.
    Hash(HashConfig => HashGrid),
    /// An MLP over features of source images.
    PixelNerf(PixelNerfConfig => PixelNerf),
    /// Voxels decoded from a latent code, and a warp of them.
    NeuralVolumes(NeuralVolumesConfig => NeuralVolumes),
    /// Codes on a body's vertices, spread by sparse convolutions.
    NeuralBody(NeuralBodyConfig => NeuralBody),
}

impl RadianceField {
    /// Builds the field that `config` describes.
    ///
    /// # Errors
    /// If a size in `config` is out of range, or a file of weights that it names cannot be used.
    pub fn new(config: &FieldConfig, setup: &FieldSetup<'_>) -> Result<Self, Fault> {
        config.validate()?;
        config.build(setup)
    }
}
