//! Quantities written with their units: `250ms`, `48 V`, `0.3ohm`.

/// Units of one dimension with the factor to the first of them, which is the dimension's base.
type Dimension = &'static [(&'static str, f64)];

const DIMENSIONS: &[Dimension] = &[
    &[
        ("s", 1.0),
        ("ms", 1e-3),
        ("us", 1e-6),
        ("µs", 1e-6),
        ("ns", 1e-9),
        ("min", 60.0),
        ("h", 3600.0),
    ],
    &[("m", 1.0), ("mm", 1e-3), ("cm", 1e-2), ("km", 1e3)],
    &[("m/s", 1.0), ("mm/s", 1e-3), ("km/h", 1.0 / 3.6)],
    &[("m/s^2", 1.0)],
    &[("kg", 1.0), ("g", 1e-3), ("t", 1e3)],
    &[("kg*m^2", 1.0)],
    &[("N", 1.0), ("kN", 1e3)],
    &[("N*s", 1.0)],
    &[("N*m", 1.0), ("mN*m", 1e-3)],
    &[("V", 1.0), ("mV", 1e-3), ("kV", 1e3)],
    &[("A", 1.0), ("mA", 1e-3), ("uA", 1e-6), ("kA", 1e3)],
    &[("A^2*s", 1.0)],
    &[("Ah", 1.0), ("mAh", 1e-3)],
    &[("W", 1.0), ("mW", 1e-3), ("kW", 1e3)],
    &[
        ("ohm", 1.0),
        ("mohm", 1e-3),
        ("kohm", 1e3),
        ("Mohm", 1e6),
        ("Ω", 1.0),
        ("mΩ", 1e-3),
    ],
    &[("Hz", 1.0), ("kHz", 1e3), ("MHz", 1e6)],
    &[
        ("deg", 1.0),
        ("°", 1.0),
        ("rad", 180.0 / std::f64::consts::PI),
    ],
    &[("degC", 1.0), ("°C", 1.0)],
    &[("K", 1.0)],
    &[("rpm", 1.0), ("r/min", 1.0)],
    &[("%", 1.0)],
    &[("baud", 1.0), ("Bd", 1.0)],
    &[("V*s/rad", 1.0)],
    &[("B", 1.0), ("bytes", 1.0)],
];

/// Reads `text`, a number with its unit, as a number of `unit`.
///
/// An empty `unit` takes a bare number only. Otherwise only 0 as a time may lack its unit.
///
/// # Errors
/// Says in words what is wrong; NaN and infinities are refused.
pub fn parse_quantity(text: &str, unit: &str) -> Result<f64, String> {
    let text = text.trim();
    // The exponent of `1e-3` is a letter too, so the longest prefix that is a number counts.
    let split = (0..=text.len())
        .rev()
        .filter(|&at| text.is_char_boundary(at))
        .find(|&at| text[..at].trim_end().parse::<f64>().is_ok())
        .ok_or_else(|| format!("`{text}` does not begin with a number"))?;
    let (number, suffix) = (text[..split].trim_end(), text[split..].trim());
    let number: f64 = number
        .parse()
        .map_err(|_| format!("`{number}` is not a number"))?;
    if !number.is_finite() {
        return Err(format!("`{text}` is not a finite number"));
    }
    if suffix.is_empty() {
        return match unit.is_empty() || unit == "s" && number == 0.0 {
            true => Ok(number),
            false => Err(lacks_unit(text, unit)),
        };
    }
    if suffix == unit {
        return Ok(number);
    }
    let dimension = DIMENSIONS
        .iter()
        .find(|units| factor(units, unit).is_some());
    let scale = dimension.and_then(|units| Some(factor(units, suffix)? / factor(units, unit)?));
    scale
        .map(|scale| number * scale)
        .ok_or_else(|| match dimension {
            Some(units) => {
                let names: Vec<&str> = units.iter().map(|(name, _)| *name).collect();
                format!("`{suffix}` is not a unit of it; use {}", names.join(", "))
            }
            None => format!("a bare number is wanted, without `{suffix}`"),
        })
}

/// The error of a number without its unit.
pub(crate) fn lacks_unit(number: impl std::fmt::Display, unit: &str) -> String {
    match unit {
        "s" => format!("{number} lacks a unit, as in \"{number}s\" or \"{number}ms\""),
        _ => format!("{number} lacks a unit, as in \"{number} {unit}\""),
    }
}

/// A regular expression for text that [`parse_quantity`] takes for `unit`.
pub(crate) fn pattern(unit: &str) -> String {
    let units = DIMENSIONS
        .iter()
        .find(|units| factor(units, unit).is_some());
    let escape = |name: &str| {
        let special = |c: char| matches!(c, '*' | '^' | '.' | '+');
        name.chars()
            .flat_map(|c| special(c).then_some('\\').into_iter().chain([c]))
            .collect::<String>()
    };
    let names: Vec<String> = units.map_or_else(
        || vec![escape(unit)],
        |units| units.iter().map(|(name, _)| escape(name)).collect(),
    );
    format!(
        "^[-+]?([0-9]+\\.?[0-9]*|\\.[0-9]+)([eE][-+]?[0-9]+)? *({})$",
        names.join("|")
    )
}

fn factor(units: Dimension, name: &str) -> Option<f64> {
    units
        .iter()
        .find(|(unit, _)| *unit == name)
        .map(|(_, factor)| *factor)
}
