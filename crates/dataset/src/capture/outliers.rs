//! Cameras far from all others, and worlds far from their origin.

use glam::DVec3;

use crate::frame::Frame;

/// A camera is an outlier if it is farther from the median position than this many times the 75 % quantile of distances.
const FAR_OUT: f64 = 6.0;
/// Fewer cameras than this do not show which of them are outliers.
const MIN_CAMERAS: usize = 6;
/// Maximum share of cameras that are left out: more are a part of the capture.
const MAX_SHARE: f64 = 0.1;
/// A world is moved to its cameras if they are farther from its origin than this many times their spread, at which `f32`
/// resolves 10⁻⁵ of the spread.
const DISTANT: f64 = 100.0;
/// Distance from the origin beyond which a world is moved whose cameras all stand in one place.
const DISTANT_PLACE: f64 = 1e4;
/// Names that a warning lists.
const MAX_LISTED: usize = 5;

/// Returns the median position of the cameras, and the 75 % quantile of their distances from it.
fn middle_and_spread(frames: &[Frame]) -> (DVec3, f64) {
    let median = |mut values: Vec<f64>, share: f64| {
        values.sort_by(f64::total_cmp);
        values.get(((values.len().max(1) - 1) as f64 * share).round() as usize).copied().unwrap_or(0.0)
    };
    let middle =
        DVec3::from_array([0, 1, 2].map(|axis| median(frames.iter().map(|f| f.pose.w_axis[axis]).collect(), 0.5)));
    (middle, median(frames.iter().map(|f| place(f).distance(middle)).collect(), 0.75))
}

/// Lists names, [`MAX_LISTED`] at most.
pub(crate) fn listed<'a>(names: impl Iterator<Item = &'a str>) -> String {
    names
        .take(MAX_LISTED + 1)
        .enumerate()
        .map(|(i, name)| if i < MAX_LISTED { name } else { "…" })
        .collect::<Vec<_>>()
        .join(", ")
}

fn place(frame: &Frame) -> DVec3 {
    frame.pose.w_axis.truncate()
}

/// Leaves out the frames whose camera is far from all training cameras, and returns a warning that names them.
pub(super) fn leave_out(train: &mut Vec<Frame>, test: &mut Vec<Frame>) -> Option<String> {
    if train.len() < MIN_CAMERAS {
        return None;
    }
    let (middle, spread) = middle_and_spread(train);
    let times = |frame: &Frame| place(frame).distance(middle) / spread;
    let is_far = |frame: &Frame| spread > 0.0 && times(frame) > FAR_OUT;
    let far: Vec<&Frame> = train.iter().chain(test.iter()).filter(|frame| is_far(frame)).collect();
    let first = far.iter().map(|frame| times(frame)).fold(0.0, f64::max);
    if far.is_empty() || far.len() as f64 > (MAX_SHARE * (train.len() + test.len()) as f64).max(1.0) {
        return None;
    }
    let (count, all) = (far.len(), train.len() + test.len());
    let names = listed(far.iter().map(|frame| frame.name.as_str()));
    let warning = format!(
        "{count} of {all} cameras are up to {first:.0} times farther out than the others and left out: {names}"
    );
    train.retain(|frame| !is_far(frame));
    test.retain(|frame| !is_far(frame));
    Some(warning)
}

/// Returns the middle of the training cameras if the world's origin is so far away that `f32` would lose detail.
pub(super) fn distant_middle(train: &[Frame]) -> Option<DVec3> {
    let (middle, spread) = middle_and_spread(train);
    let limit = if spread > 0.0 { DISTANT * spread } else { DISTANT_PLACE };
    (middle.length() > limit).then_some(middle)
}
