//! The command line on a GPU, or on what plays one.
#![cfg(feature = "wgpu")]

mod common;

use common::{infonerf, text};

#[test]
fn an_experiment_on_wgpu_ends_with_a_report() {
}
