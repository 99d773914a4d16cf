//! What recordings say of the model: of commands, fields and settings.

mod text;

use std::collections::{BTreeMap, BTreeSet};

use rigsim_core::SimTime;
use rigsim_core::event::Hex;
use rigsim_core::settings::SimSettings;
use rigsim_settings::Basis;
use serde::Serialize;

use super::recording::{Reply, Slot, middle};
use super::search::{Doubt, ENOUGH, Findings, Found, Model, Search, Verdict};
use super::{plan, poses};
pub(super) use text::MARK;

/// Why nothing is written that is certain by the rest of a recording.
const NO_BETTER: &str = "the third that was not used fits no better with what was found";
/// Shifts of one series against the other, by which its lag is found, ms.
const LAGS: std::ops::RangeInclusive<i32> = -50..=50;
const LAG_STEP: f64 = 10.0;
/// Reported as unexplained if no reply can be read.
const NOT_UNDERSTOOD: &str =
    "nothing that the vehicle sent can be read: was it on, and was the speed of the line right?";

/// The report of recordings.
#[derive(Serialize)]
pub(super) struct Report {
    /// Share of the recording that took part; the rest was left out for stalls of the machine.
    pub(super) used: f64,
    /// Clock offset of the poses of each recording that has some, s.
    pub(super) poses_offsets: Vec<f64>,
    /// Set if no documented value is contradicted, and nothing is unexplained.
    pub(super) is_as_documented: bool,
    pub(super) commands: Vec<CommandRow>,
    pub(super) fields: Vec<FieldRow>,
    pub(super) settings: Vec<SettingRow>,
    /// Replies that no setting explains.
    pub(super) unexplained: Vec<String>,
    pub(super) held_out: HeldOut,
    /// The device sends by itself, so that its messages have no time to reply.
    #[serde(skip)]
    chatters: bool,
    #[serde(skip)]
    base: SimSettings,
    #[serde(skip)]
    written: SimSettings,
}

/// Cost of the third of the recording that the search did not use.
#[derive(Serialize)]
pub(super) struct HeldOut {
    pub(super) slots: usize,
    pub(super) before: f64,
    /// With what is written.
    pub(super) fitted: f64,
    /// Of plays of the model itself with what is written.
    pub(super) by_chance: f64,
}

/// Of two values, the first is the vehicle's, the second the model's.
#[derive(Serialize, Default)]
pub(super) struct CommandRow {
    name: String,
    asked: usize,
    answered: [usize; 2],
    /// Median and 99th percentile of the time to reply.
    ms: [[f64; 2]; 2],
    /// Bytes of replies.
    lengths: [BTreeSet<usize>; 2],
    /// Replies to the same request that are of another message, command or length.
    other_form: usize,
    /// Replies that came before the one to an earlier request.
    out_of_order: [usize; 2],
}

#[derive(Serialize, Default)]
pub(super) struct FieldRow {
    pub(super) name: String,
    pub(super) unit: &'static str,
    pub(super) count: usize,
    pub(super) bias: f64,
    pub(super) rms: f64,
    /// Lag of the vehicle, ms, if it changes enough.
    pub(super) lag_ms: Option<f64>,
    pub(super) range: [f64; 2],
    /// For a bit or a word: how often it differs, and the first time, s.
    pub(super) differs: Option<(usize, Option<f64>)>,
    /// Time in s, the vehicle's value, the model's.
    #[serde(skip)]
    pub(super) series: Vec<[f64; 3]>,
}

#[derive(Serialize)]
pub(super) struct SettingRow {
    pub(super) key: String,
    pub(super) basis: &'static str,
    pub(super) verdict: &'static str,
    pub(super) value: String,
    /// Another value that explains the recording.
    pub(super) found: Option<String>,
    /// Set if it is unambiguous, and improves the fit of the third that was not used.
    pub(super) written: bool,
    /// Why a value that was found is not written.
    not_written: Option<String>,
    /// A number, the ends of its 99 % interval, and their unit.
    pub(super) number: Option<(f64, [Option<f64>; 2], String)>,
    #[serde(skip)]
    is_whole: bool,
    /// Settings that it may be instead.
    pub(super) or: Vec<String>,
    /// The evidence for it, or what would be evidence.
    pub(super) why: String,
}

