//! One vehicle in one world, advanced as the simulator does.
#![allow(dead_code, reason = "each test binary uses its own part")]
#![allow(unreachable_pub, reason = "shared by including the file")]
#![allow(clippy::unwrap_used, reason = "a failed step fails the test")]

use std::time::Duration;

use rigsim_physics::faults::BodyFaults;
use rigsim_physics::r150::Sides;
use rigsim_physics::{
    Ground, Plant as _, Pose, R150Commands, R150Plant, R150PlantSettings, World, WorldSettings,
    Wrench,
};

/// The default ground's friction.
pub const FRICTION: f64 = 0.8;

pub struct Bench {
    pub world: World,
    pub plant: R150Plant,
    pub commands: R150Commands,
}

impl Bench {
    pub fn new() -> Self {
        Self::with(&R150PlantSettings::default())
    }

    pub fn with(settings: &R150PlantSettings) -> Self {
        let mut world = World::new(&WorldSettings::default());
        let plant = R150Plant::new("r150", settings, &mut world, Pose::default());
        Self {
            world,
            plant,
            commands: R150Commands::default(),
        }
    }

    /// A vehicle whose motor drivers limit nothing and take no time.
    pub fn unlimited() -> Self {
        let mut settings = R150PlantSettings::default();
        settings.motor.current_limit = None;
        settings.motor.ramp_up = Duration::ZERO;
        settings.motor.ramp_down = Duration::ZERO;
        Self::with(&settings)
    }

    /// A slope that rises in the direction in which the vehicle looks at the start.
    pub fn on_slope(degrees: f64, payload: f64) -> Self {
        let mut bench = Self::new();
        bench
            .world
            .set_ground(Ground::new(FRICTION, degrees.to_radians(), 0.0));
        bench.load(payload);
        bench
    }

    /// Pushes steadily until changed.
    pub fn push(&mut self, push: Wrench) {
        let faults = BodyFaults {
            push,
            ..*self.plant.vehicle().faults()
        };
        self.plant.set_body_faults(&mut self.world, &faults);
    }

    /// Puts a payload on the deck, kg.
    pub fn load(&mut self, payload: f64) {
        let faults = BodyFaults {
            payload,
            ..*self.plant.vehicle().faults()
        };
        self.plant.set_body_faults(&mut self.world, &faults);
    }

    pub fn drive(&mut self, right: f64, left: f64) {
        self.commands.motor_duty = Sides { right, left };
        self.plant.set_commands(&self.commands);
    }

    pub fn command(&mut self, change: impl FnOnce(&mut R150Commands)) {
        change(&mut self.commands);
        self.plant.set_commands(&self.commands);
    }

    pub fn step(&mut self) {
        self.plant.before_step(&mut self.world);
        self.world.step().unwrap();
        self.plant.after_step(&mut self.world);
    }

    pub fn run(&mut self, seconds: f64) {
        self.run_while(seconds, |_| true);
    }

    /// Steps for so long or until the condition ends; returns the seconds that passed.
    pub fn run_while(&mut self, seconds: f64, go: impl Fn(&Self) -> bool) -> f64 {
        let step = self.world.step_length().as_secs_f64();
        let mut passed = 0.0;
        while passed < seconds - step / 2.0 && go(self) {
            self.step();
            passed += step;
        }
        passed
    }

    pub fn speed(&self) -> f64 {
        self.plant.truth().motion.forward_speed
    }
}

/// 100 ms.
pub const TICK: Duration = Duration::from_millis(100);
