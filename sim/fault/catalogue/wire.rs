//! Faults of the wire: bytes on their way.

/// Hands these faults on, behind those that come before them, to the next in the row.
macro_rules! wire {
    ({ $next:ident $($later:ident)* } $($before:tt)*) => { $next! { { $($later)* } $($before)*

    /// Faults of the wire: bytes on their way.
    Wire WireFault {

    /// Single bits change on the wire.
    BitFlips = "bit-flips", true,
    sees "Frames whose CRC is wrong, or packets with wrong values; its own requests get no answer.",
    counts "A bit was flipped.",
    {}
    chance "For each byte; 0.01 unless given." "defaults::rarely"
    most "At most so many."
    way "Which way; both unless given." "defaults::both"
    on "On which link; main unless given."
    /// Bytes are lost on the wire.
    DroppedBytes = "dropped-bytes", true,
    sees "Frames that are too short, so that the next one is taken for their end.",
    counts "A byte was lost.",
    {}
    chance "For each byte; 0.01 unless given." "defaults::rarely"
    most "At most so many."
    way "Which way; both unless given." "defaults::both"
    on "On which link; main unless given."
    /// Bytes arrive twice.
    DuplicatedBytes = "duplicated-bytes", true,
    sees "Frames with a byte too many.",
    counts "A byte was doubled.",
    {}
    chance "For each byte; 0.01 unless given." "defaults::rarely"
    most "At most so many."
    way "Which way; both unless given." "defaults::both"
    on "On which link; main unless given."
    /// Random bytes appear between the others.
    InsertedBytes = "inserted-bytes", true,
    sees "Frames with a foreign byte in or before them.",
    counts "A byte was inserted.",
    {}
    chance "Before each byte; 0.01 unless given." "defaults::rarely"
    most "At most so many."
    way "Which way; both unless given." "defaults::both"
    on "On which link; main unless given."
    /// Interference makes several bytes in a row random.
    Burst = "burst", true,
    sees "Runs of garbage inside frames and across them.",
    counts "A burst began.",
    {
        /// Bytes of a burst; 8 unless given.
        #[serde(default = "defaults::burst_length")]
        length: u16,
    }
    chance "That a burst begins, for each byte; 0.01 unless given." "defaults::rarely"
    most "At most so many bursts."
    way "Which way; both unless given." "defaults::both"
    on "On which link; main unless given."
    /// Bytes take longer, all by the same or by a random time. They never overtake one another.
    Delay = "delay", true,
    sees "Replies that come late; frames torn by pauses if there is jitter.",
    counts "A byte came late.",
    {
        /// By which every byte is late; 50 ms unless given.
        #[serde(default = "defaults::delay")]
        by: Span,
        /// Most of what a random further delay adds to each byte; none unless given.
        #[serde(default)]
        jitter: Span,
    }
    way "Which way; both unless given." "defaults::both"
    on "On which link; main unless given."
    /// Pauses tear what is sent in one piece.
    Fragmentation = "fragmentation", true,
    sees "A reply that comes in pieces over several reads.",
    counts "A pause was put between two bytes.",
    {
        /// Bytes of a piece; 3 unless given.
        #[serde(default = "defaults::piece")]
        size: u16,
        /// Pause after each; 5 ms unless given. The R150 gives an unfinished request up after 20 ms.
        #[serde(default = "defaults::pause")]
        pause: Span,
    }
    way "Which way; to-client unless given." "defaults::to_client"
    on "On which link; main unless given."
    /// Bytes stop, and all come at once when the stall ends, as with a busy USB adapter.
    Stall = "stall", true,
    sees "Silence, then everything at once, old replies first.",
    counts "A byte was held up.",
    {}
    way "Which way; both unless given." "defaults::both"
    on "On which link; main unless given."
    /// One wire of the cable is broken: nothing arrives that way.
    Mute = "mute", true,
    sees "No replies; to-device, a vehicle that does nothing and whose watchdog fires.",
    counts "A byte was lost.",
    {}
    way "Which way; to-client unless given." "defaults::to_client"
    on "On which link; main unless given."
    /// The device's serial port runs at a wrong speed.
    WrongBaud = "wrong-baud", true,
    sees "Garbage instead of replies, and no answer to what it sends.",
    counts "Something was sent at mismatched speeds.",
    {
        /// Bits per second of the device's end; 9600 unless given.
        #[serde(default = "defaults::wrong_baud")]
        baud: u32,
    }
    on "On which link; main unless given."
    /// Random bytes come out of an idle line.
    IdleNoise = "idle-noise", true,
    sees "Bytes between replies that belong to nothing.",
    counts "A byte came out of nothing.",
    {
        /// Mean time between two; 100 ms unless given, at least 1 ms.
        #[serde(default = "defaults::noise_every")]
        every: Span,
    }
    most "At most so many."
    way "Which way; to-client unless given." "defaults::to_client"
    on "On which link; main unless given."
    /// The cable is pulled, and plugged in again at the end.
    CablePulled = "cable-pulled", true,
    sees "Its port hangs up, as a pulled USB adapter does, and can be opened again afterwards.",
    counts "A client had the port open, or something was sent.",
    {}
    on "Of which link; main unless given."

    } } };
}
