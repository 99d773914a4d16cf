//! Reports as text and as a file of settings.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use rigsim_core::settings::SimSettings;
use rigsim_settings::Settings as _;

use super::super::search::Verdict;
use super::{HeldOut, NO_BETTER, Report, SettingRow};
use crate::config;

/// First words of a file of settings that were found.
pub(in super::super) const MARK: &str = "# Settings by which the model does what was recorded.";

impl Report {
    fn with(&self, verdict: Verdict) -> impl Iterator<Item = &SettingRow> {
        self.settings
            .iter()
            .filter(move |row| row.verdict == verdict.as_str())
    }

    pub(in super::super) fn text(&self) -> String {
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

    pub(in super::super) fn fit_text(&self) -> String {
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
    pub(in super::super) fn toml(&self, file: &SimSettings) -> String {
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
