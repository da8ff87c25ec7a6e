//! Makes the version that the program shows, and the list of the model files that are built in.

use std::error::Error;
use std::{env, fs};

/// The folder of the makers' folders.
const VENDORS: &str = "src/vendors";

/// Hexadecimal digits of the commit that are shown.
const COMMIT_DIGITS: usize = 12;

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo:rerun-if-changed=build.rs");
    list_models()?;
    show_version()
}

/// Writes name and text of every model file, in the order of their names.
fn list_models() -> Result<(), Box<dyn Error>> {
    println!("cargo:rerun-if-changed={VENDORS}");
    let mut names = Vec::new();
    for maker in fs::read_dir(VENDORS)? {
        let maker = maker?;
        if !maker.file_type()?.is_dir() {
            continue;
        }
        for file in fs::read_dir(maker.path())? {
            let name = format!("{}/{}", name_of(&maker)?, name_of(&file?)?);
            if name.ends_with(".toml") {
                names.push(name);
            }
        }
    }
    names.sort();
    let mut list = "&[\n".to_owned();
    for name in names {
        let path = format!("concat!(env!(\"CARGO_MANIFEST_DIR\"), \"/{VENDORS}/{name}\")");
        list += &format!("({name:?}, include_str!({path})),\n");
    }
    fs::write(format!("{}/models.rs", env::var("OUT_DIR")?), list + "]")?;
    Ok(())
}

fn name_of(entry: &fs::DirEntry) -> Result<String, String> {
    let name = entry.file_name().into_string();
    name.map_err(|name| format!("not UTF-8: {}", name.display()))
}

/// Sets the version: that of `Cargo.toml`, and for a version that is not a release also the commit in `VFD_GATEWAY_BUILD`. Git
/// is not asked here, because every commit would then compile the library again.
fn show_version() -> Result<(), Box<dyn Error>> {
    println!("cargo:rerun-if-env-changed=VFD_GATEWAY_BUILD");
    let commit = env::var("VFD_GATEWAY_BUILD").unwrap_or_default();
    let mut version = env::var("CARGO_PKG_VERSION")?;
    if version.ends_with("-dev") && !commit.is_empty() {
        match commit.get(..COMMIT_DIGITS) {
            Some(digits) if commit.bytes().all(|it| it.is_ascii_hexdigit()) => {
                version = format!("{version}+g{digits}");
            }
            _ => return Err(format!("VFD_GATEWAY_BUILD is not a commit: {commit}").into()),
        }
    }
    println!("cargo:rustc-env=VFD_GATEWAY_VERSION={version}");
    Ok(())
}
