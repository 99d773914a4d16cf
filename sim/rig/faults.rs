//! Faults in a rig.

use sim_settings::SimTime;

use super::{PortId, Rig, Slot};
use crate::device::EffectHandle;
use crate::fault::{
    Fault, FaultError, FaultEvent, FaultKind, FaultPhase, FirmwareFault, MOST_ARMED, MOST_EVER,
    WireFault,
};
use crate::injection::Injection;
use crate::line::SerialLine;
use crate::noise::Noise;

impl Rig {
    /// Arms a fault on a device now. `name` tells it apart in events, and gives its random numbers:
    /// the same ones in every run with the same seed, whatever else is armed.
    ///
    /// # Errors
    /// When there is no such device, it cannot have such a fault, or too many are armed.
    pub fn inject(
        &mut self,
        device: usize,
        name: &str,
        fault: &Fault,
    ) -> Result<EffectHandle, FaultError> {
        let now = self.now;
        let slot = self.slots.get(device).ok_or(FaultError::NoDevice(device))?;
        let link = possible(fault, slot).map_err(FaultError::Impossible)?;
        let armed = slot.faults.as_ref().map_or(0, |faults| faults.count());
        if armed >= MOST_ARMED || self.fault_hits.len() >= MOST_EVER {
            return Err(FaultError::TooMany);
        }
        let handle = self.effects.begin();
        self.fault_hits.insert(handle, 0);
        self.fault_event(device, name, fault.id(), FaultPhase::Armed);
        // Armed again under the same name, a fault draws other numbers than the first time.
        let times = self.fault_names.entry(name.to_owned()).or_insert(0);
        *times += 1;
        let stem = format!("fault.{name}.{times}");
        let seed = self.settings.seed;
        self.rest_to_grid(device);
        let slot = &mut self.slots[device];
        let links = slot.lines.len();
        let faults = slot
            .faults
            .get_or_insert_with(|| Box::new(Injection::new(links, now)));
        // What has arrived already has arrived whole.
        for (link, line) in slot.lines.iter_mut().enumerate() {
            faults.pump(now, link, line);
        }
        let stream = |purpose: &str| Noise::new(seed, &format!("{stem}.{purpose}"));
        let own = slot.device.as_mut();
        let changes = faults.arm(now, (handle, name), (fault, link), own, stream);
        faults.apply(now, own, &mut self.world);
        if let FaultKind::Wire(WireFault::CablePulled {}) = fault.kind {
            let attached = slot.lines.get(link).is_some_and(SerialLine::is_attached);
            faults.pull_cable(now, link, attached);
        }
        slot.follow_baud(now);
        self.effects.add(handle, device, changes);
        self.after_change(device);
        Ok(handle)
    }

    /// Ends a fault, if it is one that is armed.
    pub(super) fn disarm(&mut self, handle: EffectHandle) {
        let now = self.now;
        let arms = |slot: &Slot| slot.faults.as_ref().is_some_and(|own| own.arms(handle));
        let Some(device) = self.slots.iter().position(arms) else {
            return;
        };
        // What has arrived until now is still the fault's.
        self.pump(device);
        self.report_faults(device);
        self.rest_to_grid(device);
        let slot = &mut self.slots[device];
        let Some(faults) = &mut slot.faults else {
            return;
        };
        let own = slot.device.as_mut();
        let ended = faults.disarm(now, handle, own);
        faults.apply(now, own, &mut self.world);
        slot.follow_baud(now);
        if let Some((name, id)) = ended {
            self.fault_event(device, &name, id, FaultPhase::Cleared);
        }
        self.after_change(device);
    }

    /// Takes what has arrived off the lines of a device with faults.
    fn pump(&mut self, device: usize) {
        let slot = &mut self.slots[device];
        if let Some(faults) = &mut slot.faults {
            for (link, line) in slot.lines.iter_mut().enumerate() {
                faults.pump(self.now, link, line);
            }
        }
    }

    /// Number of times that a fault has acted so far; the catalogue says what counts.
    #[must_use]
    pub fn fault_hits(&self, handle: EffectHandle) -> u64 {
        self.fault_hits.get(&handle).copied().unwrap_or(0)
    }

    /// Tells whether the cable of a port is out: whoever serves the port to a real client hangs it
    /// up as long as this holds.
    #[must_use]
    pub fn cable_pulled(&self, port: PortId) -> bool {
        let slot = self.slots.get(port.device);
        slot.and_then(|slot| slot.faults.as_ref())
            .is_some_and(|faults| faults.cable_pulled(port.link))
    }

    /// Looks what the faults of a device have done, and tells of it.
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
        faults.report(|handle, name, id, hits, first| {
            if let Some(own) = self.fault_hits.get_mut(&handle) {
                *own = hits;
            }
            if let Some(what) = first {
                let phase = FaultPhase::Triggered { what };
                let name = name.to_owned();
                self.events.keep(at, device, FaultEvent { name, id, phase });
            }
        });
    }

    fn fault_event(&mut self, device: usize, name: &str, id: &'static str, phase: FaultPhase) {
        let name = name.to_owned();
        let event = FaultEvent { name, id, phase };
        self.events.keep(self.now, device, event);
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

    /// Has the device's ends of the lines run at the speeds that the faults say.
    fn follow_baud(&mut self, now: SimTime) {
        for (link, line) in self.lines.iter_mut().enumerate() {
            let faults = self.faults.as_ref();
            line.set_faulty_baud(now, faults.and_then(|faults| faults.baud(link)));
        }
    }
}

/// Tells whether a device as it is set up can have a fault; gives the link that it is about.
fn possible(fault: &Fault, slot: &Slot) -> Result<usize, String> {
    slot.spec.check(fault)?;
    if let FaultKind::Firmware(FirmwareFault::WatchdogOff {}) = fault.kind {
        slot.device.check_watchdog()?;
    }
    let Some(name) = fault.link() else {
        return Ok(0);
    };
    let link = slot.spec.link(name.as_str());
    link.filter(|link| *link < slot.lines.len())
        .ok_or_else(|| format!("`link`: the {name} link of this device is not configured"))
}
