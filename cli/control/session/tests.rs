use super::*;
use std::os::unix::fs::symlink;

#[test]
fn a_session_is_found_while_it_runs_and_by_any_name_of_its_port() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("sim");
    assert_eq!(Session::running_in(&folder).unwrap(), []);
    let (port, link) = (dir.path().join("port"), dir.path().join("link"));
    fs::write(&port, "").unwrap();
    symlink(&port, &link).unwrap();
    let session = Session {
        pid: std::process::id(),
        url: "http://127.0.0.1:1/#token=x".to_owned(),
        ports: vec![link.clone()],
    };
    let file = session.publish_in(&folder).unwrap();
    assert_eq!(
        Session::running_in(&folder).unwrap(),
        std::slice::from_ref(&session)
    );
    assert!(session.serves(&port) && session.serves(&link));
    assert!(!session.serves(dir.path()) && !session.serves(&dir.path().join("gone")));
    drop(file);
    assert_eq!(Session::running_in(&folder).unwrap(), []);
}
