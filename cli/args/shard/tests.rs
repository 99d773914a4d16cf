use super::*;

#[test]
fn a_shard_counts_from_one_to_the_number_of_shards() {
    assert_eq!(shard("3/20"), Shard::new(3, 20, None));
    for wrong in ["0/3", "4/3", "3", "a/3", "1/0", "1/100001", "-1/3", ""] {
        assert!(shard(wrong).is_err(), "{wrong}");
    }
}

#[test]
fn each_case_has_one_owner_and_shards_are_about_equal() {
    let mut counts = [0_u32; 7];
    for seed in 0..7000 {
        let owner = Shard::owner(7, "a.toml", &[], seed);
        counts[usize::try_from(owner).unwrap() - 1] += 1;
    }
    assert!(
        counts.iter().all(|count| (850..1150).contains(count)),
        "{counts:?}"
    );
    let other = |case: &str, set: &[&str]| {
        let set: Vec<String> = set.iter().map(|set| (*set).to_owned()).collect();
        Shard::owner(MOST_SHARDS, case, &set, 1)
    };
    let owners = [
        other("a.toml", &[]),
        other("a.toml a=b", &[]),
        other("a.toml", &["a", "b"]),
    ];
    assert!(owners[0] != owners[1] && owners[1] != owners[2] && owners[0] != owners[2]);
}

#[test]
fn engines_count_from_where_they_do_and_may_not_disagree() {
    let find = |variables: &[(&str, &str)]| {
        find(|name| {
            let variable = variables.iter().find(|(known, _)| *known == name)?;
            Some(variable.1.to_owned())
        })
    };
    let shard = |variables: &[(&str, &str)]| find(variables).map(|shard| shard.to_string());
    let gitlab = [("CI_NODE_INDEX", "5"), ("CI_NODE_TOTAL", "5")];
    let circle = [("CIRCLE_NODE_INDEX", "4"), ("CIRCLE_NODE_TOTAL", "5")];
    assert_eq!(shard(&gitlab).as_deref(), Ok("5/5"));
    assert_eq!(shard(&circle).as_deref(), Ok("5/5"));
    assert_eq!(shard(&[gitlab, circle].concat()).as_deref(), Ok("5/5"));
    let grid = [
        ("SGE_TASK_ID", "9"),
        ("SGE_TASK_FIRST", "3"),
        ("SGE_TASK_LAST", "11"),
        ("SGE_TASK_STEPSIZE", "2"),
    ];
    assert_eq!(shard(&grid).as_deref(), Ok("4/5"));
    let no_array = [("SGE_TASK_ID", "undefined")];
    for (wrong, why) in [
        (
            &[gitlab, [circle[0], ("CIRCLE_NODE_TOTAL", "6")]].concat()[..],
            "CircleCI says shard 5/6",
        ),
        (&gitlab[..1], "CI_NODE_TOTAL is not"),
        (
            &[("CI_NODE_INDEX", "0"), gitlab[1]],
            "none of the 5 numbers from 1",
        ),
        (
            &[("CIRCLE_NODE_INDEX", "5"), circle[1]],
            "none of the 5 numbers from 0",
        ),
        (&no_array, "none of CI_NODE_INDEX"),
    ] {
        let found = shard(wrong).unwrap_err();
        assert!(found.contains(why), "{found}");
    }
}
