//! Two clients for the same job: around a rectangle, three revolutions of the wheels ahead and one to
//! the left by packets, three back and one to the right by lines.

use std::time::Duration;

use rigsim_core::SimTime;
use rigsim_core::mecanum_device::ascii::{Command, Letter};
use rigsim_core::mecanum_device::codec;
use rigsim_core::mecanum_device::packet::{Request, Status};
use rigsim_core::mecanum_device::settings::ByteOrder;
use rigsim_core::scanner::{Decoded, Scanner};

use super::{Client, millis};
use crate::Ask;

const MAIN: usize = 0;
const ROS: usize = 1;
const SPEED: i16 = 300;
/// Silence in which a car would drive unseen.
const DEAF: Duration = millis(500);
const STOP: Request = Request::Motion {
    seq: 0,
    is_reset: 1,
    moving_idx: 0,
    s: 0,
    v: 0,
};
const BOARD_DRIVES: Request = Request::ControlMode { seq: 0, mode: 0 };

#[derive(Clone, Copy, PartialEq)]
enum Axis {
    X,
    Y,
}

fn pose(axis_x: i16, axis_y: i16) -> Request {
    Request::SetPose {
        seq: 0,
        axis_x,
        axis_y,
        ori: 0,
    }
}

fn motion(axis: Axis, way: i16) -> Request {
    Request::Motion {
        seq: 0,
        is_reset: 1,
        moving_idx: if axis == Axis::X { 0 } else { 2 },
        s: way.unsigned_abs(),
        v: SPEED * way.signum(),
    }
}

fn line(axis: Axis, way: i16) -> Vec<u8> {
    let letter = if axis == Axis::X {
        Letter::X
    } else {
        Letter::Y
    };
    let tenths = way.into();
    Command { letter, tenths }.encode()
}

/// Finds one packet, takes whatever comes after it for packets, and waits for each motion to end.
pub(crate) fn naive(client: &Client) -> Option<()> {
    client.ask(Ask::Open(MAIN))?;
    client.ask(Ask::Open(ROS))?;
    let mut last = [0; 2];
    while last != [0, 39] {
        last = [last[1], client.read(MAIN, 1)?[0]];
    }
    client.read(MAIN, 37)?;
    client.write(MAIN, pose(0, 0).encode())?;
    for order in [
        (MAIN, motion(Axis::X, 30).encode()),
        (MAIN, motion(Axis::Y, 10).encode()),
        (ROS, line(Axis::X, -30)),
        (ROS, line(Axis::Y, -10)),
    ] {
        client.write(order.0, order.1)?;
        let mut moved = false;
        loop {
            let running = client.read(MAIN, 39)?[36] != 0;
            if moved && !running {
                break;
            }
            moved |= running;
        }
    }
    client.ask(Ask::Close(MAIN))?;
    client.ask(Ask::Close(ROS))?;
    Some(())
}

/// Why the car does not go on. Nothing is known of its links here: they may be gone.
enum End {
    /// The run is over.
    Over,
    /// Something is wrong with the car.
    Trouble,
}

/// Why a way is not driven at one go.
#[derive(PartialEq)]
enum Pause {
    /// All motors stand.
    Stands,
    /// It has to be stopped first.
    Doubt,
}

/// A car that is not trusted.
struct Car<'c> {
    client: &'c Client,
    decoder: Scanner,
    now: SimTime,
    greeted: SimTime,
    /// The last packet that was believed, and how many there were.
    status: Status,
    count: u32,
    /// One that did not fit it.
    odd: Option<Status>,
    /// Where the car was when its board began again.
    lost: Option<(i16, i16)>,
}

/// Whether the car can have come from one place to the other between two packets.
fn fits(one: &Status, other: &Status) -> bool {
    let near = |a: i16, b: i16, most: u16| a.abs_diff(b) <= most;
    near(one.axis_x, other.axis_x, 6)
        && near(one.axis_y, other.axis_y, 6)
        && near(one.ori, other.ori, 300)
        && other.mile.wrapping_sub(one.mile) < 200
}

fn is_likely(status: &Status) -> bool {
    let distances = status.ut_f.iter().chain(&status.ut_b);
    distances.copied().all(|mm| (20..=4500).contains(&mm))
        && status.infra <= 1
        && status.moto_state <= 3
}

