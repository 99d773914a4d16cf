//! Traffic between a device and its clients while faults are armed: bytes off the line, frames
//! on their way to it.

use rigsim_settings::SimTime;

use super::{Injection, Tally, Way, Work};
use crate::device::OnBytes;
use crate::line::{Adapter, MOST_IN_FLIGHT, SerialLine};

/// Most frames that wait for their time.
const MOST_LATE: usize = 256;

impl Injection {
    /// Takes what has arrived on a link by `now` off its line.
    pub(crate) fn pump(&mut self, now: SimTime, link: usize, line: &mut SerialLine) {
        while let Some(byte) = line.take_for_device(now) {
            self.pass(now, link, Way::ToDevice, byte);
        }
        self.pump_to_client(now, link, line);
        let idle = [
            line.next_for_device().is_none(),
            line.next_off_wire().is_none() && line.is_attached(),
        ];
        for way in Way::ALL {
            let Some(both_ways) = self.delayed.get_mut(link) else {
                return;
            };
            for armed in &mut self.armed {
                if let Work::Bytes(on_bytes) = &mut armed.work
                    && armed.link == link
                    && let Some(byte) = on_bytes.add(now, way, idle[way.index()], &mut armed.tally)
                {
                    both_ways[way.index()].push(now, byte);
                }
            }
        }
    }

    /// Takes what has arrived at the client of a link by `now` off its line.
    pub(crate) fn pump_to_client(&mut self, now: SimTime, link: usize, line: &mut SerialLine) {
        while let Some((_, byte)) = line.take_off_wire(now) {
            self.pass(now, link, Way::ToClient, byte);
        }
    }

    /// Returns whether all that a line carries can wait for the client of a link, which does not read.
    pub(crate) fn has_room(&self, link: usize) -> bool {
        let delayed = self.delayed.get(link);
        delayed.is_none_or(|both_ways| both_ways[Way::ToClient.index()].room() >= MOST_IN_FLIGHT)
    }

    fn pass(&mut self, now: SimTime, link: usize, way: Way, byte: u8) {
        let mut bytes = vec![(now, byte)];
        for (wire, tally) in self.wires_mut(link) {
            wire.pass(way, &mut bytes, tally);
        }
        if let Some(both_ways) = self.delayed.get_mut(link) {
            for (at, byte) in bytes {
                both_ways[way.index()].push(at, byte);
            }
        }
    }

    pub(crate) fn take_for_device(&mut self, now: SimTime, link: usize) -> Option<u8> {
        let taken = self.delayed.get_mut(link)?[Way::ToDevice.index()].take(now);
        taken.map(|(_, byte)| byte)
    }

    /// Passes what has come through by `now` on to the client's adapter.
    pub(crate) fn pass_to_adapter(&mut self, now: SimTime, link: usize, line: &mut SerialLine) {
        self.pump_to_client(now, link, line);
        if let Some(both_ways) = self.delayed.get_mut(link) {
            while let Some((at, byte)) = both_ways[Way::ToClient.index()].take(now) {
                line.adapter_hears(at, byte);
            }
        }
    }

    /// A frame is about to be put on a line. What has arrived makes room for it, whether its client
    /// has read it or not.
    pub(crate) fn before_sending(
        &mut self,
        now: SimTime,
        link: usize,
        bytes: usize,
        line: &mut SerialLine,
    ) {
        self.pump_to_client(now, link, line);
        self.count_sent(link, Way::ToClient, bytes, line.is_garbled());
    }

    /// Bytes are put on a line.
    pub(crate) fn count_sent(&mut self, link: usize, way: Way, bytes: usize, garbled: bool) {
        for (wire, tally) in self.wires_mut(link) {
            if garbled || wire.pulls_cable() {
                wire.count_sent(way, bytes, tally);
            }
        }
    }

