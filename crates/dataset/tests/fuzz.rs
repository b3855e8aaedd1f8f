//! A bounded run of the fuzzers in `fuzz/`: their seeds, their findings, and seeded mutations of both.
//!
//! `INFONERF_FUZZ=1000000` sets the number of mutations of each target.

use std::fs;
use std::path::Path;

use infonerf_dataset::fuzzing;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn files(kind: &str, target: &str) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz").join(kind).join(target);
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    let mut paths: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    paths.iter().map(|path| fs::read(path).unwrap()).collect()
}

/// Returns `bytes` with a few of them changed, removed or duplicated.
fn mutated(mut bytes: Vec<u8>, rng: &mut ChaCha8Rng) -> Vec<u8> {
    for _ in 0..rng.random_range(1..6) {
        let at = rng.random_range(0..=bytes.len());
        let length = rng.random_range(1..9).min(bytes.len() - at);
        match rng.random_range(0..4) {
            0 if length > 0 => bytes[at] = rng.random(),
            1 if length > 0 => bytes[at] ^= 1 << rng.random_range(0..8),
            2 => drop(bytes.drain(at..at + length)),
            _ => drop(bytes.splice(at..at, bytes[at..at + length].to_vec())),
        }
    }
    bytes
}

#[test]
fn seeds_findings_and_mutations_are_read_or_refused() {
    let count = std::env::var("INFONERF_FUZZ").map_or(4000, |count| count.parse().expect("a number"));
    for target in ["transforms", "poses_bounds", "depth", "colmap", "cameras_npz", "annots", "image"] {
        let read = |bytes: &[u8]| fuzzing::run(target, bytes);
        let (seeds, findings) = (files("seeds", target), files("findings", target));
        assert!(!seeds.is_empty(), "fuzz/seeds/{target} is empty");
        for (i, bytes) in seeds.iter().enumerate() {
            // All seeds of these readers are valid files.
            let whole = read(bytes);
            assert!(whole || !["colmap", "cameras_npz", "annots"].contains(&target), "seed {i} of {target}");
        }
        for bytes in &findings {
            read(bytes);
        }
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let accepted = (0..count).filter(|i| read(&mutated(seeds[i % seeds.len()].clone(), &mut rng))).count();
        // Some mutations are accepted and some are refused.
        assert!(accepted > 0 && accepted < count, "{target}: {accepted} of {count} accepted");
    }
}
