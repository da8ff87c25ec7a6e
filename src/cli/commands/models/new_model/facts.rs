//! What `models new` knows of a drive, and the model file that says it.

use crate::domain::link::LinkSettings;
use crate::toml_file::words::{PARITIES, word_for};
use serde_json::json;
use std::fmt::Write;

/// Where a fact comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FactEvidence {
    /// The manual, at this place.
    Manual(String),
    /// The person who answered, in these words.
    Person(String),
    /// A device template, at this place of it.
    Template(String),
}

impl FactEvidence {
    /// The keys `confidence` and `source`.
    pub fn keys(&self) -> String {
        format!(
            "confidence = \"{}\"\nsource = {}\n",
            self.grade(),
            json!(self.source())
        )
    }

    /// Its grade, as model files write it.
    pub const fn grade(&self) -> &'static str {
        match self {
            Self::Manual(_) => "manual",
            Self::Person(_) | Self::Template(_) => "third-party",
        }
    }

    /// The document, and the place in it.
    pub fn source(&self) -> String {
        match self {
            Self::Manual(place) => format!("UM {place}"),
            Self::Person(words) => format!("SN {words}"),
            Self::Template(place) => format!("TP {place}"),
        }
    }

    /// This evidence, with the place that states the raw steps of the register.
    #[must_use]
    pub fn and_steps(self, place: Option<String>) -> Self {
        match (self, place) {
            (Self::Manual(of), Some(place)) if of != place => {
                Self::Manual(format!("{of}, steps {place}"))
            }
            (Self::Person(of), Some(place)) => Self::Person(format!("{of}, steps {place}")),
            (evidence, _) => evidence,
        }
    }

    /// The keys `confidence` and `source` as they are written in an inline table.
    pub fn inline(&self) -> String {
        self.keys().trim_end().replace('\n', ", ")
    }
}

/// The documents that the facts cite.
#[derive(Clone, Debug, Default)]
pub struct CitedDocuments {
    /// Title of the manual.
    pub manual: Option<String>,
    /// When the questions were answered.
    pub answered_on: Option<String>,
    /// Name of the device template.
    pub template: Option<String>,
}

/// A register.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RegisterFacts {
    /// Its name.
    pub name: String,
    /// Its title.
    pub title: String,
    /// The address on the wire.
    pub address: u16,
    /// Its table, if it is not a holding register.
    pub table: Option<&'static str>,
    /// Raw steps in one unit.
    pub scale: u32,
    /// The unit, as model files write it.
    pub unit: &'static str,
    /// Two's complement.
    pub signed: bool,
    /// `read`, `write` or `read-write`.
    pub access: &'static str,
    /// What the gateway uses it for.
    pub role: Option<&'static str>,
    /// How often it is read.
    pub poll: Option<&'static str>,
    /// Where it comes from.
    pub evidence: FactEvidence,
}

/// A flag of the status register.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FlagFacts {
    /// `running` or `tripped`.
    pub flag: &'static str,
    /// The bits that show it: all of them are 1 then.
    pub mask: u16,
    /// Where it comes from.
    pub evidence: FactEvidence,
}

/// A word of the run command. It comes from a place of its own: that the manual names the register says nothing of its words.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WordFacts {
    /// The word.
    pub value: u16,
    /// Where it comes from.
    pub evidence: FactEvidence,
}

/// The words of the run command.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunFacts {
    /// Stops the motor by its ramp.
    pub stop: WordFacts,
    /// Runs it forward.
    pub forward: WordFacts,
    /// Runs it in reverse.
    pub reverse: Option<WordFacts>,
}

impl RunFacts {
    /// The words by the names of their orders.
    pub fn words(&self) -> impl Iterator<Item = (&'static str, &WordFacts)> {
        let reverse = self.reverse.iter().map(|word| ("reverse", word));
        [("stop", &self.stop), ("forward", &self.forward)]
            .into_iter()
            .chain(reverse)
    }
}

/// A setting under which the drive obeys the line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SetupFacts {
    /// Its code at the panel.
    pub code: String,
    /// What it does, and to what it is set.
    pub text: String,
    /// Where it comes from.
    pub evidence: FactEvidence,
}

/// All that is known.
#[derive(Clone, Debug)]
pub struct ModelFacts {
    /// Identifier.
    pub id: String,
    /// The maker.
    pub vendor: String,
    /// The series.
    pub title: String,
    /// What the facts cite.
    pub documents: CitedDocuments,
    /// Settings of the line, and where they come from; `None`: look them up at the panel.
    pub link: Option<(LinkSettings, FactEvidence)>,
    /// Most words in one read, and where that comes from.
    pub max_words: (u16, FactEvidence),
    /// Functions that the drive has, and where they come from.
    pub functions: (Vec<u8>, FactEvidence),
    /// Where facts come from for which nothing was asked.
    pub evidence: FactEvidence,
    /// The run command; `None`: the model is only read.
    pub run: Option<RunFacts>,
    /// Flags of the register `status`.
    pub flags: Vec<FlagFacts>,
    /// Settings for the panel.
    pub setup: Vec<SetupFacts>,
    /// Registers.
    pub registers: Vec<RegisterFacts>,
    /// What was left out, for a comment.
    pub left_out: Vec<String>,
}

impl ModelFacts {
    /// The model file.
    pub fn text(&self) -> String {
        let mut text = self.head();
        self.link(&mut text);
        self.exchange(&mut text);
        self.orders(&mut text);
        for setup in &self.setup {
            let what = json!(setup.code);
            let _ = write!(
                text,
                "\n[[setup]]\nwhat = {what}\ntext = {}\n{}",
                json!(setup.text),
                setup.evidence.keys()
            );
        }
        for register in &self.registers {
            text.push_str(&register.text());
        }
        text
    }

