//! Files that the user names: read only if they are regular files, and only up to a bound.
//!
//! A FIFO would block, a device may be endless or react to being opened, and a file that is much too large costs time
//! and memory. Anything but a regular file is refused before a byte of it is read.

use rustix::fs::OFlags;
use std::fs::{FileType, Metadata, OpenOptions};
use std::io::{self, Read};
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::path::Path;

/// Longest configuration, model file, dump or PEM file in bytes.
pub const BYTES_MAX: u64 = 1024 * 1024;

/// The bytes of the regular file at `path`, at most `most`.
///
/// # Errors
/// The system's; or it is not a regular file, or it is longer.
pub fn bytes(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    // Checked before it is opened: opening a serial device would toggle its control lines.
    is_fit(&std::fs::metadata(path)?, most)?;
    // A file that replaces it at this moment must not block.
    let flags = i32::try_from((OFlags::NONBLOCK | OFlags::NOCTTY).bits()).unwrap_or(0);
    let file = OpenOptions::new()
        .read(true)
        .custom_flags(flags)
        .open(path)?;
    is_fit(&file.metadata()?, most)?;
    let mut bytes = Vec::new();
    // It may grow meanwhile, or the system may not know its length.
    file.take(most.saturating_add(1)).read_to_end(&mut bytes)?;
    if u64::try_from(bytes.len()).unwrap_or(u64::MAX) > most {
        Err(too_long(None, most))
    } else {
        Ok(bytes)
    }
}

/// The text of the regular file at `path`, of at most `most` bytes.
///
/// # Errors
/// As [`bytes`]; or it is not UTF-8 text.
pub fn text(path: &Path, most: u64) -> io::Result<String> {
    String::from_utf8(bytes(path, most)?)
        .map_err(|_| io::Error::new(io::ErrorKind::InvalidData, "it is not UTF-8 text"))
}

fn is_fit(found: &Metadata, most: u64) -> io::Result<()> {
    if !found.is_file() {
        let what = format!(
            "it is {}, and a regular file is needed",
            kind(found.file_type())
        );
        return Err(io::Error::new(io::ErrorKind::InvalidInput, what));
    }
    if found.len() > most {
        Err(too_long(Some(found.len()), most))
    } else {
        Ok(())
    }
}

fn too_long(bytes: Option<u64>, most: u64) -> io::Error {
    let found = bytes.map_or_else(
        || "too long".to_owned(),
        |bytes| format!("{bytes} bytes long"),
    );
    io::Error::new(
        io::ErrorKind::FileTooLarge,
        format!("it is {found}; {most} bytes are the most"),
    )
}

fn kind(of: FileType) -> &'static str {
    match of {
        _ if of.is_dir() => "a directory",
        _ if of.is_fifo() => "a pipe",
        _ if of.is_socket() => "a socket",
        _ if of.is_char_device() || of.is_block_device() => "a device",
        _ => "no regular file",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::testing::Dir;
    use rustix::fs::{CWD, FileType as Kind, Mode, mknodat};
    use std::fs::File;
    use std::os::unix::net::UnixListener;

    fn refused(path: &Path) -> String {
        bytes(path, 10).unwrap_err().to_string()
    }

    #[test]
    fn only_regular_files_are_read_and_nothing_is_waited_for() {
        let dir = Dir::new();
        let pipe = dir.join("pipe");
        mknodat(CWD, &pipe, Kind::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
        let socket = dir.join("socket");
        let _listener = UnixListener::bind(&socket).unwrap();
        for (path, right) in [
            (pipe.as_path(), "it is a pipe, and a regular file is needed"),
            (&dir, "it is a directory, and a regular file is needed"),
            (&socket, "it is a socket, and a regular file is needed"),
            (
                Path::new("/dev/zero"),
                "it is a device, and a regular file is needed",
            ),
        ] {
            assert_eq!(refused(path), right);
        }
        let link = dir.join("link");
        std::fs::write(dir.join("file"), "0123456789").unwrap();
        std::os::unix::fs::symlink("file", &link).unwrap();
        assert_eq!(
            text(&link, 10).unwrap(),
            "0123456789",
            "secrets of a container are links"
        );
    }

    #[test]
    fn what_is_too_long_is_refused_by_its_length() {
        let dir = Dir::new();
        let path = dir.join("file");
        let file = File::create(&path).unwrap();
        for (length, right) in [
            (10, None),
            (11, Some("it is 11 bytes long; 10 bytes are the most")),
        ] {
            file.set_len(length).unwrap();
            assert_eq!(
                bytes(&path, 10)
                    .err()
                    .map(|error| error.to_string())
                    .as_deref(),
                right
            );
        }
        file.set_len(1 << 40).unwrap();
        assert!(
            refused(&path).contains("1099511627776 bytes"),
            "nothing of it was read"
        );
        // The system reports a length of 0 for such a file.
        assert!(refused(Path::new("/proc/self/status")).contains("too long"));
        std::fs::write(&path, [0xFF, 0xFE]).unwrap();
        assert_eq!(
            text(&path, 10).unwrap_err().to_string(),
            "it is not UTF-8 text"
        );
    }
}
