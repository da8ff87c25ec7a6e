//! Passwords as argon2id hashes in the PHC format: requirements on the hash, making and comparing it. Both take time
//! and memory on purpose.

use argon2::password_hash::{PasswordHash, PasswordHasher, PasswordVerifier, SaltString};
use argon2::{Algorithm, Argon2, Params, Version};
use std::fmt;
use std::ops::RangeInclusive;

/// Memory that a hash must need, in KiB, and passes over it: at least what is recommended, at most what a sign-in may
/// cost a small machine.
const MEMORY_KIB: RangeInclusive<u32> = Params::DEFAULT_M_COST..=64 * 1024;
const PASSES: RangeInclusive<u32> = Params::DEFAULT_T_COST..=16;
const LANES: RangeInclusive<u32> = 1..=16;
/// Bytes of the salt and of the hash itself, at least.
const SALT_BYTES_MIN: usize = 8;
const OUTPUT_BYTES_MIN: usize = 16;
/// Longest text of a hash in bytes.
const TEXT_BYTES_MAX: usize = 512;
/// Allowed length of a password, in characters: shorter ones are guessed.
pub const PASSWORD_CHARS: RangeInclusive<usize> = 8..=256;

/// The hash of a password, strong enough. Its content never appears in logs.
#[derive(Clone, PartialEq, Eq)]
pub struct StoredHash {
    text: String,
}

/// Why a text is not an acceptable hash.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum UnfitHash {
    /// The text is not in the PHC format. It may be a password in clear text.
    #[error("is no hash in the PHC format")]
    NoHash,
    /// The hash was made in another way.
    #[error("is made by {0}, not by argon2id in its version 19")]
    OtherAlgorithm(String),
    /// Part of it is missing or too short.
    #[error(
        "has no salt of at least {SALT_BYTES_MIN} bytes, or no hash of at least {OUTPUT_BYTES_MIN}"
    )]
    Short,
    /// A parameter makes guessing too fast, or checking too slow.
    #[error("{what} = {value} is out of range ({} to {})", range.start(), range.end())]
    Parameter {
        /// The parameter, as the text calls it.
        what: char,
        /// Its value.
        value: u32,
        /// Its range.
        range: RangeInclusive<u32>,
    },
}

impl StoredHash {
    /// The hash in `text`, such as `$argon2id$v=19$m=19456,t=2,p=1$SALT$HASH`.
    ///
    /// # Errors
    /// [`UnfitHash`].
    pub fn parse(text: &str) -> Result<Self, UnfitHash> {
        let text = text.trim();
        let hash = Some(text)
            .filter(|text| text.len() <= TEXT_BYTES_MAX)
            .map(PasswordHash::new);
        let Some(Ok(hash)) = hash else {
            return Err(UnfitHash::NoHash);
        };
        let version = hash.version.unwrap_or_default();
        if hash.algorithm != argon2::ARGON2ID_IDENT || version != u32::from(Version::V0x13) {
            return Err(UnfitHash::OtherAlgorithm(format!(
                "{} in version {version}",
                hash.algorithm
            )));
        }
        let mut salt = [0; TEXT_BYTES_MAX];
        let salt_bytes = hash
            .salt
            .and_then(|salt_text| salt_text.decode_b64(&mut salt).ok())
            .map_or(0, <[u8]>::len);
        let output_bytes = hash.hash.map_or(0, |output| output.len());
        if salt_bytes < SALT_BYTES_MIN || output_bytes < OUTPUT_BYTES_MIN {
            return Err(UnfitHash::Short);
        }
        let params = Params::try_from(&hash).map_err(|_| UnfitHash::NoHash)?;
        let limits = [
            ('m', params.m_cost(), MEMORY_KIB),
            ('t', params.t_cost(), PASSES),
            ('p', params.p_cost(), LANES),
        ];
        for (what, value, range) in limits {
            if !range.contains(&value) {
                return Err(UnfitHash::Parameter { what, value, range });
            }
        }
        Ok(Self {
            text: text.to_owned(),
        })
    }

