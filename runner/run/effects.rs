//! Effects of steps on vehicles and on the world around them, and their end.

use std::fmt;

use sim_core::SimTime;
use sim_core::device::Action;
use sim_core::rig::Rig;
use sim_physics::world::ObstacleError;
use sim_physics::{Ground, Pose, World};

use super::Run;
use crate::scenario::WorldAction;

/// End of the effect of a step.
pub(super) enum Undo {
    /// Nothing is left to be undone: a repetition's time is over.
    Nothing,
    /// The step's fault with this number ends.
    Fault(u64),
    /// Something in the rig goes back to what it was.
    Effect(Box<dyn FnOnce(&mut Rig) + Send>),
}

impl fmt::Debug for Undo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Nothing => "Nothing",
            Self::Fault(_) => "Fault",
            Self::Effect(_) => "Effect",
        })
    }
}

impl Undo {
    fn in_world(undo: impl FnOnce(&mut World) + Send + 'static) -> Self {
        Self::Effect(Box::new(move |rig| rig.with_world(undo)))
    }
}

impl Run {
    /// Does something to a device.
    pub(super) fn operate(&mut self, device: usize, action: &dyn Action) -> Option<Undo> {
        let done = self
            .rig
            .with_any_device(device, |own, world, now| action.perform(own, world, now));
        let undo = done.flatten()?;
        Some(Undo::Effect(Box::new(move |rig| {
            rig.with_any_device(device, undo);
        })))
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
                let names: Vec<String> = action.brings().map(str::to_owned).collect();
                // Another step may have taken it away or put one of its name there meanwhile; then
                // that is what counts.
                Some(Undo::in_world(move |world| {
                    for name in &names {
                        let _ = world.remove_obstacle(name);
                    }
                }))
            }
            WorldAction::Move {
                obstacle,
                place,
                heading,
            } => {
                let change = |world: &mut World| world.move_obstacle(obstacle, *place, *heading);
                let moved = self.rig.with_world(change);
                let Pose { x, y, heading } = self.or_fail(index, now, moved)?;
                let name = obstacle.clone();
                Some(Undo::in_world(move |world| {
                    let _ = world.move_obstacle(&name, [x, y], Some(heading));
                }))
            }
            WorldAction::Remove(obstacle) => {
                let removed = self.rig.with_world(|world| world.remove_obstacle(obstacle));
                let obstacle = self.or_fail(index, now, removed)?;
                Some(Undo::in_world(|world| {
                    let _ = world.add_obstacle(obstacle);
                }))
            }
            WorldAction::Friction(friction) => {
                let usual = self.ground;
                let ground = usual.with_friction_of(&Ground::flat(*friction));
                self.rig.with_world(|world| world.set_ground(ground));
                Some(Undo::in_world(move |world| world.set_ground(usual)))
            }
            WorldAction::Device(action) => self.operate(device, action.as_ref()),
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

    pub(super) fn undo(&mut self, index: usize, undo: Undo) {
        match undo {
            Undo::Nothing => {}
            Undo::Fault(number) => self.clear_fault(index, number),
            Undo::Effect(undo) => {
                self.note_deed(index, true);
                undo(&mut self.rig);
            }
        }
    }
}
