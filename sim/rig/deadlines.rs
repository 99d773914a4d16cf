//! Times at which each device next has something to do.

use rigsim_settings::SimTime;

/// A time for each device, with the earliest at hand however many there are.
///
/// It is a tree of minima over the devices' times: setting one takes as many steps as the tree is
/// high, and the earliest is at its root.
#[derive(Debug, Clone)]
pub(super) struct Deadlines {
    /// The root is at 1, the children of `n` are at `2n` and `2n + 1`, and the devices' own times
    /// fill the second half.
    nodes: Vec<SimTime>,
    devices: usize,
}

impl Deadlines {
    /// Without any devices.
    pub(super) fn new() -> Self {
        Self {
            nodes: vec![SimTime::MAX; 2],
            devices: 0,
        }
    }

    /// Adds a device that has nothing to do.
    pub(super) fn push(&mut self) {
        if self.devices == self.leaves() {
            let times = self.nodes.split_off(self.leaves());
            self.nodes = vec![SimTime::MAX; 4 * times.len()];
            for (device, time) in times.into_iter().enumerate() {
                self.set(device, time);
            }
        }
        self.devices += 1;
    }

    /// Time at which a device next has something to do; never if there is no such device.
    pub(super) fn of(&self, device: usize) -> SimTime {
        let time = self.nodes.get(self.leaves() + device);
        time.copied().unwrap_or(SimTime::MAX)
    }

    /// A device next has something to do at `time`. There must be such a device.
    pub(super) fn set(&mut self, device: usize, time: SimTime) {
        let mut node = self.leaves() + device;
        self.nodes[node] = time;
        while node > 1 {
            let earlier = self.nodes[node].min(self.nodes[node ^ 1]);
            node /= 2;
            if self.nodes[node] == earlier {
                break;
            }
            self.nodes[node] = earlier;
        }
    }

    /// The earliest of all times.
    pub(super) fn earliest(&self) -> SimTime {
        self.nodes[1]
    }

    /// The first device from index `from` on with something to do by `at`.
    pub(super) fn due(&self, at: SimTime, from: usize) -> Option<usize> {
        if self.earliest() > at || from >= self.devices {
            return None;
        }
        let mut node = self.leaves() + from;
        while self.nodes[node] > at {
            // On to the subtree on the right of this one and of all that end with it.
            node >>= node.trailing_ones();
            if node == 0 {
                return None;
            }
            node += 1;
        }
        while node < self.leaves() {
            node *= 2;
            node += usize::from(self.nodes[node] > at);
        }
        Some(node - self.leaves())
    }

    fn leaves(&self) -> usize {
        self.nodes.len() / 2
    }
}

#[cfg(test)]
mod tests;
