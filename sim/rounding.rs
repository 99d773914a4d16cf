//! From numbers to the integers of fields.

/// Rounds to the nearest integer of a field, saturating at its ends; what is not a number is 0.
pub(crate) fn round<T: FromRounded>(value: f64) -> T {
    T::from_rounded(value.round())
}

pub(crate) trait FromRounded {
    fn from_rounded(value: f64) -> Self;
}

macro_rules! from_rounded {
    ($($field:ty),*) => { $(
        impl FromRounded for $field {
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "a cast from a float saturates, as the documentation says; not every \
                          field can lose a sign"
            )]
            fn from_rounded(value: f64) -> Self {
                value as $field
            }
        }
    )* };
}

from_rounded!(u16, u32, i16, i32, i64);
