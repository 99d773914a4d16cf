//! Input of a client on the network.

use std::collections::VecDeque;

use rigsim_pty::{NetDecoder, Protocol};

/// Bytes that wait for the device, at most, and one of a break.
const MOST_AHEAD: usize = 4097;

/// Everything that was made of a stream.
#[derive(Debug, PartialEq, Eq)]
struct Made {
    bytes: Vec<u8>,
    output: Vec<u8>,
    settings: String,
}

/// Plays any bytes, of which the first says in which pieces they come.
///
/// # Promises
/// All is taken as long as output is; what waits is bounded; how the stream is split changes
/// neither bytes nor answers nor settings, as long as nothing waits; without a protocol all bytes
/// pass as they are, and with it none of the device's is lost on its way.
pub fn play(data: &[u8]) {
    let Some((first, stream)) = data.split_first() else {
        return;
    };
    let size = usize::from(*first % 32) + 1;
    assert_eq!(
        decode(Protocol::Tcp, stream.chunks(size)),
        Made {
            bytes: stream.to_vec(),
            output: Vec::new(),
            settings: format!("{:?}", NetDecoder::new(Protocol::Tcp, 115_200).settings()),
        }
    );
    let whole = decode(Protocol::Rfc2217, stream.chunks(1));
    if size == 1 {
        assert_eq!(whole, decode(Protocol::Rfc2217, stream.chunks(1)));
    }
    let pieces = decode(Protocol::Rfc2217, stream.chunks(size));
    assert_eq!(whole.settings, pieces.settings);
    assert_eq!(whole.output, pieces.output);
    // A purge takes what came in the same piece.
    assert!(pieces.bytes.len() <= whole.bytes.len());
    queue(stream);
    echo(stream);
}

fn decode<'a>(protocol: Protocol, pieces: impl Iterator<Item = &'a [u8]>) -> Made {
    let mut decoder = NetDecoder::new(protocol, 115_200);
    let (mut bytes, mut output, mut ahead) = (Vec::new(), Vec::new(), VecDeque::new());
    let mut send = |decoder: &mut NetDecoder| {
        let count = decoder.output().len();
        output.extend_from_slice(decoder.output());
        decoder.consume_output(count);
    };
    send(&mut decoder);
    for piece in pieces {
        let mut at = 0;
        while at < piece.len() {
            let taken = decoder.take(&piece[at..], &mut ahead);
            assert!(taken > 0 && taken <= piece.len() - at, "{taken} taken");
            at += taken;
            send(&mut decoder);
        }
        bytes.extend(ahead.drain(..));
    }
    Made {
        bytes,
        output,
        settings: format!("{:?}", decoder.settings()),
    }
}

/// Nothing is taken: neither the device nor the client.
fn queue(stream: &[u8]) {
    let mut decoder = NetDecoder::new(Protocol::Rfc2217, 115_200);
    let mut ahead = VecDeque::new();
    let mut rest = stream;
    loop {
        let taken = decoder.take(rest, &mut ahead);
        rest = &rest[taken..];
        assert!(ahead.len() <= MOST_AHEAD, "{} wait", ahead.len());
        if taken == 0 {
            break;
        }
    }
}

/// The device says the same, which arrives with each 0xFF doubled.
fn echo(stream: &[u8]) {
    let mut decoder = NetDecoder::new(Protocol::Rfc2217, 115_200);
    let opening = decoder.output().len();
    decoder.consume_output(opening);
    let mut output = Vec::new();
    let mut rest = stream;
    while !rest.is_empty() {
        let taken = decoder.put(rest);
        rest = &rest[taken..];
        assert!(
            !decoder.output().is_empty(),
            "nothing taken and nothing to send"
        );
        output.extend_from_slice(decoder.output());
        decoder.consume_output(decoder.output().len());
    }
    let doubled: Vec<u8> = stream
        .iter()
        .flat_map(|byte| std::iter::repeat_n(*byte, if *byte == 255 { 2 } else { 1 }))
        .collect();
    assert_eq!(output, doubled);
}
