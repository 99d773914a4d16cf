use super::*;
use crate::args::{Cli, Command};
use std::ffi::OsString;

use rigsim_core::SHIPPED;
use rigsim_core::device::DeviceSpec;

/// Devices that break when they are built: one when it is to be played with seed 7, the other also
/// when its file is read, which is tried with seed 0.
fn clumsy() -> Devices {
    let when_played = DeviceSpec {
        id: "clumsy",
        build: |setup, world| match setup.seed {
            7 => panic!("dropped \u{1b}[2J"),
            _ => (SHIPPED[0].build)(setup, world),
        },
        ..*SHIPPED[0]
    };
    let when_read = DeviceSpec {
        id: "clumsier",
        build: |_, _| panic!("dropped \u{1b}[2J"),
        ..*SHIPPED[0]
    };
    let own = [when_played, when_read].map(|spec| &*Box::leak(Box::new(spec)));
    Box::leak(Box::new([SHIPPED[0], own[0], own[1]]))
}

#[test]
fn a_panic_in_one_scenario_is_its_error_and_the_others_are_played() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let kinds = [
        ("a", "r150"),
        ("b", "clumsy"),
        ("c", "clumsier"),
        ("d", "r150"),
    ];
    for (name, kind) in kinds {
        let text = format!(
            "schema = 1\ntitle = \"{name}\"\ngood_client = \"Any.\"\nlimit = \"100 ms\"\n\
             [[device]]\nkind = \"{kind}\"\n"
        );
        fs::write(folder.join(format!("{name}.toml")), text).unwrap();
    }
    let junit = folder.join("r.xml");
    for players in ["1", "3"] {
        let mut words = ["sim", "run", "--seed", "7", "-j", players, "--junit"]
            .map(OsString::from)
            .to_vec();
        words.extend([junit.clone().into(), folder.into()]);
        let cli = Cli::parse(clumsy(), &words).unwrap();
        let Some(Command::Run(args)) = cli.command else {
            panic!("another command");
        };
        let ended = run(clumsy(), &args);
        assert_eq!(
            ended.map_err(|failure| failure.error).unwrap(),
            Exit::System
        );
        let results = fs::read_to_string(&junit).unwrap();
        assert!(
            results.contains("tests=\"4\" failures=\"0\" errors=\"2\""),
            "{results}"
        );
        let why = "the simulator panicked: dropped \\u{1b}[2J";
        assert_eq!(results.matches(why).count(), 2, "{results}");
        let unread = results.split("<testsuite ").nth(3).unwrap();
        assert!(
            unread.contains("c.toml") && unread.contains(why),
            "{results}"
        );
    }
    // Nothing is played here, and what is wrong is reported all the same.
    let checked = check(clumsy(), &[folder.to_owned()], &GivenArgs::default());
    let failure = checked.unwrap_err();
    assert_eq!(failure.exit, Exit::System);
    let said = failure.error.to_string();
    assert!(
        said.contains("c.toml") && !said.contains("b.toml"),
        "{said}"
    );
}
