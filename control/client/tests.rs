use super::*;

#[test]
fn urls_are_those_that_a_simulator_prints() {
    assert!(Client::new(" http://127.0.0.1:4000/#token=abc\n").is_ok());
    for wrong in [
        "",
        "http://127.0.0.1:4000/",
        "https://h/#token=a",
        "http://h/#token=a\r\nX: y",
    ] {
        assert!(Client::new(wrong).is_err(), "{wrong}");
    }
}

#[test]
fn names_of_steps_can_stand_in_paths() {
    assert_eq!(escape("bit flips/2"), "bit%20flips%2F2");
}
