//! Claims of a paper with their findings.

use crate::{
    Finding, TestedClaim, Verdict,
    text::{escape_html, html_prose},
};

/// Lists every claim with its comparisons; empty without claims.
pub(super) fn list(claims: &[TestedClaim]) -> String {
    if claims.is_empty() {
        return String::new();
    }
    format!(
        "<h3>Claims of the paper, tested here</h3>\n{}\
         <p class=\"muted\">Differences are taken between runs on the same scene and view set: their mean with its 95 % interval, \
         for other view sets of these scenes and for other scenes like them.</p>\n",
        claims.iter().map(claim).collect::<String>()
    )
}

fn claim(claim: &TestedClaim) -> String {
    format!(
        "<div class=\"scroll\"><table class=\"claim\">\n<caption>{} {}</caption>\n<thead><tr>\
         <th scope=\"col\">Comparison</th><th scope=\"col\">Left − right, here</th><th scope=\"col\">In the paper</th>\
         <th scope=\"col\"></th></tr></thead>\n<tbody>\n{}</tbody>\n</table></div>\n",
        tag(claim.verdict),
        html_prose(&claim.statement),
        claim.findings.iter().map(row).collect::<String>(),
    )
}

fn row(finding: &Finding) -> String {
    format!(
        "<tr><th scope=\"row\">{}</th><td>{}</td><td>{}</td><td>{}</td></tr>\n",
        escape_html(&finding.formula),
        escape_html(&finding.found()),
        escape_html(&finding.in_paper()),
        tag(finding.verdict),
    )
}

pub(super) fn tag(verdict: Verdict) -> String {
    let class = match verdict {
        Verdict::Holds => "holds",
        Verdict::Fails => "fails",
        Verdict::Undecided | Verdict::Untested => "open",
    };
    format!("<span class=\"tag {class}\">{verdict}</span>")
}
