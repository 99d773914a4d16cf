use super::*;

#[test]
fn a_key_that_stands_twice_is_refused_wherever_it_is() {
    let text = r#"{"a": [{"b": 1}, -1.5, "x", true], "d": {"b": 9223372036854775807, "e": []}}"#;
    assert_eq!(
        read(text.as_bytes()).unwrap(),
        serde_json::from_str::<Value>(text).unwrap()
    );
    for twice in [
        r#"{"a": 1, "a": 1}"#,
        r#"{"d": [{"a": 1, "b": 2, "a": 3}]}"#,
    ] {
        let why = read(twice.as_bytes()).unwrap_err().to_string();
        assert!(why.starts_with("duplicate key: `a`"), "{why}");
    }
    assert!(read(b"{").is_err());
}
