use crate::error::MetricError;
use crate::picture::{Picture, check_length};
use crate::rectangle::Rectangle;

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
    /// [`MetricError::Length`] unless there are `width × height` values.
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

    /// Returns the smallest rectangle that holds every pixel inside.
    ///
    /// # Panics
    /// If the mask is empty.
    pub fn bounding_rectangle(&self) -> Rectangle {
        let [width, _] = self.size;
        let inside = || self.inside.iter().enumerate().filter(|(_, inside)| **inside).map(|(index, _)| index);
        let bounds = |coordinate: fn(usize, usize) -> usize| {
            inside()
                .map(|index| coordinate(index, width))
                .fold((usize::MAX, 0), |(low, high), at| (low.min(at), high.max(at)))
        };
        let ((left, right), (top, bottom)) =
            (bounds(|index, width| index % width), bounds(|index, width| index / width));
        Rectangle { origin: [left, top], size: [right - left + 1, bottom - top + 1] }
    }

    /// Replaces pixels outside the mask by `color`.
    ///
    /// # Panics
    /// If `picture` has another size.
    pub(crate) fn composite(&self, picture: &Picture, color: [f32; 3]) -> Picture {
        assert_eq!(picture.size(), self.size, "a mask of the picture's size");
        picture.mapped(|index, pixel| if self.inside[index] { pixel } else { color })
    }

    /// Intersects two masks of one size.
    pub(crate) fn and(self, other: &Self) -> Self {
        let inside = self.inside.into_iter().zip(&other.inside).map(|(a, b)| a && *b).collect();
        Self { inside, ..self }
    }

    /// Returns the part inside `rectangle`.
    pub(crate) fn cropped(&self, rectangle: Rectangle) -> Result<Self, MetricError> {
        let [width, height] = rectangle.size;
        Self::new(rectangle.of(&self.inside, self.size[0]), width, height)
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
    fn bounding_rectangle_is_the_smallest() {
        let rectangle = mask([".....", "..#..", ".#.#."]).unwrap().bounding_rectangle();
        assert_eq!(rectangle, Rectangle { origin: [1, 1], size: [3, 2] });
        let rectangle = mask(["#....", ".....", "....#"]).unwrap().bounding_rectangle();
        assert_eq!(rectangle, Rectangle { origin: [0, 0], size: [5, 3] });
    }

    #[test]
    fn mask_must_have_a_value_per_pixel() {
        assert!(mask(["..", "..", ".."]).unwrap().is_empty() && !mask(["..", ".#", ".."]).unwrap().is_empty());
        assert!(matches!(Mask::new(vec![true], 2, 2), Err(MetricError::Length { .. })));
    }

    #[test]
    fn composite_replaces_pixels_outside() {
        let picture = Picture::new(vec![[0.5; 3]; 6], 2, 3).unwrap();
        let composite = mask(["#.", "..", ".#"]).unwrap().composite(&picture, [1.0; 3]);
        assert_eq!(composite.pixels().iter().filter(|pixel| **pixel == [1.0; 3]).count(), 4);
        assert_eq!(composite.pixels()[5], [0.5; 3]);
    }
}
