//! Any sequence of operations on any devices keeps the promises, and is the same again.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod made;

use made::{made, operations};
use proptest::prelude::*;
use rigsim_testkit::groups;
use rigsim_testkit::session::{Session, play};

fn session() -> impl Strategy<Value = Session> {
    let parts = (made(), prop::collection::vec(made(), 0..5), operations());
    parts.prop_map(|(setup, settings, operations)| Session {
        setup,
        settings,
        operations,
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(600))]

    #[test]
    fn any_operations_with_any_settings_keep_the_promises(
        devices in prop::sample::select(groups().collect::<Vec<_>>()),
        session in session(),
    ) {
        prop_assert_eq!(play(devices, &session), play(devices, &session));
    }
}
