use crate::TensorShape;
use crate::maps::Window;

/// Layers of LPIPS's backbone.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LpipsConfig {
    layers: Vec<Layer>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Layer {
    /// A convolution and a rectifier. Pictures are compared behind it if it `is_compared`.
    Convolution { window: Window, channels: usize, is_compared: bool },
    /// Max pooling.
    Pool(Window),
}

/// A layer with what follows from those before it.
pub(super) enum Placed {
    Convolution(PlacedConvolution),
    Pool(Window),
}

pub(super) struct PlacedConvolution {
    pub(super) window: Window,
    /// Inputs and outputs.
    pub(super) channels: [usize; 2],
    /// Number among the layers of torchvision's `features`, which counts rectifiers.
    place: usize,
    /// Number among the heads, if pictures are compared behind it.
    head: Option<usize>,
}

impl LpipsConfig {
    /// AlexNet (Krizhevsky 2014), compared behind each of its five convolutions.
    #[must_use]
    pub fn alex() -> Self {
        let convolution = |kernel, stride, padding, channels| {
            let window = Window::square(kernel, stride, padding);
            Layer::Convolution { window, channels, is_compared: true }
        };
        let pool = Layer::Pool(Window::square(3, 2, 0));
        let layers = vec![
            convolution(11, 4, 2, 64),
            pool,
            convolution(5, 1, 2, 192),
            pool,
            convolution(3, 1, 1, 384),
            convolution(3, 1, 1, 256),
            convolution(3, 1, 1, 256),
        ];
        Self { layers }
    }

    /// VGG-16 (Simonyan and Zisserman 2015), compared behind the last convolution at each size.
    #[must_use]
    pub fn vgg() -> Self {
        let mut layers = Vec::new();
        for (channels, count) in [(64, 2), (128, 2), (256, 3), (512, 3), (512, 3)] {
            if !layers.is_empty() {
                layers.push(Layer::Pool(Window::square(2, 2, 0)));
            }
            let window = Window::square(3, 1, 1);
            let convolution = |index| Layer::Convolution { window, channels, is_compared: index + 1 == count };
            layers.extend((0..count).map(convolution));
        }
        Self { layers }
    }

    /// The same with a fraction of the channels, for tests.
    ///
    /// # Panics
    /// If a number of channels cannot be divided by `divisor`.
    #[must_use]
    pub fn narrowed(mut self, divisor: usize) -> Self {
        for layer in &mut self.layers {
            if let Layer::Convolution { channels, .. } = layer {
                assert!(channels.is_multiple_of(divisor), "{channels} channels by {divisor}");
                *channels /= divisor;
            }
        }
        self
    }

    /// Names and shapes of the backbone's tensors, as torchvision has them.
    pub fn backbone_tensors(&self) -> Vec<TensorShape> {
        self.convolutions().flat_map(|convolution| convolution.tensors()).collect()
    }

    /// Names and shapes of the heads' tensors, as the `lpips` package has them.
    pub fn head_tensors(&self) -> Vec<TensorShape> {
        self.convolutions().filter_map(|convolution| convolution.head_tensor()).collect()
    }

    /// Every layer in its place.
    pub(super) fn placed(&self) -> impl Iterator<Item = Placed> {
        let (mut place, mut inputs, mut heads) = (0, 3, 0..);
        self.layers.iter().map(move |layer| match *layer {
            Layer::Pool(window) => {
                place += 1;
                Placed::Pool(window)
            }
            Layer::Convolution { window, channels, is_compared } => {
                let head = if is_compared { heads.next() } else { None };
                let placed = PlacedConvolution { window, channels: [inputs, channels], place, head };
                (place, inputs) = (place + 2, channels);
                Placed::Convolution(placed)
            }
        })
    }

    fn convolutions(&self) -> impl Iterator<Item = PlacedConvolution> {
        self.placed().filter_map(|layer| match layer {
            Placed::Convolution(convolution) => Some(convolution),
            Placed::Pool(_) => None,
        })
    }

    /// Whether it can look at pictures of `size` = (height, width).
    pub(super) fn fits(&self, size: [usize; 2]) -> bool {
        let output = |size: [usize; 2], layer: &Layer| match layer {
            Layer::Convolution { window, .. } | Layer::Pool(window) => window.output(size),
        };
        self.layers.iter().try_fold(size, output).is_some()
    }
}

impl PlacedConvolution {
    /// Names and shapes of weight and bias.
    pub(super) fn tensors(&self) -> [TensorShape; 2] {
        let ([inputs, outputs], [height, width]) = (self.channels, self.window.kernel);
        let name = |part: &str| format!("features.{}.{part}", self.place);
        [(name("weight"), vec![outputs, inputs, height, width]), (name("bias"), vec![outputs])]
    }

    /// Name and shape of the head behind it.
    pub(super) fn head_tensor(&self) -> Option<TensorShape> {
        self.head.map(|head| (format!("lin{head}.model.1.weight"), vec![1, self.channels[1], 1, 1]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_are_counted_as_torchvision_does() {
        let places = |config: LpipsConfig| config.convolutions().map(|placed| placed.place).collect::<Vec<_>>();
        assert_eq!(places(LpipsConfig::alex()), [0, 3, 6, 8, 10]);
        assert_eq!(places(LpipsConfig::vgg()), [0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24, 26, 28]);
        let heads: Vec<usize> = LpipsConfig::vgg().head_tensors().iter().map(|(_, shape)| shape[1]).collect();
        assert_eq!(heads, [64, 128, 256, 512, 512]);
    }

    #[test]
    fn small_pictures_do_not_fit() {
        let smallest = |config: LpipsConfig| (1..100).find(|side| config.fits([*side, *side])).unwrap();
        assert_eq!((smallest(LpipsConfig::alex()), smallest(LpipsConfig::vgg())), (31, 16));
    }
}
