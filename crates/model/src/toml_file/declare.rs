//! Declares a table of a file: the names of its keys, and for each its type, valid values, default and purpose.

use super::values::ValueKind;
use super::{LocatedValue, OptionalKey, RequiredKey, TableReader, document};
use crate::domain::problem::Problem;

/// Declares a table of a file.
///
/// ```ignore
/// declare_table! {
///     /// The journal.
///     JournalFile is "[journal]" at location, refuses NOT_SERVED {
///         /// Maximum size of the journal file.
///         max_size: OptionalKey<u64> = optional(size()), default "64MB" => max_bytes;
///         /// The name of the journal.
///         name: OptionalKey<Name> = optional(name()), without "the gateway's name";
///         /// Kept beside the journal.
///         copies after max_size: OptionalKey<u8> = copies(max_size), or 1;
///     } fills JournalSettings with |file, directory: PathBuf| { directory }
/// }
/// ```
///
/// Made from it:
///
/// * the struct `JournalFile`, with a field for each key and, after `at`, one for the location of the table;
/// * `JournalFile::read`, which reads the table and reports all mistakes in it, and `JournalFile::keys`, which reads its keys in
///   a table that has others as well. `refuses` names a list of [`RefusedKey`];
/// * for a key with a default, a method of its name: `max_size()` is the value, or the default if the key is left out;
/// * with `fills`, the method `settings`, which makes the settings of the room that uses the table: each field that an arrow
///   names has the value of its key, and the block after `fills` has all other fields. Between the bars, the first name stands
///   for the table as it was read, and the others are arguments of `settings`. In the block, `?` leaves `settings` with `None`.
///   A key without an arrow fills no field: the block reads it, or a rule between keys does;
/// * the rows of the table in its reference: `docs/configuration.md` or `docs/model-reference.md`. The comment of a key is its
///   sentence there.
///
/// A default is written as in the file (`default "64MB"`), is a value of the key's type (`or 1`), or a time of another room
/// (`constant ControlSettings::DELAY`). `without` says in words what a missing key means. A field that is not called like
/// its key names it: `lines as "line"`. What is valid may depend on keys before it, which are named after `after`. A table whose
/// keys need something more to be read takes it as an argument: `AreaFile is "[[read.area]]" with facts: &FactReader<'_>`.
#[macro_export]
macro_rules! declare_table {
    (
        $(#[doc = $says:literal])+
        $table:ident is $header:literal $(at $location:ident)? $(with $given:ident: $context:ty)?
            $(, refuses $refused:path)? {
            $(
                $(#[doc = $about:literal])*
                $field:ident $(as $key:literal)? $(after $earlier:ident)* : $type:ty = $form:expr
                $(, default $default:literal)?
                $(, constant $constant:path)?
                $(, or $value:expr)?
                $(, without $words:expr)?
                $(=> $target:ident)?;
            )+
        } $(fills $($fills:tt)+)?
    ) => {
        $(#[doc = $says])+
        #[derive(Clone, Debug, Default)]
        pub struct $table {
            $(
                /// Where the table stands.
                pub $location: $crate::toml_file::KeyLocation,
            )?
            $($(#[doc = $about])* pub $field: $type,)+
        }

        impl $table {
            /// Reads the table, and reports every mistake in it.
            #[allow(dead_code, reason = "the keys of some tables stand beside others")]
            pub fn read($($given: $context,)? mut reader: $crate::toml_file::TableReader<'_, '_>) -> Self {
                $($crate::toml_file::declare::refuse(&mut reader, &$refused);)?
                let table = Self::keys($($given,)? &mut reader);
                reader.finish();
                table
            }

            /// Reads the keys of the table, and reports every mistake in them.
            pub fn keys($($given: $context,)? reader: &mut $crate::toml_file::TableReader<'_, '_>) -> Self {
                let mut table = Self {
                    $($location: reader.location().clone(),)?
                    ..Self::default()
                };
                $({
                    $(let $earlier = &table.$earlier;)*
                    let value: $type = $form.read(reader, [$($key,)? stringify!($field)][0]);
                    table.$field = value;
                })+
                table
            }

            $($(
                /// The value, or the default if the key is left out; `None` if the value is invalid.
                pub fn $field(
                    &self,
                ) -> Option<<$type as $crate::toml_file::declare::WithDefault>::Value> {
                    $crate::toml_file::declare::or_default(&self.$field, || $form, stringify!($default))
                }
            )?)+

            $($(
                /// The value, or the default if the key is left out; `None` if the value is invalid.
                pub fn $field(&self) -> Option<std::time::Duration> {
                    self.$field.or($constant)
                }
            )?)+

            $($(
                /// The value, or the default if the key is left out; `None` if the value is invalid.
                pub fn $field(
                    &self,
                ) -> Option<<$type as $crate::toml_file::declare::WithDefault>::Value> {
                    self.$field.or($value)
                }
            )?)+

            $crate::toml_file::declare::in_tests! {
                /// The table as it is declared.
                #[allow(dead_code, reason = "references have not all tables")]
                pub fn declared($($given: $context)?) -> $crate::toml_file::declare::DeclaredTable {
                    use $crate::toml_file::declare;
                    let _table = Self::default();
                    let mut keys = Vec::new();
                    $({
                        $(let $earlier = &_table.$earlier;)*
                        let form: declare::KeyForm<'_, $type> = $form;
                        let about: &[&str] = &[$($about),*];
                        keys.push(declare::DeclaredKey {
                            name: [$($key,)? stringify!($field)][0],
                            valid: form.valid,
                            default: [
                                $(Some($words.to_owned()),)?
                                $(Some(stringify!($default).to_owned()),)?
                                $(Some(format!("\"{}\"", $crate::toml_file::values::duration_text($constant))),)?
                                $(Some(stringify!($value).to_owned()),)?
                                None,
                            ][0].clone(),
                            has_valid_default: [
                                $(declare::or_default(&_table.$field, || $form, stringify!($default)).is_some(),)?
                                true,
                            ][0],
                            about: about.iter().map(|line| line.trim()).collect::<Vec<_>>().join(" "),
                        });
                    })+
                    declare::DeclaredTable {
                        header: $header,
                        says: [$($says),+].map(str::trim).join(" "),
                        keys,
                        refused: [$($refused,)? &[]][0],
                    }
                }
            }
        }

        $crate::toml_file::fill::fill_settings! {
            $table { $($field [$($default)? $($constant)? $($value)?] [$($target)?])+ } $($($fills)+)?
        }
    };
}
pub use declare_table;

/// What only tests need, those of other crates included.
#[cfg(any(test, feature = "testing"))]
#[macro_export]
macro_rules! in_tests {
    ($($item:tt)+) => { $($item)+ };
}
/// What only tests need.
#[cfg(not(any(test, feature = "testing")))]
#[macro_export]
macro_rules! in_tests {
    ($($item:tt)+) => {};
}
pub use in_tests;

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
        match key.what {
            Some(what) => reader.refuse(key.name, what, key.instead),
            None => reader.refuse_unserved(key.name, key.instead),
        }
    }
}

/// How a key is read, and what is valid for it.
pub struct KeyForm<'k, W> {
    read: Box<ReadKey<'k, W>>,
    /// What is valid for it.
    pub valid: ValidValues,
}

type ReadKey<'k, W> = dyn Fn(&mut TableReader<'_, '_>, &'static str) -> W + 'k;

/// What is valid for a key, as references list it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ValidValues {
    /// In few words: `1 to 9`.
    pub notation: String,
    /// In the words of messages: `a whole number from 1 to 9`.
    pub right: String,
    /// Whether the key must be there.
    pub is_required: bool,
}

