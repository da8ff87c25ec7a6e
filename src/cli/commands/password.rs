//! `password`: hashes a password for a user of the page.

use crate::cli::tools::passwords::{CTRL_C, SilentTerminal, hashed};
use crate::cli::tools::{CommandFailure, log, print};
use rustix::termios::isatty;
use std::io::{self, Read, Stdin};

/// Longest line that is read, in bytes.
const LINE_BYTES_MAX: u64 = 4096;

/// Where the hash is used, for people.
const WHERE: &str = "\
Put this line into a file that only the gateway may read, and name it in its configuration:

    [[http.users]]
    name = \"anna\"
    password_hash_file = \"/etc/vfd-gateway/anna.hash\"

or write it there as `password_hash`. Then `vfd-gateway reload`.
";

/// Arguments of `password`.
#[derive(Debug, clap::Args)]
pub struct Args {}

/// Asks for a password, twice on a terminal, and prints its hash.
pub fn password(_: &Args) -> Result<(), CommandFailure> {
    let stdin = io::stdin();
    let password = if isatty(&stdin) {
        ask_twice(&stdin)?
    } else {
        read_line(&stdin)?.0
    };
    print(&format!("{}\n", hashed(&password)?.as_str()))?;
    log::complain(WHERE.as_bytes());
    Ok(())
}

fn ask_twice(stdin: &Stdin) -> Result<String, CommandFailure> {
    let _silence = SilentTerminal::begin(stdin).map_err(CommandFailure::failed)?;
    let ask = |prompt: &str| {
        log::complain(prompt.as_bytes());
        let (line, is_cancelled) = read_line(stdin)?;
        if is_cancelled {
            Err(CommandFailure::failed("\nnothing was made"))
        } else {
            Ok(line)
        }
    };
    let password = ask("Password: ")?;
    if ask("Repeat the password: ")? == password {
        Ok(password)
    } else {
        Err(CommandFailure::wrong("the passwords differ"))
    }
}

/// The next line without its end, and whether it ends with Ctrl-C.
fn read_line(stdin: &Stdin) -> Result<(String, bool), CommandFailure> {
    let mut line = Vec::new();
    for byte in stdin.lock().take(LINE_BYTES_MAX).bytes() {
        match byte.map_err(CommandFailure::failed)? {
            b'\n' => break,
            CTRL_C => return Ok((String::new(), true)),
            byte => line.push(byte),
        }
    }
    let line = String::from_utf8(line)
        .map_err(|_| CommandFailure::wrong("the password is not valid UTF-8"))?;
    Ok((
        line.strip_suffix('\r').map(str::to_owned).unwrap_or(line),
        false,
    ))
}
