//! Two clients for the same job: switch 12 V A on, drive ahead at 0.5 m/s for 6 s, stop.

use std::time::Duration;

use rigsim_core::SimTime;
use rigsim_core::message::Message as _;
use rigsim_core::r150_device::codec;
use rigsim_core::r150_device::command::{Motors, Reply, Request, Success, SystemInfo, code};
use rigsim_core::scanner::{Decoded, Scanner};

use super::{Client, millis};
use crate::Ask;

/// About 0.5 m/s.
const AHEAD: Request = Request::SetMotors {
    right: 357,
    left: 357,
};
const STOP: Request = Request::SetMotors { right: 0, left: 0 };
const CAMERA_ON: Request = Request::PowerControl { on: 1 };
const ALL_OFF: Request = Request::PowerControl { on: 0 };
const DRIVE: Duration = Duration::from_secs(6);

/// Reads a whole frame as a reply to one of the commands of these clients.
fn read(frame: &[u8]) -> Option<Reply> {
    let (command, mut rest) = codec::parts(frame)?;
    Some(match command {
        code::SystemInfo => Reply::SystemInfo(SystemInfo::take(command, &mut rest)?),
        code::SetMotors => Reply::Motors(Motors::take(command, &mut rest)?),
        _ => {
            let Success { success } = Success::take(command, &mut rest)?;
            Reply::Bool { command, success }
        }
    })
}

/// Sends, waits for as many bytes as the answer should have, and takes everything for granted.
pub(crate) fn naive(client: &Client) -> Option<()> {
    client.sleep(millis(200))?;
    client.ask(Ask::Open(0))?;
    client.write(0, CAMERA_ON.encode())?;
    client.read(0, 7)?;
    for _ in 0..115 {
        client.write(0, AHEAD.encode())?;
        client.read(0, 14)?;
        client.sleep(millis(50))?;
    }
    client.write(0, STOP.encode())?;
    client.read(0, 14)?;
    client.ask(Ask::Close(0))?;
    Some(())
}

/// A link that is not trusted.
struct Link<'c> {
    client: &'c Client,
    decoder: Scanner,
    now: SimTime,
    /// When something valid last came.
    heard: SimTime,
}

impl<'c> Link<'c> {
    /// Opens the port, again and again if need be.
    fn open(client: &'c Client) -> Option<Self> {
        for _ in 0..100 {
            if let Some((now, _)) = client.ask(Ask::Open(0)) {
                return Some(Self {
                    client,
                    decoder: codec::decoder(millis(50)),
                    now,
                    heard: now,
                });
            }
            client.sleep(millis(100))?;
        }
        None
    }

    /// Asks, and waits until `patience` is over for the reply that fits.
    fn request(&mut self, request: Request, patience: Duration) -> Option<Option<Reply>> {
        self.client.write(0, request.encode())?;
        let until = self.now + patience;
        let mut fitting = None;
        // What is left of the time is waited for in any case, so that requests never come too fast.
        while self.now < until {
            let (now, bytes) = self.client.ask(Ask::Read(0, 64, Some(millis(5))))?;
            self.now = now;
            for byte in bytes {
                for decoded in self.decoder.push(now, byte) {
                    if let Decoded::Frame(frame) = decoded
                        && let Some(reply) = read(&frame)
                        && reply.command() == request.command()
                    {
                        fitting = Some(reply);
                    }
                }
            }
            self.decoder.expire(now);
        }
        if fitting.is_some() {
            self.heard = self.now;
        }
        Some(fitting)
    }

    /// Asks until `done` likes the reply; says whether it did in time.
    fn insist(
        &mut self,
        request: Request,
        time: Duration,
        done: impl Fn(&Reply) -> bool,
    ) -> Option<bool> {
        let until = self.now + time;
        while self.now < until {
            if self
                .request(request, millis(100))?
                .is_some_and(|reply| done(&reply))
            {
                return Some(true);
            }
        }
        Some(false)
    }
}

/// Waits for nothing without end, believes only what has the right CRC and fits what it asked,
/// watches what the module says of itself, and stops when in doubt.
pub(crate) fn careful(client: &Client) -> Option<()> {
    carefully(client, halt)
}

/// As careful, and stops by saying nothing more: the watchdog stops the vehicle.
pub(crate) fn silent(client: &Client) -> Option<()> {
    carefully(client, |_| Some(()))
}

fn carefully(client: &Client, stop: fn(&mut Link<'_>) -> Option<()>) -> Option<()> {
    client.sleep(millis(200))?;
    let mut link = Link::open(client)?;
    if mission(&mut link).and_then(|()| stop(&mut link)).is_none() {
        // The port has hung up: first of all the vehicle is to stand.
        link = Link::open(client)?;
        stop(&mut link)?;
    }
    Some(())
}

fn mission(link: &mut Link<'_>) -> Option<()> {
    let is_true = |reply: &Reply| matches!(reply, Reply::Bool { success: true, .. });
    let ready = link.insist(Request::Version, Duration::from_secs(15), |_| true)?
        && link.insist(CAMERA_ON, Duration::from_secs(3), is_true)?;
    if ready { drive(link) } else { Some(()) }
}

fn drive(link: &mut Link<'_>) -> Option<()> {
    let begun = link.now;
    let mut round = 0;
    let mut wrong_speeds = 0;
    while link.now < begun + DRIVE {
        let reply = link.request(AHEAD, millis(60))?;
        if let Some(Reply::Motors(Motors {
            right_rpm,
            left_rpm,
            soc,
        })) = reply
        {
            let slow = link.now > begun + millis(800) && right_rpm.min(left_rpm) < 250;
            wrong_speeds = if slow { wrong_speeds + 1 } else { 0 };
            if soc < 100 || wrong_speeds > 5 {
                return Some(());
            }
        }
        if round % 4 == 3
            && let Some(Reply::SystemInfo(info)) = link.request(Request::SystemInfo, millis(40))?
            && (info.sys_status != 0 || info.power_status & 1 == 0)
        {
            return Some(());
        }
        if link.now.since(link.heard) > millis(1500) {
            return Some(());
        }
        round += 1;
    }
    Some(())
}

/// Stops, makes sure of it, and leaves.
fn halt(link: &mut Link<'_>) -> Option<()> {
    let stands = |reply: &Reply| {
        matches!(reply, Reply::Motors(motors)
            if motors.right_rpm.abs() < 10 && motors.left_rpm.abs() < 10)
    };
    link.insist(STOP, Duration::from_secs(3), stands)?;
    link.insist(ALL_OFF, Duration::from_secs(1), |_| true)?;
    link.client.ask(Ask::Close(0)).map(drop)
}
