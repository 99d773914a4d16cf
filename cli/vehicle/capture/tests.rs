use super::*;

#[test]
fn times_count_from_the_first_line_and_keep_their_nanoseconds() {
    let text = "seconds,direction,bytes\n# a comment\n1700000000.000000001,client,AA 55\n\n\
                1700000000.5,vehicle:1,0102\n";
    let records = of_text(text, 2).unwrap();
    assert!(matches!(
        records[0],
        Record::Attach {
            port: PortRecord(0, 0),
            ..
        }
    ));
    assert!(matches!(
        records[1],
        Record::Attach {
            port: PortRecord(0, 1),
            ..
        }
    ));
    let (first, second) = (PortRecord(0, 0), PortRecord(0, 1));
    assert_eq!(
        records[2..4],
        [
            Record::In {
                t: 1_000_000,
                port: first,
                bytes: Hexed(vec![0xAA, 0x55])
            },
            Record::Out {
                t: 500_999_999,
                dt: 0,
                port: second,
                bytes: Hexed(vec![1, 2])
            },
        ]
    );
}

#[test]
fn an_error_names_its_line_and_what_is_allowed() {
    for (text, why) in [
        ("1,client,AA\n0.5,client,AA", "line 2: time goes back"),
        (
            "1,car,AA",
            "line 1: `car` is not a direction; allowed: client, vehicle",
        ),
        (
            "1,client:1,AA",
            "line 1: there is no link `1`; this --device has 0 to 0",
        ),
        (
            "1,client,A",
            "line 1: `A` is not bytes: pairs of hexadecimal digits",
        ),
        (
            "1,client",
            "line 1: `` is not bytes: pairs of hexadecimal digits",
        ),
        (".5,client,AA", "line 1: `.5` is not a time in seconds"),
        ("-1,client,AA", "line 1: `-1` is not a time in seconds"),
        ("1e3,client,AA", "line 1: `1e3` is not a time in seconds"),
        ("1.-5,client,AA", "line 1: `1.-5` is not a time in seconds"),
        ("", "it has no lines; each is `seconds,direction,bytes`"),
    ] {
        let error = of_text(text, 1).unwrap_err();
        assert_eq!(format!("{error:#}"), why);
    }
}

#[test]
fn no_row_is_taken_for_a_heading_and_a_heading_is_none() {
    for (text, rows) in [
        ("\u{feff}1,client,AA\n2,client,BB", 2),
        ("+1,client,AA\n2,client,BB", 2),
        ("\"1\",\"client\",\"AA\"\n2,client,BB", 2),
        ("# a comment\n\nseconds,direction,bytes\n1,client,AA", 1),
        (
            "\u{feff}\"seconds\",\"direction\",\"bytes\"\n1,client,AA",
            1,
        ),
    ] {
        let records = of_text(text, 1).unwrap();
        let bytes = |one: &&Record| matches!(one, Record::In { .. });
        assert_eq!(records.iter().filter(bytes).count(), rows, "{text}");
    }
}
