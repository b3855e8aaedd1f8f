//! Configs and scenes of tiny runs.

use std::collections::BTreeMap;
use std::sync::Arc;

use burn::tensor::Device;
use infonerf_scene::{Scene, SceneRequest, TestProtocol, ViewSelection};
use infonerf_train::{Config, Event, Outcome, Preset, Trainer};

/// The field of the paper, everything on: coarse and fine network, occupancy grid, jitter, all loss terms, unseen rays.
const PAPER: &str = "\
    field={kind='nerf',layers=3,width=16,skip=1,position_frequencies=4,direction_frequencies=2,density='softplus',detail={from=0.0,to=1.0,end=0.5}} \
    render.samples=10 render.fine_samples=6 render.occupancy.enabled=true loss.entropy.rays=all \
    loss.kl.weight={from=1e-3,factor=0.5,every=4,stairs=true} loss.kl.rays=all train.lr={from=5e-4,to=5e-5,curve='exponential'}";

/// The field of preset `fast`, everything on, with a gain and bias of each view, and learned cameras.
const FAST: &str = "\
    field.resolutions=[4,8,16] field.channels=2 field.width=16 field.layers=1 loss.kl.weight=1e-3 train.target_samples=400 \
    render.samples={from=12,to=24,end=0.5,curve='exponential'} train.exposure_compensation=true \
    train.cameras={refine='photometric',focal='shared'}";

/// The field of mip-NeRF, with smaller images first.
const MIP: &str = "\
    field={kind='mip',layers=3,width=16,skip=1,position_frequencies=6,direction_frequencies=2,detail={from=0.0,to=1.0,end=0.5}} \
    render.placement=interval render.clip_to_bounds=true train.downscale={steps=[[0.0,2],[0.5,1]]}";

/// The field that is conditioned on images, everything on.
const PIXEL: &str = "\
    field={kind='pixelnerf',encoder={width=4,blocks=[1,1],weights=''},blocks=3,pool_after=2,width=8,frequencies=2,lowest_frequency=1.5,density='softplus'} \
    render.samples=8 render.fine_samples=4 render.occupancy.enabled=true loss.kl.weight=1e-3 loss.kl.rays=all \
    train.batch=held-out train.sources=2";

/// The field that encodes images into a latent code, which it draws in training.
const ENCODED: &str = "\
    field={kind='neuralvolumes',latent=8,resolution=8,width=8,maps=2,warp_resolution=4,encoder={images=1,size=[16,32],width=2}} \
    render.samples=12 render.fine_samples=0 render.placement=mid render.compositing=additive loss.opacity_prior.weight=0.01 \
    loss.tv.weight=0.01 loss.latent.weight=1e-3";

/// Settings of all runs: an occupancy grid for the fields that use one, and few rays.
const ALL: &str = "\
    render.occupancy.resolution=8 render.occupancy.warmup=2 render.occupancy.every=3 train.iterations=12 train.rays=24 \
    train.unseen_rays=12 eval.information_rays=16 loss.entropy.mask.threshold=0.0";

/// Returns the config of a tiny run with the settings `own` as words, and those of `more` on top.
fn configured(preset: Preset, own: &str, more: &[&str]) -> Config {
    let words = [ALL, own].into_iter().flat_map(str::split_whitespace);
    Config::of(preset, words.chain(more.iter().copied())).unwrap()
}

/// Returns the config of a tiny run of the paper's field with `settings` on top.
pub fn config(settings: &[&str]) -> Config {
    configured(Preset::Paper, PAPER, settings)
}

/// Returns the config of a tiny run of the field of preset `fast` with `settings` on top.
pub fn fast_config(settings: &[&str]) -> Config {
    configured(Preset::Fast, FAST, settings)
}

/// Returns the config of a tiny run of the field that is conditioned on images, with `settings` on top.
pub fn pixel_config(settings: &[&str]) -> Config {
    configured(Preset::Paper, PIXEL, settings)
}

/// Returns the configs of tiny runs of every kind of field.
pub fn configs() -> [Config; 5] {
    let mip: Vec<&str> = MIP.split_whitespace().collect();
    let encoded = configured(Preset::Paper, ENCODED, &[]);
    [config(&[]), config(&mip), fast_config(&[]), pixel_config(&[]), encoded]
}

pub fn scene() -> Arc<Scene> {
    scene_of("knot", 4, 16)
}

/// Returns a procedural scene with `count` training views, `size` pixels wide.
pub fn scene_of(name: &str, count: usize, size: u32) -> Arc<Scene> {
    let (train, test) = (ViewSelection::Seed { seed: 0, count }, TestProtocol::First(2));
    let request = SceneRequest { train, test, image_size: Some(size), ..SceneRequest::default() };
    infonerf_procedural::load(name, &request).unwrap().into()
}

#[allow(deprecated, reason = "the older backend stays selectable, so it stays tested")]
pub fn devices() -> [Device; 2] {
    [Device::flex(), Device::ndarray()]
}

pub fn trainer(config: &Config, seed: u64, device: &Device) -> Trainer {
    Trainer::new(config, scene(), seed, None, device).unwrap()
}

/// Takes up to `count` steps and returns what was reported, without times.
pub fn steps(trainer: &mut Trainer, count: usize) -> Vec<Event> {
    let mut events = Vec::new();
    for _ in 0..count {
        if trainer.step(&mut |event| events.push(timeless(event))).unwrap() != Outcome::Running {
            break;
        }
    }
    events
}

pub fn timeless(mut event: Event) -> Event {
    if let Event::Step { seconds, rays_per_second, .. } = &mut event {
        (*seconds, *rays_per_second) = (0.0, 0.0);
    }
    event
}

/// Takes up to `count` steps and returns the losses of each by name, and the objective.
pub fn losses(trainer: &mut Trainer, count: usize) -> Vec<(BTreeMap<String, f32>, f32)> {
    let losses = |event| match event {
        Event::Step { losses, loss, .. } => (losses, loss),
        other => panic!("{other:?}"),
    };
    steps(trainer, count).into_iter().map(losses).collect()
}
