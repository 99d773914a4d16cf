use super::*;

/// A client's end as the system opens it.
fn client_of(pair: &Pair) -> OwnedFd {
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
    rustix::fs::open(pair.slave(), flags, Mode::empty()).expect("the node can be opened")
}

fn set_speed(client: &OwnedFd, baud: u32) {
    let mut termios = tcgetattr(client).expect("there are settings");
    termios.set_speed(baud).expect("a speed");
    tcsetattr(client, OptionalActions::Now, &termios).expect("the settings are taken");
}

fn speed(pair: &Pair) -> u32 {
    pair.settings().expect("there are settings").output_speed()
}

#[test]
fn a_client_that_has_come_before_settings_are_restored_keeps_its_own() {
    let pair = Pair::open(PtySetup::raw(115_200)).expect("a pair");
    let former = client_of(&pair);
    set_speed(&former, 9_600);
    drop(former);
    let client = client_of(&pair);
    set_speed(&client, 57_600);
    assert_eq!(pair.restore().ok(), Some((true, 1)));
    assert_eq!(speed(&pair), 57_600);
    pair.restore_for_next().expect("it is restored");
    assert_eq!(speed(&pair), 57_600);
    drop(client);
    assert_eq!(pair.restore().ok(), Some((true, 1)));
    assert_eq!(speed(&pair), 115_200);
}

#[test]
fn a_client_that_waits_for_bytes_waits_on_while_another_s_settings_are_undone() {
    let pair = Pair::open(PtySetup::raw(115_200)).expect("a pair");
    let client = client_of(&pair);
    rustix::io::ioctl_fionbio(&client, false).expect("it may block");
    let waiting = std::thread::spawn(move || {
        let mut buf = [0; 8];
        rustix::io::read(&client, &mut buf).map(|count| buf[..count].to_vec())
    });
    // Most of these come while it waits.
    for _ in 0..100 {
        pair.restore().expect("it is restored");
        std::thread::sleep(std::time::Duration::from_micros(100));
    }
    assert_eq!(rustix::io::write(&pair.master, b"reply"), Ok(5));
    assert_eq!(waiting.join().expect("no panic"), Ok(b"reply".to_vec()));
}

#[test]
fn what_waits_for_a_client_is_taken_back() {
    let pair = Pair::open(PtySetup::raw(115_200)).expect("a pair");
    let client = client_of(&pair);
    let mut buf = [0; 8];
    for restore in [
        Pair::restore_for_next as fn(&Pair) -> Result<u32, PortErrorKind>,
        |pair| pair.restore().map(|(_, visits)| visits),
    ] {
        assert_eq!(rustix::io::write(&pair.master, b"reply"), Ok(5));
        assert_eq!(restore(&pair).ok(), Some(1));
        assert_eq!(rustix::io::read(&client, &mut buf), Err(Errno::AGAIN));
    }
}
