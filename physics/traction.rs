//! Wheels on the ground: tyre forces from slip, limited by friction.
//!
//! # Model
//!
//! Each contact patch has a deflection `z` along two axes, as if the tread were a brush between the
//! wheel and the ground. It grows with the slip velocity `v` (the ground's view of the patch) and
//! is shed as fresh tread rolls in:
//!
//! ```text
//! dz/dt = v − |rolling speed| / relaxation length · z
//! F     = −k (z + t_d v)          per axis, k = slip stiffness · load / relaxation length
//! |F|   ≤ friction · load         both axes together
//! ```
//!
//! Rolling steadily this is the linear tyre `F = −slip stiffness · load · v / rolling speed` up to
//! the friction limit; standing still it is a spring, so a parked vehicle stays where it is and
//! does not creep as it would with a force from slip alone. The damping `t_d` keeps the spring from
//! ringing and fades out as the wheel starts to roll. Source: H. B. Pacejka, *Tire and Vehicle
//! Dynamics*, 3rd ed. 2012, sections 7.2 and 8.6 (single contact point transient model,
//! standstill).
//!
//! The forces are stiff against a 5 ms step, so they are found together with the velocities they
//! lead to: every patch is a soft constraint, in general solved by projected Gauss–Seidel iteration
//! over the impulses of one step (E. Catto, *Soft Constraints*, GDC 2011, for the constraint; M.
//! Anitescu and F. A. Potra, *Nonlinear Dynamics* 14, 1997, for time stepping with Coulomb
//! friction). The constraints are far softer than the bodies they join, so a few rounds suffice.
//! While no patch slides there is nothing to project and the solution is found directly.
//!
//! Nothing here knows which vehicle it is: a wheel turns several patches or one, and how the axes
//! of a patch lie is up to its [`Contact`]: [`Straight`] for a tyre, [`Slanted`] for a mecanum
//! wheel, whose first axis is that of the roller on the ground and whose second is the way in which
//! the roller turns. The tread of a roller is as stiff one way as the other, and the bearing of the
//! roller gives way: across, the deflection does not grow beyond what `drag · load` takes, by the
//! friction model of P. R. Dahl, *A Solid Friction Model*, 1968. Along, the tread that turns up by
//! the roller's own spin is fresh as well:
//!
//! ```text
//! dz/dt = v − (|rolling speed| + |slip across|) / relaxation length · z                along
//! dz/dt = v − (|rolling speed| / relaxation length + |slip across| · k / (drag · load)) z   across
//! ```
//!
//! The ground turns a roller only by friction. Where the limit is reached, a roller that turns takes
//! its drag from what friction gives, and what is left acts along; a roller that friction cannot
//! turn slides like a tyre. A strafe at 45° needs a friction of √2 · drag to go on.

mod contact;
mod loads;
mod settings;
mod solve;

pub use contact::{Contact, Slanted, Straight};
pub use loads::Stance;
pub use settings::TyreSettings;

use crate::twist::Twist;

/// A place where a wheel meets the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Patch {
    /// Metres ahead of the body's centre.
    pub x: f64,
    /// Metres left of the body's centre.
    pub y: f64,
    /// Index of the wheel speed that turns it.
    pub wheel: usize,
}

/// Force of a patch on the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroundForce {
    /// On the body, along and across, N.
    pub force: [f64; 2],
    /// With which it is pressed down, N.
    pub load: f64,
    /// The most that friction gives, N.
    pub most: f64,
}

/// A wheel, or several geared together, as the drive presents it for one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wheel {
    /// Speed at the end of the step if the ground did nothing, rad/s; on return with the ground.
    pub speed: f64,
    /// The N·m·s that it takes to change the speed at the end of the step by 1 rad/s, kg·m². A
    /// motor that opposes speed makes it larger.
    pub inertia: f64,
    /// The inverse of that, or zero for a wheel that cannot turn.
    pub compliance: f64,
    /// The most that dry friction and brakes can hold, N·m.
    pub hold_torque: f64,
}

/// The body for one step, in its own axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chassis {
    /// kg
    pub mass: f64,
    /// kg·m²
    pub inertia: f64,
    /// Velocity at the end of the step if the ground did nothing; on return with the ground.
    pub velocity: Twist,
}

