use std::io::BufReader;

use flate2::bufread::MultiGzDecoder;

use super::super::resume;
use super::*;
use crate::json_lines::Lines;

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
            command: "a.toml".to_owned(),
            later_command: "a.toml".to_owned(),
        }],
    }
}

fn line(repeat: u32) -> Line {
    Line {
        case: repeat as usize,
        name: format!("a.toml #{}", repeat + 1),
        seed: 1 + u64::from(repeat),
        verdict: Verdict::Passed,
        signature: None,
        kind: None,
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
    let (mut results, known) = resume(folder.path(), Shard::WHOLE, plan()).unwrap();
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
        let file = BufReader::new(File::open(&torn).unwrap());
        let mut lines = Lines::new(BufReader::new(MultiGzDecoder::new(file)));
        let mut seen = 0;
        if let Some(header) = lines.next::<Header>().unwrap() {
            assert_eq!(header.plan, plan());
            while let Some(line) = lines.next::<Line>().unwrap() {
                assert_eq!(line.case, seen);
                seen += 1;
            }
        }
        assert!(seen >= most, "{length}");
        assert!(length < whole.len() || !lines.is_torn);
        most = seen;
    }
    assert_eq!(most, 1000);
    let (_, known) = resume(folder.path(), Shard::WHOLE, plan()).unwrap();
    assert_eq!(known, vec![Some((Verdict::Passed, String::new())); 1000]);
    assert_eq!(fs::read(&path).unwrap(), whole);
    assert_eq!(files(folder.path()).unwrap().len(), 2);
}
