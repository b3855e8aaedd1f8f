//! The documents: links and anchors lead somewhere, experiments that they name exist, docs/paper.md covers the paper, the book has
//! every page, the README stays short, and `just` runs what it says.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::Command;

use infonerf_experiment::{Experiment, Selection};
use infonerf_train::Preset;

/// Most bytes of README.md.
const README_BYTES: usize = 8 << 10;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Every Markdown document of the repository, with its path from the root.
fn documents() -> Vec<(PathBuf, String)> {
    let folders = ["", "docs", "docs/log", "experiments"].map(|folder| root().join(folder));
    let files = folders.iter().flat_map(|folder| fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()));
    let markdown = files.filter(|path| path.extension().is_some_and(|extension| extension == "md"));
    let documents: Vec<_> = markdown.map(|path| (path.clone(), fs::read_to_string(path).unwrap())).collect();
    assert!(documents.len() >= 15, "{}", documents.len());
    documents
}

/// The text and target of every link.
fn links(text: &str) -> impl Iterator<Item = (&str, &str)> {
    text.match_indices("](").filter_map(|(at, _)| {
        let shown = text[..at].rsplit_once('[').map_or("", |(_, shown)| shown);
        text[at + 2..].split_once(')').map(|(target, _)| (shown, target))
    })
}

/// The anchors that GitHub and mdBook give headings.
fn anchors(text: &str) -> Vec<String> {
    let heading = |line: &str| Some(line.strip_prefix('#')?.trim_start_matches('#').trim().to_lowercase());
    let kept = |c: &char| c.is_alphanumeric() || matches!(c, '-' | '_' | ' ');
    text.lines()
        .filter_map(heading)
        .map(|text| text.chars().filter(kept).collect::<String>().replace(' ', "-"))
        .collect()
}

#[test]
fn links_resolve() {
    for (path, text) in documents() {
        for (_, link) in links(&text).filter(|(_, link)| !link.contains("://")) {
            let (file, anchor) = link.split_once('#').unwrap_or((link, ""));
            let target = if file.is_empty() { path.clone() } else { path.parent().unwrap().join(file) };
            assert!(target.exists(), "{}: {link}", path.display());
            if !anchor.is_empty() {
                let known = anchors(&fs::read_to_string(target).unwrap());
                assert!(known.iter().any(|name| name == anchor), "{}: {link}: {known:?}", path.display());
            }
        }
    }
}

#[test]
fn the_book_has_every_page() {
    let summary = fs::read_to_string(root().join("docs/SUMMARY.md")).unwrap();
    let listed: Vec<PathBuf> =
        links(&summary).map(|(_, link)| root().join("docs").join(link).canonicalize().unwrap()).collect();
    for (path, _) in documents().iter().filter(|(path, _)| !path.ends_with("SUMMARY.md")) {
        assert!(listed.contains(&path.canonicalize().unwrap()), "docs/SUMMARY.md: {}", path.display());
    }
}

/// Main paper and supplement, as they number them.
#[test]
fn the_paper_is_covered() {
    let text = fs::read_to_string(root().join("docs/paper.md")).unwrap();
    let numbered = |kind: &str, last: u8| (1..=last).map(|number| format!("{kind} {number}")).collect::<Vec<_>>();
    let lettered = |kind: &str, last: char| ('A'..=last).map(|letter| format!("{kind} {letter}")).collect::<Vec<_>>();
    let all = [
        numbered("Eq.", 11),
        numbered("Table", 6),
        lettered("Table", 'G'),
        numbered("Figure", 7),
        lettered("Figure", 'I'),
    ];
    for name in all.concat() {
        assert!(text.lines().any(|line| line.starts_with(&format!("| {name} |"))), "{name}");
    }
}

/// What docs/paper.md names is in the file that it links, and its keys are those of a config.
#[test]
fn the_paper_leads_to_code_and_keys() {
    let text = fs::read_to_string(root().join("docs/paper.md")).unwrap();
    let named = links(&text).filter_map(|(shown, link)| Some((shown.strip_prefix('`')?.strip_suffix('`')?, link)));
    let mut count = 0;
    for (name, link) in named {
        let code = fs::read_to_string(root().join("docs").join(link)).unwrap();
        let defined = ["fn", "struct", "enum", "const"].iter().any(|kind| {
            let defines = format!("pub {kind} {name}");
            code.split(&defines).skip(1).any(|rest| !rest.starts_with(|c: char| c.is_alphanumeric() || c == '_'))
        });
        assert!(defined, "{name} in {link}");
        count += 1;
    }
    assert!(count > 10, "{count}");
    let config = Preset::Paper.table();
    let code = text.split('`').skip(1).step_by(2);
    let keys = code.filter_map(|code| Some((code, code.split_once('.')?))).filter_map(|(code, (section, rest))| {
        let plain = rest.chars().all(|c| c.is_alphanumeric() || matches!(c, '.' | '_'));
        config.get(section).filter(|_| plain).map(|section| (code, section, rest))
    });
    let mut count = 0;
    for (key, section, rest) in keys {
        assert!(rest.split('.').try_fold(section, |value, part| value.get(part)).is_some(), "{key}");
        count += 1;
    }
    assert!(count > 20, "{count}");
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
