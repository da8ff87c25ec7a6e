//! The model files that are built in, one folder per vendor. Data only.

use crate::profile::catalog::Catalog;
use std::sync::LazyLock;

/// Name and text of model files.
macro_rules! files {
    ($($file:literal,)*) => { &[$(($file, include_str!($file)),)*] };
}

/// Name and text of every model file. The model of `maker/series.toml` is called `maker-series`.
#[must_use]
pub fn texts() -> &'static [(&'static str, &'static str)] {
    files![
        "hyundai/n700.toml",
        "hyundai/n100plus.toml",
        "toshiba/vf-as1.toml",
        "toshiba/vf-s15.toml",
        "teco/e510.toml",
        "teco/e510s.toml",
        "frecon/fr500a.toml",
    ]
}

/// The models that the demo shows, one each of some vendors.
#[must_use]
pub const fn in_demo() -> &'static [&'static str] {
    &["hyundai-n700", "toshiba-vf-as1", "teco-e510", "frecon-fr500a"]
}

/// All built-in models. Each is read when it is first asked for, once in a process.
#[must_use]
pub fn catalog() -> Catalog {
    static CATALOG: LazyLock<Catalog> = LazyLock::new(|| Catalog::of_sound(texts()));
    CATALOG.clone()
}

#[cfg(test)]
mod tests;
