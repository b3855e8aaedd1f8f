//! Routes of the server.

use super::control::Command;

/// Folders of pictures in a run.
const PICTURES: [&str; 4] = ["test", "truth", "depth", "error"];

/// What a request asks for. [`Roots`](super::runs::Roots) says how runs are named.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Route {
    /// The page.
    Page,
    /// The list of runs.
    Runs,
    /// Whether this process trains, and whether it is paused.
    Training,
    /// To pause, resume or stop it.
    Command(Command),
    /// A run's field as it is now.
    Field { run: String },
    /// A run's loss and PSNR by step, and the names of its test views.
    Progress { run: String },
    /// A picture of a run.
    Picture { run: String, kind: &'static str, name: String },
}

impl Route {
    /// The route of a path and its query, if there is one.
    pub(super) fn of(path: &str, query: &str) -> Option<Self> {
        let value = |wanted: &str| {
            let mut pairs = form_urlencoded::parse(query.as_bytes());
            pairs.find(|(key, _)| key == wanted).map(|(_, value)| value.into_owned())
        };
        Some(match path {
            "/" => Self::Page,
            "/runs" => Self::Runs,
            "/training" => Self::Training,
            "/pause" => Self::Command(Command::Pause),
            "/resume" => Self::Command(Command::Resume),
            "/stop" => Self::Command(Command::Stop),
            "/field" => Self::Field { run: value("run")? },
            "/progress" => Self::Progress { run: value("run")? },
            "/picture" => {
                let (kind, name) = (value("kind")?, value("name")?);
                let kind = PICTURES.into_iter().find(|known| *known == kind)?;
                let plain = !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || "-_".contains(c));
                plain.then_some(Self::Picture { run: value("run")?, kind, name })?
            }
            _ => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_and_queries() {
        assert_eq!(Route::of("/", ""), Some(Route::Page));
        assert_eq!(
            Route::of("/field", "run=a%2Finfonerf%2B/seed0"),
            Some(Route::Field { run: "a/infonerf+/seed0".into() })
        );
        let picture = Route::Picture { run: ".".into(), kind: "truth", name: "003".into() };
        assert_eq!(Route::of("/picture", "run=.&kind=truth&name=003"), Some(picture));
    }

    #[test]
    fn what_is_not_there() {
        for (path, query) in [
            ("/field", ""),
            ("/../etc/passwd", ""),
            ("/picture", "run=.&kind=checkpoint&name=003"),
            ("/picture", "run=.&kind=test&name=../truth/003"),
            ("/picture", "run=.&kind=test&name=003.png"),
            ("/picture", "run=.&kind=test&name="),
            ("/picture", "run=.&kind=test&name=%00"),
        ] {
            assert_eq!(Route::of(path, query), None, "{path}?{query}");
        }
    }
}
