//! What passes between host and device in a step. A file of its own: the counts are of the whole process.

mod common;

use burn::tensor::Device;
use common::{config, steps, trainer};
use infonerf_ops::Traffic;

/// A coarse and a fine pass of NeRF with L_RGB alone.
#[test]
fn a_step_uploads_and_reads_what_it_needs_and_no_more() {
    let settings = ["loss.entropy.weight=0", "loss.kl.weight=0", "render.occupancy.enabled=false"];
    let mut trainer = trainer(&config(&settings), 1, &Device::flex());
    let mut step = || {
        let before = trainer.profile().traffic();
        assert_eq!(steps(&mut trainer, 1).len(), 1);
        trainer.profile().traffic() - before
    };
    let first = step();
    let (rays, coarse, fine) = (24, 24 * 10, 24 * 16);
    // Of a pass the positions, lengths and distances of its samples and the background; the colours of the pixels.
    let samples = [coarse, fine].map(|samples| (3 + 1 + 1) * samples + 3).iter().sum::<u64>();
    let uploads = Traffic { uploads: 2 * 4 + 1, uploaded_bytes: 4 * (samples + 3 * rays), ..Traffic::default() };
    // The coarse pass's optical depths, and the numbers of the step: total, squared error, opacity, and the one loss.
    assert_eq!(first, Traffic { reads: 2, read_bytes: 4 * (coarse + 4), ..uploads });
    assert_eq!([step(), step()], [first; 2]);
}
