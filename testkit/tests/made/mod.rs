//! What the fuzz targets make of bytes, for property tests.

use arbitrary::{Arbitrary, Unstructured};
use proptest::prelude::*;
use rigsim_testkit::choice::Choice;
use rigsim_testkit::operation::{Message, Operation};

/// Anything of a type.
pub fn made<T: for<'b> Arbitrary<'b> + std::fmt::Debug>() -> impl Strategy<Value = T> {
    // What bytes run out for is made of zeros.
    let bytes = prop::collection::vec(any::<u8>(), 0..32);
    bytes.prop_map(|bytes| T::arbitrary(&mut Unstructured::new(&bytes)).unwrap())
}

/// Up to 40 operations, of which many are commands.
pub fn operations() -> impl Strategy<Value = Vec<Operation>> {
    let command = (any::<u8>(), made::<Choice>()).prop_map(|(port, command)| Operation::Send {
        port,
        message: Message::Command(command),
    });
    prop::collection::vec(prop_oneof![5 => made(), 1 => command], 0..40)
}
