//! What steps do to vehicles and to the world around them, and how that ends.

use sim_core::SimTime;
use sim_core::mecanum_device as mecanum;
use sim_core::r150_device::vehicle;
use sim_physics::r150::{Load, PwmSource, Rail};
use sim_physics::world::{Obstacle, ObstacleError};
use sim_physics::{Ground, Pose, World};

use super::Run;
use crate::scenario::{OperatorAction, WorldAction};

/// What ends the effect of a step.
#[derive(Debug, Clone)]
pub(super) enum Undo {
    /// Nothing is left to be undone: a repetition's time is over.
    Nothing,
    Fault(u64),
    R150(vehicle::Action),
    Mecanum(mecanum::Action),
    Push,
    Payload,
    TakeAway(Vec<String>),
    MoveBack(String, Pose),
    PutBack(Box<Obstacle>),
    Friction,
    Load(Rail, Load),
    Pwm(usize),
}

impl Run {
    pub(super) fn operate(&mut self, device: usize, action: &OperatorAction) -> Option<Undo> {
        match action {
            OperatorAction::R150(action, end) => {
                self.rig
                    .with_device(device, |r150: &mut R150, _, now| r150.operate(now, *action));
                end.map(Undo::R150)
            }
            OperatorAction::Mecanum(action, end) => {
                self.rig
                    .with_device(device, |car: &mut Mecanum, _, now| car.operate(now, *action));
                end.map(Undo::Mecanum)
            }
            OperatorAction::Push(push) => {
                self.push(device, *push);
                Some(Undo::Push)
            }
            OperatorAction::Payload(mass) => {
                self.payload(device, *mass);
                Some(Undo::Payload)
            }
            OperatorAction::Place(pose) => {
                self.rig.with_device(device, |r150: &mut R150, world, _| {
                    r150.place(world, *pose);
                });
                self.rig.with_device(device, |car: &mut Mecanum, world, _| {
                    car.plant_mut().place(world, *pose);
                });
                None
            }
        }
    }

    fn push(&mut self, device: usize, [ahead, left, turn]: [f64; 3]) {
        self.rig.with_device(device, |r150: &mut R150, _, _| {
            r150.set_push(ahead, left, turn);
        });
        self.rig.with_device(device, |car: &mut Mecanum, _, _| {
            car.plant_mut().set_push(ahead, left, turn);
        });
    }

    fn payload(&mut self, device: usize, mass: f64) {
        self.rig.with_device(device, |r150: &mut R150, world, _| {
            r150.set_payload(world, mass);
        });
        self.rig.with_device(device, |car: &mut Mecanum, world, _| {
            car.plant_mut().set_payload(world, mass);
        });
    }

    pub(super) fn change_world(
        &mut self,
        index: usize,
        device: usize,
        action: &WorldAction,
        now: SimTime,
    ) -> Option<Undo> {
        match action {
            WorldAction::Add(map) => {
                let added = self.rig.with_world(|world| world.add_map(map));
                self.or_fail(index, now, added)?;
                let names = action.brings().map(str::to_owned).collect();
                Some(Undo::TakeAway(names))
            }
            WorldAction::Move {
                obstacle,
                place,
                heading,
            } => {
                let change = |world: &mut World| world.move_obstacle(obstacle, *place, *heading);
                let moved = self.rig.with_world(change);
                let back = self.or_fail(index, now, moved)?;
                Some(Undo::MoveBack(obstacle.clone(), back))
            }
            WorldAction::Remove(obstacle) => {
                let removed = self.rig.with_world(|world| world.remove_obstacle(obstacle));
                let obstacle = self.or_fail(index, now, removed)?;
                Some(Undo::PutBack(Box::new(obstacle)))
            }
            WorldAction::Friction(friction) => {
                let ground = self.ground.with_friction_of(&Ground::flat(*friction));
                self.rig.with_world(|world| world.set_ground(ground));
                Some(Undo::Friction)
            }
            WorldAction::Load(rail, load) => {
                let before = self.load(device, *rail, *load)?;
                Some(Undo::Load(*rail, before))
            }
            WorldAction::Pwm(input, source) => {
                self.pwm(device, *input, *source);
                Some(Undo::Pwm(*input))
            }
        }
    }

    fn or_fail<T>(
        &mut self,
        index: usize,
        now: SimTime,
        changed: Result<T, ObstacleError>,
    ) -> Option<T> {
        changed
            .map_err(|why| self.fail_step(index, now, why.to_string()))
            .ok()
    }

    /// Wires a load; gives what was there before.
    fn load(&mut self, device: usize, rail: Rail, load: Load) -> Option<Load> {
        self.rig
            .with_device(device, |r150: &mut R150, _, _| r150.set_load(rail, load))
    }

    fn pwm(&mut self, device: usize, input: usize, source: PwmSource) {
        self.rig.with_device(device, |r150: &mut R150, _, _| {
            r150.set_pwm_source(input, source);
        });
    }

    pub(super) fn undo(&mut self, index: usize, undo: Undo) {
        let device = self.scenario.steps[index].device;
        match undo {
            Undo::Nothing => {}
            Undo::Fault(number) => self.clear_fault(index, number),
            Undo::R150(action) => {
                self.rig
                    .with_device(device, |r150: &mut R150, _, now| r150.operate(now, action));
            }
            Undo::Mecanum(action) => {
                self.rig
                    .with_device(device, |car: &mut Mecanum, _, now| car.operate(now, action));
            }
            Undo::Push => self.push(device, [0.0; 3]),
            Undo::Payload => self.payload(device, 0.0),
            // Another step may have taken it away or put one of its name there meanwhile; then that
            // is what counts.
            Undo::TakeAway(names) => self.rig.with_world(|world| {
                for name in &names {
                    let _ = world.remove_obstacle(name);
                }
            }),
            Undo::MoveBack(name, Pose { x, y, heading }) => self.rig.with_world(|world| {
                let _ = world.move_obstacle(&name, [x, y], Some(heading));
            }),
            Undo::PutBack(obstacle) => self.rig.with_world(|world| {
                let _ = world.add_obstacle(*obstacle);
            }),
            Undo::Friction => {
                let ground = self.ground;
                self.rig.with_world(|world| world.set_ground(ground));
            }
            Undo::Load(rail, before) => {
                self.load(device, rail, before);
            }
            Undo::Pwm(input) => self.pwm(device, input, PwmSource::None),
        }
    }
}
