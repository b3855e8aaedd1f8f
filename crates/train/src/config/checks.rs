//! Consistency checks, made before anything is trained: of a config alone, with a scene, and with many scenes.

use infonerf_field::{FieldSpec, SourceImages};
use infonerf_loss::Need;
use infonerf_render::{Placement, SpaceChoice, Warp};
use infonerf_scene::Scene;
use infonerf_schedule::Fault;

use super::{Batch, Config, NeighbourSampling};

/// Checks every number, and that all parts are consistent.
pub(super) fn check_config(config: &Config) -> Result<(), Fault> {
    let Config { scene, field, render, loss, train, eval } = config;
    field.validate()?;
    render.validate()?;
    loss.validate()?;
    train.validate()?;
    let protocols = infonerf_metrics::Protocol::NAMED.map(|(name, _)| name);
    let expected = format!("one of {}", protocols.join(", "));
    Fault::unless(protocols.contains(&eval.protocol.as_str()), "eval.protocol", expected, &eval.protocol)?;
    Fault::unless_within(0.0..=180.0, "scene.disturb.degrees", scene.disturb.degrees)?;
    Fault::unless_within(0.0..=1.0, "scene.disturb.distance", scene.disturb.distance)?;
    Fault::unless_within(0..=1_000_000, "eval.information_rays", eval.information_rays)?;
    Fault::unless_within(0..=10_000, "eval.pose_steps", eval.pose_steps)?;
    if train.cameras.refine.is_photometric() || eval.pose_steps > 0 {
        let expected = "a field that passes gradients on to positions where cameras are learned (train.cameras.refine, \
                        eval.pose_steps), as all but `pixelnerf` do";
        Fault::unless(field.traits().tracks_positions, "field.kind", expected, field)?;
    }
    let whole = !field.traits().intervals || render.placement == Placement::Interval;
    let expected = format!("\"interval\" with a {field}, whose samples are pieces of cones");
    Fault::unless(whole, "render.placement", expected, name(&render.placement))?;
    if let SourceImages::First { key, count: images } = field.traits().sources {
        // The field is given the same images in every step.
        Fault::unless(train.sources == 0, "train.sources", format!("0 with {field}"), train.sources)?;
        let expected = format!("\"pixels\" or \"image\" with {field}");
        Fault::unless(train.batch != Batch::HeldOut, "train.batch", expected, name(&train.batch))?;
        config.scene.views.count().map_or(Ok(()), |views| enough_views(key, images, views))?;
    }
    Fault::unless(loss.active().next().is_some(), "loss", "a term with a weight above 0", "none")?;
    let unseen = loss.needs().iter().any(|need| matches!(need, Need::Unseen | Need::UnseenNeighbours));
    let expected = "at least 1 with a loss over rays of unseen poses";
    Fault::unless(!unseen || train.unseen_rays > 0, "train.unseen_rays", expected, train.unseen_rays)?;
    // A single pass in the middles of steps takes as many samples of a ray as it is long.
    let skips = render.occupancy.enabled || render.clip_to_bounds || render.marches();
    let paired = train.neighbours.sampling == NeighbourSampling::Partner
        || !skips
        || !loss.needs().iter().any(Need::is_of_neighbours);
    let expected = "\"partner\" with render.occupancy.enabled, render.clip_to_bounds, or render.placement = \"mid\" in one \
                    pass (rays and their neighbours are paired by index, and have different numbers of samples there)";
    Fault::unless(paired, "train.neighbours.sampling", expected, name(&train.neighbours.sampling))
}

pub(crate) fn check_scene(config: &Config, scene: &Scene) -> Result<(), Fault> {
    let Config { field, render, .. } = config;
    if let SourceImages::First { key, count: images } = field.traits().sources {
        enough_views(key, images, scene.train.len())?;
    }
    body(config, scene.space.body.is_some())?;
    let forward = render.space != SpaceChoice::Ndc || Warp::has_ndc(scene);
    let found = format!("\"ndc\", while the cameras of {} face all ways", scene.name);
    Fault::unless(forward, "render.space", "another space", found)?;
    if Warp::of(scene, render.space).is_identity() {
        return Ok(());
    }
    let within_a_box = |good: bool, key: &str, expected: &str, found: String| {
        let expected = format!("{expected}, or render.space = \"box\": {} is not bounded by a box", scene.name);
        Fault::unless(good, key, expected, found)
    };
    let placement = render.placement;
    within_a_box(placement != Placement::Interval, "render.placement", "\"mid\" or \"left\"", name(&placement))?;
    let looks = "a field that looks at no photographs";
    within_a_box(field.traits().sources != SourceImages::Any, "field.kind", looks, field.to_string())?;
    within_a_box(!field.traits().body, "field.kind", "a field that hangs on no body", field.to_string())
}

/// Checks that `config` can learn from many scenes at once.
pub(crate) fn check_multi_scene(config: &Config) -> Result<(), Fault> {
    let Config { field, render, train, .. } = config;
    Fault::unless(
        field.traits().sources == SourceImages::Any,
        "field.kind",
        "`pixelnerf`, which looks at photographs of each scene",
        field,
    )?;
    let off = |is_on: bool, key: &str| Fault::unless(!is_on, key, "false where there are many scenes", "true");
    off(render.occupancy.enabled, "render.occupancy.enabled")?;
    off(train.exposure_compensation, "train.exposure_compensation")
}

/// Checks that a field that is attached to a body gets one: from the scene, if it `has_body`, or from a file.
///
/// # Errors
/// If it gets none.
pub fn body(config: &Config, has_body: bool) -> Result<(), Fault> {
    let named = || config.field.clone().files().iter().any(|file| !file.path.as_os_str().is_empty());
    let expected = "a PLY file, or a scene that comes with a body's vertices (ZJU-MoCap with `new_vertices`, or the \
                    built-in figure)";
    Fault::unless(!config.field.traits().body || has_body || named(), "field.vertices", expected, "neither")
}

