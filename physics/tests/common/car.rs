//! One mecanum car in one world, advanced as the simulator does.
#![allow(dead_code, reason = "each test binary uses its own part")]
#![allow(unreachable_pub, reason = "shared by including the file")]
#![allow(clippy::unwrap_used, reason = "a failed step fails the test")]

use rigsim_physics::faults::{BodyFaults, MotorFaults};
use rigsim_physics::mecanum::{MecanumFaults, PlugSwaps, WHEELS, Wheel};
use rigsim_physics::{
    Ground, MecanumCommands, MecanumPlant, MecanumPlantSettings, Plant as _, Pose, World,
    WorldSettings, Wrench,
};

/// Radius of a wheel, m.
pub const RADIUS: f64 = 0.05;
/// Half the wheelbase plus half the track, m.
pub const ARM: f64 = 0.22;
/// Full speed, rad/s.
pub const FULL: f64 = 50.0 * std::f64::consts::TAU / 60.0;

/// The ten motions of the article's picture: name, rotation of LF, RF, LR, RR, and the direction of
/// the body: ahead, left, counter-clockwise.
pub const MOTIONS: [(&str, [i8; WHEELS], [i8; 3]); 10] = [
    ("X+ forward", [1, 1, 1, 1], [1, 0, 0]),
    ("X- backward", [-1, -1, -1, -1], [-1, 0, 0]),
    ("Y+ turn right", [1, -1, 1, -1], [0, 0, -1]),
    ("Y- turn left", [-1, 1, -1, 1], [0, 0, 1]),
    ("Z+ strafe left", [-1, 1, 1, -1], [0, 1, 0]),
    ("Z- strafe right", [1, -1, -1, 1], [0, -1, 0]),
    ("A+ left-front", [0, 1, 1, 0], [1, 1, 0]),
    ("A- right-rear", [0, -1, -1, 0], [-1, -1, 0]),
    ("B+ right-front", [1, 0, 0, 1], [1, -1, 0]),
    ("B- left-rear", [-1, 0, 0, -1], [-1, 1, 0]),
];

pub struct Car {
    pub world: World,
    pub plant: MecanumPlant,
}

impl Car {
    pub fn new() -> Self {
        Self::with(&MecanumPlantSettings::default())
    }

    pub fn with(settings: &MecanumPlantSettings) -> Self {
        Self::within(World::new(&WorldSettings::default()), settings)
    }

    pub fn within(mut world: World, settings: &MecanumPlantSettings) -> Self {
        let plant = MecanumPlant::new("mecanum", settings, &mut world, Pose::default());
        Self { world, plant }
    }

    /// Rollers and gears without drag on a floor that holds everything.
    pub fn ideal() -> Self {
        let mut settings = MecanumPlantSettings::default();
        settings.wheel.roller_drag = 0.0;
        settings.motor.gear_friction = 0.0;
        let mut car = Self::with(&settings);
        car.world.set_ground(Ground::flat(2.0));
        car
    }

    pub fn swapped(swaps: PlugSwaps) -> Self {
        let mut car = Self::new();
        let faults = MecanumFaults {
            swaps,
            ..MecanumFaults::default()
        };
        car.plant.set_faults(&faults);
        car
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

    /// What the firmware does to turn the wheels so.
    pub fn turn(&mut self, rotations: [i8; WHEELS], speed_voltage: f64) {
        let mut commands = MecanumCommands {
            speed_voltage,
            ..MecanumCommands::default()
        };
        for wheel in Wheel::ALL {
            let rotation = rotations[wheel.index()];
            let port = &mut commands.ports[wheel.port().index()];
            port.brake = rotation == 0;
            port.reverse = rotation < 0;
        }
        self.plant.set_commands(&commands);
    }

    pub fn brake(&mut self) {
        self.plant.set_commands(&MecanumCommands::default());
    }

    pub fn fault(&mut self, wheel: Wheel, faults: MotorFaults) {
        self.plant.set_wheel_faults(wheel, faults);
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

    /// How far the body would have gone by what its wheels turned: ahead, left, counter-clockwise.
    pub fn by_wheels(&self) -> [f64; 3] {
        let [lf, rf, lr, rr] = self.plant.truth().wheel_angle.map(|angle| angle * RADIUS);
        [
            (lf + rf + lr + rr) / 4.0,
            (-lf + rf + lr - rr) / 4.0,
            (-lf + rf - lr + rr) / (4.0 * ARM),
        ]
    }

    /// How far it has really gone from the origin: ahead, left, counter-clockwise.
    pub fn gone(&self) -> [f64; 3] {
        let pose = self.plant.truth().motion.pose;
        [pose.x, pose.y, pose.heading]
    }
}
