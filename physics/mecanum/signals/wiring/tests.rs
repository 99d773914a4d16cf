use super::*;

const FORWARD: PortCommand = PortCommand {
    reverse: false,
    brake: false,
};

fn read(text: &str) -> Result<Wiring, String> {
    Wiring::read(&Value::Text(text.to_owned()), "")
}

#[test]
fn what_is_shown_reads_back() {
    for text in ["x-y-e0-e1", "x-y-z-e0", "!e1-x-!z-y"] {
        assert_eq!(read(text).unwrap().to_string(), text);
    }
}

#[test]
fn what_is_no_wiring_is_refused_with_the_reason() {
    assert!(read("x-y-e0").unwrap_err().contains("4 ports"));
    assert!(read("x-y-e0-e1-z").unwrap_err().contains("4 ports"));
    assert!(read("x-y-e0-x").unwrap_err().contains("twice"));
    assert!(read("x-y-e0-E1").unwrap_err().contains("`E1`"));
    assert!(read("x-y-!!e0-e1").unwrap_err().contains("`!e0`"));
    assert!(read("").is_err());
    assert!(Wiring::read(&Value::Integer(4), "").is_err());
}

#[test]
fn a_reversed_wheel_rolls_the_other_way_and_an_idle_port_holds() {
    let mut commands = MecanumCommands::default();
    commands.ports[Port::Y.index()].brake = false;
    let wiring = read("y-!x-e0-e1").unwrap();
    assert_eq!(wiring.command(&commands, Wheel::LeftFront), FORWARD);
    assert!(wiring.command(&commands, Wheel::RightFront).brake);
    let wiring = read("!y-x-e0-e1").unwrap();
    let backward = PortCommand {
        reverse: true,
        ..FORWARD
    };
    assert_eq!(wiring.command(&commands, Wheel::LeftFront), backward);
}
