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

/// A few bytes changed, taken out, or put in.
fn mutated(mut bytes: Vec<u8>, rng: &mut ChaCha8Rng) -> Vec<u8> {
    for _ in 0..rng.random_range(1..6) {
        let at = rng.random_range(0..=bytes.len());
        let length = rng.random_range(1..9).min(bytes.len() - at);
        match rng.random_range(0..4) {
            0 if length > 0 => bytes[at] = rng.random(),
            1 if length > 0 => bytes[at] ^= 1 << rng.random_range(0..8),
            2 => drop(bytes.drain(at..at + length)),
            _ => {
                let copy = bytes[at..at + length].to_vec();
                bytes.splice(at..at, copy);
            }
        }
    }
    bytes
}

/// A fuzz target: whether it accepts the bytes.
type Reader = fn(&[u8]) -> bool;

fn run(target: &str, read: Reader) {
    let count = std::env::var("INFONERF_FUZZ").map_or(4000, |count| count.parse().expect("a number"));
    let (seeds, findings) = (files("seeds", target), files("findings", target));
    assert!(!seeds.is_empty(), "fuzz/seeds/{target} is empty");
    for bytes in seeds.iter().chain(&findings) {
        read(bytes);
    }
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let mut accepted = 0;
    for i in 0..count {
        accepted += usize::from(read(&mutated(seeds[i % seeds.len()].clone(), &mut rng)));
    }
    // Not all are refused at the first byte, and not all are let through.
    assert!(accepted > 0 && accepted < count, "{target}: {accepted} of {count} accepted");
}

#[test]
fn transforms() {
    run("transforms", fuzzing::transforms);
}

#[test]
fn poses_bounds() {
    run("poses_bounds", fuzzing::poses_bounds);
}

#[test]
fn depth() {
    run("depth", fuzzing::depth);
}

#[test]
fn image() {
    run("image", fuzzing::image);
}

#[test]
fn colmap() {
    run("colmap", fuzzing::colmap);
}

#[test]
fn cameras_npz() {
    run("cameras_npz", fuzzing::cameras_npz);
}

#[test]
fn annots() {
    run("annots", fuzzing::annots);
}

/// The seeds were written by NumPy: whole, they are all read.
#[test]
fn numpys_own_files_are_read() {
    let targets: [(&str, Reader); 3] =
        [("colmap", fuzzing::colmap), ("cameras_npz", fuzzing::cameras_npz), ("annots", fuzzing::annots)];
    for (target, read) in targets {
        for (i, bytes) in files("seeds", target).iter().enumerate() {
            assert!(read(bytes), "seed {i} of {target}");
        }
    }
}
