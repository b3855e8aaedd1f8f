//! Routes of the server.

use super::control::TrainingCommand;

/// Folders of images in a run.
const IMAGE_FOLDERS: [&str; 4] = ["test", "truth", "depth", "error"];

/// Subject of a request. [`Roots`](super::runs::Roots) defines the names of runs.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum PageRoute {
    /// Page.
    Page,
    /// List of runs.
    Runs,
    /// State of the training in this process.
    Training,
    /// Command to the training in this process.
    TrainingCommand(TrainingCommand),
    /// Field of a run at its newest checkpoint.
    Field { run: String },
    /// Work that is being done to answer for a run's field.
    Work { run: String },
    /// Loss and PSNR of a run by step, and the names of its test views.
    Progress { run: String },
    /// Image of a run.
    Image { run: String, kind: &'static str, name: String },
}

impl PageRoute {
    /// Returns the route of a path and its query; `None` if there is none.
    pub(super) fn of(path: &str, query: &str) -> Option<Self> {
        let value = |wanted: &str| {
            let mut pairs = form_urlencoded::parse(query.as_bytes());
            pairs.find(|(key, _)| key == wanted).map(|(_, value)| value.into_owned())
        };
        Some(match path {
            "/" => Self::Page,
            "/runs" => Self::Runs,
            "/training" => Self::Training,
            "/pause" => Self::TrainingCommand(TrainingCommand::Pause),
            "/resume" => Self::TrainingCommand(TrainingCommand::Resume),
            "/stop" => Self::TrainingCommand(TrainingCommand::Stop),
            "/field" => Self::Field { run: value("run")? },
            "/work" => Self::Work { run: value("run")? },
            "/progress" => Self::Progress { run: value("run")? },
            "/picture" => {
                let (kind, name) = (value("kind")?, value("name")?);
                let kind = IMAGE_FOLDERS.into_iter().find(|known| *known == kind)?;
                let plain = !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || "-_".contains(c));
                plain.then_some(Self::Image { run: value("run")?, kind, name })?
            }
            _ => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_and_queries_have_routes() {
        assert_eq!(PageRoute::of("/", ""), Some(PageRoute::Page));
        assert_eq!(
            PageRoute::of("/field", "run=a%2Finfonerf%2B/seed0"),
            Some(PageRoute::Field { run: "a/infonerf+/seed0".into() })
        );
        let image = PageRoute::Image { run: ".".into(), kind: "truth", name: "003".into() };
        assert_eq!(PageRoute::of("/picture", "run=.&kind=truth&name=003"), Some(image));
    }

    #[test]
    fn unknown_paths_have_no_route() {
        for (path, query) in [
            ("/field", ""),
            ("/../etc/passwd", ""),
            ("/picture", "run=.&kind=checkpoint&name=003"),
            ("/picture", "run=.&kind=test&name=../truth/003"),
            ("/picture", "run=.&kind=test&name=003.png"),
            ("/picture", "run=.&kind=test&name="),
            ("/picture", "run=.&kind=test&name=%00"),
        ] {
            assert_eq!(PageRoute::of(path, query), None, "{path}?{query}");
        }
    }
}
