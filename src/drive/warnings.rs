//! What a drive warns of. A warning is only shown: it stops no motor, refuses no order and is no trip.

use crate::profile::model::{Model, Role};

/// The number of the warning that `word` of the model's warning register shows, 0 for none; of bits, the number of the
/// lowest + 1.
#[must_use]
pub fn code(model: &Model, word: u16) -> u16 {
    if word == 0 || !are_bits(model) {
        return word;
    }
    u16::try_from(word.trailing_zeros() + 1).unwrap_or_default()
}

/// The vendor's texts for all warnings that `word` shows, each marked if it is unproven; `None` if it shows none.
#[must_use]
pub fn text(model: &Model, word: u16) -> Option<String> {
    if word == 0 {
        return None;
    }
    if !are_bits(model) {
        return Some(text_of(model, word, || format!("code {word}")));
    }
    let set = (0..16_u16).filter(|bit| word >> bit & 1 == 1);
    let texts: Vec<_> = set.map(|bit| text_of(model, bit + 1, || format!("bit {bit}"))).collect();
    Some(texts.join("; "))
}

fn are_bits(model: &Model) -> bool {
    model.warning_register().is_some_and(|register| register.role == Some(Role::WarningBits))
}

fn text_of(model: &Model, code: u16, unknown: impl Fn() -> String) -> String {
    match model.warning_text(code) {
        Some(known) if known.confidence.is_proven() => known.text.clone(),
        Some(known) => format!("{} ({})", known.text, known.confidence.word()),
        None => unknown(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drive::testing::model;
    use crate::profile::model::{CodeText, Confidence};

    fn warning(role: Role) -> Model {
        let mut model = model();
        model.registers.truncate(1);
        model.registers[0].role = Some(role);
        let text = |code, text: &str, confidence| CodeText {
            code,
            text: text.to_owned(),
            confidence,
            source: "IM 1".to_owned(),
        };
        model.warning_codes = vec![text(1, "hot", Confidence::Manual), text(4, "fan", Confidence::Inferred)];
        model
    }

    #[test]
    fn a_code_is_one_warning_and_each_bit_is_one() {
        let codes = warning(Role::WarningCode);
        let bits = warning(Role::WarningBits);
        assert_eq!((code(&codes, 0), text(&codes, 0)), (0, None));
        assert_eq!((code(&codes, 4), text(&codes, 4).as_deref()), (4, Some("fan (inferred)")));
        assert_eq!(text(&codes, 9).as_deref(), Some("code 9"));
        assert_eq!((code(&bits, 0), text(&bits, 0)), (0, None));
        assert_eq!((code(&bits, 0x8008), text(&bits, 0x8008).as_deref()), (4, Some("fan (inferred); bit 15")));
        assert_eq!((code(&bits, 0x8000), code(&bits, 9)), (16, 1));
        assert_eq!(text(&bits, 9).as_deref(), Some("hot; fan (inferred)"));
    }
}
