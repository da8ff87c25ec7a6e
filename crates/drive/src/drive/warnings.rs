//! What a drive warns of. A warning is only shown: it stops no motor, refuses no order and is no trip.

use crate::profile::model::{CodeText, Model, RegisterRole};
use crate::profile::value::codes_of_bits;

/// The number of the warning that the model's warning register shows with `shown`, 0 for none; of bits, the number of
/// the lowest + 1.
#[must_use]
pub fn code(model: &Model, shown: u32) -> u16 {
    if are_bits(model) {
        codes_of_bits(shown).next().unwrap_or(0)
    } else {
        u16::try_from(shown).unwrap_or(u16::MAX)
    }
}

/// The vendor's texts for all warnings that it shows with `shown`, each marked if it is unproven; `None` if it shows
/// none.
#[must_use]
pub fn text(model: &Model, shown: u32) -> Option<String> {
    if shown == 0 {
        return None;
    }
    let text = |code, unknown: String| model.warning_text(code).map_or(unknown, CodeText::marked);
    if !are_bits(model) {
        return Some(text(code(model, shown), format!("code {shown}")));
    }
    let texts: Vec<_> = codes_of_bits(shown)
        .map(|code| text(code, format!("bit {}", code - 1)))
        .collect();
    Some(texts.join("; "))
}

fn are_bits(model: &Model) -> bool {
    model
        .warning_register()
        .is_some_and(|register| register.role == Some(RegisterRole::WarningBits))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::model::Confidence;
    use crate::vendors::testing::model;

    fn warning(role: RegisterRole) -> Model {
        let mut model = model();
        model.registers.truncate(1);
        model.registers[0].role = Some(role);
        let text = |code, text: &str, confidence| CodeText {
            code,
            text: text.to_owned(),
            confidence,
            source: "IM 1".to_owned(),
        };
        model.warning_codes = vec![
            text(1, "hot", Confidence::Manual),
            text(4, "fan", Confidence::Inferred),
        ];
        model
    }

    #[test]
    fn a_code_is_one_warning_and_each_bit_is_one() {
        let codes = warning(RegisterRole::WarningCode);
        let bits = warning(RegisterRole::WarningBits);
        assert_eq!((code(&codes, 0), text(&codes, 0)), (0, None));
        assert_eq!(
            (code(&codes, 4), text(&codes, 4).as_deref()),
            (4, Some("fan (inferred)"))
        );
        assert_eq!(text(&codes, 9).as_deref(), Some("code 9"));
        assert_eq!((code(&bits, 0), text(&bits, 0)), (0, None));
        assert_eq!(
            (code(&bits, 0x8008), text(&bits, 0x8008).as_deref()),
            (4, Some("fan (inferred); bit 15"))
        );
        assert_eq!((code(&bits, 0x8000), code(&bits, 9)), (16, 1));
        assert_eq!(text(&bits, 9).as_deref(), Some("hot; fan (inferred)"));
    }
}
