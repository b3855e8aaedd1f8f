//! Inception's features against PyTorch: a narrow network with weights by rule (`inception.json`, made by `inception.py`).

use crate::common::{devices, picture, write_weights};
use approx::assert_abs_diff_eq;
use burn::tensor::Device;
use infonerf_metrics::{INCEPTION_NETWORK, Networks, Pair, Picture, Protocol, evaluate};
use infonerf_pretrained::{Inception, InceptionConfig};
use serde_json::Value;

fn inception(config: InceptionConfig, device: &Device) -> Inception {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("inception");
    write_weights(&path, &config.tensors());
    Inception::read(&path, config, device).unwrap()
}

#[test]
fn features_agree_with_pytorch_on_every_device() {
    let cases: Vec<Value> = serde_json::from_str(include_str!("inception.json")).unwrap();
    assert_eq!(cases.len(), 2);
    for device in devices() {
        let inception = inception(InceptionConfig::NARROW, &device);
        for case in &cases {
            let number = |key: &str| case[key].as_u64().unwrap() as usize;
            let picture = picture(number("picture"), number("height"), number("width"));
            let expected = case["pytorch_fid"].as_array().unwrap();
            let found = &inception.features(&[&picture])[0];
            assert_eq!(found.len(), expected.len());
            // The largest feature is 0.7.
            for (found, expected) in found.iter().zip(expected) {
                assert_abs_diff_eq!(f64::from(*found), expected.as_f64().unwrap(), epsilon = 2e-6);
            }
        }
    }
}

#[test]
fn sets_of_views_have_a_fid_and_a_kid() {
    let inception = inception(InceptionConfig::NARROW, &Device::flex());
    let features = move |pictures: &[&Picture]| inception.features(pictures);
    let mut networks = Networks::none();
    networks.extractors.insert(INCEPTION_NETWORK, Box::new(features));
    let truths = [0, 1, 2].map(|index| picture(index, 60, 50));
    let renders = [3, 4, 5].map(|index| picture(index, 60, 50));
    let measured = |count: usize, renders: &[Picture]| {
        let pairs: Vec<Pair<'_>> = renders.iter().zip(&truths).map(|(x, y)| Pair::new(x, y)).take(count).collect();
        evaluate(&pairs, &networks, &Protocol::default()).unwrap()
    };
    let (near, far) = (measured(3, &truths).set, measured(3, &renders).set);
    assert_abs_diff_eq!(near["fid"].unwrap(), 0.0, epsilon = 1e-6);
    assert!(far["fid"].unwrap() > 1e-4 && far["kid"] > near["kid"], "{far:?} against {near:?}");
    let one = measured(1, &renders);
    assert_eq!((one.set["fid"], one.set["kid"]), (None, None));
    assert!(one.notes.iter().any(|note| note.to_string() == "fid, kid: needs at least 2 images, got 1"));
}

#[test]
fn batches_and_single_images_agree() {
    let inception = inception(InceptionConfig::NARROW, &Device::flex());
    let [x, y] = [0, 1].map(|index| picture(index, 20 + index, 30));
    assert_eq!(inception.features(&[&x, &y]), [&x, &y].map(|picture| inception.features(&[picture]).remove(0)));
}
