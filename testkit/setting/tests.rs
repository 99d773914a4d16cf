use super::*;

#[test]
fn every_setting_has_a_value_beside_its_default_and_takes_all() {
    for entry in entries() {
        let values = values(&entry);
        assert!(
            values.iter().any(|value| *value != entry.default),
            "{}",
            entry.key
        );
        for value in values {
            let mut settings = SimSettings::new(rigsim_core::SHIPPED);
            let loaded = load_toml(&line(&entry.key, &value), "value", &mut settings);
            assert_eq!(loaded, Ok(()));
        }
    }
}