/// The patches of one vehicle with their state.
#[derive(Debug, Clone)]
pub struct Traction<const WHEELS: usize, const PATCHES: usize, C = Straight> {
    patches: [PatchState<C>; PATCHES],
    /// Impulses of dry friction and brakes in the last step, N·m·s, and the most they could do.
    hold: [f64; WHEELS],
    hold_limit: [f64; WHEELS],
    /// Set if a patch slid in the last step.
    slides: bool,
    /// Length of the last step, s.
    dt: f64,
    law: TyreLaw,
}

#[derive(Debug, Clone, Copy)]
struct PatchState<C> {
    place: Patch,
    contact: C,
    /// Drag of the contact where it turns by itself, as a share of the load.
    drag: f64,
    /// Speed at which the contact turns by itself, m/s.
    spin: f64,
    /// Factor by which the force across would be more in this step if it did not turn.
    stuck: f64,
    /// Along and across, m.
    deflection: [f64; 2],
    /// Of the last step, along and across, N·s; the next solution starts from it.
    impulse: [f64; 2],
    /// Spring stiffness of the last step, N/m.
    stiffness: [f64; 2],
    /// Part of a deflection that is left after the step's rolling, along and across.
    shed: [f64; 2],
    /// Load and friction limit of the last step, N.
    load: f64,
    limit: f64,
}

/// Time over which a standing tyre damps its own ringing, s: settles a parked vehicle in about one
/// swing.
const DAMPING_TIME: f64 = 0.03;

/// [`TyreSettings`] in the form that the solver wants.
#[derive(Debug, Clone, Copy)]
struct TyreLaw {
    radius: f64,
    stiffness_per_load: [f64; 2],
    relaxation_length: f64,
    inverse_fade_speed: f64,
}

impl<const WHEELS: usize, const PATCHES: usize, C: Contact> Traction<WHEELS, PATCHES, C> {
    /// Undeflected wheels of any kind, whose tyres damp their ringing below `fade_speed`, m/s. A wheel
    /// whose contact turns by itself has one patch only.
    #[must_use]
    pub fn new(settings: &TyreSettings, fade_speed: f64, patches: [(Patch, C); PATCHES]) -> Self {
        Self {
            patches: patches.map(|(place, contact)| PatchState {
                place,
                contact,
                drag: 1.0,
                spin: 0.0,
                stuck: 1.0,
                deflection: [0.0; 2],
                impulse: [0.0; 2],
                stiffness: [0.0; 2],
                shed: [1.0; 2],
                load: 0.0,
                limit: 0.0,
            }),
            hold: [0.0; WHEELS],
            hold_limit: [0.0; WHEELS],
            slides: false,
            dt: 0.0,
            law: TyreLaw::new(settings, fade_speed),
        }
    }

    /// Forgets deflections, as after lifting the vehicle off the ground.
    pub fn relax(&mut self) {
        self.hold = [0.0; WHEELS];
        self.slides = false;
        for patch in &mut self.patches {
            patch.deflection = [0.0; 2];
            patch.impulse = [0.0; 2];
            patch.spin = 0.0;
        }
    }

    /// Strains the patches as those of a vehicle that has stood for long: against a `pull` on the
    /// body, ahead and left, each as the share of the `loads` on it.
    pub fn strain(&mut self, pull: [f64; 2], loads: [f64; PATCHES]) {
        let weight: f64 = loads.iter().sum();
        if weight <= 0.0 {
            return;
        }
        for (patch, load) in self.patches.iter_mut().zip(loads) {
            if load > 0.0 {
                let pull = patch.contact.split(pull);
                patch.deflection = std::array::from_fn(|axis| {
                    pull[axis] / (self.law.stiffness_per_load[axis] * weight)
                });
            }
        }
    }

    /// Returns whether a patch slid in the last step.
    #[must_use]
    pub fn slides(&self) -> bool {
        self.slides
    }

