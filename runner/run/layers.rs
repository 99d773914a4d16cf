//! Layers of what steps have changed: of each thing, the latest that is in effect counts.
//!
//! A layer brings back what was before it. If one ends that has others above it, the next above it
//! takes that over, so that nothing is seen of its end but that it is not brought back later.

use sim_core::rig::Rig;

/// Brings something back to how it was.
pub(super) type Restore = Box<dyn FnOnce(&mut Rig) + Send>;

/// Change of something.
pub(super) struct Changed {
    /// What was changed: something of a device, or of the world around all.
    pub(super) of: (Option<usize>, String),
    /// Brings back what was before; none if that was no other.
    pub(super) restore: Option<Restore>,
}

struct Layer {
    effect: u64,
    changed: Changed,
}

/// Changes that are in effect, in the order in which they were made.
#[derive(Default)]
pub(super) struct Layers {
    layers: Vec<Layer>,
    effects: u64,
}

impl Layers {
    /// Lays the changes of one effect on top; gives its number.
    pub(super) fn add(&mut self, changes: Vec<Changed>) -> u64 {
        self.effects += 1;
        let effect = self.effects;
        let layers = changes.into_iter();
        self.layers
            .extend(layers.map(|changed| Layer { effect, changed }));
        effect
    }

    /// Takes an effect away; gives what brings back what was covered by it alone.
    #[must_use]
    pub(super) fn take(&mut self, effect: u64) -> Vec<Restore> {
        let mut due = Vec::new();
        while let Some(index) = self.position(effect) {
            let Changed { of, restore } = self.layers.remove(index).changed;
            let mut above = self.layers.iter_mut().skip(index);
            match above.find(|layer| layer.changed.of == of) {
                // One that changed nothing covers nothing either.
                Some(above) if restore.is_some() => above.changed.restore = restore,
                Some(_) => {}
                None => due.extend(restore),
            }
        }
        due
    }

    /// Lets an effect last for good: what is below it does not come back.
    pub(super) fn keep(&mut self, effect: u64) {
        while let Some(index) = self.position(effect) {
            let of = self.layers[index].changed.of.clone();
            let above = self.layers.split_off(index + 1);
            self.layers.retain(|layer| layer.changed.of != of);
            self.layers.extend(above);
        }
    }

    fn position(&self, effect: u64) -> Option<usize> {
        self.layers.iter().position(|layer| layer.effect == effect)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lay(layers: &mut Layers, of: &str) -> u64 {
        let of = (Some(0), of.to_owned());
        let restore: Option<Restore> = Some(Box::new(|_| {}));
        layers.add(vec![Changed { of, restore }])
    }

    #[test]
    fn what_is_kept_ends_what_is_below_it() {
        let mut layers = Layers::default();
        let [below, kept, above] = [(); 3].map(|()| lay(&mut layers, "a"));
        let other = lay(&mut layers, "b");
        layers.keep(kept);
        assert!(layers.take(below).is_empty() && layers.take(kept).is_empty());
        assert_eq!(layers.take(above).len(), 1);
        assert_eq!(layers.take(other).len(), 1);
        assert!(layers.layers.is_empty());
    }
}
