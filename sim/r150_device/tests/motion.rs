//! Motor watchdog, reply rate, and what keeps the vehicle from moving.

use crate::firmware::Firmware as _;
use proptest::prelude::*;

use super::*;
use crate::defects::Defects;
use crate::event::Role;
use crate::r150_device::codec::encode;
use crate::r150_device::event::{NOT_DRIVING, WATCHDOG_FIRED};
use crate::r150_device::settings::{MotorsRefusalReply, OutOfRange, OverRate};
use crate::r150_device::vehicle::{Key, Obstacle, OperatorInput};

const WATCHDOG: Duration = Duration::from_millis(500);
const INTERVAL: Duration = Duration::from_millis(50);

#[test]
fn the_watchdog_stops_the_motors_at_500_ms_and_not_one_quantum_before() {
    let mut bench = Bench::new();
    bench.drive(300, -300);
    bench.after(WATCHDOG - QUANTUM);
    assert_eq!(bench.duty(), [0.3, -0.3]);
    assert_eq!(bench.codes(), [""; 0]);
    bench.after(QUANTUM);
    assert_eq!(bench.duty(), [0.0, 0.0]);
    let words = "motor watchdog fired: no motor command in time, motors stopped (were right 300 \
                 left -300)";
    assert_eq!(bench.events(), [EventKind::new(WATCHDOG_FIRED, words)]);
}

#[test]
fn only_motor_commands_feed_the_watchdog() {
    let mut bench = Bench::new();
    bench.drive(300, 300);
    bench.after(WATCHDOG - QUANTUM);
    for request in [
        Request::Heartbeat,
        Request::SystemInfo,
        Request::PowerControl { on: 0 },
    ] {
        bench.ask(request);
    }
    bench.after(QUANTUM);
    assert_eq!(bench.duty(), [0.0, 0.0]);
}

#[test]
fn a_motor_command_at_the_last_moment_feeds_the_watchdog() {
    let mut bench = Bench::new();
    bench.drive(300, 300);
    bench.now += WATCHDOG;
    bench.drive(200, 200);
    bench.after(WATCHDOG - QUANTUM);
    assert_eq!(bench.duty(), [0.2, 0.2]);
    bench.after(QUANTUM);
    assert_eq!(bench.duty(), [0.0, 0.0]);
}

#[test]
fn a_watchdog_that_stops_what_did_not_drive_is_not_the_clients_fault() {
    let mut bench = Bench::start(at_once(), Start::Locked);
    bench.drive(300, 300);
    bench.after(WATCHDOG);
    let faults = |bench: &mut Bench| bench.events().iter().any(EventKind::is_client_error);
    assert!(!faults(&mut bench));
    let mut bench = Bench::new();
    bench.drive(300, 300);
    bench.after(WATCHDOG);
    assert!(faults(&mut bench));
}

#[test]
fn a_refused_motor_command_feeds_nothing() {
    let mut bench = Bench::with(|s| s.on_motors_out_of_range = OutOfRange::Refuse);
    bench.drive(300, 300);
    bench.after(WATCHDOG - QUANTUM);
    assert_eq!(bench.drive(2000, 300), None);
    bench.after(QUANTUM);
    assert_eq!(bench.duty(), [0.0, 0.0]);
}

#[test]
fn a_watchdog_over_standing_motors_is_no_event() {
    let mut bench = Bench::new();
    bench.drive(0, 0);
    bench.after(WATCHDOG * 2);
    assert_eq!(bench.codes(), [""; 0]);
}

proptest! {
    #[test]
    fn no_flood_and_no_excuse_makes_replies_more_frequent_than_the_manual_allows(
        acts in prop::collection::vec((0_u32..80_000, 0_u8..4, 0_u64..600), 1..200),
        choice in 0_usize..3,
        spread in 0_u64..5,
    ) {
        let mut bench = Bench::with(|s| {
            s.over_rate = [OverRate::Delay, OverRate::Silent, OverRate::Ignore][choice];
            s.on_motors_refused = MotorsRefusalReply::Speeds;
            s.reply_spread = Duration::from_millis(spread);
        });
        for (wait, act, by) in acts {
            let span = Duration::from_millis(by);
            match act {
                0 => bench.device.late(bench.now, span, Duration::ZERO),
                1 => bench.device.late(bench.now, span, span),
                2 => {
                    let defects = Defects { slow: span, ..Defects::default() };
                    bench.device.set_defects(bench.now, defects);
                }
                _ => bench.after(Duration::from_micros(wait.into())),
            }
            for frame in [encode(0x12, &[1, 0, 1, 0]), encode(0x12, &[1])] {
                bench.device.handle_bytes(bench.now, &frame);
            }
        }
        bench.after(Duration::from_secs(2));
        let mut last = None;
        while let Some((at, event)) = bench.device.poll_event() {
            if event.code().role == Role::Reply {
                let gap = last.replace(at).map(|last| at.since(last));
                prop_assert!(gap.is_none_or(|gap| gap >= INTERVAL), "{gap:?}");
            }
        }
        prop_assert!(last.is_some());
    }
}

