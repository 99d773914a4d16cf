//! The faults that are armed on one device.

use std::collections::BTreeMap;

use sim_physics::World;
use sim_physics::mecanum::Wheel;
use sim_physics::r150::Side;
use sim_settings::SimTime;

use super::frame::Form;
use super::mecanum::Echoes;
use super::protocol::FrameFault;
use super::stage::Stage;
use super::wire::{Way, WireFault};
use super::{Fault, FaultHandle, FaultLevel, Tally, firmware, mecanum, operator, r150};
use crate::defects::DefectCounts;
use crate::device_kind::DeviceKind;
use crate::line::SerialLine;
use crate::mecanum::Mecanum;
use crate::noise::Noise;
use crate::r150::R150;
use crate::r150_device::vehicle::Action;

/// Most frames that wait for their time.
const MOST_LATE: usize = 256;

/// The device that has the faults.
pub(crate) enum Target<'r> {
    R150(&'r mut R150),
    Mecanum(&'r mut Mecanum),
}

impl Target<'_> {
    fn defect_counts(&self) -> &DefectCounts {
        match self {
            Self::R150(r150) => r150.device().defect_counts(),
            Self::Mecanum(car) => car.device().defect_counts(),
        }
    }
}

/// An armed fault.
struct Armed {
    handle: FaultHandle,
    name: String,
    fault: Fault,
    tally: Tally,
    work: Work,
}

/// What a fault keeps while it is armed.
enum Work {
    Wire(WireFault),
    Frames(FrameFault),
    Device(Box<OnDevice>),
}

struct OnDevice {
    noise: Noise,
    /// Whether the hardware fault had an effect when last looked at.
    acted: bool,
    /// How often the firmware's defect had shown when last looked at.
    counted: u64,
    /// What undoes the operator's deed.
    undo: Vec<Action>,
    /// What the ultrasonic sensors gave at the start.
    echoes: Echoes,
    /// What interference adds to the R150's encoders now, rpm.
    errors: [f64; 2],
    /// Shares of the car's next pulses of interference.
    pulses: [f64; 4],
}

/// All faults of one device, and what they hold back.
pub(crate) struct Faults {
    kind: DeviceKind,
    armed: Vec<Armed>,
    /// By link and way.
    stages: Vec<[Stage; 2]>,
    /// By time and order, with the link.
    late: BTreeMap<(SimTime, u64), (usize, Vec<u8>)>,
    order: u64,
    ticked: SimTime,
    r150: r150::Layer,
    car: mecanum::Layer,
}

impl Faults {
    pub(crate) fn new(kind: DeviceKind, links: usize, now: SimTime) -> Self {
        Self {
            kind,
            armed: Vec::new(),
            stages: (0..links).map(|_| Default::default()).collect(),
            late: BTreeMap::new(),
            order: 0,
            ticked: now,
            r150: r150::Layer::default(),
            car: mecanum::Layer::default(),
        }
    }

    pub(crate) fn count(&self) -> usize {
        self.armed.len()
    }

    pub(crate) fn arms(&self, handle: FaultHandle) -> bool {
        self.armed.iter().any(|armed| armed.handle == handle)
    }

    /// Whether nothing is armed nor held back any more.
    pub(crate) fn is_spent(&self) -> bool {
        self.armed.is_empty()
            && self.late.is_empty()
            && self.stages.iter().flatten().all(Stage::is_empty)
    }

    /// Arms a fault; `stream` gives it random numbers of its own for each purpose.
    pub(crate) fn arm(
        &mut self,
        now: SimTime,
        (handle, name): (FaultHandle, &str),
        fault: &Fault,
        target: &mut Target<'_>,
        stream: impl Fn(&str) -> Noise,
    ) {
        let mut tally = Tally::default();
        let kind = self.kind;
        let work = match fault.level() {
            FaultLevel::Wire => WireFault::new(fault, now, stream).map(Work::Wire),
            FaultLevel::Protocol => {
                let form = |link| Form::of(kind, link);
                FrameFault::new(fault, now, form, stream("frames")).map(Work::Frames)
            }
            _ => Some(self.begin(now, fault, target, stream("device"), &mut tally)),
        };
        let Some(work) = work else {
            return;
        };
        self.armed.push(Armed {
            handle,
            name: name.to_owned(),
            fault: fault.clone(),
            tally,
            work,
        });
    }

