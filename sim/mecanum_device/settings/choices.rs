//! Settings of the firmware that are one of a few words.

use rigsim_settings::words;

words! {
    /// Order of the bytes in a field.
    pub enum ByteOrder {
        /// The least significant first.
        Little = "little",
        /// The most significant first.
        Big = "big",
    }

    /// Answer to a valid packet or line.
    pub enum Acknowledge {
        /// Nothing.
        Nothing = "nothing",
        /// A status packet, or on the ROS link a report line, at once.
        Status = "status",
    }

    /// Meaning of a status packet's sequence number.
    pub enum StatusSeq {
        /// It counts the status packets.
        Count = "count",
        /// That of the client's last packet.
        Echo = "echo",
    }

    /// Links whose motions count while the ROS link is configured.
    pub enum OrdersWithRos {
        /// Those of both links; the last order counts.
        BothLinks = "both-links",
        /// Those of the ROS link; those of the main link are ignored.
        RosOnly = "ros-only",
    }

    /// Motions that a preempting one discards.
    pub enum Preempt {
        /// The motion that runs and those that wait.
        All = "all",
        /// The motion that runs; those that wait follow the new one.
        Running = "running",
    }

    /// Meaning of a motion without distance.
    pub enum ZeroDistance {
        /// It ends at once.
        End = "end",
        /// It runs until another preempts it.
        Endless = "endless",
    }

    /// Meaning of a motion without speed.
    pub enum ZeroSpeed {
        /// It ends at once.
        End = "end",
        /// It stands until another preempts it.
        Wait = "wait",
    }

    /// Meaning of a speed beyond its range.
    pub enum OverSpeed {
        /// The end of the range.
        Clamp = "clamp",
        /// As good as any; the speed voltage has its own end.
        Obey = "obey",
        /// Its motion is ignored.
        Ignore = "ignore",
    }

    /// Direction in which a positive speed turns the car.
    pub enum PositiveTurn {
        /// To the right, clockwise.
        Right = "right",
        /// To the left, as `ori` counts.
        Left = "left",
    }

    /// Direction in which a positive speed strafes.
    pub enum PositiveStrafe {
        /// To the left.
        Left = "left",
        /// To the right.
        Right = "right",
    }

    /// Driver when the board starts.
    pub enum StartMode {
        /// The board.
        Board = "board",
        /// The remote control.
        Remote = "remote",
    }

    /// Fate of motions when the control mode changes.
    pub enum ModeChange {
        /// They are discarded.
        Discard = "discard",
        /// They stand still while the remote control drives, and go on after it.
        Keep = "keep",
    }

    /// State of BK while no wheel is driven.
    pub enum IdleWheels {
        /// It holds the wheels.
        Hold = "hold",
        /// It releases them.
        Release = "release",
    }

    /// Meaning of the letters Y and Z on the ROS link; the article's table and its picture differ.
    pub enum AsciiLetters {
        /// Y+ strafes left, Z+ turns right.
        Table = "table",
        /// Y+ turns right, Z+ strafes left.
        Picture = "picture",
    }

    /// In which axes the status packet gives the velocity.
    pub enum VelocityFrame {
        /// In those of the frame in which it gives the position.
        Odometry = "odometry",
        /// In the car's: ahead and to the left.
        Body = "body",
    }

    /// Time during which the status packet calls a side's motors running.
    pub enum MotorState {
        /// While the firmware drives one of them.
        Driven = "driven",
        /// While pulses come from one of them.
        Turning = "turning",
    }

    /// Distance that the mileage counts.
    pub enum Mileage {
        /// Turning of the driven wheels, as the distance of a motion does; turning on the spot
        /// counts too.
        Wheels = "wheels",
        /// Way of the middle of the car.
        Path = "path",
    }

    /// The sign of a reported speed.
    pub enum AsciiSpeedSign {
        /// Negative while a motion goes its negative way.
        Motion = "motion",
        /// It has none.
        None = "none",
    }

    /// Distance that the reported mileage counts.
    pub enum AsciiMileage {
        /// All that was driven, either way.
        Total = "total",
        /// Positive motions up, negative ones down.
        Signed = "signed",
        /// Distance of the last motion.
        Motion = "motion",
    }

    /// Reading of a value beyond its field.
    pub enum Overflow {
        /// Its low bits.
        Wrap = "wrap",
        /// The end of the field's range.
        Saturate = "saturate",
    }

    /// Range of a heading.
    pub enum HeadingRange {
        /// Full turns add up.
        FullTurns = "full-turns",
        /// Above −180° and up to 180°.
        HalfTurn = "half-turn",
    }

    /// Meaning of the bits of `magn`.
    pub enum MagnBits {
        /// One for each channel, bit 0 leftmost.
        FromLeft = "from-left",
        /// One for each channel, bit 0 rightmost.
        FromRight = "from-right",
        /// 1 when any channel is over a strip, and else 0.
        Any = "any",
    }

    /// Reading of an ultrasonic sensor without an echo.
    pub enum NoEcho {
        /// Its longest distance.
        Farthest = "farthest",
        /// 0.
        Zero = "zero",
        /// 65535 mm.
        Max = "max",
    }
}