#[test]
fn a_client_at_20_hz_gets_every_reply_however_its_commands_jitter() {
    for jitter_us in [0, 1, 400, 2500] {
        let mut bench = Bench::new();
        let mut replies = 0;
        let mut count = |bench: &mut Bench| {
            while bench.device.poll_output().is_some() {
                replies += 1;
            }
        };
        for turn in 0..200_u64 {
            let early = Duration::from_micros(jitter_us * (turn % 3));
            bench.until(SimTime::from_millis(50 * (turn + 1)) - early);
            bench.device.handle_bytes(
                bench.now,
                &Request::SetMotors { right: 1, left: 1 }.encode(),
            );
            count(&mut bench);
        }
        bench.after(INTERVAL);
        count(&mut bench);
        assert_eq!(replies, 200, "{jitter_us}");
        assert_eq!(bench.codes(), [""; 0], "{jitter_us}");
    }
}

#[test]
fn a_rate_over_a_second_is_the_clients_error_and_a_command_is_not() {
    // 22 within a second are more than 20 and 5 %; 21 are not.
    for (period_us, reported) in [(47_700, false), (47_500, true), (20_000, true)] {
        let mut bench = Bench::new();
        for _ in 0..60 {
            bench.drive(100, 100);
            bench.after(Duration::from_micros(period_us));
        }
        assert_eq!(
            bench.codes().contains(&"over_rate"),
            reported,
            "{period_us} us"
        );
    }
}

#[test]
fn replies_may_be_further_apart_or_nearer() {
    for (interval, held) in [
        (Duration::from_millis(100), true),
        (Duration::from_millis(10), false),
    ] {
        let mut bench = Bench::with(|s| s.motor_reply_interval = interval);
        assert!(bench.drive(100, 100).is_some());
        bench.after(Duration::from_millis(20));
        assert_eq!(bench.drive(100, 100).is_none(), held, "{interval:?}");
        if held {
            bench.after(Duration::from_millis(80) - QUANTUM);
            assert_eq!(bench.reply(), None);
            bench.after(QUANTUM);
            assert!(bench.reply().is_some());
        }
    }
}

/// A stall: simulated time stands still from a time of the client's clock on, for so long.
type Stall = (Duration, Duration);

/// Returns the times at which `over_rate` was reported for commands that a client sent at `times`,
/// by its own clock.
fn over_rates(times: impl IntoIterator<Item = Duration>, stalls: &[Stall]) -> Vec<SimTime> {
    let mut bench = Bench::new();
    let (mut left, mut stood) = (stalls.iter().copied().peekable(), Duration::ZERO);
    let mut times = times.into_iter().peekable();
    while let Some(&sent) = times.peek() {
        match left.next_if(|(from, _)| *from <= sent) {
            Some((from, by)) => {
                let now = SimTime::ZERO + (from - stood);
                bench.until(now.max(bench.now));
                bench.device.late(bench.now, by, by);
                stood += by;
                while times.next_if(|sent| *sent <= from + by).is_some() {
                    bench.drive(100, 100);
                }
            }
            None => {
                bench.until(SimTime::ZERO + (sent - stood));
                bench.drive(100, 100);
                times.next();
            }
        }
    }
    let events = std::iter::from_fn(|| bench.device.poll_event());
    events
        .filter(|(_, event)| event.code().name == "over_rate")
        .map(|(at, _)| at)
        .collect()
}

/// Times from a second on, `period` apart.
fn every(period: Duration, count: u32) -> impl Iterator<Item = Duration> {
    (0..count).map(move |n| Duration::from_secs(1) + period * n)
}

#[test]
fn a_stall_excuses_what_piled_up_in_it_as_long_as_that_is_in_the_second() {
    let ms = Duration::from_millis;
    // An 18 Hz client, and one stall of 300 ms.
    let stall = [(ms(1510), ms(300))];
    assert_eq!(over_rates(every(ms(55), 100), &stall), []);
    // A client at exactly 20 Hz, and stalls that no one of them would be too much.
    for by in [30, 52, 100, 240, 900, 3000] {
        let many: Vec<Stall> = (0..3).map(|n| (ms(1510 + 1000 * n), ms(by))).collect();
        let many: Vec<Stall> = many.into_iter().filter(|_| by < 1000).collect();
        assert_eq!(over_rates(every(INTERVAL, 200), &many), [], "{by} ms");
        let one = [(ms(1510), ms(by))];
        assert_eq!(over_rates(every(INTERVAL, 200), &one), [], "{by} ms");
    }
    // A pause of a minute in which a port holds no more.
    let pause = [(ms(1510), ms(60_000))];
    assert_eq!(over_rates(every(INTERVAL, 1500), &pause), []);
}

