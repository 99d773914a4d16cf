//! PWM inputs and outputs.

use super::signals::{PwmReading, PwmSource};

/// Lowest voltage that an input takes as high, V (manual section 3).
const INPUT_HIGH: f64 = 2.0;
/// Highest voltage that an input takes, V (manual section 3d).
const INPUT_VOLTAGE_MAX: f64 = 15.0;
/// Frequencies that an input measures, Hz (manual section 4.3.4).
const INPUT_FREQUENCIES: std::ops::RangeInclusive<f64> = 10.0..=20_000.0;
/// Frequency of the outputs, Hz; the manual gives only the limit of 20 kHz.
const OUTPUT_FREQUENCY: f64 = 1000.0;
/// Voltage to which an output wired to an input is pulled up, V: logic level.
const OUTPUT_PULL_UP: f64 = 5.0;

/// Reads an input with this source; 0 Hz and 0 where it cannot measure the signal.
///
/// The outputs are open-drain, so the line is high while an output releases it. A level that
/// never changes has no period, and a signal outside the input's limits is not seen at all.
pub(super) fn read(source: PwmSource, own_duty: &[f64; 4]) -> PwmReading {
    let (frequency, duty, high_voltage) = match source {
        PwmSource::None => return PwmReading::default(),
        PwmSource::Generator {
            frequency,
            duty,
            high_voltage,
        } => (frequency, duty, high_voltage),
        PwmSource::OwnOutput(output) => {
            let duty = own_duty.get(output).copied().unwrap_or(0.0);
            (OUTPUT_FREQUENCY, duty, OUTPUT_PULL_UP)
        }
    };
    let measurable = (INPUT_HIGH..=INPUT_VOLTAGE_MAX).contains(&high_voltage)
        && INPUT_FREQUENCIES.contains(&frequency)
        && duty > 0.0
        && duty < 1.0;
    if measurable {
        PwmReading { frequency, duty }
    } else {
        PwmReading::default()
    }
}
