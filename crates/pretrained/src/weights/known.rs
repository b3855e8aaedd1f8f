use infonerf_metrics::{INCEPTION_NETWORK, LPIPS_ALEX_NETWORK, LPIPS_VGG_NETWORK};

use super::resnet34;
use crate::clip::ClipConfig;
use crate::file::TensorShape;
use crate::inception::InceptionConfig;
use crate::lpips::LpipsConfig;

/// Published weights that this program can use.
#[derive(Debug, Clone, Copy)]
pub struct KnownWeights {
    /// Name in this program, such as `lpips-vgg`.
    pub name: &'static str,
    /// Metric, loss or encoder that needs them.
    pub needed_by: &'static str,
    /// Names of other weights that these need.
    pub companions: &'static [&'static str],
    /// Address of the published file.
    pub url: &'static str,
    /// SHA-256 of the published file.
    pub sha256: &'static str,
    /// Size of the published file.
    pub bytes: u64,
    pub(super) tensors: fn() -> Vec<TensorShape>,
}

/// All weights that this program can use.
pub const KNOWN_WEIGHTS: &[KnownWeights] = &[
    KnownWeights {
        name: LPIPS_ALEX_NETWORK,
        needed_by: "LPIPS with AlexNet (backbone)",
        companions: &["lpips-alex-heads"],
        url: "https://download.pytorch.org/models/alexnet-owt-7be5be79.pth",
        sha256: "7be5be791159472b1fbf3c69796f7cb30dca7ad8466c2df70058c37116cdee02",
        bytes: 244_408_911,
        tensors: || LpipsConfig::alex().backbone_tensors(),
    },
    KnownWeights {
        name: "lpips-alex-heads",
        needed_by: "LPIPS with AlexNet (heads, version 0.1)",
        companions: &[],
        url: "https://raw.githubusercontent.com/richzhang/PerceptualSimilarity/master/lpips/weights/v0.1/alex.pth",
        sha256: "df73285e35b22355a2df87cdb6b70b343713b667eddbda73e1977e0c860835c0",
        bytes: 6_009,
        tensors: || LpipsConfig::alex().head_tensors(),
    },
    KnownWeights {
        name: LPIPS_VGG_NETWORK,
        needed_by: "LPIPS with VGG-16 (backbone)",
        companions: &["lpips-vgg-heads"],
        url: "https://download.pytorch.org/models/vgg16-397923af.pth",
        sha256: "397923af8e79cdbb6a7127f12361acd7a2f83e06b05044ddf496e83de57a5bf0",
        bytes: 553_433_881,
        tensors: || LpipsConfig::vgg().backbone_tensors(),
    },
    KnownWeights {
        name: "lpips-vgg-heads",
        needed_by: "LPIPS with VGG-16 (heads, version 0.1)",
        companions: &[],
        url: "https://raw.githubusercontent.com/richzhang/PerceptualSimilarity/master/lpips/weights/v0.1/vgg.pth",
        sha256: "a78928a0af1e5f0fcb1f3b9e8f8c3a2a5a3de244d830ad5c1feddc79b8432868",
        bytes: 7_289,
        tensors: || LpipsConfig::vgg().head_tensors(),
    },
    KnownWeights {
        name: INCEPTION_NETWORK,
        needed_by: "FID and KID",
        companions: &[],
        url: "https://github.com/mseitzer/pytorch-fid/releases/download/fid_weights/pt_inception-2015-12-05-6726825d.pth",
        sha256: "6726825d0af5f729cebd5821db510b11b1cfad8faad88a03f1befd49fb9129b2",
        bytes: 95_628_359,
        tensors: || InceptionConfig::FULL.tensors(),
    },
    KnownWeights {
        name: "clip-vit-b32",
        needed_by: "DietNeRF's semantic loss",
        companions: &[],
        url: "https://huggingface.co/openai/clip-vit-base-patch32/resolve/\
              3d74acf9a28c67741b2f4f2ea7635f0aaf6f0268/pytorch_model.bin",
        sha256: "a63082132ba4f97a80bea76823f544493bffa8082296d62d71581a4feff1576f",
        bytes: 605_247_071,
        tensors: || ClipConfig::VIT_B_32.tensors(),
    },
    KnownWeights {
        name: "resnet34",
        needed_by: "PixelNeRF's encoder",
        companions: &[],
        url: "https://download.pytorch.org/models/resnet34-333f7ec4.pth",
        sha256: "333f7ec4c6338da2cbed37f1fc0445f9624f1355633fa1d7eab79a91084c6cef",
        bytes: 87_306_240,
        tensors: resnet34::tensors,
    },
];

impl KnownWeights {
    /// Finds the weights called `name`.
    pub fn named(name: &str) -> Option<&'static Self> {
        KNOWN_WEIGHTS.iter().find(|weights| weights.name == name)
    }

    /// Returns the name of the published file.
    pub fn published_file(&self) -> &'static str {
        self.url.rsplit('/').next().unwrap_or(self.url)
    }

    /// Returns the name of the file that an import writes: safetensors of the needed tensors.
    pub fn file(&self) -> String {
        format!("{}.safetensors", self.name)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn tensors_distinguish_all_weights() {
        let names: HashSet<&str> = KNOWN_WEIGHTS.iter().map(|weights| weights.name).collect();
        assert_eq!(names.len(), KNOWN_WEIGHTS.len());
        for one in KNOWN_WEIGHTS {
            assert!(one.companions.iter().all(|name| names.contains(name)), "{}", one.name);
            let tensors: HashSet<TensorShape> = (one.tensors)().into_iter().collect();
            for other in KNOWN_WEIGHTS.iter().filter(|other| other.name != one.name) {
                let differ = (other.tensors)().iter().any(|tensor| !tensors.contains(tensor));
                assert!(differ, "{} {}", one.name, other.name);
            }
        }
    }

    #[test]
    fn checksums_are_well_formed_and_agree_with_file_names() {
        for weights in KNOWN_WEIGHTS {
            assert!(weights.sha256.len() == 64 && weights.sha256.bytes().all(|b| b.is_ascii_hexdigit()));
            // PyTorch's published files have the first eight digits of their sum in their names.
            let stem = weights.published_file().trim_end_matches(".pth");
            let digits = stem.rsplit('-').next().filter(|end| end.len() == 8);
            assert!(digits.is_none_or(|digits| weights.sha256.starts_with(digits)), "{stem}");
        }
    }
}
