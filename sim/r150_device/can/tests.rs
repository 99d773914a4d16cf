use super::*;

const MS: fn(u64) -> SimTime = SimTime::from_millis;
const FULL: [i16; 2] = [1000, 1000];
const BACK: [i16; 2] = [-500, -500];

fn driving() -> Can {
    let mut can = Can::default();
    can.update(MS(0), FULL);
    can
}

#[test]
fn cut_it_leaves_the_last_set_point_until_the_controller_stops_by_itself() {
    let mut can = driving();
    can.fail(MS(100), FULL, Some(CanFailure::Cut));
    can.update(MS(200), BACK);
    assert_eq!((can.heard(BACK), can.deadline()), (FULL, Some(MS(600))));
    can.update(MS(600) - Duration::from_nanos(1), BACK);
    assert_eq!(can.heard(BACK), FULL);
    can.update(MS(600), BACK);
    assert_eq!((can.heard(BACK), can.deadline()), ([0; 2], None));
    can.fail(MS(700), BACK, None);
    assert_eq!(can.heard(BACK), BACK);
}

#[test]
fn late_it_brings_everything_in_order() {
    let mut can = driving();
    let delay = Duration::from_millis(300);
    can.fail(MS(100), FULL, Some(CanFailure::Late(delay)));
    can.update(MS(200), BACK);
    can.update(MS(250), FULL);
    assert_eq!((can.heard(FULL), can.deadline()), (FULL, Some(MS(500))));
    can.update(MS(500), FULL);
    assert_eq!((can.heard(FULL), can.deadline()), (BACK, Some(MS(550))));
    can.update(MS(550), FULL);
    assert_eq!((can.heard(FULL), can.deadline()), (FULL, None));
}

#[test]
fn memory_is_bounded() {
    let mut can = driving();
    can.fail(
        MS(0),
        FULL,
        Some(CanFailure::Late(Duration::from_secs(3600))),
    );
    for at in 0..10_000_u64 {
        can.update(MS(at), [(at % 1000) as i16, 0]);
    }
    assert!(can.under_way.len() <= MOST_UNDER_WAY);
}