    fn begin(
        &self,
        now: SimTime,
        fault: &Fault,
        target: &mut Target<'_>,
        noise: Noise,
        tally: &mut Tally,
    ) -> Work {
        let counted = firmware::count(target.defect_counts(), fault).map_or(0, |(count, _)| count);
        let mut own = OnDevice {
            noise,
            acted: false,
            counted,
            undo: Vec::new(),
            echoes: Echoes::default(),
            errors: [0.0; 2],
            pulses: [0.0; 4],
        };
        let done = match (fault, target) {
            (Fault::Reset { boot }, Target::R150(r150)) => r150.reset(now, boot.0),
            (Fault::Reset { boot }, Target::Mecanum(car)) => car.reset(now, boot.0),
            (fault, Target::R150(r150)) => {
                let (undo, done) = operator::begin(fault, r150, now);
                own.undo = undo;
                let held = self.held().chain(operator::held_by(fault));
                done || operator::hold(held, r150, now)
            }
            (_, Target::Mecanum(car)) => {
                own.echoes = car.plant().unspoilt().echoes;
                false
            }
        };
        if done {
            tally.hit(|| fault.info().counts.trim_end_matches('.').to_owned());
        }
        Work::Device(Box::new(own))
    }

    fn held(&self) -> impl Iterator<Item = operator::Held> {
        self.armed
            .iter()
            .filter_map(|armed| operator::held_by(&armed.fault))
    }

    /// Ends a fault; gives its name and its id.
    pub(crate) fn disarm(
        &mut self,
        now: SimTime,
        handle: FaultHandle,
        target: &mut Target<'_>,
    ) -> Option<(String, &'static str)> {
        let at = self.armed.iter().position(|armed| armed.handle == handle)?;
        let ended = self.armed.remove(at);
        match &ended.work {
            Work::Wire(wire) if wire.stalls() => self.release(now, wire.link),
            Work::Device(own) => self.undo(now, &ended.fault, &own.undo, target),
            _ => {}
        }
        Some((ended.name, ended.fault.id()))
    }

    /// Lets go what no stall holds up any more.
    fn release(&mut self, now: SimTime, link: usize) {
        for way in Way::BOTH {
            let stalled = self.wires().any(|wire| wire.stalls_way(link, way));
            if let (false, Some(stage)) = (stalled, self.stages.get_mut(link)) {
                stage[way.index()].release(now);
            }
        }
    }

    fn undo(&mut self, now: SimTime, fault: &Fault, undo: &[Action], target: &mut Target<'_>) {
        let Target::R150(r150) = target else {
            return;
        };
        if operator::held_by(fault).is_some() {
            operator::hold(self.held(), r150, now);
            return;
        }
        // As long as somebody else does the same, it stays done, and is for him to undo.
        let heir = self
            .armed
            .iter_mut()
            .find(|armed| std::mem::discriminant(&armed.fault) == std::mem::discriminant(fault));
        match heir.map(|heir| &mut heir.work) {
            Some(Work::Device(heir)) => {
                if heir.undo.is_empty() {
                    heir.undo = undo.to_vec();
                }
            }
            _ => {
                for action in undo {
                    r150.operate(now, *action);
                }
            }
        }
    }

    /// Puts hardware and firmware into the state that all armed faults together make.
    pub(crate) fn apply(&mut self, now: SimTime, target: &mut Target<'_>, world: &mut World) {
        match target {
            Target::R150(r150) => {
                let errors = self.devices().fold([0.0; 2], |sum: [f64; 2], (_, own)| {
                    [sum[0] + own.errors[0], sum[1] + own.errors[1]]
                });
                let faults = self.armed.iter().map(|armed| &armed.fault);
                let layer = r150::Layer::of(faults, errors);
                layer.apply(&self.r150, r150, world, now);
                self.r150 = layer;
            }
            Target::Mecanum(car) => {
                let faults = self.devices().map(|(fault, own)| (fault, &own.echoes));
                let layer = mecanum::Layer::of(faults);
                layer.apply(&self.car, car, world, now);
                self.car = layer;
            }
        }
    }

    fn devices(&self) -> impl Iterator<Item = (&Fault, &OnDevice)> {
        self.armed.iter().filter_map(|armed| match &armed.work {
            Work::Device(own) => Some((&armed.fault, own.as_ref())),
            _ => None,
        })
    }

    fn wires(&self) -> impl Iterator<Item = &WireFault> {
        self.armed.iter().filter_map(|armed| match &armed.work {
            Work::Wire(wire) => Some(wire),
            _ => None,
        })
    }

