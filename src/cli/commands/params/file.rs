//! A dump of parameters as a TOML file: written, and read again.

use crate::cli::tools::CommandFailure;
use std::fmt::Write;
use std::path::Path;
use toml::{Table, Value};

/// The content of a dump.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ParameterDump {
    /// Name of the drive.
    pub drive: String,
    /// Its model.
    pub model: String,
    /// Its station number, if known.
    pub station: Option<u8>,
    /// When it was read, in RFC 3339.
    pub at: String,
    /// The parameters that were read, in order of address.
    pub parameters: Vec<Parameter>,
    /// The parameters that could not be read.
    pub unreadable: Vec<UnreadableParameter>,
    /// What else it does not hold.
    pub left_out: Vec<LeftOut>,
}

/// Something that a dump does not hold.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LeftOut {
    /// A code, or codes in words.
    pub what: String,
    /// Why.
    pub reason: String,
}

/// One parameter with its value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Parameter {
    /// The vendor's code.
    pub code: String,
    /// Its address on the wire.
    pub address: u16,
    /// The word, or the number in two words.
    pub raw: u32,
    /// The value in its unit, or its meaning; `None` for a plain number.
    pub text: Option<String>,
    /// Its title.
    pub title: String,
}

/// A parameter that the drive did not show.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnreadableParameter {
    /// The vendor's code.
    pub code: String,
    /// Its address on the wire.
    pub address: u16,
    /// Why.
    pub reason: String,
}

impl Parameter {
    /// The value as people read it.
    #[must_use]
    pub fn shown(&self) -> String {
        self.text.as_ref().map_or_else(
            || self.raw.to_string(),
            |text| format!("{text} ({})", self.raw),
        )
    }
}

impl ParameterDump {
    /// The parameter at `address`.
    #[must_use]
    pub fn at(&self, address: u16) -> Option<&Parameter> {
        self.parameters
            .iter()
            .find(|parameter| parameter.address == address)
    }

    /// The file.
    #[must_use]
    pub fn text(&self) -> String {
        let quoted = |text: &str| Value::String(text.to_owned()).to_string();
        let mut file = String::from(
            "# Made by `vfd-gateway params dump`. `raw` is what counts; `text` is for people.\n\
             # `vfd-gateway params diff` compares two of these, `params restore` writes one back.\n",
        );
        file.push_str(&self.header());
        file.push_str("\n[drive]\n");
        let _ = writeln!(
            file,
            "name = {}\nmodel = {}",
            quoted(&self.drive),
            quoted(&self.model)
        );
        if let Some(station) = self.station {
            let _ = writeln!(file, "station = {station}");
        }
        let _ = writeln!(file, "at = {}", quoted(&self.at));
        for Parameter {
            code,
            address,
            raw,
            text,
            title,
        } in &self.parameters
        {
            let _ = write!(
                file,
                "\n[[parameter]]\ncode = {}\naddress = 0x{address:04X}\nraw = {raw}\n",
                quoted(code)
            );
            if let Some(text) = text {
                let _ = writeln!(file, "text = {}", quoted(text));
            }
            let _ = writeln!(file, "title = {}", quoted(title));
        }
        for UnreadableParameter {
            code,
            address,
            reason,
        } in &self.unreadable
        {
            let _ = write!(
                file,
                "\n[[unreadable]]\ncode = {}\naddress = 0x{address:04X}\n",
                quoted(code)
            );
            let _ = writeln!(file, "reason = {}", quoted(reason));
        }
        for LeftOut { what, reason } in &self.left_out {
            let _ = writeln!(
                file,
                "\n[[left_out]]\nwhat = {}\nreason = {}",
                quoted(what),
                quoted(reason)
            );
        }
        file
    }

    /// What the file does not hold, as comments at its head.
    fn header(&self) -> String {
        let mut header = format!(
            "#\n# It holds {} parameters. It does not hold:\n",
            self.parameters.len()
        );
        for LeftOut { what, reason } in self.missing() {
            let one_line = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
            let _ = writeln!(header, "#   {}: {}", one_line(&what), one_line(&reason));
        }
        header.push_str("#   what the drive keeps where no register shows it\n");
        header
    }

    /// All that it does not hold, as far as that is known.
    #[must_use]
    pub fn missing(&self) -> Vec<LeftOut> {
        let unread = self.unreadable.iter().map(|it| LeftOut {
            what: it.code.clone(),
            reason: it.reason.clone(),
        });
        unread.chain(self.left_out.iter().cloned()).collect()
    }

    /// Reads the file at `path`.
    ///
    /// # Errors
    /// It cannot be read, or is not a dump: where, and what would be correct.
    pub fn read(path: &Path) -> Result<Self, CommandFailure> {
        let text = crate::cli::tools::input::read(path)?;
        Self::parse(&text)
            .map_err(|wrong| CommandFailure::wrong(format!("{}: {wrong}", path.display())))
    }

