//! Faults in a rig while they are at work.

use rigsim_settings::SimTime;

use super::{PortId, Rig, Slot};
use crate::device::EffectHandle;
use crate::event::{EventKind, code};

impl Rig {
    /// Ends a fault, if it is one that is armed.
    pub(super) fn disarm(&mut self, handle: EffectHandle) {
        let now = self.now;
        let arms = |slot: &Slot| {
            slot.faults
                .as_ref()
                .is_some_and(|injection| injection.arms(handle))
        };
        let Some(device) = self.slots.iter().position(arms) else {
            return;
        };
        // What has arrived until now is still the fault's.
        self.pump(device);
        let slot = &self.slots[device];
        let adapter = |link| slot.faults.as_ref()?.adapter(link);
        if (0..slot.lines.len()).any(|link| adapter(link).is_some()) {
            self.pass_to_adapters(device);
        }
        self.report_faults(device);
        self.rest_to_grid(device);
        let slot = &mut self.slots[device];
        let Some(faults) = &mut slot.faults else {
            return;
        };
        let target = slot.device.as_mut();
        let ended = faults.disarm(now, handle);
        faults.apply(now, target, &mut self.world);
        slot.set_faulty_ends(now);
        if let Some((name, info)) = ended.filter(|(_, info)| info.is_fault()) {
            let event = EventKind::of_fault(code::FAULT_CLEARED, &name, info.id, "cleared");
            self.events.push(event.at(now, device));
        }
        self.after_change(device);
    }

    /// Takes what has arrived off the lines of a device with faults.
    pub(super) fn pump(&mut self, device: usize) {
        let slot = &mut self.slots[device];
        if let Some(faults) = &mut slot.faults {
            for (link, line) in slot.lines.iter_mut().enumerate() {
                faults.pump(self.now, link, line);
            }
        }
    }

    /// Passes what has come through by now on to the adapters of the clients, before others replace them.
    pub(super) fn pass_to_adapters(&mut self, device: usize) {
        let slot = &mut self.slots[device];
        for (link, line) in slot.lines.iter_mut().enumerate() {
            match &mut slot.faults {
                Some(faults) => faults.pass_to_adapter(self.now, link, line),
                None => line.pass_to_adapter(self.now),
            }
        }
    }

    /// Returns whether the cable of a port is out: the server of the port to a real client hangs it
    /// up as long as this holds.
    #[must_use]
    pub fn cable_pulled(&self, port: PortId) -> bool {
        let slot = self.slots.get(port.device);
        slot.and_then(|slot| slot.faults.as_ref())
            .is_some_and(|faults| faults.cable_pulled(port.link))
    }

    /// Checks what the faults of a device have hit, and reports it.
    pub(super) fn watch_faults(&mut self, device: usize) {
        let slot = &mut self.slots[device];
        let Some(faults) = &mut slot.faults else {
            return;
        };
        faults.watch(slot.device.as_ref());
        self.report_faults(device);
        let slot = &mut self.slots[device];
        slot.faults.take_if(|faults| faults.is_spent());
    }

    fn report_faults(&mut self, device: usize) {
        let at = self.now;
        let Some(faults) = &mut self.slots[device].faults else {
            return;
        };
        faults.report(|handle, name, info, hits, first| {
            if let Some(total) = self.fault_hits.get_mut(&handle) {
                *total = hits;
            }
            if let Some(what) = first.filter(|_| info.is_fault()) {
                let what = format!("triggered: {what}");
                let event = EventKind::of_fault(code::FAULT_TRIGGERED, name, info.id, &what);
                self.events.push(event.at(at, device));
            }
        });
    }
}

impl Slot {
    /// Times at which something next arrives at each client that is there.
    pub(super) fn next_for_clients(&self) -> impl Iterator<Item = SimTime> {
        let attached = self.lines.iter().enumerate();
        let attached = attached.filter(|(_, line)| line.is_attached());
        attached.flat_map(|(link, line)| {
            let faults = self.faults.as_ref();
            let held = faults.and_then(|faults| faults.next_for_client(link));
            line.next_for_client().into_iter().chain(held)
        })
    }

    /// Sets both ends of the lines to what the faults say.
    pub(super) fn set_faulty_ends(&mut self, now: SimTime) {
        for (link, line) in self.lines.iter_mut().enumerate() {
            let faults = self.faults.as_ref();
            line.set_faulty_baud(now, faults.and_then(|faults| faults.baud(link)));
            line.set_faulty_adapter(faults.and_then(|faults| faults.adapter(link)));
        }
    }
}
