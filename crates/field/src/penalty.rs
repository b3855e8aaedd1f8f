/// The name of a penalty on a field's own parameters, such as the total variation of its tables.
///
/// A term of the objective requests it by name from [`Field::penalty`](crate::Field::penalty). The set of names is open: a
/// penalty of a single field is defined next to that field.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Penalty(pub &'static str);

impl Penalty {
    /// Total variation of a field's tables (planes and lines, voxels), a mean that each field defines.
    pub const TOTAL_VARIATION: Self = Self("total variation");
}
