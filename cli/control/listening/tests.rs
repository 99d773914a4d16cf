use super::*;

#[test]
fn two_thousand_a_second_are_sent_after_a_hundred_at_once() {
    let mut traffic = Traffic::default();
    let start = SimTime::from_secs(1);
    assert_eq!((0..1000).filter(|_| traffic.has_room(start)).count(), 101);
    let later = start + Traffic::EVERY;
    assert!(!traffic.has_room(later - Duration::from_nanos(1)));
    assert!(traffic.has_room(later) && !traffic.has_room(later));
    assert!((1..4000).all(|count| traffic.has_room(later + count * Traffic::EVERY)));
}
