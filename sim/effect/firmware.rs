//! Faults of the firmware: bugs in the device's program.

use rigsim_settings::Span;

use super::defaults;
use crate::defects::DefectCounts;
use crate::device::{Begin, Device, Effect, EffectError, OnHardware, Sum, Tally, Work};

crate::faults! {
    /// Bugs in the device's program.
    pub enum FirmwareFault {
        /// The firmware restarts: its outputs go off, and it ignores all input until it is up.
        Reset = "reset", Firmware,
        sees "Silence for the boot time; then rails and PWM off, control with the app, motions forgotten.",
        counts "The firmware ran and was reset.",
        tries ["boot = \"2 s\"", ""]
        lasts [50]
        {
            /// Time until it is up again; default 500 ms. It takes that long even if the fault ends.
            #[serde(default = "defaults::boot")]
            boot: Span,
        }
        /// The firmware hangs: it sends no reply, no timeout fires, and outputs stay as they are.
        Hang = "hang", Firmware,
        sees "Silence, while the vehicle continues what it last did.",
        counts "A byte was ignored, or a packet not sent.",
        weaker ["slow-replies", "mute"]
        {}
        /// The firmware replies late; a car sends its packets late.
        SlowReplies = "slow-replies", Firmware,
        sees "Late replies; fewer status packets.",
        counts "A frame was late.",
        tries ["by = \"600 ms\"", ""]
        {
            /// Delay; default 200 ms.
            #[serde(default = "defaults::slow")]
            by: Span,
        }
        /// The firmware no longer updates the status it reports.
        StuckStatus = "stuck-status", Firmware,
        sees "`sysStatus`, modes and switched outputs, or `moto_state`, do not change; the rest is live.",
        counts "A reply carried old status that is no longer true.",
        {}
        /// The firmware no longer reads its sensors, and uses the last readings.
        FrozenSensors = "frozen-sensors", Firmware,
        sees "Speeds, voltages, currents and temperatures, or distances, tag and strip, that never change.",
        counts "A sensor would have read something else.",
        {}
        /// The firmware's watchdog does not fire: an R150's for motor commands; a car's `link_timeout`.
        WatchdogOff = "watchdog-off", Firmware,
        sees "A vehicle that continues although the client sends nothing.",
        counts "The watchdog should have stopped it.",
        lasts [2000, 0]
        {}
    }
}

impl Effect for FirmwareFault {
    fn begin(&self, at: &mut Begin<'_>) -> Result<Work, EffectError> {
        match self {
            Self::Reset { boot } if at.device.reset(at.now, boot.0) => {
                at.tally.hit(|| "the firmware ran and was reset".to_owned());
            }
            Self::WatchdogOff {} => at
                .device
                .check_watchdog()
                .map_err(EffectError::Impossible)?,
            _ => {}
        }
        let (count, _) = self.shown(&at.device.defect_counts());
        at.tally.count_from(count);
        Ok(Work::Hardware(Box::new(self.clone())))
    }

    fn disturbs_requests(&self) -> bool {
        matches!(self, Self::Reset { .. } | Self::Hang {})
    }
}

impl FirmwareFault {
    /// How often it has shown, and in words what did.
    fn shown(&self, counts: &DefectCounts) -> (u64, &'static str) {
        match self {
            Self::Reset { .. } => (0, ""),
            Self::Hang {} => (counts.hung, "a byte not heard, or a packet not sent"),
            Self::SlowReplies { .. } => (counts.slow, "a frame"),
            Self::StuckStatus {} => (counts.stuck_status, "a reply with old status"),
            Self::FrozenSensors {} => (counts.frozen_sensors, "a reading not taken over"),
            Self::WatchdogOff {} => (counts.watchdog_off, "motors that should have stopped"),
        }
    }
}

impl OnHardware for FirmwareFault {
    fn add(&self, sum: &mut Sum) {
        let defects = &mut sum.defects;
        match self {
            // Done at once.
            Self::Reset { .. } => {}
            Self::Hang {} => defects.hung = true,
            Self::SlowReplies { by } => defects.slow = defects.slow.saturating_add(by.0),
            Self::StuckStatus {} => defects.stuck_status = true,
            Self::FrozenSensors {} => defects.frozen_sensors = true,
            Self::WatchdogOff {} => defects.watchdog_off = true,
        }
    }

    fn watch(&mut self, device: &dyn Device, tally: &mut Tally) {
        let (count, what) = self.shown(&device.defect_counts());
        tally.count_to(count, || what.to_owned());
    }
}
