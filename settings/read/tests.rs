use super::*;
use crate::Length;
use serde::Deserialize;
use std::collections::BTreeMap;

#[derive(Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    name: Spanned<String>,
    #[serde(default)]
    count: u8,
    #[serde(default)]
    scale: Option<f64>,
    #[serde(default)]
    at: Vec<Place>,
    #[serde(default)]
    does: Option<Does>,
    #[serde(default)]
    named: BTreeMap<Spanned<String>, bool>,
}

#[derive(Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Place {
    x: Length,
}

#[derive(Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
enum Does {
    Stop,
    Turn(i16),
    Drive { far: Length },
}

fn parsed(text: &str) -> Spanned<DeValue<'_>> {
    let table = DeTable::parse(text).unwrap();
    Spanned::new(table.span(), DeValue::Table(table.into_inner()))
}

#[test]
fn values_are_read_with_their_places() {
    let text = "name = \"a\"\ncount = 0x10\nscale = 2\nat = [{ x = \"1 m\" }]\n\
                does.drive = { far = \"2 m\" }\nnamed = { b = true }\n";
    let document: Document = read(&parsed(text)).unwrap();
    assert_eq!(
        (document.name.get_ref().as_str(), document.name.span()),
        ("a", 7..10)
    );
    assert_eq!((document.count, document.scale), (16, Some(2.0)));
    assert_eq!(document.at, [Place { x: Length(1.0) }]);
    assert_eq!(document.does, Some(Does::Drive { far: Length(2.0) }));
    let at = text.find("b = true").unwrap();
    let (key, _) = document.named.into_iter().next().unwrap();
    assert_eq!((key.get_ref().as_str(), key.span()), ("b", at..at + 1));
    for (does, wanted) in [("\"stop\"", Does::Stop), ("{ turn = -3 }", Does::Turn(-3))] {
        let text = format!("name = \"\"\ndoes = {does}");
        let document: Document = read(&parsed(&text)).unwrap();
        assert_eq!(document.does, Some(wanted));
    }
}

#[test]
fn errors_say_where_and_what_is_wrong() {
    for (text, place, path, why) in [
        ("count = 1", "count = 1", "", "missing key `name`"),
        ("name = 3", "3", "name", "3 is not a text"),
        (
            "name = \"\"\ncount = 300",
            "300",
            "count",
            "300 is not a whole number from 0 to 255",
        ),
        (
            "name = \"\"\nscale = true",
            "true",
            "scale",
            "true is not a number",
        ),
        (
            "name = \"\"\nat = { x = 1 }",
            "{ x = 1 }",
            "at",
            "a table is not a list",
        ),
        (
            "name = \"\"\nat = [{ x = 1 }]",
            "1 }",
            "at.[].x",
            "1 lacks a unit",
        ),
        ("name = \"\"\nat = [{}]", "{}", "at.[]", "missing key `x`"),
        (
            "name = \"\"\nconut = 1",
            "conut",
            "conut",
            "unknown key `conut`; did you mean `count`?",
        ),
        (
            "name = \"\"\ndoes = \"sop\"",
            "\"sop\"",
            "does",
            "unknown word `sop`; did you mean `stop`?",
        ),
        (
            "name = \"\"\ndoes = { tunr = 1 }",
            "tunr",
            "does.tunr",
            "unknown word `tunr`; did you mean `turn`?",
        ),
        (
            "name = \"\"\ndoes = { turn = 1.5 }",
            "1.5",
            "does.turn",
            "1.5 is not a whole number",
        ),
        (
            "name = \"\"\ndoes = \"turn\"",
            "\"turn\"",
            "does",
            "a value belongs to it",
        ),
        (
            "name = \"\"\ndoes = { stop = 1 }",
            "1 }",
            "does.stop",
            "no value belongs to it",
        ),
        (
            "name = \"\"\ndoes = { drive = { far = \"1 V\" } }",
            "\"1 V\"",
            "does.drive.far",
            "`V` is not a unit",
        ),
        (
            "name = \"\"\ndoes = 1979-05-27",
            "1979",
            "does",
            "a date is not one of stop, turn, drive",
        ),
    ] {
        let error = read::<Document>(&parsed(text)).unwrap_err();
        let parts = error.path.iter().map(|part| match part {
            Part::Key(key) => key.as_str(),
            Part::Element(_) => "[]",
        });
        assert_eq!(parts.collect::<Vec<_>>().join("."), path, "{text}");
        let at = error.at.clone().unwrap().start;
        assert!(
            path.is_empty() || text[at..].starts_with(place),
            "{text}: {at}"
        );
        assert!(error.to_string().starts_with(why), "{text}: {error}");
    }
}

#[test]
fn the_kind_of_a_table_names_the_variant() {
    let read = |text: &str| {
        let value = parsed(text);
        Does::deserialize(Reader::of_kind(&value))
    };
    assert_eq!(
        read("kind = \"drive\"\nfar = \"1 m\""),
        Ok(Does::Drive { far: Length(1.0) })
    );
    for (text, path, why) in [
        ("far = \"1 m\"", None, "missing key `kind`"),
        (
            "kind = \"driv\"",
            Some("kind"),
            "unknown word `driv`; did you mean `drive`?",
        ),
        ("kind = \"drive\"", None, "missing key `far`"),
        (
            "kind = \"drive\"\nfarr = 1",
            Some("farr"),
            "unknown key `farr`; did you mean `far`?",
        ),
    ] {
        let error = read(text).unwrap_err();
        let path = path.map(|key| vec![Part::Key(key.to_owned())]);
        assert_eq!(error.path, path.unwrap_or_default(), "{text}");
        assert!(error.to_string().starts_with(why), "{text}: {error}");
    }
}
