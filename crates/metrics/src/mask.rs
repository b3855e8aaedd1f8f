use crate::size::check_length;
use crate::{MetricError, Picture, Rectangle};

/// The pixels of a picture that count.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mask {
    inside: Vec<bool>,
    size: [usize; 2],
}

impl Mask {
    /// The mask of row-major `inside`.
    ///
    /// # Errors
    /// [`MetricError::Length`] unless there are `width × height` values.
    pub fn new(inside: Vec<bool>, width: usize, height: usize) -> Result<Self, MetricError> {
        check_length("mask", inside.len(), [width, height])?;
        Ok(Self { inside, size: [width, height] })
    }

    /// Whether each pixel is inside, row-major.
    pub fn inside(&self) -> &[bool] {
        &self.inside
    }

    /// Whether no pixel is inside: a view with such a mask has no masked figures.
    pub fn is_empty(&self) -> bool {
        !self.inside.contains(&true)
    }

    /// Width and height in pixels.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// The smallest rectangle that holds every pixel inside.
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

    /// `picture` with `color` where the mask is not.
    ///
    /// # Panics
    /// If the picture has another size.
    pub(crate) fn composite(&self, picture: &Picture, color: [f32; 3]) -> Picture {
        assert_eq!(picture.size(), self.size, "a mask of the picture's size");
        picture.mapped(|index, pixel| if self.inside[index] { pixel } else { color })
    }

    /// The pixels inside both masks, which have one size.
    pub(crate) fn and(self, other: &Self) -> Self {
        let inside = self.inside.into_iter().zip(&other.inside).map(|(a, b)| a && *b).collect();
        Self { inside, ..self }
    }

    /// The part inside `rectangle`.
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
    fn its_rectangle_is_the_smallest() {
        let rectangle = mask([".....", "..#..", ".#.#."]).unwrap().bounding_rectangle();
        assert_eq!(rectangle, Rectangle { origin: [1, 1], size: [3, 2] });
        let rectangle = mask(["#....", ".....", "....#"]).unwrap().bounding_rectangle();
        assert_eq!(rectangle, Rectangle { origin: [0, 0], size: [5, 3] });
    }

    #[test]
    fn a_mask_has_the_size_of_its_picture() {
        assert!(mask(["..", "..", ".."]).unwrap().is_empty() && !mask(["..", ".#", ".."]).unwrap().is_empty());
        assert!(matches!(Mask::new(vec![true], 2, 2), Err(MetricError::Length { .. })));
    }

    #[test]
    fn what_is_outside_gets_the_color() {
        let picture = Picture::new(vec![[0.5; 3]; 6], 2, 3).unwrap();
        let composite = mask(["#.", "..", ".#"]).unwrap().composite(&picture, [1.0; 3]);
        assert_eq!(composite.pixels().iter().filter(|pixel| **pixel == [1.0; 3]).count(), 4);
        assert_eq!(composite.pixels()[5], [0.5; 3]);
    }
}
