//! Effects of steps on vehicles and on the world around them, and their end.

use sim_core::SimTime;
use sim_core::device::{Action, Change};
use sim_core::rig::Rig;
use sim_physics::world::{Obstacle, ObstacleError};
use sim_physics::{Ground, Pose, World};

use super::Run;
use super::layers::{Changed, Restore};
use crate::scenario::WorldAction;

/// End of the effect of a step.
#[derive(Debug, Clone, Copy)]
pub(super) enum Undo {
    /// Nothing is left to be undone: a repetition's time is over.
    Nothing,
    /// The step's fault with this number ends.
    Fault(u64),
    /// What this effect has changed goes back to what it was.
    Effect(u64),
}

impl Run {
    /// Does something to a device.
    pub(super) fn operate(&mut self, device: usize, action: &dyn Action) -> Option<Undo> {
        let done = self
            .rig
            .with_any_device(device, |own, world, now| action.perform(own, world, now));
        let Change { of, restore } = done.flatten()?;
        let restore = restore.map(|restore| -> Restore {
            Box::new(move |rig: &mut Rig| {
                rig.with_any_device(device, restore);
            })
        });
        let of = (Some(device), of);
        Some(Undo::Effect(self.layers.add(vec![Changed { of, restore }])))
    }

    pub(super) fn change_world(
        &mut self,
        index: usize,
        device: usize,
        action: &WorldAction,
        now: SimTime,
    ) -> Option<Undo> {
        let changes = match action {
            WorldAction::Add(map) => {
                let added = self.rig.with_world(|world| world.add_map(map));
                self.or_fail(index, now, added)?;
                let names = action.brings();
                names.flat_map(|name| presence(name, None)).collect()
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
                // It is not there if who brought it has taken it away.
                vec![in_world(place_of(obstacle), true, move |world| {
                    let _ = world.move_obstacle(&name, [x, y], Some(heading));
                })]
            }
            WorldAction::Remove(obstacle) => {
                let removed = self.rig.with_world(|world| world.remove_obstacle(obstacle));
                let removed = self.or_fail(index, now, removed)?;
                presence(obstacle, Some(removed)).into()
            }
            WorldAction::Friction(friction) => {
                let before = self.rig.world().ground();
                let ground = before.with_friction_of(&Ground::flat(*friction));
                self.rig.with_world(|world| world.set_ground(ground));
                let restore = move |world: &mut World| world.set_ground(before);
                vec![in_world("friction".to_owned(), before != ground, restore)]
            }
            WorldAction::Device(action) => return self.operate(device, action.as_ref()),
        };
        Some(Undo::Effect(self.layers.add(changes)))
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
            Undo::Effect(effect) => {
                self.note_deed(index, true);
                for restore in self.layers.take(effect) {
                    restore(&mut self.rig);
                }
            }
        }
    }
}

/// Coming or going of an obstacle, which was as given or not there `before`.
fn presence(name: &str, before: Option<Obstacle>) -> [Changed; 2] {
    let owned = name.to_owned();
    let there = in_world(format!("obstacle {name}"), true, move |world| {
        // There may be another of its name now, or none at all.
        let _ = world.remove_obstacle(&owned);
        if let Some(before) = before {
            let _ = world.add_obstacle(before);
        }
    });
    // Wherever one of its name was before, it is another place that counts from now on.
    let place = in_world(place_of(name), false, |_| {});
    [there, place]
}

fn place_of(obstacle: &str) -> String {
    format!("place of {obstacle}")
}

/// Change of something in the world.
fn in_world(
    of: String,
    changed: bool,
    restore: impl FnOnce(&mut World) + Send + 'static,
) -> Changed {
    let restore: Restore = Box::new(move |rig| rig.with_world(restore));
    Changed {
        of: (None, of),
        restore: changed.then_some(restore),
    }
}