#[test]
fn a_stall_within_the_second_excuses_no_quantum_more_than_it_took() {
    // 22 commands in a second by the client's clock, but for a quantum or not, over a stall.
    let second = Duration::from_secs(1);
    for by in [1, 50, 300, 600].map(Duration::from_millis) {
        let stall = [(Duration::from_millis(1310), by)];
        let with_last = |last| every(Duration::from_millis(47), 21).chain([last]);
        assert_eq!(over_rates(with_last(second * 2), &stall), [], "{by:?}");
        let at = second * 2 - QUANTUM;
        let found = over_rates(with_last(at), &stall);
        assert_eq!(found, [SimTime::ZERO + (at - by)], "{by:?}");
    }
    // The client that is too fast is found again once the stall is a second ago.
    let stall = [(Duration::from_millis(1310), Duration::from_millis(300))];
    assert!(!over_rates(every(Duration::from_millis(40), 100), &stall).is_empty());
}

#[test]
fn what_waits_may_be_as_old_as_the_machine_was_late_and_not_one_quantum_older() {
    let late = Duration::from_millis(15);
    for (early, reported) in [(Duration::ZERO, false), (QUANTUM, true)] {
        let mut bench = Bench::new();
        for n in 0..22 {
            // The first is read late, so that the others seem to follow sooner.
            if n == 0 {
                bench.until(SimTime::from_secs(1) + late);
                bench.device.late(bench.now, late, Duration::ZERO);
            } else {
                let span = Duration::from_secs(1) / 21 * n;
                bench.until(SimTime::from_secs(1) + span);
            }
            if n == 21 {
                bench.until(SimTime::from_secs(2) - early);
            }
            bench.drive(100, 100);
        }
        assert_eq!(bench.codes().contains(&"over_rate"), reported, "{early:?}");
    }
}

proptest! {
    #[test]
    fn no_stalls_make_a_client_at_20_hz_seem_too_fast(
        stalls in prop::collection::vec((1_u64..1500, 1_u64..700), 0..12),
    ) {
        let mut from = Duration::ZERO;
        let stalls: Vec<Stall> = stalls
            .into_iter()
            .map(|(wait, by)| {
                let by = Duration::from_millis(by);
                let begins = from + Duration::from_millis(wait);
                from = begins + by;
                (begins, by)
            })
            .collect();
        prop_assert_eq!(over_rates(every(INTERVAL, 300), &stalls), []);
    }
}

#[test]
fn seconds_are_counted_in_which_a_client_is_too_fast() {
    let found = over_rates(every(Duration::from_millis(10), 500), &[]);
    assert_eq!(found.len(), 5, "{found:?}");
}

#[test]
fn a_choice_that_ignores_commands_takes_those_that_piled_up() {
    let mut bench = Bench::with(|s| s.over_rate = OverRate::Ignore);
    bench.after(Duration::from_secs(1));
    assert!(bench.drive(100, 100).is_some());
    bench.device.late(bench.now, INTERVAL, INTERVAL);
    // Its reply is held all the same.
    assert_eq!(bench.drive(200, 200), None);
    assert_eq!(bench.duty(), [0.2, 0.2]);
    assert_eq!(bench.drive(300, 300), None);
    bench.until(SimTime::from_secs(1) + INTERVAL);
    assert!(bench.reply().is_some());
}

#[test]
fn a_held_reply_tells_what_is_measured_when_it_goes() {
    let mut bench = Bench::new();
    assert!(bench.drive(100, 100).is_some());
    bench.after(Duration::from_millis(20));
    assert_eq!(bench.drive(200, 200), None);
    assert_eq!(bench.duty(), [0.2, 0.2], "it takes effect at once");
    bench.read(|r| r.soc = 0.5);
    bench.until(SimTime::ZERO + INTERVAL);
    let frame = bench.reply().unwrap();
    assert_eq!(u16::from_le_bytes([frame[8], frame[9]]), 500);
}

