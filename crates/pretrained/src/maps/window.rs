use std::ops::Range;

/// Which part of its input an output pixel sees. Sides are (height, width).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Window {
    pub(crate) kernel: [usize; 2],
    pub(crate) stride: usize,
    pub(crate) padding: [usize; 2],
}

impl Window {
    /// A square one.
    pub(crate) const fn square(kernel: usize, stride: usize, padding: usize) -> Self {
        Self { kernel: [kernel; 2], stride, padding: [padding; 2] }
    }

    /// Size of the output for an input of that size; none where no window fits.
    pub(crate) fn output(self, size: [usize; 2]) -> Option<[usize; 2]> {
        let side = |axis: usize| {
            let free = (size[axis] + 2 * self.padding[axis]).checked_sub(self.kernel[axis])?;
            Some(free / self.stride + 1)
        };
        Some([side(0)?, side(1)?])
    }

    /// Along one axis of `side` pixels: the input pixels that output `at` sees, and how many padded ones are before them.
    pub(crate) fn seen(self, axis: usize, at: usize, side: usize) -> (Range<usize>, usize) {
        let start = at * self.stride;
        let before = self.padding[axis].saturating_sub(start);
        let first = (start + before - self.padding[axis]).min(side);
        let end = (start + self.kernel[axis]).saturating_sub(self.padding[axis]).min(side);
        (first..end.max(first), before)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_those_of_pytorch() {
        assert_eq!(Window::square(11, 4, 2).output([400, 64]), Some([99, 15]));
        assert_eq!(Window::square(3, 2, 0).output([3, 8]), Some([1, 3]));
        assert_eq!(Window { kernel: [1, 7], stride: 1, padding: [0, 3] }.output([17, 17]), Some([17, 17]));
        assert_eq!(Window::square(3, 2, 0).output([2, 8]), None);
    }

    #[test]
    fn windows_end_at_the_border() {
        let window = Window::square(3, 1, 1);
        assert_eq!(window.seen(0, 0, 5), (0..2, 1));
        assert_eq!(window.seen(0, 2, 5), (1..4, 0));
        assert_eq!(window.seen(0, 4, 5), (3..5, 0));
        let wide = Window::square(5, 1, 2);
        assert_eq!((wide.seen(1, 0, 1), wide.seen(1, 0, 2)), ((0..1, 2), (0..2, 2)));
        assert_eq!(Window::square(11, 4, 2).seen(0, 1, 400), (2..13, 0));
    }
}
