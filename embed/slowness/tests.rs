use std::sync::atomic::{AtomicBool, Ordering};

use super::*;

#[test]
fn the_time_is_counted_in_which_others_run() {
    let queue = RunQueue::of_this_thread();
    if queue.0.is_none() {
        eprintln!("SKIPPED: this system does not count how long threads wait for a processor");
        return;
    }
    let processors = std::thread::available_parallelism().unwrap().get();
    let enough = AtomicBool::new(false);
    std::thread::scope(|scope| {
        for _ in 0..2 * processors {
            scope.spawn(|| {
                while !enough.load(Ordering::Relaxed) {
                    std::hint::spin_loop()
                }
            });
        }
        let (begun, before) = (Instant::now(), queue.waited());
        while queue.waited() < before + Duration::from_millis(20) {
            if begun.elapsed() > Duration::from_secs(120) {
                enough.store(true, Ordering::Relaxed);
                panic!("it never waited");
            }
        }
        enough.store(true, Ordering::Relaxed);
    });
}
