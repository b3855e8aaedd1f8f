//! Keys of earlier versions: refused with the name of the new one.

use toml::{Table, Value};

use crate::TrainError;

/// Each old key, and what it is now.
const OLD_KEYS: &[(&str, &str)] = &[
    ("loss.gain.halve_every", "loss.kl.weight = { from = ..., factor = 0.5, every = STEPS, stairs = true }"),
    ("loss.gain.max_angle_deg", "train.neighbours.max_angle_deg"),
    ("loss.gain", "loss.kl"),
    ("loss.key", "loss.silhouette, with a weight"),
    ("loss.variation", "loss.tv, with a schedule as its weight"),
    ("loss.alpha", "loss.mask.weight"),
    (
        "loss.start",
        "the schedule of a weight, such as loss.entropy.weight = { from = 0.0, to = 1e-3, start = 0.2, end = 0.4 }",
    ),
    (
        "loss.ramp",
        "the schedule of a weight, such as loss.entropy.weight = { from = 0.0, to = 1e-3, start = 0.2, end = 0.4 }",
    ),
    ("loss.opacity.until", "loss.opacity.weight = { from = ..., to = 0.0, end = SHARE }"),
    ("train.explained", "train.error_sampling, with threshold and keep"),
    ("train.converged", "train.early_stopping, with patience and min_delta"),
    ("train.members", "train.ensemble.size"),
    ("train.member_seconds", "train.ensemble.seconds_per_member"),
    ("train.average", "train.weight_averaging"),
    ("train.center_steps", "train.precrop_steps"),
    ("train.samples", "train.target_samples"),
    ("train.table_rate", "train.grid_lr_multiplier"),
    ("train.pyramid", "train.downscale = { steps = [[0.0, 4], [0.1, 2], [0.4, 1]] }"),
    ("train.lr_decay", "the schedule train.lr, such as { from = 5e-4, factor = 0.1, every = 250_000 }"),
    ("train.lr_warmup", "the warmup of the schedule train.lr"),
    ("render.min_transmittance", "render.early_stop_transmittance"),
    ("render.occupancy.min_alpha", "render.occupancy.alpha_threshold"),
    (
        "render.samples_start",
        "the schedule render.samples, such as { from = 173, to = 346, end = 0.5, curve = \"exponential\" }",
    ),
    ("field.view_dependent", "field.view_dependence, 0 for false and 1 for true"),
    ("field.octaves", "field.frequencies"),
    ("field.position_octaves", "field.position_frequencies"),
    ("field.direction_octaves", "field.direction_frequencies"),
    ("field.frequency", "field.lowest_frequency"),
    ("field.anneal", "field.detail = { from = 0.0, to = 1.0, end = SHARE }"),
];

/// Refuses a table with a key of an earlier version.
pub(super) fn refuse_old_keys(table: &Table) -> Result<(), TrainError> {
    match OLD_KEYS.iter().find(|(old, _)| has(table, old)) {
        Some((old, new)) => Err(TrainError::config(old, format!("a key of an earlier version: it is {new} now"))),
        None => Ok(()),
    }
}

fn has(table: &Table, path: &str) -> bool {
    match path.split_once('.') {
        None => table.contains_key(path),
        Some((first, rest)) => matches!(table.get(first), Some(Value::Table(inner)) if has(inner, rest)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Config, Preset, assign};

    #[test]
    fn an_old_key_is_refused_with_the_new_one() {
        for (old, new) in OLD_KEYS {
            for preset in Preset::ALL {
                let mut table = preset.table();
                assert!(!has(&table, old), "{old} is a key of {preset:?}");
                assign(&mut table, &format!("{old}=1.0")).unwrap();
                let message = Config::from_table(table).unwrap_err().to_string();
                assert!(message.contains(new), "{old}: {message}");
            }
        }
    }
}
