use super::*;

#[test]
fn only_the_total_of_skipped_tests_goes() {
    let mut report = Report::new("a > b");
    let mut suite = TestSuite::new("suite");
    suite.add_test_case(TestCase::new("case", TestCaseStatus::skipped()));
    report.add_test_suite(suite);
    let text = document(&mut report).unwrap();
    assert_eq!(text.matches("skipped=\"1\"").count(), 1, "{text}");
    assert!(text.contains("<testsuite name=\"suite\" tests=\"1\" skipped=\"1\""));
}
