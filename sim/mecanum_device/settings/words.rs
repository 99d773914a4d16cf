//! The words that settings of the firmware may have.

use sim_settings::choices;

choices! {
    /// Order of the bytes in a field.
    pub enum ByteOrder {
        /// The least significant first.
        Little = "little",
        /// The most significant first.
        Big = "big",
    }
}

choices! {
    /// What tells the beginning of a packet.
    pub enum Framing {
        /// A known type, and after it the length that this type has; any other byte is skipped by itself.
        TypeAndLength = "type-and-length",
        /// Nothing: the second byte is the length, and a packet that is not known is skipped as a whole.
        Length = "length",
    }
}

choices! {
    /// What becomes of a packet that was begun and not finished in time.
    pub enum PartialPacket {
        /// The search for a packet goes on at its second byte.
        Rescan = "rescan",
        /// All its bytes are dropped.
        Drop = "drop",
    }
}

choices! {
    /// What a valid packet or line is answered by.
    pub enum Acknowledge {
        /// Nothing.
        Nothing = "nothing",
        /// A status packet, or on the ROS link a report line, at once.
        Status = "status",
    }
}

choices! {
    /// What the sequence number of a status packet is.
    pub enum StatusSeq {
        /// It counts the status packets.
        Count = "count",
        /// That of the client's last packet.
        Echo = "echo",
    }
}

choices! {
    /// Whose motions count while the ROS link is configured.
    pub enum OrdersWithRos {
        /// Those of both links; the last order counts.
        BothLinks = "both-links",
        /// Those of the ROS link; those of the main link are ignored.
        RosOnly = "ros-only",
    }
}

choices! {
    /// What a motion that preempts discards.
    pub enum Preempt {
        /// The motion that runs and those that wait.
        All = "all",
        /// The motion that runs; those that wait follow the new one.
        Running = "running",
    }
}

choices! {
    /// When the wheels of a motion stop.
    pub enum MotionEnd {
        /// Each by itself, when it has turned far enough.
        EachWheel = "each-wheel",
        /// All at once, when they have turned far enough on average.
        Mean = "mean",
    }
}

choices! {
    /// What a motion without distance is.
    pub enum ZeroDistance {
        /// It ends at once.
        End = "end",
        /// It runs until another preempts it.
        Endless = "endless",
    }
}

choices! {
    /// What a motion without speed is.
    pub enum ZeroSpeed {
        /// It ends at once.
        End = "end",
        /// It stands until another preempts it.
        Wait = "wait",
    }
}

choices! {
    /// What a speed beyond its range is.
    pub enum OverSpeed {
        /// The end of the range.
        Clamp = "clamp",
        /// As good as any; the speed voltage has its own end.
        Obey = "obey",
        /// Its motion is ignored.
        Ignore = "ignore",
    }
}

choices! {
    /// Which way a positive speed turns the car.
    pub enum PositiveTurn {
        /// To the right, clockwise.
        Right = "right",
        /// To the left, as `ori` counts.
        Left = "left",
    }
}

choices! {
    /// Which way a positive speed strafes.
    pub enum PositiveStrafe {
        /// To the left.
        Left = "left",
        /// To the right.
        Right = "right",
    }
}

choices! {
    /// Who drives when the board starts.
    pub enum StartMode {
        /// The board.
        Board = "board",
        /// The remote control.
        Remote = "remote",
    }
}

choices! {
    /// What becomes of motions when the control mode changes.
    pub enum ModeChange {
        /// They are discarded.
        Discard = "discard",
        /// They stand still while the remote control drives, and go on after it.
        Keep = "keep",
    }
}

choices! {
    /// What BK does while no wheel is driven.
    pub enum IdleWheels {
        /// It holds the wheels.
        Hold = "hold",
        /// It lets them go.
        Release = "release",
    }
}

choices! {
    /// How the firmware knows which way a wheel has turned.
    pub enum PulseDirection {
        /// It takes pulses for those of the direction in which it last drove the wheel.
        Driven = "driven",
        /// The motors tell, and their counters count down when a wheel turns back.
        Counted = "counted",
    }
}

choices! {
    /// What the letters Y and Z of the ROS link mean; the article's table and its picture differ.
    pub enum AsciiLetters {
        /// Y+ strafes left, Z+ turns right.
        Table = "table",
        /// Y+ turns right, Z+ strafes left.
        Picture = "picture",
    }
}

choices! {
    /// In which axes the status packet gives the velocity.
    pub enum VelocityFrame {
        /// In those of the frame in which it gives the position.
        Odometry = "odometry",
        /// In the car's: ahead and to the left.
        Body = "body",
    }
}

choices! {
    /// When the status packet calls a side's motors running.
    pub enum MotorState {
        /// While the firmware drives one of them.
        Driven = "driven",
        /// While pulses come from one of them.
        Turning = "turning",
    }
}

choices! {
    /// What the mileage counts.
    pub enum Mileage {
        /// How far the driven wheels turn, as the distance of a motion does; turning on the spot
        /// counts too.
        Wheels = "wheels",
        /// How far the middle of the car goes.
        Path = "path",
    }
}

choices! {
    /// How a number on the ROS link is read.
    pub enum AsciiNumbers {
        /// Digits, perhaps after a minus, and nothing else.
        Strict = "strict",
        /// As C's `atoi` does: perhaps a sign, then digits up to whatever else comes; without any it is 0.
        Atoi = "atoi",
    }
}

choices! {
    /// Where spaces and carriage returns are skipped in a line.
    pub enum AsciiSpaces {
        /// Anywhere.
        Anywhere = "anywhere",
        /// Before its end.
        Trailing = "trailing",
    }
}

choices! {
    /// What a number beyond its range is.
    pub enum AsciiOutOfRange {
        /// Its line is ignored.
        Ignore = "ignore",
        /// The end of the range.
        Clamp = "clamp",
    }
}

choices! {
    /// The sign of a reported speed.
    pub enum AsciiSpeedSign {
        /// Negative while a motion goes its negative way.
        Motion = "motion",
        /// It has none.
        None = "none",
    }
}

choices! {
    /// What the reported mileage counts.
    pub enum AsciiMileage {
        /// All that was driven, either way.
        Total = "total",
        /// Positive motions up, negative ones down.
        Signed = "signed",
        /// What the last motion has driven.
        Motion = "motion",
    }
}

choices! {
    /// What a value beyond its field reads.
    pub enum Overflow {
        /// Its low bits.
        Wrap = "wrap",
        /// The end of the field's range.
        Saturate = "saturate",
    }
}

choices! {
    /// How far a heading goes.
    pub enum HeadingRange {
        /// Full turns add up.
        FullTurns = "full-turns",
        /// Above −180° and up to 180°.
        HalfTurn = "half-turn",
    }
}

choices! {
    /// What the bits of `magn` are.
    pub enum MagnBits {
        /// One for each channel, bit 0 leftmost.
        FromLeft = "from-left",
        /// One for each channel, bit 0 rightmost.
        FromRight = "from-right",
        /// 1 when any channel is over a strip, and else 0.
        Any = "any",
    }
}

choices! {
    /// What an ultrasonic sensor without an echo reads.
    pub enum NoEcho {
        /// Its longest distance.
        Farthest = "farthest",
        /// 0.
        Zero = "zero",
        /// 65535 mm.
        Max = "max",
    }
}