    /// Returns whether a patch was pushed across by more than this share of what friction gives.
    #[must_use]
    pub fn is_strained_across(&self, share: f64) -> bool {
        let patches = &self.patches;
        (patches.iter()).any(|patch| patch.impulse[1].abs() > share * patch.limit * self.dt)
    }

    /// Returns what every patch did on the ground in the last step, or part of one; nothing before
    /// the first.
    #[must_use]
    pub fn on_ground(&self) -> [GroundForce; PATCHES] {
        let rate = self.rate();
        self.patches.map(|patch| GroundForce {
            force: patch.impulse.map(|impulse| impulse * rate),
            load: patch.load,
            most: patch.limit,
        })
    }

    /// Impulses of dry friction and brakes on the wheels in the last step, N·m·s.
    #[must_use]
    pub fn held(&self) -> [f64; WHEELS] {
        self.hold
    }

    /// Energy that the patches took from body and wheels in the last step, J; their speeds are the
    /// means of its beginning and its end.
    #[must_use]
    pub fn lost(&self, velocity: Twist, wheel_speeds: [f64; WHEELS]) -> f64 {
        let lost = self.patches.iter().map(|patch| {
            let slip = patch.slip(velocity, wheel_speeds[patch.place.wheel] * self.law.radius);
            -(patch.impulse[0] * slip[0] + patch.impulse[1] * slip[1])
        });
        lost.sum()
    }

    /// Sets the drag of contacts that turn by themselves, as shares of the load.
    pub fn set_drag(&mut self, drags: [f64; PATCHES]) {
        for (patch, drag) in self.patches.iter_mut().zip(drags) {
            patch.drag = drag;
        }
    }

    /// The force of all patches on the body in the last step, ahead and left, N.
    #[must_use]
    pub fn force(&self) -> [f64; 2] {
        let mut sum = [0.0; 2];
        for patch in &self.patches {
            let [ahead, left] = patch.contact.join(patch.impulse);
            sum[0] += ahead;
            sum[1] += left;
        }
        sum.map(|impulse| impulse * self.rate())
    }

    /// Steps of the last one's length in a second; none before the first.
    fn rate(&self) -> f64 {
        if self.dt > 0.0 { 1.0 / self.dt } else { 0.0 }
    }

    /// Updates the deflections by the velocities that the step really ended with.
    ///
    /// These differ from the solver's where the body met an obstacle: a vehicle that pushes a wall
    /// keeps its tyres strained and stands still.
    pub fn update_deflections(&mut self, velocity: Twist, wheel_speeds: [f64; WHEELS]) {
        let dt = self.dt;
        for patch in &mut self.patches {
            let slip = patch.slip(velocity, wheel_speeds[patch.place.wheel] * self.law.radius);
            patch.spin = patch.contact.spin(slip);
            let mut force = [0.0; 2];
            for axis in 0..2 {
                let deflection = patch.deflection[axis] + dt * slip[axis];
                patch.deflection[axis] = patch.shed[axis] * deflection;
                force[axis] = patch.stiffness[axis] * patch.deflection[axis];
            }
            let kept = solve::kept(force, patch.limit, patch.stuck);
            patch.deflection[0] *= kept[0];
            patch.deflection[1] *= kept[1];
        }
    }
}

impl<C: Contact> PatchState<C> {
    /// Velocity of the patch over the ground, along and across, m/s.
    fn slip(&self, velocity: Twist, rolling: f64) -> [f64; 2] {
        self.contact.split([
            velocity.ahead - velocity.turn * self.place.y - rolling,
            velocity.left + velocity.turn * self.place.x,
        ])
    }

    /// The forward part of an impulse along and across, which turns the wheel back.
    fn ahead(&self, impulse: [f64; 2]) -> f64 {
        self.contact.join(impulse)[0]
    }
}

impl TyreLaw {
    fn new(settings: &TyreSettings, fade_speed: f64) -> Self {
        Self {
            radius: settings.wheel_radius,
            stiffness_per_load: [
                settings.longitudinal_stiffness / settings.relaxation_length,
                settings.lateral_stiffness / settings.relaxation_length,
            ],
            relaxation_length: settings.relaxation_length,
            inverse_fade_speed: 1.0 / fade_speed,
        }
    }
}
