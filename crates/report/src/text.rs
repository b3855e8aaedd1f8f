//! Counts with their nouns, and escaping of text for HTML, Markdown and LaTeX.

/// Returns a count with its noun, such as `1 run` or `2 runs`.
pub fn counted(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

/// Escapes text for HTML and XML content and quoted attributes; control characters, which XML forbids, become spaces.
pub fn escape_html(text: &str) -> String {
    let marks = [('&', "&amp;"), ('<', "&lt;"), ('>', "&gt;"), ('"', "&quot;"), ('\'', "&#39;")];
    marks.into_iter().fold(plain(text), |text, (mark, escaped)| text.replace(mark, escaped))
}

/// Escapes a sentence for HTML content; text between backticks becomes `<code>`.
pub(crate) fn html_prose(text: &str) -> String {
    by_code(text, escape_html, |code| format!("<code>{}</code>", escape_html(code)))
}

/// Escapes a sentence for Markdown on one line, also inside a table cell; text between backticks stays code.
pub(crate) fn escape_markdown(text: &str) -> String {
    by_code(&plain(text), markdown_text, |code| format!("`{}`", code.replace('|', "\\|")))
}

/// Applies `of_code` to the text between backticks and `of_text` to the rest, or to all if backticks are not paired.
fn by_code(text: &str, of_text: impl Fn(&str) -> String, of_code: impl Fn(&str) -> String) -> String {
    let parts: Vec<&str> = text.split('`').collect();
    if parts.len().is_multiple_of(2) || parts.iter().skip(1).step_by(2).any(|code| code.is_empty()) {
        return of_text(text);
    }
    // Text and code alternate.
    let parts = parts.into_iter().enumerate();
    parts.map(|(index, part)| if index % 2 == 1 { of_code(part) } else { of_text(part) }).collect()
}

fn markdown_text(text: &str) -> String {
    let escaped = |c: char| match c {
        '&' => "&amp;".to_owned(),
        '<' => "&lt;".to_owned(),
        c if "\\`*_[]|#!~$".contains(c) => format!("\\{c}"),
        c => c.to_string(),
    };
    text.chars().map(escaped).collect()
}

/// Escapes text for LaTeX, with the symbols of tables as its commands.
pub(crate) fn escape_latex(text: &str) -> String {
    const SYMBOLS: &str = "±×↑↓→†λ₁₂";
    let commands = [r"\pm", r"\times", r"\uparrow", r"\downarrow", r"\rightarrow", r"\dagger", r"\lambda", "_1", "_2"];
    let escaped = |c: char| match (c, SYMBOLS.chars().position(|symbol| symbol == c)) {
        (_, Some(index)) => format!("${}$", commands[index]),
        ('–', _) => "--".to_owned(),
        ('\\', _) => r"\textbackslash{}".to_owned(),
        ('~' | '^', _) => format!("\\{c}{{}}"),
        _ if "&%$#_{}".contains(c) => format!("\\{c}"),
        _ => c.to_string(),
    };
    plain(text).chars().map(escaped).collect()
}

/// Replaces control characters, which no output needs and some forbid, by spaces.
pub(crate) fn plain(text: &str) -> String {
    text.chars().map(|c| if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') { ' ' } else { c }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_cannot_break_out() {
        assert_eq!(escape_html("<a b=\"c\">&'\u{0}"), "&lt;a b=&quot;c&quot;&gt;&amp;&#39; ");
        assert_eq!(escape_latex("a_b\\^~{50 %}\n"), r"a\_b\textbackslash{}\^{}\~{}\{50 \%\} ");
        assert_eq!(escape_latex("1 ± 2†→"), r"1 $\pm$ 2$\dagger$$\rightarrow$");
        assert_eq!(escape_markdown("a|b\n<i>*"), r"a\|b &lt;i>\*");
        assert_eq!(escape_markdown("set `loss.kl_x|y` to a_b"), r"set `loss.kl_x\|y` to a\_b");
        assert_eq!(escape_markdown("a ` b_``"), r"a \` b\_\`\`");
        assert_eq!(html_prose("<a> `b<c` `"), "&lt;a&gt; `b&lt;c` `");
        assert_eq!(html_prose("<a> `b<c`"), "&lt;a&gt; <code>b&lt;c</code>");
    }
}
