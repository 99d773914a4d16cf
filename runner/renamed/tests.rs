use super::*;
use crate::Scenario;
use rigsim_core::settings::SimSettings;
use rigsim_settings::Source;

const HEAD: &str = "schema = 1\ntitle = \"t\"\ngood_client = \"g\"\nlimit = \"1 s\"\n";
const DEVICE: &str = "[[device]]\nkind = \"r150\"\n";

fn error(head: &str, more: &str) -> String {
    let text = format!("{HEAD}{head}{DEVICE}{more}");
    let source = Source {
        file: "s.toml",
        text: &text,
    };
    let settings = SimSettings::new(rigsim_core::SHIPPED);
    Scenario::parse(source, &settings)
        .expect_err(&text)
        .to_string()
}

/// Names of the command line are tried there.
#[test]
fn a_former_name_is_an_error_that_says_the_new_one() {
    for renamed in RENAMED {
        let old = renamed.old;
        let error = match renamed.kind {
            Kind::Key("") => error(&format!("{old} = 1\n"), ""),
            Kind::Key(table) => error("", &format!("{table}\n{old} = 1\n")),
            Kind::Effect("fault") => {
                let step = format!("[[step]]\nat = \"0 s\"\nfault = {{ kind = \"{old}\" }}\n");
                error("", &step)
            }
            Kind::Effect(key) => error(
                "",
                &format!("[[step]]\nat = \"0 s\"\n{key} = {{ {old} = 1 }}\n"),
            ),
            Kind::Name => {
                let old = old.replace('*', "lf_torque_nm");
                error("", &format!("[[always]]\nthat = \"{old} < 1\"\n"))
            }
            Kind::Setting => error(&format!("settings = {{ {old} = \"1\" }}\n"), ""),
            Kind::Flag(_) | Kind::Ctl => continue,
        };
        assert!(error.contains(&renamed.to_string()), "{renamed}: {error}");
    }
}

#[test]
fn a_removed_setting_is_an_error_that_suggests_no_other() {
    for row in FIXED.lines() {
        let (group, names) = row.split_once(": ").unwrap();
        for name in names.split(' ') {
            let key = format!("{group}.{name}");
            let error = error(&format!("settings = {{ {key} = \"1\" }}\n"), "");
            let wanted = format!("`{key}` was removed: its value is fixed now");
            assert!(error.ends_with(&wanted), "{error}");
        }
    }
}

#[test]
fn a_removed_key_is_an_error_that_says_what_to_do() {
    for (key, beside, instead) in REMOVED {
        let error = match *beside {
            "limit" => error(&format!("{key} = 1\n"), ""),
            _ => error("", &format!("[[step]]\nat = \"0 s\"\n{key} = 1\n")),
        };
        assert!(
            error.contains(&format!("`{key}` was removed: {instead}")),
            "{error}"
        );
    }
}

#[test]
fn what_is_confused_leads_to_a_name_that_there_is() {
    for (confused, _) in CONFUSED {
        let error = error("", &format!("[[always]]\nthat = \"{confused}\"\n"));
        assert!(error.contains("did you mean `"), "{error}");
        let meant = error.split("did you mean `").nth(1).unwrap();
        let meant = meant.split('`').next().unwrap();
        let wrong = self::error("", &format!("[[never]]\nthat = \"{meant} == nothing\"\n"));
        assert!(!wrong.contains(&format!("no name `{meant}`")), "{wrong}");
    }
    let named = error(
        "",
        "name = \"my-car\"\n[[always]]\nthat = \"my_car.mode.remote\"\n",
    );
    assert!(
        named.contains("did you mean `!my_car.mode.autonomous`?"),
        "{named}"
    );
}