    fn wires_mut(&mut self, link: usize) -> impl Iterator<Item = (&mut WireFault, &mut Tally)> {
        self.armed
            .iter_mut()
            .filter_map(move |armed| match &mut armed.work {
                Work::Wire(wire) if wire.link == link => Some((wire, &mut armed.tally)),
                _ => None,
            })
    }

    /// Time has passed for the hardware up to `now`: interference goes on.
    pub(crate) fn tick(&mut self, now: SimTime, target: &mut Target<'_>) {
        let seconds = now.since(self.ticked).as_secs_f64();
        self.ticked = now;
        let mut errors = [0.0; 2];
        for armed in &mut self.armed {
            let Fault::EncoderNoisy {
                motors,
                spread_rpm,
                pulses_per_second,
            } = armed.fault
            else {
                continue;
            };
            let Work::Device(own) = &mut armed.work else {
                continue;
            };
            match target {
                Target::R150(_) => {
                    for (index, side) in Side::BOTH.into_iter().enumerate() {
                        let error = own.noise.normal() * f64::from(spread_rpm);
                        if motors.has_side(side) {
                            own.errors[index] = error;
                            errors[index] += error;
                        }
                    }
                    if own.errors != [0.0; 2] {
                        armed.tally.hit(|| format!("motors {motors}"));
                    }
                }
                Target::Mecanum(car) => {
                    for wheel in Wheel::ALL {
                        let mean = f64::from(pulses_per_second) * seconds;
                        let share = &mut own.pulses[wheel.index()];
                        *share += mean * 2.0 * own.noise.uniform();
                        let whole = share.floor();
                        *share -= whole;
                        if motors.has_wheel(wheel) && whole >= 1.0 {
                            car.plant_mut().add_pulses(wheel, pulses(whole));
                            armed.tally.hit(|| format!("wheel {}", wheel.name()));
                        }
                    }
                }
            }
        }
        if let Target::R150(r150) = target
            && self.r150.set_errors(errors)
        {
            r150.plant_mut().set_encoder_error(errors.into());
        }
    }

    /// Looks whether faults of firmware and hardware have an effect.
    pub(crate) fn watch(&mut self, target: &Target<'_>) {
        for armed in &mut self.armed {
            let Work::Device(own) = &mut armed.work else {
                continue;
            };
            if let Some((count, what)) = firmware::count(target.defect_counts(), &armed.fault) {
                let more = count.saturating_sub(own.counted);
                armed.tally.hit_times(more, || what.to_owned());
                own.counted = count;
                continue;
            }
            let acts = match target {
                Target::R150(r150) => r150::acts(&armed.fault, r150),
                Target::Mecanum(car) => mecanum::acts(&armed.fault, &own.echoes, car),
            };
            if acts && !own.acted {
                armed.tally.hit(|| match target {
                    Target::R150(r150) => r150::what(&armed.fault, r150),
                    Target::Mecanum(_) => mecanum::words(&armed.fault),
                });
            }
            own.acted = acts;
        }
    }

    /// Hands on what has been counted: handle, name, id, hits, and at the first hit what it was.
    pub(crate) fn report(
        &mut self,
        mut told: impl FnMut(FaultHandle, &str, &'static str, u64, Option<String>),
    ) {
        for armed in &mut self.armed {
            let first = armed.tally.first.take();
            let id = armed.fault.id();
            told(armed.handle, &armed.name, id, armed.tally.hits, first);
        }
    }
}

/// Wire and frames.
impl Faults {
    /// Takes what has arrived on a link by `now` off its line.
    pub(crate) fn pump(&mut self, now: SimTime, link: usize, line: &mut SerialLine) {
        while let Some(byte) = line.take_for_device(now) {
            self.pass(now, link, Way::ToDevice, byte);
        }
        self.pump_to_client(now, link, line);
        let idle = [
            line.next_for_device().is_none(),
            line.next_for_client().is_none() && line.is_attached(),
        ];
        for way in Way::BOTH {
            let Some(stage) = self.stages.get_mut(link) else {
                return;
            };
            for armed in &mut self.armed {
                if let Work::Wire(wire) = &mut armed.work
                    && wire.link == link
                    && let Some(byte) =
                        wire.make_noise(now, way, idle[way.index()], &mut armed.tally)
                {
                    stage[way.index()].push(now, byte);
                }
            }
        }
    }

    /// Takes what has arrived at the client of a link by `now` off its line.
    pub(crate) fn pump_to_client(&mut self, now: SimTime, link: usize, line: &mut SerialLine) {
        let mut bytes = Vec::new();
        line.take_for_client(now, &mut bytes);
        for byte in bytes {
            self.pass(now, link, Way::ToClient, byte);
        }
    }

