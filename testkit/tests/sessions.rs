//! Any sequence of operations on any devices keeps the promises, and is the same again.

use proptest::prelude::*;
use sim_testkit::session::{Session, play};

proptest! {
    #![proptest_config(ProptestConfig::with_cases(600))]

    #[test]
    fn any_operations_with_any_settings_keep_the_promises(session: Session) {
        prop_assert_eq!(play(&session), play(&session));
    }
}
