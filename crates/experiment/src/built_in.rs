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
    "fast-losses",
    "recipe",
    "time-against-error",
    "llff-2view",
    "llff-3view",
    "dtu-3view",
    "zju-4view",
    "capture",
    "cameras",
    "loss-ablation",
    "unseen-rays",
    "baseline",
    "views",
    "information",
    "integration",
    "integration-pixelnerf",
    "pixelnerf-pretrain",
    "baselines",
    "baselines-paper",
    "released-small",
}
