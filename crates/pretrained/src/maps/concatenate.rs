use burn::tensor::Tensor;

use super::{HostMaps, Maps};

/// All maps of each picture, of the parts in order.
///
/// # Panics
/// If there are no parts, or they are on different devices or of different sizes.
pub(crate) fn concatenate<const N: usize>(parts: [Maps; N]) -> Maps {
    let (mut host, mut device) = (Vec::new(), Vec::new());
    for part in parts {
        match part {
            Maps::Host(maps) => host.push(maps),
            Maps::Device(maps) => device.push(maps),
        }
    }
    assert!(host.is_empty() != device.is_empty(), "all parts are on the same device");
    if host.is_empty() {
        return Maps::Device(Tensor::cat(device, 1));
    }
    let [n, height, width, _] = host[0].shape;
    assert!(host.iter().all(|part| part.shape[..3] == [n, height, width]), "parts are of the same size");
    let channels: usize = host.iter().map(HostMaps::channels).sum();
    let mut values = Vec::with_capacity(n * height * width * channels);
    for pixel in 0..n * height * width {
        for part in &host {
            values.extend_from_slice(&part.values()[pixel * part.channels()..][..part.channels()]);
        }
    }
    Maps::Host(HostMaps::new(values, [n, height, width, channels]))
}
