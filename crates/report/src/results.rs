//! The results of several experiments as one Markdown document, so that no figure in it is typed by hand.

use indexmap::IndexSet;

use crate::{
    Quantity, Record, ReportInput, Table, markdown, overview_table, protocol_lines, scene_table, text::escape_markdown,
};

/// An experiment in a document of results.
#[derive(Debug, Clone, PartialEq)]
pub struct Results {
    /// Its runs and what is said of them.
    pub input: ReportInput,
    /// The command that ran it, if it is known.
    pub command: Option<String>,
}

/// A section for each experiment: its command and protocol, what its records note, the means over scenes, each scene's
/// PSNR, and its claims.
pub fn results_document(title: &str, experiments: &[Results]) -> String {
    let mut blocks = vec![format!("# {}", escape_markdown(title))];
    blocks.push("Written by `infonerf collect` from results files; not edited by hand.".into());
    for Results { input, command } in experiments {
        let records: Vec<Record> = input.runs.iter().map(|run| run.record.clone()).collect();
        blocks.push(format!("## {}", escape_markdown(&input.heading())));
        blocks.extend(command.as_ref().map(|command| format!("```sh\n{command}\n```")));
        blocks.extend(markdown::protocol(&protocol_lines(&records)));
        let notes: IndexSet<&String> = records.iter().flat_map(|record| &record.notes).collect();
        if !notes.is_empty() {
            blocks.push(notes.iter().map(|note| format!("- {}", escape_markdown(note))).collect::<Vec<_>>().join("\n"));
        }
        // The protocol stands above all tables.
        let markdown = |table: Table| Table { protocol: Vec::new(), ..table }.to_markdown();
        blocks.push(markdown(overview_table(&records, &Quantity::all())));
        if records.iter().any(|record| record.scene != records[0].scene) {
            blocks.push(markdown(scene_table(&records, Quantity::PSNR)));
        }
        let claims = input.tested_claims();
        if !claims.is_empty() {
            blocks.push(markdown::claims(&claims));
        }
    }
    blocks.join("\n\n") + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_section_has_command_protocol_and_tables() {
        let run = |scene: &str, variant: &str, psnr| Record {
            scene: scene.into(),
            variant: variant.into(),
            metrics: [("psnr".to_owned(), Some(psnr))].into_iter().collect(),
            notes: vec!["procedural scene".into()],
            ..Record::default()
        };
        let records = vec![run("lego", "nerf", 15.0), run("lego", "infonerf", 19.0), run("mic", "nerf", 14.0)];
        let input = ReportInput::new("exp", "Four views", records);
        let command = Some("infonerf exp synthetic-4view".to_owned());
        let document = results_document("Results", &[Results { input, command }]);
        for part in ["# Results", "## Four views", "infonerf exp synthetic-4view", "**19.00**", "| mic |", "seed 0"] {
            assert!(document.contains(part), "{part}: {document}");
        }
        // Once for all runs and tables.
        for part in ["- procedural scene", "seed 0"] {
            assert_eq!(document.matches(part).count(), 1, "{part}: {document}");
        }
    }
}