impl<'k, W> KeyForm<'k, W> {
    /// A key that `read` reads, listed in references as `notation`.
    pub fn new(
        notation: impl Into<String>,
        read: impl Fn(&mut TableReader<'_, '_>, &'static str) -> W + 'k,
    ) -> Self {
        let notation = notation.into();
        Self {
            read: Box::new(read),
            valid: ValidValues {
                right: notation.clone(),
                notation,
                is_required: false,
            },
        }
    }

    /// A key for which `kind` is valid, and which `read` reads.
    pub fn of<T: 'k>(
        kind: ValueKind<'k, T>,
        read: impl Fn(&mut TableReader<'_, '_>, &'static str, &ValueKind<'k, T>) -> W + 'k,
    ) -> Self {
        let (notation, right) = (kind.notation().to_owned(), kind.right().to_owned());
        Self::new(notation, move |reader, key| read(reader, key, &kind)).right(right)
    }

    /// This form, listed in references as `notation`.
    #[must_use]
    pub fn listed_as(mut self, notation: impl Into<String>) -> Self {
        self.valid.notation = notation.into();
        self
    }

    /// This form, for which messages call `right` valid.
    #[must_use]
    pub fn right(mut self, right: impl Into<String>) -> Self {
        self.valid.right = right.into();
        self
    }

    /// This form, of a key that must be there.
    #[must_use]
    pub fn needed(mut self) -> Self {
        self.valid.is_required = true;
        self
    }

