//! LPIPS against PyTorch: narrow backbones with weights by rule (`lpips.json`, made by `lpips.py`), and the published
//! weights on the images whose distances the authors publish.

use std::path::{Path, PathBuf};

use crate::common::{devices, picture, write_weights};
use approx::assert_relative_eq;
use burn::tensor::Device;
use infonerf_metrics::Picture;
use infonerf_metrics::protocol::LpipsInput;
use infonerf_pretrained::{Lpips, LpipsConfig};
use serde_json::Value;

fn files(folder: &Path, config: &LpipsConfig) -> [PathBuf; 2] {
    let files = ["backbone", "heads"].map(|name| folder.join(name));
    write_weights(&files[0], &config.backbone_tensors());
    write_weights(&files[1], &config.head_tensors());
    files
}

fn narrow(config: LpipsConfig, device: &Device) -> Lpips {
    let folder = tempfile::tempdir().unwrap();
    let config = config.narrowed(8);
    let [backbone, heads] = files(folder.path(), &config);
    Lpips::read(&backbone, &heads, config, device).unwrap()
}

#[test]
fn agrees_with_pytorch_on_every_device() {
    let cases: Vec<Value> = serde_json::from_str(include_str!("lpips.json")).unwrap();
    assert_eq!(cases.len(), 3);
    let same = picture(0, 40, 40);
    for device in devices().into_iter().chain([Device::flex().autodiff()]) {
        assert_eq!(narrow(LpipsConfig::alex(), &device).distance(&same, &same, LpipsInput::Signed), Ok(0.0));
        for (name, config) in [("alex", LpipsConfig::alex()), ("vgg", LpipsConfig::vgg())] {
            let lpips = narrow(config, &device);
            for case in &cases {
                let side = |key: &str| case[key].as_u64().unwrap() as usize;
                let [x, y] = [0, 1].map(|index| picture(index, side("height"), side("width")));
                for (suffix, input) in [("", LpipsInput::Signed), ("_unsigned", LpipsInput::Unsigned)] {
                    let found = lpips.distance(&x, &y, input).unwrap();
                    assert_relative_eq!(found, case[format!("{name}{suffix}")].as_f64().unwrap(), max_relative = 1e-5);
                }
            }
        }
    }
}

#[test]
fn unsuitable_sizes_are_refused() {
    let lpips = narrow(LpipsConfig::alex(), &Device::flex());
    let (small, tall, wide) = (picture(0, 30, 64), picture(0, 64, 40), picture(0, 40, 64));
    let error = |a, b| lpips.distance(a, b, LpipsInput::Signed).unwrap_err();
    assert_eq!(error(&small, &small), "64×30 pixels are too few for its convolutions");
    assert_eq!(error(&tall, &wide), "images of [40, 64] and [64, 40] pixels cannot be compared");
}

#[test]
fn lpips_errors_name_file_tensor_and_shape() {
    let folder = tempfile::tempdir().unwrap();
    let config = LpipsConfig::alex().narrowed(8);
    let [backbone, heads] = files(folder.path(), &config);
    let fault = |backbone: &Path, heads: &Path, config: LpipsConfig| {
        Lpips::read(backbone, heads, config, &Device::flex()).map(|_| ()).unwrap_err()
    };
    let expected = format!("{}: no tensor `features.0.weight`, expected F32 [8, 3, 11, 11]", heads.display());
    assert_eq!(fault(&heads, &heads, config.clone()), expected);
    let expected = format!("{}: no tensor `lin0.model.1.weight`, expected F32 [1, 8, 1, 1]", backbone.display());
    assert_eq!(fault(&backbone, &backbone, config.clone()), expected);
    let expected =
        format!("{}: `features.0.weight` is F32 [8, 3, 11, 11], not F32 [64, 3, 11, 11]", backbone.display());
    assert_eq!(fault(&backbone, &heads, LpipsConfig::alex()), expected);
    let absent = folder.path().join("absent");
    assert!(fault(&absent, &heads, config).starts_with(&format!("{}: No such file", absent.display())));
}

#[test]
#[ignore = "needs the published weights in INFONERF_DATA"]
fn published_distances_are_reproduced() {
    let data = PathBuf::from(std::env::var("INFONERF_DATA").expect("INFONERF_DATA is set"));
    let (backbones, heads) = (data.join("lpips_backbones_v0.1"), data.join("lpips_heads_v0.1"));
    let [reference, first, second] = ["ex_ref.png", "ex_p0.png", "ex_p1.png"]
        .map(|name| Picture::from_rgb8(&image::open(backbones.join(name)).unwrap().to_rgb8()).unwrap());
    for (backbone, heads, config, expected) in [
        ("alexnet_features.pth", heads.join("alex.pth"), LpipsConfig::alex(), [0.72188, 0.13757]),
        ("vgg16_features.pth", heads.join("vgg.pth"), LpipsConfig::vgg(), [0.56861, 0.42166]),
    ] {
        let lpips = Lpips::read(&backbones.join(backbone), &heads, config, &Device::flex()).unwrap();
        for (picture, expected) in [&first, &second].into_iter().zip(expected) {
            let found = lpips.distance(&reference, picture, LpipsInput::Signed).unwrap();
            approx::assert_abs_diff_eq!(found, expected, epsilon = 1e-5);
        }
    }
}
