use super::check_ids;
use crate::error::SceneError;

/// Choice of the test views to evaluate on.
///
/// As text ([`std::fmt::Display`], [`std::str::FromStr`]): `all`, `split`, `every-8`, `first-3`, `26,86,2`, `training` or a name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TestProtocol {
    /// Every test view.
    All,
    /// Every n-th test view, starting with the first: `Every(8)` takes 25 of Blender's 200.
    Every(usize),
    /// The first n test views.
    First(usize),
    /// Test views by their ids, in this order.
    Ids(Vec<usize>),
    /// The format's own test split: Blender's test set, every eighth view of LLFF and captures, RegNeRF's 25 for DTU.
    Split,
    /// A published protocol by its name, such as `pixelnerf` for DTU.
    Published(String),
    /// Chosen training views: metrics then measure how well these are fitted, not how new views look. Captures hold no
    /// view out, for few photographs that are all trained on.
    Training,
}

impl TestProtocol {
    /// Returns the indices of the chosen views among `n`, for a scene with all of them in its split and no published protocol.
    ///
    /// # Errors
    /// There are no test views; `Every(0)`, `First(0)` or more than there are; an id is out of range or given twice; a published
    /// protocol; or `Training`, which does not choose among test views.
    pub fn select(&self, n: usize) -> Result<Vec<usize>, SceneError> {
        let error = |expected: &str, found: &str| SceneError::request("test", expected, found);
        match self {
            _ if n == 0 => Err(error("a scene with at least one test view", "none")),
            Self::Every(0) => Err(error("a positive step", "0")),
            Self::First(count) if !(1..=n).contains(count) => {
                let expected = format!("a number of the first test views from 1 to {n}, as many as there are");
                Err(SceneError::request("test", expected, count))
            }
            Self::All | Self::Split => Ok((0..n).collect()),
            Self::Every(step) => Ok((0..n).step_by(*step).collect()),
            Self::First(count) => Ok((0..*count).collect()),
            Self::Ids(ids) => check_ids("test", ids, n).map(|()| ids.clone()),
            Self::Published(name) => Err(error("a protocol that this scene knows", name)),
            Self::Training => Err(error("a protocol of test views", "training")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn test_protocols() {
        use TestProtocol::{All, Every, First, Ids, Published, Split, Training};
        let ids = |ids: &[usize]| Ids(ids.to_vec());
        let few: [(_, &[usize]); 5] =
            [(All, &[0, 1, 2]), (Split, &[0, 1, 2]), (First(2), &[0, 1]), (ids(&[2, 0]), &[2, 0]), (Every(2), &[0, 2])];
        for (protocol, expected) in few {
            assert_eq!(protocol.select(3).unwrap(), expected);
        }
        assert_eq!(Every(8).select(200).unwrap().len(), 25);
        for bad in [Every(0), First(0), First(4), ids(&[3]), ids(&[1, 1]), ids(&[]), Published("x".into()), Training] {
            assert!(bad.select(3).unwrap_err().to_string().contains("`test`"));
        }
        assert!(All.select(0).is_err());
    }
}
