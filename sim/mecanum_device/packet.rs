//! The packets of the main link as types, bytes and words (article, control by the on-board Android).
//!
//! The article does not state the byte order. Little-endian is our assumption, and what the types
//! here read and write; [`Packet::reorder`] makes the other of it.

use std::fmt;

use super::codec::Packet;
use super::settings::ByteOrder;

/// Packet of a client to the board. Fields are as on the wire; what is out of range is the
/// device's business.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Request {
    /// Type 0, control instruction, 控制指令.
    Motion {
        /// Sequence number.
        seq: u8,
        /// Preempt, 是否抢占: 1 discards what runs and waits, 0 appends.
        is_reset: u8,
        /// 0 forward/backward, 1 rotate, 2 strafe, 3 left-front/right-rear, 4
        /// right-front/left-rear.
        moving_idx: u8,
        /// Distance, 1/10 revolution.
        s: u16,
        /// Speed, 1/10 r/min, −500 to 500.
        v: i16,
    },
    /// Type 1, define the present coordinates, 定义当前坐标.
    SetPose {
        /// Sequence number.
        seq: u8,
        /// 1/10 revolution.
        axis_x: i16,
        /// 1/10 revolution.
        axis_y: i16,
        /// 1/10°, counter-clockwise.
        ori: i16,
    },
    /// Type 2, switch control mode, 切换控制模式.
    ControlMode {
        /// Sequence number.
        seq: u8,
        /// 0 board, 1 remote control.
        mode: u8,
    },
}

impl Request {
    /// The name of the packet, as events and documentation use it.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Motion { .. } => "motion",
            Self::SetPose { .. } => "set_pose",
            Self::ControlMode { .. } => "control_mode",
        }
    }

    /// Its sequence number.
    #[must_use]
    pub fn seq(&self) -> u8 {
        match *self {
            Self::Motion { seq, .. }
            | Self::SetPose { seq, .. }
            | Self::ControlMode { seq, .. } => seq,
        }
    }

    /// The packet on the wire in this byte order.
    #[must_use]
    pub fn encode_in(&self, order: ByteOrder) -> Vec<u8> {
        let mut bytes = self.encode();
        Self::reorder(&mut bytes, order);
        bytes
    }

    /// The packet on the wire, little-endian.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        match *self {
            Self::Motion {
                seq,
                is_reset,
                moving_idx,
                s,
                v,
            } => {
                let ([s0, s1], [v0, v1]) = (s.to_le_bytes(), v.to_le_bytes());
                vec![0, 9, seq, is_reset, moving_idx, s0, s1, v0, v1]
            }
            Self::SetPose {
                seq,
                axis_x,
                axis_y,
                ori,
            } => {
                let mut bytes = vec![1, 9, seq];
                bytes.extend([axis_x, axis_y, ori].map(i16::to_le_bytes).concat());
                bytes
            }
            Self::ControlMode { seq, mode } => vec![2, 4, seq, mode],
        }
    }
}

impl Packet for Request {
    const HEADERS: &'static [[u8; 2]] = &[[0, 9], [1, 9], [2, 4]];

    fn widths(kind: u8) -> &'static [usize] {
        match kind {
            0 => &[1, 1, 2, 2],
            1 => &[2, 2, 2],
            _ => &[1],
        }
    }

    fn parse(bytes: &[u8]) -> Option<Self> {
        Some(match *bytes {
            [0, 9, seq, is_reset, moving_idx, s0, s1, v0, v1] => Self::Motion {
                seq,
                is_reset,
                moving_idx,
                s: u16::from_le_bytes([s0, s1]),
                v: i16::from_le_bytes([v0, v1]),
            },
            [1, 9, seq, x0, x1, y0, y1, o0, o1] => Self::SetPose {
                seq,
                axis_x: i16::from_le_bytes([x0, x1]),
                axis_y: i16::from_le_bytes([y0, y1]),
                ori: i16::from_le_bytes([o0, o1]),
            },
            [2, 4, seq, mode] => Self::ControlMode { seq, mode },
            _ => return None,
        })
    }
}

