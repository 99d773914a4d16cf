use super::*;
use crate::world::{Obstacle, ObstacleError, ObstacleShape, Shape, World, WorldSettings};

fn read(text: &str) -> Result<WorldMap, WorldFileError> {
    WorldMap::from_toml(text, "test.toml")
}

/// What the error of a file with this text after its first line says.
fn refusal(text: &str) -> String {
    let text = format!("schema = 1\n{text}");
    read(&text).unwrap_err().to_string()
}

const SHIPPED: [(&str, &str); 4] = [
    ("empty", include_str!("../../../worlds/empty.toml")),
    ("yard", include_str!("../../../worlds/yard.toml")),
    ("line-loop", include_str!("../../../worlds/line-loop.toml")),
    ("slope", include_str!("../../../worlds/slope.toml")),
];

#[test]
fn the_shipped_worlds_load() {
    let maps = SHIPPED.map(|(name, text)| {
        let map = WorldMap::from_toml(text, name).unwrap_or_else(|error| panic!("{error}"));
        let _world = World::with_map(&WorldSettings::default(), &map);
        map
    });
    let [empty, yard, line_loop, slope] = maps;
    assert_eq!(empty, WorldMap::default());
    assert_eq!(yard.obstacles.iter().count(), 2 + 2 + 3);
    let fence = yard.obstacles.iter().next().unwrap();
    assert_eq!(fence.solids().len(), 4);
    assert_eq!(line_loop.tags.len(), 4);
    assert!(line_loop.strips[0].closed);
    let [ramp] = &slope.slopes[..] else { panic!() };
    assert!((ramp.slope - 0.1745).abs() < 1e-3);
    assert!(matches!(ramp.area, Shape::Rectangle(_)));
}

#[test]
fn quantities_take_any_unit_of_their_kind() {
    let map = read(
        "schema = 1\n[[circle]]\nat_m = [1, -2.5]\nradius = \"35 cm\"\n\
         [[box]]\nat_m = [0, 0]\nheading = \"0.5 rad\"\nlength = \"1.5m\"\nwidth = \"2e2 mm\"",
    )
    .unwrap();
    let shapes: Vec<&ObstacleShape> = map.obstacles.iter().map(Obstacle::shape).collect();
    let [ObstacleShape::Box(block), ObstacleShape::Circle(post)] = shapes[..] else {
        panic!("{shapes:?}")
    };
    assert!((post.radius - 0.35).abs() < 1e-12);
    assert_eq!(post.centre, [1.0, -2.5]);
    assert!((block.direction[0] - 0.5_f64.cos()).abs() < 1e-12);
    assert!((block.half[1] - 0.1).abs() < 1e-12);
}

#[test]
fn obstacles_may_have_names() {
    let map = read(
        "schema = 1\n[[wall]]\npoints_m = [[0, 0], [1, 0]]\nthickness = \"1 m\"\n\
         [[box]]\nname = \"gate_1\"\nat_m = [0, 0]\nlength = \"1.5m\"\nwidth = \"2e2 mm\"\n\
         [[circle]]\nname = \"post-2\"\nat_m = [1, -2.5]\nradius = \"35 cm\"",
    )
    .unwrap();
    let names: Vec<Option<&str>> = map.obstacles.iter().map(Obstacle::name).collect();
    assert_eq!(names, [None, Some("gate_1"), Some("post-2")]);
}

