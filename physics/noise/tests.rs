use super::*;

#[test]
fn streams_repeat_and_differ_by_seed_and_name() {
    let first = |seed, name| Noise::new(seed, name).uniform().to_bits();
    assert_eq!(first(1, "a"), first(1, "a"));
    assert_ne!(first(1, "a"), first(2, "a"));
    assert_ne!(first(1, "a"), first(1, "b"));
}

#[test]
fn normal_has_mean_zero_and_deviation_one() {
    let mut noise = Noise::new(7, "test");
    let drawn: Vec<f64> = (0..20_000).map(|_| noise.normal()).collect();
    let mean = drawn.iter().sum::<f64>() / 20_000.0;
    let variance = drawn.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / 20_000.0;
    assert!(mean.abs() < 0.03, "{mean}");
    assert!((variance - 1.0).abs() < 0.05, "{variance}");
}
