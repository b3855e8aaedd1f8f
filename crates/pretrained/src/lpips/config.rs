use crate::file::TensorShape;
use crate::layers::Window;

/// Layers of the backbone of LPIPS.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LpipsConfig {
    pub(super) layers: Vec<LpipsLayer>,
    /// Number of first layers that images pass in bands of rows: convolutions that keep the size, and a pooling without overlap.
    pub(super) in_bands: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LpipsLayer {
    Convolution(ConvolutionShape),
    Pool(Window),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ConvolutionShape {
    pub(super) window: Window,
    pub(super) channels: [usize; 2],
    /// Index among the layers of torchvision's `features`, which counts rectifiers.
    index: usize,
    /// Index among the heads, if images are compared after this convolution.
    head: Option<usize>,
}

impl LpipsConfig {
    /// Returns AlexNet (Krizhevsky 2014), compared after each of its five convolutions.
    pub fn alex() -> Self {
        let convolution = |kernel, stride, pad, outputs| Some((Window::square(kernel, stride, pad), outputs, true));
        let first = [convolution(11, 4, 2, 64), None, convolution(5, 1, 2, 192), None];
        let last = [384, 256, 256].map(|outputs| convolution(3, 1, 1, outputs));
        Self::new(0, Window::square(3, 2, 0), first.into_iter().chain(last))
    }

    /// Returns VGG-16 (Simonyan and Zisserman 2015), compared after the last convolution at each size.
    pub fn vgg() -> Self {
        let blocks = [(64, 2), (128, 2), (256, 3), (512, 3), (512, 3)].into_iter().enumerate();
        let layers = blocks.flat_map(|(block, (outputs, count))| {
            let convolution = move |index| Some((Window::square(3, 1, 1), outputs, index == count));
            (block > 0).then_some(None).into_iter().chain((1..=count).map(convolution))
        });
        Self::new(3, Window::square(2, 2, 0), layers)
    }

    /// Numbers the layers: convolutions (window, number of outputs, whether images are compared after it), or `None` for `pool`.
    fn new(in_bands: usize, pool: Window, layers: impl Iterator<Item = Option<(Window, usize, bool)>>) -> Self {
        let (mut inputs, mut index, mut heads) = (3, 0, 0);
        let number = |layer: Option<(Window, usize, bool)>| match layer {
            None => {
                index += 1;
                LpipsLayer::Pool(pool)
            }
            Some((window, outputs, is_compared)) => {
                let head = is_compared.then_some(heads);
                let shape = ConvolutionShape { window, channels: [inputs, outputs], index, head };
                (inputs, index, heads) = (outputs, index + 2, heads + usize::from(is_compared));
                LpipsLayer::Convolution(shape)
            }
        };
        Self { layers: layers.map(number).collect(), in_bands }
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

    pub(super) fn convolutions(&self) -> impl Iterator<Item = &ConvolutionShape> {
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
    pub(super) fn tensors(&self) -> [TensorShape; 2] {
        let ([inputs, outputs], [height, width]) = (self.channels, self.window.kernel);
        let name = |part: &str| format!("features.{}.{part}", self.index);
        [(name("weight"), vec![outputs, inputs, height, width]), (name("bias"), vec![outputs])]
    }

    /// Returns name and shape of the head after this convolution, if any.
    pub(super) fn head_tensor(&self) -> Option<TensorShape> {
        self.head.map(|head| (format!("lin{head}.model.1.weight"), vec![1, self.channels[1], 1, 1]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fits_from_the_smallest_possible_side() {
        let smallest = |config: LpipsConfig| (1..100).find(|side| config.fits([*side, *side])).unwrap();
        assert_eq!((smallest(LpipsConfig::alex()), smallest(LpipsConfig::vgg())), (31, 16));
    }
}
