//! The number of each Sparkplug connection, `bdSeq`: it increases by one with every CONNECT, from 255 to 0, also across restarts.
//!
//! A number is on the disk before the CONNECT that carries it leaves. Otherwise a gateway that loses power could
//! connect twice with the same number, and a late NDEATH of the first connection would mark the second as dead.

use super::Chore;
use crate::daemon::host::user_files;
use crate::daemon::host::whole_files::{self, FileReaders};
use std::io;
use std::path::{Path, PathBuf};

/// The file, in the data directory.
const FILE_NAME: &str = "sparkplug-bdseq";
/// Maximum size of the file in bytes.
const BYTES_MAX: u64 = 64;

/// Numbers connections.
#[derive(Debug)]
pub struct BdSeq {
    file: PathBuf,
    last: Option<u8>,
    /// No CONNECT with the last number was sent.
    is_spare: bool,
}

impl BdSeq {
    /// Continues from the number stored in `data_dir`. Reads a file.
    #[must_use]
    pub fn read(data_dir: &Path) -> Self {
        let file = data_dir.join(FILE_NAME);
        let last = match user_files::text(&file, BYTES_MAX) {
            Ok(text) => text.trim().parse().map_or_else(
                |_| {
                    tracing::warn!(file = %file.display(), "no number from 0 to 255 in the file; counting sessions from 0");
                    None
                },
                Some,
            ),
            Err(error) if error.kind() == io::ErrorKind::NotFound => None,
            Err(error) => {
                tracing::warn!(file = %file.display(), %error, "cannot read the file; counting sessions from 0");
                None
            }
        };
        Self {
            file,
            last,
            is_spare: false,
        }
    }

    /// The number of the next connection, and blocking work to be done before it begins.
    pub fn begin(&mut self) -> (u8, Option<Chore>) {
        if let (true, Some(last)) = (std::mem::take(&mut self.is_spare), self.last) {
            return (last, None);
        }
        let number = self.last.map_or(0, |last| last.wrapping_add(1));
        self.last = Some(number);
        let file = self.file.clone();
        let chore = move || {
            let kept =
                whole_files::replace(&file, format!("{number}\n").as_bytes(), FileReaders::All);
            if let Err(error) = kept {
                // A gateway without a connection to its host would be worse than one that may reuse a number.
                tracing::error!(file = %file.display(), %error, "cannot save the session number; it may be used again after a restart");
            }
        };
        (number, Some(Box::new(chore)))
    }

    /// No CONNECT with the last number was sent, so it is used for the next.
    pub const fn unsent(&mut self) {
        self.is_spare = true;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::testing::Dir;
    use std::fs;

    fn connect(numbers: &mut BdSeq) -> u8 {
        let (number, chore) = numbers.begin();
        chore.into_iter().for_each(|chore| chore());
        number
    }

    /// tck-id-message-flow-edge-node-birth-publish-will-message-payload-bdSeq.
    #[test]
    fn it_rises_by_one_over_restarts_and_begins_again_behind_255() {
        let place = Dir::new();
        let mut all = Vec::new();
        for _ in 0..130 {
            let mut numbers = BdSeq::read(&place);
            all.extend([connect(&mut numbers), connect(&mut numbers)]);
        }
        let expected: Vec<_> = (0..=255).chain(0..4).collect();
        assert_eq!(all, expected);
        assert_eq!(fs::read_to_string(place.join(FILE_NAME)).unwrap(), "3\n");
    }

    #[test]
    fn a_number_that_no_broker_saw_is_used_for_the_next_connection() {
        let place = Dir::new();
        let mut numbers = BdSeq::read(&place);
        assert_eq!(connect(&mut numbers), 0);
        numbers.unsent();
        assert_eq!((connect(&mut numbers), connect(&mut numbers)), (0, 1));
    }

    #[test]
    fn a_damaged_file_or_a_full_disk_does_not_stop_it() {
        let place = Dir::new();
        fs::write(place.join(FILE_NAME), "256").unwrap();
        assert_eq!(connect(&mut BdSeq::read(&place)), 0);
        let mut nowhere = BdSeq::read(&place.join("missing"));
        assert_eq!((connect(&mut nowhere), connect(&mut nowhere)), (0, 1));
    }
}
