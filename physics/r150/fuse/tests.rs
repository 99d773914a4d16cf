use super::*;

#[test]
fn each_fuse_carries_the_manuals_rating_and_not_twice_that() {
    let fuses = Fuse::all(&FuseSettings::default());
    for (fuse, rating) in fuses.iter().zip([50.0, 50.0, 60.0, 5.0]) {
        assert_eq!(fuse.time_to_blow(rating), None);
        let seconds = fuse.time_to_blow(2.0 * rating).unwrap();
        assert!((4.0..6.0).contains(&seconds), "{seconds}");
    }
}
