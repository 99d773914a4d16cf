use super::*;

fn distances(strip: &Strip, point: [f64; 2]) -> f64 {
    let bands = strip.bands();
    let nearest = |best: f64, band: &Band| best.min(band.square_distance(point));
    bands.iter().fold(f64::INFINITY, nearest).sqrt()
}

#[test]
fn a_rounded_corner_is_an_arc_that_touches_both_sides() {
    for corner in [[2.0, 0.0], [2.0, 2.0]] {
        let strip = Strip {
            points: vec![[0.0, 0.0], corner, [2.0, 5.0]],
            closed: false,
            corner_radius: 0.5,
        };
        let line = strip.line();
        assert!(line.len() > 8);
        // It neither kinks nor leaves the sides before the corner.
        let mut before = from(line[0], line[1]);
        for pair in line.windows(2).skip(1) {
            let after = from(pair[0], pair[1]);
            let cos = dot(before, after) / (square(before) * square(after)).sqrt();
            assert!(cos > libm::cos(1.01 * MOST_TURN), "{line:?}");
            before = after;
        }
    }
    let square_corner = Strip {
        points: vec![[0.0, 0.0], [2.0, 0.0], [2.0, 5.0]],
        closed: false,
        corner_radius: 0.5,
    };
    let diagonal = 0.5 * (1.0 - 0.5_f64.sqrt());
    let on_arc = [2.0 - diagonal, diagonal];
    assert!(distances(&square_corner, on_arc) < 1e-3);
    assert!(distances(&square_corner, [2.0, 0.0]) > 0.15);
}

#[test]
fn odd_lines_do_no_harm() {
    for points in [
        vec![],
        vec![[1.0, 1.0]],
        vec![[0.0, 0.0], [0.0, 0.0]],
        vec![[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]],
        vec![[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 0.0], [3.0, 0.0]],
    ] {
        for closed in [false, true] {
            let strip = Strip {
                points: points.clone(),
                closed,
                corner_radius: 1e3,
            };
            let line = strip.line();
            assert!(
                line.iter().flatten().all(|part| part.is_finite()),
                "{line:?}"
            );
            assert!(!distances(&strip, [0.5, 0.0]).is_nan());
        }
    }
}
