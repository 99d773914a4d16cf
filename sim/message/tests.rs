//! What declarations say, beside what the messages do.

use std::collections::BTreeSet;

use super::*;
use crate::SHIPPED;
use crate::device::names::{Getter, Unit};
use crate::event::code::{REPLY, REQUEST};
use crate::mecanum_device::packet::Status;
use crate::r150_device::command::{Motors, Reply, Request, SystemInfo};
use crate::r150_device::event::passed;

#[test]
fn declarations_of_every_device_hold_together() {
    for device in SHIPPED {
        let mut seen = BTreeSet::new();
        for info in device.all_messages() {
            let key = (info.sender == Sender::Device, info.link, info.id);
            assert!(
                seen.insert(key),
                "{}: {} has another's id",
                device.id,
                info.name
            );
            assert!(device.links.get(info.link).is_some(), "{}", info.name);
            assert!(info.text.len() > 4, "{}", info.name);
            let end = info
                .layout()
                .last()
                .map_or(0, |(at, field)| at + field.size());
            assert!(
                end <= info.length,
                "{}: {end} of {}",
                info.name,
                info.length
            );
            let names: BTreeSet<&str> = info.fields.iter().map(|field| field.name).collect();
            assert_eq!(names.len(), info.fields.len(), "{}", info.name);
            for field in info.fields {
                assert!(field.text.len() > 4, "{}.{}", info.name, field.name);
                let count = field.count.unwrap_or(1);
                assert!([0, 1, count].contains(&field.named.len()), "{}", field.name);
                let labels = match field.wire {
                    WireType::Bool => 1,
                    _ => field.bits.len() + field.values.len(),
                };
                assert!([0, labels].contains(&field.flags.len()), "{}", field.name);
                let flags: Vec<&str> = field.flags.iter().map(|(name, _)| *name).collect();
                let names = field.named.iter().chain(&flags);
                for name in names.filter(|name| !name.is_empty()) {
                    let found = device.find_name(name).expect("a name");
                    let is_flag = flags.contains(name);
                    assert_eq!(found.unit == Unit::Flag, is_flag, "{name}");
                    assert!(
                        matches!(found.getter, Getter::Field(_) | Getter::Bit(_)),
                        "{name}"
                    );
                }
            }
        }
    }
}

#[test]
fn names_of_conditions_are_there_once() {
    for device in SHIPPED {
        let names: Vec<_> = device.all_names().collect();
        let unique: BTreeSet<&str> = names.iter().map(|info| info.name).collect();
        assert_eq!(unique.len(), names.len(), "{}", device.id);
    }
}

#[test]
fn the_layout_is_that_of_the_wire() {
    let layout: Vec<_> = SystemInfo::INFOS[0]
        .layout()
        .map(|(offset, field)| (offset, field.name, field.wire, field.count))
        .collect();
    use WireType::{I32, U8, U32};
    assert_eq!(
        layout,
        [
            (0, "voltage_12v", U32, Some(4)),
            (16, "voltage_48v", U32, None),
            (20, "current_12v", I32, Some(4)),
            (36, "current_48v", I32, None),
            (40, "temp_12v", I32, Some(2)),
            (48, "sys_status", U32, None),
            (52, "power_ctrl_mode", U8, None),
            (53, "pwm_ctrl_mode", U8, None),
            (54, "power_status", U8, None),
            (55, "pwm_status", U8, None),
        ]
    );
    assert_eq!(SystemInfo::INFOS[0].length, 76);
}

fn words(reply: Reply) -> String {
    passed(REPLY, reply.command(), reply.info(), reply.encode()).to_string()
}

