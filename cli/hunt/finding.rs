//! Findings: attributed to the client, reduced while they break the same rule, and written.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use anyhow::anyhow;
use maud::Markup;

use crate::config;
use crate::exit::Failure;
use crate::print::{OutputFile, complain_above};
use crate::run::{Case, CaseResult, case_in_full};
use crate::visible;

use super::attribution;
use super::player::{Broken, Seen};
use super::search::{Found, Hunt};
use super::space::{FOR_GOOD, Fault, Form, Frame, Kind, Trigger, duration, step_name};

/// Candidates that are played in parallel.
const AT_ONCE: usize = 8;
/// Longest name of a finding's file.
const MOST_NAME: usize = 60;
/// Most files for one rule.
const MOST_OF_RULE: usize = 3;
/// Most files whose names begin with the same words.
const MOST_PLACES: usize = 100;
/// First line of a finding's file, by which a later hunt may replace it.
const MARK: &str = "# Found by sim hunt in run ";
/// Seeds with which a finding is played.
const SEEDS: u64 = 20;
/// Prefix of the failure of a client that exits with a code, and the duration of a fault, ms, above which that
/// is allowed.
pub(super) const GAVE_UP: &str = "the client ended with exit code";
const GIVE_UP: u64 = 300;
/// Prefixes of failures that are always the client's.
const OWN: [&str; 2] = ["the client", "it was still"];
/// Durations to which a finding is shortened, and times by which it is moved, ms.
const SHORTER: [u64; 8] = [10, 20, 50, 100, 200, 500, 1000, 2000];
const MOVED: [u64; 7] = [20, 50, 100, 200, 500, 1000, WIDEST];
const WIDEST: u64 = 2000;
/// Times are rounded to these, ms.
const ROUND: [u64; 5] = [1000, 500, 100, 50, 10];

