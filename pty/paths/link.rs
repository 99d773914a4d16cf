//! The symbolic link under which clients find a pseudo-terminal.

use std::path::{Path, PathBuf};

use rustix::fs::{AtFlags, unlinkat};

use super::Place;
use super::lock::Lock;
use crate::error::PortErrorKind;

/// A published link, removed on drop if it is still ours. Its lock is held as long, and records where it
/// points: so the link of a killed simulator is known, even when the number of its pseudo-terminal is in use
/// again.
#[derive(Debug)]
pub(crate) struct Link {
    path: PathBuf,
    place: Place,
    target: PathBuf,
    // Dropped, and with it released, after the link is removed.
    lock: Lock,
}

impl Link {
    /// Publishes a link at `path` to `target`, a node that we hold.
    pub(crate) fn publish(path: &Path, target: &Path) -> Result<Self, PortErrorKind> {
        let place = Place::of(path)?;
        let lock = Lock::take(&place)?;
        let recorded = lock.recorded_target();
        lock.record(target)?;
        // Only what a simulator has recorded is a simulator's, wherever else a link may lead.
        let made = place.link_to(target, |name| {
            recorded.is_some() && place.read_link(name).ok() == recorded
        });
        if let Err(kind) = made {
            // All is left as it was found.
            match recorded {
                Some(recorded) => lock.record(&recorded)?,
                None => lock.remove(&place),
            }
            return Err(kind);
        }
        Ok(Self {
            path: path.to_owned(),
            place,
            target: target.to_owned(),
            lock,
        })
    }

    /// The path that clients open.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Turns the link to another node, so that clients see either the one or the other.
    pub(crate) fn turn_to(&mut self, target: &Path) -> Result<(), PortErrorKind> {
        self.lock.record(target)?;
        let old = &self.target;
        self.place.link_to(target, |name| {
            self.place.read_link(name).is_ok_and(|found| found == *old)
        })?;
        target.clone_into(&mut self.target);
        Ok(())
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        let place = &self.place;
        if place
            .read_link(&place.name)
            .is_ok_and(|found| found == self.target)
        {
            let _ = unlinkat(&place.dir, &place.name, AtFlags::empty());
        }
        self.lock.remove(place);
    }
}
