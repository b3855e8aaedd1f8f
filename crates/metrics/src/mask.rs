use std::ops::Range;

use crate::error::MetricError;
use crate::picture::{Picture, check_length};

/// Pixels of an image that count.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mask {
    inside: Vec<bool>,
    size: [usize; 2],
}

impl Mask {
    /// Wraps row-major `inside`.
    ///
    /// # Errors
    /// If there are not `width × height` values.
    pub fn new(inside: Vec<bool>, width: usize, height: usize) -> Result<Self, MetricError> {
        check_length("mask", inside.len(), [width, height])?;
        Ok(Self { inside, size: [width, height] })
    }

    /// Returns whether each pixel is inside, row-major.
    pub fn inside(&self) -> &[bool] {
        &self.inside
    }

    /// Returns whether no pixel is inside: a view with such a mask has no masked metrics.
    pub fn is_empty(&self) -> bool {
        !self.inside.contains(&true)
    }

    /// Returns width and height in pixels.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    pub(crate) fn check_inside(&self) -> Result<(), MetricError> {
        if self.is_empty() { Err(MetricError::other("the mask is empty: no pixel is inside")) } else { Ok(()) }
    }

    /// Returns columns and rows of the smallest rectangle that holds every pixel inside.
    pub(crate) fn bounding_rectangle(&self) -> [Range<usize>; 2] {
        let mut ends = [(usize::MAX, 0); 2];
        for index in (0..self.inside.len()).filter(|&index| self.inside[index]) {
            for ((low, high), at) in ends.iter_mut().zip([index % self.size[0], index / self.size[0]]) {
                (*low, *high) = ((*low).min(at), (*high).max(at + 1));
            }
        }
        ends.map(|(low, high)| low..high)
    }

    /// Replaces pixels outside the mask by `color`.
    pub(crate) fn composite(&self, picture: &Picture, color: [f32; 3]) -> Picture {
        assert_eq!(picture.size(), self.size, "a mask of the picture's size");
        picture.mapped(|index, pixel| if self.inside[index] { pixel } else { color })
    }

    pub(crate) fn and(&self, other: &Self) -> Self {
        Self { inside: self.inside.iter().zip(&other.inside).map(|(a, b)| *a && *b).collect(), size: self.size }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mask(rows: [&str; 3]) -> Result<Mask, MetricError> {
        let inside = rows.concat().chars().map(|c| c == '#').collect();
        Mask::new(inside, rows[0].len(), rows.len())
    }

    #[test]
    fn mask_has_a_value_per_pixel_and_a_smallest_rectangle() {
        assert_eq!(mask([".....", "..#..", ".#.#."]).unwrap().bounding_rectangle(), [1..4, 1..3]);
        assert_eq!(mask(["#....", ".....", "....#"]).unwrap().bounding_rectangle(), [0..5, 0..3]);
        assert!(mask(["..", "..", ".."]).unwrap().is_empty() && !mask(["..", ".#", ".."]).unwrap().is_empty());
        assert_eq!(Mask::new(vec![true], 2, 2), Err(MetricError::length("mask", 1, 4)));
    }
}
