//! The gateway's Modbus TCP client for `read`, `write` and `watch`: one drive by its unit, by address or by the names of
//! the uniform map.

use super::CommandFailure;
use crate::domain::address::{Address, DataTable};
use crate::domain::command::Reason;
use crate::domain::units::UnitOfMeasure;
use crate::drive::view::RunState;
use crate::north::modbus::{self, ConnectionLimits, MapRow, RowContent};
use std::fmt;
use std::io;
use std::os::unix::net::UnixStream as StdUnixStream;
use std::sync::LazyLock;
use std::time::Duration;
use tokio::net::{TcpStream, UnixStream};
use tokio::sync::mpsc;
use tokio::time::timeout;
use tokio_modbus::client::{Context, Reader, Writer, tcp};
use tokio_modbus::{ExceptionCode, Slave};

/// Longest wait for a connection, and for an answer: longer than the gateway lets a request wait, so that a drive that does
/// not answer is not taken for a gateway that is dead.
const PATIENCE: Duration = ConnectionLimits::ANSWER_WITHIN.saturating_add(Duration::from_secs(3));

/// Why there is no answer.
#[derive(Debug)]
pub enum NoAnswer {
    /// The gateway or the drive answered with this exception.
    Exception(u8),
    /// There is no connection, so nothing was sent.
    Unreachable(String),
    /// The connection broke, or no answer arrived in time: what was sent may have been carried out.
    Lost(String),
}

impl fmt::Display for NoAnswer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Exception(code) => write!(f, "{} (exception {code:02X})", sentence(*code)),
            Self::Unreachable(reason) | Self::Lost(reason) => f.write_str(reason),
        }
    }
}

impl From<NoAnswer> for CommandFailure {
    fn from(error: NoAnswer) -> Self {
        Self::failed(error)
    }
}

/// The meaning of an exception, from whichever sender.
const fn sentence(code: u8) -> &'static str {
    match code {
        1 => "not allowed: the drive or this register is read-only, or this client may not do it",
        2 => "there is no such register here, or it is not listed as writable",
        3 => "the value or the count is not allowed",
        4 => "the drive refused",
        6 => {
            "not now: another client holds control, a start is inhibited, a stop is pending, or a queue is full"
        }
        0x0A => "there is no such unit, or its line is down",
        0x0B => "the drive did not answer in time",
        _ => "the drive answered with a vendor-specific code",
    }
}

/// The path to a gateway.
pub enum GatewayPath {
    /// Modbus TCP on this host and port.
    Tcp(String, u16),
    /// In this process.
    Own(mpsc::Sender<StdUnixStream>),
}

impl GatewayPath {
    async fn connect(&self, unit: Slave) -> io::Result<Context> {
        match self {
            Self::Tcp(host, port) => {
                let stream = TcpStream::connect((host.as_str(), *port)).await?;
                Ok(tcp::attach_slave(stream, unit))
            }
            Self::Own(connections) => {
                let (ours, theirs) = StdUnixStream::pair()?;
                ours.set_nonblocking(true)?;
                theirs.set_nonblocking(true)?;
                connections
                    .send(theirs)
                    .await
                    .map_err(|_| io::Error::from(io::ErrorKind::ConnectionRefused))?;
                Ok(tcp::attach_slave(UnixStream::from_std(ours)?, unit))
            }
        }
    }
}

/// A client of one unit. It connects on its first request, and again after each failure.
pub struct UnitClient {
    way: GatewayPath,
    unit: u8,
    connection: Option<Context>,
}

impl UnitClient {
    /// A client that has not connected yet.
    pub const fn new(way: GatewayPath, unit: u8) -> Self {
        Self {
            way,
            unit,
            connection: None,
        }
    }

    /// Reads `count` words from the holding register `address` on.
    ///
    /// # Errors
    /// [`NoAnswer`].
    pub async fn read(&mut self, address: u16, count: u16) -> Result<Vec<u16>, NoAnswer> {
        self.read_from(Address::holding(address), count).await
    }

