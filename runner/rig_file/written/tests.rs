use rigsim_core::settings::SimSettings;
use rigsim_settings::Source;

use super::*;

#[test]
fn a_plan_is_read_from_what_was_written_of_it() {
    let text = r#"
        schema = 1
        settings = { world = { slope = "3 deg" }, r150 = { heartbeat_timeout = "5s" } }
        [[device]]
        kind = "r150"
        start = "locked"
        pose = { x = "0.1 m", y = "-2 cm", heading = "93.7 deg" }
        settings = { motor_watchdog = "600 ms", battery = { initial_soc = "20 %" } }
        [[device]]
        kind = "mecanum"
        name = "my-car"
        ros = true
        [[device]]
        kind = "mecanum"
    "#;
    let parse = |text: &str, base: &SimSettings| {
        RigPlan::parse(Source { file: "rig", text }, base).unwrap()
    };
    let plan = parse(text, &SimSettings::new(rigsim_core::SHIPPED));
    let written = plan.to_toml();
    assert_eq!(parse(&written, &plan.settings), plan, "{written}");
}

#[test]
fn degrees_are_read_as_the_same_radians() {
    for step in -36_000..36_000 {
        let radians = (f64::from(step) * 0.0173).to_radians();
        assert_eq!(degrees(radians).to_radians(), radians);
    }
}
