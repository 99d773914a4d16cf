//! Any sequence of operations on any devices keeps the promises, and is the same again.

use proptest::prelude::*;
use sim_attack::operation::Operation;
use sim_attack::session::{Session, Setup, play};

fn session() -> impl Strategy<Value = Session> {
    let operations = prop::collection::vec(any::<Operation>(), 0..40);
    (any::<Setup>(), operations).prop_map(|(setup, operations)| Session { setup, operations })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn any_operations_keep_the_promises(session in session()) {
        prop_assert_eq!(play(&session), play(&session));
    }
}
