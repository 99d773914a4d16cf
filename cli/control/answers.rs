//! State of a run as JSON. Numbers without end are `null`.

use rigsim_control::{Refusal, Reply};
use rigsim_core::device::Devices;
use rigsim_core::effect;
use rigsim_core::rig::Rig;
use rigsim_embed::clock::Clock;
use rigsim_embed::ports::ShownPort;
use rigsim_physics::Drawing;
use rigsim_physics::world::{FeatureKind, Shape};
use rigsim_runner::condition::Reading;
use rigsim_runner::run::{Failure, Probe, StepReport};
use rigsim_runner::{Run, Scenario};
use serde_json::{Map, Value, json};

use super::ask::TimeChange;
use crate::summary::client_report;

/// Corners of what is round.
const CORNERS: u32 = 24;

/// Progress of a step.
pub(super) fn step(run: &Run, index: usize) -> Reply {
    run.step_report(index)
        .map(|report| {
            let mut step = step_json(&report);
            step["t"] = json!(run.rig().now().as_secs_f64());
            step
        })
        .ok_or_else(|| Refusal::new(404, "that step is no more"))
}

/// What was not as the scenario says.
pub(super) fn failure(failure: &Failure) -> Value {
    json!({
        "t": failure.at.as_secs_f64(),
        "step": failure.step,
        "what": failure.what,
    })
}

/// Progress of all steps.
pub(super) fn steps(run: &Run) -> Vec<Value> {
    run.steps().map(|report| step_json(&report)).collect()
}

pub(super) fn step_json(step: &StepReport<'_>) -> Value {
    let state = match (step.failure, step.done, step.begun) {
        (Some(_), ..) => "failed",
        (None, Some(_), _) if step.lasting => "active",
        (None, Some(_), _) => "done",
        (None, None, Some(_)) => "active",
        (None, None, None) => "waiting",
    };
    json!({
        "name": step.name,
        "device": step.device,
        "key": step.key,
        "what": step.what,
        "state": state,
        "why": step.failure,
        "begun_s": step.begun.map(|at| at.as_secs_f64()),
        "done_s": step.done.map(|at| at.as_secs_f64()),
        "hits": step.hits,
        "added": step.added,
        "clearable": step.lasting,
    })
}

/// Passing of time; without a clock it is the client's.
pub(super) fn time(run: &Run, clock: Option<&Clock>) -> Value {
    json!({
        "t": run.rig().now().as_secs_f64(),
        "time": if clock.is_some() { "real" } else { "lockstep" },
        "paused": clock.is_some_and(Clock::is_stopped),
        "speed": clock.map(Clock::speed),
    })
}

/// Things that there are.
pub(super) fn state(run: &Run, clock: Option<&Clock>, ports: &[ShownPort]) -> Value {
    let scenario = run.scenario();
    let mut state = time(run, clock);
    state["version"] = json!(env!("CARGO_PKG_VERSION"));
    state["seed"] = json!(run.seed());
    state["title"] = json!(Some(&scenario.title).filter(|title| !title.is_empty()));
    state["expected"] = json!(Some(&scenario.good_client).filter(|text| !text.is_empty()));
    state["devices"] = devices(run, ports);
    state["world"] = world(run);
    state["steps"] = json!(steps(run));
    state["failures"] = run.failures().iter().map(failure).collect();
    state
}

fn devices(run: &Run, ports: &[ShownPort]) -> Value {
    let plans = run.scenario().rig.devices.iter();
    let parts = plans.zip(run.reports()).zip(run.rig().world().bodies());
    let devices = parts
        .enumerate()
        .map(|(index, ((plan, report), (_, [length, width])))| {
            let device_ports = ports.iter().filter(|port| port.link.id.device == index);
            let drawing = drawing(run.rig(), index);
            let wheels = drawing.wheels.iter().map(|wheel| {
                json!({
                    "x": wheel.place[0],
                    "y": wheel.place[1],
                    "length": wheel.length,
                    "width": wheel.width,
                })
            });
            let sensors = drawing.echoes.iter().map(|echo| {
                json!({
                    "x": echo.place[0],
                    "y": echo.place[1],
                    "heading": echo.heading,
                    "opening": echo.opening,
                    "range_m": echo.range,
                })
            });
            json!({
                "name": plan.name,
                "identifier": rigsim_runner::condition::identifier(&plan.name),
                "kind": plan.device.id,
                "ports": device_ports.map(ShownPort::json).collect::<Vec<_>>(),
                "body": { "length": length, "width": width },
                "wheels": wheels.collect::<Vec<_>>(),
                "sensors": sensors.collect::<Vec<_>>(),
                "requests": report.requests,
                "replies": report.replies,
                "report": client_report(report).collect::<Vec<_>>(),
            })
        });
    devices.collect()
}

/// What of a device is drawn.
pub(crate) fn drawing(rig: &Rig, device: usize) -> Drawing {
    let device = rig.any_device(device);
    device
        .map(|device| device.plant().drawing())
        .unwrap_or_default()
}

/// Everything that lies and stands around.
fn world(run: &Run) -> Value {
    let mut world = json!({"areas": [], "strips": [], "tags": [], "obstacles": []});
    let mut put = |kind: &str, one: Value| {
        if let Some(list) = world[kind].as_array_mut() {
            list.push(one);
        }
    };
    for feature in run.rig().world().features() {
        let outline = || json!(outline(&feature.shape));
        match (feature.kind, feature.shape) {
            (FeatureKind::Slope, _) => put("areas", json!({"kind": "slope", "outline": outline()})),
            (FeatureKind::Friction(friction), _) => put(
                "areas",
                json!({"kind": "friction", "friction": friction, "outline": outline()}),
            ),
            (FeatureKind::Strip, Shape::Band(band)) => put(
                "strips",
                json!({"from": band.ends[0], "to": band.ends[1], "radius": band.radius}),
            ),
            (FeatureKind::Tag(number), Shape::Disc(disc)) => put(
                "tags",
                json!({"x": disc.centre[0], "y": disc.centre[1], "number": number}),
            ),
            (FeatureKind::Strip | FeatureKind::Tag(_) | FeatureKind::Obstacle, _) => {
                put("obstacles", json!({"outline": outline()}));
            }
        }
    }
    world
}

