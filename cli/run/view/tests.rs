use super::*;

#[test]
fn a_signature_has_numbers_in_conditions_only() {
    let one = signature("22 motor commands within 1.0 s, `count.x > 3`");
    assert_eq!(one, "# motor commands within # s, `count.x > 3`");
}
