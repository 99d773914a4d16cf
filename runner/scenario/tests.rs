use super::*;

fn parse(text: &str) -> Result<Scenario, String> {
    let source = Source {
        file: "s.toml",
        text,
    };
    Scenario::parse(source, &SimSettings::new(rigsim_core::SHIPPED))
        .map_err(|error| error.to_string())
}

/// Four lines, so that what follows begins at line 5.
const HEAD: &str = "schema = 1\ntitle = \"t\"\ngood_client = \"g\"\nlimit = \"9s\"\n";
const R150: &str = "[[device]]\nkind = \"r150\"\n";
const CAR: &str = "[[device]]\nkind = \"mecanum\"\n";

#[test]
fn a_full_scenario_is_read() {
    let text = format!(
        "{HEAD}description = \"d\"\nworld = \"yard.toml\"\nseed = 3\ntags = [\"drive\", \"48v\"]\n\
         client_report = {{ allowed = [\"over_rate\"] }}\n\
         [settings]\nr150.heartbeat_timeout = \"2s\"\n{R150}{CAR}ros = true\n\
         [[step]]\nname = \"a\"\nat = \"1s\"\nevery = \"50ms\"\nfor = \"1s\"\ndevice = \"r150\"\n\
         host = {{ send = {{ set_motors = {{ right = 1, left = -1 }} }} }}\n\
         [[step]]\nafter = \"a\"\ndelay = \"10ms\"\ndevice = \"mecanum\"\n\
         host = {{ send = {{ line = \"X10\" }}, expect = {{ within = \"1s\" }} }}\n\
         [[always]]\nthat = \"t < 100\"\nfrom = \"1s\"\nuntil = \"2s\"\nafter = \"a\"\n"
    );
    let scenario = parse(&text).unwrap();
    assert_eq!(scenario.rig.seed, Some(3));
    assert_eq!(scenario.tags, ["drive", "48v"]);
    assert_eq!(scenario.rig.world.as_deref(), Some(Path::new("yard.toml")));
    let timeout = scenario.rig.devices[0]
        .settings
        .of_device(&rigsim_core::r150::R150_SPEC)
        .and_then(|settings| settings.get::<rigsim_core::r150::R150Settings>())
        .unwrap()
        .firmware
        .heartbeat_timeout;
    assert_eq!(timeout.as_secs(), 2);
    assert_eq!(
        scenario.steps[0].lasts.map(|lasts| (lasts.min, lasts.max)),
        Some((Duration::from_secs(1), Duration::from_secs(1)))
    );
    assert_eq!(scenario.steps[1].name, "step 2");
    let is_host = |step: &Step| matches!(step.action, StepAction::Host(_));
    assert!(scenario.steps.iter().any(is_host));
}

#[test]
fn the_document_s_example_is_a_scenario() {
    let example: String = include_str!("../scenario.rs")
        .lines()
        .filter_map(|line| line.strip_prefix("//!"))
        .skip_while(|line| !line.contains("```toml"))
        .skip(1)
        .take_while(|line| !line.contains("```"))
        .map(|line| format!("{}\n", line.trim()))
        .collect();
    parse(&example).unwrap();
}

