//! Seeded mutations of configs: each is read or refused with one line, and nothing panics.
//!
//! `INFONERF_FUZZ=1000000` sets their number.

use infonerf_train::{Config, Preset, TrainError, config as layers};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Words of configs, and numbers at the ends of their types.
const WORDS: &str = r#"0 -1 1e999 nan -inf 9223372036854775807 4294967296 1e-320 true "" [] {} [[ {a={a={a=1}}} = . kind
    "nerf" "factored" train.rays field scene.views é"#;

/// Makes all trials of a seed, and checks that some are accepted, and others not.
fn check_trials(seed: u64, is_accepted: impl Fn(&mut ChaCha8Rng) -> bool) {
    let count: usize = std::env::var("INFONERF_FUZZ").map_or(3000, |count| count.parse().expect("a number"));
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let accepted = (0..count).filter(|_| is_accepted(&mut rng)).count();
    assert!(accepted > 0 && accepted < count, "{accepted} of {count} accepted");
}

/// Changes, removes or repeats a few characters, or puts in a word.
fn mutated(text: &str, rng: &mut ChaCha8Rng) -> String {
    let words: Vec<&str> = WORDS.split_whitespace().chain(["\u{0}"]).collect();
    let mut text: Vec<char> = text.chars().collect();
    for _ in 0..rng.random_range(1..5) {
        let at = rng.random_range(0..=text.len());
        let length = rng.random_range(1..12).min(text.len() - at);
        match rng.random_range(0..4) {
            0 if length > 0 => text[at] = char::from(rng.random_range(9..127)),
            1 => drop(text.drain(at..at + length)),
            2 => drop(text.splice(at..at, text[at..at + length].to_vec())),
            _ => drop(text.splice(at..at + length, words[rng.random_range(0..words.len())].chars())),
        }
    }
    text.into_iter().collect()
}

fn one_line<T>(result: Result<T, TrainError>, what: &str) -> bool {
    let Err(error) = result else { return true };
    let message = error.to_string();
    assert!(!message.is_empty() && message.lines().count() == 1, "{what}: {message:?}");
    false
}

#[test]
fn mutated_configs_are_read_or_refused() {
    let text = toml::to_string(&Preset::Fast.table()).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    check_trials(4, |rng| {
        // Part of the file, as an experiment has it, laid over a preset.
        let from = rng.random_range(0..lines.len());
        let to = rng.random_range(from..=lines.len());
        let over = mutated(&lines[from..to].join("\n"), rng);
        let Ok(over) = over.parse::<toml::Table>() else { return false };
        let mut table = Preset::ALL[rng.random_range(0..Preset::ALL.len())].table();
        layers::merge(&mut table, over.clone());
        one_line(Config::from_table(table), &format!("{over:?}"))
    });
}

#[test]
fn mutated_assignments_are_read_or_refused() {
    let valid = [
        "train.rays=64",
        "field={kind='nerf'}",
        "scene.views={kind='ids', ids=[0, 4]}",
        "scene.views={kind='all'}",
        "eval.test=every-8",
    ];
    check_trials(5, |rng| {
        let assignment = mutated(valid[rng.random_range(0..valid.len())], rng);
        let mut table = Preset::Fast.table();
        let config = layers::assign(&mut table, &assignment).and_then(|()| Config::from_table(table));
        one_line(config, &assignment)
    });
}
