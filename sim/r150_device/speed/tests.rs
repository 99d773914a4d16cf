use super::*;

/// Speeds shown every millisecond of a motor that turns at 600 rpm from 0 on.
fn shown(change: impl FnOnce(&mut R150FirmwareSettings)) -> Vec<f64> {
    let mut settings = R150FirmwareSettings::default();
    change(&mut settings);
    let mut meter = Speedometer::new(&settings, SimTime::ZERO, 0.0);
    (1..=1000_u32)
        .map(|ms| {
            meter.read(SimTime::from_millis(ms.into()), f64::from(ms) * 0.01);
            meter.rpm
        })
        .collect()
}

#[test]
fn it_lags_by_its_window_and_its_filter_and_gets_there() {
    let plain = shown(|s| s.speed_filter = Duration::ZERO);
    assert_eq!(plain[18], 0.0);
    // 204 whole pulses of 204.8.
    assert!((plain[19] - 597.656).abs() < 0.001, "{}", plain[19]);
    let filtered = shown(|s| s.speed_filter = Duration::from_millis(100));
    assert!(
        filtered[99] > 200.0 && filtered[99] < 450.0,
        "{}",
        filtered[99]
    );
    assert!((filtered[999] - 600.0).abs() < 1.0);
}

#[test]
fn after_a_long_pause_it_shows_what_was_on_average() {
    let settings = R150FirmwareSettings::default();
    let mut meter = Speedometer::new(&settings, SimTime::ZERO, 0.0);
    meter.read(SimTime::from_millis(20), 0.2);
    meter.read(SimTime::from_secs(3600), 0.2);
    assert_eq!(meter.rpm, 0.0);
}
