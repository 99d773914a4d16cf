use std::time::Duration;

use proptest::prelude::*;

use crate::*;

words! {
    /// What to do.
    pub enum Action {
        /// Nothing.
        Hold = "hold",
        /// Something.
        Go = "go",
    }
}

settings! {
    /// The pack.
    pub struct Pack {
        /// Charge at the start.
        initial_soc: f64 = 80.0, unit "%", range 0.0..=100.0, assumed "a typical charge";
        /// What to do when empty.
        when_empty: Action = Action::Hold, assumed "a guess";
    }
}

settings! {
    /// The module.
    pub struct Module {
        /// Silence after which
        /// control goes back.
        timeout: Duration = Duration::from_secs(3),
            range Duration::from_millis(1)..=Duration::from_secs(3600), documented "4.3.6";
        /// Speed of the line.
        baud: u32 = 115_200, unit "baud", range 1..=4_000_000, documented "4.1";
        /// Loads.
        loads: [f64; 2] = [1.0, 2.5], unit "W", range 0.0..=10.0, assumed "nothing";
        /// Whether.
        flag: bool = false, assumed "nothing";
        /// Optional.
        link_timeout: Option<Duration> = None, assumed "no watchdog is documented";
    }
    groups {
        /// Its supply.
        pack: Pack,
    }
}

settings! {
    /// The root.
    pub struct Tree {}
    groups { r150: Module }
}

fn tree() -> Tree {
    Tree::default()
}

#[test]
fn what_is_shown_loads_back_unchanged() {
    let mut changed = tree();
    changed.r150.timeout = Duration::from_millis(1500);
    changed.r150.pack.when_empty = Action::Go;
    changed.r150.loads = [0.1, 10.0];
    changed.r150.link_timeout = Some(Duration::from_millis(5));
    let text = show_toml(&changed);
    let mut loaded = tree();
    load_toml(&text, "shown", &mut loaded).unwrap();
    assert_eq!(loaded, changed);
    assert!(text.contains("# documented: 4.3.6\n"), "{text}");
    assert!(
        text.contains("# default: \"3s\"\ntimeout = \"1500ms\"\n"),
        "{text}"
    );
}

fn error_of(text: &str) -> String {
    let errors = load_toml(text, "my.toml", &mut tree()).unwrap_err();
    assert_eq!(errors.len(), 1, "{errors:?}");
    errors[0].to_string()
}

#[test]
fn errors_name_file_line_key_and_what_is_allowed() {
    assert_eq!(
        error_of("# comment\n[r150]\ntimeout = \"0s\"\n"),
        "my.toml:3:11: `r150.timeout`: \"0s\" is out of range; allowed: a time from 1ms to 1h"
    );
    assert_eq!(
        error_of("r150.timout = \"1s\""),
        "my.toml:1:6: no setting is named `r150.timout`, did you mean `r150.timeout`?; \
         `sim config` lists them all"
    );
    assert_eq!(
        error_of("[r150.pack]\n\nwhen_empty = \"stop\""),
        "my.toml:3:14: `r150.pack.when_empty`: \"stop\" is not one of the choices; \
         allowed: \"hold\", \"go\""
    );
    assert_eq!(
        error_of("[r150]\npack = 3"),
        "my.toml:2:1: `r150.pack` is a group of settings, not a setting: name one in it, \
         as in `r150.pack.initial_soc`"
    );
    assert!(error_of("[r1500]\n").starts_with("my.toml:1:2: no setting is named `r1500`"));
    load_toml("[r150]\n[r150.pack]\n", "f", &mut tree()).unwrap();
    assert!(error_of("[r150\n").starts_with("my.toml:1:"));
    for bare in [
        "[r150]\ntimeout = 5",
        "[r150]\nbaud = 9600",
        "[r150.pack]\ninitial_soc = 5.0",
    ] {
        assert!(error_of(bare).contains("lacks a unit"), "{bare}");
    }
    assert!(error_of("[r150]\nloads = [\"1 W\"]").contains("2 values are wanted, 1 given"));
    assert!(
        error_of("[r150]\nloads = [\"1 W\", \"5 V\"]").contains("`V` is not a unit of it; use W")
    );
    assert!(error_of("[r150.pack]\ninitial_soc = \"nan %\"").contains("not a finite number"));
    assert!(error_of("[r150.pack]\ninitial_soc = \"inf %\"").contains("not a finite number"));
    assert!(error_of("[r150.pack]\ninitial_soc = 1979-05-27").contains("a date"));
    assert!(error_of("[r150.pack]\ninitial_soc = { a = 1 }").contains("initial_soc.a"));
}

#[test]
fn all_errors_of_a_file_are_reported_at_once() {
    let text = "[r150]\ntimeout = \"0s\"\nbaud = 0\nwrong = 1\n";
    assert_eq!(load_toml(text, "f", &mut tree()).unwrap_err().len(), 3);
}