#[test]
fn words_of_the_log() {
    let info = SystemInfo {
        voltage_12v: [12_010, 0, 11_980, 12_000],
        voltage_48v: 51_250,
        current_12v: [1500, 0, -250, 3125],
        current_48v: 7000,
        temp_12v: [313, -400],
        sys_status: 0b10_0010_0001,
        power_ctrl_mode: 1,
        pwm_ctrl_mode: 7,
        power_status: 0b1_0001,
        pwm_status: 0,
    };
    assert_eq!(
        words(Reply::SystemInfo(info)),
        "0x06 system_info voltage_12v [12.010, 0.000, 11.980, 12.000] V voltage_48v 51.250 V \
         current_12v [1.500, 0.000, -0.250, 3.125] A current_48v 7.000 A temp_12v [31.3, -40.0] \
         degC sys_status overcurrent_ab+over_temperature_cd+0x200 power_ctrl_mode app \
         pwm_ctrl_mode 7 power_status 12v-a+48v pwm_status none"
    );
    let motors = Motors {
        right_rpm: 1511,
        left_rpm: -3,
        soc: 800,
    };
    assert_eq!(
        words(Reply::Motors(motors)),
        "0x12 set_motors right_rpm 1511 left_rpm -3 soc 80.0 %"
    );
    let [command, success] = [0x99, 0x02].map(|command| Reply::Bool {
        command,
        success: command == 0x02,
    });
    assert_eq!(words(command), "0x99 ? success false");
    assert_eq!(words(success), "0x02 power_control success true");
    let request = Request::Heartbeat;
    let asked = passed(REQUEST, request.command(), request.info(), request.encode());
    assert_eq!(asked.to_string(), "0x07 heartbeat");
    let status = Status {
        ori: -900,
        magn: 0x8001,
        moto_state: 3,
        ..Status::default()
    };
    let words = status.info().show(&status.payload()).to_string();
    assert!(words.starts_with(" seq 0 v_x 0 "), "{words}");
    assert!(words.contains(" ori -90.0 deg "), "{words}");
    assert!(words.contains(" magn 0x8001 "), "{words}");
    assert!(words.contains(" moto_state left+right "), "{words}");
}

#[test]
fn a_name_has_a_field_in_its_unit() {
    let values = |numbers: &[f64], field: &FieldInfo| {
        let named: Vec<_> = field.named_values(numbers).collect();
        named
    };
    let fields = SystemInfo::INFOS[0].fields;
    let of = |name| fields.iter().find(|field| field.name == name).unwrap();
    assert_eq!(
        values(&[51_250.0], of("voltage_48v")),
        [("reported.supply_v", 51.25)]
    );
    assert_eq!(
        values(&[313.0, 400.0], of("temp_12v")),
        [
            ("reported.temperature_ab_c", 31.3),
            ("reported.temperature_cd_c", 40.0)
        ]
    );
    let status = values(&[f64::from(0b100)], of("sys_status"));
    assert_eq!(status[0], ("reported.sys_status", 4.0));
    let set: Vec<_> = status[1..].iter().filter(|(_, bit)| *bit == 1.0).collect();
    assert_eq!(set, [&("reported.overcurrent_48v", 1.0)]);
    // A name for a list has its smallest element, and one of a value only that value.
    let front = Status::INFOS[0]
        .fields
        .iter()
        .find(|field| field.name == "ut_f")
        .unwrap();
    assert_eq!(
        values(&[7.0, 3.0, 9.0, 5.0], front),
        [("reported.front_mm", 3.0)]
    );
    let mode = &crate::mecanum_device::packet::Request::INFOS[2].fields[1];
    for (value, is_remote) in [(0.0, 0.0), (1.0, 1.0), (3.0, 0.0)] {
        assert_eq!(values(&[value], mode), [("client.asked_remote", is_remote)]);
    }
}

#[test]
fn a_payload_that_is_cut_short_has_the_fields_that_are_whole() {
    let info = &Motors::INFOS[0];
    let fields = info.fields(&[1, 0, 0xFF, 0xFF, 9]);
    let wanted = [
        ("right_rpm", Field::Number(1.0)),
        ("left_rpm", Field::Number(-1.0)),
    ];
    assert_eq!(fields, wanted);
    assert_eq!(Motors::take(0x12, &mut &[1, 0, 0][..]), None);
}

#[test]
fn lines_have_fields_too() {
    let [report] = &crate::mecanum_device::ascii::REPORTS;
    let wanted = [
        ("speed", Field::Number(-4.0)),
        ("mileage", Field::Number(500.0)),
    ];
    assert_eq!(report.fields(b"V-4 S500 \n"), wanted);
    assert_eq!(report.fields(b"X4 S500 \n"), []);
    assert_eq!(
        report.show(b"V4 S500 \n").to_string(),
        " speed 4 mileage 500"
    );
}
