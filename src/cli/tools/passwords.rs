//! Passwords: a terminal that does not show them, and their hash.

use super::CommandFailure;
use crate::north::operator::password::{PASSWORD_CHARS, StoredHash};
use ring::rand::{SecureRandom, SystemRandom};
use rustix::termios::{
    LocalModes, OptionalActions, SpecialCodeIndex, Termios, tcgetattr, tcsetattr,
};
use std::io::{self, Stdin};

/// The character of Ctrl-C when it does not end the program.
pub const CTRL_C: u8 = 3;

/// The hash of `password`.
///
/// # Errors
/// It is too short or too long.
pub fn hashed(password: &str) -> Result<StoredHash, CommandFailure> {
    let mut salt = [0; 16];
    SystemRandom::new()
        .fill(&mut salt)
        .map_err(|_| CommandFailure::failed("no random numbers from the system"))?;
    StoredHash::make(password, &salt).ok_or_else(|| {
        let least = PASSWORD_CHARS.start();
        let most = PASSWORD_CHARS.end();
        CommandFailure::wrong(format!("a password has {least} to {most} characters"))
    })
}

/// A terminal that echoes only the ends of lines, until this is dropped.
pub struct SilentTerminal<'t> {
    terminal: &'t Stdin,
    before: Termios,
}

impl<'t> SilentTerminal<'t> {
    /// Silences `terminal`.
    ///
    /// # Errors
    /// It is none, or it is gone.
    pub fn begin(terminal: &'t Stdin) -> io::Result<Self> {
        let before = tcgetattr(terminal)?;
        let mut silent = before.clone();
        // Ctrl-C would end the program and leave the terminal without echo: it ends the line instead.
        silent
            .local_modes
            .remove(LocalModes::ECHO | LocalModes::ISIG);
        silent
            .local_modes
            .insert(LocalModes::ECHONL | LocalModes::ICANON);
        silent.special_codes[SpecialCodeIndex::VEOL] = CTRL_C;
        tcsetattr(terminal, OptionalActions::Flush, &silent)?;
        Ok(Self { terminal, before })
    }
}

impl Drop for SilentTerminal<'_> {
    fn drop(&mut self) {
        // A terminal that is gone echoes nothing any more.
        let _ = tcsetattr(self.terminal, OptionalActions::Flush, &self.before);
    }
}
