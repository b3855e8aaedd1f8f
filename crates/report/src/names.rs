//! Names that are used as folder names.

/// Maximum length of a name in bytes that file systems allow.
const MAX_BYTES: usize = 255;

/// Returns the reason why some file system refuses `name` for a folder: it is empty, a path, `.` or `..`, has control
/// characters or one of `<>:"|?*`, ends with a dot or space, or is too long. `None` if all take it.
pub fn folder_name_fault(name: &str) -> Option<String> {
    let reserved = |c: char| c.is_control() || r#"/\<>:"|?*"#.contains(c);
    match name {
        "" => Some("it is empty".to_owned()),
        "." | ".." => Some("it means another folder".to_owned()),
        _ => match name.chars().find(|c| reserved(*c)) {
            Some(c) => Some(format!("it holds {c:?}")),
            None if name.ends_with(['.', ' ']) => Some("it ends with a dot or a space".to_owned()),
            None if name.len() > MAX_BYTES => Some(format!("it has {} bytes, more than {MAX_BYTES}", name.len())),
            None => None,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_a_file_system_refuses_have_a_fault() {
        for name in ["lego", "my scene", "nerf+key", "my exp", "λ₁=1e-3", "a.b", ".hidden", "(1)"] {
            assert_eq!(folder_name_fault(name), None, "{name}");
        }
        let long = "x".repeat(256);
        for name in ["", ".", "..", "a/b", "a\\b", "a\nb", "a:b", "what?", "end.", "end ", &long] {
            let fault = folder_name_fault(name).expect(name);
            assert_eq!(fault.lines().count(), 1, "{fault}");
        }
    }
}
