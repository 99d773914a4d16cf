use super::*;
use crate::condition::Reading;
use crate::trace::Replay;

const PORT: PortId = PortId { device: 0, link: 0 };
/// A rule that holds as long as the client knows where it is.
const KNOWS: &str = "[[always]]\nthat = \"abs(client.x - truth.x_m) < 0.5\"\n";

fn live(more: &str) -> Run {
    let options = RunOptions {
        live: true,
        trace: true,
        ..RunOptions::scripted(1)
    };
    let mut run = Run::new(scenario(&text(R150, "4s", more)), None, options).unwrap();
    run.attach(PORT, SimTime::from_millis(1)).unwrap();
    run
}

fn publish(run: &mut Run, at: u64, line: &str) -> Result<(), PublishError> {
    run.publish(SimTime::from_millis(at), line).unwrap()
}

fn refusals(run: &mut Run) -> usize {
    let events = std::iter::from_fn(|| run.poll_event());
    let codes = events.map(|event| event.kind.code().name);
    codes.filter(|code| *code == "bad_publication").count()
}

#[test]
fn what_a_client_publishes_is_a_name_of_conditions() {
    let mut run = live("");
    let holds = |run: &Run, text: &str| run.holds(&run.condition(text).unwrap()).unwrap();
    assert!(!holds(&run, "client.x < 1 || client.x >= 1"), "not known");
    publish(&mut run, 10, "x=1.5 y=-2e-1\r").unwrap();
    assert!(holds(&run, "client.x == 1.5 && client.y == -0.2"));
    publish(&mut run, 20, r#"{"x": 3, "name_2": 0.25}"#).unwrap();
    assert!(holds(&run, "client.x == 3 && client.y == -0.2"));
    assert!(holds(&run, "client.name_2 == 0.25"));
    assert_eq!(run.rig().now(), SimTime::from_millis(20));
    let names: Vec<String> = run.published().map(|probe| probe.name).collect();
    assert_eq!(names, ["client.name_2", "client.x", "client.y"]);
    assert_eq!(refusals(&mut run), 0);
}

#[test]
fn a_rule_is_judged_from_the_first_line_on_and_at_the_time_of_each() {
    for (wrong, passes) in [("0.4", true), ("0.6", false)] {
        let mut run = live(KNOWS);
        publish(&mut run, 1000, "x=0").unwrap();
        publish(&mut run, 2002, &format!("x={wrong}")).unwrap();
        publish(&mut run, 2003, "x=0").unwrap();
        run.advance(SimTime::MAX).unwrap();
        let outcome = run.finished().unwrap().clone();
        assert_eq!(outcome.passed, passes, "{outcome:?}");
        let at: Vec<SimTime> = outcome.failures.iter().map(|one| one.at).collect();
        let wanted = if passes {
            vec![]
        } else {
            vec![SimTime::from_millis(2002)]
        };
        assert_eq!(at, wanted);
        // The trace has it all.
        let lines: Vec<String> = std::iter::from_fn(|| run.poll_trace()).collect();
        assert_eq!(
            lines
                .iter()
                .filter(|line| line.contains("\"publish\""))
                .count(),
            3
        );
        let mut replay = Replay::begin(rigsim_core::SHIPPED, &lines[0]).unwrap();
        for line in &lines[1..] {
            replay.line(line).unwrap();
        }
        assert_eq!(replay.run().finished().unwrap().failures, outcome.failures);
        replay.finish().unwrap();
    }
}

#[test]
fn a_line_that_says_nothing_changes_nothing_and_is_an_event() {
    let mut run = live("");
    publish(&mut run, 10, "x=1").unwrap();
    let long = format!("x=2{}", " ".repeat(300));
    let bad = [
        "",
        "x",
        "x=",
        "=2",
        "x=two",
        "x=nan",
        "x=inf y=3",
        "x=2 y",
        "X=2",
        "2x=2",
        "a.b=2",
        "{",
        "[2]",
        "{\"x\": \"2\"}",
        "{\"x\": true}",
        "attached=2",
        "attached_2=2",
        "x=2 pwm_a=3",
        &long,
        "ö=2",
    ];
    for (index, line) in bad.iter().enumerate() {
        let at = 20 + u64::try_from(index).unwrap();
        assert!(publish(&mut run, at, line).is_err(), "{line}");
        let value = run.value("client.x").unwrap();
        assert_eq!(value, Reading::Number(1.0), "{line}");
        assert_eq!(refusals(&mut run), 1, "{line}");
    }
    assert_eq!(run.published().count(), 1);
}

#[test]
fn names_and_lines_are_bounded() {
    let mut run = live("");
    for number in 0..64 {
        publish(&mut run, 10 + number, &format!("n{number}_of_all={number}")).unwrap();
    }
    assert!(publish(&mut run, 100, "one_more=1").is_err());
    publish(&mut run, 101, "n7_of_all=8").unwrap();
    assert_eq!(run.published().count(), 64);
    assert_eq!(refusals(&mut run), 1);
    // In the next second, a flood.
    let used = |run: &mut Run, at: u64| {
        let lines = (0..5000).map(|number| publish(run, at, &format!("n1_of_all={number}")));
        lines.filter(Result::is_ok).count()
    };
    assert_eq!(used(&mut run, 1500), 1000);
    assert_eq!(
        run.value("client.n1_of_all").unwrap(),
        Reading::Number(999.0)
    );
    assert_eq!(refusals(&mut run), 1, "a flood is reported once");
    let lines = std::iter::from_fn(|| run.poll_trace());
    assert!(lines.filter(|line| line.contains("n1_of_all=4")).count() < 1000);
    assert_eq!(used(&mut run, 2500), 1000);
}
