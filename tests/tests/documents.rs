//! The documents: links lead somewhere, experiments that they name exist, the README stays short, and `just` runs what it says.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::Command;

use infonerf_experiment::{Experiment, Selection};

/// Most bytes of README.md.
const README_BYTES: usize = 8 << 10;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Every Markdown document of the repository, with its path from the root.
fn documents() -> Vec<(PathBuf, String)> {
    let folders = [root(), root().join("docs"), root().join("experiments")];
    let files = folders.iter().flat_map(|folder| fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()));
    let markdown = files.filter(|path| path.extension().is_some_and(|extension| extension == "md"));
    let documents: Vec<_> = markdown.map(|path| (path.clone(), fs::read_to_string(path).unwrap())).collect();
    assert!(documents.len() >= 8, "{}", documents.len());
    documents
}

#[test]
fn links_resolve() {
    for (path, text) in documents() {
        for link in text.split("](").skip(1).filter_map(|rest| rest.split_once(')')).map(|(link, _)| link) {
            let file = link.split('#').next().unwrap_or_default();
            if link.contains("://") || file.is_empty() {
                continue;
            }
            assert!(path.parent().unwrap().join(file).exists(), "{}: {link}", path.display());
        }
    }
}

#[test]
fn named_experiments_exist() {
    let known: Vec<&str> = infonerf_experiment::list().unwrap().into_iter().map(|(name, _)| name).collect();
    for (path, text) in documents() {
        for rest in text.split("infonerf exp ").skip(1) {
            let in_name = |c: &char| c.is_ascii_alphanumeric() || matches!(c, '-' | '.');
            let name: String = rest.chars().take_while(in_name).collect();
            if name.ends_with(".toml") {
                continue;
            }
            assert!(name.is_empty() || known.contains(&name.as_str()), "{}: {name}", path.display());
        }
    }
}

#[test]
fn every_experiment_is_described() {
    let text = fs::read_to_string(root().join("experiments/README.md")).unwrap();
    for (name, _) in infonerf_experiment::list().unwrap() {
        let stem = name.strip_suffix("-paper").unwrap_or(name);
        let family = stem.rsplit_once('-').map_or(stem, |(family, _)| family);
        assert!(text.contains(&format!("`{stem}`")) || text.contains(&format!("`{family}`")), "{name}");
    }
}

/// The experiment that experiments/README.md shows can be planned as it stands.
#[test]
fn the_example_of_an_experiment_is_valid() {
    let text = fs::read_to_string(root().join("experiments/README.md")).unwrap();
    let (_, rest) = text.split_once("```toml\n").unwrap();
    let (example, _) = rest.split_once("```").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("mine.toml");
    fs::write(&file, example).unwrap();
    let planned = Experiment::plan(file.to_str().unwrap(), &Selection::default()).unwrap();
    // Three variants of synthetic-4view and one of its own, two scenes, two seeds.
    assert_eq!(planned.runs.len(), 16);
}

#[test]
fn the_readme_is_short() {
    let length = fs::metadata(root().join("README.md")).unwrap().len() as usize;
    assert!(length <= README_BYTES, "{length}");
}

/// As `just` says it, where that is installed; by the text of the justfile alone elsewhere.
#[test]
fn just_builds_with_the_features_that_are_given() {
    for (args, expected) in [
        (&["exp", "synthetic-4view"][..], "cargo run --release -- exp \"$@\""),
        (&["features=wgpu", "exp", "synthetic-4view"], "cargo run --release --features wgpu -- exp \"$@\""),
        (&["features=wgpu,vulkan", "sweep", "fields"], "cargo run --release --features wgpu,vulkan -- sweep \"$@\""),
    ] {
        match Command::new("just").arg("--dry-run").args(args).current_dir(root()).output() {
            Ok(output) => assert_eq!(String::from_utf8_lossy(&output.stderr).trim(), expected),
            Err(error) => {
                // Past the capture of the test's output.
                writeln!(io::stderr(), "NOT RUN: just {}: {error}", args.join(" ")).unwrap();
                let text = fs::read_to_string(root().join("justfile")).unwrap();
                let command = expected.rsplit(" -- ").next().unwrap();
                assert!(
                    text.contains("\"--features \" + features") && text.contains(&format!("{{{{ run }}}} {command}"))
                );
            }
        }
    }
}
