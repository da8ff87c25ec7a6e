//! Makes the settings of a room from a table that is declared.

use super::{OptionalKey, RequiredKey};

/// Makes `settings` of a table: from its keys, each as `key [default] [field that it fills]`, and from the block after `fills`.
/// The rules that begin with `@` take one key after the other, and put each field before those that are there.
#[macro_export]
macro_rules! fill_settings {
    ($table:ident { $($field:ident [$($default:tt)?] [])+ }) => {};
    ($table:ident { $($keys:tt)+ }) => {
        compile_error!("a key has an arrow, and its table has no `fills`");
    };
    (
        $table:ident { $($keys:tt)+ }
        $settings:ident with |$file:ident $(, $given:ident: $type:ty)*| { $($others:tt)* }
    ) => {
        impl $table {
            /// The settings that the table fills; `None` if a value that it takes is invalid.
            pub fn settings(&self $(, $given: $type)*) -> Option<$settings> {
                let $file = self;
                $crate::toml_file::fill::fill_settings!(
                    @ $settings $file { $($others)* } $($keys)+
                )
            }
        }
    };
    (@ $settings:ident $file:ident { $($fields:tt)* }) => { Some($settings { $($fields)* }) };
    (@ $settings:ident $file:ident $fields:tt $field:ident [$($default:tt)?] [] $($keys:tt)*) => {
        $crate::toml_file::fill::fill_settings!(@ $settings $file $fields $($keys)*)
    };
    (
        @ $settings:ident $file:ident { $($fields:tt)* }
        $field:ident [] [$target:ident] $($keys:tt)*
    ) => {
        $crate::toml_file::fill::fill_settings!(@ $settings $file {
            $target: $crate::toml_file::fill::KeyValue::value(&$file.$field)?, $($fields)*
        } $($keys)*)
    };
    (
        @ $settings:ident $file:ident { $($fields:tt)* }
        $field:ident [$default:tt] [$target:ident] $($keys:tt)*
    ) => {
        $crate::toml_file::fill::fill_settings!(@ $settings $file {
            $target: $file.$field()?, $($fields)*
        } $($keys)*)
    };
}
pub use fill_settings;

/// A key without a default, as settings have it.
pub trait KeyValue {
    /// `T` for a required key, `Option<T>` for one that may be left out.
    type Value;

    /// The value; `None` if it is invalid.
    fn value(&self) -> Option<Self::Value>;
}

impl<T: Clone> KeyValue for RequiredKey<T> {
    type Value = T;

    fn value(&self) -> Option<T> {
        self.as_ref().map(|written| written.value.clone())
    }
}

impl<T: Clone> KeyValue for OptionalKey<T> {
    type Value = Option<T>;

    fn value(&self) -> Option<Option<T>> {
        self.clone().optional()
    }
}

#[cfg(test)]
mod tests {
    use super::super::declare::{declare_table, optional, required};
    use super::super::values::ValueKind;
    use super::super::{OptionalKey, RequiredKey, TableReader, document};

    #[derive(Debug, PartialEq)]
    pub struct PumpSettings {
        number: u8,
        name: Option<String>,
        speed: u8,
        is_small: bool,
        place: String,
        most: u8,
    }

    declare_table! {
        /// A pump.
        PumpFile is "[pump]" {
            /// Its number.
            number: RequiredKey<u8> = required(ValueKind::number(1..=9)) => number;
            /// Its name.
            name: OptionalKey<String> = optional(ValueKind::text()), without "none" => name;
            /// Its speed.
            speed: OptionalKey<u8> = optional(ValueKind::number(1..=9)), default 5 => speed;
            /// Whether it is small.
            small: OptionalKey<bool> = optional(ValueKind::flag()), or false => is_small;
            /// How many more there may be.
            more: OptionalKey<u8> = optional(ValueKind::number(0..=9)), default 0;
        } fills PumpSettings with |file, place: &str| {
            place: place.to_owned(),
            most: file.more()? + 1
        }
    }

    fn settings(text: &str) -> Option<PumpSettings> {
        let mut problems = Vec::new();
        let document = document(text, &mut problems).unwrap();
        let file = PumpFile::read(TableReader::new(document.section(), &mut problems));
        let settings = file.settings("cellar");
        assert_eq!(settings.is_none(), !problems.is_empty(), "{problems:?}");
        settings
    }

    #[test]
    fn settings_have_the_values_of_the_keys_and_of_the_block() {
        let defaults = PumpSettings {
            number: 1,
            name: None,
            speed: 5,
            is_small: false,
            place: "cellar".to_owned(),
            most: 1,
        };
        assert_eq!(settings("number = 1"), Some(defaults));
        let declared = PumpFile::declared().keys;
        assert!(declared.iter().all(|key| key.has_valid_default));
        let text = "number = 2\nname = 'a'\nspeed = 3\nsmall = true\nmore = 4";
        let given = PumpSettings {
            number: 2,
            name: Some("a".to_owned()),
            speed: 3,
            is_small: true,
            place: "cellar".to_owned(),
            most: 5,
        };
        assert_eq!(settings(text), Some(given));
    }

    #[test]
    fn there_are_no_settings_without_a_value_that_they_need() {
        for text in [
            "",
            "number = 0",
            "number = 1\nname = 2",
            "number = 1\nspeed = 0",
            "number = 1\nsmall = 0",
            "number = 1\nmore = 10",
        ] {
            assert_eq!(settings(text), None, "{text}");
        }
    }
}