impl Report {
    pub(super) fn of(search: &Search<'_>, findings: &Findings) -> Self {
        let slots = || all(search).map(|(_, slot, _)| slot);
        let mut unexplained = search.unexplained(&findings.model);
        if search.recordings.iter().any(|one| !one.is_understood) {
            unexplained.insert(0, NOT_UNDERSTOOD.to_owned());
        }
        let settings: Vec<SettingRow> = (0..search.knobs.len())
            .map(|at| setting(search, findings, at))
            .collect();
        let documented = settings.iter().filter(|row| row.basis == "documented");
        let contradicted = documented.filter(|row| row.verdict == Verdict::Contradicted.as_str());
        Self {
            used: search.used(),
            poses_offsets: search
                .recordings
                .iter()
                .filter_map(|one| one.offset)
                .collect(),
            // Where little is left of a recording, the machine may have caused the differences.
            is_as_documented: contradicted.count() == 0
                && (unexplained.is_empty() || search.used() < ENOUGH),
            commands: commands(search, &findings.assumed),
            fields: fields(search, &findings.assumed),
            settings,
            unexplained,
            held_out: HeldOut {
                slots: slots().filter(|slot| slot.counts && slot.held_out).count(),
                before: findings.held_out[0],
                fitted: findings.held_out[1],
                by_chance: findings.held_out[2],
            },
            chatters: search.recordings[0].device.host.chatters,
            base: search.base.clone(),
            written: findings.written.clone(),
        }
    }

    /// Returns whether enough of the recording takes part for a verdict.
    pub(super) fn is_enough(&self) -> bool {
        self.used >= ENOUGH
    }
}

impl Verdict {
    pub(super) fn as_str(self) -> &'static str {
        match self {
            Self::Supported => "supported",
            Self::Contradicted => "contradicted",
            Self::NotDecided => "not decided",
            Self::NotTouched => "not touched",
        }
    }
}

fn setting(search: &Search<'_>, findings: &Findings, at: usize) -> SettingRow {
    let (knob, verdict) = (&search.knobs[at], findings.verdicts[at]);
    let found = findings.found.iter().find(|one| one.knob == at);
    let why = match (found, verdict) {
        (Some(found), _) => shown(search, findings, found),
        (None, Verdict::NotTouched) => plan::touching(search.recordings[0].device, &knob.key),
        _ => String::new(),
    };
    let written = found.is_some_and(|found| {
        let changed = |settings| knob.literal_in(settings) != knob.literal_in(&search.base);
        search.used() >= ENOUGH && search.doubt(found).is_none() && changed(&findings.written)
    });
    SettingRow {
        key: knob.name(),
        basis: match knob.basis {
            Basis::Documented(_) => "documented",
            Basis::Assumed(_) => "assumed",
        },
        verdict: verdict.as_str(),
        value: knob.default.clone(),
        found: found.map(|found| found.literal.clone()),
        number: found
            .and_then(|found| found.number)
            .map(|(value, ends)| (value, ends, knob.unit())),
        is_whole: knob.is_whole(),
        written,
        not_written: found
            .filter(|_| !written)
            .map(|found| not_written(search, found)),
        or: found.map(|found| found.or.clone()).unwrap_or_default(),
        why,
    }
}

/// Why a value that was found is not written.
fn not_written(search: &Search<'_>, found: &Found) -> String {
    if search.used() < ENOUGH {
        return "too little of the recording takes part".to_owned();
    }
    match search.doubt(found) {
        Some(Doubt::Others) => format!("it may be one of these instead: {}", found.or.join(", ")),
        Some(Doubt::Left) => "too much is left of what it changes".to_owned(),
        Some(Doubt::Shaky) => {
            "it saves little, and no more than luck where another setting replaces one that was found"
                .to_owned()
        }
        Some(Doubt::Before) => "the value before is within its interval".to_owned(),
        Some(Doubt::OneEnd) => "the recording shows one end of it only".to_owned(),
        Some(Doubt::Rough) => "its interval is wide".to_owned(),
        None => NO_BETTER.to_owned(),
    }
}

/// Time and bytes that show best that a setting differs.
fn shown(search: &Search<'_>, findings: &Findings, found: &Found) -> String {
    let (at, slot) = found.shown_by;
    let recording = &search.recordings[at];
    let reply = |reply: Option<&Reply>| match reply {
        Some(reply) if recording.slots[slot].is_pose() => poses::show(&reply.values[1..]),
        Some(reply) => format!("{} after {:.1} ms", Hex(&reply.bytes), reply.values[0]),
        None => "nothing".to_owned(),
    };
    format!(
        "at {} s, {}: the vehicle answered {}, the model {}",
        SimTime::from_nanos(recording.slots[slot].at),
        recording.slots[slot].text,
        reply(recording.seen[slot].as_ref()),
        reply(findings.assumed.reply(at, slot)),
    )
}

/// Recording, slot, and what the vehicle answered.
fn all<'a>(
    search: &'a Search<'_>,
) -> impl Iterator<Item = ((usize, usize), &'a Slot, Option<&'a Reply>)> {
    let recordings = search.recordings.iter().enumerate();
    recordings.flat_map(|(at, recording)| {
        let slots = recording.slots.iter().zip(&recording.seen).enumerate();
        slots.map(move |(slot, (asked, seen))| ((at, slot), asked, seen.as_ref()))
    })
}