/// Packet of the board: type 0, state, 状态采集.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Status {
    /// Counts these packets, wrapping.
    pub seq: u8,
    /// 1/10 r/min.
    pub v_x: i16,
    /// 1/10 r/min.
    pub v_y: i16,
    /// 1/10 revolution.
    pub axis_x: i16,
    /// 1/10 revolution.
    pub axis_y: i16,
    /// 1/10°, counter-clockwise.
    pub ori: i16,
    /// Number of the RFID tag, 0 without one.
    pub rfid: u32,
    /// One bit for each channel of the magnetic bar, bit 0 leftmost, 1 hit.
    pub magn: u16,
    /// Infrared: 1 when something is ahead.
    pub infra: u8,
    /// Ultrasonic distances in front, left to right, mm.
    pub ut_f: [u16; 4],
    /// Ultrasonic distances in the rear, left to right, mm.
    pub ut_b: [u16; 4],
    /// Bit 0 left motors, bit 1 right motors, 1 running.
    pub moto_state: u8,
    /// Total mileage, mm.
    pub mile: u16,
}

impl Status {
    /// Bytes of the packet.
    pub const LENGTH: usize = 39;

    /// The packet on the wire in this byte order.
    #[must_use]
    pub fn encode_in(&self, order: ByteOrder) -> Vec<u8> {
        let mut bytes = self.encode();
        Self::reorder(&mut bytes, order);
        bytes
    }

    /// The packet on the wire, little-endian.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(Self::LENGTH);
        bytes.extend([0, 39, self.seq]);
        let pose = [self.v_x, self.v_y, self.axis_x, self.axis_y, self.ori];
        bytes.extend(pose.map(i16::to_le_bytes).concat());
        bytes.extend(self.rfid.to_le_bytes());
        bytes.extend(self.magn.to_le_bytes());
        bytes.push(self.infra);
        bytes.extend(self.ut_f.map(u16::to_le_bytes).concat());
        bytes.extend(self.ut_b.map(u16::to_le_bytes).concat());
        bytes.push(self.moto_state);
        bytes.extend(self.mile.to_le_bytes());
        bytes
    }
}

impl Packet for Status {
    const HEADERS: &'static [[u8; 2]] = &[[0, 39]];

    fn widths(_kind: u8) -> &'static [usize] {
        &[2, 2, 2, 2, 2, 4, 2, 1, 2, 2, 2, 2, 2, 2, 2, 2, 1, 2]
    }

    fn parse(bytes: &[u8]) -> Option<Self> {
        let bytes: &[u8; Self::LENGTH] = bytes.try_into().ok()?;
        let [0, 39, seq, ..] = *bytes else {
            return None;
        };
        let half = |at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
        let signed = |at| half(at).cast_signed();
        Some(Self {
            seq,
            v_x: signed(3),
            v_y: signed(5),
            axis_x: signed(7),
            axis_y: signed(9),
            ori: signed(11),
            rfid: u32::from_le_bytes([bytes[13], bytes[14], bytes[15], bytes[16]]),
            magn: half(17),
            infra: bytes[19],
            ut_f: std::array::from_fn(|i| half(20 + 2 * i)),
            ut_b: std::array::from_fn(|i| half(28 + 2 * i)),
            moto_state: bytes[36],
            mile: half(37),
        })
    }
}

