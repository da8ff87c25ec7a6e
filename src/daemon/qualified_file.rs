//! The file with what was tried at the drives, in the data directory: read, and replaced as a whole.

use crate::config::qualified::{BYTES_MAX, FILE_NAME, QualifiedResults};
use crate::daemon::host::user_files;
use crate::daemon::host::whole_files::{self, FileReaders};
use std::io;
use std::path::Path;

/// What was tried, as far as the file in `data_dir` tells; nothing if there is none. Reads a file.
///
/// # Errors
/// The file cannot be used.
pub fn read(data_dir: &Path) -> Result<QualifiedResults, String> {
    let file = data_dir.join(FILE_NAME);
    match user_files::text(&file, BYTES_MAX) {
        Ok(text) => QualifiedResults::parse(&text),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(QualifiedResults::default()),
        Err(error) => Err(error.to_string()),
    }
}

/// Replaces the file atomically: whatever happens, the old or the new one is there.
///
/// # Errors
/// The system's.
pub fn write(data_dir: &Path, qualified: &QualifiedResults) -> io::Result<()> {
    whole_files::replace(
        &data_dir.join(FILE_NAME),
        qualified.text().as_bytes(),
        FileReaders::All,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::testing::Dir;
    use std::fs;

    #[test]
    fn a_file_is_there_as_a_whole_or_reported_to_be_damaged() {
        let place = Dir::new();
        assert_eq!(
            read(&place),
            Ok(QualifiedResults::default()),
            "nothing was tried yet"
        );
        write(&place, &QualifiedResults::default()).unwrap();
        assert_eq!(read(&place), Ok(QualifiedResults::default()));
        fs::write(place.join(FILE_NAME), "{").unwrap();
        assert!(read(&place).is_err());
        assert!(write(&place.join("missing"), &QualifiedResults::default()).is_err());
    }
}
