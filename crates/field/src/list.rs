//! The fields that config files can name.

use std::fmt;
use std::path::PathBuf;

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use infonerf_ops::HostField;
use infonerf_schedule::{Fault, Moment};
use serde::{Deserialize, Serialize};

use crate::factored::{FactoredConfig, FactoredField};
use crate::hash::{HashConfig, HashGrid};
use crate::mip::{MipConfig, MipNerf};
use crate::nerf::{NerfConfig, NerfMlp};
use crate::neural_body::{NeuralBody, NeuralBodyConfig};
use crate::neural_volumes::{NeuralVolumes, NeuralVolumesConfig};
use crate::pixel::{PixelNerf, PixelNerfConfig};
use crate::{Field, FieldOutput, FieldSetup, FieldSpec, Footprint, Penalty, Points, Sources};

/// Defines [`FieldConfig`] and [`RadianceField`] from a list of fields: one line per field, with its name, its config and
/// its module. The name in lower case is its `field.kind`.
macro_rules! fields {
    ($($(#[$doc:meta])* $name:ident($config:ty => $field:ty),)*) => {
        /// Which field to train, and its sizes.
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

            fn shares_passes(&self) -> bool {
                match self { $(Self::$name(config) => config.shares_passes(),)* }
            }

            fn needs_intervals(&self) -> bool {
                match self { $(Self::$name(config) => config.needs_intervals(),)* }
            }

            fn sees_photographs(&self) -> bool {
                match self { $(Self::$name(config) => config.sees_photographs(),)* }
            }

            fn first_photographs(&self) -> Option<(&'static str, usize)> {
                match self { $(Self::$name(config) => config.first_photographs(),)* }
            }

            fn needs_body(&self) -> bool {
                match self { $(Self::$name(config) => config.needs_body(),)* }
            }

            fn tracks_positions(&self) -> bool {
                match self { $(Self::$name(config) => config.tracks_positions(),)* }
            }

            fn weights_file(&mut self) -> Option<(&'static str, &mut PathBuf)> {
                match self { $(Self::$name(config) => config.weights_file(),)* }
            }

            fn files(&mut self) -> Vec<&mut PathBuf> {
                match self { $(Self::$name(config) => config.files(),)* }
            }
        }

        impl Field for RadianceField {
            fn evaluate(&self, points: &Points, color: bool, at: Moment) -> FieldOutput {
                match self { $(Self::$name(field) => field.evaluate(points, color, at),)* }
            }

            fn device(&self) -> Device {
                match self { $(Self::$name(field) => field.device(),)* }
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
    /// An MLP over features of photographs.
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
