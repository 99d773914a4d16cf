//! How the modules of this crate depend on one another.

#![expect(clippy::unwrap_used, reason = "a test")]

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// For each module of the crate, those that it names.
fn dependencies() -> BTreeMap<String, BTreeSet<String>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(root).unwrap() {
        let path = entry.unwrap().path();
        let module = path.file_stem().unwrap().to_str().unwrap().to_owned();
        let is_source = path.extension().is_some_and(|ending| ending == "rs");
        if is_source && module != "lib" {
            let uses = found.entry(module.clone()).or_insert_with(BTreeSet::new);
            read(&path, uses);
            read_folder(&root.join(&module), uses);
            uses.remove(&module);
        }
    }
    assert!(found.len() > 8, "{found:?}");
    found
}

fn read_folder(folder: &Path, uses: &mut BTreeSet<String>) {
    for entry in fs::read_dir(folder).into_iter().flatten() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap();
        if name == "tests" || name == "tests.rs" {
            continue;
        }
        if path.is_dir() {
            read_folder(&path, uses);
        } else {
            read(&path, uses);
        }
    }
}

/// Notes the modules that a file names, tests aside.
fn read(path: &Path, uses: &mut BTreeSet<String>) {
    let text = fs::read_to_string(path).unwrap();
    let text = text.split("\n#[cfg(test)]\nmod tests {").next().unwrap();
    let code = text
        .lines()
        .filter(|line| !line.trim_start().starts_with("//"));
    for line in code {
        assert!(
            !line.contains("use crate::{"),
            "{}: one line for each module, so that they can be read here",
            path.display()
        );
        for part in line.split("crate::").skip(1) {
            let name: String = part
                .chars()
                .take_while(|c| c.is_alphanumeric() || *c == '_')
                .collect();
            // Macros are at the root, whatever module declares them.
            if !part[name.len()..].starts_with('!') {
                uses.insert(name);
            }
        }
    }
}

#[test]
fn modules_form_no_circle() {
    let mut left = dependencies();
    // What the crate hands on from another one names none of its modules.
    let own: BTreeSet<String> = left.keys().cloned().collect();
    for uses in left.values_mut() {
        uses.retain(|used| own.contains(used));
    }
    loop {
        let free = |(_, uses): &(&String, &BTreeSet<String>)| uses.is_empty();
        let Some(next) = left.iter().find(free).map(|(module, _)| module.clone()) else {
            break;
        };
        left.remove(&next);
        for uses in left.values_mut() {
            uses.remove(&next);
        }
    }
    assert!(
        left.is_empty(),
        "these form a circle, or hang on one: {left:#?}"
    );
}

#[test]
fn firmware_knows_nothing_of_its_surroundings() {
    let dependencies = dependencies();
    for firmware in ["r150_device", "mecanum_device"] {
        for module in &dependencies[firmware] {
            assert!(
                ["defects", "noise", "uart"].contains(&module.as_str()),
                "{firmware} uses {module}"
            );
        }
    }
}

/// Source of the crates above the devices' folders, tests aside.
fn above() -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut folders: Vec<_> = ["runner", "cli", "embed", "control"]
        .iter()
        .map(|folder| root.join(folder))
        .collect();
    folders.extend(["device", "rig", "injection"].map(|folder| root.join("sim").join(folder)));
    let mut found = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_str().unwrap().to_owned();
            if path.is_dir() && name != "tests" {
                folders.push(path);
            } else if name.ends_with(".rs") && name != "tests.rs" {
                found.push((name, fs::read_to_string(&path).unwrap()));
            }
        }
    }
    assert!(found.len() > 50, "{}", found.len());
    found
}

#[test]
fn nothing_above_a_device_s_folder_names_a_device() {
    for (file, text) in above() {
        let text = text.split("\n#[cfg(test)]\nmod tests {").next().unwrap();
        for line in text.lines() {
            let is_comment = line.trim_start().starts_with("//");
            for name in ["R150", "Mecanum", "::r150", "::mecanum"] {
                // Examples of help are for the devices that ship: an R150, say.
                let is_help = line.contains("SIM_R150_PORT") || line.contains("n R150");
                assert!(
                    is_comment || is_help || !line.contains(name),
                    "{file}: {line}"
                );
            }
        }
    }
}