    fn head(&self) -> String {
        let mut text = String::from(
            "# Made by `vfd-gateway models new`. Compare every line with the manual: no check can find a wrong digit.\n\
             # What a file can say is in docs/model-reference.md; deploy/adding-a-drive.md shows how.\n",
        );
        for what in &self.left_out {
            let _ = writeln!(text, "# Left out: {what}");
        }
        let (id, vendor, title) = (json!(self.id), json!(self.vendor), json!(self.title));
        let _ = write!(
            text,
            "\nid = {id}\nvendor = {vendor}\ntitle = {title}\n\n[documents]\n"
        );
        let mut document = |short: &str, title: &str, kind: &str| {
            let _ = writeln!(
                text,
                "{short} = {{ title = {}, kind = \"{kind}\", of = [{id}] }}",
                json!(title)
            );
        };
        if let Some(manual) = &self.documents.manual {
            document("UM", manual, "manual");
        }
        if let Some(date) = &self.documents.answered_on {
            document(
                "SN",
                &format!("Answers to the questions of `models new`, {date}"),
                "site-note",
            );
        }
        if let Some(template) = &self.documents.template {
            document("TP", template, "register-map");
        }
        text
    }

    fn link(&self, text: &mut String) {
        let of = self.evidence.inline();
        let _ = writeln!(text, "\n[link]");
        match &self.link {
            Some((link, evidence)) => {
                let LinkSettings {
                    baud,
                    data_bits,
                    parity,
                    stop_bits,
                } = link;
                let parity = word_for(&PARITIES, parity);
                let of = evidence.inline();
                let _ = write!(
                    text,
                    "default = {{ baud = {baud}, data_bits = {data_bits}, parity = \"{parity}\", stop_bits = {stop_bits}, {of} }}\n\
                     # Add the others that the manual lists.\n\
                     bauds = {{ value = [{baud}], {of} }}\nparities = {{ value = [\"{parity}\"], {of} }}\n\
                     stop_bits = {{ value = [{stop_bits}], {of} }}\n",
                );
            }
            None => {
                let _ = write!(
                    text,
                    "# Not known yet: the configuration has to state what is set at the panel.\n\
                     default = {{ ask = \"speed, parity and stop bits\", {of} }}\n\
                     bauds = {{ value = [9600, 19200], {of} }}\nparities = {{ value = [\"none\", \"even\", \"odd\"], {of} }}\n\
                     stop_bits = {{ value = [1, 2], {of} }}\n",
                );
            }
        }
        let _ = write!(
            text,
            "data_bits = {{ value = [8], {of} }}\nframings = {{ value = [\"rtu\"], {of} }}\n\
             interfaces = {{ value = [\"rs485\"], {of} }}\nstations = {{ from = 1, to = 247, {of} }}\n"
        );
    }

    fn exchange(&self, text: &mut String) {
        let (max, of_max) = &self.max_words;
        let (functions, of_functions) = &self.functions;
        let functions: Vec<_> = functions
            .iter()
            .map(|function| format!("0x{function:02X}"))
            .collect();
        let _ = write!(
            text,
            "\n[timing]\ngap_chars = {{ value = 3.5, {inline} }}\n\
             reply_timeout_cap = {{ value = \"500ms\", confidence = \"default\", source = \"no longest time is known\" }}\n\
             max_lateness = {{ value = \"1s\", confidence = \"default\", source = \"no longest time is known\" }}\n\n\
             [functions]\nvalue = [{functions}]\n{of_functions}\n\
             [read]\nmax_words = {{ value = {max}, {of_max} }}\n\n\
             [write]\nrefused = {{ value = \"exception\", {inline} }}\n",
            inline = self.evidence.inline(),
            functions = functions.join(", "),
            of_functions = of_functions.keys(),
            of_max = of_max.inline(),
        );
    }

    fn orders(&self, text: &mut String) {
        if let Some(run) = &self.run {
            text.push_str("\n[run]\nform = \"values\"\n");
            for (name, WordFacts { value, evidence }) in run.words() {
                let _ = writeln!(
                    text,
                    "{name} = {{ value = 0x{value:04X}, {} }}",
                    evidence.inline()
                );
            }
        }
        for FlagFacts {
            flag,
            mask,
            evidence,
        } in &self.flags
        {
            let of = evidence.keys();
            let _ = write!(
                text,
                "\n[[status]]\nflag = \"{flag}\"\nregister = \"status\"\nmask = 0x{mask:04X}\nvalues = [0x{mask:04X}]\n{of}"
            );
        }
    }
}

impl RegisterFacts {
    fn text(&self) -> String {
        let mut text = format!(
            "\n[[register]]\nname = {}\ntitle = {}\n",
            json!(self.name),
            json!(self.title)
        );
        let _ = writeln!(text, "address = 0x{:04X}", self.address);
        if let Some(table) = self.table {
            let _ = writeln!(text, "table = \"{table}\"");
        }
        if self.scale != 1 {
            let _ = writeln!(text, "scale = {}", self.scale);
        }
        let _ = writeln!(
            text,
            "unit = \"{}\"\naccess = \"{}\"",
            self.unit, self.access
        );
        if self.signed {
            text.push_str("signed = true\n");
        }
        for (key, word) in [("role", self.role), ("poll", self.poll)] {
            if let Some(word) = word {
                let _ = writeln!(text, "{key} = \"{word}\"");
            }
        }
        text.push_str(&self.evidence.keys());
        text
    }
}
