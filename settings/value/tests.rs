use super::*;

#[test]
fn what_is_shown_reads_back() {
    for span in ["250ms", "3s", "1us", "1h", "0s", "1500ms"] {
        let read = Duration::read(&Value::Text(span.into()), "s").unwrap();
        assert_eq!(read.show(""), format!("\"{span}\""));
    }
}
