use super::*;

#[test]
fn a_shard_counts_from_one_to_the_number_of_shards() {
    let parse = |text: &str| text.parse::<ShardArg>();
    assert_eq!(
        parse("3/20"),
        Ok(ShardArg::Given(Shard { index: 3, of: 20 }))
    );
    assert_eq!(parse("auto"), Ok(ShardArg::Auto));
    for wrong in ["0/3", "4/3", "3", "a/3", "1/0", "1/100001", "-1/3", ""] {
        assert!(parse(wrong).is_err(), "{wrong}");
    }
}

#[test]
fn each_case_has_one_owner_and_shards_are_about_equal() {
    let mut counts = [0_u32; 7];
    for seed in 0..7000 {
        let owner = Shard::owner(7, "a.toml", &[], &[], seed);
        counts[owner as usize - 1] += 1;
    }
    assert!(
        counts.iter().all(|count| (850..1150).contains(count)),
        "{counts:?}"
    );
    let other = |parameters: &[(&str, &str)], set: &[&str]| {
        let parameters = parameters
            .iter()
            .map(|(name, value)| ((*name).into(), (*value).into()));
        let parameters: Vec<(String, String)> = parameters.collect();
        let set: Vec<String> = set.iter().map(|set| (*set).to_owned()).collect();
        Shard::owner(MOST_SHARDS, "a.toml", &parameters, &set, 1)
    };
    let owners = [
        other(&[], &[]),
        other(&[("a", "b")], &[]),
        other(&[], &["a", "b"]),
    ];
    assert!(owners[0] != owners[1] && owners[1] != owners[2] && owners[0] != owners[2]);
}
