//! Makes the version that the program shows: that of `Cargo.toml`, and for a version that is not a release also the commit in
//! `VFD_GATEWAY_BUILD`. Git is not asked here, because every commit would then compile the library again.

use std::env;

/// Hexadecimal digits of the commit that are shown.
const COMMIT_DIGITS: usize = 12;

fn main() -> Result<(), String> {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-env-changed=VFD_GATEWAY_BUILD");
    let commit = env::var("VFD_GATEWAY_BUILD").unwrap_or_default();
    let mut version = env::var("CARGO_PKG_VERSION").map_err(|error| error.to_string())?;
    if version.ends_with("-dev") && !commit.is_empty() {
        match commit.get(..COMMIT_DIGITS) {
            Some(digits) if commit.bytes().all(|it| it.is_ascii_hexdigit()) => {
                version = format!("{version}+g{digits}");
            }
            _ => return Err(format!("VFD_GATEWAY_BUILD is not a commit: {commit}")),
        }
    }
    println!("cargo:rustc-env=VFD_GATEWAY_VERSION={version}");
    Ok(())
}
