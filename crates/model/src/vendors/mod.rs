//! The model files that are built in, one folder per vendor. Data only.

use crate::profile::catalog::Catalog;
use std::sync::LazyLock;

#[cfg(any(test, feature = "testing"))]
pub mod testing;

/// Name and text of every model file. The model of `maker/series.toml` is called `maker-series`.
#[must_use]
pub fn texts() -> &'static [(&'static str, &'static str)] {
    TEXTS
}

// `build.rs` lists the files that are in the folders.
static TEXTS: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/models.rs"));

/// The models that the demo shows, one each of some vendors.
#[must_use]
pub const fn in_demo() -> &'static [&'static str] {
    &[
        "hyundai-n700",
        "toshiba-vf-as1",
        "teco-e510",
        "frecon-fr500a",
    ]
}

/// The models whose every row was typed a second time in `tests/` here. Tests that play one promise in depth rest on
/// what these have in common: they take orders, in one register, with a setpoint in steps of 0.01 Hz.
#[must_use]
pub const fn reviewed() -> &'static [&'static str] {
    &[
        "frecon-fr500a",
        "hyundai-n100plus",
        "hyundai-n700",
        "teco-e510",
        "teco-e510s",
        "toshiba-vf-as1",
        "toshiba-vf-s15",
    ]
}

/// All built-in models. Each is read when it is first asked for, once in a process.
#[must_use]
pub fn catalog() -> Catalog {
    static CATALOG: LazyLock<Catalog> = LazyLock::new(|| Catalog::of_sound(texts()));
    CATALOG.clone()
}

#[cfg(test)]
mod tests;