fn commands(search: &Search<'_>, model: &Model) -> Vec<CommandRow> {
    let mut rows: BTreeMap<&str, (CommandRow, [Vec<f64>; 2])> = BTreeMap::new();
    // The last reply of each side so far, and in which recording.
    let mut last = [(0, 0); 2];
    let chatters = search.recordings[0].device.host.chatters;
    for ((at, slot), asked, seen) in all(search).filter(|(_, slot, _)| !slot.is_pose()) {
        let (row, times) = rows.entry(&asked.name).or_default();
        row.asked += 1;
        let replies = [seen, model.reply(at, slot)];
        if let [Some(seen), Some(model)] = replies {
            row.other_form += usize::from(seen.form != model.form);
        }
        for (side, reply) in replies.into_iter().enumerate() {
            let Some(reply) = reply else { continue };
            row.answered[side] += 1;
            row.lengths[side].insert(reply.bytes.len());
            times[side].push(reply.values[0]);
            let came = (at, reply.at);
            row.out_of_order[side] += usize::from(came < last[side] && !chatters);
            last[side] = last[side].max(came);
        }
    }
    let row = |(name, (row, times)): (&str, (CommandRow, [Vec<f64>; 2]))| CommandRow {
        name: name.to_owned(),
        ms: times.map(|mut all| {
            all.sort_by(f64::total_cmp);
            [50, 99].map(|part| all.get(all.len() * part / 100).copied().unwrap_or(0.0))
        }),
        ..row
    };
    rows.into_iter().map(row).collect()
}

fn fields(search: &Search<'_>, model: &Model) -> Vec<FieldRow> {
    let mut rows: BTreeMap<(&str, usize), FieldRow> = BTreeMap::new();
    for ((at, slot), asked, seen) in all(search).filter(|(_, slot, _)| slot.counts) {
        let cell = &model.cells[at][slot];
        let Some(seen) = seen.filter(|seen| Some(seen.form) == cell.form) else {
            continue;
        };
        let channels = model.layout.channels(seen).iter().enumerate().skip(1);
        for (channel, info) in channels {
            let new = || FieldRow {
                name: format!("{}.{}", seen.form.0, info.name),
                unit: info.unit,
                differs: info.is_choice.then_some((0, None)),
                ..FieldRow::default()
            };
            let row = rows.entry((seen.form.0, channel)).or_insert_with(new);
            let time = asked.at as f64 / 1e9;
            let [seen, model] =
                [seen.values[channel], cell.mean[channel]].map(|value| value / info.per);
            if let Some((count, first)) = row.differs.as_mut().filter(|_| seen != model) {
                *count += 1;
                first.get_or_insert(time);
            }
            row.series.push([time, seen, model]);
        }
    }
    let mut rows: Vec<FieldRow> = rows.into_values().collect();
    rows.iter_mut().for_each(FieldRow::sum_up);
    rows
}

impl FieldRow {
    fn sum_up(&mut self) {
        let rest = self.series.iter().map(|[_, seen, model]| seen - model);
        let rest: Vec<f64> = rest.collect();
        self.count = rest.len();
        self.bias = middle(&rest).0;
        self.rms = rms(rest.into_iter());
        let mut seen: Vec<f64> = self.series.iter().map(|[_, seen, _]| *seen).collect();
        seen.sort_by(f64::total_cmp);
        self.range = [seen[0], seen[seen.len() - 1]];
        let varies = self.range[1] - self.range[0];
        let is_plain = varies == 0.0 || varies < 20.0 * self.rms.min(1.0);
        if self.differs.is_some() || self.count < 20 || is_plain {
            return;
        }
        let with_lag = |lag: f64| {
            let series = self.series.iter();
            rms(series.filter_map(|[time, seen, _]| Some(seen - self.model_at(time - lag)?)))
        };
        let lags = LAGS.map(|lag| f64::from(lag) * LAG_STEP / 1e3);
        let best = lags.min_by(|one, other| with_lag(*one).total_cmp(&with_lag(*other)));
        self.lag_ms = best.map(|lag| lag * 1e3);
    }

    /// The model's value between its replies.
    fn model_at(&self, time: f64) -> Option<f64> {
        let at = self.series.partition_point(|[other, ..]| *other <= time);
        let (before, after) = (self.series.get(at.checked_sub(1)?)?, self.series.get(at)?);
        let part = (time - before[0]) / (after[0] - before[0]).max(1e-9);
        Some(before[2] + part * (after[2] - before[2]))
    }
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (count, sum) = values.fold((0.0_f64, 0.0), |(count, sum), value| {
        (count + 1.0, sum + value * value)
    });
    f64::sqrt(sum / count.max(1.0))
}
