//! Any faults, any bytes: no panic, and the same again on every run.

use proptest::prelude::*;

use super::*;

fn any_fault() -> impl Strategy<Value = String> {
    let ids: Vec<&str> = faults().map(|info| info.id).collect();
    let wild = vec![
        "kind = \"delay\"\nby = \"500 h\"\njitter = \"1 h\"",
        "kind = \"delay\"\nby = \"0 s\"\njitter = \"0 s\"",
        "kind = \"burst\"\nlength = 0\nprobability = 1",
        "kind = \"fragmentation\"\nsize = 0\npause = \"0 s\"",
        "kind = \"fragmentation\"\nsize = 1\npause = \"1 h\"\ndirection = \"both\"",
        "kind = \"duplicated-bytes\"\nprobability = 1",
        "kind = \"inserted-bytes\"\nprobability = 1",
        "kind = \"reply-twice\"",
        "kind = \"wrong-baud\"\nbaud = 0",
        "kind = \"wrong-baud\"\nbaud = 4294967295",
        "kind = \"idle-noise\"\nevery = \"0 s\"\ndirection = \"both\"",
        "kind = \"unsolicited-frame\"\nevery = \"0 s\"",
        "kind = \"wrong-length\"\nby = -128",
        "kind = \"wrong-length\"\nby = 127",
        "kind = \"wrong-length\"\nby = 127\nwhat = \"field\"",
        "kind = \"late-reply\"\nby = \"1 h\"",
        "kind = \"slow-replies\"\nby = \"300 h\"",
        "kind = \"reset\"\nboot = \"0 s\"",
        "kind = \"reset\"\nboot = \"300 h\"",
        "kind = \"payload\"\nmass = \"10000 kg\"",
        "kind = \"push\"\nahead = \"100000 N\"\nturn = \"-100000 N*m\"",
        "kind = \"supply-sag\"\nby = \"1000 V\"\nresistance = \"10 ohm\"",
        "kind = \"ice\"\nfriction = 0",
        "kind = \"encoder-noisy\"\nmotors = \"all\"\npulses_per_second = 65535",
        "kind = \"encoder-noisy\"\nmotors = \"all\"\nspread_rpm = 65535",
        "kind = \"dragging\"\nmotors = \"all\"\ntorque = \"100000 N*m\"",
        "kind = \"rail-load\"\nrail = \"5v\"\nresistance = \"0 ohm\"",
        "kind = \"ultrasonic-ghost\"\ndistance = \"-10000 m\"",
    ];
    prop_oneof![
        3 => prop::sample::select(ids).prop_map(sample),
        1 => prop::sample::select(wild).prop_map(str::to_owned),
    ]
}

#[derive(Debug, Clone)]
enum Action {
    Inject(String),
    Clear(usize),
    Send(usize, Vec<u8>),
    Leave,
}

fn actions() -> impl Strategy<Value = Vec<(u64, Action)>> {
    let motors = (any::<i16>(), any::<i16>())
        .prop_map(|(right, left)| Request::SetMotors { right, left }.encode());
    let moves = (0_u8..6, any::<u16>(), any::<i16>()).prop_map(|(idx, s, v)| motion(idx, s, v));
    let power = any::<u32>().prop_map(|status| Request::PowerControl { on: status }.encode());
    let bytes = prop_oneof![
        3 => motors,
        3 => moves,
        1 => power,
        1 => Just(Request::SystemInfo.encode()),
        1 => Just(b"X10 \n".to_vec()),
        1 => prop::collection::vec(any::<u8>(), 0..40),
    ];
    let action = prop_oneof![
        4 => any_fault().prop_map(Action::Inject),
        2 => any::<prop::sample::Index>().prop_map(|index| Action::Clear(index.index(64))),
        5 => (0_usize..3, bytes).prop_map(|(port, bytes)| Action::Send(port, bytes)),
        1 => Just(Action::Leave),
    ];
    prop::collection::vec((0_u64..150_000_000, action), 0..24)
}

const PORTS: [PortId; 3] = [
    MAIN,
    PortId { device: 1, link: 0 },
    PortId { device: 1, link: 1 },
];

/// Everything that can be seen of a run.
fn transcript(seed: u64, actions: &[(u64, Action)], ask_often: bool) -> String {
    let mut rig = r150_with(seed, |_| {});
    let pose = Pose {
        x: 1.2,
        ..Pose::default()
    };
    let settings = MecanumSettings::default();
    let setup = Setup {
        links: 2,
        pose,
        ..Setup::new("car", &settings)
    };
    rig.add(&crate::mecanum::MECANUM_SPEC, &setup);
    for port in PORTS {
        rig.attach(port, SimTime::ZERO).unwrap();
    }
    let mut bytes: [Vec<u8>; 3] = Default::default();
    let mut handles = Vec::new();
    let mut now = SimTime::ZERO;
    for (pause, action) in actions {
        now += Duration::from_nanos(*pause);
        while rig.now() + MS(20) < now {
            let next = rig.now() + MS(20);
            while let Some(due) = rig.next_deadline().filter(|due| ask_often && *due < next) {
                rig.advance(due).unwrap();
                read_all(&mut rig, &mut bytes);
            }
            rig.advance(next).unwrap();
            read_all(&mut rig, &mut bytes);
        }
        rig.advance(now).unwrap();
        match action {
            Action::Inject(fault) => {
                for device in 0..2 {
                    handles.extend(rig.inject(device, "any", fault));
                }
            }
            Action::Clear(index) => {
                if let Some(handle) = handles.get(index % handles.len().max(1)) {
                    rig.clear(*handle);
                }
            }
            Action::Send(port, bytes) => rig.client_sends(PORTS[*port], now, bytes).unwrap(),
            Action::Leave => {
                // What is unread then is lost, so it has to be read up to here in any case.
                for (port, bytes) in PORTS.into_iter().zip(&mut bytes) {
                    rig.client_reads(port, bytes);
                    rig.detach(port, now).unwrap();
                    rig.attach(port, now).unwrap();
                }
            }
        }
    }
    // A client that does not read loses what does not fit, so these read now and then.
    for _ in 0..50 {
        now += MS(40);
        rig.advance(now).unwrap();
        read_all(&mut rig, &mut bytes);
    }
    let hits: Vec<u64> = handles.iter().map(|own| rig.hits(*own)).collect();
    let events: Vec<String> = std::iter::from_fn(|| rig.poll_event())
        .map(|event| format!("{} {} {}", event.at, event.device, event.kind))
        .collect();
    let truths = (
        rig.device::<R150>(0).unwrap().truth(),
        rig.device::<Mecanum>(1).unwrap().truth(),
    );
    format!("{bytes:?}\n{hits:?}\n{events:#?}\n{truths:?}")
}

