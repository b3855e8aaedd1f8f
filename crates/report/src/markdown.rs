//! Markdown document of the results of several experiments.

use indexmap::IndexSet;

use crate::claim::{Finding, TestedClaim};
use crate::input::ReportInput;
use crate::protocol::protocol_lines;
use crate::quantity::Quantity;
use crate::table::{Table, overview_table, scene_table};
use crate::text::escape_markdown;

/// The second line of every document of [`results_document`].
pub const WRITTEN_BY: &str = "Written by `infonerf collect` from results files; not edited by hand.";

/// Makes one Markdown document of the results of several experiments, so that no figure in it is typed by hand. Each
/// experiment has its command and protocol, the notes of its records, means over scenes, each scene's PSNR, and claims.
pub fn results_document(title: &str, experiments: &[ReportInput]) -> String {
    let mut blocks = vec![format!("# {}", escape_markdown(title))];
    blocks.push(WRITTEN_BY.into());
    // The protocol is printed above all tables.
    let markdown = |table: Table| Table { protocol: Vec::new(), ..table }.to_markdown();
    for input in experiments {
        let records = &input.records;
        blocks.push(format!("## {}", escape_markdown(&input.heading())));
        blocks.extend(input.command.as_ref().map(|command| format!("```sh\n{command}\n```")));
        let protocol: Vec<String> = protocol_lines(records).iter().map(|line| escape_markdown(line)).collect();
        blocks.extend((!protocol.is_empty()).then(|| protocol.join("  \n")));
        let notes: IndexSet<&String> = records.iter().flat_map(|record| &record.notes).collect();
        let notes: Vec<String> = notes.into_iter().map(|note| format!("- {}", escape_markdown(note))).collect();
        blocks.extend((!notes.is_empty()).then(|| notes.join("\n")));
        blocks.push(markdown(overview_table(records, &Quantity::all())));
        if records.iter().any(|record| record.scene != records[0].scene) {
            blocks.push(markdown(scene_table(records, Quantity::PSNR)));
        }
        let tested = input.tested_claims();
        blocks.extend((!tested.is_empty()).then(|| claims(&tested)));
    }
    blocks.join("\n\n") + "\n"
}

fn claims(claims: &[TestedClaim]) -> String {
    let one = |claim: &TestedClaim| {
        let row = |finding: &Finding| {
            let cells = [&finding.formula, &finding.found, &finding.in_paper, &finding.verdict.to_string()];
            format!("\n| {} |", cells.map(|cell| escape_markdown(cell)).join(" | "))
        };
        let (verdict, statement) = (claim.verdict, escape_markdown(&claim.statement));
        let head = "| comparison | left − right, here | in the paper | |\n| --- | ---: | ---: | --- |";
        format!("**{verdict}**: {statement}\n\n{head}{}", claim.findings.iter().map(row).collect::<String>())
    };
    claims.iter().map(one).collect::<Vec<_>>().join("\n\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::tests::record;

    #[test]
    fn results_document_has_command_protocol_and_tables() {
        let runs = [("lego", "nerf", 15.0), ("lego", "infonerf", 19.0), ("mic", "nerf", 14.0)];
        let mut records = runs.map(|(scene, variant, psnr)| record(scene, variant, 0, psnr)).to_vec();
        records.iter_mut().for_each(|record| record.notes.push("procedural scene".into()));
        let command = Some("infonerf exp synthetic-4view".to_owned());
        let input = ReportInput { command, ..ReportInput::new("exp", "Four views", records) };
        let document = results_document("Results", &[input]);
        for part in ["# Results", "## Four views", "infonerf exp synthetic-4view", "**19.00**", "| mic |", "seed 0"] {
            assert!(document.contains(part), "{part}: {document}");
        }
        // Notes and protocol appear once for all runs and tables.
        for part in ["- procedural scene", "seed 0"] {
            assert_eq!(document.matches(part).count(), 1, "{part}: {document}");
        }
    }
}
