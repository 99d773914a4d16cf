use super::*;
use rigsim_core::device::typed;
use rigsim_core::r150::R150Settings;

fn parse(text: &str) -> Result<RigPlan, String> {
    let source = Source {
        file: "my-rig.toml",
        text,
    };
    RigPlan::parse(source, &SimSettings::new(rigsim_core::SHIPPED))
        .map_err(|error| error.to_string())
}

#[test]
fn a_full_rig() {
    let plan = parse(
        "schema = 1\nworld = \"yard.toml\"\nseed = 7\n\
         [settings]\nworld.slope = \"3 deg\"\nr150.heartbeat_timeout = \"9s\"\n\
         [[device]]\nkind = \"r150\"\nport = \"/tmp/a\"\nstart = \"locked\"\n\
         pose = { x = \"1.5 m\", y = \"-20 cm\", heading = \"90 deg\" }\n\
         [device.settings]\nbattery.initial_soc = \"50 %\"\n\
         [[device]]\nkind = \"r150\"\nname = \"other\"\n",
    )
    .unwrap();
    assert_eq!(plan.seed, Some(7));
    assert_eq!(plan.world, Some(PathBuf::from("yard.toml")));
    let [first, second] = &plan.devices[..] else {
        panic!("{plan:?}")
    };
    assert_eq!(
        (first.name.as_str(), second.name.as_str()),
        ("r150-1", "other")
    );
    let r150 = |device: &DevicePlan| typed::<R150Settings>(device.own_settings().unwrap()).clone();
    assert_eq!(first.start, 1);
    assert_eq!((first.pose.x, first.pose.y), (1.5, -0.2));
    assert_eq!(first.pose.heading, std::f64::consts::FRAC_PI_2);
    assert_eq!(r150(first).plant.battery.initial_soc, 50.0);
    assert_eq!(r150(second).plant.battery.initial_soc, 80.0);
    assert_eq!(r150(second).firmware.heartbeat_timeout.as_secs(), 9);
    assert_eq!(plan.settings.world.slope, 3.0);
}

#[test]
fn the_schema_is_the_published_one() {
    let schema = RigPlan::json_schema(rigsim_core::SHIPPED);
    assert!(
        schema == include_str!("../../worlds/rig.schema.json"),
        "worlds/rig.schema.json is to read:\n{schema}"
    );
}

#[test]
fn errors_name_file_line_and_key() {
    let one = "schema = 1\n[[device]]\nkind = \"r150\"\n";
    for (text, expected) in [
        (
            "schema = 2\n[[device]]\nkind = \"r150\"",
            "my-rig.toml:1:10: `schema`",
        ),
        ("schema = 1\n", "1 to 1000 [[device]]"),
        ("schema = 1\ntitle = \"A drive\"\n", "`sim run` plays it"),
        (
            "schema = 1\ndevices = 3\n",
            "my-rig.toml:2:1: `devices`: unknown key",
        ),
        (
            "schema = 1\n[[device]]\nkind = \"tank\"",
            "my-rig.toml:3:8: `device.kind`: ",
        ),
        (&format!("{one}color = \"red\""), "unknown key `color`"),
        (
            &format!("{one}pose = {{ x = \"1 V\" }}"),
            "my-rig.toml:4:14: `device.pose.x`: ",
        ),
        (
            &format!("{one}name = \"a b\""),
            "my-rig.toml:4:8: `device.name`: \"a b\" may have letters, digits",
        ),
        (
            &format!("{one}ros_port = \"/tmp/x\""),
            "my-rig.toml:4:12: `device.ros_port`: only a mecanum car",
        ),
        (
            &format!("{one}settings = {{ nonsense = 1 }}"),
            "my-rig.toml:4:14: no setting",
        ),
        (
            &format!("{one}port = \"/tmp/x\"\n[[device]]\nkind = \"r150\"\nport = \"/tmp/x\""),
            "my-rig.toml:7:8: `device.port`: two ports have the path /tmp/x",
        ),
        (
            &format!("{one}name = \"a\"\n[[device]]\nkind = \"r150\"\nname = \"a\""),
            "my-rig.toml:7:8: `device.name`: two devices are named",
        ),
    ] {
        let error = parse(text).unwrap_err();
        assert!(error.contains(expected), "{text}\ngave {error}");
    }
}
