use super::*;
use rigsim_settings::Settings;

#[test]
fn every_default_is_allowed_and_reads_back() {
    let text = rigsim_settings::show_toml(&MecanumFirmwareSettings::default());
    let mut read = MecanumFirmwareSettings {
        baud: 9600,
        link_timeout: Some(S(1)),
        ..MecanumFirmwareSettings::default()
    };
    rigsim_settings::load_toml(&text, "defaults", &mut read).unwrap();
    assert_eq!(read, MecanumFirmwareSettings::default());
}

#[test]
fn the_documentation_names_every_setting_and_every_other_choice() {
    let page = include_str!("../../../docs/mecanum.md");
    let mut missing = Vec::new();
    let mut look = |entry: rigsim_settings::Entry| {
        let group = entry.key.rsplit_once('.').map(|(group, _)| group);
        let named = page.contains(&format!("`{}`", entry.key))
            || page.contains(&format!("`{} = ", entry.key))
            || group.is_some_and(|group| page.contains(&format!("`{group}.*`")));
        if !named {
            missing.push(entry.key.clone());
        }
        // Words beside the default, but for those that a group stands for.
        if entry.allowed.words.starts_with('"')
            && !entry.allowed.words.contains("…")
            && group.is_none()
        {
            for word in entry
                .allowed
                .words
                .split(", ")
                .filter(|word| word.starts_with('"') && **word != entry.default)
            {
                if !page.contains(word) && !page.contains(word.trim_matches('"')) {
                    missing.push(format!("{} {word}", entry.key));
                }
            }
        }
    };
    let firmware = MecanumFirmwareSettings::default().entries();
    let plant = rigsim_physics::MecanumPlantSettings::default().entries();
    firmware.into_iter().chain(plant).for_each(&mut look);
    assert_eq!(missing, [] as [&str; 0]);
}
