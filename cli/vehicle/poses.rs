//! Poses of a vehicle, from motion capture or GNSS, as further replies beside a recording.

use std::io::Read as _;
use std::path::Path;

use anyhow::{Context as _, ensure};
use rigsim_core::SimTime;
use rigsim_core::device::host::MessageInfo;
use rigsim_core::message::{FieldInfo, Sender};
use rigsim_runner::Run;
use rigsim_runner::trace::Observer;

use crate::patient_file::PatientFile;

const COLUMNS: [&str; 4] = ["seconds", "x_m", "y_m", "heading_deg"];
/// Limits of a file: length in bytes, and time from its first pose to its last, s.
const MOST_BYTES: u64 = 64 << 20;
const MOST_TIME: f64 = 3600.0;
/// Limit of all numbers.
const MOST: f64 = 1e10;
/// Least time between two poses that are compared, ns; a clock of whole milliseconds must not halve the
/// number of poses.
pub(super) const APART: u64 = 100_000_000;
const NEARLY: f64 = 0.098;
/// Step sizes of the search for the offset of a file's clock, s.
const STEPS: [f64; 3] = [0.1, 0.01, 0.001];
/// Distance that counts like turning by a radian, m.
const LEVER: f64 = 0.5;

/// Time in s, x and y in m, heading in rad, which does not wrap.
pub(super) type TimedPose = [f64; 4];

pub(super) static POSE: MessageInfo = MessageInfo::new(
    Sender::Device,
    0,
    &[
        field("x", "m", 1000),
        field("y", "m", 1000),
        field("heading", "deg", 100),
        field("speed", "m/s", 1000),
    ],
)
.named(0, "pose", "Where the vehicle is, seen from where it began.");

const fn field(name: &'static str, unit: &'static str, per: u32) -> FieldInfo {
    FieldInfo {
        name,
        unit,
        per,
        ..FieldInfo::new::<i32>()
    }
}

/// Reads a file of poses. A pose soon after another is left out.
pub(super) fn read(path: &Path) -> anyhow::Result<Vec<TimedPose>> {
    let file = PatientFile::open(path)?.take(MOST_BYTES);
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .comment(Some(b'#'))
        .flexible(true)
        .from_reader(file);
    let heads = reader.headers()?;
    let mut columns = [0; 4];
    for (column, name) in columns.iter_mut().zip(COLUMNS) {
        let found = heads.iter().position(|head| head == name);
        let there = || heads.iter().collect::<Vec<_>>().join("`, `");
        *column = found.with_context(|| {
            format!(
                "no column is named `{name}`; commas stand between columns, and these are `{}`",
                there()
            )
        })?;
    }
    let mut all: Vec<TimedPose> = Vec::new();
    let mut last = f64::NEG_INFINITY;
    for record in reader.records() {
        let record = record?;
        let line = record.position().map_or(0, csv::Position::line);
        let mut row = [0.0; 4];
        for ((value, name), column) in row.iter_mut().zip(COLUMNS).zip(columns) {
            let cell = record.get(column).unwrap_or_default();
            let number = cell.parse().ok();
            *value = number
                .filter(|number: &f64| number.abs() < MOST)
                .with_context(|| format!("line {line}, column {name}: `{cell}` is not a number"))?;
        }
        ensure!(row[0] > last, "line {line}, column seconds: time goes back");
        last = row[0];
        let first = all.first().map_or(last, |first| first[0]);
        ensure!(
            last - first <= MOST_TIME,
            "line {line}, column seconds: more than an hour behind the first pose"
        );
        row[3] = row[3].to_radians();
        if all.last().is_none_or(|kept| last - kept[0] > NEARLY) {
            row[3] = unwrapped(all.last(), row[3]);
            all.push(row);
        }
    }
    ensure!(all.len() > 1, "it has fewer than two poses");
    Ok(all)
}

/// The heading nearest to the last one.
fn unwrapped(last: Option<&TimedPose>, heading: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    last.map_or(heading, |last| {
        last[3] + (heading - last[3] + PI).rem_euclid(TAU) - PI
    })
}

/// Poses of the first device at these times.
pub(super) struct Track<'t> {
    /// In ns, each later than the one before.
    pub(super) times: &'t [u64],
    pub(super) poses: Vec<TimedPose>,
}