impl fmt::Display for Request {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())?;
        match self {
            Self::Motion {
                seq,
                is_reset,
                moving_idx,
                s,
                v,
            } => write!(
                f,
                " #{seq} is_reset {is_reset} moving_idx {moving_idx} s {s} v {v}"
            ),
            Self::SetPose {
                seq,
                axis_x,
                axis_y,
                ori,
            } => write!(f, " #{seq} x {axis_x} y {axis_y} ori {ori}"),
            Self::ControlMode { seq, mode } => write!(f, " #{seq} {mode}"),
        }
    }
}

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "status #{} v {} {} at {} {} ori {} rfid {} magn 0x{:04X} infra {} front {:?} mm \
             rear {:?} mm motors {} mile {} mm",
            self.seq,
            self.v_x,
            self.v_y,
            self.axis_x,
            self.axis_y,
            self.ori,
            self.rfid,
            self.magn,
            self.infra,
            self.ut_f,
            self.ut_b,
            self.moto_state,
            self.mile,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn requests_byte_by_byte() {
        let motion = Request::Motion {
            seq: 7,
            is_reset: 1,
            moving_idx: 2,
            s: 0x0102,
            v: -500,
        };
        assert_eq!(motion.encode(), [0, 9, 7, 1, 2, 0x02, 0x01, 0x0C, 0xFE]);
        let pose = Request::SetPose {
            seq: 255,
            axis_x: 10,
            axis_y: -10,
            ori: 900,
        };
        assert_eq!(pose.encode(), [1, 9, 255, 10, 0, 0xF6, 0xFF, 0x84, 0x03]);
        let mode = Request::ControlMode { seq: 1, mode: 1 };
        assert_eq!(mode.encode(), [2, 4, 1, 1]);
        for request in [motion, pose, mode] {
            assert_eq!(Request::parse(&request.encode()), Some(request));
        }
    }

    #[test]
    fn the_status_packet_byte_by_byte() {
        let status = Status {
            seq: 3,
            v_x: 1,
            v_y: -1,
            axis_x: 0x0203,
            axis_y: -2,
            ori: -900,
            rfid: 0x0403_0201,
            magn: 0x8001,
            infra: 1,
            ut_f: [1, 2, 3, 4],
            ut_b: [4500, 20, 256, 65_535],
            moto_state: 3,
            mile: 0x1234,
        };
        #[rustfmt::skip]
        let bytes = [
            0, 39, 3,
            1, 0, 0xFF, 0xFF,
            0x03, 0x02, 0xFE, 0xFF, 0x7C, 0xFC,
            1, 2, 3, 4,
            0x01, 0x80,
            1,
            1, 0, 2, 0, 3, 0, 4, 0,
            0x94, 0x11, 20, 0, 0, 1, 0xFF, 0xFF,
            3,
            0x34, 0x12,
        ];
        assert_eq!(bytes.len(), Status::LENGTH);
        assert_eq!(status.encode(), bytes);
        assert_eq!(Status::parse(&bytes), Some(status));
    }

    #[test]
    fn big_endian_turns_every_field_and_no_other_byte() {
        let motion = Request::Motion {
            seq: 7,
            is_reset: 1,
            moving_idx: 2,
            s: 0x0102,
            v: -500,
        };
        let big = motion.encode_in(ByteOrder::Big);
        assert_eq!(big, [0, 9, 7, 1, 2, 0x01, 0x02, 0xFE, 0x0C]);
        let pose = Request::SetPose {
            seq: 255,
            axis_x: 10,
            axis_y: -10,
            ori: 900,
        };
        let big = pose.encode_in(ByteOrder::Big);
        assert_eq!(big, [1, 9, 255, 0, 10, 0xFF, 0xF6, 0x03, 0x84]);
        let mode = Request::ControlMode { seq: 1, mode: 1 };
        assert_eq!(mode.encode_in(ByteOrder::Big), [2, 4, 1, 1]);
        let status = Status {
            seq: 3,
            v_x: 1,
            v_y: 2,
            axis_x: 3,
            axis_y: 4,
            ori: 5,
            rfid: 0x0102_0304,
            magn: 6,
            infra: 1,
            ut_f: [7, 8, 9, 10],
            ut_b: [11, 12, 13, 0x1234],
            moto_state: 3,
            mile: 0x5678,
        };
        #[rustfmt::skip]
        let bytes = [
            0, 39, 3,
            0, 1, 0, 2,
            0, 3, 0, 4, 0, 5,
            1, 2, 3, 4,
            0, 6,
            1,
            0, 7, 0, 8, 0, 9, 0, 10,
            0, 11, 0, 12, 0, 13, 0x12, 0x34,
            3,
            0x56, 0x78,
        ];
        assert_eq!(status.encode_in(ByteOrder::Big), bytes);
    }

    proptest! {
        #[test]
        fn turned_twice_it_is_as_it_was(status: bool, kind in 0u8..3, order: bool, mut bytes in prop::collection::vec(any::<u8>(), 0..50)) {
            let order = if order { ByteOrder::Big } else { ByteOrder::Little };
            if let Some(first) = bytes.first_mut() {
                *first = kind;
            }
            let reorder = if status { Status::reorder } else { Request::reorder };
            let mut turned = bytes.clone();
            reorder(&mut turned, order);
            reorder(&mut turned, order);
            prop_assert_eq!(turned, bytes);
        }

        #[test]
        fn what_parses_encodes_to_the_same_bytes(mut bytes in prop::collection::vec(any::<u8>(), 39)) {
            (bytes[0], bytes[1]) = (0, 39);
            prop_assert_eq!(Status::parse(&bytes).unwrap().encode(), bytes.clone());
            for [kind, length] in Request::HEADERS {
                let mut request = bytes[..usize::from(*length)].to_vec();
                (request[0], request[1]) = (*kind, *length);
                prop_assert_eq!(Request::parse(&request).unwrap().encode(), request);
            }
        }

        #[test]
        fn only_headers_with_their_length_parse(bytes in prop::collection::vec(0u8..12, 0..12)) {
            let header = bytes.get(..2).is_some_and(|head| {
                Request::HEADERS.iter().any(|known| known == head)
                    && usize::from(head[1]) == bytes.len()
            });
            prop_assert_eq!(Request::parse(&bytes).is_some(), header);
        }
    }
}
