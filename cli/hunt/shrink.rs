//! Making a finding smaller while it breaks the same rule.

use crate::exit::Failure;

use super::player::Player;
use super::space::{DURATIONS, Fault, Frame, Kind};

/// Candidates that are played at a time.
const AT_ONCE: usize = 8;

/// A finding that was made smaller.
pub(super) struct Shrunk {
    pub(super) schedule: Vec<Fault>,
    pub(super) runs: u32,
    /// The budget was used up before nothing smaller was left.
    pub(super) is_cut: bool,
}

/// Makes a schedule smaller until no candidate breaks the rule any more.
///
/// # Errors
/// When it cannot be played.
pub(super) fn shrink(
    player: &mut Player<'_>,
    frame: &Frame,
    kinds: &[Kind],
    schedule: &[Fault],
    key: &str,
    most: u32,
) -> Result<Shrunk, Failure> {
    let mut best = schedule.to_vec();
    let before = player.asked;
    let used = |player: &Player<'_>| u32::try_from(player.asked - before).unwrap_or(u32::MAX);
    let mut is_cut = false;
    'smaller: loop {
        for candidates in candidates(&best, kinds).chunks(AT_ONCE) {
            if used(player) >= most {
                is_cut = true;
                break 'smaller;
            }
            let texts = candidates.iter().map(|one| frame.document(one, "", None));
            let seen = player.play(&texts.collect::<Vec<_>>())?;
            let breaks = seen.iter().position(|seen| {
                seen.as_ref()
                    .is_some_and(|seen| seen.broken.contains_key(key))
            });
            if let Some(index) = breaks {
                best.clone_from(&candidates[index]);
                continue 'smaller;
            }
        }
        break;
    }
    Ok(Shrunk {
        schedule: best,
        runs: used(player),
        is_cut,
    })
}

/// Smaller schedules, the smallest first. Each is smaller by an order that has an end.
fn candidates(schedule: &[Fault], kinds: &[Kind]) -> Vec<Vec<Fault>> {
    let mut all = Vec::new();
    if schedule.len() > 1 {
        for index in 0..schedule.len() {
            let mut less = schedule.to_vec();
            less.remove(index);
            all.push(less);
        }
    }
    for (index, fault) in schedule.iter().enumerate() {
        let mut add = |changed: Fault| {
            let mut less = schedule.to_vec();
            less[index] = changed;
            all.push(less);
        };
        let kind = kinds
            .iter()
            .find(|kind| kind.id == fault.kind && kind.device == fault.device);
        if let Some(kind) = kind {
            // The last set of parameters is the mildest, and the first is the usual one.
            let mut actions: Vec<String> = (0..kind.values.len())
                .map(|value| kind.fault(value, "", None).action)
                .collect();
            actions.rotate_right(1);
            let at = actions.iter().position(|action| *action == fault.action);
            for action in actions.into_iter().take(at.unwrap_or(usize::MAX)) {
                add(Fault {
                    action,
                    ..fault.clone()
                });
            }
        }
        let shorter = DURATIONS
            .iter()
            .filter(|lasts| lasts.unwrap_or(u64::MAX) < fault.lasts.unwrap_or(u64::MAX));
        for lasts in shorter {
            add(Fault {
                lasts: *lasts,
                ..fault.clone()
            });
        }
        for trigger in rounder(&fault.trigger) {
            add(Fault {
                trigger,
                ..fault.clone()
            });
        }
    }
    all
}

/// The same trigger with a rounder time.
fn rounder(trigger: &str) -> Vec<String> {
    let time = trigger
        .strip_prefix("at = \"")
        .and_then(|rest| rest.strip_suffix(" ms\""));
    let Some(time) = time.and_then(|time| time.parse::<u64>().ok()) else {
        return Vec::new();
    };
    let steps = [1000, 500, 100, 50, 10].into_iter();
    let finer = steps.take_while(|step| !time.is_multiple_of(*step));
    finer
        .map(|step| format!("at = \"{} ms\"", (time + step / 2) / step * step))
        .collect()
}
