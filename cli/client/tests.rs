//! The output of a client stays within its bound.

use super::*;

#[test]
fn an_output_beyond_its_bound_keeps_its_beginning_and_what_comes_next() {
    let file = tempfile::Builder::new().append(true).tempfile().unwrap();
    let mut client = file.reopen().unwrap();
    client.write_all(b"the beginning\n").unwrap();
    // A hole takes no room on the disk.
    client.set_len(2 * MOST_FILED + 1).unwrap();
    let mut written = Written::new(file.into_file());
    assert_eq!(written.cut(), MOST_FILED);
    (&written.file).write_all(b"the end\n").unwrap();

    let text = written.text();
    let left_out = MOST_FILED + 1;
    let marked = format!("\n({left_out} bytes are left out here)\nthe end\n");
    assert!(text.ends_with(&marked), "{}", &text[text.len() - 100..]);
    let length = written.file.metadata().unwrap().len();
    let before = length - MOST_SHOWN + left_out;
    let first = format!("({before} bytes before this are left out)\n");
    assert!(text.starts_with(&first), "{}", &text[..100]);
    let mut begin = [0; 14];
    written.file.rewind().unwrap();
    written.file.read_exact(&mut begin).unwrap();
    assert_eq!(&begin, b"the beginning\n");
}