    /// Reads `count` words or bits from `address` on, each bit as a word.
    ///
    /// # Errors
    /// [`NoAnswer`].
    pub async fn read_from(&mut self, address: Address, count: u16) -> Result<Vec<u16>, NoAnswer> {
        let number = address.number();
        let mut connection = self.connection().await?;
        let bits = |answer: tokio_modbus::Result<Vec<bool>>| {
            answer.map(|bits| bits.map(|bits| bits.into_iter().map(u16::from).collect()))
        };
        let answer = async {
            match address.table() {
                DataTable::Coil => bits(connection.read_coils(number, count).await),
                DataTable::Discrete => bits(connection.read_discrete_inputs(number, count).await),
                DataTable::Input => connection.read_input_registers(number, count).await,
                DataTable::Holding => connection.read_holding_registers(number, count).await,
            }
        };
        let answer = timeout(PATIENCE, answer).await;
        let words = self.outcome(connection, answer)?;
        // A shorter answer would be another client's.
        if words.len() == usize::from(count) {
            Ok(words)
        } else {
            Err(self.lost("the answer has a wrong number of words"))
        }
    }

    /// Writes one word.
    ///
    /// # Errors
    /// [`NoAnswer`].
    pub async fn write(&mut self, address: u16, word: u16) -> Result<(), NoAnswer> {
        let mut connection = self.connection().await?;
        let answer = timeout(PATIENCE, connection.write_single_register(address, word)).await;
        self.outcome(connection, answer)
    }

    /// The connection of the last answer, or a new one. It is put back after the next answer.
    async fn connection(&mut self) -> Result<Context, NoAnswer> {
        if let Some(connection) = self.connection.take() {
            return Ok(connection);
        }
        let connected = timeout(PATIENCE, self.way.connect(Slave(self.unit))).await;
        match connected.unwrap_or_else(|_| Err(io::ErrorKind::TimedOut.into())) {
            Ok(context) => Ok(context),
            Err(error) => Err(NoAnswer::Unreachable(
                self.place(format!("cannot connect: {error}")),
            )),
        }
    }

    fn outcome<T>(
        &mut self,
        connection: Context,
        answer: Result<tokio_modbus::Result<T>, tokio::time::error::Elapsed>,
    ) -> Result<T, NoAnswer> {
        match answer {
            Ok(Ok(answer)) => {
                self.connection = Some(connection);
                answer.map_err(|code| NoAnswer::Exception(number(code)))
            }
            Ok(Err(error)) => Err(self.lost(error)),
            Err(_) => Err(self.lost(format!("no answer within {} s", PATIENCE.as_secs()))),
        }
    }

    fn lost(&self, reason: impl fmt::Display) -> NoAnswer {
        NoAnswer::Lost(self.place(reason))
    }

    fn place(&self, reason: impl fmt::Display) -> String {
        match &self.way {
            GatewayPath::Tcp(host, port) => format!("gateway at {host}:{port}: {reason}"),
            GatewayPath::Own(_) => format!("gateway of this command: {reason}"),
        }
    }
}

fn number(code: ExceptionCode) -> u8 {
    code.into()
}

/// A register by its number on the wire, decimal or with `0x`.
///
/// # Errors
/// It is not a register number, in words.
pub fn address(text: &str) -> Result<u16, String> {
    let number = match text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")) {
        Some(digits) => u16::from_str_radix(digits, 16),
        None => text.parse(),
    };
    number.map_err(|_| {
        format!(
            "{text} is not a register: expected a number from 0 to 65535, such as 0x0101 or 257"
        )
    })
}

/// A word of the uniform map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UniformWord {
    /// Its name in this program.
    pub name: &'static str,
    /// Its address.
    pub address: u16,
    /// Its format.
    pub form: WordFormat,
}

/// The format of a word of the uniform map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WordFormat {
    /// A number, `word / scale` in a unit; 65535 if there is none.
    Number(u32, UnitOfMeasure),
    /// Like [`WordFormat::Number`] in two's complement; 32768 if there is none.
    Signed(u32, UnitOfMeasure),
    /// A number all values of which are valid.
    Count,
    /// The upper half of a number that is continued in the next word; both 65535 if there is none.
    Wide(u32, UnitOfMeasure),
    /// A run state.
    RunState,
    /// The status bits.
    Status,
    /// What can be ordered, bit by bit.
    Capabilities,
}

impl UniformWord {
    /// How many words it takes.
    pub const fn words(self) -> u16 {
        if matches!(self.form, WordFormat::Wide(..)) {
            2
        } else {
            1
        }
    }
}

/// The words of the uniform map that have a name: what is read, then what is written and read back.
pub static UNIFORM: LazyLock<Vec<UniformWord>> = LazyLock::new(|| {
    let named = modbus::map().iter().filter(|row| !row.key.is_empty());
    named
        .map(|row| UniformWord {
            name: row.key,
            address: row.address,
            form: format_of(row),
        })
        .collect()
});

