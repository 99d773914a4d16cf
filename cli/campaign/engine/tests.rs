use super::*;

fn found(variables: &[(&str, &str)]) -> Result<(String, &'static str), String> {
    let variable = |name: &str| {
        let one = variables.iter().find(|(known, _)| *known == name);
        one.map(|(_, value)| (*value).to_owned())
    };
    find(variable).map(|(shard, engine)| (shard.to_string(), engine))
}

type Variables<'a> = &'a [(&'a str, &'a str)];

#[test]
fn each_engine_counts_as_its_documentation_says() {
    let cases: &[(Variables<'_>, &str, &str)] = &[
        (
            &[("CI_NODE_INDEX", "1"), ("CI_NODE_TOTAL", "4")],
            "1/4",
            "GitLab",
        ),
        (
            &[("CI_NODE_INDEX", "4"), ("CI_NODE_TOTAL", "4")],
            "4/4",
            "GitLab",
        ),
        (
            &[("CIRCLE_NODE_INDEX", "0"), ("CIRCLE_NODE_TOTAL", "4")],
            "1/4",
            "CircleCI",
        ),
        (
            &[
                ("BUILDKITE_PARALLEL_JOB", "3"),
                ("BUILDKITE_PARALLEL_JOB_COUNT", "4"),
            ],
            "4/4",
            "Buildkite",
        ),
        (
            &[("TEST_SHARD_INDEX", "2"), ("TEST_TOTAL_SHARDS", "3")],
            "3/3",
            "Bazel",
        ),
        (
            &[("JOB_COMPLETION_INDEX", "0"), (SHARDS, "9")],
            "1/9",
            "Kubernetes",
        ),
        (
            &[
                ("AWS_BATCH_JOB_ARRAY_INDEX", "7"),
                ("AWS_BATCH_JOB_ARRAY_SIZE", "8"),
            ],
            "8/8",
            "AWS Batch",
        ),
        (
            &[("PARALLEL_SEQ", "5"), (SHARDS, "5")],
            "5/5",
            "GNU parallel",
        ),
        (&slurm("0", "0", "1", "20"), "1/20", "Slurm"),
        (&slurm("19", "0", "1", "20"), "20/20", "Slurm"),
        // --array=10-50:10
        (&slurm("30", "10", "10", "5"), "3/5", "Slurm"),
        (&grid("1", "1", "6", "1"), "1/6", "Grid Engine"),
        // -t 2-10:4
        (&grid("10", "2", "10", "4"), "3/3", "Grid Engine"),
    ];
    for (variables, shard, engine) in cases {
        assert_eq!(
            found(variables),
            Ok(((*shard).to_owned(), *engine)),
            "{variables:?}"
        );
    }
}

fn slurm<'a>(id: &'a str, min: &'a str, step: &'a str, count: &'a str) -> [(&'a str, &'a str); 4] {
    [
        ("SLURM_ARRAY_TASK_ID", id),
        ("SLURM_ARRAY_TASK_MIN", min),
        ("SLURM_ARRAY_TASK_STEP", step),
        ("SLURM_ARRAY_TASK_COUNT", count),
    ]
}

fn grid<'a>(id: &'a str, first: &'a str, last: &'a str, step: &'a str) -> [(&'a str, &'a str); 4] {
    [
        ("SGE_TASK_ID", id),
        ("SGE_TASK_FIRST", first),
        ("SGE_TASK_LAST", last),
        ("SGE_TASK_STEPSIZE", step),
    ]
}

#[test]
fn what_is_missing_or_in_doubt_is_refused() {
    let cases: &[(Variables<'_>, &str)] = &[
        (&[], "none of CI_NODE_INDEX"),
        (&[("SGE_TASK_ID", "undefined")], "none of CI_NODE_INDEX"),
        (&[("JOB_COMPLETION_INDEX", "3")], "SIM_SHARDS is not"),
        (
            &[("CI_NODE_INDEX", "0"), ("CI_NODE_TOTAL", "4")],
            "which is none of the 4 numbers from 1",
        ),
        (
            &[("CIRCLE_NODE_INDEX", "4"), ("CIRCLE_NODE_TOTAL", "4")],
            "which is none of",
        ),
        (
            &[("CI_NODE_INDEX", "one"), ("CI_NODE_TOTAL", "4")],
            "not a number",
        ),
        // --array=1,3,7
        (&slurm("7", "1", "1", "3"), "an array with gaps"),
        (
            &[
                ("CI_NODE_INDEX", "1"),
                ("CI_NODE_TOTAL", "4"),
                ("JOB_COMPLETION_INDEX", "2"),
                (SHARDS, "4"),
            ],
            "GitLab says shard 1/4 (CI_NODE_INDEX), Kubernetes says 3/4",
        ),
    ];
    for (variables, why) in cases {
        let error = found(variables).unwrap_err();
        assert!(error.contains(why), "{variables:?}: {error}");
    }
    // Two that agree are in no doubt.
    let both = [
        ("CI_NODE_INDEX", "3"),
        ("CI_NODE_TOTAL", "4"),
        ("JOB_COMPLETION_INDEX", "2"),
        (SHARDS, "4"),
    ];
    assert_eq!(found(&both).map(|(shard, _)| shard), Ok("3/4".to_owned()));
}