#[test]
fn other_over_rates_answer_all_or_none() {
    for (over_rate, answered) in [(OverRate::Answer, 10), (OverRate::Silent, 1)] {
        let mut bench = Bench::with(|s| s.over_rate = over_rate);
        let mut replies = 0;
        for _ in 0..10 {
            replies += usize::from(bench.drive(100, 100).is_some());
            bench.after(Duration::from_millis(1));
        }
        assert_eq!(replies, answered);
        assert_eq!(bench.duty(), [0.1, 0.1]);
    }
}

#[test]
fn the_emergency_stop_may_cut_the_tail_supply() {
    for cuts in [false, true] {
        let mut bench = Bench::with(|s| s.emergency_stop_cuts_tail = cuts);
        bench
            .device
            .operate(bench.now, OperatorInput::EmergencyStop(true));
        assert_eq!(bench.device.commands().tail_power, !cuts);
    }
}

#[test]
fn driving_may_release_the_brake_by_itself() {
    let mut bench = Bench::with(|s| s.driving_needs_release = false);
    bench.device.operate(bench.now, OperatorInput::Park);
    assert!(bench.device.commands().parking_brake);
    bench.drive(500, 500);
    assert_eq!(
        (bench.duty(), bench.device.commands().parking_brake),
        ([0.5, 0.5], false)
    );
    bench.after(WATCHDOG);
    assert!(bench.device.commands().parking_brake);
}

#[test]
fn replies_spread_evenly_up_to_what_is_set_and_keep_their_order() {
    let spread = Duration::from_millis(4);
    let mut bench = Bench::with(|s| s.reply_spread = spread);
    let mut took = Vec::new();
    for _ in 0..200 {
        let asked = bench.now;
        bench
            .device
            .handle_bytes(asked, &Request::Heartbeat.encode());
        while bench.device.poll_output().is_none() {
            bench.after(Duration::from_micros(50));
        }
        took.push(bench.now.since(asked));
        bench.after(spread);
    }
    let mean = took.iter().sum::<Duration>() / 200;
    assert!(
        took.iter()
            .all(|took| *took <= spread + Duration::from_micros(50))
    );
    assert!((1700..2300).contains(&mean.as_micros()), "{mean:?}");
    for request in [Request::Heartbeat, Request::Version, Request::GetPwmOutputs] {
        bench.device.handle_bytes(bench.now, &request.encode());
    }
    bench.after(spread);
    let order: Vec<u8> = std::iter::from_fn(|| bench.device.poll_output())
        .map(|frame| frame[3])
        .collect();
    assert_eq!(order, [0x07, 0xF0, 0x04]);
}

#[test]
fn other_commands_have_no_rate_limit() {
    let mut bench = Bench::new();
    for _ in 0..100 {
        assert!(bench.ask(Request::SystemInfo).is_some());
    }
}

#[test]
fn over_rate_delay_answers_once_when_the_interval_has_passed() {
    let mut bench = Bench::with(|s| s.over_rate = OverRate::Delay);
    assert!(bench.drive(100, 100).is_some());
    for _ in 0..5 {
        bench.after(Duration::from_millis(1));
        assert_eq!(bench.drive(200, 200), None);
    }
    bench.until(SimTime::ZERO + INTERVAL - QUANTUM);
    assert_eq!(bench.reply(), None);
    bench.after(QUANTUM);
    assert!(bench.reply().is_some());
    bench.after(INTERVAL * 3);
    assert_eq!(bench.reply(), None);
}

/// What keeps it from moving, as the event says.
fn obstacles(bench: &mut Bench) -> Vec<Obstacle> {
    bench.events();
    assert!(
        bench.drive(500, 500).is_some(),
        "it is answered in every state"
    );
    bench.after(INTERVAL);
    let events = bench.events();
    let event = events.iter().find(|event| event.code() == NOT_DRIVING);
    let words = event.map(EventKind::to_string).unwrap_or_default();
    let all = Obstacle::ALL.into_iter();
    all.filter(|obstacle| words.contains(obstacle.as_str()))
        .collect()
}