fn read_all(rig: &mut Rig, bytes: &mut [Vec<u8>; 3]) {
    for (port, bytes) in PORTS.into_iter().zip(bytes) {
        rig.client_reads(port, bytes);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn any_faults_on_any_bytes_are_the_same_again(actions in actions(), seed: u64) {
        let once = transcript(seed, &actions, false);
        prop_assert_eq!(&once, &transcript(seed, &actions, false));
        // However often the time is looked at in between.
        prop_assert_eq!(&once, &transcript(seed, &actions, true));
    }
}

#[test]
fn another_fault_does_not_shift_a_random_one() {
    let flips = |other: bool| {
        let mut rig = r150();
        if other {
            rig.inject(
                0,
                "other",
                "kind = \"idle-noise\"\ndirection = \"to-device\"",
            )
            .unwrap();
            rig.inject(
                0,
                "third",
                "kind = \"bit-flips\"\ndirection = \"to-device\"",
            )
            .unwrap();
        }
        let fault = "kind = \"bit-flips\"\nprobability = 0.1\ndirection = \"to-client\"";
        rig.inject(0, "flips", fault).unwrap();
        let mut bytes = Vec::new();
        for _ in 0..50 {
            // Not asked for, since the others spoil requests.
            rig.inject(0, "frame", "kind = \"unsolicited-frame\"")
                .unwrap();
            bytes.extend(run(&mut rig, MAIN, MS(10)));
        }
        bytes
    };
    let (alone, together) = (flips(false), flips(true));
    assert_eq!(alone, together);
    assert_eq!(alone.len(), 350);
}

#[test]
fn armed_again_a_fault_draws_other_numbers_and_the_bounds_hold() {
    let mut rig = r150();
    let flips = "kind = \"bit-flips\"\nprobability = 1\ncount = 1\ndirection = \"to-client\"";
    let mut seen = std::collections::BTreeSet::new();
    for _ in 0..12 {
        let handle = rig.inject(0, "again", flips).unwrap();
        seen.insert(ask(&mut rig, Request::Heartbeat));
        rig.clear(handle);
    }
    assert!(seen.len() > 2, "{seen:?}");
    let armed = (0..300).filter(|_| rig.inject(0, "many", flips).is_ok());
    assert_eq!(armed.count(), crate::device::MOST_ARMED);
    assert_eq!(rig.inject(0, "many", flips), Err(EffectError::TooMany));
    assert_eq!(ask(&mut rig, Request::Heartbeat).len(), 7);
}

#[test]
fn a_client_that_does_not_read_loses_whole_packets_whatever_is_broken() {
    let mut rig = car(false);
    inject(
        &mut rig,
        "kind = \"bit-flips\"\nprobability = 0\nlink = \"main\"",
    );
    rig.advance(SimTime::from_secs(100)).unwrap();
    let mut unread = Vec::new();
    rig.client_reads(MAIN, &mut unread);
    assert!(unread.len() > 12_000, "{} bytes", unread.len());
    assert_eq!(unread.len() % 39, 0, "{} bytes", unread.len());
    assert!(unread.chunks(39).all(|packet| packet.starts_with(&[0, 39])));
    let dropped = std::iter::from_fn(|| rig.poll_event())
        .filter(|event| event.kind.code().name == "line_full")
        .count();
    assert!(dropped > 0, "and it is reported");
}

#[test]
fn what_a_stall_let_go_is_due_for_no_client_when_its_client_has_left() {
    let mut rig = car(true);
    let stall = inject(
        &mut rig,
        "kind = \"stall\"\ndirection = \"to-client\"\nlink = \"ros\"",
    );
    assert_eq!(run(&mut rig, ROS, MS(500)), NOTHING);
    let now = rig.now();
    for port in [MAIN, ROS] {
        rig.detach(port, now).unwrap();
    }
    rig.clear(stall);
    rig.advance(now).unwrap();
    assert!(rig.next_deadline().unwrap() > now);
    // Nor does the next one get it.
    rig.attach(ROS, now).unwrap();
    let mut bytes = Vec::new();
    rig.client_reads(ROS, &mut bytes);
    assert_eq!(bytes, NOTHING);
}
