//! The serial ports of this host: under which name to configure them, what they are, and whether this user may open them.

use rustix::fs::{Access, access};
use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Most processes that are searched for the holder of a port.
const PROCESSES_MAX: usize = 20_000;

/// One serial port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SerialAdapter {
    /// The name to configure: the one by its serial number where there is one, since it stays the same.
    pub path: PathBuf,
    /// The device.
    pub device: PathBuf,
    /// The driver, as the kernel names it.
    pub driver: Option<String>,
    /// Whether this user may open it.
    pub may_open: bool,
    /// The group that may, by name or number.
    pub group: String,
    /// Programs that have it open, as far as this user may see them.
    pub holders: Vec<String>,
}

/// All serial ports, those with a stable name first.
#[must_use]
pub fn list() -> Vec<SerialAdapter> {
    list_in(
        Path::new("/dev"),
        Path::new("/sys/class/tty"),
        Path::new("/proc"),
    )
}

/// The names of all serial ports, those with a stable name first.
#[must_use]
pub fn names() -> Vec<String> {
    let dev = Path::new("/dev");
    let stable = stable_names(dev);
    let devices = serial_devices(dev, Path::new("/sys/class/tty"));
    let mut named: Vec<_> = devices
        .map(|device| (!stable.contains_key(&device), device))
        .collect();
    named.sort();
    named
        .iter()
        .map(|(_, device)| stable.get(device).unwrap_or(device).display().to_string())
        .collect()
}

/// The group that may open the device at `path`, by name or number.
#[must_use]
pub fn group_of(path: &Path) -> String {
    fs::metadata(path).map_or_else(|_| "?".to_owned(), |metadata| group_name(metadata.gid()))
}

/// Programs that have the device at `path` open, as far as this user may see them.
#[must_use]
pub fn holders_of(path: &Path) -> Vec<String> {
    fs::canonicalize(path).map_or_else(
        |_| Vec::new(),
        |device| holders(&device, Path::new("/proc")),
    )
}

fn list_in(dev: &Path, sys: &Path, proc: &Path) -> Vec<SerialAdapter> {
    let stable = stable_names(dev);
    let mut found: Vec<SerialAdapter> = serial_devices(dev, sys)
        .filter_map(|device| {
            let tty = sys.join(device.file_name()?);
            let metadata = fs::metadata(&device).ok()?;
            Some(SerialAdapter {
                path: stable.get(&device).unwrap_or(&device).clone(),
                driver: name_of(&tty.join("device/driver")),
                may_open: access(&device, Access::READ_OK | Access::WRITE_OK).is_ok(),
                group: group_name(metadata.gid()),
                holders: holders(&device, proc),
                device,
            })
        })
        .collect();
    found.sort_by_key(|adapter| (adapter.path == adapter.device, adapter.path.clone()));
    found
}

/// The names by serial number, by device.
fn stable_names(dev: &Path) -> BTreeMap<PathBuf, PathBuf> {
    let links = entries(&dev.join("serial/by-id")).into_iter();
    links
        .filter_map(|link| Some((fs::canonicalize(&link).ok()?, link)))
        .collect()
}

/// The devices of all serial ports that exist.
fn serial_devices(dev: &Path, sys: &Path) -> impl Iterator<Item = PathBuf> {
    let ttys = entries(sys).into_iter().filter(|tty| is_serial(tty));
    ttys.filter_map(move |tty| Some(dev.join(tty.file_name()?)))
        .filter(|device| device.exists())
}

/// Whether there is hardware behind a terminal. The kernel lists many ports of a PC that do not exist, of type 0.
fn is_serial(tty: &Path) -> bool {
    let exists = fs::read_to_string(tty.join("type")).map_or(true, |kind| kind.trim() != "0");
    tty.join("device").exists() && exists
}

/// Programs with an open file at `device`.
fn holders(device: &Path, proc: &Path) -> Vec<String> {
    let is_number = |path: &&PathBuf| {
        path.file_name()
            .is_some_and(|it| it.as_encoded_bytes().iter().all(u8::is_ascii_digit))
    };
    let processes = entries(proc);
    let holds = |process: &&PathBuf| {
        entries(&process.join("fd"))
            .iter()
            .any(|fd| fs::read_link(fd).is_ok_and(|target| target == device))
    };
    let named = |process: &PathBuf| {
        let name = fs::read_to_string(process.join("comm")).unwrap_or_default();
        let number = process
            .file_name()
            .map(|it| it.to_string_lossy().into_owned())
            .unwrap_or_default();
        format!("{} (process {number})", name.trim())
    };
    processes
        .iter()
        .filter(is_number)
        .take(PROCESSES_MAX)
        .filter(holds)
        .map(named)
        .collect()
}

/// The paths in `directory`; none if it cannot be read.
fn entries(directory: &Path) -> Vec<PathBuf> {
    let read = fs::read_dir(directory)
        .into_iter()
        .flatten()
        .filter_map(Result::ok);
    let mut paths: Vec<_> = read.map(|entry| entry.path()).collect();
    paths.sort();
    paths
}

/// The last part of where the link leads.
fn name_of(link: &Path) -> Option<String> {
    Some(
        fs::read_link(link)
            .ok()?
            .file_name()?
            .to_string_lossy()
            .into_owned(),
    )
}

/// The name of a group, or its number.
fn group_name(gid: u32) -> String {
    let groups = fs::read_to_string("/etc/group").unwrap_or_default();
    let named = groups.lines().find_map(|line| {
        let mut fields = line.split(':');
        let name = fields.next()?;
        (fields.nth(1)?.parse() == Ok(gid)).then(|| name.to_owned())
    });
    named.unwrap_or_else(|| gid.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::testing::Dir;
    use std::os::unix::fs::symlink;

    #[test]
    fn ports_have_their_stable_names_and_their_holders() {
        let dir = Dir::new();
        let root = fs::canonicalize(&*dir).unwrap();
        let at = |path: &str| root.join(path);
        for directory in [
            "dev/serial/by-id",
            "sys/ttyUSB0/device",
            "sys/ttyS0/device",
            "sys/tty1",
            "bus/ftdi_sio",
            "proc/42/fd",
        ] {
            fs::create_dir_all(at(directory)).unwrap();
        }
        for file in ["dev/ttyUSB0", "dev/ttyS0", "dev/tty1"] {
            fs::write(at(file), "").unwrap();
        }
        fs::write(at("sys/ttyS0/type"), "0\n").unwrap();
        fs::write(at("proc/42/comm"), "minicom\n").unwrap();
        symlink(at("dev/ttyUSB0"), at("dev/serial/by-id/usb-FTDI_A1")).unwrap();
        symlink(at("bus/ftdi_sio"), at("sys/ttyUSB0/device/driver")).unwrap();
        symlink(at("dev/ttyUSB0"), at("proc/42/fd/3")).unwrap();
        let found = list_in(&at("dev"), &at("sys"), &at("proc"));
        let [adapter] = &found[..] else {
            panic!("{found:?}")
        };
        assert_eq!(adapter.path, at("dev/serial/by-id/usb-FTDI_A1"));
        assert_eq!(adapter.driver.as_deref(), Some("ftdi_sio"));
        assert!(adapter.may_open);
        assert_eq!(adapter.holders, ["minicom (process 42)"]);
    }
}
