/// Part of an image, aligned with its axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rectangle {
    /// Column and row of its upper left pixel.
    pub origin: [usize; 2],
    /// Width and height in pixels.
    pub size: [usize; 2],
}

impl Rectangle {
    /// Returns the values inside it, row-major, of a row-major map that is `width` wide.
    ///
    /// # Panics
    /// If it reaches out of the map or is empty.
    pub(crate) fn of<T: Copy>(self, map: &[T], width: usize) -> Vec<T> {
        let ([x, y], [columns, rows]) = (self.origin, self.size);
        assert!(columns > 0 && rows > 0 && x + columns <= width, "a rectangle within the map");
        map.chunks_exact(width).skip(y).take(rows).flat_map(|row| &row[x..x + columns]).copied().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rectangle_selects_rows_and_columns() {
        let map: Vec<usize> = (0..12).collect();
        assert_eq!(Rectangle { origin: [1, 1], size: [2, 2] }.of(&map, 4), [5, 6, 9, 10]);
    }
}
