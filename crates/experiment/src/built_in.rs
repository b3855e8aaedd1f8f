//! The experiments that are built in: a file in `experiments/` and a line here.

/// Makes the list of names with the text of each file.
macro_rules! built_in {
    ($($name:literal,)*) => {
        /// Names and texts.
        pub(crate) const BUILT_IN: &[(&str, &str)] =
            &[$(($name, include_str!(concat!("../experiments/", $name, ".toml"))),)*];
    };
}

built_in! {
    "synthetic-4view",
    "paper-regime",
    "paper-regime-choices",
    "llff-2view",
    "llff-3view",
    "dtu-3view",
    "capture",
    "cameras",
    "zju-4view",
    "fast-losses",
    "mlp-losses",
    "fast-alpha",
    "integration",
    "integration-paper",
    "released-skipping",
    "released-warm",
    "recipe",
    "fields",
    "time-against-error",
    "scales",
    "unseen-rays",
    "loss-ablation",
    "baseline",
    "views",
    "information",
    "baselines",
    "baselines-paper",
    "small-nerf",
    "released-small",
    "dietnerf",
    "pixelnerf-pretrain",
    "pixelnerf-pretrain-paper",
    "integration-pixelnerf",
    "integration-pixelnerf-paper",
}
