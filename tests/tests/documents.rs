//! The documents: links and anchors lead somewhere, experiments that they name exist, docs/paper.md covers the paper, the book has
//! every page, documents keep their size; and the words of documents and source code.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use infonerf_experiment::{Experiment, Selection};
use infonerf_train::Preset;
use walkdir::{DirEntry, WalkDir};

/// Maximum number of bytes of all documents together, and of one of them.
const MAX_BYTES: [usize; 2] = [90 << 10, 11 << 10];

const README_LINES: usize = 100;

/// First words of a doc comment that is not understood when it is read alone.
const ANAPHORA: [&str; 18] = [
    "Of", "Those", "That", "The same", "Whose", "What", "Which", "It", "Its", "They", "Their", "He", "She", "This is",
    "These", "And", "Or", "As above",
];

/// Words and prefixes of constants that are not used, with their replacements.
const WORDS: [(&str, &str); 10] = [
    ("slope", "gradient or derivative"),
    ("slopes", "gradients or derivatives"),
    ("so many", "the number"),
    ("learnt", "learned"),
    ("MOST_", "MAX_"),
    ("LARGEST_", "MAX_"),
    ("LONGEST_", "MAX_"),
    ("DEEPEST_", "MAX_"),
    ("LEAST_", "MIN_"),
    ("FEWEST_", "MIN_"),
];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Returns path and text of every file with this extension at most `depth` levels below `folders`, sorted by path.
fn files(folders: &[&str], depth: usize, extension: &str) -> Vec<(PathBuf, String)> {
    let own = |entry: &DirEntry| entry.file_name() != "target";
    let walk = |folder: &&str| {
        WalkDir::new(root().join(folder)).max_depth(depth).sort_by_file_name().into_iter().filter_entry(own)
    };
    let paths = folders.iter().flat_map(walk).map(|entry| entry.unwrap().into_path());
    let wanted = paths.filter(|path| path.extension().is_some_and(|found| found == extension));
    wanted.map(|path| (path.clone(), fs::read_to_string(path).unwrap())).collect()
}

/// Returns every Markdown document.
fn documents() -> Vec<(PathBuf, String)> {
    let documents = files(&["", "docs", "experiments"], 1, "md");
    assert!(documents.len() >= 15, "{}", documents.len());
    documents
}

/// Returns every Rust file.
fn sources() -> Vec<(PathBuf, String)> {
    let sources = files(&["crates", "tests", "fuzz"], usize::MAX, "rs");
    assert!(sources.len() > 300, "{}", sources.len());
    sources
}

/// Returns the text and target of every link.
fn links(text: &str) -> impl Iterator<Item = (&str, &str)> {
    text.match_indices("](").filter_map(|(at, _)| {
        let shown = text[..at].rsplit_once('[').map_or("", |(_, shown)| shown);
        text[at + 2..].split_once(')').map(|(target, _)| (shown, target))
    })
}

/// Returns the anchors that GitHub and mdBook give headings.
fn anchors(text: &str) -> Vec<String> {
    let heading = |line: &str| Some(line.strip_prefix('#')?.trim_start_matches('#').trim().to_lowercase());
    let kept = |c: &char| c.is_alphanumeric() || matches!(c, '-' | '_' | ' ');
    let anchor = |text: String| text.chars().filter(kept).collect::<String>().replace(' ', "-");
    text.lines().filter_map(heading).map(anchor).collect()
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
    let tables = [numbered("Table", 6), lettered("Table", 'G')].concat();
    let figures = [numbered("Figure", 7), lettered("Figure", 'I')].concat();
    for name in [numbered("Eq.", 11), tables, figures].concat() {
        assert!(text.lines().any(|line| line.starts_with(&format!("| {name} |"))), "{name}");
    }
}

/// Items that docs/paper.md names are in the files that it links, and its keys are those of a config.
#[test]
fn the_paper_leads_to_code_and_keys() {
    let text = fs::read_to_string(root().join("docs/paper.md")).unwrap();
    let named = links(&text).filter_map(|(shown, link)| Some((shown.strip_prefix('`')?.strip_suffix('`')?, link)));
    let named: Vec<_> = named.collect();
    assert!(named.len() > 10, "{named:?}");
    for (name, link) in named {
        let code = fs::read_to_string(root().join("docs").join(link)).unwrap();
        let defined = ["fn", "struct", "enum", "const"].iter().any(|kind| {
            let defines = format!("pub {kind} {name}");
            code.split(&defines).skip(1).any(|rest| !rest.starts_with(|c: char| c.is_alphanumeric() || c == '_'))
        });
        assert!(defined, "{name} in {link}");
    }
    let config = Preset::Paper.table();
    let code = text.split('`').skip(1).step_by(2);
    let keys = code.filter_map(|code| Some((code, code.split_once('.')?))).filter_map(|(code, (section, rest))| {
        let plain = rest.chars().all(|c| c.is_alphanumeric() || matches!(c, '.' | '_'));
        config.get(section).filter(|_| plain).map(|section| (code, section, rest))
    });
    let keys: Vec<_> = keys.collect();
    assert!(keys.len() > 20, "{keys:?}");
    for (key, section, rest) in keys {
        assert!(rest.split('.').try_fold(section, |value, part| value.get(part)).is_some(), "{key}");
    }
}