    /// The dump in `text`.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn parse(text: &str) -> Result<Self, String> {
        let table: Table = text
            .parse()
            .map_err(|error: toml::de::Error| error.to_string())?;
        let known = ["drive", "parameter", "unreadable", "left_out"];
        if let Some(other) = table.keys().find(|key| !known.contains(&key.as_str())) {
            return Err(format!(
                "there is no `{other}` in a dump of parameters, only {}",
                known.join(", ")
            ));
        }
        let drive = table
            .get("drive")
            .and_then(Value::as_table)
            .ok_or("`[drive]` is missing")?;
        let mut dump = Self {
            drive: text_of_key(drive, "drive", "name")?,
            model: text_of_key(drive, "drive", "model")?,
            station: drive
                .get("station")
                .map(|it| number(it, "drive.station"))
                .transpose()?,
            at: text_of_key(drive, "drive", "at")?,
            ..Self::default()
        };
        for (place, one) in tables(&table, "parameter")? {
            let of = |key: &str| one.get(key).ok_or(format!("{place}.{key} is missing"));
            dump.parameters.push(Parameter {
                code: text_of_key(one, &place, "code")?,
                address: number(of("address")?, &format!("{place}.address"))?,
                raw: number(of("raw")?, &format!("{place}.raw"))?,
                text: one.get("text").and_then(Value::as_str).map(str::to_owned),
                title: one
                    .get("title")
                    .and_then(Value::as_str)
                    .unwrap_or_default()
                    .to_owned(),
            });
        }
        for (place, one) in tables(&table, "unreadable")? {
            let address = one
                .get("address")
                .ok_or(format!("{place}.address is missing"))?;
            let address = number(address, &format!("{place}.address"))?;
            dump.unreadable.push(UnreadableParameter {
                code: text_of_key(one, &place, "code")?,
                address,
                reason: text_of_key(one, &place, "reason")?,
            });
        }
        for (place, one) in tables(&table, "left_out")? {
            dump.left_out.push(LeftOut {
                what: text_of_key(one, &place, "what")?,
                reason: text_of_key(one, &place, "reason")?,
            });
        }
        let mut addresses: Vec<u16> = dump
            .parameters
            .iter()
            .map(|parameter| parameter.address)
            .collect();
        addresses.sort_unstable();
        match addresses.windows(2).find(|pair| pair[0] == pair[1]) {
            Some(pair) => Err(format!("0x{:04X} occurs twice", pair[0])),
            None => Ok(dump),
        }
    }
}

fn tables<'t>(table: &'t Table, key: &str) -> Result<Vec<(String, &'t Table)>, String> {
    let Some(list) = table.get(key) else {
        return Ok(Vec::new());
    };
    let list = list
        .as_array()
        .ok_or(format!("`{key}` must be tables: [[{key}]]"))?;
    let named = |(at, one): (usize, &'t Value)| {
        let place = format!("{key}[{at}]");
        one.as_table()
            .map(|table| (place.clone(), table))
            .ok_or(format!("{place} must be a table"))
    };
    list.iter().enumerate().map(named).collect()
}

fn text_of_key(table: &Table, place: &str, key: &str) -> Result<String, String> {
    let text = table.get(key).and_then(Value::as_str);
    text.map(str::to_owned)
        .ok_or(format!("{place}.{key} is missing or not text"))
}

fn number<T: TryFrom<i64>>(value: &Value, place: &str) -> Result<T, String> {
    let number = value
        .as_integer()
        .and_then(|number| T::try_from(number).ok());
    number.ok_or(format!("{place} is not a number in its range"))
}

#[cfg(test)]
mod tests {
    use super::*;

    pub fn dump() -> ParameterDump {
        let parameter = |code: &str, address, raw, text: Option<&str>| Parameter {
            code: code.to_owned(),
            address,
            raw,
            text: text.map(str::to_owned),
            title: "It \"is\" one".to_owned(),
        };
        ParameterDump {
            drive: "pump-1".to_owned(),
            model: "acme-1".to_owned(),
            station: Some(3),
            at: "2026-01-31T08:00:00.000Z".to_owned(),
            parameters: vec![
                parameter("F007", 0x020C, 100, Some("10.0 s")),
                parameter("F010", 0x0211, 3, None),
            ],
            unreadable: vec![UnreadableParameter {
                code: "F9".to_owned(),
                address: 9,
                reason: "no answer".to_owned(),
            }],
            left_out: vec![LeftOut {
                what: "F23 to F38".to_owned(),
                reason: "the drive\nrefuses".to_owned(),
            }],
        }
    }

    #[test]
    fn what_is_written_is_read_again() {
        let dump = dump();
        assert_eq!(ParameterDump::parse(&dump.text()), Ok(dump.clone()));
        let without = ParameterDump {
            station: None,
            unreadable: Vec::new(),
            parameters: Vec::new(),
            left_out: Vec::new(),
            ..dump
        };
        assert_eq!(ParameterDump::parse(&without.text()), Ok(without));
    }

    #[test]
    fn the_head_says_what_is_not_in_it() {
        let text = dump().text();
        let head: Vec<_> = text
            .lines()
            .take_while(|line| line.starts_with('#'))
            .collect();
        let wanted = [
            "# It holds 2 parameters. It does not hold:",
            "#   F9: no answer",
            "#   F23 to F38: the drive refuses",
            "#   what the drive keeps where no register shows it",
        ];
        assert_eq!(head[3..], wanted);
    }

    #[test]
    fn what_is_no_dump_is_reported() {
        let text = dump().text();
        for (old, new, expected) in [
            ("[drive]", "[drives]", "no `drives`"),
            ("model = ", "modell = ", "drive.model is missing"),
            (
                "raw = 100",
                "raw = 4294967296",
                "parameter[0].raw is not a number in its range",
            ),
            ("raw = 100", "raw = \"x\"", "parameter[0].raw"),
            (
                "address = 0x0211",
                "address = 0x020C",
                "0x020C occurs twice",
            ),
            (
                "[[unreadable]]\ncode = \"F9\"\n",
                "[[unreadable]]\n",
                "unreadable[0].code",
            ),
        ] {
            let wrong = ParameterDump::parse(&text.replacen(old, new, 1)).unwrap_err();
            assert!(wrong.contains(expected), "{new}: {wrong}");
        }
    }
}