#[test]
fn flags_take_words_quantities_and_literals() {
    let mut tree = tree();
    for text in [
        "r150.timeout=5s",
        "r150.pack.when_empty=go",
        "r150.loads=[\"3 W\", \"2 W\"]",
        "r150.baud=9600 Bd",
        "r150.flag=true",
        "r150.link_timeout=off",
        "r150.pack.initial_soc=50 %",
    ] {
        let (key, value) = parse_assignment("--set", text).unwrap();
        set(
            &mut tree,
            &key,
            &value,
            Origin::Flag(format!("--set {text}")),
        )
        .unwrap();
    }
    assert_eq!(tree.r150.timeout, Duration::from_secs(5));
    assert_eq!(tree.r150.loads, [3.0, 2.0]);
    assert_eq!(tree.r150.baud, 9600);
    assert!(tree.r150.flag);
    assert_eq!(tree.r150.pack.initial_soc, 50.0);
    let error = parse_assignment("--set", "r150.baud")
        .unwrap_err()
        .to_string();
    assert!(error.contains("KEY=VALUE"), "{error}");
}

#[test]
fn quantities_convert_between_units() {
    assert_eq!(parse_quantity("250 mA", "A"), Ok(0.25));
    assert_eq!(parse_quantity("1.5kW", "W"), Ok(1500.0));
    assert_eq!(parse_quantity("1e-3 V", "mV"), Ok(1.0));
    assert_eq!(parse_quantity("12", ""), Ok(12.0));
    assert_eq!(
        parse_quantity("12", "V"),
        Err("12 lacks a unit, as in \"12 V\"".to_owned())
    );
    assert_eq!(parse_quantity("3.6 km/h", "m/s"), Ok(1.0));
    assert!(parse_quantity("12", "s").is_err());
    assert!(parse_quantity("V", "V").is_err());
    assert!(parse_quantity("nan V", "V").is_err());
    assert!(parse_quantity("inf", "V").is_err());
    assert!(parse_quantity("1 A", "V").is_err());
    assert!(parse_quantity("1 A", "").is_err());
}

#[test]
fn times_print_and_round() {
    assert_eq!(SimTime::from_millis(1234).to_string(), "1.234000");
    assert_eq!(
        SimTime::from_millis(7).next_multiple(Duration::from_millis(5)),
        SimTime::from_millis(10)
    );
    assert_eq!(
        SimTime::from_millis(5).next_multiple(Duration::from_millis(5)),
        SimTime::from_millis(10)
    );
    assert_eq!(SimTime::ZERO.since(SimTime::MAX), Duration::ZERO);
    assert_eq!(SimTime::MAX + Duration::MAX, SimTime::MAX);
    for (nanos, shown) in [
        (0, "0ms"),
        (52_345_678, "52.346ms"),
        (300_000_000, "300ms"),
        (1_500_000_001, "1.5s"),
    ] {
        assert_eq!(show_rounded(Duration::from_nanos(nanos)), shown);
    }
}

proptest! {
    #[test]
    fn any_text_is_judged_without_panic(text in "\\PC{0,60}") {
        let _ = load_toml(&text, "f", &mut tree());
        let _ = parse_quantity(&text, "V");
        if let Ok((key, value)) = parse_assignment("--set", &text) {
            let _ = set(&mut tree(), &key, &value, Origin::Flag(String::new()));
        }
    }

    #[test]
    fn any_duration_reads_back(nanos in 0u64..u64::MAX / 4) {
        let span = Duration::from_nanos(nanos);
        // Through f64 a span keeps 53 bits.
        let read = Duration::read(&Value::Text(show_duration(span)), "").unwrap();
        let error = span.abs_diff(read).as_nanos() as f64;
        prop_assert!(error <= nanos as f64 * 1e-15 + 0.5);
    }
}

#[test]
fn an_error_does_not_repeat_what_is_endless() {
    let endless = "k".repeat(1_000_000);
    for text in [
        format!("{endless} = 1"),
        format!("r150.baud = \"{endless}\""),
        format!("r150.{endless}"),
    ] {
        let errors = load_toml(&text, "my.toml", &mut Tree::default()).unwrap_err();
        let error = errors[0].to_string();
        assert!(error.len() < 2000, "{} bytes", error.len());
        assert!(error.starts_with("my.toml:1:"), "{error}");
    }
}

/// Every key is there with its range, its units and its default, in the table of its group.
#[test]
fn the_schema_types_every_key_and_allows_no_other() {
    let schema = crate::schema_of(&Module::default()).to_value();
    assert_eq!(schema["additionalProperties"], false);
    let entries = Module::default().entries();
    assert!(entries.len() > 3);
    for entry in entries {
        let mut own = &schema;
        for name in entry.key.split('.') {
            own = &own["properties"][name];
        }
        assert!(own["description"].is_string(), "{}", entry.key);
        assert!(!own["default"].is_null(), "{}", entry.key);
        assert_ne!(own["type"], "object", "{}", entry.key);
    }
    let unit = crate::quantity::pattern;
    assert!(unit("kg*m^2").ends_with(" *(kg\\*m\\^2)$"));
    assert!(unit("s").ends_with("|h)$"));
    let share = <f64 as crate::SettingValue>::allowed("", Some(&(1.0..=60.0)));
    let share = share.schema.to_value();
    assert_eq!(share["minimum"], 1.0);
    assert_eq!(share["maximum"], 60.0);
}
