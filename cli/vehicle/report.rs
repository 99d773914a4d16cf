//! What recordings say of the model: of commands, fields and settings, as text and as a file of settings.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use rigsim_core::SimTime;
use rigsim_core::event::Hex;
use rigsim_core::settings::SimSettings;
use rigsim_settings::{Basis, Settings as _};
use serde::Serialize;

use super::recording::{Reply, Slot, middle};
use super::search::{Doubt, ENOUGH, Findings, Found, Model, Search, Verdict};
use super::{plan, poses};
use crate::config;

/// Why nothing is written that is certain by the rest of a recording.
const NO_BETTER: &str = "the third that was not used fits no better with what was found";
/// First words of a file of settings that were found.
pub(super) const MARK: &str = "# Settings by which the model does what was recorded.";
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
    /// Settings that explain the recording nearly as well.
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

    fn with(&self, verdict: Verdict) -> impl Iterator<Item = &SettingRow> {
        self.settings
            .iter()
            .filter(move |row| row.verdict == verdict.as_str())
    }

    pub(super) fn text(&self) -> String {
        let mut text = self.warning();
        // Writing to a string cannot fail.
        text.push_str(match self.chatters {
            true => "message                     vehicle  model   bytes\n",
            false => {
                "command                  requests  vehicle  model   ms p50/p99 vehicle      model   bytes\n"
            }
        });
        for row in &self.commands {
            let [v, m] = row.ms.map(|[p50, p99]| format!("{p50:.1}/{p99:.1}"));
            let [asked, times] = match self.chatters {
                true => [String::new(), String::new()],
                false => [format!("{:6} ", row.asked), format!(" {v:>18} {m:>12}")],
            };
            let lengths = row.lengths.each_ref().map(|all| format!("{all:?}"));
            let different = if lengths[0] == lengths[1] { 1 } else { 2 };
            let [vehicle, model] = row.answered;
            let form = match row.other_form {
                0 => String::new(),
                count => format!("; {count} of another form"),
            };
            let order = match row.out_of_order {
                [0, 0] => String::new(),
                [vehicle, model] => format!("; out of order {vehicle} / {model}"),
            };
            let _ = writeln!(
                text,
                "{:26} {asked}{vehicle:8} {model:6}{times}   {}{form}{order}",
                row.name,
                lengths[..different].join(" / "),
            );
        }
        let _ = writeln!(
            text,
            "\nfield                                     bias          rms      lag   vehicle's range"
        );
        let mut same = 0;
        for row in &self.fields {
            let is_same = match row.differs {
                Some((_, first)) => first.is_none(),
                None => row.rms == 0.0,
            };
            same += usize::from(is_same);
            if is_same {
                continue;
            }
            if let Some((count, Some(first))) = row.differs {
                let _ = writeln!(
                    text,
                    "{:34} differs {count} times of {}, first at {first:.3} s",
                    row.name, row.count
                );
                continue;
            }
            let lag = row
                .lag_ms
                .map_or(String::new(), |lag| format!("{lag:.0} ms"));
            let [low, high] = row.range.map(|end| (end * 1e4).round() / 1e4);
            let _ = writeln!(
                text,
                "{:34} {:>11.4} {:>12.4} {lag:>8}   {low} to {high} {}",
                row.name, row.bias, row.rms, row.unit,
            );
        }
        if same > 0 {
            let _ = writeln!(text, "the other {same} are equal");
        }
        text.push('\n');
        for offset in &self.poses_offsets {
            let _ = writeln!(text, "poses: {offset:.3} s were added to their times\n");
        }
        text.push_str(&self.verdicts());
        text
    }

    /// Warning at the top if little of the recording takes part.
    fn warning(&self) -> String {
        let left_out = (1.0 - self.used) * 100.0;
        match self.is_enough() {
            false => format!(
                "WARNING: {left_out:.0} % was left out, since the recording machine stalled: too little is left for \
                 a verdict. Record again on a machine that does nothing else.\n\n"
            ),
            true => String::new(),
        }
    }

    fn verdicts(&self) -> String {
        let mut text = String::new();
        for row in self.with(Verdict::Contradicted) {
            let _ = writeln!(
                text,
                "contradicted  {} ({}): {} instead of {}\n    {}",
                row.key,
                row.basis,
                row.shown(),
                row.value,
                row.why
            );
        }
        let undecided = self.with(Verdict::NotDecided);
        for row in undecided.filter(|row| row.found.is_some()) {
            let or = match row.or.is_empty() {
                true => String::new(),
                false => format!(", or one of: {}", row.or.join(", ")),
            };
            let (key, shown, value, why) = (&row.key, row.shown(), &row.value, &row.why);
            let _ = writeln!(
                text,
                "not decided   {key}: {shown} instead of {value}{or}\n    {why}"
            );
        }
        for row in &self.unexplained {
            let _ = writeln!(text, "unexplained   {row}");
        }
        for verdict in [Verdict::Supported, Verdict::NotDecided] {
            let keys: Vec<&str> = self
                .with(verdict)
                .filter(|row| row.found.is_none())
                .map(|row| row.key.as_str())
                .collect();
            let _ = writeln!(
                text,
                "{:13} {}: {}",
                verdict.as_str(),
                keys.len(),
                keys.join(", ")
            );
        }
        let mut untouched: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
        for row in self.with(Verdict::NotTouched) {
            untouched.entry(&row.why).or_default().push(&row.key);
        }
        for (why, keys) in untouched {
            let _ = writeln!(text, "not touched   {}\n    {why}", keys.join(", "));
        }
        if self.used < 1.0 {
            let _ = writeln!(
                text,
                "{:.0} % was left out: the recording machine stalled, or replies were late",
                (1.0 - self.used) * 100.0
            );
        }
        text.trim_end().to_owned()
    }

    pub(super) fn fit_text(&self) -> String {
        let mut found = self.settings.iter().filter(|row| row.found.is_some());
        let not_written = found
            .clone()
            .filter_map(|row| Some((&row.key, row.not_written.as_ref()?)));
        let is_worse = not_written.clone().any(|(_, since)| since == NO_BETTER);
        let mut reasons = String::new();
        for (key, since) in not_written {
            let _ = writeln!(reasons, "not written   {key}, since {since}");
        }
        let result = match (found.clone().next(), found.any(|row| row.written)) {
            _ if !self.is_enough() => "nothing is written",
            (None, _) if !self.unexplained.is_empty() => "no setting explains what differs",
            (None, _) => "nothing to change",
            (_, true) => "better",
            (_, false) if is_worse => "NOT better: nothing is written but as a comment",
            (_, false) => "nothing is certain enough: nothing is written but as a comment",
        };
        let (warning, verdicts) = (self.warning(), self.verdicts());
        format!(
            "{warning}{verdicts}\n\n{reasons}{} ({result})",
            self.held_out.words()
        )
    }

    /// The file of settings: those of `file`, and those that were found. A setting that was given for the
    /// recording only, such as a raised vehicle, is not a property of the vehicle.
    pub(super) fn toml(&self, file: &SimSettings) -> String {
        let [given, before, after] = [file, &self.base, &self.written].map(SimSettings::entries);
        let all = given.into_iter().zip(before).zip(after);
        let entries = all.map(
            |((given, before), after)| match before.value == after.value {
                true => given,
                false => after,
            },
        );
        let mut text = format!("{MARK}\n# {}.\n", self.held_out.words());
        let found = self.settings.iter().filter(|row| row.found.is_some());
        let (written, others): (Vec<_>, Vec<_>) = found.partition(|row| row.written);
        let why = |row: &SettingRow| {
            let (key, shown, value, why) = (&row.key, row.shown(), &row.value, &row.why);
            format!("# {key}: {shown} instead of {value}; {why}\n")
        };
        for line in config::changed_of(entries) {
            // Each part of a version has its own reason.
            let of_knob = written.iter().filter(|row| {
                let key = row.key.split('[').next().unwrap_or_default();
                line.split(' ').next() == Some(key)
            });
            let mut reasons: String = of_knob.map(|row| why(row)).collect();
            if reasons.is_empty() {
                reasons = "# As it was set before.\n".to_owned();
            }
            let _ = writeln!(text, "\n{reasons}{line}");
        }
        for row in others {
            let since = row.not_written.as_deref().unwrap_or_default();
            let _ = writeln!(text, "\n{}# Not written, since {since}", why(row));
        }
        text
    }
}