/// Refuses a field that needs more training views than there are: `images`, set by `key` within `[field]`.
fn enough_views(key: &str, images: usize, views: usize) -> Result<(), Fault> {
    let expected = format!("at most {views}, as many as there are training views");
    Fault::unless(images <= views, &format!("field.{key}"), expected, images)
}

/// Returns the name of an enum's value as config files write it.
fn name(value: &impl serde::Serialize) -> String {
    toml::Value::try_from(value).map_or_else(|error| error.to_string(), |value| value.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Preset, Refine};
    use crate::testing::knot;

    #[test]
    fn cameras_are_learned_with_fields_that_pass_gradients_on() {
        let fault = |settings: &[&str]| Config::of(Preset::Paper, settings).err().map(|error| error.to_string());
        let mip =
            "field={kind='mip',layers=2,width=8,skip=0,position_frequencies=4,direction_frequencies=2,detail=1.0}";
        let pixel = "field={kind='pixelnerf',encoder={width=4,blocks=[1],weights=''},blocks=1,pool_after=1,width=8,\
                     frequencies=2,lowest_frequency=1.5,density='relu'}";
        let refine = "train.cameras.refine=photometric";
        let matches = "train.cameras.refine=matches";
        assert_eq!(fault(&[refine]), None);
        assert_eq!(fault(&[mip, "render.placement=interval", refine]), None);
        assert_eq!(fault(&[mip, "render.placement=interval", matches, "train.cameras.focal=shared"]), None);
        let refines = [Refine::None, Refine::Matches, Refine::Photometric, Refine::Both];
        assert_eq!(refines.map(Refine::is_by_matches), [false, true, false, true]);
        assert_eq!(refines.map(Refine::is_photometric), [false, false, true, true]);
        for (settings, start) in [
            (&[pixel, refine][..], "field.kind: expected a field that passes gradients on"),
            (&[pixel, "eval.pose_steps=3"], "field.kind: expected a field that passes gradients on"),
            (&["train.cameras.refine=true"], "train.cameras.refine: expected a name in quotes"),
            (&["train.cameras.lr=-1"], "train.cameras.lr: expected a number from 0 to 1"),
            (&["train.cameras.prior=-1"], "train.cameras.prior: expected a number from 0 to 1000000"),
            (&["train.cameras.focal=some"], "train.cameras.focal: expected fixed or shared, found \"some\""),
            (&["eval.information_rays=1000001"], "eval.information_rays: expected a number from 0 to 1000000"),
            (&["eval.pose_steps=10001"], "eval.pose_steps: expected a number from 0 to 10000"),
            (&["scene.disturb.degrees=200"], "scene.disturb.degrees: expected a number from 0 to 180"),
        ] {
            let message = fault(settings).unwrap();
            assert!(message.starts_with(start) && message.lines().count() == 1, "{message}");
        }
    }

    /// Checks that neighbours with samples of their own are refused where something skips samples, if a loss pairs them.
    #[test]
    fn neighbours_of_skipped_samples_take_those_of_their_partners() {
        let fault = |settings: &[&str]| {
            let own = ["train.neighbours.sampling=own", "render.fine_samples=0"];
            Config::of(Preset::Paper, own.iter().chain(settings)).err().map(|error| error.to_string())
        };
        let paired = "loss.kl.weight=1e-3";
        assert_eq!(fault(&[paired]), None);
        for skips in ["render.occupancy.enabled=true", "render.clip_to_bounds=true", "render.placement=mid"] {
            assert_eq!(fault(&[skips]), None);
            let message = fault(&[skips, paired]).unwrap();
            assert!(message.starts_with("train.neighbours.sampling: expected \"partner\" with"), "{message}");
        }
    }

    /// Checks a config that alone does not determine the number of views.
    #[test]
    fn field_cannot_look_at_more_views_than_there_are() {
        let scene = knot(4, 4);
        let fault = |images: usize| {
            let encoder = format!("encoder={{images={images},size=[16,16],width=1}}");
            let field = "kind='neuralvolumes',latent=4,resolution=4,width=8,maps=1,warp_resolution=2";
            let settings = ["scene.views={kind='all'}", &format!("field={{{field},{encoder}}}")];
            let config = Config::of(Preset::Fast, settings).unwrap();
            check_scene(&config, &scene).err().map(|fault| fault.to_string())
        };
        let views = scene.train.len();
        assert_eq!(fault(views), None);
        let message = fault(views + 1).unwrap();
        let expected = format!("field.encoder.images: expected at most {views}, as many as there are training views");
        assert!(message.starts_with(&expected), "{message}");
    }

    #[test]
    fn cameras_that_face_all_ways_have_no_ndc() {
        let mut scene = knot(4, 4);
        let mut config = Config::from_table(Preset::Fast.table()).unwrap();
        config.render.space = SpaceChoice::Ndc;
        let views = scene.train.clone();
        scene.train = views[..1].to_vec();
        scene.all_train_cameras = vec![views[0].camera.clone()];
        assert_eq!(check_scene(&config, &scene), Ok(()));
        // Two cameras back to back.
        let turned = glam::DMat4::from_rotation_y(std::f64::consts::PI);
        scene.train = vec![views[0].clone(), views[0].clone()];
        scene.train[1].camera.to_world = views[0].camera.to_world * turned;
        scene.all_train_cameras = scene.training_cameras();
        let message = check_scene(&config, &scene).unwrap_err().to_string();
        assert!(message.contains("render.space") && message.contains("knot"), "{message}");
    }
}
