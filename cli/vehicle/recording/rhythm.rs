//! Rhythm of the messages that a device sends by itself.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::time::Duration;

use rigsim_core::SimTime;

use super::{Slot, middle};

/// First messages of a kind whose place in their period is taken, before an inexact period matters.
const FIRST: usize = 20;
/// Most periods of the most frequent message that a vehicle is taken to have been on before the recording.
const MOST_AHEAD: u32 = 64;

/// The usual time between two messages of each kind that comes regularly, s.
pub(super) fn periods(slots: &[Slot]) -> Vec<f64> {
    let times = own_times(slots).into_values();
    let periods = times.filter_map(|times| period(&times));
    periods.map(|period| period / 1e9).collect()
}

/// How much earlier the model is switched on so that its messages come when those of the vehicle do, ns.
pub(super) fn lead(vehicle: &[Slot], model: &[Slot]) -> u64 {
    let [vehicle, model] = [vehicle, model].map(own_times);
    // Period of a kind, and the lead that suits it.
    let of_kind = |(kind, times): (&&str, &Vec<u64>)| {
        let of_model = model.get(kind)?;
        let [period, by_model] = [period(times)?, period(of_model)?];
        Some((period, phase(of_model, by_model) - phase(times, period)))
    };
    let mut all: Vec<(f64, f64)> = vehicle.iter().filter_map(of_kind).collect();
    all.sort_by(|one, other| one.0.total_cmp(&other.0));
    let Some((shortest, first)) = all.first().copied() else {
        return 0;
    };
    // To a millisecond, since an adapter does not tell more.
    let misfit = |lead: &f64| {
        let each = all.iter().map(|(period, wanted)| {
            let periods = (lead - wanted) / period;
            ((periods - periods.round()).abs() * period / 1e6).round()
        });
        each.sum::<f64>()
    };
    let leads =
        (0..MOST_AHEAD).map(|count| first.rem_euclid(shortest) + f64::from(count) * shortest);
    let best = leads.min_by(|one, other| misfit(one).total_cmp(&misfit(other)));
    let best = Duration::from_secs_f64(best.unwrap_or_default() / 1e9);
    (SimTime::ZERO + best).as_nanos()
}

/// Times of the messages of each kind that the device sends by itself, ns.
pub(super) fn own_times(slots: &[Slot]) -> BTreeMap<&str, Vec<u64>> {
    let mut times: BTreeMap<&str, Vec<u64>> = BTreeMap::new();
    for slot in slots.iter().filter(|slot| slot.own.is_some()) {
        times.entry(&slot.text).or_default().push(slot.at);
    }
    times
}

/// The usual time between two messages, ns, if they come regularly.
fn period(times: &[u64]) -> Option<f64> {
    let waits = times.windows(2).map(|two| (two[1] - two[0]) as f64);
    let mut waits: Vec<f64> = waits.collect();
    let (usual, _) = middle(&waits);
    // An adapter delivers some earlier and some later.
    waits.retain(|wait| (wait / usual - 1.0).abs() < 0.5);
    let is_regular = 4 * waits.len() > 3 * times.len();
    is_regular.then(|| waits.iter().sum::<f64>() / waits.len() as f64)
}

/// Mean place of the first messages in their period, ns from the nearest beginning of one.
fn phase(times: &[u64], period: f64) -> f64 {
    let turns = times.iter().take(FIRST).map(|at| *at as f64 / period * TAU);
    let (sin, cos) = turns.fold((0.0, 0.0), |(sin, cos), turn| {
        (sin + turn.sin(), cos + turn.cos())
    });
    sin.atan2(cos) / TAU * period
}
