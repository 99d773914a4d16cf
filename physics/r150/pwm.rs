//! PWM inputs and outputs.

use super::settings::{OutputDuty, PwmSettings, SteadyLevel, Unmeasured};
use super::signals::{PwmReading, PwmSource};

/// Signal that reaches an input.
#[derive(Debug, Clone, Copy)]
struct Signal {
    frequency: f64,
    /// Share of the period at the high level, 0–1.
    duty: f64,
    high_voltage: f64,
}

/// Reads an input with this source; `last` is what it read before.
///
/// The outputs are open-drain, so the line is high while an output lets go of it. A level that
/// never changes has no period, and a signal outside the input's limits is not seen at all.
pub(super) fn read(
    source: PwmSource,
    own_duty: &[f64; 4],
    last: PwmReading,
    settings: &PwmSettings,
) -> PwmReading {
    let unmeasured = match settings.unmeasured {
        Unmeasured::Zero => PwmReading::default(),
        Unmeasured::Last => last,
    };
    let Some(signal) = signal(source, own_duty, settings) else {
        return unmeasured;
    };
    let high = signal.high_voltage >= settings.input_high;
    let steady = signal.duty <= 0.0 || signal.duty >= 1.0;
    let measurable = high
        && signal.high_voltage <= settings.input_voltage_max
        && signal.frequency >= settings.input_frequency_min
        && signal.frequency <= settings.input_frequency_max
        && signal.duty > 0.0
        && signal.duty < 1.0;
    if measurable {
        PwmReading {
            frequency: signal.frequency,
            duty: signal.duty,
        }
    } else if steady && settings.steady_level == SteadyLevel::Level {
        PwmReading {
            frequency: 0.0,
            duty: if high && signal.duty >= 1.0 { 1.0 } else { 0.0 },
        }
    } else {
        unmeasured
    }
}

fn signal(source: PwmSource, own_duty: &[f64; 4], settings: &PwmSettings) -> Option<Signal> {
    match source {
        PwmSource::None => None,
        PwmSource::Generator {
            frequency,
            duty,
            high_voltage,
        } => Some(Signal {
            frequency,
            duty,
            high_voltage,
        }),
        PwmSource::OwnOutput(output) => own_duty.get(output).map(|duty| Signal {
            frequency: settings.output_frequency,
            duty: match settings.output_duty {
                OutputDuty::Released => *duty,
                OutputDuty::Sinking => 1.0 - duty,
            },
            high_voltage: settings.output_pull_up,
        }),
    }
}
