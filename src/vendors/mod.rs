//! The model files that are built in, one folder per vendor. Data only.

/// Name and text of every model file.
#[must_use]
pub fn texts() -> &'static [(&'static str, &'static str)] {
    &[
        ("hyundai/n700.toml", include_str!("hyundai/n700.toml")),
        ("hyundai/n100plus.toml", include_str!("hyundai/n100plus.toml")),
        ("toshiba/vf-as1.toml", include_str!("toshiba/vf-as1.toml")),
        ("toshiba/vf-s15.toml", include_str!("toshiba/vf-s15.toml")),
        ("teco/e510.toml", include_str!("teco/e510.toml")),
        ("teco/e510s.toml", include_str!("teco/e510s.toml")),
        ("frecon/fr500a.toml", include_str!("frecon/fr500a.toml")),
    ]
}

#[cfg(test)]
mod tests;
