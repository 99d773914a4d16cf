//! What the library has as a whole.

#![expect(
    clippy::unwrap_used,
    clippy::disallowed_methods,
    reason = "a test, and it reads the files for the pure library"
)]

mod common;

use std::collections::BTreeSet;

use rigsim_core::SHIPPED;
use rigsim_core::effect::catalogue;

use common::Loaded;

fn library() -> Vec<Loaded> {
    let files = common::files();
    files
        .iter()
        .map(|file| Loaded::read(file).unwrap())
        .collect()
}

#[test]
fn every_fault_of_the_catalogue_is_used() {
    let library = library();
    let used: BTreeSet<&str> = library
        .iter()
        .flat_map(|one| one.scenario.faults())
        .collect();
    let unused: Vec<&str> = catalogue(SHIPPED)
        .into_iter()
        .filter(|info| info.is_fault())
        .map(|info| info.id)
        .filter(|id| !used.contains(id))
        .collect();
    assert!(unused.is_empty(), "no scenario uses {unused:?}");
}

#[test]
fn titles_are_unique_and_sentences_are_whole() {
    let mut titles = BTreeSet::new();
    for Loaded { path, scenario, .. } in library() {
        let file = path.display();
        assert!(
            titles.insert(scenario.title.clone()),
            "{file}: its title is taken"
        );
        assert!(
            !scenario.title.ends_with('.'),
            "{file}: a title is not a sentence"
        );
        let sentences = [Some(&scenario.good_client), scenario.description.as_ref()];
        for text in sentences.into_iter().flatten() {
            assert!(text.ends_with('.'), "{file}: no sentence: {text}");
        }
    }
}
