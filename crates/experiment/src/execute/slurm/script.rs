//! Shell scripts of jobs, with Slurm's options as comments.

use std::ffi::OsString;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result, bail};

/// A script that is being written.
pub(super) struct Script {
    text: String,
}

impl Script {
    pub(super) fn new() -> Self {
        Self { text: "#!/bin/sh\n".to_owned() }
    }

    /// Adds `--name="value"`.
    pub(super) fn option(&mut self, name: &str, value: &str) -> Result<()> {
        if value.contains(char::is_control) {
            bail!("--{name} {value:?}: expected no line breaks or other control characters");
        }
        let value = value.replace('\\', "\\\\").replace('"', "\\\"");
        self.text.push_str(&format!("#SBATCH --{name}=\"{value}\"\n"));
        Ok(())
    }

    /// Adds an option without a value.
    pub(super) fn flag(&mut self, name: &str) {
        self.text.push_str(&format!("#SBATCH --{name}\n"));
    }

    /// Adds a line of shell.
    pub(super) fn line(&mut self, line: &str) {
        self.text.push_str(line);
        self.text.push('\n');
    }

    /// Writes the script, with its folder.
    pub(super) fn write(&self, path: &Path) -> Result<()> {
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
        }
        fs::write(path, &self.text).with_context(|| path.display().to_string())
    }
}

/// Returns a command as a shell reads it.
pub(super) fn quoted(command: &[OsString]) -> Result<String> {
    let quote = |word: &OsString| {
        let text = word.to_str().with_context(|| format!("{}: expected UTF-8", word.display()))?;
        Ok(shlex::try_quote(text).with_context(|| format!("{text:?}"))?.into_owned())
    };
    Ok(command.iter().map(quote).collect::<Result<Vec<_>>>()?.join(" "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_and_words_are_quoted() {
        let mut script = Script::new();
        script.option("output", "a \"b\"/%A.log").unwrap();
        script.flag("requeue");
        assert_eq!(script.text, "#!/bin/sh\n#SBATCH --output=\"a \\\"b\\\"/%A.log\"\n#SBATCH --requeue\n");
        assert!(script.option("output", "a\nb").unwrap_err().to_string().contains("line breaks"));
        assert_eq!(quoted(&["a b".into(), "it's".into(), "c=1".into()]).unwrap(), "'a b' \"it's\" 'c=1'");
    }
}