    /// A hash of `password` with a salt that must be random; `None` if the length of the password is outside
    /// [`PASSWORD_CHARS`].
    #[must_use]
    pub fn make(password: &str, salt: &[u8; 16]) -> Option<Self> {
        if !PASSWORD_CHARS.contains(&password.chars().count()) {
            return None;
        }
        let salt = SaltString::encode_b64(salt).ok()?;
        let argon2 = Argon2::new(Algorithm::Argon2id, Version::V0x13, Params::DEFAULT);
        let hash = argon2.hash_password(password.as_bytes(), &salt).ok()?;
        Some(Self {
            text: hash.to_string(),
        })
    }

    /// Whether it is the hash of `password`.
    #[must_use]
    pub fn matches(&self, password: &str) -> bool {
        let hash = PasswordHash::new(&self.text);
        hash.is_ok_and(|hash| {
            Argon2::default()
                .verify_password(password.as_bytes(), &hash)
                .is_ok()
        })
    }

    /// The text for the configuration.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.text
    }
}

impl fmt::Debug for StoredHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("StoredHash")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of "correct horse", by the reference implementation (argon2-cffi), salt "saltsaltsaltsalt".
    const REFERENCE: &str = "$argon2id$v=19$m=19456,t=2,p=1$c2FsdHNhbHRzYWx0c2FsdA$AdweBLwcflnNX2HVW8i1Mtu7frrn4Ki7h/rYSGuU7Is";

    #[test]
    fn what_the_reference_implementation_makes_is_understood() {
        let hash = StoredHash::parse(&format!("{REFERENCE}\n")).unwrap();
        assert!(hash.matches("correct horse"));
        assert!(!hash.matches("correct horse ") && !hash.matches(""));
        assert_eq!(hash.as_str(), REFERENCE);
    }

    #[test]
    fn what_is_made_here_is_taken_here() {
        let hash = StoredHash::make("correct horse", &[7; 16]).unwrap();
        assert_eq!(StoredHash::parse(hash.as_str()), Ok(hash.clone()));
        assert!(hash.matches("correct horse") && !hash.matches("correct horsf"));
        assert_ne!(
            StoredHash::make("correct horse", &[8; 16]),
            Some(hash.clone())
        );
        assert_eq!(
            (StoredHash::make("1234567", &[7; 16]), format!("{hash:?}")),
            (None, "StoredHash".to_owned())
        );
        assert_eq!(StoredHash::make(&"x".repeat(257), &[7; 16]), None);
    }

    #[test]
    fn what_is_weak_or_no_hash_is_refused() {
        let with = |from: &str, to: &str| {
            StoredHash::parse(&REFERENCE.replace(from, to))
                .unwrap_err()
                .to_string()
        };
        for (from, to, why) in [
            (
                "m=19456",
                "m=19455",
                "m = 19455 is out of range (19456 to 65536)",
            ),
            (
                "m=19456",
                "m=65537",
                "m = 65537 is out of range (19456 to 65536)",
            ),
            (
                "m=19456",
                "m=1000000",
                "m = 1000000 is out of range (19456 to 65536)",
            ),
            ("t=2", "t=1", "t = 1 is out of range (2 to 16)"),
            ("p=1", "p=17", "p = 17 is out of range (1 to 16)"),
            (
                "argon2id",
                "argon2i",
                "is made by argon2i in version 19, not by argon2id in its version 19",
            ),
            (
                "v=19$",
                "v=16$",
                "is made by argon2id in version 16, not by argon2id in its version 19",
            ),
            (
                "c2FsdHNhbHRzYWx0c2FsdA",
                "c2FsdA",
                "has no salt of at least 8 bytes, or no hash of at least 16",
            ),
        ] {
            assert_eq!(with(from, to), why);
        }
        let (without_output, _) = REFERENCE.rsplit_once('$').unwrap();
        assert_eq!(StoredHash::parse(without_output), Err(UnfitHash::Short));
        for text in ["", "correct horse", "$argon2id$", &"x".repeat(10_000)] {
            assert_eq!(StoredHash::parse(text), Err(UnfitHash::NoHash), "{text}");
        }
    }
}
