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
            knob: mass,
            literal: String::new(),
            number: None,
            by_spread: 0.0,
            or: Vec::new(),
            as_good: vec![as_good],
            saves: 0.0,
            is_shaky: false,
            left: [0.0; 2],
            shown_by: (0, 0),
        };
        search.is_needless(&model, &[found], ambient).unwrap()
    };
    assert!(!is_needless(both));
    assert!(is_needless(with(&[heavy])));
}
