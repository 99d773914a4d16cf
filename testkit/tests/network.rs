//! Any bytes are legal on the network, and how they are split changes nothing.

use proptest::prelude::*;
use rigsim_testkit::network;

const IAC: u8 = 255;

/// A subnegotiation of COM-PORT-OPTION.
fn command((number, value): (u8, Vec<u8>)) -> Vec<u8> {
    [&[IAC, 250, 44, number], &value[..], &[IAC, 240]].concat()
}

proptest! {
    #[test]
    fn what_a_client_on_the_network_says(
        first in any::<u8>(),
        parts in prop::collection::vec(prop_oneof![
            2 => Just(vec![IAC, 251, 44]),
            1 => (250_u8..=255, any::<u8>()).prop_map(|(verb, option)| vec![IAC, verb, option]),
            1 => Just(vec![IAC, 240]),
            4 => (0_u8..16, prop::collection::vec(any::<u8>(), 0..6)).prop_map(command),
            3 => prop::collection::vec(any::<u8>(), 0..20),
        ], 0..40),
    ) {
        network::play(&[vec![first], parts.concat()].concat());
    }
}
