use super::*;

fn lay(effects: &mut Effects, of: &str) -> EffectHandle {
    let effect = effects.begin();
    effects.add(effect, 0, vec![Change::new(of, true, |_, _, _| {})]);
    effect
}

#[test]
fn what_is_kept_ends_what_is_below_it() {
    let mut effects = Effects::default();
    let [below, kept, above] = [(); 3].map(|()| lay(&mut effects, "a"));
    let other = lay(&mut effects, "b");
    effects.keep(kept);
    assert!(effects.take(below).is_empty() && effects.take(kept).is_empty());
    assert_eq!(effects.take(above).len(), 1);
    assert_eq!(effects.take(other).len(), 1);
    assert!(effects.layers.is_empty());
}
