use std::path::Path;

use crate::record::{Record, TestViews, distinct};

/// Maximum number of views, or of values that nothing explains, that a line lists. A larger number of them is only counted.
const MAX_LISTED: usize = 8;
/// Maximum number of seeds, or of other causes of a difference, that a line lists. A larger number of them is only counted.
const MAX_EXPLAINED: usize = 32;

/// Describes how `records` were obtained, in up to three lines: training views, test views, image size and seeds;
/// preset, iterations and device; how images are measured.
///
/// Where records differ in one of these, the line names the value of each seed, scene, preset or variant
/// (`train views seed 0: 26, 86, 2, 55; seed 1: 80, 84, 33, 81`). If none of the four explains the values, they are listed as
/// `mixed`, or counted if there are too many. Iterations that differ are a range. No records have no lines.
pub fn protocol_lines<R: AsRef<Record>>(records: &[R]) -> Vec<String> {
    if records.is_empty() {
        return Vec::new();
    }
    let mut seeds = distinct(records, |record| record.seed);
    seeds.sort_unstable();
    let first = [
        described(records, "train views ", "", |record| match record.train_views.len() {
            count if count > MAX_LISTED => format!("{count} of them"),
            _ => view_names(&record.train_views, &record.train_files),
        }),
        described(records, "test views ", "", |record| {
            let TestViews { protocol, count, .. } = &record.test_views;
            match protocol.as_str() {
                "training" => format!("training ({count}; how well these are fitted, not the quality of new views)"),
                _ if *count > MAX_LISTED || record.test_files.is_empty() => format!("{protocol} ({count})"),
                _ => format!("{protocol} ({count}: {})", view_names(&record.test_views.ids, &record.test_files)),
            }
        }),
        described(records, "", " pixels", |record| format!("{} × {}", record.image_size[0], record.image_size[1])),
        match seeds.len() {
            1 => format!("seed {}", joined(&seeds)),
            count if count > MAX_EXPLAINED => format!("{count} seeds"),
            _ => format!("seeds {}", joined(&seeds)),
        },
    ];
    let counts = || records.iter().map(|record| record.as_ref().iterations);
    let second = [
        described(records, "preset ", "", |record| record.preset.clone()),
        // A range, as every run takes another number of steps under a time budget.
        match (counts().min(), counts().max()) {
            (Some(least), Some(most)) if least < most => format!("{least}–{most} iterations"),
            (least, _) => format!("{} iterations", least.unwrap_or(0)),
        },
        described(records, "device ", "", |record| record.device.clone()),
    ];
    let third = described(records, "", "", |record| record.evaluation.clone());
    [first.join(" · "), second.join(" · "), third].into_iter().filter(|line| !line.is_empty()).collect()
}

/// Lists views by the names of their files, or by ids if the names end with the ids (as Blender's do) or there are no files.
fn view_names(ids: &[usize], files: &[String]) -> String {
    let number = |file: &String| {
        let stem = Path::new(file).file_stem().unwrap_or_default().to_string_lossy();
        stem[stem.trim_end_matches(|c: char| c.is_ascii_digit()).len()..].parse::<usize>().ok()
    };
    if files.iter().map(number).eq(ids.iter().map(|id| Some(*id))) || files.is_empty() {
        return joined(ids);
    }
    let name = |file: &String| Path::new(file).file_name().unwrap_or_default().to_string_lossy().into_owned();
    joined(&files.iter().map(name).collect::<Vec<_>>())
}

/// Describes `value` of all records: once if it is the same for all, else by seed, scene, preset or variant, else as a list.
fn described<R: AsRef<Record>>(records: &[R], before: &str, after: &str, value: impl Fn(&Record) -> String) -> String {
    let values = distinct(records, &value);
    if let [only] = values.as_slice() {
        return format!("{before}{only}{after}");
    }
    let keys: [fn(&Record) -> String; 4] = [
        |record| format!("seed {}", record.seed),
        |record| record.scene.clone(),
        |record| record.preset.clone(),
        Record::label,
    ];
    let explained = keys.iter().find_map(|key| {
        let pairs = distinct(records, |record| (key(record), value(record)));
        (pairs.len() <= MAX_EXPLAINED && pairs.len() == distinct(records, key).len()).then(|| {
            let parts: Vec<String> = pairs.into_iter().map(|(key, value)| format!("{key}: {value}")).collect();
            parts.join("; ")
        })
    });
    let text = explained.unwrap_or_else(|| match values.len() {
        count if count > MAX_LISTED => format!("{count} different values, see results.json"),
        _ => format!("mixed: {}", values.join("; ")),
    });
    format!("{before}{text}{after}")
}

fn joined<T: ToString>(values: &[T]) -> String {
    values.iter().map(T::to_string).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::tests::record;

    #[test]
    fn differences_are_explained_by_seed_scene_or_variant() {
        let mut records = [("lego", 0), ("lego", 1), ("mic", 1)].map(|(scene, seed)| record(scene, "nerf", seed, 1.0));
        records[0].train_views = vec![1, 2];
        records[2].image_size = [800, 800];
        records[1].device = "cuda".into();
        let lines = protocol_lines(&records);
        let expected = "train views seed 0: 1, 2; seed 1: 26, 86, 2, 55 · test views every-8 (25)";
        assert!(lines[0].starts_with(expected), "{lines:?}");
        assert!(lines[0].contains("lego: 400 × 400; mic: 800 × 800 pixels"), "{lines:?}");
        assert!(lines[1].contains("device mixed: flex; cuda"), "{lines:?}");
        assert!(protocol_lines::<Record>(&[]).is_empty());
    }

    #[test]
    fn views_of_captures_are_named_by_their_files() {
        let mut saved = record("fern", "nerf", 0, 1.0);
        saved.train_views = vec![6, 8];
        saved.test_views = TestViews { protocol: "every-8".into(), count: 1, ids: vec![0] };
        let line = |saved: &Record| protocol_lines(&[saved])[0].clone();
        saved.train_files = ["images/image007.png", "images/image010.png"].map(String::from).to_vec();
        saved.test_files = vec!["images/IMG_4026.JPG".into()];
        let named = line(&saved);
        let expected = "train views image007.png, image010.png · test views every-8 (1: IMG_4026.JPG)";
        assert!(named.starts_with(expected), "{named}");
        saved.train_files = ["train/r_6.png", "train/r_8.png"].map(String::from).to_vec();
        saved.test_files = Vec::new();
        assert!(line(&saved).starts_with("train views 6, 8 · test views every-8 (1)"), "{}", line(&saved));
    }
}
