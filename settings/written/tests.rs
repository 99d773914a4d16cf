use super::*;

#[test]
fn what_is_written_reads_back() {
    for text in ["250ms", "3s", "1500us"] {
        assert_eq!(text.parse::<Span>().unwrap().to_string(), text);
    }
    assert_eq!("0.25 kW".parse::<Power>(), Ok(Power(250.0)));
    assert_eq!(Power(250.0).to_string().parse(), Ok(Power(250.0)));
    assert!(
        "-1 kg"
            .parse::<Mass>()
            .unwrap_err()
            .contains("out of range")
    );
    assert!("1 V".parse::<Mass>().unwrap_err().contains("not a unit"));
    assert!("nan kg".parse::<Mass>().is_err());
    assert!("5".parse::<Span>().is_err());
    assert!("-5s".parse::<Span>().is_err());
}
