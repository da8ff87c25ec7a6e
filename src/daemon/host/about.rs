//! The program and its host, for diagnostics.

use super::adapters;
use super::archive::ArchivedFile;
use crate::domain::version::PROGRAM_VERSION;
use rustix::system::uname;
use serde_json::{Value, json};
use std::fs;

/// The files about the host: `about.json` and `ports.json`.
#[must_use]
pub fn files() -> [ArchivedFile; 2] {
    [("about.json", versions()), ("ports.json", ports())]
        .map(|(path, value)| ArchivedFile::new(path, format!("{value:#}\n")))
}

/// Versions of the program and of its host.
fn versions() -> Value {
    let uname = uname();
    let release = fs::read_to_string("/etc/os-release").unwrap_or_default();
    let system = release
        .lines()
        .find_map(|line| line.strip_prefix("PRETTY_NAME="));
    let word = |text: &std::ffi::CStr| text.to_string_lossy().into_owned();
    json!({
        "version": PROGRAM_VERSION,
        "architecture": std::env::consts::ARCH,
        "system": system.map(|name| name.trim_matches('"')),
        "kernel": word(uname.release()),
        "host": word(uname.nodename()),
        "user": rustix::process::geteuid().as_raw(),
        "in_container": fs::exists("/.dockerenv").unwrap_or(false) || fs::exists("/run/.containerenv").unwrap_or(false),
    })
}

/// The serial ports of the host.
fn ports() -> Value {
    let port = |it: adapters::SerialAdapter| {
        json!({
            "path": it.path.display().to_string(),
            "device": it.device.display().to_string(),
            "driver": it.driver,
            "may_open": it.may_open,
            "group": it.group,
            "holders": it.holders,
        })
    };
    adapters::list().into_iter().map(port).collect()
}