#[test]
fn what_is_refused_is_named_with_its_line_its_key_and_what_is_allowed() {
    for (text, wanted) in [
        (
            "gate = 1",
            &["test.toml:2:1", "`gate`", "wall, box", "strip"][..],
        ),
        (
            "[[wall]]\npoints_m = [[0, 0], [1, 0]]\nthicknes = \"1 m\"",
            &["test.toml:4:1", "`wall.thicknes`", "`thickness`"],
        ),
        (
            "[[wall]]\npoints_m = [[0, 0], [1, 0]]\nthickness = 0.1",
            &[
                "test.toml:4:13",
                "`wall.thickness`",
                "\"0.5 m\"",
                "in m from 0.001 to 10000",
            ],
        ),
        (
            "[[wall]]\npoints_m = [[0, 0], [1, 0]]\nthickness = \"0.1\"",
            &["test.toml:4:13", "`wall.thickness`", "lacks a unit"],
        ),
        (
            "[[wall]]\npoints_m = [[0, 0], [1, 0]]\nthickness = \"3 kg\"",
            &["test.toml:4:13", "`wall.thickness`", "mm, cm, km"],
        ),
        (
            "[[wall]]\npoints_m = [[0, 0]]\nthickness = \"3 mm\"",
            &["test.toml:3:12", "`wall.points_m`", "two points"],
        ),
        (
            "[[circle]]\nat_m = [0, 1e9]\nradius = \"3 mm\"",
            &["test.toml:3:", "`circle.at_m`", "-10000 to 10000"],
        ),
        (
            "[[circle]]\nat_m = [0, 1, 2]\nradius = \"3 mm\"",
            &["test.toml:3:", "`circle.at_m`"],
        ),
        (
            "[[circle]]\nat_m = [0, 1]\nradius = \"0 mm\"",
            &["test.toml:4:10", "`circle.radius`", "out of range", "0.001"],
        ),
        (
            "[[circle]]\nat_m = [0, 1]",
            &["test.toml:2:", "`circle`", "missing key `radius`"],
        ),
        (
            "[[slope]]\narea.square = 1\nslope = \"3 deg\"\nuphill = \"0 deg\"",
            &["test.toml:3:", "`slope.area.square`", "rectangle, circle"],
        ),
        (
            "[[slope]]\narea.circle = { at_m = [0, 0], radius = \"1 m\" }\nslope = \"80 deg\"\nuphill = \"0 deg\"",
            &["test.toml:4:9", "`slope.slope`", "-45 to 45"],
        ),
        (
            "[[slope]]\narea.circle = { at_m = [0, 0], size = \"1 m\" }\nslope = \"8 deg\"\nuphill = \"0 deg\"",
            &[
                "test.toml:3:32",
                "`slope.area.circle.size`",
                "allowed: at_m, radius",
            ],
        ),
        (
            "[[friction]]\narea.circle = { at_m = [0, 0], radius = \"1 m\" }\nfriction = 3",
            &["test.toml:4:12", "`friction.friction`", "0 to 2"],
        ),
        (
            "[[tag]]\nat_m = [0, 0]\nnumber = 0",
            &["test.toml:4:10", "`tag.number`", "1 to 4294967295"],
        ),
        (
            "[[circle]]\nname = \"a b\"\nat_m = [0, 1]\nradius = \"1 m\"",
            &["test.toml:3:8", "`circle.name`", "letters, digits"],
        ),
        (
            "[[circle]]\nname = \"gate\"\nat_m = [0, 1]\nradius = \"1 m\"\n\
             [[wall]]\npoints_m = [[0, 0], [1, 0]]\nthickness = \"3 mm\"\nname = \"gate\"",
            &["test.toml:3:8", "`circle.name`", "`gate` already"],
        ),
        ("[[tag]\n", &["test.toml:2:"]),
    ] {
        let found = refusal(text);
        println!("{found}");
        for part in wanted {
            assert!(found.contains(part), "{part} in {found}");
        }
    }
    let found = read("schema = 2").unwrap_err().to_string();
    assert!(
        found.contains("test.toml:1:10") && found.contains("from 1 to 1"),
        "{found}"
    );
    let found = read("").unwrap_err().to_string();
    assert!(found.contains("missing key `schema`"), "{found}");
}

#[test]
fn a_world_with_too_many_parts_is_refused_from_a_file_and_when_they_are_added() {
    let file = |boxes: usize| {
        let text = "[[box]]\nat_m = [3, 0]\nlength = \"1 m\"\nwidth = \"1 m\"\n";
        format!("schema = 1\n{}", text.repeat(boxes))
    };
    let full = read(&file(MOST_PARTS)).unwrap();
    let error = read(&file(MOST_PARTS + 1)).unwrap_err().to_string();
    assert!(error.contains("more than 4000 things"), "{error}");

    let mut world = World::with_map(&WorldSettings::default(), &full);
    let one = read(&file(1)).unwrap();
    assert_eq!(world.add_map(&one), Err(ObstacleError::TooMany));
    let mut world = World::with_map(&WorldSettings::default(), &one);
    assert_eq!(world.add_map(&full), Err(ObstacleError::TooMany));
    assert_eq!(world.obstacles().count(), 1);
}

#[test]
fn the_schema_describes_every_key_and_allows_no_other() {
    let schema = WorldMap::json_schema();
    for key in [
        "wall",
        "box",
        "points_m",
        "corner_radius",
        "uphill",
        "circle",
    ] {
        assert!(schema.contains(&format!("\"{key}\"")), "{key}");
    }
    assert!(schema.contains("\"additionalProperties\": false"));
    assert!(schema.contains("\"title\": \"sim world file\""));
    assert!(
        schema == include_str!("../../../worlds/world.schema.json"),
        "worlds/world.schema.json is to read:\n{schema}"
    );
}