impl Observer for Track<'_> {
    fn next_sample(&self) -> SimTime {
        let next = self.times.get(self.poses.len());
        next.map_or(SimTime::MAX, |next| SimTime::from_nanos(*next))
    }

    fn sample(&mut self, run: &Run) {
        let motion = run.rig().motion(0);
        let pose = motion.map(|motion| motion.pose).unwrap_or_default();
        let heading = unwrapped(self.poses.last(), pose.heading);
        let now = run.rig().now().as_secs_f64();
        self.poses.push([now, pose.x, pose.y, heading]);
    }
}

/// Speed ahead, m/s.
fn speed([from, to]: [&TimedPose; 2]) -> f64 {
    let (sin, cos) = f64::midpoint(from[3], to[3]).sin_cos();
    let ahead = (to[1] - from[1]) * cos + (to[2] - from[2]) * sin;
    ahead / (to[0] - from[0]).max(1e-9)
}

/// The fields of [`POSE`] on the wire, relative to the mean of the first `still` poses, at which the vehicle
/// stands.
pub(super) fn on_wire(poses: &[TimedPose], still: usize) -> impl Iterator<Item = Vec<f64>> {
    let still = &poses[..still.max(1).min(poses.len())];
    let mean = |at: usize| still.iter().map(|pose| pose[at]).sum::<f64>() / still.len() as f64;
    let [x, y, heading] = [1, 2, 3].map(mean);
    let (sin, cos) = heading.sin_cos();
    poses.iter().enumerate().map(move |(at, pose)| {
        let (ahead, left) = (pose[1] - x, pose[2] - y);
        let values = [
            ahead * cos + left * sin,
            left * cos - ahead * sin,
            (pose[3] - heading).to_degrees(),
            speed([&poses[at.saturating_sub(1)], pose]),
        ];
        let values = values.iter().zip(POSE.fields);
        values
            .map(|(value, field)| value * f64::from(field.per))
            .collect()
    })
}

/// Offset of a file's clock, s, at which the vehicle moves when the model does; `None` if it does not explain
/// half of the model's motion.
pub(super) fn offset(file: &[TimedPose], model: &[TimedPose]) -> Option<f64> {
    let rates = |poses: &[TimedPose]| {
        let pairs = poses.windows(2).map(|two| {
            let [from, to] = [&two[0], &two[1]];
            let turning = LEVER * (to[3] - from[3]) / (to[0] - from[0]);
            [f64::midpoint(from[0], to[0]), speed([from, to]), turning]
        });
        pairs.collect::<Vec<_>>()
    };
    let (file, model) = (rates(file), rates(model));
    let still = [0.0; 3];
    let cost = |offset: f64| {
        let of_one = |[time, speed, turning]: &[f64; 3]| {
            let after = file.partition_point(|[at, ..]| *at <= time - offset);
            let around = after.checked_sub(1).and_then(|at| file.get(at..at + 2));
            let [from, to] = around.map_or([still; 2], |two| [two[0], two[1]]);
            let part = (time - offset - from[0]) / (to[0] - from[0]).max(1e-9);
            let rest = |at: usize, value| from[at] + part * (to[at] - from[at]) - value;
            rest(1, speed).powi(2) + rest(2, turning).powi(2)
        };
        model.iter().map(of_one).sum::<f64>()
    };
    let [first, last] = [&file, &model].map(|all| Some([all.first()?[0], all.last()?[0]]));
    let ([first, last], [from, to]) = (first?, last?);
    let (mut centre, mut reach) = (
        f64::midpoint(from - last, to - first),
        (to - from + last - first) / 2.0,
    );
    let mut least = f64::INFINITY;
    for step in STEPS {
        let count = (reach / step).ceil();
        let offsets = (0..)
            .map(|at| f64::from(at) - count)
            .take_while(|at| *at <= count);
        let costs = offsets.map(|at| (cost(centre + at * step), centre + at * step));
        (least, centre) = costs.min_by(|one, other| one.0.total_cmp(&other.0))?;
        reach = step;
    }
    let motion = model
        .iter()
        .map(|[_, speed, turning]| speed.powi(2) + turning.powi(2));
    (least < 0.5 * motion.sum::<f64>()).then_some(centre)
}

/// A pose by its values on the wire, in words.
pub(super) fn show(on_wire: &[f64]) -> String {
    let fields = POSE.fields.iter().zip(on_wire);
    let field = |(field, value): (&FieldInfo, &f64)| {
        let value = value / f64::from(field.per);
        format!("{} {value:.3} {}", field.name, field.unit)
    };
    fields.map(field).collect::<Vec<_>>().join(" ")
}
