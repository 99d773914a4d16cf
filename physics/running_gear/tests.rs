use super::*;

fn ends(part: f64, step: f64, sudden: &[f64]) -> Vec<f64> {
    let mut ends = Vec::new();
    while ends.last().is_none_or(|end| *end < step) {
        let from = ends.last().copied().unwrap_or(0.0);
        ends.push(next_part(from, part, step, sudden).to);
    }
    ends
}

#[test]
fn a_step_is_cut_into_equal_parts_and_where_something_changes() {
    let cut = |part, step, sudden: &[f64], wanted: &[f64]| {
        let ends = ends(part, step, sudden);
        let near = ends.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-12);
        assert!(ends.len() == wanted.len() && near, "{ends:?} {wanted:?}");
        assert_eq!(ends.last(), wanted.last());
    };
    cut(5e-3, 5e-3, &[], &[5e-3]);
    cut(1.25e-3, 5e-3, &[], &[1.25e-3, 2.5e-3, 3.75e-3, 5e-3]);
    cut(5e-3, 5e-3, &[1e-3, 4e-3], &[1e-3, 4e-3, 5e-3]);
    cut(2.5e-3, 5e-3, &[1e-3, 4e-3], &[1e-3, 2.5e-3, 4e-3, 5e-3]);
    // A hair before and after each end, and after one another.
    let hair = SHORTEST * 0.9;
    cut(
        2.5e-3,
        5e-3,
        &[hair, 2.5e-3 - hair, 2.5e-3 + hair, 5e-3 - hair],
        &[2.5e-3, 5e-3],
    );
    cut(
        5e-3,
        5e-3,
        &[1e-3, 1e-3 + hair, 1e-3 + 2.0 * hair],
        &[1e-3, 1e-3 + 2.0 * hair, 5e-3],
    );
    cut(
        SHORTEST / 2.0,
        SHORTEST / 2.0,
        &[SHORTEST / 4.0],
        &[SHORTEST / 2.0],
    );
    // None of no length, and nothing outside of it.
    cut(f64::NAN, 0.0, &[0.0], &[0.0]);
    cut(5e-3, 5e-3, &[-1.0, 0.0, 5e-3, 1.0], &[5e-3]);
}