/// Each is what follows [`HEAD`] and a device, so the first line of it is the seventh.
#[test]
fn errors_name_file_line_key_and_what_is_allowed() {
    let step = "[[step]]\nat = \"1s\"\n";
    for (more, expected) in [
        // Fields and values.
        (
            "[[step]]\natt = \"1s\"",
            "s.toml:8:1: `step.att`: unknown key `att`; did you mean `at`? allowed: name, at, when,",
        ),
        ("[[step]]\natt = \"1s\"", "did you mean `at`?"),
        ("[[stepp]]\nat = \"1s\"", "did you mean `step`?"),
        ("[[step]]\nat = 1", "a time with its unit"),
        ("[[step]]\nat = \"1 m\"", "s.toml:8:6: `step.at`: "),
        ("[[step]]\nat = \"1s\"", "exactly one of `host`"),
        (
            &format!("{step}after = \"x\"\noperator = \"lock\""),
            "exactly one of `at`",
        ),
        (
            &format!("{step}host = {{ }}"),
            "s.toml:9:8: `step.host`: exactly one of `send`",
        ),
        (
            &format!("{step}host = {{ send = \"hartbeat\" }}"),
            "did you mean `heartbeat`?",
        ),
        (
            &format!("{step}host = {{ bytes = \"AA 5\" }}"),
            "pairs of hexadecimal digits",
        ),
        (
            &format!("{step}host = {{ bytes = \"+1\" }}"),
            "pairs of hexadecimal digits",
        ),
        (
            &format!("{step}host = {{ link = \"ros\", bytes = \"AA\" }}"),
            "no link `ros`",
        ),
        (
            &format!("{step}host = {{ send = {{ motion = {{ moving_idx = 0, s = 1, v = 1 }} }} }}"),
            "unknown word `motion`; allowed: power_control",
        ),
        (
            &format!("{step}host = {{ send = {{ power_control = {{ on = [\"49v\"] }} }} }}"),
            "did you mean `48v`?",
        ),
        (
            &format!(
                "{step}host = {{ send = \"heartbeat\", expect = {{ within = \"1s\", \
                 reply = {{ succes = true }} }} }}"
            ),
            "that reply has no field `succes`; did you mean `success`?",
        ),
        (
            &format!(
                "{step}host = {{ send = \"heartbeat\", expect = {{ within = \"1s\", \
                 silence = true, reply = {{ success = true }} }} }}"
            ),
            "only one of `reply`",
        ),
        // Conditions.
        (
            "[[step]]\nwhen = \"truth.sped_mps > 1\"\noperator = \"lock\"",
            "s.toml:8:8: `step.when`: no name `truth.sped_mps`; did you mean `truth.speed_mps`?",
        ),
        ("[[never]]\nthat = \"t > \"", "s.toml:8:8: `never.that`: "),
        (
            "[[always]]\nthat = \"t\"",
            "s.toml:8:8: `always.that`: a condition is true or false",
        ),
        (
            "[[always]]\nthat = \"t > 1\"\nfrom = \"2s\"\nuntil = \"1s\"",
            "s.toml:10:9: `always.until`: is before `from`",
        ),
        // Other steps.
        (
            "[[step]]\nname = \"drive\"\nat = \"1s\"\noperator = \"lock\"\n\
             [[step]]\nafter = \"dirve\"\noperator = \"lock\"",
            "s.toml:12:9: `step.after`: no step is named \"dirve\", did you mean \"drive\"?",
        ),
        (
            "[[step]]\nname = \"a\"\nafter = \"b\"\noperator = \"lock\"\n\
             [[step]]\nname = \"b\"\nafter = \"a\"\noperator = \"lock\"",
            "wait for one another in a circle",
        ),
        (
            "[[step]]\nname = \"a\"\nafter = \"a\"\noperator = \"lock\"",
            "s.toml:9:9: `step.after`: the steps wait for one another in a circle",
        ),
        (
            "[[step]]\nname = \"a\"\nat = \"1s\"\nevery = \"1s\"\noperator = \"lock\"\n\
             [[step]]\nafter = \"a\"\noperator = \"lock\"",
            "repeated without end",
        ),
        (
            "[[step]]\nname = \"a\"\nat = \"1s\"\noperator = \"lock\"\n\
             [[step]]\nname = \"a\"\nat = \"1s\"\noperator = \"lock\"",
            "s.toml:12:8: `step.name`: two steps are named \"a\"",
        ),
        // Times.
        (
            "[[step]]\nat = \"10s\"\noperator = \"lock\"",
            "later than the run lasts",
        ),
        (
            &format!("{step}count = 3\noperator = \"lock\""),
            "needs `every`",
        ),
        (
            &format!("{step}every = \"0s\"\noperator = \"lock\""),
            "some time has to pass",
        ),
        (
            &format!("{step}for = \"1s\"\noperator = \"autonomous\""),
            "cannot be undone",
        ),
        (
            &format!("{step}for = \"1s\"\nhost = {{ send = \"heartbeat\" }}"),
            "it needs `every`",
        ),
        (
            &format!(
                "{step}every = {{ min = \"2s\", max = \"1s\" }}\nhost = {{ send = \"heartbeat\" }}"
            ),
            "s.toml:9:9: `step.every`: `min` is more than `max`",
        ),
        (
            &format!(
                "{step}delay = {{ min = \"2s\", max = 3 }}\nhost = {{ send = \"heartbeat\" }}"
            ),
            "a time, with its unit",
        ),
        (
            &format!("{step}until = \"t > 2\"\nhost = {{ send = \"heartbeat\" }}"),
            "it needs `every`",
        ),
        // What is remembered.
        (
            "[[never]]\nthat = \"saved.x0 > 1\"",
            "no step remembers `x0`; one does with `remember = { x0",
        ),
        (
            &format!(
                "{step}remember = {{ start = \"truth.x_m\" }}\n[[never]]\nthat = \"saved.strat > 1\""
            ),
            "no step remembers `strat`, did you mean `saved.start`?",
        ),
        (
            &format!(
                "{step}remember = {{ x0 = \"truth.x_m\" }}\n{step}remember = {{ x0 = \"truth.at_rest\" }}"
            ),
            "of another kind",
        ),
        (
            &format!("{step}remember = {{ a-b = \"truth.x_m\" }}"),
            "letters, digits and _",
        ),
        // Responses.
        (
            "[[response]]\nthen = \"truth.at_rest\"",
            "exactly one of `whenever` and `step`",
        ),
        (
            "[[response]]\nwhenever = \"t > 1\"\nthen = \"truth.at_rest\"\nwithin = \"2s\"\nuntil = \"1s\"",
            "s.toml:11:9: `response.until`: is before `within`",
        ),
        (
            &format!("{step}probability = 2\noperator = \"lock\""),
            "0 to 1",
        ),
        (
            &format!("{step}delay = \"1s\"\noperator = \"lock\""),
            "`delay` goes with",
        ),
        // Devices.
        (
            &format!("{step}device = \"r15\"\noperator = \"lock\""),
            "did you mean `r150`?",
        ),
        (
            &format!("{step}operator = {{ press = \"up\" }}"),
            "unknown word `up`",
        ),
        (
            &format!("{step}operator = \"locked\""),
            "did you mean `lock`?",
        ),
        (
            &format!("{step}world = {{ friction = 3 }}"),
            "`friction` is now `fault = { kind = \"ice\"",
        ),
        (
            &format!("{step}world = {{ add = {{ wal = [] }} }}"),
            "unknown key `wal`; did you mean `wall`?",
        ),
        (
            &format!("{step}fault = {{ kind = \"idle-noise\", every = \"1 ns\" }}"),
            "\"1 ns\" is out of range; allowed: a time from 1ms to 24h",
        ),
        (
            &format!("{step}fault = {{ kind = \"unsolicited-frame\", every = \"1 ns\" }}"),
            "\"1 ns\" is out of range; allowed: a time from 1ms to 24h",
        ),
        (
            &format!(
                "{step}fault = {{ kind = \"rail-load\", rail = \"48v\", power = \"1 W\", resistance = \"1 ohm\" }}"
            ),
            "one of `power`",
        ),
        ("client_report = \"full\"", "`empty`, or a table"),
    ] {
        let (before, after) = if more.starts_with("client_report") {
            (more, "")
        } else {
            ("", more)
        };
        let error =
            parse(&format!("{HEAD}{before}\n{R150}{after}\n").replace("\"9s\"\n\n", "\"9s\"\n"))
                .expect_err(more);
        let expected = expected.replace("`empty`", "\"empty\"");
        assert!(error.contains(&expected), "{more}\n{error}\n{expected}");
    }
}