#[test]
fn started_locked_it_says_what_is_missing_until_every_button_is_pressed() {
    let mut bench = Bench::start(at_once(), Start::Locked);
    let commands = bench.device.commands();
    assert!(commands.parking_brake);
    assert_eq!(
        obstacles(&mut bench),
        [Obstacle::Locked, Obstacle::Parked, Obstacle::Remote]
    );
    assert_eq!(bench.duty(), [0.0, 0.0]);
    // The parking brake cannot be released while it is locked.
    bench
        .device
        .operate(bench.now, OperatorInput::ReleaseParking);
    assert!(bench.device.commands().parking_brake);
    bench.device.operate(bench.now, OperatorInput::Unlock);
    assert_eq!(obstacles(&mut bench), [Obstacle::Parked, Obstacle::Remote]);
    bench
        .device
        .operate(bench.now, OperatorInput::ReleaseParking);
    assert!(!bench.device.commands().parking_brake);
    assert_eq!(obstacles(&mut bench), [Obstacle::Remote]);
    assert!(
        !bench.device.commands().propulsion_power,
        "released, it can be pushed"
    );
    bench.device.operate(bench.now, OperatorInput::Autonomous);
    assert_eq!(obstacles(&mut bench), []);
    assert_eq!(bench.duty(), [0.5, 0.5]);
    bench
        .device
        .operate(bench.now, OperatorInput::EmergencyStop(true));
    assert_eq!(obstacles(&mut bench), [Obstacle::EmergencyStop]);
    assert!(!bench.device.commands().propulsion_power);
    assert!(bench.device.commands().parking_brake);
    bench
        .device
        .operate(bench.now, OperatorInput::EmergencyStop(false));
    assert_eq!(obstacles(&mut bench), []);
    bench.device.operate(bench.now, OperatorInput::Lock);
    assert_eq!(obstacles(&mut bench), [Obstacle::Locked, Obstacle::Parked]);
}

#[test]
fn the_emergency_stop_leaves_the_rails_on() {
    let mut bench = Bench::new();
    bench.power(0b11_1111);
    bench
        .device
        .operate(bench.now, OperatorInput::EmergencyStop(true));
    assert_eq!(bench.info().power_status, 0b11_1111);
}

#[test]
fn the_emergency_stop_may_leave_the_brake_released() {
    let mut bench = Bench::with(|s| s.emergency_stop_brakes = false);
    bench
        .device
        .operate(bench.now, OperatorInput::EmergencyStop(true));
    assert!(!bench.device.commands().parking_brake);
    assert!(!bench.device.commands().propulsion_power);
}

#[test]
fn locking_may_leave_the_brake_released() {
    let mut bench = Bench::with(|s| s.locking_parks = false);
    bench.device.operate(bench.now, OperatorInput::Lock);
    assert!(!bench.device.commands().parking_brake);
    assert_eq!(obstacles(&mut bench), [Obstacle::Locked]);
}

#[test]
fn any_motion_key_switches_to_remote_mode_and_drives() {
    for (key, duty) in [
        (Key::Forward, [0.5, 0.5]),
        (Key::Backward, [-0.5, -0.5]),
        (Key::Left, [0.5, -0.5]),
        (Key::Right, [-0.5, 0.5]),
    ] {
        let mut bench = Bench::new();
        bench.drive(1000, 1000);
        bench.device.operate(bench.now, OperatorInput::Press(key));
        assert_eq!(bench.duty(), duty, "{key:?}");
        bench.after(INTERVAL);
        assert_eq!(obstacles(&mut bench), [Obstacle::Remote]);
        bench.device.operate(bench.now, OperatorInput::ReleaseKey);
        assert_eq!(bench.duty(), [0.0, 0.0]);
        bench.device.operate(bench.now, OperatorInput::Autonomous);
        assert_eq!(
            bench.duty(),
            [0.5, 0.5],
            "the client's command still stands"
        );
    }
}

#[test]
fn an_empty_battery_stops_the_motors() {
    let mut bench = Bench::new();
    bench.drive(1000, 1000);
    bench.read(|r| r.soc = 0.0);
    assert_eq!(bench.duty(), [0.0, 0.0]);
    bench.after(INTERVAL);
    assert_eq!(obstacles(&mut bench), [Obstacle::BatteryEmpty]);
}

#[test]
fn standing_still_is_never_an_event() {
    let mut bench = Bench::start(at_once(), Start::Locked);
    assert!(bench.drive(0, 0).is_some());
    assert_eq!(bench.codes(), [""; 0]);
}

#[test]
fn the_emergency_stop_may_lock_the_vehicle() {
    let mut bench = Bench::with(|s| s.emergency_stop_locks = true);
    bench
        .device
        .operate(bench.now, OperatorInput::EmergencyStop(true));
    bench
        .device
        .operate(bench.now, OperatorInput::EmergencyStop(false));
    assert_eq!(obstacles(&mut bench), [Obstacle::Locked, Obstacle::Parked]);
}

#[test]
fn an_empty_battery_may_let_the_motors_run() {
    let mut bench = Bench::with(|s| s.empty_battery_stops = false);
    bench.drive(1000, 1000);
    bench.read(|r| r.soc = 0.0);
    assert_eq!(bench.duty(), [1.0, 1.0]);
    bench.after(INTERVAL);
    assert_eq!(obstacles(&mut bench), []);
}
