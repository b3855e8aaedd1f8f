use crate::TensorShape;
use crate::maps::Window;

/// A convolution of Inception with its batch normalisation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Unit {
    /// As pytorch-fid has it, such as `Mixed_5b.branch1x1`.
    pub(super) name: String,
    /// Inputs and outputs.
    pub(super) channels: [usize; 2],
    pub(super) window: Window,
}

impl Unit {
    /// Name and shape of the convolution's weight.
    pub(super) fn weight(&self) -> TensorShape {
        let ([inputs, outputs], [height, width]) = (self.channels, self.window.kernel);
        (format!("{}.conv.weight", self.name), vec![outputs, inputs, height, width])
    }

    /// Name and shape of γ, β, mean and variance of the normalisation.
    pub(super) fn normalisation(&self) -> [TensorShape; 4] {
        let part = |part: &str| (format!("{}.bn.{part}", self.name), vec![self.channels[1]]);
        ["weight", "bias", "running_mean", "running_var"].map(part)
    }
}

/// Every unit of Inception v3 as pytorch-fid has it, with channels divided by `divisor`.
pub(super) fn units(divisor: usize) -> Vec<Unit> {
    let mut list = List { units: Vec::new(), block: "", divisor };
    list.add("Conv2d_1a_3x3", [3, 32], Window::square(3, 2, 0));
    list.add("Conv2d_2a_3x3", [32, 32], Window::square(3, 1, 0));
    list.add("Conv2d_2b_3x3", [32, 64], Window::square(3, 1, 1));
    list.add("Conv2d_3b_1x1", [64, 80], POINT);
    list.add("Conv2d_4a_3x3", [80, 192], Window::square(3, 1, 0));
    list.block_a("Mixed_5b", 192, 32);
    list.block_a("Mixed_5c", 256, 64);
    list.block_a("Mixed_5d", 288, 64);
    list.block_b("Mixed_6a", 288);
    list.block_c("Mixed_6b", 128);
    list.block_c("Mixed_6c", 160);
    list.block_c("Mixed_6d", 160);
    list.block_c("Mixed_6e", 192);
    list.block_d("Mixed_7a");
    list.block_e("Mixed_7b", 1280);
    list.block_e("Mixed_7c", 2048);
    list.units
}

const POINT: Window = Window::square(1, 1, 0);
const SQUARE: Window = Window::square(3, 1, 1);
const HALVING: Window = Window::square(3, 2, 0);

/// A row of `width` pixels.
const fn row(width: usize) -> Window {
    Window { kernel: [1, width], stride: 1, padding: [0, width / 2] }
}

/// A column of `height` pixels.
const fn column(height: usize) -> Window {
    Window { kernel: [height, 1], stride: 1, padding: [height / 2, 0] }
}

struct List {
    units: Vec<Unit>,
    block: &'static str,
    divisor: usize,
}

impl List {
    fn add(&mut self, name: &str, [inputs, outputs]: [usize; 2], window: Window) {
        let name = if self.block.is_empty() { name.to_owned() } else { format!("{}.{name}", self.block) };
        // A picture has three channels at any width.
        let inputs = if inputs == 3 { 3 } else { inputs / self.divisor };
        self.units.push(Unit { name, channels: [inputs, outputs / self.divisor], window });
    }

    fn block_a(&mut self, block: &'static str, inputs: usize, pool: usize) {
        self.block = block;
        self.add("branch1x1", [inputs, 64], POINT);
        self.add("branch5x5_1", [inputs, 48], POINT);
        self.add("branch5x5_2", [48, 64], Window::square(5, 1, 2));
        self.add("branch3x3dbl_1", [inputs, 64], POINT);
        self.add("branch3x3dbl_2", [64, 96], SQUARE);
        self.add("branch3x3dbl_3", [96, 96], SQUARE);
        self.add("branch_pool", [inputs, pool], POINT);
    }

    fn block_b(&mut self, block: &'static str, inputs: usize) {
        self.block = block;
        self.add("branch3x3", [inputs, 384], HALVING);
        self.add("branch3x3dbl_1", [inputs, 64], POINT);
        self.add("branch3x3dbl_2", [64, 96], SQUARE);
        self.add("branch3x3dbl_3", [96, 96], HALVING);
    }

    fn block_c(&mut self, block: &'static str, inner: usize) {
        self.block = block;
        self.add("branch1x1", [768, 192], POINT);
        self.add("branch7x7_1", [768, inner], POINT);
        self.add("branch7x7_2", [inner, inner], row(7));
        self.add("branch7x7_3", [inner, 192], column(7));
        self.add("branch7x7dbl_1", [768, inner], POINT);
        self.add("branch7x7dbl_2", [inner, inner], column(7));
        self.add("branch7x7dbl_3", [inner, inner], row(7));
        self.add("branch7x7dbl_4", [inner, inner], column(7));
        self.add("branch7x7dbl_5", [inner, 192], row(7));
        self.add("branch_pool", [768, 192], POINT);
    }

    fn block_d(&mut self, block: &'static str) {
        self.block = block;
        self.add("branch3x3_1", [768, 192], POINT);
        self.add("branch3x3_2", [192, 320], HALVING);
        self.add("branch7x7x3_1", [768, 192], POINT);
        self.add("branch7x7x3_2", [192, 192], row(7));
        self.add("branch7x7x3_3", [192, 192], column(7));
        self.add("branch7x7x3_4", [192, 192], HALVING);
    }

    fn block_e(&mut self, block: &'static str, inputs: usize) {
        self.block = block;
        self.add("branch1x1", [inputs, 320], POINT);
        self.add("branch3x3_1", [inputs, 384], POINT);
        self.add("branch3x3_2a", [384, 384], row(3));
        self.add("branch3x3_2b", [384, 384], column(3));
        self.add("branch3x3dbl_1", [inputs, 448], POINT);
        self.add("branch3x3dbl_2", [448, 384], SQUARE);
        self.add("branch3x3dbl_3a", [384, 384], row(3));
        self.add("branch3x3dbl_3b", [384, 384], column(3));
        self.add("branch_pool", [inputs, 192], POINT);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_has_the_published_number_of_parameters() {
        let units = units(1);
        assert_eq!(units.len(), 94);
        let weights: usize = units.iter().map(|unit| unit.weight().1.iter().product::<usize>()).sum();
        let normalisation: usize = units.iter().map(|unit| 2 * unit.channels[1]).sum();
        // torchvision's Inception v3 has 23,834,568 without its auxiliary head; 2,049,000 of them classify 1000 classes.
        assert_eq!(weights + normalisation, 23_834_568 - 2_049_000);
    }

    #[test]
    fn every_width_is_divided() {
        for (full, narrow) in units(1).iter().zip(units(16)) {
            assert_eq!(full.channels[1], 16 * narrow.channels[1], "{}", full.name);
        }
    }
}