    /// This form, whose value `turn` turns into another one.
    pub fn map<U>(self, turn: impl Fn(W) -> U + 'k) -> KeyForm<'k, U>
    where
        W: 'k,
    {
        KeyForm {
            read: Box::new(move |reader, key| turn((self.read)(reader, key))),
            valid: self.valid,
        }
    }

    /// Reads `key`.
    pub fn read(&self, reader: &mut TableReader<'_, '_>, key: &'static str) -> W {
        (self.read)(reader, key)
    }
}

/// A value that must be there.
pub fn required<'k, T: 'k>(kind: ValueKind<'k, T>) -> KeyForm<'k, RequiredKey<T>> {
    KeyForm::of(kind, |reader, key, kind| reader.required(key, kind)).needed()
}

/// A value.
pub fn optional<'k, T: 'k>(kind: ValueKind<'k, T>) -> KeyForm<'k, OptionalKey<T>> {
    KeyForm::of(kind, |reader, key, kind| reader.optional(key, kind))
}

/// A list of values.
pub fn list<'k, T: 'k>(kind: ValueKind<'k, T>) -> KeyForm<'k, OptionalKey<Vec<LocatedValue<T>>>> {
    listing(KeyForm::of(kind, |reader, key, kind| {
        reader.list(key, kind)
    }))
}

/// A list of values that must be there.
pub fn required_list<'k, T: 'k>(
    kind: ValueKind<'k, T>,
) -> KeyForm<'k, RequiredKey<Vec<LocatedValue<T>>>> {
    let form = KeyForm::of(kind, |reader, key, kind| reader.required_list(key, kind));
    listing(form).needed()
}

/// `form`, which reads a list of what is valid for it so far.
pub fn listing<W>(form: KeyForm<'_, W>) -> KeyForm<'_, W> {
    // Each of several words may be there.
    let notation = format!("list of {}", form.valid.notation.replace(" or ", ", "));
    let right = format!("a list, each {}", form.valid.right);
    form.listed_as(notation).right(right)
}

/// `form`, if the key exists here at all; otherwise the table has no such key.
pub fn only<'k, W: Default + 'k>(exists: bool, form: KeyForm<'k, W>) -> KeyForm<'k, W> {
    if exists {
        form
    } else {
        no_key(|_| W::default())
    }
}

/// What is no key of its own: `read` reads it from the table. References do not list it.
pub fn no_key<'k, W: 'k>(read: impl Fn(&mut TableReader<'_, '_>) -> W + 'k) -> KeyForm<'k, W> {
    KeyForm::new("", move |reader, _| read(reader))
}

/// A table, read by `read`.
pub fn table<'k, T: 'k>(
    read: impl Fn(TableReader<'_, '_>) -> T + 'k,
) -> KeyForm<'k, OptionalKey<T>> {
    KeyForm::new("table", move |reader, key| reader.inner(key, &read)).right(TABLE)
}

/// A table that must be there, read by `read`.
pub fn required_table<'k, T: 'k>(
    read: impl Fn(TableReader<'_, '_>) -> T + 'k,
) -> KeyForm<'k, Option<T>> {
    let form = KeyForm::new("table", move |reader, key| {
        let section = reader.required_table(key)?;
        Some(read(reader.open(section)))
    });
    form.right(TABLE).needed()
}

/// Tables in double brackets, each read by `read`.
pub fn tables<'k, T: 'k>(read: impl Fn(TableReader<'_, '_>) -> T + 'k) -> KeyForm<'k, Vec<T>> {
    KeyForm::new("tables", move |reader, key| each(reader, key, &read)).right(TABLES)
}

/// What is valid for a table.
pub const TABLE: &str = "a table";
/// What is valid for tables in double brackets.
pub const TABLES: &str = "a list of tables";

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
#[cfg(any(test, feature = "testing"))]
#[derive(Clone, Debug)]
pub struct DeclaredTable {
    /// Its header.
    pub header: &'static str,
    /// What it says.
    pub says: String,
    /// Its keys.
    pub keys: Vec<DeclaredKey>,
    /// Keys that are known but refused.
    pub refused: &'static [RefusedKey],
}

/// A key as it is declared.
#[cfg(any(test, feature = "testing"))]
#[derive(Clone, Debug)]
pub struct DeclaredKey {
    /// Its name.
    pub name: &'static str,
    /// What is valid for it.
    pub valid: ValidValues,
    /// Its default, as declared; `None` if it has none.
    pub default: Option<String>,
    /// Whether its default is one of the valid values, if it is not given in words.
    pub has_valid_default: bool,
    /// Its purpose.
    pub about: String,
}
