//! Makes the settings of a room from a table that is declared.

use super::{OptionalKey, RequiredKey};

/// Makes `settings` of a table: from its keys, each with its default and the field that it fills, and from the block after
/// `fills`.
#[macro_export]
macro_rules! fill_settings {
    ($table:ident { $($keys:tt)+ }) => {};
    (
        $table:ident { $($keys:tt)+ }
        $settings:ident with |$file:ident $(, $given:ident: $type:ty)*| { $($others:tt)* }
    ) => {
        impl $table {
            /// The settings that the table fills; `None` if one of its values is invalid.
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
            $($fields)* $target: $crate::toml_file::fill::KeyValue::value(&$file.$field)?,
        } $($keys)*)
    };
    (
        @ $settings:ident $file:ident { $($fields:tt)* }
        $field:ident [$default:tt] [$target:ident] $($keys:tt)*
    ) => {
        $crate::toml_file::fill::fill_settings!(@ $settings $file {
            $($fields)* $target: $file.$field()?,
        } $($keys)*)
    };
}
pub use fill_settings;

/// A key without a default, as settings have it.
pub trait KeyValue {
    /// Its value, or `None` in it if the key may be left out.
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
