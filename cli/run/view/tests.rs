use super::*;

#[test]
fn a_signature_has_no_values() {
    let one = signature("always `truth.distance_m < 0.2`, but truth.distance_m = 0.200616");
    assert_eq!(one, "always `truth.distance_m < 0.2`");
    let one = signature("22 motor commands within 1.0 s, `count.x > 3`");
    assert_eq!(one, "# motor commands within # s, `count.x > 3`");
}
