//! Seeded mutations of configs: each is read or refused with one line, and nothing panics.
//!
//! `INFONERF_FUZZ=1000000` sets their number.

use infonerf_train::{Config, Preset, TrainError, config as layers};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Words of configs, and numbers at the ends of their types.
const WORDS: &str = r#"0 -1 1e999 nan -inf 9223372036854775807 4294967296 1e-320 true "" [] {} [[ {a={a={a=1}}} = . kind
    "nerf" "factored" train.rays field scene.views é"#;

fn count(usual: usize) -> usize {
    std::env::var("INFONERF_FUZZ").map_or(usual, |count| count.parse().expect("a number"))
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
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let text = toml::to_string(&Preset::Fast.table()).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    let mut accepted = 0;
    let count = count(3000);
    for _ in 0..count {
        // Part of the file, as an experiment has it, laid over a preset.
        let from = rng.random_range(0..lines.len());
        let to = rng.random_range(from..=lines.len());
        let over = mutated(&lines[from..to].join("\n"), &mut rng);
        let Ok(over) = over.parse::<toml::Table>() else { continue };
        let mut table = Preset::ALL[rng.random_range(0..Preset::ALL.len())].table();
        layers::merge(&mut table, over.clone());
        accepted += usize::from(one_line(Config::from_table(table), &format!("{over:?}")));
    }
    assert!(accepted > 0 && accepted < count, "{accepted} of {count} accepted");
}

#[test]
fn mutated_assignments_are_read_or_refused() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let valid = [
        "train.rays=64",
        "field={kind='nerf'}",
        "scene.views={kind='ids', ids=[0, 4]}",
        "scene.views={kind='all'}",
        "eval.test=every-8",
    ];
    let mut accepted = 0;
    let count = count(3000);
    for _ in 0..count {
        let assignment = mutated(valid[rng.random_range(0..valid.len())], &mut rng);
        let mut table = Preset::Fast.table();
        let config = layers::assign(&mut table, &assignment).and_then(|()| Config::from_table(table));
        accepted += usize::from(one_line(config, &assignment));
    }
    assert!(accepted > 0 && accepted < count, "{accepted} of {count} accepted");
}
