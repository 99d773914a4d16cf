use super::*;
use std::collections::BTreeSet;

#[test]
fn every_default_is_allowed_and_every_key_is_there_once() {
    let mut seen = BTreeSet::new();
    let mut tree = SimSettings::new(crate::SHIPPED);
    let text = rigsim_settings::show_toml(&tree);
    rigsim_settings::load_toml(&text, "defaults", &mut tree).unwrap();
    assert_eq!(tree, SimSettings::new(crate::SHIPPED));
    for entry in tree.entries() {
        assert!(seen.insert(entry.key.clone()), "{} twice", entry.key);
        assert!(!entry.basis.source().is_empty());
    }
    assert!(seen.contains("r150.heartbeat_timeout"));
    assert!(seen.contains("r150.battery.initial_soc"));
}

/// The page that sets documented and assumed behaviour side by side names every setting of the
/// R150, by itself or with its group, and none that does not exist.
#[test]
fn the_r150_s_page_names_every_setting_and_no_other() {
    let page = include_str!("../../docs/r150.md");
    let words: BTreeSet<&str> = page.split('`').skip(1).step_by(2).collect();
    let entries = SimSettings::new(crate::SHIPPED).entries();
    let keys: BTreeSet<String> = entries.into_iter().map(|entry| entry.key).collect();
    for key in keys.iter().filter(|key| key.starts_with("r150.")) {
        let (group, last) = key.rsplit_once('.').unwrap();
        let ways = [key.clone(), format!(".{last}"), format!("{group}.*")];
        let named = ways.iter().any(|way| words.contains(way.as_str()));
        assert!(named, "docs/r150.md does not name `{key}`");
    }
    for word in words.iter().filter(|word| word.starts_with("r150.")) {
        let known = match word.strip_suffix('*') {
            Some(group) => keys.iter().any(|key| key.starts_with(group)),
            None => keys.contains(*word),
        };
        assert!(known, "docs/r150.md names `{word}`, which is not a setting");
    }
}

#[test]
fn the_settings_to_compare_first_are_there_and_few_enough_to_read() {
    let entries = SimSettings::new(crate::SHIPPED).entries();
    let keys: BTreeSet<String> = entries.into_iter().map(|entry| entry.key).collect();
    for device in crate::SHIPPED {
        assert_eq!(device.compare_first.len(), 20, "{}", device.id);
        for key in device.compare_first {
            let key = format!("{}.{key}", device.id);
            assert!(keys.contains(&key), "`{key}`");
        }
    }
}
