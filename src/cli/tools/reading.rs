//! What `read` and `watch` are to read, and its values for people and programs.

use super::CommandFailure;
use super::client::{DecodedValue, NoAnswer, UNIFORM, UniformWord, UnitClient, address};
use super::own_gateway::ToolAccess;
use super::target::{DriveTarget, ReachedDrive};
use crate::domain::address::DataTable;
use crate::domain::problem::nearest;
use crate::profile::model::{Model, Register};
use serde_json::json;

/// The selection for `read` and `watch` alike.
#[derive(Debug, clap::Args)]
pub struct ReadSelection {
    #[command(flatten)]
    pub target: DriveTarget,
    /// Register by its number on the wire (0x0101 or 257); with `--uniform` or directly on a port also by its name or code
    /// (A60, also where the model has no such register but a rule for codes), or omitted for all of them
    #[arg(required_unless_present_any = ["uniform", "station"])]
    register: Option<String>,
    /// Number of registers
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=125))]
    count: u16,
    /// The unit is a uniform one, whose registers have names
    #[arg(long)]
    uniform: bool,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// What is requested, resolved before anything is opened.
pub enum ReadRequest {
    /// Registers by number: the first and how many.
    Numbers(u16, u16),
    /// Words of the uniform map.
    Names(Vec<UniformWord>),
    /// Registers of a model.
    Registers(Vec<Register>),
}

impl ReadSelection {
    /// What the arguments request.
    ///
    /// # Errors
    /// Neither a number nor a known name.
    pub fn asked(&self) -> Result<ReadRequest, CommandFailure> {
        if let Some(model) = self.target.model()?
            && !self.uniform
        {
            return self.asked_of(&model);
        }
        let Some(register) = &self.register else {
            return Ok(ReadRequest::Names(UNIFORM.to_vec()));
        };
        if self.uniform
            && let Some(word) = UNIFORM.iter().find(|word| word.name == register)
        {
            return Ok(ReadRequest::Names(vec![*word]));
        }
        match address(register) {
            Ok(first) if first.checked_add(self.count - 1).is_some() => {
                Ok(ReadRequest::Numbers(first, self.count))
            }
            Ok(first) => Err(CommandFailure::wrong(format!(
                "{} registers from {first} on pass the last one",
                self.count
            ))),
            Err(_) if self.uniform => Err(CommandFailure::wrong(no_name(register))),
            Err(error) => Err(CommandFailure::wrong(
                match UNIFORM.iter().find(|word| word.name == register) {
                    Some(_) => format!("{error}; names are those of uniform units: add --uniform"),
                    None => error,
                },
            )),
        }
    }
}

impl ReadSelection {
    /// What they request directly on a port, where the model gives names: without one, what a gateway would poll.
    fn asked_of(&self, model: &Model) -> Result<ReadRequest, CommandFailure> {
        let readable = |register: &&Register| register.access.can_read();
        let Some(wanted) = &self.register else {
            let polled = model
                .registers
                .iter()
                .filter(readable)
                .filter(|register| register.poll.is_some());
            return Ok(ReadRequest::Registers(polled.cloned().collect()));
        };
        let named = model
            .register_named(wanted)
            .or_else(|| model.register_at(address(wanted).ok()?));
        if self.count == 1
            && let Some(register) = named.filter(readable)
        {
            return Ok(ReadRequest::Registers(vec![register.clone()]));
        }
        if let Some(register) =
            named.filter(|register| register.address.table() != DataTable::Holding)
        {
            let what = if register.access.can_read() {
                "is read alone, without --count"
            } else {
                "cannot be read"
            };
            return Err(CommandFailure::wrong(format!(
                "{} ({}) {what}",
                register.name, register.address
            )));
        }
        let by_code = || {
            model
                .codes
                .as_ref()
                .and_then(|rule| rule.address_typed(wanted))
        };
        let number = || address(wanted).or_else(|error| by_code().ok_or(error));
        let first = named.map_or_else(number, |register| Ok(register.address.number()));
        let first = first.map_err(|error| {
            let names = model
                .registers
                .iter()
                .flat_map(|it| [Some(it.name.as_str()), it.code.as_deref()])
                .flatten();
            let hint = nearest(wanted, names)
                .map(|near| format!("; did you mean {near}?"))
                .unwrap_or_default();
            CommandFailure::wrong(format!("{error}, or a name or code of {}{hint}", model.id))
        })?;
        match first.checked_add(self.count - 1) {
            Some(_) => Ok(ReadRequest::Numbers(first, self.count)),
            None => Err(CommandFailure::wrong(format!(
                "{} registers from {first} on pass the last one",
                self.count
            ))),
        }
    }

    /// Whether there is no gateway between.
    pub const fn is_straight(&self) -> bool {
        self.target.is_straight()
    }

