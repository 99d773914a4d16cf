//! Faults of firmware and hardware as time passes: interference, and what they have an effect on.

use sim_physics::mecanum::Wheel;
use sim_physics::r150::Side;
use sim_settings::SimTime;

use super::active::{Faults, Target, Work};
use super::{Fault, firmware, mecanum, r150};

impl Faults {
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
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a cast from a float saturates, and nobody counts so many pulses"
)]
fn pulses(whole: f64) -> u32 {
    whole as u32
}
