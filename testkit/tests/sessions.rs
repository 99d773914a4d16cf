//! Any sequence of operations on any devices keeps the promises, and is the same again.

use proptest::prelude::*;
use rigsim_testkit::groups;
use rigsim_testkit::session::{Session, play};

proptest! {
    #![proptest_config(ProptestConfig::with_cases(600))]

    #[test]
    fn any_operations_with_any_settings_keep_the_promises(
        devices in prop::sample::select(groups().collect::<Vec<_>>()),
        session: Session,
    ) {
        prop_assert_eq!(play(devices, &session), play(devices, &session));
    }
}
