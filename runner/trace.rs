//! Traces: a run as lines of JSON, and the run again from them.
//!
//! Each line is an object whose `kind` says what it is. Times `t` are nanoseconds since the start
//! in simulated time; bytes are hexadecimal. A line is written when what it describes is over, so
//! lines of bytes may stand a little behind others of the same time.
//!
//! | kind | what |
//! |---|---|
//! | `header` | the first line: everything that a second run needs |
//! | `time` | whose time a real client has: `lockstep` or `real` |
//! | `attach`, `detach` | a client opened or closed a port |
//! | `line` | a client set its end of a line |
//! | `late` | the simulator was late: what it reads next may be up to `by` ns old; simulated time stood still for `stood` ns |
//! | `in` | a client sent bytes, all at `t` |
//! | `host` | the scripted client sent bytes |
//! | `out` | bytes of the device arrived at the client: the first at `t`, each further one `dt` later |
//! | `event` | something happened, traffic aside |
//! | `pose` | where a device really was, every 100 ms while it moves |
//! | `add`, `clear` | a step was added while the run went on, or ended before its time |
//! | `publish` | a client published numbers, or a line that is not used |
//! | `pace` | time was made to stand still, to go on, or to pass at another speed |
//! | `step` | a step of the file has begun, or is done |
//! | `wait` | a thread of the client began to wait, and for what; nothing if it has ended |
//! | `failure` | something was not as the file says |
//! | `end` | the last line |

mod observer;
mod replay;

pub use crate::run::record::{FORMAT, Header, Hexed, MOST_BYTES, PortRecord, Record, Timed};
pub use observer::Observer;
pub use replay::{Difference, Replay, ReplayError, Sent};