    /// Spoils a frame that the firmware sends at `now`, and keeps what is put off.
    pub(crate) fn send(&mut self, now: SimTime, link: usize, frame: Vec<u8>) -> Vec<Vec<u8>> {
        let mut frames = vec![(now, frame)];
        for armed in &mut self.armed {
            if let Work::Frames(on_frames) = &mut armed.work
                && armed.link == link
            {
                on_frames.pass(&mut frames, &mut armed.tally);
            }
        }
        let mut at_once = Vec::new();
        for (at, frame) in frames {
            if at <= now {
                at_once.push(frame);
            } else if self.late.len() < MOST_LATE {
                self.order += 1;
                self.late.insert((at, self.order), (link, frame));
            }
        }
        at_once
    }

    /// The next frame whose time has come, with its link.
    pub(crate) fn take_due(&mut self, now: SimTime) -> Option<(usize, Vec<u8>)> {
        if let Some(entry) = self.late.first_entry()
            && entry.key().0 <= now
        {
            return Some(entry.remove());
        }
        self.armed
            .iter_mut()
            .find_map(|armed| match &mut armed.work {
                Work::Frames(on_frames) => on_frames
                    .send(now, &mut armed.tally)
                    .map(|frame| (armed.link, frame)),
                _ => None,
            })
    }

    /// Returns whether bytes must be looked at when they arrive.
    pub(crate) fn act_on_wire(&self) -> bool {
        let mut works = self.armed.iter().map(|armed| &armed.work);
        works.any(|work| matches!(work, Work::Bytes(_)))
    }

    pub(crate) fn cable_pulled(&self, link: usize) -> bool {
        self.wires(link).any(OnBytes::pulls_cable)
    }

    /// A cable has been pulled: what was on its way is lost.
    pub(crate) fn pull_cable(&mut self, now: SimTime, link: usize, attached: bool) {
        if let Some(both_ways) = self.delayed.get_mut(link) {
            both_ways.iter_mut().for_each(|way| way.cut(now));
        }
        for (wire, tally) in self.wires_mut(link) {
            if attached && wire.pulls_cable() {
                tally.hit(|| "a client had the port open".to_owned());
            }
        }
    }

    /// The wrong speed at which the device's end of a link runs.
    pub(crate) fn baud(&self, link: usize) -> Option<u32> {
        self.wires(link).filter_map(OnBytes::baud).last()
    }

    /// The adapter that replaces a client's.
    pub(crate) fn adapter(&self, link: usize) -> Option<Adapter> {
        self.wires(link).filter_map(OnBytes::adapter).last()
    }

    /// Time of the next thing that happens here, besides bytes that arrive at the device.
    pub(crate) fn next(&self) -> Option<SimTime> {
        let to_device = self
            .delayed
            .iter()
            .filter_map(|both_ways| both_ways[Way::ToDevice.index()].next());
        let from_faults = self.armed.iter().filter_map(|armed| match &armed.work {
            Work::Bytes(bytes) => bytes.due(),
            Work::Frames(frames) => frames.due(),
            Work::Hardware(_) | Work::Done(_) => None,
        });
        let late = self.late.keys().next().map(|(at, _)| *at);
        to_device.chain(from_faults).chain(late).min()
    }

    /// Time at which the next byte arrives at the client of a link.
    pub(crate) fn next_for_client(&self, link: usize) -> Option<SimTime> {
        self.delayed.get(link)?[Way::ToClient.index()].next()
    }

    /// Releases what no stall blocks any more.
    pub(super) fn release(&mut self, now: SimTime, link: usize) {
        for way in Way::ALL {
            let stalled = self.wires(link).any(|wire| wire.stalls(way));
            if let (false, Some(both_ways)) = (stalled, self.delayed.get_mut(link)) {
                both_ways[way.index()].release(now);
            }
        }
    }

    fn wires(&self, link: usize) -> impl Iterator<Item = &dyn OnBytes> {
        self.armed
            .iter()
            .filter_map(move |armed| match &armed.work {
                Work::Bytes(wire) if armed.link == link => Some(wire.as_ref()),
                _ => None,
            })
    }

    fn wires_mut(
        &mut self,
        link: usize,
    ) -> impl Iterator<Item = (&mut Box<dyn OnBytes>, &mut Tally)> {
        self.armed
            .iter_mut()
            .filter_map(move |armed| match &mut armed.work {
                Work::Bytes(wire) if armed.link == link => Some((wire, &mut armed.tally)),
                _ => None,
            })
    }
}
