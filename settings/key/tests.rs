use super::*;

#[test]
fn keys_and_values_lead_to_their_key() {
    let text = "a = 1\n[[b]]\nc = { d = 2 }\n[[b]]\nc.d = 3\n";
    for (part, key) in [
        ("a", Some("a")),
        ("1", Some("a")),
        ("2", Some("b.c.d")),
        ("3", Some("b.c.d")),
        ("[[b", Some("b")),
        ("\n", None),
    ] {
        assert_eq!(
            key_at(text, text.find(part).unwrap()).as_deref(),
            key,
            "{part}"
        );
    }
    assert_eq!(key_at("a = ", 0), None);
}
