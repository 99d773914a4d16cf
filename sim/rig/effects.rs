//! Effects in a rig: their beginning and their end.
//!
//! What an action changes lies over what was before, in layers: of each thing the latest that is in
//! effect counts. A layer brings back what was before it. If one ends that has others above it, the
//! next above it takes that over, so that nothing is seen of its end but that it is not brought back
//! later.

use std::collections::BTreeMap;

use super::Rig;
use crate::device::{
    Begin, Change, EffectError, EffectHandle, MOST_ARMED, MOST_EVER, Restore, Tally, Work,
};
use crate::effect::Checked;
use crate::event::{Code, EventKind, code};
use crate::injection::Injection;
use crate::line::SerialLine;
use crate::noise::Noise;

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
    /// Device that each action is about, the action in words, and whether it changed anything.
    actions: BTreeMap<EffectHandle, (usize, String, bool)>,
    layers: Vec<Layer>,
}

impl Rig {
    /// Begins an effect on a device now. `name` is that of its step: it identifies the effect in events,
    /// and seeds its random numbers, which are the same in every run with the same seed, whatever else is
    /// at work. Returns what [`clear`](Self::clear) ends, if it can end.
    ///
    /// # Errors
    /// When there is no such device, it or its world does not allow this, or too many faults are at
    /// work.
    pub fn apply(
        &mut self,
        device: usize,
        name: &str,
        effect: &Checked,
    ) -> Result<Option<EffectHandle>, EffectError> {
        let (info, link, now, seed) = (effect.info(), effect.link(), self.now, self.settings.seed);
        if device >= self.slots.len() {
            return Err(EffectError::NoDevice(device));
        }
        let faults = &self.slots[device].faults;
        let armed = faults.as_ref().map_or(0, |faults| faults.count());
        if info.is_fault() && (armed >= MOST_ARMED || self.fault_hits.len() >= MOST_EVER) {
            return Err(EffectError::TooMany);
        }
        // Begun again under the same name, a fault draws other numbers than the first time.
        let times = 1 + self.fault_names.get(name).copied().unwrap_or(0);
        self.rest_to_grid(device);
        let slot = &mut self.slots[device];
        let mut tally = Tally::default();
        let work = effect.effect().begin(&mut Begin {
            now,
            device: slot.device.as_mut(),
            world: &mut self.world,
            framing: slot.spec.links[link].framing,
            tally: &mut tally,
            stream: &|purpose| Noise::new(seed, &format!("fault.{name}.{times}.{purpose}")),
        })?;
        let handle = self.effects.begin();
        if info.is_fault() {
            self.fault_names.insert(name.to_owned(), times);
            self.fault_hits.insert(handle, 0);
            let event = EventKind::of_fault(code::FAULT_ARMED, name, info.id, "armed");
            self.events.push(event.at(now, device));
        } else {
            let what = format!("step \"{name}\": {} {}", info.level.key(), info.id);
            self.emit_action(device, code::ACTION_APPLIED, what.clone());
            let changes = match &work {
                Work::Done(changes) => changes.iter().any(|change| change.restore.is_some()),
                _ => true,
            };
            self.effects.actions.insert(handle, (device, what, changes));
        }
        match work {
            Work::Done(changes) => {
                if changes.iter().any(|change| change.in_world) {
                    self.with_world(|_| {});
                } else {
                    self.after_change(device);
                }
                if changes.is_empty() {
                    self.effects.actions.remove(&handle);
                    return Ok(None);
                }
                self.effects.add(handle, device, changes);
            }
            work => {
                if matches!(&work, Work::Bytes(bytes) if bytes.adapter().is_some()) {
                    self.pass_to_adapters(device);
                }
                let slot = &mut self.slots[device];
                let links = slot.lines.len();
                let attached = slot.lines.get(link).is_some_and(SerialLine::is_attached);
                slot.faults
                    .get_or_insert_with(|| Box::new(Injection::new(links, now)));
                // What has arrived already has arrived whole.
                self.pump(device);
                let slot = &mut self.slots[device];
                let Some(faults) = &mut slot.faults else {
                    return Ok(None);
                };
                faults.arm(now, (handle, name), info, (link, attached), (work, tally));
                faults.apply(now, slot.device.as_mut(), &mut self.world);
                slot.set_faulty_ends(now);
                self.after_change(device);
            }
        }
        Ok(Some(handle))
    }

    /// Ends an effect, and brings back what was before it. What has ended already stays so.
    pub fn clear(&mut self, effect: EffectHandle) {
        self.disarm(effect);
        if let Some((device, what, _)) = self.effects.actions.remove(&effect) {
            self.emit_action(device, code::ACTION_REVERTED, format!("{what}, undone"));
        }
        self.restore(effect);
    }

    /// Ends an action without an event: it goes on in the same one that came after it.
    pub fn supersede(&mut self, action: EffectHandle) {
        self.effects.actions.remove(&action);
        self.restore(action);
    }

    /// Makes an action permanent: what was before it does not come back.
    pub fn keep(&mut self, action: EffectHandle) {
        self.effects.actions.remove(&action);
        self.effects.keep(action);
    }

    /// Number of hits of an effect so far; its declaration says what counts.
    #[must_use]
    pub fn hits(&self, effect: EffectHandle) -> u64 {
        let action = self.effects.actions.get(&effect);
        let changed = action.map(|(_, _, changed)| u64::from(*changed));
        let hits = self.fault_hits.get(&effect).copied();
        hits.or(changed).unwrap_or(0)
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

    fn emit_action(&mut self, device: usize, code: Code, text: String) {
        let event = EventKind::new(code, text);
        self.events.push(event.at(self.now, device));
    }
}

impl Effects {
    /// The next one.
    pub(super) fn begin(&mut self) -> EffectHandle {
        self.begun += 1;
        EffectHandle(self.begun)
    }

    /// Applies the effect's overrides to the device or the world.
    pub(super) fn add(&mut self, effect: EffectHandle, device: usize, changes: Vec<Change>) {
        self.layers.extend(changes.into_iter().map(|change| Layer {
            effect,
            device: (!change.in_world).then_some(device),
            of: change.of,
            restore: change.restore,
        }));
    }

    /// Removes an effect; returns what restores the values that only it covered.
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

    /// Makes an effect permanent: what is below it does not come back.
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
mod tests;