    /// The path to the drive.
    ///
    /// # Errors
    /// The arguments do not go together, or directly on a port the drive does not answer.
    pub async fn reach(&self) -> Result<ReachedDrive, CommandFailure> {
        self.target.reach(self.uniform, &self.extra()).await
    }

    /// What is shown, in one line.
    pub fn title(&self) -> String {
        let (place, number) = self.target.place();
        format!("{place} {number}")
    }

    /// What a gateway of our own has to do for this: uniform words are based on what is polled.
    fn extra(&self) -> ToolAccess {
        ToolAccess {
            poll: self
                .uniform
                .then_some(std::time::Duration::from_millis(250)),
            ..ToolAccess::default()
        }
    }
}

fn no_name(register: &str) -> String {
    let near = nearest(register, UNIFORM.iter().map(|word| word.name));
    let hint = near
        .map(|near| format!("; did you mean {near}?"))
        .unwrap_or_default();
    format!("{register} is neither a number nor a name of the uniform map{hint}")
}

/// One value as it is printed.
#[derive(Clone, Debug, PartialEq)]
pub struct ShownValue {
    /// Its name or number.
    pub label: String,
    address: u16,
    words: Vec<u16>,
    value: Option<DecodedValue>,
}

impl ShownValue {
    /// One word of an unknown register.
    #[cfg(test)]
    pub fn word(label: &str, address: u16, word: u16) -> Self {
        Self {
            label: label.to_owned(),
            address,
            words: vec![word],
            value: None,
        }
    }

    /// The value of `register`.
    ///
    /// Without the others on which it may depend, its words are all that is known.
    fn of_model(register: &Register, words: Vec<u16>) -> Self {
        let first = words.first().copied().unwrap_or_default();
        let meaning = register
            .meaning(first)
            .map(|text| DecodedValue::Meaning(first, text.to_owned()));
        let number = register
            .value(|address| address.word_in(register.address, &words))
            .and_then(|value| {
                let (raw, scale) = value.fraction();
                Some(DecodedValue::Number(
                    raw,
                    u32::try_from(scale).ok()?,
                    register.unit,
                ))
            });
        let value = meaning.or(number);
        let code = register
            .code
            .as_ref()
            .map(|code| format!("{code} "))
            .unwrap_or_default();
        let label = format!("{code}{}", register.name);
        Self {
            label,
            address: register.address.number(),
            words,
            value,
        }
    }

    /// The value: with its unit if its meaning is known, else in decimal and hexadecimal.
    pub fn text(&self) -> String {
        match &self.value {
            Some(value) => value.to_string(),
            None => self
                .words
                .iter()
                .map(|word| format!("{word:5}  0x{word:04X}"))
                .collect::<Vec<_>>()
                .join(" "),
        }
    }

    /// The value for programs.
    pub fn json(&self) -> serde_json::Value {
        let mut json = json!({ "address": self.address, "raw": self.words[0] });
        if self.words.len() > 1 {
            json["raw"] = json!(self.words);
        }
        if let Some(value) = &self.value {
            json["name"] = self.label.as_str().into();
            json["value"] = value.json();
            if let DecodedValue::Number(_, _, unit) = value {
                json["unit"] = unit.symbol().into();
            }
        }
        json
    }
}

impl ReadRequest {
    /// Reads it, name by name or in one piece.
    ///
    /// # Errors
    /// The first failure; no partial result is returned.
    pub async fn read(&self, client: &mut UnitClient) -> Result<Vec<ShownValue>, NoAnswer> {
        match self {
            Self::Numbers(first, count) => {
                let words = client.read(*first, *count).await?;
                let addresses = *first..=u16::MAX;
                let shown = |(address, word)| ShownValue {
                    label: format!("0x{address:04X}"),
                    address,
                    words: vec![word],
                    value: None,
                };
                Ok(addresses.zip(words).map(shown).collect())
            }
            Self::Registers(registers) => {
                let mut values = Vec::with_capacity(registers.len());
                for register in registers {
                    match client
                        .read_from(register.address, register.form.words())
                        .await
                    {
                        Ok(words) => values.push(ShownValue::of_model(register, words)),
                        // What the drive does not have must not hide what it has.
                        Err(NoAnswer::Exception(1..=4)) if registers.len() > 1 => {}
                        Err(error) => return Err(error),
                    }
                }
                Ok(values)
            }
            Self::Names(names) => {
                let mut values = Vec::with_capacity(names.len());
                for word in names {
                    let words = match client.read(word.address, word.words()).await {
                        // Another version may have fewer words; a request for all shows those that exist.
                        Err(NoAnswer::Exception(2)) if names.len() > 1 => continue,
                        read => read?,
                    };
                    let value = Some(DecodedValue::understand(word.form, &words));
                    values.push(ShownValue {
                        label: word.name.to_owned(),
                        address: word.address,
                        words,
                        value,
                    });
                }
                Ok(values)
            }
        }
    }
}
