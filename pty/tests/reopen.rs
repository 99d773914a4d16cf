//! Clients may come and go without end. One test alone in its process, since
//! it counts the descriptors of the whole of it.

mod common;

use common::Bench;
use rigsim_pty::Event;

fn descriptors() -> usize {
    std::fs::read_dir("/proc/self/fd").map_or(0, Iterator::count)
}

#[test]
fn two_hundred_clients_leave_no_descriptor_behind() {
    let mut bench = Bench::unlinked();
    let before = descriptors();
    assert!(before > 0);
    for round in 0..200_u8 {
        let client = bench.client();
        bench.expect(Event::Attached);
        client.send(&[round]);
        assert_eq!(bench.expect_bytes(1), [round]);
        assert_eq!(bench.port.write(&[round]).unwrap(), 1);
        assert_eq!(client.receive(1), [round]);
        drop(client);
        bench.expect(Event::Detached);
        assert_eq!(descriptors(), before);
    }
    bench.expect_quiet();
    assert_eq!(bench.port.counters().attached, 200);
}
