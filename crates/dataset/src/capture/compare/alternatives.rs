//! Cameras as other programs would read them.

use glam::{DMat3, DMat4, DQuat, DVec3};
use infonerf_scene::{Camera, Format, Lens, LensModel};

use crate::capture::sizes::long_side;

/// Returns `given` with other intrinsics, each time with words that name these.
pub(super) fn intrinsics(given: &[Camera]) -> Vec<(String, Vec<Camera>)> {
    let each = |change: &dyn Fn(&Camera) -> Camera| given.iter().map(change).collect::<Vec<_>>();
    let mean = given.iter().map(|c| (c.fx * c.fy).sqrt() / long_side(c)).sum::<f64>() / given.len() as f64;
    let focal_lengths = (0..17).map(|i| 0.5 * 1.12f64.powi(i)).map(|widths| {
        let times = |c: &Camera| Camera { fx: widths / mean * c.fx, fy: widths / mean * c.fy, ..c.clone() };
        (format!("with focal lengths of about {widths:.2} image widths"), each(&times))
    });
    let centred = |c: &Camera| Camera { cx: 0.5 * f64::from(c.width), cy: 0.5 * f64::from(c.height), ..c.clone() };
    let reversed = |c: &Camera| match c.lens.model() {
        LensModel::RadialTangential { k, p, .. } => c.with_lens(Lens::radial_tangential(k.map(|k| -k), p.map(|p| -p))),
        _ => c.clone(),
    };
    let lenses = [
        ("with the principal point in the middle", each(&centred)),
        ("with lens coefficients of the other sign", each(&reversed)),
        ("without lens distortion", each(&|c| c.with_lens(Lens::PERSPECTIVE))),
        ("as fisheyes", each(&|c| c.with_lens(Lens::fisheye([0.0; 4])))),
    ];
    focal_lengths.chain(lenses.map(|(name, cameras)| (name.to_owned(), cameras))).collect()
}

/// Returns the given matrices in the conventions of other programs, each time with words that name these in a file of `format`.
pub(super) fn conventions(given: &[DMat4], names: &[&str], format: Format) -> Vec<(&'static str, Vec<DMat4>)> {
    let [flip, mirror] = [-1.0, 1.0].map(|y| DMat4::from_scale(DVec3::new(1.0, y, -1.0)));
    let (mut axes, mut inverse) = ("with OpenCV's axes (y down, z forward)", "as world-to-camera matrices");
    let mut inverse_flipped = "as world-to-camera matrices with OpenCV's axes";
    let mut quarter = ["with cameras rolled by 270°", "with OpenCV's axes and cameras rolled by 270°"];
    match format {
        Format::Colmap | Format::Dtu | Format::Zju => {
            (axes, inverse_flipped) = ("with OpenGL's axes (y up, z backward)", "as camera-to-world matrices");
            inverse = "as camera-to-world matrices with OpenGL's axes";
        }
        Format::Llff => {
            quarter = ["with the columns right, up, backward", "with the columns right, down, forward"];
            axes = "with the columns up, right, forward";
        }
        _ => {}
    }
    let turn = |pose: &DMat4| DMat3::from_mat4(*pose);
    let each = |change: &dyn Fn(&DMat4) -> DMat4| given.iter().map(change).collect::<Vec<_>>();
    let rolled = |degrees: f64| each(&|pose| *pose * DMat4::from_rotation_z(degrees.to_radians()));
    let transposed = |pose: &DMat4| DMat4 { w_axis: pose.w_axis, ..DMat4::from_mat3(turn(pose).transpose()) };
    let moved = |pose: &DMat4| DMat4 { w_axis: (-(turn(pose) * pose.w_axis.truncate())).extend(1.0), ..*pose };
    let shifted = |by: usize| (0..given.len()).map(|i| given[(i + by) % given.len()]).collect();
    let mut all = vec![
        (axes, each(&|pose| *pose * flip)),
        (inverse, each(&|pose| pose.inverse())),
        (inverse_flipped, each(&|pose| pose.inverse() * flip)),
        ("with transposed rotations", each(&transposed)),
        ("with transposed rotations and OpenCV's axes", each(&|pose| transposed(pose) * flip)),
        ("with the translations taken as those of world-to-camera matrices", each(&moved)),
        ("each with the pose of the next photograph", shifted(1)),
        ("each with the pose of the photograph before", shifted(given.len() - 1)),
        ("in the opposite order", given.iter().rev().copied().collect()),
        ("with cameras rolled by 90°", rolled(90.0)),
        ("with cameras rolled by 180°", rolled(180.0)),
        (quarter[0], rolled(270.0)),
        (quarter[1], each(&|pose| *pose * DMat4::from_rotation_z(270f64.to_radians()) * flip)),
        ("as matrices of a left-handed world (z reversed)", each(&|pose| mirror * *pose * mirror)),
        ("as matrices of a left-handed world (y reversed)", each(&|pose| mirror * *pose * mirror * flip)),
    ];
    if format == Format::Colmap {
        let reordered = |pose: &DMat4| {
            let file = (*pose * flip).inverse();
            let q = DQuat::from_mat4(&file);
            let rotation = DMat4::from_quat(DQuat::from_xyzw(q.w, q.x, q.y, q.z));
            DMat4 { w_axis: file.w_axis, ..rotation }.inverse() * flip
        };
        all.push(("with quaternions in the order x, y, z, w", each(&reordered)));
    }
    let mut as_text: Vec<usize> = (0..names.len()).collect();
    as_text.sort_by_key(|&i| names[i]);
    if as_text.windows(2).any(|pair| pair[0] > pair[1]) {
        let mut by_text = vec![DMat4::IDENTITY; given.len()];
        let mut by_number = by_text.clone();
        for (place, &image) in as_text.iter().enumerate() {
            (by_text[image], by_number[place]) = (given[place], given[image]);
        }
        all.push(("in the order of image names as text", by_text));
        all.push(("in the order of the numbers in image names", by_number));
    }
    all
}
