//! Traffic between host and device in a step. A file of its own: the counts are of the whole process.

mod common;

use burn::tensor::Device;
use common::{config, steps, trainer};

/// A coarse and a fine pass of NeRF with L_RGB alone.
#[test]
fn a_step_uploads_its_samples_and_pixels_and_reads_twice() {
    let settings = ["loss.entropy.weight=0", "loss.kl.weight=0", "render.occupancy.enabled=false"];
    let mut trainer = trainer(&config(&settings), 1, &Device::flex());
    for step in 0..3 {
        let (before, evaluated) = (trainer.profile().traffic(), trainer.progress().samples_evaluated);
        assert_eq!(steps(&mut trainer, 1).len(), 1);
        let traffic = trainer.profile().traffic() - before;
        let samples = trainer.progress().samples_evaluated - evaluated;
        // Of each pass the positions, lengths and distances of its samples, the directions and radii of its rays (which a GPU is
        // given at once), and the background; the pixels' colours.
        assert_eq!(traffic.uploads, 2 * 6 + 1, "step {step}");
        let of_rays = 2 * (3 + 1) * 24 + 3 * 24;
        assert_eq!(traffic.uploaded_bytes, 4 * ((3 + 1 + 1) * samples + of_rays + 2 * 3), "step {step}");
        // The coarse pass's optical depths, and the step's numbers.
        assert_eq!((traffic.reads, traffic.launches), (2, 0), "step {step}");
    }
    let before = trainer.profile().traffic();
    trainer.read_every(4);
    assert_eq!(steps(&mut trainer, 9).len(), 9, "the ninth is the last");
    assert_eq!((trainer.profile().traffic() - before).reads, 9 + 3);
}
