use super::*;
use rigsim_core::SHIPPED;
use rigsim_core::device::names::Unit;
use rigsim_core::mecanum::MECANUM_SPEC;
use rigsim_core::r150::R150_SPEC;

/// Devices alone; with one, its name may be left out.
fn scope<'a>(devices: &'a Devices<'a>) -> Scope<'a> {
    static NONE: BTreeMap<String, Reading> = BTreeMap::new();
    Scope {
        devices,
        usual: (devices.len() == 1).then_some(0),
        saved: &[],
        parameters: &NONE,
    }
}

fn parse(text: &str) -> Result<Condition, ExpressionError> {
    Condition::parse(text, &scope(&[("r150", &R150_SPEC)]))
}

#[test]
fn names_are_sorted_into_groups_and_unique() {
    for device in SHIPPED {
        let mut seen = std::collections::BTreeSet::new();
        for info in device.all_names() {
            assert!(seen.insert(info.name), "{} twice", info.name);
            assert!(!info.meaning.is_empty());
            let text = match info.unit {
                Unit::Flag => info.name.to_owned(),
                Unit::Number(_) => format!("{} > 1", info.name),
            };
            Condition::parse(&text, &scope(&[("d", device)])).unwrap();
        }
    }
}

#[test]
fn what_makes_sense_is_read() {
    for text in [
        "truth.speed_mps < 1.5",
        "r150.truth.speed_mps * 2 <= 3",
        "t > 3 && !(rail.v48_on || client.asked_v48)",
        "abs(truth.y_m) + max(truth.x_m, 0) < min(1, 2.5)",
        "rail.v48_on == client.asked_v48",
        "t < 1 ? true : truth.at_rest",
        "-truth.x_m != 0x10",
        "true",
    ] {
        parse(text).unwrap_or_else(|why| panic!("{text}: {why}"));
    }
}

#[test]
fn what_makes_none_is_refused_in_words() {
    for (text, expected) in [
        ("truth.speed_mpss < 1.5", "did you mean `truth.speed_mps`?"),
        ("speed_mps < 1.5", "did you mean `truth.speed_mps`?"),
        (
            "r150.truth.sped_mps < 1",
            "did you mean `r150.truth.speed_mps`?",
        ),
        ("tank.x > 1", "names begin with `t` or a device: r150"),
        ("truth.speed_mps", "compare it"),
        (
            "truth.speed_mps && true",
            "`&&` wants true or false, this is a number",
        ),
        (
            "truth.at_rest < 1",
            "`<` wants a number, this is true or false",
        ),
        ("truth.at_rest == 1", "compares a number with true or false"),
        ("size('a') == 1", "only numbers"),
        ("sqrt(t) > 1", "`sqrt` is not known here"),
        ("t.abs() > 1", "`abs` is not known here"),
        ("abs(t, 1) > 1", "`abs` takes 1, not 2"),
        ("[1].exists(x, x > 0)", "no use here"),
        ("t >", "not finished"),
        ("", "not finished"),
        ("t % 2 == 0", "`%` is not known here"),
        ("t > 1 $ 2", "cannot be read from character"),
        (
            "t > 1 and t < 2",
            "from character 7 on: `and t < 2`; `and` is written `&&`",
        ),
        ("t > 1 or t < 0", "`or` is written `||`"),
        ("not truth.at_rest", "`not` is written `!`"),
        ("t = 1", "`==` compares"),
        ("truth.speed_mps < 1 m/s", "a number has no unit"),
        ("t in [1]", "no use here"),
        ("has(truth.x_m)", "not a name"),
    ] {
        let why = parse(text).expect_err(text).to_string();
        assert!(why.contains(expected), "{text}: {why}");
    }
    let deep = format!("{}true{}", "(".repeat(900), ")".repeat(900));
    assert!(parse(&deep).is_err());
    assert!(parse(&"!".repeat(1900)).is_err());
    assert!(parse(&format!("{}true", "true&&".repeat(300))).is_ok());
    assert!(
        parse(&"x".repeat(3000))
            .unwrap_err()
            .to_string()
            .contains("at most")
    );
}

#[test]
fn several_devices_have_to_be_named() {
    let devices = [("r150-1", &R150_SPEC), ("car", &MECANUM_SPEC)];
    let read = |text| Condition::parse(text, &scope(&devices));
    assert!(read("r150_1.mode.locked && car.motion.running").is_ok());
    let why = read("mode.locked").unwrap_err().to_string();
    assert!(why.contains("did you mean `r150_1.mode.locked`?"), "{why}");
    assert!(read("car.mode.locked").is_err());
}

#[test]
fn an_error_says_which_expression_and_where() {
    for (text, place) in [("t > 1 and t < 2", 6), ("t >", 3), ("", 0)] {
        match parse(text).unwrap_err() {
            ExpressionError::Unreadable { expression, at, .. } => {
                assert_eq!((expression.as_str(), at), (text, place));
            }
            other => panic!("{text}: {other:?}"),
        }
    }
    let unsound = parse("tank.x > 1").unwrap_err();
    assert!(
        matches!(&unsound, ExpressionError::Unsound { expression, .. } if expression == "tank.x > 1"),
        "{unsound:?}"
    );
}