#[test]
fn folders_hold_other_files_too() {
    for (path, is_one) in [
        ("scenarios/r150/cable-pulled.toml", true),
        (".hidden.toml", false),
        ("scenario.schema.json", false),
        ("notes", false),
    ] {
        assert_eq!(is_scenario_file(Path::new(path)), is_one, "{path}");
    }
}

#[test]
fn what_the_whole_file_lacks_is_reported() {
    for (text, expected) in [
        (HEAD.to_owned(), "1 to 1000 [[device]]"),
        (
            format!("{HEAD}{R150}").replace("= 1", "= 2"),
            "only schema 1",
        ),
        (
            format!("{HEAD}{R150}").replace("title", "titel"),
            "did you mean `title`?",
        ),
        (
            format!("{HEAD}{R150}").replace("9s", "0s"),
            "a run takes some time",
        ),
        (
            format!("{HEAD}{R150}name = \"truth\"\n"),
            "no device can be named \"truth\"",
        ),
        (
            format!("{HEAD}{R150}name = \"1st\"\n"),
            "no device can be named \"1st\"",
        ),
        (
            format!("{HEAD}{R150}name = \"a-b\"\n{R150}name = \"a_b\"\n"),
            "cannot tell \"a_b\" from \"a-b\"",
        ),
        (
            format!("{HEAD}{R150}{CAR}[[step]]\nat = \"1s\"\noperator = \"release\"\n"),
            "`device` has to say which",
        ),
        (
            format!("{HEAD}{CAR}[[step]]\nat = \"1s\"\noperator = \"unlock\"\n"),
            "a mecanum car has no `unlock`",
        ),
        (
            format!("{HEAD}client_report = {{ allowed = [\"over_rat\"] }}\n{CAR}"),
            "did you mean `over_rate`?",
        ),
        (
            format!("{HEAD}tags = [\"Drive\"]\n{CAR}"),
            "a tag is made of lower-case letters",
        ),
        (
            format!("{HEAD}step = []\n{CAR}[[step]]\nat = \"1s\"\nname = \"x\"\n"),
            "duplicate key `step`; a list is written either `step = [{ … }, { … }]` or with `[[step]]`",
        ),
        (
            format!("{HEAD}client_report = {{ only = \"live\" }}\n{CAR}"),
            "exactly one of `allowed` and `forbidden`",
        ),
    ] {
        let error = parse(&text).expect_err(&text);
        assert!(error.contains(expected), "{text}\n{error}");
    }
}

