//! Changes are taken back, or in doubt, where nothing needs them.

use crate::vehicle::search::{Found, Search};
use crate::vehicle::tests::{drive, with};

#[test]
fn only_a_change_that_something_needs_stays() {
    let [ambient, mass] = ["r150.thermal.ambient", "r150.body.mass"].map(str::to_owned);
    let [warm, heavy] = [format!("{ambient}=34degC"), format!("{mass}=180kg")];
    let recordings = [drive(
        &["questions"],
        &with(std::slice::from_ref(&warm)),
        41,
    )];
    let search = Search::new(&recordings, with(&[]), &[ambient.clone(), mass.clone()]);
    let place = |key: &String| search.knobs.iter().position(|knob| knob.key == *key);
    let (ambient, mass) = (place(&ambient).unwrap(), place(&mass).unwrap());

    // Nothing moves, so the mass does nothing.
    let both = with(&[warm, heavy.clone()]);
    let mut model = search.model(&both, 1.0).unwrap();
    let (removals, _) = search.take_back(&mut model).unwrap();
    assert_eq!(search.changed(&model.settings), [ambient]);
    let [removal] = &*removals else {
        panic!("{} are left", removals.len());
    };
    assert!(removal.knob == ambient && removal.saves > removal.least);

    let is_needless = |as_good| {
        let found = Found {
            as_good: vec![as_good],
            ..found(mass)
        };
        search.is_needless(&model, &[found], ambient).unwrap()
    };
    assert!(!is_needless(both));
    assert!(is_needless(with(&[heavy])));
}

fn found(knob: usize) -> Found {
    Found {
        knob,
        literal: String::new(),
        number: None,
        by_spread: 0.0,
        or: Vec::new(),
        as_good: Vec::new(),
        saves: 0.0,
        is_shaky: false,
        left: [0.0; 2],
        shown_by: (0, 0),
    }
}

#[test]
fn what_is_certain_is_searched_again_without_several_others() {
    let warm = "r150.thermal.ambient=34degC".to_owned();
    let wrong = ["r150.body.mass=180kg", "r150.reply_delay=3ms"].map(str::to_owned);
    let recordings = [drive(
        &["questions"],
        &with(std::slice::from_ref(&warm)),
        41,
    )];
    let keys = ["r150.thermal.ambient", "r150.body.mass", "r150.reply_delay"];
    let search = Search::new(&recordings, with(&[]), &keys.map(str::to_owned));
    let again = |changes: &[String], doubted: &[&str]| {
        let doubted = doubted.iter().map(|key| {
            let place = search.knobs.iter().position(|knob| knob.key == *key);
            Found {
                or: vec!["another".to_owned()],
                ..found(place.unwrap())
            }
        });
        let model = search.model(&with(changes), 1.0).unwrap();
        let better = search.again_from_certain(&model, &doubted.collect::<Vec<_>>());
        let (better, _) = better.unwrap()?;
        let changed = search.changed(&better.settings).into_iter();
        Some(changed.map(|at| &*search.knobs[at].key).collect::<Vec<_>>())
    };
    assert_eq!(again(&wrong, &keys[1..]), Some(vec![keys[0]]));
    assert_eq!(again(&wrong, &keys[2..]), None);
    // Others that are no better are not taken.
    assert_eq!(again(&[warm], &keys[..2]), None);
}