impl HeldOut {
    fn words(&self) -> String {
        let Self {
            slots,
            before,
            fitted,
            by_chance,
        } = self;
        format!(
            "Cost of the third that was not used, {slots} messages: {before:.0} before, {fitted:.0} with what is \
             written, {by_chance:.0} for plays of the model itself"
        )
    }
}

impl SettingRow {
    /// The value that was found, with its interval.
    fn shown(&self) -> String {
        let Some((value, ends, unit)) = &self.number else {
            return self.found.clone().unwrap_or_default();
        };
        let short = |end: f64| format!("{end:.2e}").parse().unwrap_or(end);
        let text = match *ends {
            [Some(low), Some(high)] if self.is_whole && high - low < 1.0 => {
                format!("{value:.0} {unit}")
            }
            [Some(low), Some(high)] if (high + low - 2.0 * value).abs() > 0.1 * (high - low) => {
                format!("{} to {} {unit}", short(low), short(high))
            }
            [Some(_), Some(high)] => {
                // Two digits of the uncertainty.
                let half = high - value;
                let scales = std::iter::successors(Some(10.0), |scale| Some(scale / 10.0));
                let digits = scales.take(9).position(|scale| half >= scale).unwrap_or(9);
                format!("{value:.digits$} ± {half:.digits$} {unit}")
            }
            [Some(low), None] => format!("more than {} {unit}", short(low)),
            [None, Some(high)] => format!("less than {} {unit}", short(high)),
            [None, None] => "another value".to_owned(),
        };
        text.trim_end().to_owned()
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
        Some(Doubt::Others) => format!(
            "one of these explains it nearly as well: {}",
            found.or.join(", ")
        ),
        Some(Doubt::Left) => "too much is left of what it changes".to_owned(),
        Some(Doubt::Shaky) => {
            "it shows little, and is not needed if another is in the place of one that was found"
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
