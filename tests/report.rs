//! The page of `sim run --report`.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod harness;

use harness::live::{DRIVE, Folder};

/// Walls, a strip and ice, as in the worlds that ship.
const WORLD: &str = r#"
schema = 1

[[wall]]
points_m = [[-1, -0.8], [4, -0.8]]
thickness = "100 mm"

[[friction]]
area.circle = { at_m = [1, 0], radius = "0.5 m" }
friction = 0.1

[[strip]]
points_m = [[0, 0.8], [3, 0.8]]
"#;

/// A drive that goes too far, with two faults, under names that would be markup.
fn hostile() -> String {
    let drive = DRIVE
        .replace("A client drives", "</title><script>alert(1)</script>")
        .replace(
            "name = \"drive\"",
            "name = \"<img src=x onerror=alert(2)>\"",
        )
        .replace("tags = ", "world = \"world.toml\"\ntags = ")
        .replace(
            "truth.speed_mps < 1.0\"",
            "truth.distance_m < 0.5\"\nmessage = \"<b>&amp;\"",
        );
    drive
        + r#"
[[step]]
name = "</svg><style>*{display:none}"
at = "300 ms"
for = "200 ms"
fault = { kind = "ice", friction = 0.1 }

[[step]]
at = "700 ms"
for = "200 ms"
optional = true
fault = { kind = "reply-twice" }
"#
}

fn count(text: &str, what: &str) -> usize {
    text.matches(what).count()
}

#[test]
fn a_case_that_failed_is_shown_with_its_world_plots_and_traffic() {
    let files = [("drive.toml", &*hostile()), ("world.toml", WORLD)];
    let folder = Folder::with(&files);
    let args = [
        "run",
        "--seed",
        "1",
        "--report",
        "out/report.html",
        "drive.toml",
    ];
    let said = folder.sim(&args);
    assert_eq!(said.code(), Some(1), "{}", said.err);
    let page = folder.read("out/report.html");
    for part in [
        "0 of 1 passed",
        "truth.distance_m &lt; 0.5",
        "polyline class=\"obstacle band\"",
        "polyline class=\"strip band\"",
        "circle class=\"slippery\"",
        "polygon class=\"ends\"",
        "path class=\"failure\"",
        "circle class=\"fault\"",
        "friction 0.1",
        "figcaption>speed, m/s<",
        "figcaption>commands and set-points, 0.1 %<",
        "figcaption>measured speed, r/min<",
        "figcaption>current, A<",
        "figcaption>voltage, V<",
        "figcaption>charge, %<",
        "figcaption>distance, m<",
        "-&gt; 0x12 set_motors right 500 left 500  | AA 55 04 12 ",
        "[fault_armed]",
    ] {
        assert!(page.contains(part), "no {part} in {page}");
    }
    // A band for each fault and a line for the failure, in each plot.
    let (_, page) = page.split_once("<body>").unwrap();
    let plots = count(page, "<figure><figcaption>");
    assert!(plots >= 7, "{plots}");
    assert_eq!(count(page, "<rect class=\"fault\""), 2 * plots);
    assert_eq!(count(page, "<path class=\"failure\""), plots + 1);
}

#[test]
fn each_failure_is_shown_with_what_was_so_then() {
    let drive = DRIVE.to_owned()
        + "[[step]]\nname = \"slip\"\nat = \"300 ms\"\nworld = { pwm_signal = { input = \"A\", from_output = \"A\" } }\n\
           [[step]]\nname = \"twice\"\nat = \"600 ms\"\nfault = { kind = \"reply-twice\" }\n\
           [[never]]\nthat = \"t > 0.5\"\n[[never]]\nthat = \"t > 0.8\"\n";
    let folder = Folder::with(&[("drive.toml", &drive)]);
    let said = folder.sim(&["run", "--seed", "1", "--report", "r.html", "drive.toml"]);
    assert_eq!(said.code(), Some(1), "{}", said.err);
    let page = folder.read("r.html");
    let (_, first) = page.split_once("never `t &gt; 0.5`").unwrap();
    let (first, second) = first.split_once("never `t &gt; 0.8`").unwrap();
    let slip = "in effect then: &quot;slip&quot; (world pwm_signal), from 0.300000 s on";
    let twice = "armed then: &quot;twice&quot; (reply-twice), from 0.600000 s on";
    assert!(first.contains(slip) && !first.contains(twice), "{first}");
    assert!(second.contains(slip) && second.contains(twice), "{second}");
    assert_eq!(
        count(&page, "What happened before, since the failure above"),
        1
    );
    assert!(page.contains("== step &quot;slip&quot; begun"), "{page}");
}

