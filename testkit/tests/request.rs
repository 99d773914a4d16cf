//! Any bytes may come to the control socket, and how they are split changes nothing.

use proptest::prelude::*;
use rigsim_testkit::request;

const PIECES: &[&str] = &[
    "GET ",
    "POST ",
    "DELETE ",
    "/v1/steps",
    "/v1/steps/a%20b",
    "/v1/names?names=",
    "truth.x_m,t",
    "?wait=true",
    "%",
    "%zz",
    "&",
    " HTTP/1.1\r\n",
    " HTTP/1.0\r\n",
    " HTTP/9\r\n",
    "Host: ",
    "127.0.0.1:1",
    "Origin: http://127.0.0.1:1",
    "Authorization: Bearer ",
    "Content-Length: ",
    "12",
    "99999999999999999999",
    "-1",
    "Transfer-Encoding: chunked",
    "Expect: 100-continue",
    "Connection: close",
    "\r\n",
    "\r\n\r\n",
    "\n\n",
    ":",
    " ",
    "\r",
    "\0",
    "{}",
];

proptest! {
    #[test]
    fn what_a_client_of_the_control_socket_says(
        parts in prop::collection::vec(prop_oneof![
            8 => prop::sample::select(PIECES).prop_map(|piece| piece.as_bytes().to_vec()),
            1 => prop::collection::vec(any::<u8>(), 0..20),
            1 => (any::<u8>(), 0_usize..20_000).prop_map(|(byte, count)| vec![byte; count]),
        ], 0..40),
    ) {
        request::play(&parts.concat());
    }
}
