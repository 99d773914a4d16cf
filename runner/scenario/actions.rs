//! Deeds of operators, and changes around a vehicle.

use std::sync::Arc;

use sim_core::SimTime;
use sim_core::device::{Action, Actions, Change, Device, DeviceSpec, HANDS, Performed};
use sim_physics::world::Obstacle;
use sim_physics::{Ground, Pose, World, WorldMap};
use toml::Spanned;
use toml::de::{DeValue, ValueDeserializer};

use super::document::AnyWorldText;
use crate::schema;
use crate::suggest::or_allowed;
use crate::tables;

/// Change around any vehicle.
#[derive(Debug)]
enum WorldAction {
    Add(WorldMap),
    Move {
        obstacle: String,
        place: [f64; 2],
        heading: Option<f64>,
    },
    Remove(String),
    Friction(f64),
}

/// Changes that there are around any vehicle.
const AROUND: [&str; 4] = ["add", "move", "remove", "friction"];

/// Reads what an operator does to a device.
pub(super) fn read_operator(
    value: &Spanned<DeValue<'_>>,
    device: &DeviceSpec,
) -> Result<Arc<dyn Action>, toml::de::Error> {
    let all = [Some(&HANDS), device.operator.as_ref()];
    read_one_of(value, device, all.into_iter().flatten(), &[])
}

/// Reads an action of the first of `all` that has one of its name; others are known, too.
fn read_one_of<'a>(
    value: &Spanned<DeValue<'_>>,
    device: &DeviceSpec,
    all: impl Iterator<Item = &'a Actions>,
    others: &[&str],
) -> Result<Arc<dyn Action>, toml::de::Error> {
    let name = tables::name_of(value).unwrap_or_default();
    let mut known: Vec<String> = others.iter().map(|name| (*name).to_owned()).collect();
    for actions in all {
        let mut generator = schemars::SchemaGenerator::default();
        let names = schema::names(vec![(actions.schema)(&mut generator)]);
        if names.iter().any(|own| own == name) {
            return (actions.read)(ValueDeserializer::from(value.clone())).map(Arc::from);
        }
        known.extend(names);
    }
    let known: Vec<&str> = known.iter().map(String::as_str).collect();
    let why = match name {
        "" => format!("one thing is done by a step; allowed: {}", known.join(", ")),
        name => {
            let allowed = or_allowed(name, &known);
            format!("{} has no `{name}`; {allowed}", device.title)
        }
    };
    Err(serde::de::Error::custom(why))
}

/// Reads what changes around a device.
pub(super) fn read_world(
    value: &Spanned<DeValue<'_>>,
    device: &DeviceSpec,
) -> Result<Arc<dyn Action>, toml::de::Error> {
    let name = tables::name_of(value).unwrap_or_default();
    if !AROUND.contains(&name) {
        return read_one_of(value, device, device.surroundings.iter(), &AROUND);
    }
    let wrong = |why: String| serde::de::Error::custom(why);
    Ok(Arc::new(match tables::read(value)? {
        AnyWorldText::Add(table) => WorldAction::Add(add(&table).map_err(wrong)?),
        AnyWorldText::Move(to) => WorldAction::Move {
            place: [to.x.0, to.y.0],
            heading: to.heading.map(|angle| angle.0.to_radians()),
            obstacle: to.obstacle,
        },
        AnyWorldText::Remove(obstacle) => WorldAction::Remove(obstacle),
        AnyWorldText::Friction(friction) if (0.0..=2.0).contains(&friction) => {
            WorldAction::Friction(friction)
        }
        AnyWorldText::Friction(friction) => {
            return Err(wrong(format!(
                "friction {friction} is out of range; allowed: 0 to 2"
            )));
        }
    }))
}

impl Action for WorldAction {
    fn perform(&self, _device: &mut dyn Device, world: &mut World, _now: SimTime) -> Performed {
        Ok(match self {
            Self::Add(map) => {
                world.add_map(map)?;
                // What has no name stays.
                let things = Change::in_world("things", false, |_| {});
                let named = self.brings().into_iter();
                let named = named.flat_map(|name| presence(name, None));
                [things].into_iter().chain(named).collect()
            }
            Self::Move {
                obstacle,
                place,
                heading,
            } => {
                let Pose { x, y, heading } = world.move_obstacle(obstacle, *place, *heading)?;
                let name = obstacle.clone();
                // It is not there if who brought it has taken it away.
                vec![Change::in_world(place_of(obstacle), true, move |world| {
                    let _ = world.move_obstacle(&name, [x, y], Some(heading));
                })]
            }
            Self::Remove(obstacle) => {
                let removed = world.remove_obstacle(obstacle)?;
                presence(obstacle, Some(removed)).into()
            }
            Self::Friction(friction) => {
                let before = world.ground();
                let ground = before.with_friction_of(&Ground::flat(*friction));
                world.set_ground(ground);
                let restore = move |world: &mut World| world.set_ground(before);
                vec![Change::in_world("friction", before != ground, restore)]
            }
        })
    }

    fn can_end(&self) -> bool {
        let map = match self {
            Self::Add(map) => map,
            Self::Move { .. } | Self::Remove(_) | Self::Friction(_) => return true,
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
            Self::Move { obstacle, .. } | Self::Remove(obstacle) => Some(obstacle),
            Self::Add(_) | Self::Friction(_) => None,
        }
    }

    fn brings(&self) -> Vec<&str> {
        match self {
            Self::Add(map) => {
                let obstacles = map.obstacles.iter();
                obstacles.filter_map(|obstacle| obstacle.name()).collect()
            }
            Self::Move { .. } | Self::Remove(_) | Self::Friction(_) => Vec::new(),
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

/// Reads a table as if it were a world file, so that there is one form for both.
fn add(table: &toml::Table) -> Result<WorldMap, String> {
    let mut file = table.clone();
    file.insert("schema".to_owned(), toml::Value::Integer(1));
    WorldMap::from_toml(&file.to_string(), "").map_err(|error| match error.key {
        Some(key) => format!("`{key}`: {}", error.why),
        None => error.why,
    })
}
