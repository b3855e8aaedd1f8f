//! Selections and protocols for formats with their own splits and named sets.

use super::{TestProtocol, ViewSelection};
use crate::camera::Camera;
use crate::error::SceneError;

/// Named sets of view ids.
pub type Named = Vec<(String, Vec<usize>)>;

/// Returns the positions in a pool of the views that `selection` chooses. `ids` are the ids of the pool's views.
///
/// # Errors
/// Errors of [`ViewSelection::select`], or there is no selection of that name.
pub fn train(
    selection: &ViewSelection,
    cameras: &[Camera],
    ids: &[usize],
    named: &Named,
) -> Result<Vec<usize>, SceneError> {
    match selection {
        ViewSelection::Ids { ids: wanted } => positions("train", wanted, ids),
        ViewSelection::Named { name } => positions("train", by_name("train", name, named)?, ids),
        other => other.select(cameras),
    }
}

/// Returns the positions in a pool of the views that `protocol` chooses. `split` are the ids of the format's own test views.
///
/// # Errors
/// Errors of [`TestProtocol::select`], or there is no set of that name.
pub fn test(
    protocol: &TestProtocol,
    ids: &[usize],
    split: Option<&[usize]>,
    named: &Named,
) -> Result<Vec<usize>, SceneError> {
    match (protocol, split) {
        (TestProtocol::Ids(wanted), _) => positions("test", wanted, ids),
        (TestProtocol::Published(name), _) => positions("test", by_name("test", name, named)?, ids),
        (TestProtocol::Split, Some(split)) => positions("test", split, ids),
        _ => protocol.select(ids.len()),
    }
}

fn by_name<'a>(field: &'static str, name: &str, named: &'a Named) -> Result<&'a [usize], SceneError> {
    if let Some((_, ids)) = named.iter().find(|(known, _)| known == name) {
        return Ok(ids);
    }
    let known = named.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ");
    let expected = if known.is_empty() { "no name (this scene knows none)".into() } else { format!("one of {known}") };
    Err(SceneError::request(field, expected, format!("`{name}`")))
}

/// Returns the position in `ids` of each of `wanted`.
fn positions(field: &'static str, wanted: &[usize], ids: &[usize]) -> Result<Vec<usize>, SceneError> {
    let unknown = |id: &usize| {
        let known = ids.iter().map(usize::to_string).collect::<Vec<_>>().join(" ");
        SceneError::request(field, format!("view ids among {known}"), id)
    };
    let position = |id: &usize| ids.iter().position(|known| known == id).ok_or_else(|| unknown(id));
    let are_positions = ids.iter().enumerate().all(|(i, &id)| i == id);
    let found =
        if are_positions { wanted.to_vec() } else { wanted.iter().map(position).collect::<Result<Vec<_>, _>>()? };
    super::check_ids(field, &found, ids.len()).map(|()| found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::train_cameras;

    #[test]
    fn ids_need_not_be_positions() {
        let ids = [3, 5, 9];
        let named = vec![("two".to_owned(), vec![9, 3]), ("lost".to_owned(), vec![4])];
        let cameras = &train_cameras()[..3];
        let choose = |selection| train(&selection, cameras, &ids, &named);
        assert_eq!(choose(ViewSelection::Ids { ids: vec![5, 3] }).unwrap(), [1, 0]);
        assert_eq!(choose("two".parse().unwrap()).unwrap(), [2, 0]);
        assert_eq!(choose(ViewSelection::All).unwrap(), [0, 1, 2]);
        let text = choose(ViewSelection::Ids { ids: vec![4] }).unwrap_err().to_string();
        assert!(text.contains("view ids among 3 5 9, found 4"), "{text}");
        let text = choose("three".parse().unwrap()).unwrap_err().to_string();
        assert!(text.contains("one of two, lost, found `three`"), "{text}");
        assert!(choose(ViewSelection::Ids { ids: vec![5, 5] }).is_err());
        assert_eq!(test(&TestProtocol::Split, &ids, Some(&[9]), &named).unwrap(), [2]);
        assert_eq!(test(&TestProtocol::Split, &ids, None, &named).unwrap(), [0, 1, 2]);
        assert_eq!(test(&TestProtocol::Published("two".into()), &ids, None, &named).unwrap(), [2, 0]);
        assert!(test(&TestProtocol::Published("x".into()), &ids, None, &Vec::new()).is_err());
    }
}
