//! The model files that are built in, one folder per vendor. Data only.

use crate::profile::catalog::Catalog;
use std::sync::LazyLock;

#[cfg(any(test, feature = "testing"))]
pub mod testing;

/// Name and text of model files.
macro_rules! files {
    ($($file:literal,)*) => { &[$(($file, include_str!($file)),)*] };
}

/// Name and text of every model file. The model of `maker/series.toml` is called `maker-series`.
#[must_use]
pub fn texts() -> &'static [(&'static str, &'static str)] {
    TEXTS
}

static TEXTS: &[(&str, &str)] = files![
    "abb/acs355.toml",
    "abb/acs380.toml",
    "abb/acs550.toml",
    "abb/acs580.toml",
    "actech/smv.toml",
    "automationdirect/gs2.toml",
    "automationdirect/gs20.toml",
    "automationdirect/gs4.toml",
    "control-techniques/commander-sk.toml",
    "control-techniques/m200.toml",
    "control-techniques/m400.toml",
    "danfoss/fc102.toml",
    "danfoss/fc302.toml",
    "danfoss/fc51.toml",
    "delta/c2000.toml",
    "delta/ms300.toml",
    "delta/vfd-e.toml",
    "delta/vfd-el.toml",
    "eaton/dc1.toml",
    "eaton/de1.toml",
    "eaton/mmax.toml",
    "frecon/fr500a.toml",
    "fuji/frenic-ace.toml",
    "fuji/frenic-hvac.toml",
    "fuji/frenic-mini.toml",
    "fuji/frenic-multi.toml",
    "generic/h100.toml",
    "generic/yl620.toml",
    "hitachi/wj200.toml",
    "hitachi/x200.toml",
    "huanyang/gt.toml",
    "hyundai/n100plus.toml",
    "hyundai/n700.toml",
    "inovance/md500.toml",
    "invertek/optidrive-e2.toml",
    "invertek/optidrive-e3.toml",
    "invertek/optidrive-p2.toml",
    "invt/gd10.toml",
    "invt/gd20.toml",
    "invt/gd200a.toml",
    "ls/g100.toml",
    "ls/h100.toml",
    "ls/ig5a.toml",
    "ls/m100.toml",
    "ls/s100.toml",
    "mitsubishi/fr-d700.toml",
    "mitsubishi/fr-e700.toml",
    "mitsubishi/fr-e800.toml",
    "omron/mx2.toml",
    "powtran/pi130.toml",
    "powtran/pi500.toml",
    "rockwell/powerflex-4.toml",
    "rockwell/powerflex-40.toml",
    "rockwell/powerflex-400.toml",
    "rockwell/powerflex-4m.toml",
    "rockwell/powerflex-525.toml",
    "schneider/atv12.toml",
    "schneider/atv312.toml",
    "schneider/atv320.toml",
    "siemens/g120.toml",
    "siemens/v20.toml",
    "sunfar/e300.toml",
    "sunfar/e500.toml",
    "teco/e510.toml",
    "teco/e510s.toml",
    "toshiba/vf-as1.toml",
    "toshiba/vf-s15.toml",
    "vacon/10.toml",
    "vacon/100.toml",
    "vacon/20.toml",
    "weg/cfw300.toml",
    "weg/cfw500.toml",
    "yaskawa/a1000.toml",
    "yaskawa/ga500.toml",
    "yaskawa/ga700.toml",
    "yaskawa/v1000.toml",
];

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
