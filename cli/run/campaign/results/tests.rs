use super::super::resume;
use super::*;

#[test]
fn a_signature_has_no_values() {
    let one = signature("always `truth.distance_m < 0.2`, but truth.distance_m = 0.200616");
    assert_eq!(one, "always `truth.distance_m < 0.2`");
    let one = signature("22 motor commands within 1.0 s, `count.x > 3`");
    assert_eq!(one, "# motor commands within # s, `count.x > 3`");
}

fn plan() -> Plan {
    Plan {
        program: "x".to_owned(),
        shards: 1,
        repeat: 1000,
        client: Vec::new(),
        client_files: Vec::new(),
        set: Vec::new(),
        files: vec![crate::run::campaign::plan::PlannedFile {
            name: "a.toml".to_owned(),
            seed: 1,
            digest: String::new(),
            title: "A".to_owned(),
            commands: ["a.toml".to_owned(), "a.toml".to_owned()],
        }],
    }
}

fn line(repeat: u32) -> Line {
    Line {
        file: 0,
        repeat,
        name: format!("a.toml #{}", repeat + 1),
        seed: 1 + u64::from(repeat),
        verdict: Verdict::Passed,
        signature: None,
        reason: None,
        simulated_s: 1.0,
        margins: [("never `t > 9`".to_owned(), 0.25)].into(),
        trace: None,
        took_s: 0.1,
    }
}

#[test]
fn every_prefix_can_be_read_and_attempts_never_overwrite_one_another() {
    let folder = tempfile::tempdir().unwrap();
    let (mut results, known) = resume(folder.path(), Shard::WHOLE, &plan()).unwrap();
    assert_eq!(known, vec![None; 1000]);
    for repeat in 0..1000 {
        results.add(&line(repeat)).unwrap();
        if repeat % 100 == 99 {
            results.flush().unwrap();
        }
    }
    drop(results);
    let path = files(folder.path()).unwrap().remove(0);
    let whole = fs::read(&path).unwrap();
    let torn = folder.path().join("torn");
    let mut most = 0;
    for length in (0..whole.len()).step_by(7).chain([whole.len()]) {
        fs::write(&torn, &whole[..length]).unwrap();
        let mut seen = Vec::new();
        let take = |part| {
            if let Part::Line(line) = part {
                seen.push(line.repeat);
            }
            Ok(true)
        };
        let tail = read(&torn, take).unwrap();
        assert_eq!(
            seen,
            (0..u32::try_from(seen.len()).unwrap()).collect::<Vec<_>>()
        );
        assert!(seen.len() >= most, "{length}");
        assert!(length < whole.len() || tail == Tail::Whole);
        most = seen.len();
    }
    assert_eq!(most, 1000);
    let (_, known) = resume(folder.path(), Shard::WHOLE, &plan()).unwrap();
    assert_eq!(known, vec![Some(Verdict::Passed); 1000]);
    assert_eq!(fs::read(&path).unwrap(), whole);
    assert_eq!(files(folder.path()).unwrap().len(), 2);
}
