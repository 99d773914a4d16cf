//! Deeds in a rig, and the end of whatever goes on in it.
//!
//! What a deed or an operator's fault changes lies over what was before, in layers: of each thing
//! the latest that is in effect counts. A layer brings back what was before it. If one ends that has
//! others above it, the next above it takes that over, so that nothing is seen of its end but that
//! it is not brought back later.

use std::collections::BTreeMap;

use sim_physics::world::ObstacleError;

use super::Rig;
use crate::device::{Action, Change, EffectHandle, Restore};
use crate::event::{Code, Role, Told, code};

/// Change of something that is in effect.
struct Layer {
    effect: EffectHandle,
    /// Device that it is about; none if it is the world around all.
    device: Option<usize>,
    /// Name of what was changed.
    of: String,
    restore: Option<Restore>,
}

/// Effects that go on, and what they have changed, in the order in which they did.
#[derive(Default)]
pub(super) struct Effects {
    begun: u64,
    /// Device that each deed is about, and the deed in words.
    deeds: BTreeMap<EffectHandle, (usize, String)>,
    layers: Vec<Layer>,
}

impl Rig {
    /// Does something to a device or to the world around it, and tells of it; `what` is the deed in
    /// words. Gives what [`clear`](Self::clear) undoes, if it is anything.
    ///
    /// # Errors
    /// When the world cannot be changed so.
    pub fn perform(
        &mut self,
        device: usize,
        what: &str,
        action: &dyn Action,
    ) -> Result<Option<EffectHandle>, ObstacleError> {
        let now = self.now;
        self.rest_to_grid(device);
        let Some(slot) = self.slots.get_mut(device) else {
            return Ok(None);
        };
        let changes = action.perform(slot.device.as_mut(), &mut self.world, now)?;
        self.tell_deed(device, code::DEED_DONE, what.to_owned());
        if changes.iter().any(|change| change.in_world) {
            self.with_world(|_| {});
        } else {
            self.after_change(device);
        }
        if changes.is_empty() {
            return Ok(None);
        }
        let effect = self.effects.begin();
        self.effects.deeds.insert(effect, (device, what.to_owned()));
        self.effects.add(effect, device, changes);
        Ok(Some(effect))
    }

    /// Ends a fault, and hardware goes back to what it was; or undoes a deed. What has ended already
    /// stays so.
    pub fn clear(&mut self, effect: EffectHandle) {
        self.disarm(effect);
        if let Some((device, what)) = self.effects.deeds.remove(&effect) {
            self.tell_deed(device, code::DEED_UNDONE, format!("{what}, undone"));
        }
        self.restore(effect);
    }

    /// Ends a deed without a word: it goes on in the same one that was done after it.
    pub fn supersede(&mut self, deed: EffectHandle) {
        self.effects.deeds.remove(&deed);
        self.restore(deed);
    }

    /// Lets a deed last for good: what was before it does not come back.
    pub fn keep(&mut self, deed: EffectHandle) {
        self.effects.deeds.remove(&deed);
        self.effects.keep(deed);
    }

    /// Brings back what was covered by an effect alone.
    fn restore(&mut self, effect: EffectHandle) {
        let due = self.effects.take(effect);
        let Some((about, _)) = due.first() else {
            return;
        };
        // One effect is about one device, or about the world, which has any device's restored.
        let about = *about;
        self.with_any_device(about.unwrap_or(0), |device, world, now| {
            for (_, restore) in due {
                restore(device, world, now);
            }
        });
        if about.is_none() {
            self.with_world(|_| {});
        }
    }

    fn tell_deed(&mut self, device: usize, code: Code, text: String) {
        let role = Role::Other;
        self.events
            .keep(self.now, device, Told { code, role, text });
    }
}

impl Effects {
    /// The next one.
    pub(super) fn begin(&mut self) -> EffectHandle {
        self.begun += 1;
        EffectHandle(self.begun)
    }

    /// Lays what an effect has changed of a device or the world on top.
    pub(super) fn add(&mut self, effect: EffectHandle, device: usize, changes: Vec<Change>) {
        self.layers.extend(changes.into_iter().map(|change| Layer {
            effect,
            device: (!change.in_world).then_some(device),
            of: change.of,
            restore: change.restore,
        }));
    }

    /// Takes an effect away; gives what brings back what was covered by it alone.
    fn take(&mut self, effect: EffectHandle) -> Vec<(Option<usize>, Restore)> {
        let mut due = Vec::new();
        while let Some(index) = self.position(effect) {
            let taken = self.layers.remove(index);
            let mut above = self.layers.iter_mut().skip(index);
            match above.find(|layer| layer.is_of_same(&taken)) {
                // One that changed nothing covers nothing either.
                Some(above) if taken.restore.is_some() => above.restore = taken.restore,
                Some(_) => {}
                None => due.extend(taken.restore.map(|restore| (taken.device, restore))),
            }
        }
        due
    }

    /// Lets an effect last for good: what is below it does not come back.
    fn keep(&mut self, effect: EffectHandle) {
        while let Some(index) = self.position(effect) {
            let above = self.layers.split_off(index + 1);
            if let Some(kept) = self.layers.pop() {
                self.layers.retain(|layer| !layer.is_of_same(&kept));
            }
            self.layers.extend(above);
        }
    }

    fn position(&self, effect: EffectHandle) -> Option<usize> {
        self.layers.iter().position(|layer| layer.effect == effect)
    }
}

impl Layer {
    fn is_of_same(&self, other: &Self) -> bool {
        self.device == other.device && self.of == other.of
    }
}

#[cfg(test)]
mod tests {
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
}