#[test]
fn several_errors_are_reported_at_once() {
    let bad = "[[step]]\nat = \"1s\"\nexpect = { that = \"x\" }\n".repeat(30);
    let error = parse(&format!("{HEAD}{R150}{bad}")).unwrap_err();
    let lines: Vec<&str> = error.lines().collect();
    assert_eq!(lines.len(), 21);
    assert_eq!(lines[20], "s.toml: and 10 more");
}

/// Each is what follows [`HEAD`] and a device, so the first line of it is the seventh; and the place and
/// key of each error, of which there are no others.
#[test]
fn no_error_of_a_table_hides_another_or_brings_one_about() {
    let mut wrong = Vec::new();
    for (more, expected) in [
        (
            "[[step]]\nat = \"1 V\"\nfor = 3\nwhen = \"truth.sped > 1\"\ndelay = { min = \"2s\", max = \"1s\" }\n\
             host = { send = { set_motors = { right = \"x\", left = 700000, up = 3 } }, \
             expect = { within = 3, reply = { sucess = true } } }\n",
            &[
                "8:6: `step.at`",
                "9:7: `step.for`",
                "10:8: `step.when`",
                "11:9: `step.delay`",
                "12:42: `step.host.send.set_motors.right`",
                "12:54: `step.host.send.set_motors.left`",
                "12:62: `step.host.send.set_motors.up`",
                "12:94: `step.host.expect.within`",
            ][..],
        ),
        (
            "[[step]]\nat = \"1s\"\nafter = \"x\"\nevery = \"0s\"\nprobability = 2\nuntil = \"t\"\n\
             remember = { a = \"truth.no\", 1b = \"t\" }\nexpect = { that = \"saved.a > 1\", whithin = \"1s\" }\n",
            &[
                "7:1: `step`: exactly one of `at`",
                "9:9: `step.after`",
                "10:9: `step.every`",
                "11:15: `step.probability`",
                "12:9: `step.until`",
                "13:18: `step.remember.a`",
                "13:30: `step.remember.1b`",
                "14:34: `step.expect.whithin`",
            ],
        ),
        (
            "[[step]]\nat = \"1s\"\nfault = { kind = \"bit-flips\", probability = 3, direcion = \"up\", count = \"x\" }\n",
            &[
                "9:45: `step.fault.probability`",
                "9:48: `step.fault.direcion`",
                "9:73: `step.fault.count`",
            ],
        ),
        (
            "[[step]]\nat = \"1s\"\nfault = { kind = \"bit-flip\", probability = 3 }\n\
             [[step]]\nat = \"1s\"\nfault = { kind = \"rail-load\" }\n",
            &["9:18: `step.fault.kind`", "12:9: `step.fault`"],
        ),
        (
            "[[step]]\nat = \"1s\"\nworld = { add = { box = [{ at_m = [1], length = \"1 V\", width = \"1 m\" }], bx = [] } }\n\
             [[step]]\nat = \"1s\"\noperator = { place = { x = \"1 V\", z = \"1 m\", y = \"0 m\" } }\n",
            &[
                "9:35: `step.world.add.box.at_m`",
                "9:49: `step.world.add.box.length`",
                "9:74: `step.world.add.bx`",
                "12:28: `step.operator.place.x`",
                "12:35: `step.operator.place.z`",
            ],
        ),
        (
            "pose = { x = \"1 V\", y = \"2 V\" }\nname = 3\nros = true\n\
             [[step]]\nat = \"1s\"\noperator = \"lok\"\n",
            &[
                "7:14: `device.pose.x`",
                "7:25: `device.pose.y`",
                "8:8: `device.name`",
                "9:7: `device.ros`",
                "12:12: `step.operator`",
            ],
        ),
        (
            "[[device]]\nkind = \"mecanum\"\nros = 3\n\
             [[step]]\nat = \"1s\"\ndevice = \"mecanum\"\nhost = { send = { line = \"X10\" } }\n",
            &["9:7: `device.ros`"],
        ),
        (
            "[[always]]\nthat = 3\nafter = \"x\"\nuntl = \"1s\"\n\
             [[response]]\nwhenever = \"truth.a > 1 && truth.b > 1\"\nwithin = 1\n",
            &[
                "8:8: `always.that`",
                "9:9: `always.after`",
                "10:1: `always.untl`",
                "11:1: `response`: missing key `then`",
                "12:12: `response.whenever`: no name `truth.a`",
                "13:10: `response.within`",
            ],
        ),
        (
            "[[step]]\nname = \"a\"\nat = \"1s\"\nevery = \"1s\"\nfor = 3\nhost = { send = \"version\" }\n\
             [[step]]\nafter = \"a\"\noperator = \"lock\"\n\
             [[step]]\nname = \"f\"\nat = \"1s\"\nfault = 3\n",
            &["11:7: `step.for`", "19:9: `step.fault`"],
        ),
    ] {
        let error = parse(&format!("{HEAD}{R150}{more}")).expect_err(more);
        let places = error
            .lines()
            .map(|line| line.strip_prefix("s.toml:").unwrap());
        let as_expected = places.clone().count() == expected.len()
            && places
                .zip(expected)
                .all(|(line, place)| line.starts_with(place));
        if !as_expected {
            wrong.push(format!("{more}{error}\n{expected:#?}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn all_that_is_no_toml_is_reported() {
    let error = parse("schema = \ntitle = \"t\ngood_client = \"g\"\n[[step]\nlimit = \"9s\"\n");
    let error = error.unwrap_err();
    let places: Vec<&str> = error.lines().map(|line| &line[..9]).collect();
    assert_eq!(places, ["s.toml:1:", "s.toml:2:", "s.toml:4:"], "{error}");
}

#[test]
fn what_a_parameter_makes_wrong_is_reported_where_its_value_stands() {
    let base = format!(
        "{HEAD}settings = {{ r150 = {{ heartbeat_timeout = \"${{hb}}\" }} }}\n{R150}\
         [parameters]\npwm = 300\nwait = \"1 s\"\nhb = \"5 s\"\n\
         [[step]]\nat = \"${{wait}}\"\nhost = {{ send = {{ set_motors = {{ right = \"${{pwm}}\", left = 1 }} }} }}\n\
         [[always]]\nthat = \"param.pwm < 500\"\n\
         [[never]]\nthat = \"t > ${{pwm}}\"\n"
    );
    let child = "schema = 1\nbase = \"b.toml\"\n[parameters]\npwm = \"fast\"\nhb = \"5 V\"\n";
    let [file, base_file] = ["c.toml", "b.toml"];
    let source = ScenarioText {
        file: file.to_owned(),
        text: child.to_owned(),
        base: vec![NamedText {
            file: base_file.to_owned(),
            text: base,
        }],
        parameters: vec![("wait".to_owned(), "3 x".to_owned())],
        set: Vec::new(),
    };
    let settings = SimSettings::new(rigsim_core::SHIPPED);
    let error = read(&source, &settings).unwrap_err().to_string();
    let lines: Vec<&str> = error.lines().collect();
    let expected = [
        ("--param wait=3 x: `step.at`: ", "; it is in b.toml:13:6"),
        (
            "c.toml:4:7: `parameters.pwm`: \"fast\" is not a whole number",
            "; it is `step.host.send.set_motors.right` of b.toml:14:42",
        ),
        (
            "c.toml:4:7: `parameters.pwm`: no parameter that is a number",
            "; it is `always.that` of b.toml:16:8",
        ),
        ("c.toml:5:6: `r150.heartbeat_timeout`: ", "from 1ms to 1h"),
        (
            "b.toml:18:8: `never.that`: no name `fast`",
            "; a part of it is from c.toml:4:7",
        ),
    ];
    assert_eq!(lines.len(), expected.len(), "{error}");
    for (line, (begins, ends)) in lines.iter().zip(expected) {
        assert!(line.starts_with(begins) && line.ends_with(ends), "{error}");
    }
}

#[test]
fn parameters_may_add_so_much_to_a_file_and_no_more() {
    let text = |count: usize| {
        let message = "${a}".repeat(count);
        format!(
            "{HEAD}[parameters]\na = \"{}\"\n{R150}[[always]]\nthat = \"t >= 0\"\nmessage = \"{message}\"\n\
             [[never]]\nthat = \"t < 0\"\nmessage = \"{message}\"\n",
            "x".repeat(1 << 10)
        )
    };
    let message = parse(&text(512)).unwrap().rules[0].message.clone();
    assert_eq!(message.map(|message| message.len()), Some(1 << 19));
    for count in [513, 10_000] {
        let error = parse(&text(count)).unwrap_err();
        let why = "`never.message`: parameters add more than 1048576 bytes to the file";
        let last = error.lines().last().unwrap();
        let place = if count == 513 {
            "s.toml:14:11: "
        } else {
            "s.toml:11:11: "
        };
        let why = if count == 513 {
            why.to_owned()
        } else {
            why.replace("never", "always")
        };
        assert_eq!(last, format!("{place}{why}"), "{error}");
    }
}

#[test]
fn a_world_s_name_is_a_text_in_which_parameters_stand() {
    let files = [
        (
            "a/one.toml",
            "schema = 1\nbase = \"../b/two.toml\"\nparameters = { w = \"hill\" }\n",
        ),
        (
            "a/../b/two.toml",
            &format!(
                "{HEAD}world = \"worlds/${{w}}.toml\"\nparameters = {{ w = \"yard\" }}\n{R150}"
            ),
        ),
    ];
    let mut read = |path: &Path| {
        let path = path.to_str().unwrap();
        let found = files.iter().find(|(name, _)| *name == path);
        let (name, text) = found.unwrap_or_else(|| panic!("{path}"));
        let (file, text) = ((*name).to_owned(), (*text).to_owned());
        Ok::<_, FileErrors>(NamedText { file, text })
    };
    let settings = SimSettings::new(rigsim_core::SHIPPED);
    let files = ScenarioFiles::read(Path::new("a/one.toml"), None, &mut read).unwrap();
    for (given, world) in [(None, "hill"), (Some("lawn"), "lawn")] {
        let given: Vec<_> = given
            .map(|w: &str| ("w".to_owned(), w.to_owned()))
            .into_iter()
            .collect();
        let scenario = files.compose(&given, &[], &settings).unwrap();
        let path = format!("a/../b/worlds/{world}.toml");
        assert_eq!(files.world_of(&scenario), Some(path.into()));
    }
}

#[test]
fn the_schema_is_the_published_one() {
    let schema = Scenario::json_schema(rigsim_core::SHIPPED);
    assert!(
        schema == include_str!("../../scenarios/scenario.schema.json"),
        "scenarios/scenario.schema.json is to read:\n{schema}"
    );
}

#[test]
fn a_fault_that_is_added_does_not_rename_another() {
    let flips = "[[step]]\nat = \"1s\"\nfault = { kind = \"bit-flips\", probability = 0.1 }\n";
    let noise = "[[step]]\nat = \"1s\"\nfault = { kind = \"idle-noise\", every = \"1s\" }\n";
    let named = |steps: &str| -> Vec<String> {
        let text = format!("{HEAD}[[device]]\nkind = \"r150\"\n{steps}");
        let source = Source {
            file: "s.toml",
            text: &text,
        };
        let scenario = Scenario::parse(source, &SimSettings::new(rigsim_core::SHIPPED)).unwrap();
        scenario.steps.into_iter().map(|step| step.name).collect()
    };
    assert_eq!(named(flips), ["bit-flips"]);
    assert_eq!(
        named(&format!("{noise}{flips}{flips}")),
        ["idle-noise", "bit-flips", "bit-flips 2"]
    );
}
