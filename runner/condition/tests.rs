use super::*;
use proptest::prelude::*;
use proptest::sample::select;
use rigsim_core::SHIPPED;
use rigsim_core::device::names::Unit;
use rigsim_core::line::Wire;
use rigsim_core::mecanum::MECANUM_SPEC;
use rigsim_core::r150::R150_SPEC;
use rigsim_core::rig::RigSettings;
use rigsim_physics::{WorldMap, WorldSettings};

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

/// Any expression without names: its text, and whether it is true or false.
fn any_expression() -> impl Strategy<Value = (String, bool)> {
    let number = prop_oneof!["[0-9]{1,2}\\.[05]", Just("0.0 / 0.0".to_owned())];
    let leaf = prop_oneof![
        number.prop_map(|text| (text, false)),
        any::<bool>().prop_map(|flag| (flag.to_string(), true)),
    ];
    leaf.prop_recursive(6, 40, 3, |part| {
        let number = part.clone().prop_map(|(text, is_flag)| match is_flag {
            true => format!("(({text}) ? 1.0 : 2.5)"),
            false => format!("({text})"),
        });
        let flag = part.prop_map(|(text, is_flag)| match is_flag {
            true => format!("({text})"),
            false => format!("(({text}) >= 3.0)"),
        });
        let (numbers, flags) = (
            (number.clone(), number.clone()),
            (flag.clone(), flag.clone()),
        );
        prop_oneof![
            (number.clone(), select(vec!["-", "abs"]))
                .prop_map(|(x, sign)| (format!("{sign}({x})"), false)),
            (numbers.clone(), select(vec!["+", "-", "*", "/"]))
                .prop_map(|((x, y), sign)| (format!("{x} {sign} {y}"), false)),
            (numbers.clone(), select(vec!["min", "max"]))
                .prop_map(|((x, y), name)| (format!("{name}({x}, {y})"), false)),
            (
                numbers.clone(),
                select(vec!["<", "<=", ">", ">=", "==", "!="])
            )
                .prop_map(|((x, y), sign)| (format!("{x} {sign} {y}"), true)),
            (flags.clone(), select(vec!["&&", "||", "==", "!="]))
                .prop_map(|((x, y), sign)| (format!("{x} {sign} {y}"), true)),
            flag.clone().prop_map(|x| (format!("!{x}"), true)),
            (flag.clone(), numbers).prop_map(|(x, (y, z))| (format!("{x} ? {y} : {z}"), false)),
            (flag, flags).prop_map(|(x, (y, z))| (format!("{x} ? {y} : {z}"), true)),
        ]
    })
}

/// What the library makes of an expression.
fn by_library(text: &str) -> Option<Reading> {
    let mut context = cel::Context::default();
    context.add_function("abs", |x: f64| x.abs()).unwrap();
    context
        .add_function("min", |x: f64, y: f64| x.min(y))
        .unwrap();
    context
        .add_function("max", |x: f64, y: f64| x.max(y))
        .unwrap();
    let program = cel::Program::compile(text).unwrap();
    match program.execute(&context).ok()? {
        cel::Value::Bool(flag) => Some(Reading::Flag(flag)),
        cel::Value::Float(number) => Some(Reading::Number(number)),
        other => panic!("{text}: {other:?}"),
    }
}

/// A run without devices.
fn nothing() -> Situation {
    Situation {
        rig: Rig::new(RigSettings {
            world: WorldSettings::default(),
            map: WorldMap::default(),
            wire: Wire::Bare,
            seed: 1,
        }),
        counters: Vec::new(),
        saved: Vec::new(),
        published: BTreeMap::new(),
    }
}

proptest! {
    #[test]
    fn any_expression_has_the_value_that_cel_says((text, is_flag) in any_expression()) {
        let nothing = nothing();
        let (condition, own) = Condition::parse_typed(&text, &scope(&[])).unwrap();
        prop_assert_eq!(own, is_flag);
        let (own, library) = (condition.value(&nothing).ok(), by_library(&text));
        let is_same = match (own, library) {
            (Some(Reading::Number(own)), Some(Reading::Number(library))) => {
                own.to_bits() == library.to_bits() || own.is_nan() && library.is_nan()
            }
            (own, library) => own == library,
        };
        prop_assert!(is_same, "{}: {:?}, by the library {:?}", text, own, library);
    }
}