/// Corners of a shape.
pub(crate) fn outline(shape: &Shape) -> Vec<[f64; 2]> {
    let round = |centre: [f64; 2], radius: f64, from: f64, part: f64| {
        (0..=CORNERS).map(move |corner| {
            let angle = from + part * f64::from(corner) / f64::from(CORNERS);
            [
                centre[0] + radius * angle.cos(),
                centre[1] + radius * angle.sin(),
            ]
        })
    };
    match shape {
        Shape::Rectangle(rectangle) => rectangle.corners().to_vec(),
        Shape::Disc(disc) => round(disc.centre, disc.radius, 0.0, std::f64::consts::TAU).collect(),
        Shape::Band(band) => {
            let [from, to] = band.ends;
            let heading = (to[1] - from[1]).atan2(to[0] - from[0]);
            let quarter = std::f64::consts::FRAC_PI_2;
            let half = std::f64::consts::PI;
            let far = round(to, band.radius, heading - quarter, half);
            far.chain(round(from, band.radius, heading + quarter, half))
                .collect()
        }
    }
}

/// Places of everything now.
pub(super) fn picture(run: &Run) -> Value {
    let rig = run.rig();
    let devices = (0..rig.devices()).map(|index| {
        let device = rig.any_device(index);
        let touching = device.is_some_and(|device| rig.world().is_touching(device.plant().body()));
        let pose = rig
            .motion(index)
            .map(|motion| motion.pose)
            .unwrap_or_default();
        let drawing = drawing(rig, index);
        json!({
            "x": pose.x,
            "y": pose.y,
            "heading": pose.heading,
            "touching": touching,
            "wheels": drawing.wheels.iter().map(|wheel| wheel.speed).collect::<Vec<_>>(),
            "echoes": drawing.echoes.iter().map(|echo| echo.distance).collect::<Vec<_>>(),
        })
    });
    json!({"t": rig.now().as_secs_f64(), "devices": devices.collect::<Vec<_>>()})
}

/// The values of names.
pub(super) fn values_of(run: &Run, names: &[String]) -> Reply {
    let probes: Result<Vec<Probe>, _> = names.iter().map(|name| run.probe(name)).collect();
    let probes = probes.map_err(|why| Refusal::new(422, why.to_string()))?;
    Ok(values(run, &probes))
}

/// The same of names that are known.
pub(super) fn values(run: &Run, probes: &[Probe]) -> Value {
    let values: Map<String, Value> = probes
        .iter()
        .map(|probe| (probe.name.clone(), value(run, probe)))
        .collect();
    json!({"t": run.rig().now().as_secs_f64(), "values": values})
}

pub(super) fn value(run: &Run, probe: &Probe) -> Value {
    match probe.read(run) {
        Some(Reading::Number(number)) => json!(number),
        Some(Reading::Flag(flag)) => json!(flag),
        None => Value::Null,
    }
}

/// All names. With one device they need not begin with its own.
pub(super) fn names(run: &Run) -> Value {
    let devices = &run.scenario().rig.devices;
    let alone = devices.len() == 1;
    let names = run.probes().into_iter().map(|probe| {
        let bare = probe.name.split_once('.').map_or("", |(_, bare)| bare);
        let plan = probe.device.and_then(|device| devices.get(device));
        let info = plan.and_then(|plan| plan.device.find_name(bare));
        json!({
            "name": if alone { bare } else { &probe.name },
            "unit": probe.unit.to_string(),
            "meaning": info.map(|info| info.meaning),
        })
    });
    json!({ "names": names.collect::<Vec<_>>() })
}

/// The form of steps for these devices.
fn step_schema(devices: Devices) -> Value {
    let mut step: Value = serde_json::from_str(&Scenario::json_schema(devices)).unwrap_or_default();
    if let Some(schema) = step.as_object_mut() {
        schema.retain(|key, _| key == "$defs" || key == "$schema");
        schema.insert("$ref".to_owned(), json!("#/$defs/StepText"));
    }
    step
}

/// The forms of all that can be asked, and the beginning of a scenario file with the same devices.
pub(super) fn schema(devices: Devices, file: &str) -> Value {
    let each = devices.chunks(1).flat_map(|one| {
        let kinds = one.iter().map(|device| device.id.to_owned());
        kinds.map(|kind| (kind, step_schema(one)))
    });
    let steps: Map<String, Value> = each.collect();
    let faults = effect::catalogue(devices).into_iter();
    let faults = faults.filter(|info| info.is_fault()).map(|fault| {
        let able = devices.iter().filter(|device| effect::has(device, fault));
        let devices: Vec<&str> = able.map(|device| device.id).collect();
        json!({"kind": fault.id, "devices": devices, "summary": fault.summary, "sees": fault.client_sees})
    });
    let operators: Map<String, Value> = devices
        .iter()
        .map(|device| {
            (
                device.id.to_owned(),
                json!(effect::names(device, "operator")),
            )
        })
        .collect();
    json!({
        "step": step_schema(devices),
        "steps": steps,
        "file": file,
        "operators": operators,
        "time": schemars::schema_for!(TimeChange).as_value(),
        "faults": faults.collect::<Vec<_>>(),
    })
}
