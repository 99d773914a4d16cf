//! Dependencies between the modules of each crate.

#![expect(clippy::unwrap_used, reason = "a test")]

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// Path of a module, or of something in one: `["rig", "port", "PortId"]`.
type Names = Vec<String>;

/// The modules of a crate with what each names, in whichever way: `crate::`, `super::`, a child.
struct Modules(BTreeMap<Names, BTreeSet<Names>>);

impl Modules {
    fn of(folder: &str) -> Self {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
        let mut sources = BTreeMap::new();
        read_folder(&root, &[], &mut sources);
        assert!(sources.len() > 5, "{:?}", sources.keys());
        let named =
            |(module, text): (&Names, &String)| (module.clone(), named(module, text, &sources));
        Self(sources.iter().map(named).collect())
    }

    /// The module in which something really is that others may hand on.
    fn home(&self, path: &[String], hops: usize) -> Names {
        let is_module = |length: &usize| self.0.contains_key(&path[..*length]);
        let module = (0..=path.len()).rev().find(is_module).unwrap_or(0);
        let elsewhere = path.get(module).and_then(|name| {
            let mut handed_on = self.0[&path[..module]].iter();
            handed_on.find(|other| other.last() == Some(name) && **other != path[..=module])
        });
        match elsewhere {
            Some(path) if hops > 0 => self.home(path, hops - 1),
            _ => path[..module].to_vec(),
        }
    }

    /// For each module that lies in `parent`, those beside it that it or one below it uses.
    fn within(&self, parent: &[String]) -> BTreeMap<&str, BTreeSet<String>> {
        let child = |path: &'_ [String]| path.strip_prefix(parent)?.first().cloned();
        let mut found = BTreeMap::new();
        for (module, named) in &self.0 {
            let Some(name) = module.strip_prefix(parent).and_then(<[_]>::first) else {
                continue;
            };
            let uses: &mut BTreeSet<_> = found.entry(name.as_str()).or_default();
            uses.extend(named.iter().filter_map(|path| child(&self.home(path, 5))));
            uses.remove(name);
        }
        found
    }
}

/// Reads the source of a folder's modules, tests aside.
fn read_folder(folder: &Path, parent: &[String], sources: &mut BTreeMap<Names, String>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_str().unwrap();
        let mut module = parent.to_vec();
        if name != "lib" {
            module.push(name.to_owned());
        }
        if ["tests", "benches"].contains(&name) {
        } else if path.is_dir() {
            read_folder(&path, &module, sources);
        } else if path.extension().is_some_and(|ending| ending == "rs") {
            let text = fs::read_to_string(&path).unwrap();
            let text = text.split("\n#[cfg(test)]\nmod tests {").next().unwrap();
            let code = text
                .lines()
                .filter(|line| !line.trim_start().starts_with("//"));
            sources.insert(module, code.collect::<Vec<_>>().join("\n"));
        }
    }
}

/// All that a module names in its crate.
fn named(module: &Names, text: &str, modules: &BTreeMap<Names, String>) -> BTreeSet<Names> {
    let mut found = BTreeSet::new();
    let mut before = ' ';
    for (at, first) in text.char_indices() {
        // At the beginning of a path.
        if first.is_alphabetic() && !is_of_name(before) && before != ':' {
            for path in paths(&text[at..]).0 {
                let child = [&module[..], &path[..1]].concat();
                let ups = path.iter().take_while(|name| *name == "super").count();
                let base = match path[0].as_str() {
                    "crate" => &[],
                    "self" => &module[..],
                    "super" => &module[..module.len() - ups],
                    _ if modules.contains_key(&child) => &child[..],
                    _ => continue,
                };
                found.insert([base, &path[ups.max(1)..]].concat());
            }
        }
        before = first;
    }
    found
}

fn is_of_name(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// The paths at the beginning of a text, several if it has braces; and what is behind them.
fn paths(text: &str) -> (Vec<Names>, &str) {
    let text = text.trim_start();
    if let Some(mut rest) = text.strip_prefix('{') {
        let mut all = Vec::new();
        loop {
            let (some, behind) = paths(rest);
            all.extend(some);
            match behind.trim_start().strip_prefix(',') {
                Some(next) => rest = next,
                None => return (all, behind.trim_start().strip_prefix('}').unwrap_or(behind)),
            }
        }
    }
    let (name, rest) = text.split_at(text.find(|c| !is_of_name(c)).unwrap_or(text.len()));
    let (ends, rest) = match rest.strip_prefix("::") {
        Some(next) => paths(next),
        None => (vec![Vec::new()], rest),
    };
    let name = (!name.is_empty()).then(|| name.to_owned());
    let whole = |end: Names| name.iter().cloned().chain(end).collect();
    (ends.into_iter().map(whole).collect(), rest)
}

/// The folders of all crates.
const CRATES: [&str; 10] = [
    "settings", "physics", "sim", "runner", "pty", "embed", "control", "lockstep", "cli", "testkit",
];

/// The modules of which each leads back to itself.
fn circles(uses: &BTreeMap<&str, BTreeSet<String>>) -> BTreeSet<String> {
    let leads_back = |start: &&&str| {
        let mut seen = BTreeSet::new();
        let mut next: Vec<&str> = vec![**start];
        while let Some(module) = next.pop() {
            let used = uses.get(module).into_iter().flatten();
            next.extend(used.map(String::as_str).filter(|used| seen.insert(*used)));
        }
        seen.contains(**start)
    };
    let modules = uses.keys().filter(leads_back);
    modules.map(|module| (*module).to_owned()).collect()
}

#[test]
fn modules_form_no_circle() {
    for folder in CRATES {
        let modules = Modules::of(&format!("../{folder}"));
        for parent in modules.0.keys() {
            let uses = modules.within(parent);
            let place = [&[folder.to_owned()], &parent[..]].concat().join("/");
            let found = circles(&uses);
            assert!(
                found.is_empty(),
                "in {place}, {found:?} are in a circle: {uses:#?}"
            );
        }
    }
}

#[test]
fn firmware_knows_nothing_of_its_surroundings() {
    let modules = Modules::of(".");
    let uses = modules.within(&[]);
    for firmware in ["r150_device", "mecanum_device"] {
        for module in &uses[firmware] {
            assert!(
                [
                    "defects", "event", "firmware", "message", "rounding", "scanner", "uart"
                ]
                .contains(&module.as_str()),
                "{firmware} uses {module}"
            );
        }
    }
}

/// Source of the crates above the devices' folders, tests aside. The testkit's streams read the wire of each
/// device a second time, by other code, so they name them.
fn above() -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let crates = [
        "runner", "cli", "embed", "control", "lockstep", "pty", "testkit",
    ];
    let mut folders: Vec<_> = crates.map(|folder| root.join(folder)).into();
    folders.extend(["device", "rig", "injection"].map(|folder| root.join("sim").join(folder)));
    let mut found = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_str().unwrap().to_owned();
            if path.ends_with("testkit/stream") || path.ends_with("testkit/stream.rs") {
                continue;
            }
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
