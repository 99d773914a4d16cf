//! Faults of what the car looks at the world with.

/// Hands these faults on, behind those that come before them, to the next in the row.
macro_rules! sensor {
    ({ $next:ident $($later:ident)* } $($before:tt)*) => { $next! { { $($later)* } $($before)*

    /// Faults of what the car looks at the world with.
    Sensor SensorFault {

    /// Ultrasonic sensors hear nothing.
    UltrasonicMissing = "ultrasonic-missing", false,
    sees "4500 mm, whatever is there.",
    counts "An echo was not heard.",
    {
        /// Sensors; all unless given.
        #[serde(default)]
        sensor: EchoSensor,
    }
    /// Ultrasonic sensors repeat what they read at the start.
    UltrasonicStuck = "ultrasonic-stuck", false,
    sees "A distance that does not change.",
    counts "The true distance was another.",
    {
        /// Sensors; all unless given.
        #[serde(default)]
        sensor: EchoSensor,
    }
    /// Ultrasonic sensors hear an echo that is none.
    UltrasonicGhost = "ultrasonic-ghost", false,
    sees "An obstacle where there is none.",
    counts "The ghost was nearer than anything real.",
    {
        /// Sensors; all unless given.
        #[serde(default)]
        sensor: EchoSensor,
        /// Distance of the echo; 0.3 m unless given.
        #[serde(default = "defaults::ghost")]
        distance: Length,
    }
    /// The reader misreads tags.
    TagMisread = "tag-misread", false,
    sees "A wrong number in `rfid`, or none.",
    counts "A tag was misread.",
    {
        /// Number that any tag is read as; 0, which is no tag, unless given.
        #[serde(default)]
        reads_as: u32,
    }
    /// The magnetic bar does not feel the strip.
    StripLost = "strip-lost", false,
    sees "`magn` 0 over a strip.",
    counts "A strip was not felt.",
    {}
    /// The infrared sensor always says the same.
    InfraredStuck = "infrared-stuck", false,
    sees "`infra` that does not change.",
    counts "The truth was another.",
    {
        /// Says that it sees something, and not nothing; yes unless given.
        #[serde(default = "defaults::yes")]
        sees: bool,
    }

    } } };
}
