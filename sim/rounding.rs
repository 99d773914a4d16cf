//! From numbers to the integers of fields.

use num_traits::AsPrimitive;

/// Rounds to the nearest integer of a field, saturating at its ends; what is not a number is 0.
pub(crate) fn round<T: Copy + 'static>(value: f64) -> T
where
    f64: AsPrimitive<T>,
{
    value.round().as_()
}
