use super::*;

#[test]
fn a_child_is_found_and_so_is_its_parent() {
    let mut child = Command::new("sleep").arg("60").spawn().unwrap();
    let pid = Pid::from_child(&child);
    assert_eq!(parent(pid), Some(rustix::process::getpid()));
    assert!(children().contains(&pid));
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(!children().contains(&pid));
}
