//! Traffic between host and device in a step. The test is a program of its own, as counts are of the whole process.

mod common;

use burn::tensor::Device;
use common::{config, steps, trainer};

/// Counts the traffic of a coarse and a fine pass of NeRF with L_RGB alone.
#[test]
fn step_moves_each_sample_and_pixel_once() {
    let settings = ["loss.entropy.weight=0", "loss.kl.weight=0", "render.occupancy.enabled=false"];
    let mut trainer = trainer(&config(&settings), 1, &Device::flex());
    for step in 0..3 {
        let (before, evaluated) = (trainer.profile().traffic(), trainer.progress().samples_evaluated);
        assert_eq!(steps(&mut trainer, 1).len(), 1);
        let traffic = trainer.profile().traffic() - before;
        let samples = trainer.progress().samples_evaluated - evaluated;
        // Once origins, directions and radii of the rays, near and far, and the pixels' colours; for each pass the rays' random
        // streams, the background, and of each sample its place, distance, length and position.
        assert_eq!(traffic.uploads, 5 + 2 * (1 + 1 + 4), "step {step}");
        let of_rays = (3 + 3 + 1 + 2 + 3 + 2 * 3) * 24;
        assert_eq!(traffic.uploaded_bytes, 4 * ((1 + 1 + 1 + 3) * samples + of_rays + 2 * 3), "step {step}");
        // A host body reads what it is given: ends and streams to place coarse samples; streams, optical depths and places to draw
        // fine ones; ends, places and distances of each pass. Losses are read at the end.
        assert_eq!((traffic.reads, traffic.launches), (2 + 3 + 2 * 3 + 1, 0), "step {step}");
    }
    let before = trainer.profile().traffic();
    trainer.read_every(4);
    assert_eq!(steps(&mut trainer, 9).len(), 9, "the ninth is the last");
    assert_eq!((trainer.profile().traffic() - before).reads, 9 * 11 + 3);
}