fn format_of(row: &MapRow) -> WordFormat {
    let steps = match row.holds {
        RowContent::Steps(scale, unit) => Some((scale, unit)),
        _ => None,
    };
    let (scale, unit) = steps.unwrap_or((1, UnitOfMeasure::None));
    match row.address {
        STATUS | STATUS_MASK => WordFormat::Status,
        RUN_STATE => WordFormat::RunState,
        CAPABILITIES => WordFormat::Capabilities,
        LIFE => WordFormat::Count,
        _ if row.count == 2 => WordFormat::Wide(scale, unit),
        _ if row.is_signed() => WordFormat::Signed(scale, unit),
        _ if row.absent.is_some() || steps.is_some() => WordFormat::Number(scale, unit),
        _ => WordFormat::Count,
    }
}

/// The status bits.
pub const STATUS: u16 = 1;
/// The run state.
const RUN_STATE: u16 = 2;
/// The status bits that the drive can report.
const STATUS_MASK: u16 = 15;
/// Seconds since the start, which wrap.
const LIFE: u16 = 16;
/// The alarm bits.
pub const ALARMS: u16 = 17;
/// What can be ordered.
const CAPABILITIES: u16 = 26;
/// Seconds until the lease ends.
pub const LEASE_LEFT: u16 = 18;
/// Number of the reason of the last command.
pub const REASON: u16 = 261;

/// The status bits by name, from bit 0 on.
const STATUS_BITS: [&str; 14] = [
    "online",
    "running",
    "reverse",
    "tripped",
    "at_setpoint",
    "accepts_commands",
    "command_pending",
    "lease_held",
    "stale",
    "start_inhibited",
    "local",
    "alarm",
    "warning",
    "standby",
];

/// The capability bits by name, from bit 0 on.
const CAPABILITY_BITS: [&str; 7] = [
    "forward",
    "reverse",
    "coast",
    "reset",
    "frequency",
    "release",
    "take",
];

/// All run states.
const RUN_STATES: [RunState; 8] = [
    RunState::Unknown,
    RunState::Stopped,
    RunState::Forward,
    RunState::Reverse,
    RunState::Tripped,
    RunState::Offline,
    RunState::Running,
    RunState::Stopping,
];

