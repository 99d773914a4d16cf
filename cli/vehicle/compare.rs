//! The `compare` and `fit` subcommands: what a recording says of the model, and of its settings.

use std::path::PathBuf;

use anyhow::{Context as _, anyhow};
use rigsim_core::device::Devices;
use rigsim_settings::parse_quantity;

use super::knob::Knob;
use super::recording::Recording;
use super::report::{MARK, Report};
use super::search::{Findings, Search, read_best};
use super::{page, plan, poses};
use crate::args::{CompareArgs, FitArgs, PosesArgs, SettingsArgs};
use crate::config;
use crate::exit::{Exit, Failure, refuse};
use crate::print::{OutputFile, print};
use crate::visible;

/// Most requests that are compared at a time. Each takes some 200 bytes in each of hundreds of plays.
const MOST_SLOTS: usize = 10_000;

/// The `compare` subcommand.
pub(crate) fn compare(devices: Devices, args: &CompareArgs) -> Result<Exit, Failure> {
    let page = args
        .report
        .as_deref()
        .map(|path| OutputFile::find(path, crate::run::REPORT_MARKS));
    let page = page.transpose()?;
    let recordings = read(
        devices,
        std::slice::from_ref(&args.trace),
        &args.poses,
        &args.settings,
    )?;
    let (search, findings) = search(devices, &recordings, &args.settings, &args.only)?;
    let report = Report::of(&search, &findings);
    if let Some(page) = page {
        page.write(&page::page(&report))?;
    }
    print(&match args.json {
        true => serde_json::to_string_pretty(&report).map_err(Failure::system)?,
        false => report.text(),
    })?;
    Ok(match report.is_as_documented {
        _ if !report.is_enough() => Exit::System,
        true => Exit::Clean,
        false => Exit::Failed,
    })
}

/// The `fit` subcommand.
pub(crate) fn fit(devices: Devices, args: &FitArgs) -> Result<Exit, Failure> {
    if args.plan {
        let settings = config::load(devices, &args.settings)?;
        return print(&plan::show(devices, &args.device, &settings, args.json)?);
    }
    let output = args
        .output
        .as_deref()
        .ok_or_else(|| Failure::usage(anyhow!("give --output")))?;
    let output = OutputFile::find(output, &[MARK])?;
    let recordings = read(devices, &args.traces, &args.poses, &args.settings)?;
    let (search, findings) = search(devices, &recordings, &args.settings, &args.only)?;
    let report = Report::of(&search, &findings);
    if report.is_enough() {
        output.write(&report.toml(&config::load_file(devices, &args.settings)?))?;
    }
    print(&match args.json {
        true => serde_json::to_string_pretty(&report).map_err(Failure::system)?,
        false => report.fit_text(),
    })?;
    Ok(match report.is_enough() {
        true => Exit::Clean,
        false => Exit::System,
    })
}

fn read(
    devices: Devices,
    paths: &[PathBuf],
    poses: &PosesArgs,
    settings: &SettingsArgs,
) -> Result<Vec<Recording>, Failure> {
    let settings = config::load(devices, settings)?;
    let read = |path: &PathBuf| Recording::read(devices, path, &settings);
    let mut recordings: Vec<Recording> = paths.iter().map(read).collect::<Result<_, _>>()?;
    if poses.poses.len() > recordings.len() {
        refuse!("give --poses once for each recording, in the same order");
    }
    if recordings
        .windows(2)
        .any(|two| two[0].device != two[1].device)
    {
        refuse!("the recordings are of different vehicles");
    }
    read_best(&mut recordings, &settings).map_err(unplayable)?;
    let offset = match &*poses.poses_offset {
        "auto" => None,
        time => Some(
            parse_quantity(time, "s")
                .map_err(|why| Failure::usage(anyhow!("--poses-offset: {why}, or `auto`")))?,
        ),
    };
    for (recording, path) in recordings.iter_mut().zip(&poses.poses) {
        let read = poses::read(path).and_then(|poses| {
            let added = recording.add_poses(&poses, offset, &settings);
            added.map_err(anyhow::Error::msg)
        });
        read.with_context(|| format!("poses {}", visible::name(path)))
            .map_err(Failure::usage)?;
    }
    let slots: usize = recordings.iter().map(|one| one.slots.len()).sum();
    if slots > MOST_SLOTS {
        refuse!(
            "{slots} requests are recorded, and at most {MOST_SLOTS} are compared at a time: take a part of the recording, \
             such as by `head -n {MOST_SLOTS} drive.jsonl > part.jsonl`"
        );
    }
    Ok(recordings)
}

fn search<'a>(
    devices: Devices,
    recordings: &'a [Recording],
    settings: &SettingsArgs,
    only: &[String],
) -> Result<(Search<'a>, Findings), Failure> {
    let base = config::load(devices, settings)?;
    let only: Vec<String> = only.iter().map(|key| key.trim().to_owned()).collect();
    let all = Knob::all(&base, recordings[0].device.id, &[]);
    let is_unknown = |key: &&String| !all.iter().any(|knob| knob.key.starts_with(&***key));
    if let Some(key) = only.iter().find(is_unknown) {
        refuse!(
            "--only: no setting that a recording may tell begins with `{key}`; `sim config` lists all settings"
        );
    }
    let search = Search::new(recordings, base, &only);
    let findings = search.run().map_err(unplayable)?;
    Ok((search, findings))
}

fn unplayable(why: String) -> Failure {
    Failure::usage(anyhow!("it cannot be played: {why}"))
}