/// The table of crates in ARCHITECTURE.md is in the order of dependencies, and names those of all crates up to `experiment`.
#[test]
fn the_table_of_crates_is_true() {
    let text = fs::read_to_string(root().join("ARCHITECTURE.md")).unwrap();
    let mut above = BTreeSet::new();
    for line in text.lines().filter(|line| line.starts_with("| `")) {
        let cells: Vec<&str> = line.trim_matches('|').split(" | ").map(str::trim).collect();
        let name = cells[0].trim_matches('`');
        let Ok(manifest) = fs::read_to_string(root().join("crates").join(name).join("Cargo.toml")) else { continue };
        let (_, rest) = manifest.split_once("[dependencies]").unwrap();
        let own = rest.split("\n[").next().unwrap().lines().filter_map(|line| line.strip_prefix("infonerf-"));
        let own: BTreeSet<&str> = own.map(|rest| rest.split(['.', ' ']).next().unwrap()).collect();
        for dependency in &own {
            assert!(above.contains(*dependency), "{name} depends on {dependency}, which is further down");
        }
        let named = cells.last().unwrap().trim_end_matches(" (no Burn)");
        if !named.contains("above") && named != "experiment" {
            let named: BTreeSet<&str> = named.split(", ").filter(|name| *name != "–").collect();
            assert_eq!(named, own, "{name}");
        }
        above.insert(name.to_owned());
    }
    let folders = fs::read_dir(root().join("crates")).unwrap().count();
    assert_eq!(above.len(), folders, "{above:?}");
}

#[test]
fn named_experiments_exist() {
    let known: Vec<&str> = infonerf_experiment::list().unwrap().into_iter().map(|(name, _)| name).collect();
    for (path, text) in documents() {
        for rest in text.split("infonerf exp ").skip(1) {
            let in_name = |c: &char| c.is_ascii_alphanumeric() || matches!(c, '-' | '.');
            let name: String = rest.chars().take_while(in_name).collect();
            let is_known = name.is_empty() || name.ends_with(".toml") || known.contains(&name.as_str());
            assert!(is_known, "{}: {name}", path.display());
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
fn documents_keep_their_size() {
    let (mut total, [most, most_of_one]) = (0, MAX_BYTES);
    for (path, text) in documents() {
        let (name, lines) = (name_of(&path), text.lines().count());
        assert!(text.len() <= most_of_one, "{name}: {} bytes, at most {most_of_one}", text.len());
        assert!(name != "README.md" || lines <= README_LINES, "{name}: {lines} lines, at most {README_LINES}");
        total += text.len();
    }
    assert!(total <= most, "{total} bytes in all documents, at most {most}");
}

#[test]
fn doc_comments_are_understood_alone() {
    let mut found = Vec::new();
    for (path, text) in sources() {
        let mut before = "";
        for (number, line) in (1..).zip(text.lines()) {
            let comment = doc_comment(line);
            if let Some(first) = comment.filter(|_| doc_comment(before).is_none())
                && let Some(word) = ANAPHORA.iter().find(|word| begins_with(first, word))
            {
                found.push(format!("{}:{number}: begins with \"{word}\": {first}", name_of(&path)));
            }
            before = line;
        }
    }
    assert!(found.is_empty(), "\n{}\n{} doc comments", found.join("\n"), found.len());
}

#[test]
fn words_are_those_of_the_field() {
    let mut found = Vec::new();
    let own = Path::new(file!()).file_name().unwrap();
    for (path, text) in sources().into_iter().filter(|(path, _)| path.file_name() != Some(own)) {
        let lines = (1..).zip(text.lines());
        found.extend(lines.filter_map(|(number, line)| wrong_word(&path, number, line)));
    }
    for (path, text) in [documents(), files(&["crates"], 2, "md")].concat() {
        found.extend(prose(&text).filter_map(|(number, line)| wrong_word(&path, number, line)));
    }
    assert!(found.is_empty(), "\n{}\n{} words", found.join("\n"), found.len());
}

fn name_of(path: &Path) -> String {
    path.strip_prefix(root()).unwrap().display().to_string()
}

/// Returns the numbered lines of a Markdown document outside of blocks of code.
fn prose(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut code = false;
    (1..).zip(text.lines()).filter(move |(_, line)| {
        let fence = line.starts_with("```");
        code ^= fence;
        !fence && !code && !line.starts_with("    ")
    })
}

fn doc_comment(line: &str) -> Option<&str> {
    let line = line.trim_start();
    line.strip_prefix("///").or_else(|| line.strip_prefix("//!")).map(str::trim)
}

fn begins_with(text: &str, words: &str) -> bool {
    text.strip_prefix(words).is_some_and(|rest| !rest.starts_with(|c: char| c.is_alphanumeric() || c == '_'))
}

/// Returns a fault if a line has a word that another one replaces. Lines and leaky rectifiers do have slopes.
fn wrong_word(path: &Path, number: usize, line: &str) -> Option<String> {
    let words = format!(" {} ", line.to_lowercase().replace(|c: char| !c.is_alphanumeric(), " "));
    let has = |word: &str| match word.ends_with('_') {
        true => line.split(|c: char| !c.is_alphanumeric() && c != '_').any(|name| name.starts_with(word)),
        false => words.contains(&format!(" {word} ")),
    };
    let of_a_line = ["line", "lines", "aspect", "leaky"].into_iter().any(has);
    let (wrong, right) = WORDS.iter().find(|(word, _)| has(word) && !(word.starts_with("slope") && of_a_line))?;
    Some(format!("{}:{number}: {wrong}: expected {right}: {}", name_of(path), line.trim()))
}
