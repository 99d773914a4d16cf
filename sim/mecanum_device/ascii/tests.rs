use super::*;
use proptest::prelude::*;

fn decode(bytes: &[u8]) -> Vec<Line> {
    let mut decoder = Decoder::default();
    bytes
        .iter()
        .filter_map(|&byte| decoder.push(byte))
        .collect()
}

fn command(letter: Letter, tenths: i32) -> Line {
    Line::Command(Command { letter, tenths })
}

fn bad(error: LineError, bytes: &[u8]) -> Line {
    Line::Bad {
        error,
        bytes: bytes.to_vec(),
    }
}

#[test]
fn the_articles_lines() {
    assert_eq!(decode(b"X10 \n"), [command(Letter::X, 10)]);
    let one_revolution = Command {
        letter: Letter::X,
        tenths: 10,
    };
    assert_eq!(one_revolution.encode(), b"X10 \n");
    let report = Report {
        speed: 4,
        mileage: 500,
    };
    assert_eq!(report.encode(), b"V4 S500 \n");
    assert_eq!(REPORTS[0].values(b"V4 S").count(), 1);
}

#[test]
fn every_letter_and_both_ends_of_the_range() {
    assert_eq!(decode(b"Y-32768\n"), [command(Letter::Y, -32_768)]);
    assert_eq!(decode(b"Z32768\n"), [command(Letter::Z, 32_768)]);
    assert_eq!(decode(b"A0\n"), [command(Letter::A, 0)]);
    assert_eq!(decode(b"B-0007\n"), [command(Letter::B, -7)]);
}

#[test]
fn spaces_and_carriage_returns_are_skipped() {
    assert_eq!(decode(b" X - 1 0\r\n"), [command(Letter::X, -10)]);
    assert_eq!(decode(b"\n \r\n\n"), []);
}

#[test]
fn what_is_no_command_is_reported_and_the_next_line_counts() {
    for line in [
        &b"x10"[..],
        b"10",
        b"X",
        b"X-",
        b"X+1",
        b"X1.5",
        b"X1X2",
        b"X--1",
        b"C5",
        b"\xFF\x00",
    ] {
        let bytes = [line, b"\nX1\n"].concat();
        assert_eq!(
            decode(&bytes),
            [bad(LineError::Malformed, line), command(Letter::X, 1)]
        );
    }
    assert_eq!(decode(b"X32769\n"), [bad(LineError::OutOfRange, b"X32769")]);
    assert_eq!(
        decode(b"X-32769\n"),
        [bad(LineError::OutOfRange, b"X-32769")]
    );
    let huge = b"X99999999999999999999";
    assert_eq!(
        decode(&[&huge[..], b"\n"].concat()),
        [bad(LineError::OutOfRange, huge)]
    );
}

#[test]
fn a_line_of_32_bytes_is_read_and_one_more_is_too_many() {
    let fits = format!("X{:031}", 7);
    assert_eq!(
        decode(format!("{fits}\n").as_bytes()),
        [command(Letter::X, 7)]
    );
    let long = format!("{fits}0");
    let found = decode(format!("{long}1234\nX2\n").as_bytes());
    assert_eq!(found[0], bad(LineError::TooLong, fits.as_bytes()));
    assert_eq!(found[1..], [command(Letter::X, 2)]);
    // It is reported as soon as it is too long, not when it ends.
    assert_eq!(decode(long.as_bytes()).len(), 1);
}

proptest! {
    #[test]
    fn what_is_encoded_decodes(letter in prop::sample::select(&Letter::ALL[..]), tenths in LOWEST..=HIGHEST) {
        let line = Command { letter, tenths };
        prop_assert_eq!(decode(&line.encode()), [Line::Command(line)]);
    }

    #[test]
    fn reports_read_back(speed: i32, mileage: i32) {
        let [speed, mileage] = [speed, mileage].map(i64::from);
        let line = Report { speed, mileage }.encode();
        let values = REPORTS[0].values(&line);
        let numbers: Vec<String> = values.map(|(_, numbers)| numbers[0].to_string()).collect();
        prop_assert_eq!(numbers, [speed.to_string(), mileage.to_string()]);
    }

    #[test]
    fn any_bytes_give_at_most_one_report_a_line_and_a_good_line_after_them_counts(
        bytes in prop::collection::vec(
            prop_oneof![any::<u8>(), prop::sample::select(&b"XYZAB-0123456789 \r\n"[..])],
            0..300,
        ),
    ) {
        let lines = bytes.iter().filter(|&&byte| byte == b'\n').count() + 1;
        let found = decode(&[&bytes[..], b"\nX42\n"].concat());
        prop_assert!(found.len() <= lines + 1);
        prop_assert_eq!(found.last(), Some(&command(Letter::X, 42)));
    }
}
