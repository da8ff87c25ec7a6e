//! `read`: registers or named values of one drive, once, through a running gateway.

use super::client::{Client, NoAnswer, Target, UNIFORM, UniformWord, Value, address};
use super::{Failure, print};
use crate::domain::problem::nearest;
use serde_json::json;
use std::fmt::Write;

/// What is read, for `read` and `watch` alike.
#[derive(Debug, clap::Args)]
pub struct What {
    #[command(flatten)]
    pub target: Target,
    /// Register by its number on the wire (0x0101 or 257); with `--uniform` also by its name, or left out for all
    #[arg(required_unless_present = "uniform")]
    register: Option<String>,
    /// How many registers from there on
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=125))]
    count: u16,
    /// The unit is a uniform one, whose registers have names
    #[arg(long)]
    uniform: bool,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `read`.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    what: What,
}

/// Reads once and prints what came.
pub fn read(args: &Args) -> Result<(), Failure> {
    let asked = args.what.asked()?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(Failure::failed)?;
    let values = runtime.block_on(async { asked.read(&mut Client::new(&args.what.target)).await })?;
    if args.what.json {
        let values: Vec<_> = values.iter().map(Shown::json).collect();
        return print(&format!("{}\n", json!({ "unit": args.what.target.unit, "values": values })));
    }
    let width = values.iter().map(|value| value.label.len()).max().unwrap_or(0);
    let mut text = String::new();
    for value in &values {
        let _ = writeln!(text, "{:width$}  {}", value.label, value.text());
    }
    print(&text)
}

/// What is asked for, found out before anything is opened.
pub enum Asked {
    /// Registers by number: the first and how many.
    Numbers(u16, u16),
    /// Words of the uniform map.
    Names(Vec<UniformWord>),
}

impl What {
    /// What the arguments ask for.
    ///
    /// # Errors
    /// Neither a number nor a name that there is.
    pub fn asked(&self) -> Result<Asked, Failure> {
        let Some(register) = &self.register else { return Ok(Asked::Names(UNIFORM.to_vec())) };
        if self.uniform
            && let Some(word) = UNIFORM.iter().find(|word| word.name == register)
        {
            return Ok(Asked::Names(vec![*word]));
        }
        match address(register) {
            Ok(first) if first.checked_add(self.count - 1).is_some() => Ok(Asked::Numbers(first, self.count)),
            Ok(first) => Err(Failure::wrong(format!("{} registers from {first} on pass the last one", self.count))),
            Err(_) if self.uniform => Err(Failure::wrong(no_name(register))),
            Err(error) => Err(Failure::wrong(match UNIFORM.iter().find(|word| word.name == register) {
                Some(_) => format!("{error}; names are those of uniform units: add --uniform"),
                None => error,
            })),
        }
    }
}

fn no_name(register: &str) -> String {
    let near = nearest(register, UNIFORM.iter().map(|word| word.name));
    let hint = near.map(|near| format!("; did you mean {near}?")).unwrap_or_default();
    format!("{register} is neither a number nor a name of the uniform map{hint}")
}

/// One value as it is printed.
#[derive(Clone, Debug, PartialEq)]
pub struct Shown {
    /// Its name or number.
    pub label: String,
    address: u16,
    words: Vec<u16>,
    value: Option<Value>,
}

impl Shown {
    /// The value: with its unit if it is known what it is, else in decimal and hexadecimal.
    pub fn text(&self) -> String {
        match &self.value {
            Some(value) => value.to_string(),
            None => self.words.iter().map(|word| format!("{word:5}  0x{word:04X}")).collect::<Vec<_>>().join(" "),
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
            if let Value::Number(_, _, unit) = value {
                json["unit"] = unit.symbol().into();
            }
        }
        json
    }
}

impl Asked {
    /// Reads it, name by name or in one piece.
    ///
    /// # Errors
    /// The first failure; nothing is returned of a part.
    pub async fn read(&self, client: &mut Client) -> Result<Vec<Shown>, NoAnswer> {
        match self {
            Self::Numbers(first, count) => {
                let words = client.read(*first, *count).await?;
                let addresses = *first..=u16::MAX;
                let shown = |(address, word)| Shown {
                    label: format!("0x{address:04X}"),
                    address,
                    words: vec![word],
                    value: None,
                };
                Ok(addresses.zip(words).map(shown).collect())
            }
            Self::Names(names) => {
                let mut values = Vec::with_capacity(names.len());
                for word in names {
                    let words = match client.read(word.address, word.words()).await {
                        // Another version may have fewer words; who wants to see all sees those that are there.
                        Err(NoAnswer::Exception(2)) if names.len() > 1 => continue,
                        read => read?,
                    };
                    let value = Some(Value::understand(word.form, &words));
                    values.push(Shown { label: word.name.to_owned(), address: word.address, words, value });
                }
                Ok(values)
            }
        }
    }
}
