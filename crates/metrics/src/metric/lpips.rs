use super::{Measure, Metric};
use crate::descriptor::{Better, Descriptor};
use crate::error::MetricError;
use crate::networks::PictureDistance;
use crate::view::PreparedView;

/// Name of LPIPS with AlexNet among [`crate::Networks`].
pub const LPIPS_ALEX_NETWORK: &str = "lpips-alex";
/// Name of LPIPS with VGG-16 among [`crate::Networks`].
pub const LPIPS_VGG_NETWORK: &str = "lpips-vgg";

/// LPIPS with AlexNet of whole images.
pub const LPIPS_ALEX: Metric = Metric {
    descriptor: Descriptor { key: "lpips_alex", name: "LPIPS (Alex)", unit: "", decimals: 3, better: Better::Lower },
    definition: "LPIPS 0.1 with AlexNet, pictures at their own size (Zhang et al. 2018)",
    measure: Measure::Distance(LPIPS_ALEX_NETWORK, whole),
};

/// LPIPS with VGG-16 of whole images.
pub const LPIPS_VGG: Metric = Metric {
    descriptor: Descriptor { key: "lpips_vgg", name: "LPIPS (VGG)", ..LPIPS_ALEX.descriptor },
    definition: "LPIPS 0.1 with VGG-16, pictures at their own size (Zhang et al. 2018)",
    measure: Measure::Distance(LPIPS_VGG_NETWORK, whole),
};

pub(super) const LPIPS_ALEX_MASKED: Metric = Metric {
    descriptor: Descriptor { key: "lpips_alex_masked", name: "LPIPS (Alex, masked)", ..LPIPS_ALEX.descriptor },
    definition: "LPIPS with AlexNet of the masked pictures",
    measure: Measure::Distance(LPIPS_ALEX_NETWORK, masked),
};

pub(super) const LPIPS_VGG_MASKED: Metric = Metric {
    descriptor: Descriptor { key: "lpips_vgg_masked", name: "LPIPS (VGG, masked)", ..LPIPS_VGG.descriptor },
    definition: "LPIPS with VGG-16 of the masked pictures",
    measure: Measure::Distance(LPIPS_VGG_NETWORK, masked),
};

fn whole(view: &PreparedView<'_>, network: &PictureDistance) -> Result<f64, MetricError> {
    network(&view.render, &view.truth, view.protocol).map_err(MetricError::Other)
}

fn masked(view: &PreparedView<'_>, network: &PictureDistance) -> Result<f64, MetricError> {
    let (render, truth) = view.masked()?;
    network(render, truth, view.protocol).map_err(MetricError::Other)
}
