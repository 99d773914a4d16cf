//! Faults of the protocol: whole frames, packets and lines of the device.

/// Hands these faults on, behind those that come before them, to the next in the row.
macro_rules! protocol {
    ({ $next:ident $($later:ident)* } $($before:tt)*) => { $next! { { $($later)* } $($before)*

    /// Faults of the protocol: whole frames, packets and lines of the device.
    Protocol ProtocolFault {

    /// Replies have a wrong CRC.
    BadCrc = "bad-crc", false,
    sees "A reply that it must throw away.",
    counts "A reply was spoilt.",
    {}
    only "Only replies to this command; to all unless given."
    chance "For each reply; 1 unless given." "defaults::always"
    most "At most so many."
    /// Replies carry another command byte, packets another type, lines another letter; a CRC fits.
    WrongCommand = "wrong-command", true,
    sees "A well-formed answer to something that it did not ask.",
    counts "A frame was changed.",
    {
        /// The byte to put there; the right one with its lowest bit flipped unless given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        with: Option<u8>,
    }
    only "Only replies to this command, or packets of this type; all unless given."
    chance "For each frame; 1 unless given." "defaults::always"
    most "At most so many."
    on "On which link; main unless given."
    /// Replies are too short or too long.
    WrongLength = "wrong-length", true,
    sees "A well-formed frame with parameters missing or too many; or one whose length field lies.",
    counts "A frame was changed.",
    {
        /// By how many bytes; −1 unless given.
        #[serde(default = "defaults::one_less")]
        by: i8,
        /// Place of the error: `parameters` are missing, or the `field` lies; parameters unless given.
        #[serde(default)]
        what: WrongLength,
    }
    only "Only replies to this command, or packets of this type; all unless given."
    chance "For each frame; 1 unless given." "defaults::always"
    most "At most so many."
    on "On which link; main unless given."
    /// Only the first half of a reply is sent.
    TornReply = "torn-reply", true,
    sees "A frame that never ends; the next one seems to be its rest.",
    counts "A frame was cut.",
    {}
    only "Only replies to this command, or packets of this type; all unless given."
    chance "For each frame; 1 unless given." "defaults::always"
    most "At most so many."
    on "On which link; main unless given."
    /// Replies are sent late. A later one may overtake them.
    LateReply = "late-reply", true,
    sees "No reply in time, and one that it no longer waits for.",
    counts "A frame was put off.",
    {
        /// By how much; 500 ms unless given.
        #[serde(default = "defaults::late")]
        by: Span,
    }
    only "Only replies to this command, or packets of this type; all unless given."
    chance "For each frame; 1 unless given." "defaults::always"
    most "At most so many."
    on "On which link; main unless given."
    /// Replies are sent twice.
    ReplyTwice = "reply-twice", true,
    sees "The same frame again at once, which it may take for the answer to its next request.",
    counts "A frame was sent twice.",
    {}
    only "Only replies to this command, or packets of this type; all unless given."
    chance "For each frame; 1 unless given." "defaults::always"
    most "At most so many."
    on "On which link; main unless given."
    /// Replies are not sent.
    MissingReply = "missing-reply", true,
    sees "No reply, although the command took effect.",
    counts "A frame was not sent.",
    {}
    only "Only replies to this command, or packets of this type; all unless given."
    chance "For each frame; 1 unless given." "defaults::always"
    most "At most so many."
    on "On which link; main unless given."
    /// The frame before is sent again in place of the right one.
    PreviousReply = "previous-reply", true,
    sees "An old answer: other values than asked for, or the answer to another command.",
    counts "An old frame was sent. The first one after the start has none before it.",
    {}
    only "Only in place of replies to this command, or packets of this type; all unless given."
    chance "For each frame; 1 unless given." "defaults::always"
    most "At most so many."
    on "On which link; main unless given."
    /// The device sends something that nobody asked for.
    UnsolicitedFrame = "unsolicited-frame", true,
    sees "A frame without a request: a heartbeat reply, a status packet of zeros, or a line.",
    counts "The frame was sent.",
    {
        /// Bytes of it; unless given a well-formed frame of the device.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        bytes: Option<HexBytes>,
        /// Again after this; once unless given. At least 1 ms.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        every: Option<Span>,
    }
    most "At most so many."
    on "On which link; main unless given."

    } } };
}
