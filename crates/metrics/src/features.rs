use nalgebra::DMatrix;

use crate::error::MetricError;

/// Feature vectors of a set of images, `[n, dimension]`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FeatureSet {
    values: Vec<f64>,
    dimension: usize,
}

impl FeatureSet {
    /// Adds the vector of one more image; the first one decides the dimension.
    ///
    /// # Errors
    /// If the vector is empty, has another dimension, or holds a value that is not finite.
    pub fn push(&mut self, row: &[f32]) -> Result<(), MetricError> {
        if row.is_empty() {
            return Err(MetricError::empty("feature vector"));
        }
        if self.dimension != 0 && row.len() != self.dimension {
            return Err(MetricError::length("feature vector", row.len(), self.dimension));
        }
        if let Some(index) = row.iter().position(|value| !value.is_finite()) {
            return Err(MetricError::not_finite("feature vector", index));
        }
        self.dimension = row.len();
        self.values.extend(row.iter().copied().map(f64::from));
        Ok(())
    }

    fn len(&self) -> usize {
        self.values.len() / self.dimension.max(1)
    }

    /// Returns both sets as matrices with a vector per row, at least two of the same dimension.
    pub(crate) fn matrices(a: &Self, b: &Self) -> Result<[DMatrix<f64>; 2], MetricError> {
        let found = a.len().min(b.len());
        if found < 2 {
            return Err(MetricError::other(format!("needs at least 2 images, got {found}")));
        }
        if a.dimension != b.dimension {
            return Err(MetricError::length("feature vector", b.dimension, a.dimension));
        }
        Ok([a, b].map(|set| DMatrix::from_row_slice(set.len(), set.dimension, &set.values)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vectors_must_have_one_length_and_be_finite() {
        let mut features = FeatureSet::default();
        [[1.0, 2.0], [3.0, 4.0]].iter().for_each(|row| features.push(row).unwrap());
        let rows = DMatrix::from_row_slice(2, 2, &[1.0, 2.0, 3.0, 4.0]);
        assert_eq!(FeatureSet::matrices(&features, &features), Ok([rows.clone(), rows]));
        assert_eq!(features.push(&[1.0]), Err(MetricError::length("feature vector", 1, 2)));
        assert_eq!(features.push(&[1.0, f32::NAN]), Err(MetricError::not_finite("feature vector", 1)));
        assert_eq!(features.push(&[]), Err(MetricError::empty("feature vector")));
        assert_eq!(features.len(), 2);
    }
}
