//! PWM inputs.

use super::settings::PwmSettings;
use super::signals::{PwmReading, PwmSource};

/// What an input makes of its source.
///
/// The outputs are open-drain: the duty of an output is the time that it lets go of the line, so that
/// an input wired to it reads the same duty back. A level that never changes has no period, and a
/// signal outside the input's limits is not seen at all.
pub(super) fn read(source: PwmSource, own_duty: &[f64; 4], settings: &PwmSettings) -> PwmReading {
    let (frequency, duty, high) = match source {
        PwmSource::None => return PwmReading::default(),
        PwmSource::Generator {
            frequency,
            duty,
            high_voltage,
        } => (frequency, duty, high_voltage),
        PwmSource::OwnOutput(output) => {
            let Some(duty) = own_duty.get(output) else {
                return PwmReading::default();
            };
            (settings.output_frequency, *duty, settings.output_pull_up)
        }
    };
    let measurable = high >= settings.input_high
        && frequency >= settings.input_frequency_min
        && frequency <= settings.input_frequency_max
        && duty > 0.0
        && duty < 1.0;
    if measurable {
        PwmReading { frequency, duty }
    } else {
        PwmReading::default()
    }
}