    fn pass(&mut self, now: SimTime, link: usize, way: Way, byte: u8) {
        let mut bytes = vec![(now, byte)];
        for (wire, tally) in self.wires_mut(link) {
            wire.pass(way, &mut bytes, tally);
        }
        if let Some(stage) = self.stages.get_mut(link) {
            for (at, byte) in bytes {
                stage[way.index()].push(at, byte);
            }
        }
    }

    pub(crate) fn take_for_device(&mut self, now: SimTime, link: usize) -> Option<u8> {
        self.stages.get_mut(link)?[Way::ToDevice.index()].take(now)
    }

    pub(crate) fn take_for_client(&mut self, now: SimTime, link: usize, bytes: &mut Vec<u8>) {
        if let Some(stage) = self.stages.get_mut(link) {
            bytes.extend(std::iter::from_fn(|| {
                stage[Way::ToClient.index()].take(now)
            }));
        }
    }

    /// The client of a link is gone, and what was on its way to it.
    pub(crate) fn detach(&mut self, link: usize) {
        if let Some(stage) = self.stages.get_mut(link) {
            stage[Way::ToClient.index()].clear();
        }
    }

    /// What is put off for a client that has left is nobody's.
    pub(crate) fn forget_late(&mut self, link: usize) {
        self.late.retain(|_, (own, _)| *own != link);
    }

    /// The client puts bytes on a line.
    pub(crate) fn client_sends(&mut self, link: usize, bytes: usize, garbled: bool) {
        self.note_sent(link, Way::ToDevice, bytes, garbled);
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
        self.note_sent(link, Way::ToClient, bytes, line.is_garbled());
    }

    fn note_sent(&mut self, link: usize, way: Way, bytes: usize, garbled: bool) {
        for (wire, tally) in self.wires_mut(link) {
            if garbled || wire.pulls_cable(link) {
                wire.note_sent(way, bytes, tally);
            }
        }
    }

    /// What a frame that the firmware sends at `now` becomes; what is put off is kept.
    pub(crate) fn send(&mut self, now: SimTime, link: usize, frame: Vec<u8>) -> Vec<Vec<u8>> {
        let mut frames = vec![(now, frame)];
        for armed in &mut self.armed {
            if let Work::Frames(own) = &mut armed.work
                && own.link == link
            {
                own.pass(&mut frames, &mut armed.tally);
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
                Work::Frames(own) => own
                    .send(now, &mut armed.tally)
                    .map(|frame| (own.link, frame)),
                _ => None,
            })
    }

    /// Whether bytes must be looked at when they arrive.
    pub(crate) fn act_on_wire(&self) -> bool {
        self.wires().next().is_some()
    }

    pub(crate) fn cable_pulled(&self, link: usize) -> bool {
        self.wires().any(|wire| wire.pulls_cable(link))
    }

    /// A cable has been pulled: what was on its way is lost.
    pub(crate) fn pull_cable(&mut self, now: SimTime, link: usize, attached: bool) {
        if let Some(stage) = self.stages.get_mut(link) {
            stage.iter_mut().for_each(|way| way.cut(now));
        }
        for (wire, tally) in self.wires_mut(link) {
            if attached && wire.pulls_cable(link) {
                tally.hit(|| "a client had the port open".to_owned());
            }
        }
    }

    /// The wrong speed at which the device's end of a link runs.
    pub(crate) fn baud(&self, link: usize) -> Option<u32> {
        let own = self.wires().filter(|wire| wire.link == link);
        own.filter_map(WireFault::baud).last()
    }

    /// When something here next happens, besides bytes that arrive at the device.
    pub(crate) fn next(&self) -> Option<SimTime> {
        let to_device = self
            .stages
            .iter()
            .filter_map(|stage| stage[Way::ToDevice.index()].next());
        let own = self.armed.iter().filter_map(|armed| match &armed.work {
            Work::Wire(wire) => wire.noise_due(),
            Work::Frames(frames) => frames.due(),
            Work::Device(_) => None,
        });
        let late = self.late.keys().next().map(|(at, _)| *at);
        to_device.chain(own).chain(late).min()
    }

    /// When the next byte arrives at a client.
    pub(crate) fn next_for_client(&self) -> Option<SimTime> {
        self.stages
            .iter()
            .filter_map(|stage| stage[Way::ToClient.index()].next())
            .min()
    }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a cast from a float saturates, and nobody counts so many pulses"
)]
fn pulses(whole: f64) -> u32 {
    whole as u32
}
