//! Changes of the world around any vehicle.

use std::borrow::Cow;

use rigsim_physics::world::Obstacle;
use rigsim_physics::{Pose, WorldMap};
use rigsim_settings::{Angle, Length};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::Deserialize;

use crate::device::{Begin, Change, Effect, EffectError, Work};

crate::actions! {
    /// A change around any vehicle.
    pub enum Surroundings: World {
        /// Puts things into the world, in the form of a world file: `wall`, `box`, `circle`, `slope`,
        /// `friction`, `tag`, `strip`. They stay. With `for`, they are removed after that; this needs
        /// obstacles with names.
        Add(Things) = "add";
        /// Moves an obstacle at once; with `for`, back after that.
        Move(MoveText) = "move";
        /// Removes the obstacle of this name; with `for`, it returns after that.
        Remove(String) = "remove";
    }
}

/// Place for an obstacle: the middle of a box or post, the first point of a wall.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MoveText {
    /// Its name in the world file, or in the step that added it.
    pub obstacle: String,
    /// East.
    pub x: Length,
    /// North.
    pub y: Length,
    /// Counter-clockwise from x; default its present heading.
    pub heading: Option<Angle>,
}

/// Things of a world file.
#[derive(Debug, Clone, Deserialize)]
#[serde(transparent)]
pub struct Things(pub WorldMap);

impl JsonSchema for Things {
    fn inline_schema() -> bool {
        true
    }

    fn schema_name() -> Cow<'static, str> {
        "Things".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "type": "object",
            "additionalProperties": true,
            "examples": [
                {"circle": [{"name": "a", "at_m": [0.5, 0.0], "radius": "0.2 m"}]},
                {"friction": [{
                    "area": {"circle": {"at_m": [0.0, 0.0], "radius": "1 m"}},
                    "friction": 0.2,
                }]},
            ],
        })
    }
}

impl Effect for Surroundings {
    fn begin(&self, at: &mut Begin<'_>) -> Result<Work, EffectError> {
        let world = &mut *at.world;
        Ok(Work::Done(match self {
            Self::Add(Things(map)) => {
                world.add_map(map)?;
                // What has no name stays.
                let things = Change::in_world("things", false, |_| {});
                let named = self.brings().into_iter();
                let named = named.flat_map(|name| presence(name, None));
                [things].into_iter().chain(named).collect()
            }
            Self::Move(to) => {
                let heading = to.heading.map(|angle| angle.0.to_radians());
                let Pose { x, y, heading } =
                    world.move_obstacle(&to.obstacle, [to.x.0, to.y.0], heading)?;
                let name = to.obstacle.clone();
                // It is not there if who brought it has taken it away.
                vec![Change::in_world(
                    place_of(&to.obstacle),
                    true,
                    move |world| {
                        let _ = world.move_obstacle(&name, [x, y], Some(heading));
                    },
                )]
            }
            Self::Remove(obstacle) => {
                let removed = world.remove_obstacle(obstacle)?;
                presence(obstacle, Some(removed)).into()
            }
        }))
    }

    fn can_end(&self) -> bool {
        let Self::Add(Things(map)) = self else {
            return true;
        };
        let WorldMap {
            obstacles,
            slopes,
            frictions,
            tags,
            strips,
        } = map;
        let ground = slopes.len() + frictions.len() + tags.len() + strips.len();
        ground == 0 && obstacles.iter().all(|obstacle| obstacle.name().is_some())
    }

    fn needs(&self) -> Option<&str> {
        match self {
            Self::Move(MoveText { obstacle, .. }) | Self::Remove(obstacle) => Some(obstacle),
            Self::Add(_) => None,
        }
    }

    fn brings(&self) -> Vec<&str> {
        match self {
            Self::Add(Things(map)) => {
                let obstacles = map.obstacles.iter();
                obstacles.filter_map(|obstacle| obstacle.name()).collect()
            }
            Self::Move(_) | Self::Remove(_) => Vec::new(),
        }
    }
}

/// Coming or going of an obstacle, which was as given or not there `before`.
fn presence(name: &str, before: Option<Obstacle>) -> [Change; 2] {
    let owned = name.to_owned();
    let there = Change::in_world(format!("obstacle {name}"), true, move |world| {
        // There may be another of its name now, or none at all.
        let _ = world.remove_obstacle(&owned);
        if let Some(before) = before {
            let _ = world.add_obstacle(before);
        }
    });
    // Wherever one of its name was before, it is another place that counts from now on.
    let place = Change::in_world(place_of(name), false, |_| {});
    [there, place]
}

fn place_of(obstacle: &str) -> String {
    format!("place of {obstacle}")
}
