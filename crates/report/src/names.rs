//! Names that are used as folder names.

/// Longest name in bytes: what file systems allow.
const LONGEST: usize = 255;

/// Why some file system does not take `name` for a folder's: it is empty, a path, `.` or `..`, has control characters or
/// one of `<>:"|?*`, ends with a dot or space, or is too long. None if all take it.
pub fn folder_name_fault(name: &str) -> Option<String> {
    let reserved = |c: char| c.is_control() || r#"/\<>:"|?*"#.contains(c);
    match name {
        "" => Some("it is empty".to_owned()),
        "." | ".." => Some("it means another folder".to_owned()),
        _ => match name.chars().find(|c| reserved(*c)) {
            Some(c) => Some(format!("it holds {c:?}")),
            None if name.ends_with(['.', ' ']) => Some("it ends with a dot or a space".to_owned()),
            None if name.len() > LONGEST => Some(format!("it has {} bytes, more than {LONGEST}", name.len())),
            None => None,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_file_systems_take_is_taken() {
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
