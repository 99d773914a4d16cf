use super::*;
use rigsim_pty::open_port;

#[test]
fn a_panic_is_a_failure_of_the_simulator_and_leaves_no_link() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("r150");
    let exit = guarded(|| {
        let _port = open_port(&path, rigsim_pty::PtySetup::raw(115_200)).unwrap();
        assert!(path.exists());
        panic!("as a test of what is done about it");
    });
    assert_eq!(exit, Exit::System);
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
    assert_eq!(guarded(|| Ok(Exit::Clean)), Exit::Clean);
}
