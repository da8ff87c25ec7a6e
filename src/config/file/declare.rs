//! Declares a table of the file: the names of its keys, and for each its type, valid values, default and purpose.

use crate::domain::problem::Problem;
use crate::toml_file::values::ValueKind;
use crate::toml_file::{LocatedValue, OptionalKey, RequiredKey, TableReader, document};

/// Declares a table of the file.
///
/// ```ignore
/// declare_table! {
///     /// `[journal]`
///     JournalFile is "[journal]" at location, refuses NOT_SERVED {
///         /// Maximum size of the journal file.
///         max_size: OptionalKey<u64> = optional(size()), default "64MB" => max_bytes;
///         /// The name of the journal.
///         name: OptionalKey<Name> = optional(name()), without "the gateway's name";
///     } fills JournalSettings with |file, directory: PathBuf| { directory, }
/// }
/// ```
///
/// Made from it:
///
/// * the struct `JournalFile`, with a field for each key and, after `at`, one for the location of the table;
/// * `JournalFile::read`, which reads the table and reports all mistakes in it. `refuses` names a list of [`RefusedKey`];
/// * for a key with a default, a method of its name: `max_size()` is the value, or the default if the key is left out;
/// * with `fills`, the method `settings`, which makes the settings of the room that uses the table: each field that an arrow
///   names has the value of its key, and the block after `fills` has all other fields, made from what is given;
/// * the rows of the table in `docs/configuration.md`. The comment of a key is its sentence there.
///
/// A default is written as in the file (`default "64MB"`), or is a time of another room (`constant ControlSettings::DELAY`).
/// `without` says in words what a missing key means. A key with none of them is required. A field that is not called like
/// its key names it: `lines as "line"`.
macro_rules! declare_table {
    (
        $(#[$comment:meta])*
        $table:ident is $header:literal $(at $location:ident)? $(, refuses $refused:path)? {
            $(
                $(#[doc = $about:literal])+
                $field:ident $(as $key:literal)? : $type:ty = $form:expr
                $(, default $default:literal)?
                $(, constant $constant:path)?
                $(, without $words:expr)?
                $(=> $target:ident)?;
            )+
        } $(fills $($fills:tt)+)?
    ) => {
        $(#[$comment])*
        #[derive(Clone, Debug, Default)]
        pub struct $table {
            $(
                /// Where the table stands.
                pub $location: $crate::toml_file::KeyLocation,
            )?
            $($(#[doc = $about])+ pub $field: $type,)+
        }

        impl $table {
            /// Reads the table, and reports every mistake in it.
            pub fn read(mut reader: $crate::toml_file::TableReader<'_, '_>) -> Self {
                $($crate::config::file::declare::refuse(&mut reader, &$refused);)?
                let table = Self {
                    $($location: reader.location().clone(),)?
                    $($field: $form.read(&mut reader, [$($key,)? stringify!($field)][0]),)+
                };
                reader.finish();
                table
            }

            $($(
                /// The value, or the default if the key is left out; `None` if the value is invalid.
                pub fn $field(
                    &self,
                ) -> Option<<$type as $crate::config::file::declare::WithDefault>::Value> {
                    $crate::config::file::declare::or_default(&self.$field, || $form, stringify!($default))
                }
            )?)+

            $($(
                /// The value, or the default if the key is left out; `None` if the value is invalid.
                pub fn $field(&self) -> Option<std::time::Duration> {
                    self.$field.or($constant)
                }
            )?)+

            /// The table as it is declared.
            #[cfg(test)]
            pub fn declared() -> $crate::config::file::declare::DeclaredTable {
                use $crate::config::file::declare;
                let keys = vec![$(declare::DeclaredKey {
                    name: [$($key,)? stringify!($field)][0],
                    notation: $form.notation,
                    default: [
                        $(Some(stringify!($default).to_owned()),)?
                        $(Some(format!("\"{}\"", $crate::toml_file::values::duration_text($constant))),)?
                        $(Some($words.to_owned()),)?
                        None,
                    ][0].clone(),
                    has_valid_default: [
                        $(declare::or_default(&<$type>::default(), || $form, stringify!($default)).is_some(),)?
                        true,
                    ][0],
                    about: [$($about),+].map(str::trim).join(" "),
                }),+];
                declare::DeclaredTable {
                    header: $header,
                    keys,
                    refused: [$($refused,)? &[]][0],
                }
            }
        }

        $crate::toml_file::fill::fill_settings! {
            $table { $($field [$($default)? $($constant)?] [$($target)?])+ } $($($fills)+)?
        }
    };
}
pub(super) use declare_table;

/// A key that is known but refused, because an operator who wrote it would rely on a missing function.
#[derive(Clone, Copy, Debug)]
pub struct RefusedKey {
    /// Its name.
    pub name: &'static str,
    /// Why it is refused; `None`: nothing serves it.
    pub what: Option<&'static str>,
    /// The alternative.
    pub instead: &'static str,
}

/// Refuses each of `keys` that the table has.
pub fn refuse(reader: &mut TableReader<'_, '_>, keys: &[RefusedKey]) {
    for key in keys {
        reader.refuse(key.name, key.what, key.instead);
    }
}

/// How a key is read, and what is valid for it.
pub struct KeyForm<'k, W> {
    read: Box<ReadKey<'k, W>>,
    /// The valid values as the reference lists them.
    pub notation: String,
}

type ReadKey<'k, W> = dyn Fn(&mut TableReader<'_, '_>, &'static str) -> W + 'k;

impl<'k, W> KeyForm<'k, W> {
    /// A key that `read` reads, listed in the reference as `notation`.
    pub fn new(
        notation: impl Into<String>,
        read: impl Fn(&mut TableReader<'_, '_>, &'static str) -> W + 'k,
    ) -> Self {
        Self {
            read: Box::new(read),
            notation: notation.into(),
        }
    }

    /// This form, listed in the reference as `notation`.
    #[must_use]
    pub fn listed_as(mut self, notation: impl Into<String>) -> Self {
        self.notation = notation.into();
        self
    }

    /// Reads `key`.
    pub fn read(&self, reader: &mut TableReader<'_, '_>, key: &'static str) -> W {
        (self.read)(reader, key)
    }
}

/// A value that must be there.
pub fn required<'k, T: 'k>(kind: ValueKind<'k, T>) -> KeyForm<'k, RequiredKey<T>> {
    KeyForm::new(kind.notation().to_owned(), move |reader, key| {
        reader.required(key, &kind)
    })
}

/// A value.
pub fn optional<'k, T: 'k>(kind: ValueKind<'k, T>) -> KeyForm<'k, OptionalKey<T>> {
    KeyForm::new(kind.notation().to_owned(), move |reader, key| {
        reader.optional(key, &kind)
    })
}

/// A list of values.
pub fn list<'k, T: 'k>(kind: ValueKind<'k, T>) -> KeyForm<'k, OptionalKey<Vec<LocatedValue<T>>>> {
    KeyForm::new(list_of(&kind), move |reader, key| reader.list(key, &kind))
}

/// A list of values that must be there.
pub fn required_list<'k, T: 'k>(
    kind: ValueKind<'k, T>,
) -> KeyForm<'k, RequiredKey<Vec<LocatedValue<T>>>> {
    KeyForm::new(list_of(&kind), move |reader, key| {
        reader.required_list(key, &kind)
    })
}

/// How the reference lists a list of values of `kind`, of which each may be there.
fn list_of<T>(kind: &ValueKind<'_, T>) -> String {
    format!("list of {}", kind.notation().replace(" or ", ", "))
}

/// A table, read by `read`.
pub fn table<'k, T: 'k>(read: fn(TableReader<'_, '_>) -> T) -> KeyForm<'k, OptionalKey<T>> {
    KeyForm::new("table", move |reader, key| reader.inner(key, read))
}

/// Tables in double brackets, each read by `read`.
pub fn tables<'k, T: 'k>(read: fn(TableReader<'_, '_>) -> T) -> KeyForm<'k, Vec<T>> {
    KeyForm::new("tables", move |reader, key| each(reader, key, read))
}

/// The tables `[[key]]`, each read by `read`.
pub fn each<'a, T>(
    reader: &mut TableReader<'a, '_>,
    key: &'static str,
    read: impl Fn(TableReader<'a, '_>) -> T,
) -> Vec<T> {
    let sections = reader.tables(key);
    sections
        .into_iter()
        .map(|section| read(reader.open(section)))
        .collect()
}

/// A key that may have a default.
pub trait WithDefault {
    /// Its value.
    type Value;
}

impl<T> WithDefault for OptionalKey<T> {
    type Value = T;
}

/// The value `given`, or `default`, which is written as in a file; `None` if the value is invalid.
pub fn or_default<'k, T: Clone>(
    given: &OptionalKey<T>,
    form: impl FnOnce() -> KeyForm<'k, OptionalKey<T>>,
    default: &str,
) -> Option<T> {
    if !matches!(given, OptionalKey::Absent) {
        return given.clone().optional().flatten();
    }
    let mut problems: Vec<Problem> = Vec::new();
    let text = format!("default = {default}");
    let document = document(&text, &mut problems)?;
    let mut reader = TableReader::new(document.section(), &mut problems);
    form().read(&mut reader, "default").optional().flatten()
}

/// A table as it is declared.
#[cfg(test)]
pub struct DeclaredTable {
    /// Its header.
    pub header: &'static str,
    /// Its keys.
    pub keys: Vec<DeclaredKey>,
    /// Keys that are known but refused.
    pub refused: &'static [RefusedKey],
}

/// A key as it is declared.
#[cfg(test)]
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeclaredKey {
    /// Its name.
    pub name: &'static str,
    /// Its valid values, as the reference lists them.
    pub notation: String,
    /// Its default; `None` if it is required.
    pub default: Option<String>,
    /// Whether its default is one of the valid values, if it is not given in words.
    pub has_valid_default: bool,
    /// Its purpose.
    pub about: String,
}
