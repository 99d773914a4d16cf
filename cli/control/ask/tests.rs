use super::*;

#[test]
fn errors_have_no_places_in_them() {
    let text = "step:1:9: `fault`: unknown\nstep:2:1: `for`: is: odd\nplain";
    assert_eq!(
        without_places(text),
        "`fault`: unknown\n`for`: is: odd\nplain"
    );
}