impl Hunt<'_> {
    /// Attributes a broken rule, reduces the schedule, and writes it. Returns whether the client broke it.
    pub(super) fn look_into(
        &mut self,
        run: u64,
        schedule: &[Fault],
        key: &str,
        broken: &Broken,
    ) -> Result<bool, Failure> {
        if self.is_known(schedule, key) {
            return Ok(self.has_found(key));
        }
        let of = ids(schedule);
        if self.is_unavoidable(schedule, key)? {
            self.count_unavoidable(key, broken);
            return Ok(false);
        }
        let words: Vec<String> = schedule.iter().map(Fault::words).collect();
        let words = words.join("\n  ");
        complain_above(
            &self.bar,
            &format!(
                "found in run {run}, now made smaller: {}\n  {words}",
                broken.rule
            ),
        );
        let before = self.player.asked;
        let (schedule, is_cut) = self.shrink(schedule, key)?;
        // The reduced schedule may leave the client no way out, although the whole one did.
        let is_unavoidable = self.is_unavoidable(&schedule, key)?;
        let known = self.state.per_rule.entry(key.to_owned()).or_default();
        let shrunk = ids(&schedule);
        if is_unavoidable {
            complain_above(&self.bar, "  it shrinks to what no client can avoid");
            known.push(of);
            self.count_unavoidable(key, broken);
            return Ok(false);
        }
        if known.contains(&shrunk) {
            complain_above(&self.bar, "  it shrinks to a finding before");
            known.push(of);
            return Ok(self.has_found(key));
        }
        known.extend([of, shrunk]);
        let mut found = Found {
            rule: broken.rule.clone(),
            key: key.to_owned(),
            failure: broken.failure.clone(),
            faults: schedule.iter().map(Fault::words).collect(),
            file: None,
            run,
            shrink_runs: self.player.asked - before,
            seeds: 0,
            head: String::new(),
            window_ms: self.windows(&schedule, key)?,
            schedule,
        };
        self.write(&mut found, is_cut)?;
        self.state.found.push(found);
        Ok(true)
    }

    /// Returns whether the client has broken a rule.
    fn has_found(&self, key: &str) -> bool {
        self.state.written().any(|found| found.key == key)
    }

    /// Returns whether earlier findings explain it, or are enough for this rule.
    pub(super) fn is_known(&self, schedule: &[Fault], key: &str) -> bool {
        let of = ids(schedule);
        let earlier = self.state.written().filter(|found| found.key == key);
        let mut known = self.state.per_rule.get(key).into_iter().flatten();
        let contains = |one: &Vec<String>| one.iter().all(|id| of.contains(id));
        earlier.count() >= MOST_OF_RULE || known.any(contains)
    }

    fn count_unavoidable(&mut self, key: &str, broken: &Broken) {
        let first = || (broken.rule.clone(), 0);
        let all = self.state.unavoidable.entry(key.to_owned());
        all.or_insert_with(first).1 += 1;
    }

    /// Returns whether the rule is attributed to the fault, and not to the client: an ideal operator and
    /// silence break it as well, or the reference does.
    fn is_unavoidable(&mut self, schedule: &[Fault], key: &str) -> Result<bool, Failure> {
        if may_end(schedule, key) {
            return Ok(true);
        }
        let text = self.frame.document(schedule);
        if let Some(reference) = &mut self.reference {
            let seen = reference.play(std::slice::from_ref(&text))?;
            if seen[0].broken.contains_key(key) {
                return Ok(true);
            }
        }
        if OWN.iter().any(|prefix| key.starts_with(prefix)) {
            return Ok(false);
        }
        self.player.trace(&text, |case, _, _| {
            attribution::is_unavoidable(self.devices, case, schedule.len(), key)
        })
    }

    /// Plays schedules, and returns which of them break the rule in a way that is the client's error.
    fn which_break(&mut self, all: &[Vec<Fault>], key: &str) -> Result<Vec<bool>, Failure> {
        let texts = all.iter().map(|one| self.frame.document(one));
        let seen = self.player.play(&texts.collect::<Vec<_>>())?;
        let breaks = all.iter().zip(&seen);
        let breaks = breaks.map(|(one, seen)| seen.broken.contains_key(key) && !may_end(one, key));
        Ok(breaks.collect())
    }

    /// Reduces a schedule until no smaller candidate breaks the rule; also returns whether the budget was used up
    /// before that.
    fn shrink(&mut self, schedule: &[Fault], key: &str) -> Result<(Vec<Fault>, bool), Failure> {
        let until = self.player.asked + u64::from(self.args.shrink_runs);
        let mut best = schedule.to_vec();
        'smaller: while self.player.asked < until {
            let mut candidates = self.candidates(&best)?;
            while !candidates.is_empty() {
                let left = until.saturating_sub(self.player.asked);
                let most = usize::try_from(left).map_or(AT_ONCE, |left| left.min(AT_ONCE));
                if most == 0 {
                    return Ok((best, true));
                }
                self.bar
                    .set_message(format!("made smaller, at most {left} runs more"));
                let next: Vec<_> = candidates.drain(..most.min(candidates.len())).collect();
                let breaks = self.which_break(&next, key)?;
                if let Some(index) = breaks.iter().position(|breaks| *breaks) {
                    best.clone_from(&next[index]);
                    continue 'smaller;
                }
            }
            return Ok((best, false));
        }
        Ok((best, true))
    }

    /// Start times of the faults of a schedule.
    fn begun(&mut self, schedule: &[Fault]) -> Result<Vec<Option<u64>>, Failure> {
        let text = self.frame.document(schedule);
        Ok(self.player.play(&[text])?.remove(0).begun)
    }

    /// Smaller schedules, the smallest first. The order is well-founded: fewer faults, weaker kinds, milder
    /// forms, shorter, a more robust trigger, a rounder time.
    fn candidates(&mut self, schedule: &[Fault]) -> Result<Vec<Vec<Fault>>, Failure> {
        let begun = self.begun(schedule)?;
        let mut all = Vec::new();
        for index in (0..schedule.len()).filter(|_| schedule.len() > 1) {
            let mut fewer = schedule.to_vec();
            fewer.remove(index);
            all.push(fewer);
        }
        for (index, fault) in schedule.iter().enumerate() {
            for smaller in self.smaller(fault, begun[index]) {
                let mut changed = schedule.to_vec();
                changed[index] = smaller;
                all.push(changed);
            }
        }
        Ok(all)
    }

    fn smaller(&self, fault: &Fault, begun: Option<u64>) -> Vec<Fault> {
        let kinds = &self.state.kinds;
        let mut all = Vec::new();
        let Some(kind) = kinds.iter().find(|kind| kind.is_of(fault)) else {
            return all;
        };
        let same = |form: &Form| form.action == fault.action;
        let Some(form) = kind.forms.iter().position(same) else {
            return all;
        };
        let ends_itself = |form: &Form| form.lasts == [FOR_GOOD];
        let with = |kind: &Kind, form: usize| {
            let ends_itself = ends_itself(&kind.forms[form]);
            let lasts = if ends_itself { FOR_GOOD } else { fault.lasts };
            kind.fault(form, fault.trigger.clone(), lasts)
        };
        for id in kind.info.weaker {
            let is_it = |one: &&Kind| one.info.id == *id && one.device == fault.device;
            for weaker in kinds.iter().filter(is_it) {
                all.extend((0..weaker.forms.len()).map(|form| with(weaker, form)));
            }
        }
        let milder = (form + 1..kind.forms.len()).rev();
        all.extend(milder.map(|form| with(kind, form)));
        if !ends_itself(&kind.forms[form]) {
            let shorter = SHORTER.into_iter().filter(|lasts| *lasts < fault.lasts);
            all.extend(shorter.map(|lasts| kind.fault(form, fault.trigger.clone(), lasts)));
        }
        if let Trigger::At(at) = fault.trigger {
            let begun = begun.unwrap_or(at);
            let mut near: Vec<_> = self.state.moments.iter().collect();
            near.sort_by_key(|moment| moment.at.abs_diff(begun));
            let near = near.iter().map(|moment| moment.trigger.clone());
            let robust = near.filter(|trigger| matches!(trigger, Trigger::When(_)));
            let steps = ROUND
                .into_iter()
                .take_while(|step| !at.is_multiple_of(*step));
            let round = steps.map(|step| Trigger::At((at + step / 2) / step * step));
            let triggers = robust.take(2).chain(round);
            all.extend(triggers.map(|trigger| kind.fault(form, trigger, fault.lasts)));
        }
        all
    }

    /// How much earlier and later each fault may begin so that the rule is still broken, ms: the last time tried
    /// before the rule is kept.
    fn windows(&mut self, schedule: &[Fault], key: &str) -> Result<Vec<[u64; 2]>, Failure> {
        let begun = self.begun(schedule)?;
        let mut windows = vec![[0; 2]; schedule.len()];
        for (index, window) in windows.iter_mut().enumerate() {
            let begun = begun[index].unwrap_or_default();
            for (side, widest) in window.iter_mut().enumerate() {
                let moved = MOVED.iter().filter_map(|by| match side {
                    0 => begun.checked_sub(*by),
                    _ => begun.checked_add(*by),
                });
                let moved = moved.map(|at| {
                    let mut all = schedule.to_vec();
                    all[index].trigger = Trigger::At(at);
                    all
                });
                let breaks = self.which_break(&moved.collect::<Vec<_>>(), key)?;
                let pairs = MOVED.iter().zip(breaks).take_while(|(_, breaks)| *breaks);
                *widest = pairs.last().map_or(0, |(by, _)| *by);
            }
        }
        Ok(windows)
    }

    /// Writes a finding if its run is repeatable.
    fn write(&mut self, found: &mut Found, is_cut: bool) -> Result<(), Failure> {
        let (key, seed) = (&found.key, self.player.seed);
        let frame = self.with_the_rule(&found.schedule, key)?;
        let plain = frame.document(&found.schedule);
        let first = self.player.play_again(&plain)?;
        let again = self.player.play_again(&plain)?;
        let Some(broken) = first.broken.get(key).filter(|_| first.trace == again.trace) else {
            complain_above(
                &self.bar,
                "  it could not be played twice with the same result, and is not written",
            );
            return Ok(());
        };
        found.failure.clone_from(&broken.failure);
        found.rule.clone_from(&broken.rule);
        self.bar.set_message(format!("played with {SEEDS} seeds"));
        let all = (0..SEEDS).map(|more| (plain.as_str(), seed.wrapping_add(more)));
        let all = self.player.play_seeds(&all.collect::<Vec<_>>(), false)?;
        let fails = all.iter().filter(|seen| seen.broken.contains_key(key));
        found.seeds = fails.count() as u64;
        let Found {
            rule,
            run,
            shrink_runs,
            seeds,
            ..
        } = &*found;
        let cut = if is_cut {
            "; the budget of --shrink-runs ended before"
        } else {
            ""
        };
        let folder = &self.player.folder;
        let (name, path, file) = self.place(rule)?;
        let replaced = match path.exists() {
            true => ", in the place of an earlier hunt's",
            false => "",
        };
        let command = self.player.command(&plain, &path)?;
        let mut head = format!(
            "{MARK}{run}, made smaller in {shrink_runs} runs{cut}.\n\
             # Play it again: {command}\n\
             # Fails with {seeds} of {SEEDS} seeds from {seed} on.\n"
        );
        for (index, by) in found.window_ms.iter().enumerate() {
            let name = step_name(index);
            let sides = by.iter().zip(["earlier", "later"]);
            let sides = sides.filter(|(by, _)| **by > 0);
            let sides = sides.map(|(by, side)| match *by {
                WIDEST => format!("{} or more {side}", duration(*by)),
                by => format!("up to {} {side}", duration(by)),
            });
            let sides = sides.collect::<Vec<_>>().join(" or ");
            head += &match sides.as_str() {
                "" => format!(
                    "# Fails only where \"{name}\" begins at this moment, and not {} away from it.\n",
                    duration(MOVED[0])
                ),
                sides => format!("# Fails also where \"{name}\" begins {sides}.\n"),
            };
        }
        let words = found.faults.join("; ");
        let breaks = ["break", "breaks"][usize::from(found.schedule.len() == 1)];
        let kinds: Vec<&str> = found.schedule.iter().map(|fault| fault.kind).collect();
        let title = format!("{} {breaks} a rule", kinds.join(" and "));
        let about = (title.as_str(), &*format!("{words}. It breaks: {rule}."));
        file.write(&frame.finding(&found.schedule, &head, about, folder))?;
        complain_above(&self.bar, &format!("  {}{replaced}", visible::name(&path)));
        found.file = Some(name);
        found.head = head;
        Ok(())
    }

    /// The frame with the fewest further rules (none, one or all) in which the schedule breaks the rule.
    fn with_the_rule(&mut self, schedule: &[Fault], key: &str) -> Result<Frame, Failure> {
        let mut frames = self.frame.with_one_rule();
        let texts = frames.iter().map(|frame| frame.document(schedule));
        let seen = self.player.play(&texts.collect::<Vec<_>>())?;
        let breaks = |seen: &Seen| seen.broken.contains_key(key);
        Ok(match seen.iter().position(breaks) {
            Some(index) => frames.swap_remove(index),
            None => self.frame.clone(),
        })
    }

    /// A free path for a finding: files of this hunt and of other programs are kept, and different rules may lead
    /// to the same words.
    fn place(&self, rule: &str) -> Result<(String, PathBuf, OutputFile), Failure> {
        let is_taken = |name: &String| {
            let mut found = self.state.found.iter();
            found.any(|found| found.file.as_ref() == Some(name))
        };
        let names = (1..=MOST_PLACES).map(|place| format!("{}-{place}.toml", slug(rule)));
        let places = names.filter(|name| !is_taken(name)).map(|name| {
            let path = self.player.folder.join(&name);
            OutputFile::find(&path, &[MARK]).map(|file| (name, path, file))
        });
        let mut refusal = anyhow!("there is no name left for a finding");
        for place in places {
            match place {
                Ok(place) => return Ok(place),
                Err(failure) => refusal = failure.error,
            }
        }
        Err(Failure::system(refusal))
    }

    /// The run of a finding, as a report of `sim run` shows it.
    pub(super) fn picture(&self, found: &Found) -> Result<Markup, Failure> {
        let show = |case: &Case<'_>, result: &CaseResult, stop: &AtomicBool| {
            let shown = case_in_full(self.devices, case, result, stop);
            shown.ok_or_else(|| Failure::system(anyhow!("a finding could not be played again")))
        };
        match &found.file {
            Some(name) => {
                let path = self.player.folder.join(name);
                let text = config::read(&path, "scenario file")?;
                self.player.trace_of(&path, &text, show)
            }
            None => (self.player).trace(&self.frame.document(&found.schedule), show),
        }
    }
}

/// Returns whether a client may end with an exit code: it may give up where a fault lasts.
fn may_end(schedule: &[Fault], key: &str) -> bool {
    key.starts_with(GAVE_UP) && schedule.iter().any(|fault| fault.is_longer(GIVE_UP))
}

fn ids(schedule: &[Fault]) -> Vec<String> {
    let mut ids: Vec<String> = schedule.iter().map(|fault| fault.kind.to_owned()).collect();
    ids.sort();
    ids
}

/// A rule as part of a file's name: its message, or all of its text.
fn slug(rule: &str) -> String {
    let message = rule.split(": ").next().unwrap_or(rule);
    let words = message.split(|letter: char| !letter.is_ascii_alphanumeric());
    let words: Vec<String> = words
        .filter(|word| !word.is_empty())
        .map(str::to_ascii_lowercase)
        .collect();
    let whole = words.join("-");
    let cut = |short: &'_ str| short.rfind('-').unwrap_or(MOST_NAME);
    match &whole[..whole.get(..MOST_NAME).map_or(whole.len(), cut)] {
        "" => "rule".to_owned(),
        slug => slug.to_owned(),
    }
}
