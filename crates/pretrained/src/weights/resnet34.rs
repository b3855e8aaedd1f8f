use crate::file::{TensorShape, normalisation};

/// Returns names and shapes of torchvision's `resnet34` without its classifier: convolutions and batch normalisations.
pub(super) fn tensors() -> Vec<TensorShape> {
    let mut tensors = layer("conv1", "bn1", [3, 64], 7);
    let mut inputs = 64;
    for (stage, (outputs, blocks)) in [(64, 3), (128, 4), (256, 6), (512, 3)].into_iter().enumerate() {
        for block in 0..blocks {
            let part = |part: &str| format!("layer{}.{block}.{part}", stage + 1);
            tensors.extend(layer(&part("conv1"), &part("bn1"), [inputs, outputs], 3));
            tensors.extend(layer(&part("conv2"), &part("bn2"), [outputs, outputs], 3));
            if inputs != outputs {
                tensors.extend(layer(&part("downsample.0"), &part("downsample.1"), [inputs, outputs], 1));
            }
            inputs = outputs;
        }
    }
    tensors
}

fn layer(convolution: &str, normalised: &str, [inputs, outputs]: [usize; 2], kernel: usize) -> Vec<TensorShape> {
    let weight = (format!("{convolution}.weight"), vec![outputs, inputs, kernel, kernel]);
    [weight].into_iter().chain(normalisation(normalised, outputs)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn resnet34_has_the_published_number_of_parameters() {
        let learned = tensors().into_iter().filter(|(name, _)| !name.contains("running"));
        // torchvision's has 21,797,672, of which 512 × 1000 + 1000 classify.
        assert_eq!(learned.map(|(_, shape)| shape.iter().product::<usize>()).sum::<usize>(), 21_797_672 - 513_000);
    }
}
