//! The packets of the main link, each declared once (article, control by the on-board Android).
//!
//! The article does not state the byte order. Little-endian is our assumption, and what the types
//! here read and write; [`codec`] makes the other of it.

use super::codec;
use super::settings::ByteOrder;

crate::messages! {
    /// Packet of a client to the board. Fields are as on the wire; what is out of range is the
    /// device's business.
    pub enum Request, Client, link 0 {
        /// Orders a motion, 控制指令.
        Motion = 0 "motion", motion true {
            /// Sequence number; default 0.
            #[serde(default)]
            seq: u8;
            /// Preempt, 是否抢占: 1 discards the running and waiting motions, 0 appends; default 1.
            #[serde(default = "one")]
            is_reset: u8;
            /// Course: 0 forward, 1 rotate, 2 strafe, 3 left-front, 4 right-front.
            moving_idx: u8, values &["forward", "rotate", "strafe", "left-front", "right-front"];
            /// Distance.
            s: u16, unit "1/10 rev", named &["client.distance"];
            /// Speed, −500 to 500.
            v: i16, unit "1/10 r/min", named &["client.speed"];
        };
        /// Says where the car is, 定义当前坐标.
        SetPose = 1 "set_pose" {
            /// Sequence number; default 0.
            #[serde(default)]
            seq: u8;
            /// Position ahead.
            axis_x: i16, unit "1/10 rev";
            /// Position to the left.
            axis_y: i16, unit "1/10 rev";
            /// Heading, counter-clockwise.
            ori: i16, unit "1/10 deg";
        };
        /// Says who drives, 切换控制模式.
        ControlMode = 2 "control_mode" {
            /// Sequence number; default 0.
            #[serde(default)]
            seq: u8;
            /// 0 board, 1 remote control.
            mode: u8, values &["board", "remote"],
                flags &[("", ""), ("client.asked_remote", "the remote control was asked to drive")];
        };
    }
}

crate::messages! {
    /// State of the car, 状态采集.
    pub struct Status = 0 "status", Device, link 0, age "reported.age_s" {
        /// Counts these packets, wrapping.
        seq: u8;
        /// Speed along x.
        v_x: i16, unit "1/10 r/min", named &["reported.v_x"];
        /// Speed along y.
        v_y: i16, unit "1/10 r/min", named &["reported.v_y"];
        /// Position along x.
        axis_x: i16, unit "1/10 rev", named &["reported.axis_x"];
        /// Position along y.
        axis_y: i16, unit "1/10 rev", named &["reported.axis_y"];
        /// Heading, counter-clockwise.
        ori: i16, unit "deg", per 10, named &["reported.ori_deg"];
        /// Number of the RFID tag, 0 without one.
        rfid: u32, named &["reported.rfid"];
        /// One bit for each channel of the magnetic bar, bit 0 leftmost, 1 hit.
        magn: u16, hex true, named &["reported.magn"];
        /// Infrared: 1 when something is ahead.
        infra: u8, named &["reported.infra"];
        /// Ultrasonic distances in front, left to right; its name has the nearest.
        ut_f: [u16; 4], unit "mm", named &["reported.front_mm"];
        /// Ultrasonic distances in the rear, left to right; its name has the nearest.
        ut_b: [u16; 4], unit "mm", named &["reported.rear_mm"];
        /// Motors that run: bit 0 left, bit 1 right.
        moto_state: u8, bits &["left", "right"], named &["reported.moto_state"];
        /// Total mileage.
        mile: u16, unit "mm", named &["reported.mile_mm"];
    }
}

fn one() -> u8 {
    1
}

impl Request {
    /// Its sequence number.
    #[must_use]
    pub fn seq(&self) -> u8 {
        let (Self::Motion { seq, .. } | Self::SetPose { seq, .. } | Self::ControlMode { seq, .. }) =
            *self;
        seq
    }
}

macro_rules! packets {
    ($($packet:ident)*) => { $(
        impl $packet {
            /// The packet on the wire, little-endian.
            #[must_use]
            pub fn encode(&self) -> Vec<u8> {
                codec::encode(self)
            }

            /// The packet on the wire in this byte order.
            #[must_use]
            pub fn encode_in(&self, order: ByteOrder) -> Vec<u8> {
                let mut bytes = self.encode();
                codec::reorder::<Self>(&mut bytes, order);
                bytes
            }
        }
    )* };
}

packets! { Request Status }

#[cfg(test)]
mod tests;