#[test]
fn foreign_text_is_no_markup_and_nothing_is_fetched() {
    let files = [("drive.toml", &*hostile()), ("world.toml", WORLD)];
    let folder = Folder::with(&files);
    let script = r#"exec 3> "$SIM_R150_PORT"; printf '<script>alert(3)</script>\033[31m\000</pre>\n'; sleep 0.3; exit 3"#;
    let args = ["run", "--report", "report.html", "drive.toml"];
    assert_eq!(folder.with_script(&args, script).code(), Some(1));
    let page = folder.read("report.html");
    for part in ["<script", "<img", "<b>&amp;", "\u{1B}", "\0"] {
        assert!(!page.contains(part), "{part:?} in {page}");
    }
    assert_eq!(count(&page, "<style>"), 1);
    assert_eq!(count(&page, "</svg>"), count(&page, "<svg"));
    assert_eq!(count(&page, "</pre>"), count(&page, "<pre>"));
    assert!(
        page.contains("&lt;script&gt;alert(3)&lt;/script&gt;"),
        "{page}"
    );
    assert!(
        page.contains("&lt;/title&gt;&lt;script&gt;alert(1)"),
        "{page}"
    );
    assert!(page.contains("default-src 'none'"));
    assert!(page.contains("<dt>Time</dt><dd>real</dd>"));
    // The only addresses are places on the page and the names of languages.
    let addresses = page.split("://").count() - 1;
    assert_eq!(
        addresses,
        count(&page, "xmlns=\"http://www.w3.org/2000/svg\"")
    );
    assert_eq!(count(&page, "href="), count(&page, "href=\"#case-"));
    assert_eq!(count(&page, " src="), count(&page, "&lt;img src="));
}

#[test]
fn of_cases_that_passed_there_is_little_so_that_a_thousand_fit() {
    let folder = Folder::with(&[("drive.toml", DRIVE)]);
    let args = [
        "run",
        "--repeat",
        "60",
        "--report",
        "report.html",
        "drive.toml",
    ];
    let said = folder.sim(&args).expect_clean().out;
    assert!(said.contains("60 passed"), "{said}");
    let page = folder.read("report.html");
    assert_eq!(count(&page, "<details class=\"case passed\">"), 60);
    assert_eq!(count(&page, "svg class=\"map\""), 60);
    assert_eq!(count(&page, "<figcaption>speed"), 0);
    assert!(page.len() < 60 * 6000, "{} bytes", page.len());
    assert!(folder.leftovers().is_empty(), "no recording is left behind");
}

#[test]
fn what_was_not_played_has_its_line_and_the_page_a_place_to_be() {
    let folder = Folder::with(&[("drive.toml", DRIVE)]);
    std::fs::create_dir(folder.file("taken")).unwrap();
    let refused = folder.sim(&["run", "--report", "taken", "drive.toml"]);
    refused.expect_refusal(2, &["cannot write taken"]);

    let failing = DRIVE.replace("< 1.0", "< 0.1");
    std::fs::write(folder.file("a-fails.toml"), failing).unwrap();
    let args = ["run", "--fail-fast", "-j", "1", "--report", "r.html", "."];
    assert_eq!(folder.sim(&args).code(), Some(1));
    let page = folder.read("r.html");
    assert!(
        [">1 failed<", ">1 skipped<"]
            .iter()
            .all(|part| page.contains(part))
            && page.contains("the run ended before this was played"),
        "{page}"
    );
}
