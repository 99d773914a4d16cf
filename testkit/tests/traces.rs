//! A recording of any live run is the same again; a damaged one is replayed or refused in words, as
//! is any text.

use proptest::prelude::*;
use rigsim_testkit::trace::{Damage, Recording, play, recorded};

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]

    #[test]
    fn recordings_are_the_same_again_and_damaged_ones_are_reported(
        recording: Recording,
        damages in prop::collection::vec(any::<Damage>(), 0..4),
    ) {
        recorded(&recording, &damages);
    }

    #[test]
    fn any_text_is_reported(text in r#"[ -~\n]{0,200}|(\{"kind":"[a-z]{2,6}"(,"[tdproy]{1,4}":[0-9\[\],"A]{0,20}){0,6}\}?\n?){0,8}"#) {
        play(&text);
    }
}