impl Car<'_> {
    /// For ten milliseconds reads what comes, opens what has hung up, and sends heartbeats.
    fn pass(&mut self) -> Result<(), End> {
        self.now = self.client.sleep(millis(10)).ok_or(End::Over)?;
        for link in [MAIN, ROS] {
            match self.client.ask(Ask::Read(link, 4096, Some(millis(1)))) {
                Some((now, bytes)) if link == MAIN => {
                    for byte in bytes {
                        let mut found = None;
                        for decoded in self.decoder.push(now, byte) {
                            if let Decoded::Frame(packet) = decoded {
                                found = codec::parse(&packet, ByteOrder::Little);
                            }
                        }
                        found
                            .filter(is_likely)
                            .into_iter()
                            .for_each(|status| self.take(status));
                    }
                    self.decoder.expire(now);
                }
                Some(_) => {}
                None => drop(self.client.ask(Ask::Open(link))),
            }
        }
        if self.now > self.greeted + millis(300) {
            self.greeted = self.now;
            self.client.write(MAIN, BOARD_DRIVES.encode());
        }
        Ok(())
    }

    /// Believes what fits the last packet, or two that fit each other.
    fn take(&mut self, status: Status) {
        if self.count > 0 && !fits(&self.status, &status) {
            if !self.odd.is_some_and(|odd| fits(&odd, &status)) {
                self.odd = Some(status);
                return;
            }
            if status.mile < 20 && self.status.mile > 120 {
                self.lost = Some((self.status.axis_x, self.status.axis_y));
            }
        }
        self.odd = None;
        self.status = status;
        self.count += 1;
    }

    /// Waits for the next packet; says whether it came in time.
    fn next(&mut self, patience: Duration) -> Result<bool, End> {
        let (count, due) = (self.count, self.now + patience);
        while self.count == count && self.now < due {
            self.pass()?;
        }
        Ok(self.count > count)
    }

    /// Waits until the board is heard to say twice where it is, and knows it.
    fn look(&mut self) -> Result<(), End> {
        let due = self.now + Duration::from_secs(10);
        let near = |a: i16, b: i16| a.abs_diff(b) <= 1;
        while self.now < due {
            let before = (self.status.axis_x, self.status.axis_y);
            let heard = self.next(DEAF)?;
            let Some((x, y)) = self.lost else {
                let same = near(self.status.axis_x, before.0) && near(self.status.axis_y, before.1);
                if heard && same {
                    return Ok(());
                }
                continue;
            };
            if near(self.status.axis_x, x) && near(self.status.axis_y, y) {
                self.lost = None;
            } else {
                self.client.write(MAIN, pose(x, y).encode());
            }
        }
        Err(End::Trouble)
    }

    fn stop(&mut self) -> Result<(), End> {
        let mut standing = 0;
        for _ in 0..60 {
            self.client.write(MAIN, STOP.encode());
            self.client.write(ROS, b"\nX0 \n".to_vec());
            let heard = self.next(millis(150))?;
            standing = if heard && self.status.moto_state == 0 {
                standing + 1
            } else {
                0
            };
            if standing == 2 {
                break;
            }
        }
        Ok(())
    }

    fn at(&self, axis: Axis) -> i16 {
        match axis {
            Axis::X => self.status.axis_x,
            Axis::Y => self.status.axis_y,
        }
    }

    fn is_clear(&self, axis: Axis, way: i16) -> bool {
        let near = |distances: [u16; 4]| distances.into_iter().any(|mm| mm < 350);
        match axis {
            Axis::Y => true,
            Axis::X if way > 0 => self.status.infra == 0 && !near(self.status.ut_f),
            Axis::X => !near(self.status.ut_b),
        }
    }

    /// Drives to a corner in as many orders as it takes.
    fn side(&mut self, axis: Axis, corner: i16, by_line: bool) -> Result<(), End> {
        for order in 0..12 {
            self.look()?;
            let way = corner - self.at(axis);
            if way.abs() <= 1 {
                return Ok(());
            }
            let due = self.now + Duration::from_secs(10);
            while !self.is_clear(axis, way) {
                if self.now > due {
                    return Err(End::Trouble);
                }
                self.next(DEAF)?;
            }
            if by_line && order < 3 {
                let text = [b"\n".to_vec(), line(axis, way)].concat();
                self.client.write(ROS, text);
            } else {
                self.client.write(MAIN, motion(axis, way).encode());
            }
            if self.watch(axis, corner, way, by_line && order < 3)? == Pause::Doubt {
                self.stop()?;
            }
        }
        Err(End::Trouble)
    }

    fn watch(&mut self, axis: Axis, corner: i16, way: i16, by_line: bool) -> Result<Pause, End> {
        let begun = self.now;
        let (mut standing, mut strayed, mut ran) = (0, 0, false);
        let (mut nearest, mut stuck) = (way.abs(), 0);
        let other = if axis == Axis::X { Axis::Y } else { Axis::X };
        let aside = self.at(other);
        while self.next(DEAF)? {
            let left = (corner - self.at(axis)) * way.signum();
            let wrong = left < -2 || left > way.abs() + 2;
            if self.lost.is_some() || wrong || !self.is_clear(axis, way) {
                return Ok(Pause::Doubt);
            }
            let off = (self.at(other) - aside).abs() > 3 || self.status.ori.abs() > 80;
            strayed = if off { strayed + 1 } else { 0 };
            let running = self.status.moto_state != 0;
            stuck = if running && left >= nearest {
                stuck + 1
            } else {
                0
            };
            nearest = nearest.min(left);
            if by_line && strayed >= 2 && left >= way.abs() && self.status.ori.abs() <= 80 {
                // It goes aside alone where it was sent another value than it should have.
                return Ok(Pause::Doubt);
            }
            if strayed == 3 || stuck == 15 {
                return Err(End::Trouble);
            }
            ran |= running;
            standing = if running { 0 } else { standing + 1 };
            if strayed == 0 && standing >= 2 && (ran || self.now > begun + millis(600)) {
                return Ok(Pause::Stands);
            }
        }
        Ok(Pause::Doubt)
    }

    fn drive(&mut self) -> Result<(), End> {
        self.look()?;
        self.side(Axis::X, 30, false)?;
        self.side(Axis::Y, 10, false)?;
        self.side(Axis::X, 0, true)?;
        self.side(Axis::Y, 0, true)?;
        // Where the last line was misheard, it went aside.
        self.side(Axis::X, 0, false)
    }
}

/// Waits for nothing without end, believes only what is likely, watches what comes of each order,
/// and stops when in doubt.
pub(crate) fn careful(client: &Client) -> Option<()> {
    let mut car = Car {
        client,
        decoder: codec::decoder::<Status>(millis(50)),
        now: SimTime::ZERO,
        greeted: SimTime::ZERO,
        count: 0,
        status: Status::default(),
        odd: None,
        lost: None,
    };
    match car.drive() {
        Ok(()) | Err(End::Trouble) => car.stop().ok()?,
        Err(End::Over) => return None,
    }
    client.ask(Ask::Close(MAIN));
    client.ask(Ask::Close(ROS));
    Some(())
}