/// The names of the bits that are set in `word`.
fn bits_of(word: u16, names: &[&'static str]) -> Vec<&'static str> {
    names
        .iter()
        .enumerate()
        .filter(|(bit, _)| word & (1 << bit) != 0)
        .map(|(_, name)| *name)
        .collect()
}

/// A decoded value of the uniform map.
#[derive(Clone, Debug, PartialEq)]
pub enum DecodedValue {
    /// The drive or its model has none.
    Missing,
    /// A number with its decimals, and its unit.
    Number(i64, u32, UnitOfMeasure),
    /// A word.
    Word(&'static str),
    /// A list of words.
    Words(Vec<&'static str>),
    /// A word of a register with its meaning by the model.
    Meaning(u16, String),
}

impl DecodedValue {
    /// The value of `words`, one or two, in this `form`.
    #[must_use]
    pub fn understand(form: WordFormat, words: &[u16]) -> Self {
        let first = words.first().copied().unwrap_or(0);
        let second = words.get(1).copied().unwrap_or(0);
        match form {
            WordFormat::Number(_, _) if first == u16::MAX => Self::Missing,
            WordFormat::Number(scale, unit) => Self::Number(first.into(), scale, unit),
            WordFormat::Signed(_, _) if first == 0x8000 => Self::Missing,
            WordFormat::Signed(scale, unit) => {
                Self::Number(first.cast_signed().into(), scale, unit)
            }
            WordFormat::Count => Self::Number(first.into(), 1, UnitOfMeasure::None),
            WordFormat::Wide(..) if (first, second) == (u16::MAX, u16::MAX) => Self::Missing,
            WordFormat::Wide(scale, unit) => {
                Self::Number(i64::from(first) << 16 | i64::from(second), scale, unit)
            }
            WordFormat::RunState => {
                let state = RUN_STATES.iter().find(|state| state.number() == first);
                state.map_or(
                    Self::Number(first.into(), 1, UnitOfMeasure::None),
                    |state| Self::Word(state.keyword()),
                )
            }
            WordFormat::Status => Self::Words(bits_of(first, &STATUS_BITS)),
            WordFormat::Capabilities => Self::Words(bits_of(first, &CAPABILITY_BITS)),
        }
    }

    /// For programs.
    #[must_use]
    pub fn json(&self) -> serde_json::Value {
        match self {
            Self::Missing => serde_json::Value::Null,
            Self::Number(raw, 1, _) => (*raw).into(),
            Self::Number(raw, scale, _) => (*raw as f64 / f64::from(*scale)).into(),
            Self::Word(word) => (*word).into(),
            Self::Words(words) => words.clone().into(),
            Self::Meaning(_, text) => text.as_str().into(),
        }
    }
}

impl fmt::Display for DecodedValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Missing => f.write_str("not available"),
            Self::Number(raw, scale, unit) => {
                let decimals = scale.ilog10() as usize;
                write!(f, "{:.decimals$}", *raw as f64 / f64::from(*scale))?;
                if *unit == UnitOfMeasure::None {
                    Ok(())
                } else {
                    write!(f, " {unit}")
                }
            }
            Self::Word(word) => f.write_str(word),
            Self::Words(words) if words.is_empty() => f.write_str("none"),
            Self::Words(words) => f.write_str(&words.join(" ")),
            Self::Meaning(word, text) => write!(f, "{text} ({word})"),
        }
    }
}

/// The uniform unit's reason for the last command, to be appended to a message; empty if there is none.
pub async fn reason(client: &mut UnitClient) -> String {
    let number = client
        .read(REASON, 1)
        .await
        .ok()
        .and_then(|words| words.first().copied());
    let reason = Reason::ALL
        .iter()
        .find(|reason| Some(reason.number()) == number && **reason != Reason::None);
    reason
        .map(|reason| {
            format!(
                "; the gateway notes: {} ({})",
                reason.text(),
                reason.keyword()
            )
        })
        .unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn registers_are_numbers_in_either_notation() {
        assert_eq!(address("257"), Ok(257));
        assert_eq!(address("0x0101"), Ok(257));
        for wrong in ["", "0x", "65536", "0x10000", "-1", "F001", "1.5"] {
            assert!(address(wrong).unwrap_err().contains(wrong), "{wrong}");
        }
    }

    #[test]
    fn uniform_words_are_shown_in_their_units() {
        let shown = |name: &str, words: &[u16]| {
            let word = UNIFORM.iter().find(|word| word.name == name).unwrap();
            DecodedValue::understand(word.form, words).to_string()
        };
        assert_eq!(shown("output_frequency", &[4250]), "42.50 Hz");
        assert_eq!(shown("output_frequency", &[65535]), "not available");
        assert_eq!(shown("torque", &[0xFFFB]), "-0.5 %");
        assert_eq!(shown("torque", &[0x8000]), "not available");
        assert_eq!(shown("run_hours", &[1, 2]), "65538 h");
        assert_eq!(shown("run_state", &[2]), "forward");
        assert_eq!(shown("run_state", &[99]), "99");
        assert_eq!(shown("status", &[0b11]), "online running");
        assert_eq!(shown("status", &[0]), "none");
        assert_eq!(shown("alarms", &[65535]), "65535");
    }

    #[test]
    fn every_word_that_the_gateway_serves_has_a_name_here() {
        use crate::north::modbus::{MapTable, MapUnit};
        let words = crate::north::modbus::map().iter().filter(|row| {
            let is_word = matches!(row.table, MapTable::Word | MapTable::Holding);
            row.unit == MapUnit::Uniform
                && is_word
                && row.name != "reserved"
                && row.address != modbus::address::RENEW
        });
        let served: Vec<_> = words.map(|row| (row.address, row.count)).collect();
        let named: Vec<_> = UNIFORM
            .iter()
            .map(|word| (word.address, word.words()))
            .collect();
        assert_eq!(named, served);
    }

    #[test]
    fn names_and_addresses_stand_in_the_map_once_and_in_order() {
        for pair in UNIFORM.windows(2) {
            assert!(
                pair[0].address + pair[0].words() <= pair[1].address,
                "{pair:?}"
            );
        }
        let names: std::collections::BTreeSet<_> = UNIFORM.iter().map(|word| word.name).collect();
        assert_eq!(names.len(), UNIFORM.len());
    }

    #[test]
    fn every_exception_is_a_sentence_with_its_code() {
        for code in 0..=u8::MAX {
            let text = NoAnswer::Exception(code).to_string();
            assert!(
                text.contains(&format!("(exception {code:02X})")) && text.len() > 20,
                "{text}"
            );
        }
    }
}
