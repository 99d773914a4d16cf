//! Service of one device at one instant: it takes what has arrived, serves its deadlines, and what
//! it has to say goes onto its lines.

use rigsim_settings::SimTime;

use super::{Rig, Slot};
use crate::device::Device;
use crate::event::{Event, EventKind, code};
use crate::injection::Injection;
use crate::line::{SerialLine, event::reply_dropped};
use crate::newest::Newest;

/// After so many bytes of one instant, as on a line without pacing, what they led to is taken. A
/// device keeps a thousand events, and none of its frames is shorter than two bytes.
const BYTES_BETWEEN: usize = 64;

impl Rig {
    /// Does what is due for a device at the present time: arrivals, then deadlines.
    pub(super) fn serve(&mut self, device: usize) {
        let now = self.now;
        let slot = &mut self.slots[device];
        let unit = slot.device.as_mut();
        let faults = slot.faults.as_deref_mut();
        let mut reported = 0;
        deliver(now, unit, &mut slot.lines, faults, &mut |unit| {
            reported += 1;
            if reported % BYTES_BETWEEN == 0 {
                take_events(device, unit, &mut self.events);
            }
        });
        let due = unit.next_deadline().is_some_and(|due| due <= now);
        if due {
            unit.advance(now);
        }
        // Most bytes do no more than to lengthen a frame.
        if due || reported >= BYTES_BETWEEN || unit.has_output() {
            self.update_signals(device);
        }
        self.collect_output(device);
    }

    /// Follows up whatever has happened to a device at the present time.
    pub(super) fn after_change(&mut self, device: usize) {
        self.update_signals(device);
        self.collect_output(device);
    }

    /// Passes pins and measurements between firmware and hardware of a device.
    fn update_signals(&mut self, device: usize) {
        self.rest_to_grid(device);
        let now = self.now;
        if let Some(slot) = self.slots.get_mut(device) {
            let unit = slot.device.as_mut();
            let passed = now.since(slot.plant_at);
            unit.exchange_signals(now, passed);
            if unit.next_deadline().is_some_and(|due| due <= now) {
                // What the firmware answers to a measurement at once, such as a trip without delay.
                unit.advance(now);
                unit.exchange_signals(now, passed);
            }
        }
    }

    /// Takes what a device has to say, and notes when it next has something to do.
    fn collect_output(&mut self, device: usize) {
        let Some(slot) = self.slots.get_mut(device) else {
            return;
        };
        let now = self.now;
        send(now, device, slot, &mut self.events);
        take_events(device, slot.device.as_mut(), &mut self.events);
        let tips = slot.device.plant().is_tipping();
        if !std::mem::replace(&mut slot.tips, tips) && tips {
            let text = "a wheel would lift: the vehicle would tip over";
            let event = EventKind::new(code::TIPPING, text);
            self.events.push(event.at(now, device));
        }
        self.deadlines.set(device, next(slot));
        let watched = slot.faults.is_some();
        if self.resting && !slot.device.plant().at_rest() {
            for other in 0..self.slots.len() {
                self.rest_to_grid(other);
            }
            self.resting = false;
            self.physics_due = self
                .physics_due
                .min(now.next_multiple(self.world.step_length()));
        }
        if watched {
            self.watch_faults(device);
        }
    }
}

/// Takes what a device tells, before it has to forget any of it.
fn take_events(device: usize, unit: &mut dyn Device, events: &mut Newest<Event>) {
    while let Some((at, kind)) = unit.poll_event() {
        events.push(kind.at(at, device));
    }
}

/// Hands a device the bytes that have arrived; `between` is called after each.
fn deliver(
    now: SimTime,
    unit: &mut dyn Device,
    lines: &mut [SerialLine],
    mut faults: Option<&mut Injection>,
    between: &mut dyn FnMut(&mut dyn Device),
) {
    for (link, line) in lines.iter_mut().enumerate() {
        if let Some(faults) = &mut faults {
            faults.pump(now, link, line);
        }
        while let Some(byte) = match &mut faults {
            Some(faults) => faults.take_for_device(now, link),
            None => line.take_for_device(now),
        } {
            unit.receive(now, link, &[byte]);
            between(unit);
        }
    }
}

/// Puts what a device has to say onto its lines, or what faults make of it.
fn send(now: SimTime, device: usize, slot: &mut Slot, events: &mut Newest<Event>) {
    let mut put = |line: &mut SerialLine, link: usize, bytes: &[u8], has_room: bool| {
        let event = if has_room {
            line.device_sends(now, bytes)
        } else {
            Some(reply_dropped(bytes.len()))
        };
        if let Some(event) = event {
            events.push(event.on(link).at(now, device));
        }
    };
    let unit = slot.device.as_mut();
    let Some(faults) = &mut slot.faults else {
        while let Some((link, bytes)) = unit.poll_output() {
            put(&mut slot.lines[link], link, &bytes, true);
        }
        return;
    };
    let mut put = |faults: &mut Injection, link: usize, frame: &[u8]| {
        let line = &mut slot.lines[link];
        faults.before_sending(now, link, frame.len(), line);
        put(line, link, frame, faults.has_room(link));
    };
    while let Some((link, bytes)) = unit.poll_output() {
        for frame in faults.send(now, link, bytes) {
            put(faults, link, &frame);
        }
    }
    while let Some((link, frame)) = faults.take_due(now) {
        put(faults, link, &frame);
    }
}

/// When a device next has something to do.
fn next(slot: &Slot) -> SimTime {
    let arrivals = slot.lines.iter().filter_map(SerialLine::next_for_device);
    let of_device = arrivals.chain(slot.device.next_deadline()).min();
    let Some(faults) = &slot.faults else {
        return of_device.unwrap_or(SimTime::MAX);
    };
    // Faults of the wire act on bytes to the client when they arrive, too.
    let lines = slot.lines.iter().filter(|_| faults.act_on_wire());
    let to_client = lines.filter_map(SerialLine::next_off_wire);
    let all = to_client.chain(faults.next()).chain(of_device);
    all.min().unwrap_or(SimTime::MAX)
}
