use super::*;

const SECOND: Duration = Duration::from_secs(1);

#[test]
fn it_stands_still_when_stopped_and_goes_on_from_there() {
    let mut clock = Clock::start(1.0);
    let at = SimTime::ZERO + SECOND;
    clock.stop(at);
    assert_eq!((clock.now(), clock.until(at + SECOND)), (at, None));
    clock.resume(at, None);
    assert!(!clock.is_stopped());
    assert!(clock.now() >= at && clock.until(at + SECOND) <= Some(SECOND));
}

#[test]
fn it_stops_exactly_where_it_is_to() {
    let mut clock = Clock::start(1e9);
    let (at, end) = (SimTime::ZERO, SimTime::ZERO + SECOND);
    clock.resume(at, Some(SECOND));
    while clock.now() < end {}
    assert_eq!(clock.now(), end);
    clock.arrive(at);
    assert!(!clock.is_stopped());
    clock.arrive(end);
    assert!(clock.is_stopped());
}

#[test]
fn another_speed_counts_from_where_the_simulation_is() {
    let mut clock = Clock::start(1.0);
    let at = SimTime::ZERO + SECOND;
    clock.set_speed(at, 100.0);
    let until = clock.until(at + SECOND * 100);
    assert!(until.is_some_and(|until| until <= SECOND));
}
