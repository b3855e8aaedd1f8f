use crate::file::TensorShape;
use crate::layers::Window;

/// Layers of the backbone of LPIPS.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LpipsConfig {
    pub(super) layers: Vec<LpipsLayer>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LpipsLayer {
    /// Convolution and rectifier.
    Convolution(ConvolutionShape),
    /// Max pooling.
    Pool(Window),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ConvolutionShape {
    pub(super) window: Window,
    /// Inputs and outputs.
    pub(super) channels: [usize; 2],
    /// Index among the layers of torchvision's `features`, which counts rectifiers.
    index: usize,
    /// Index among the heads, if images are compared after it.
    head: Option<usize>,
}

impl LpipsConfig {
    /// Returns AlexNet (Krizhevsky 2014), compared after each of its five convolutions.
    #[must_use]
    pub fn alex() -> Self {
        Self::default()
            .convolution(Window::square(11, 4, 2), 64, true)
            .pool(Window::square(3, 2, 0))
            .convolution(Window::square(5, 1, 2), 192, true)
            .pool(Window::square(3, 2, 0))
            .convolution(Window::square(3, 1, 1), 384, true)
            .convolution(Window::square(3, 1, 1), 256, true)
            .convolution(Window::square(3, 1, 1), 256, true)
    }

    /// Returns VGG-16 (Simonyan and Zisserman 2015), compared after the last convolution at each size.
    #[must_use]
    pub fn vgg() -> Self {
        let mut config = Self::default();
        for (channels, count) in [(64, 2), (128, 2), (256, 3), (512, 3), (512, 3)] {
            if !config.layers.is_empty() {
                config = config.pool(Window::square(2, 2, 0));
            }
            for index in 1..=count {
                config = config.convolution(Window::square(3, 1, 1), channels, index == count);
            }
        }
        config
    }

    fn convolution(mut self, window: Window, outputs: usize, is_compared: bool) -> Self {
        let torchvision_layers = |layer: &LpipsLayer| if matches!(layer, LpipsLayer::Pool(_)) { 1 } else { 2 };
        let index = self.layers.iter().map(torchvision_layers).sum();
        let inputs = self.convolutions().last().map_or(3, |before| before.channels[1]);
        let heads = self.convolutions().filter(|before| before.head.is_some()).count();
        let shape = ConvolutionShape { window, channels: [inputs, outputs], index, head: is_compared.then_some(heads) };
        self.layers.push(LpipsLayer::Convolution(shape));
        self
    }

    fn pool(mut self, window: Window) -> Self {
        self.layers.push(LpipsLayer::Pool(window));
        self
    }

    /// Divides all numbers of channels but the image's by `divisor`, for tests.
    #[must_use]
    pub fn narrowed(mut self, divisor: usize) -> Self {
        for layer in &mut self.layers {
            if let LpipsLayer::Convolution(ConvolutionShape { channels, .. }) = layer {
                *channels = channels.map(|count| if count == 3 { count } else { count / divisor });
            }
        }
        self
    }

    /// Returns names and shapes of the backbone's tensors, as in torchvision.
    pub fn backbone_tensors(&self) -> Vec<TensorShape> {
        self.convolutions().flat_map(ConvolutionShape::tensors).collect()
    }

    /// Returns names and shapes of the heads' tensors, as in the `lpips` package.
    pub fn head_tensors(&self) -> Vec<TensorShape> {
        self.convolutions().filter_map(ConvolutionShape::head_tensor).collect()
    }

    fn convolutions(&self) -> impl Iterator<Item = &ConvolutionShape> {
        self.layers.iter().filter_map(|layer| match layer {
            LpipsLayer::Convolution(convolution) => Some(convolution),
            LpipsLayer::Pool(_) => None,
        })
    }

    /// Returns whether images of `size` = (height, width) are large enough for every window.
    pub(super) fn fits(&self, size: [usize; 2]) -> bool {
        let output = |size: [usize; 2], layer: &LpipsLayer| match layer {
            LpipsLayer::Convolution(ConvolutionShape { window, .. }) | LpipsLayer::Pool(window) => window.output(size),
        };
        self.layers.iter().try_fold(size, output).is_some()
    }
}

impl ConvolutionShape {
    /// Returns names and shapes of weight and bias.
    pub(super) fn tensors(&self) -> [TensorShape; 2] {
        let ([inputs, outputs], [height, width]) = (self.channels, self.window.kernel);
        let name = |part: &str| format!("features.{}.{part}", self.index);
        [(name("weight"), vec![outputs, inputs, height, width]), (name("bias"), vec![outputs])]
    }

    /// Returns name and shape of the head after it, if any.
    pub(super) fn head_tensor(&self) -> Option<TensorShape> {
        self.head.map(|head| (format!("lin{head}.model.1.weight"), vec![1, self.channels[1], 1, 1]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layer_indices_agree_with_torchvision() {
        let indices = |config: LpipsConfig| config.convolutions().map(|shape| shape.index).collect::<Vec<_>>();
        assert_eq!(indices(LpipsConfig::alex()), [0, 3, 6, 8, 10]);
        assert_eq!(indices(LpipsConfig::vgg()), [0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24, 26, 28]);
        let heads: Vec<usize> = LpipsConfig::vgg().head_tensors().iter().map(|(_, shape)| shape[1]).collect();
        assert_eq!(heads, [64, 128, 256, 512, 512]);
    }

    #[test]
    fn fits_from_the_smallest_possible_side() {
        let smallest = |config: LpipsConfig| (1..100).find(|side| config.fits([*side, *side])).unwrap();
        assert_eq!((smallest(LpipsConfig::alex()), smallest(LpipsConfig::vgg())), (31, 16));
    }
}
