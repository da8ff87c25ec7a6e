//! Whatever bits and fields a model file gives its run words: if the check lets it pass, a simulated drive, which reads
//! the file by itself, does with each run command what its name says, and with a 0 what the file says.

use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::TestRunner;
use std::fmt::Write;
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::Direction;
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::profile::check;
use vfd_gateway::profile::model::{BitMeaning, BitSense, Model, WordEffect, WordSenses, ZeroWord};
use vfd_gateway::profile::words::{BIT_MEANINGS, ZERO_WORDS};
use vfd_gateway::sim::{DriveOptions, SimDrive};

const BASE: &str = include_str!("../golden/models/zero-coast.toml");
const TABLES: usize = 500;
/// Other words that are tried as a command of each sound table.
const WILD: u16 = 40;
const RUN: u16 = 0x2000;
const SETPOINT: u16 = 0x2001;
/// Above the single bits.
const FIELD: u16 = 0x00C0;
/// All words of these bits and that field.
const WORDS: u16 = 0x0100;

/// A `[run]` table.
#[derive(Clone, Debug)]
struct Table {
    /// Bit 0 upwards: a meaning, and whether it holds while the bit is 0.
    bits: Vec<(usize, bool)>,
    /// The meanings of the field's values; none for a table without it.
    field: Option<[Option<usize>; 4]>,
    /// Which of the words that fit are taken as commands: stop, forward, reverse, coast, reset.
    picks: Vec<prop::sample::Index>,
    /// A command whose word need not fit.
    wild: Option<(usize, u16)>,
    zero: Option<usize>,
}

/// Meanings other than whom the drive obeys, which depends on more than the word.
fn meanings() -> Vec<(&'static str, BitMeaning)> {
    let depends = [BitMeaning::BusRun, BitMeaning::BusFrequency];
    BIT_MEANINGS
        .into_iter()
        .filter(|(_, meaning)| !depends.contains(meaning))
        .collect()
}

fn table() -> impl Strategy<Value = Table> {
    let meaning = 0..meanings().len();
    let field = prop::array::uniform4(prop::option::of(meaning.clone()));
    let bits = prop::collection::vec((meaning, prop::bool::weighted(0.4)), 2..=6);
    let picks = prop::collection::vec(any::<prop::sample::Index>(), 5);
    (
        bits,
        prop::option::weighted(0.4, field),
        picks,
        prop::option::weighted(0.1, 0..ZERO_WORDS.len()),
    )
        .prop_map(|(bits, field, picks, zero)| Table {
            bits,
            field,
            picks,
            wild: None,
            zero,
        })
}

impl Table {
    fn senses(&self) -> WordSenses {
        let known = meanings();
        let bits = (0..)
            .zip(&self.bits)
            .map(|(bit, (meaning, inverted))| BitSense::of_bit(bit, *inverted, known[*meaning].1));
        let field = self.field.iter().flatten().zip(0..);
        let field = field.filter_map(|(meaning, value)| {
            Some(BitSense::of_field(FIELD, value, known[(*meaning)?].1))
        });
        WordSenses(bits.chain(field).collect())
    }

    /// The bits that have a meaning.
    fn declared(&self) -> u16 {
        let field = if self.field.is_some() { FIELD } else { 0 };
        (0..self.bits.len()).fold(field, |all, bit| all | 1 << bit)
    }

    /// A word that `fits`, or the wild one; `None` if no word fits.
    fn pick(&self, place: usize, fits: impl Fn(u16) -> bool) -> Option<u16> {
        if let Some((_, word)) = self.wild.filter(|(wild, _)| *wild == place) {
            return Some(word);
        }
        let fitting: Vec<u16> = (0..WORDS)
            .filter(|word| word & !self.declared() == 0 && fits(*word))
            .collect();
        (!fitting.is_empty()).then(|| *self.picks[place].get(&fitting))
    }

    /// The model file; `None` if no word could be its stop or its forward.
    fn text(&self) -> Option<String> {
        let known = meanings();
        let senses = self.senses();
        let has_one =
            |word: u16, of: &[BitMeaning]| of.iter().any(|meaning| senses.has(word, *meaning));
        // What no command may mean, what none but a run order may, and what a run order may not.
        let never = [BitMeaning::Trip, BitMeaning::Toggle, BitMeaning::Ignored];
        let turns = [
            BitMeaning::Run,
            BitMeaning::RunForward,
            BitMeaning::RunReverse,
            BitMeaning::Jog,
        ];
        let beside = [BitMeaning::Freeze, BitMeaning::Reset, BitMeaning::Jog];
        let stops = [BitMeaning::QuickStop, BitMeaning::DcBrake];
        let does =
            |effect: WordEffect, word: u16| senses.effect(word) == effect && !has_one(word, &never);
        let runs = |direction, word| {
            does(WordEffect::Run(Some(direction)), word) && !has_one(word, &beside)
        };
        let stands =
            |effect, word| does(effect, word) && !has_one(word, &turns) && !has_one(word, &beside);
        let stop = self.pick(0, |word| {
            let has_stop = !senses.exists(BitMeaning::Stop) || senses.has(word, BitMeaning::Stop);
            stands(WordEffect::Stop, word) && has_stop && !has_one(word, &stops)
        })?;
        let forward = self.pick(1, |word| runs(Direction::Forward, word))?;
        let reverse = self.pick(2, |word| runs(Direction::Reverse, word));
        let coast = self.pick(3, |word| stands(WordEffect::Coast, word));
        let reset = self.pick(4, |word| {
            senses.has(word, BitMeaning::Reset) && !has_one(word, &never) && !has_one(word, &turns)
        });
        let zero = self.zero.map_or_else(
            || zero_by(senses.effect(0)),
            |zero| Some(ZERO_WORDS[zero].0),
        )?;
        let origin = "confidence = \"manual\", source = \"UM 4\"";
        let mut text = "[run]\nform = \"bits\"\n".to_owned();
        let words = [
            ("stop", Some(stop)),
            ("forward", Some(forward)),
            ("reverse", reverse),
            ("coast", coast),
            ("reset", reset),
        ];
        for (name, word) in words
            .into_iter()
            .filter_map(|(name, word)| Some((name, word?)))
        {
            writeln!(text, "{name} = {{ value = {word}, {origin} }}").unwrap();
        }
        if let Some(reset) = reset {
            writeln!(text, "reset_sequence = [{stop}, {reset}, {stop}]").unwrap();
        }
        writeln!(text, "zero = {{ value = \"{zero}\", {origin} }}").unwrap();
        let origin = origin.replace(", ", "\n");
        for (bit, (meaning, inverted)) in self.bits.iter().enumerate() {
            let when = u8::from(!inverted);
            let meaning = known[*meaning].0;
            writeln!(
                text,
                "[[run.bit]]\nbit = {bit}\nmeaning = \"{meaning}\"\nwhen = {when}\n{origin}"
            )
            .unwrap();
        }
        if let Some(field) = &self.field {
            let value = |(value, meaning): (usize, &Option<usize>)| {
                format!(
                    "\"{value}\" = \"{}\"",
                    meaning.map_or("nothing", |meaning| known[meaning].0)
                )
            };
            let values: Vec<_> = field.iter().enumerate().map(value).collect();
            let values = values.join(", ");
            writeln!(
                text,
                "[[run.field]]\nmask = {FIELD}\nvalues = {{ {values} }}\n{origin}"
            )
            .unwrap();
        }
        let begin = BASE.find("[run]").unwrap();
        let end = BASE.find("[[status]]").unwrap();
        Some(format!("{}{text}\n{}", &BASE[..begin], &BASE[end..]))
    }
}

fn zero_by(effect: WordEffect) -> Option<&'static str> {
    Some(match effect {
        WordEffect::Ignored => "ignored",
        WordEffect::Coast => "coast",
        WordEffect::Stop => "stop",
        WordEffect::Nothing => "nothing",
        WordEffect::Release | WordEffect::Trip | WordEffect::Run(_) | WordEffect::Turns => {
            return None;
        }
    })
}

/// A drive, and the moment.
struct Bench {
    drive: SimDrive,
    now: MonoTime,
}

impl Bench {
    fn new(model: &Arc<Model>) -> Self {
        let mut bench = Self {
            drive: SimDrive::new(Arc::clone(model), DriveOptions::default()),
            now: MonoTime::from_millis(1),
        };
        assert!(bench.write(SETPOINT, 3000));
        bench
    }

    /// One whose motor has been run by `word` for a while.
    fn running(model: &Arc<Model>, word: u16) -> Self {
        let mut bench = Self::new(model);
        assert!(bench.write(RUN, word), "0x{word:04X} is taken");
        bench.pass();
        bench
    }

    /// Whether the drive answers as if it had taken `word`.
    fn write(&mut self, address: u16, word: u16) -> bool {
        let words = [address, word].map(u16::to_be_bytes);
        let pdu = [vec![6], words.concat()].concat();
        let mut reply = Vec::new();
        self.drive.answer(self.now, &pdu, 0, &mut reply) && reply == pdu
    }

    fn pass(&mut self) {
        self.now = self.now + Duration::from_secs(30);
    }

    /// The output in hertz.
    fn output(&mut self) -> i64 {
        self.drive.output(self.now) / 1_000_000
    }

    /// What the drive has been ordered to, and its output at once.
    fn does(&mut self, word: u16, text: &str) -> (Option<Direction>, i64) {
        assert!(self.write(RUN, word), "0x{word:04X} is taken\n{text}");
        let output = self.output();
        (self.drive.ordered(), output)
    }
}

fn commands_do_what_they_say(model: &Arc<Model>, text: &str) {
    let run = model.run.as_ref().unwrap();
    let forward = (Direction::Forward, run.forward.value, 30);
    let reverse = run
        .reverse
        .as_ref()
        .map(|reverse| (Direction::Reverse, reverse.value, -30));
    for (direction, word, hertz) in [forward].into_iter().chain(reverse) {
        let mut bench = Bench::running(model, word);
        assert_eq!(
            (bench.drive.ordered(), bench.output()),
            (Some(direction), hertz),
            "{text}"
        );
        assert_eq!(
            bench.does(run.stop.value, text),
            (None, hertz),
            "a stop ramps down\n{text}"
        );
        bench.pass();
        assert_eq!(bench.output(), 0, "{text}");
        // A run order in the other direction before it changes nothing.
        for (_, other, _) in [forward].into_iter().chain(reverse) {
            let mut bench = Bench::running(model, other);
            bench.does(word, text);
            bench.pass();
            assert_eq!(bench.output(), hertz, "{text}");
        }
        if let Some(coast) = &run.coast {
            assert_eq!(
                Bench::running(model, word).does(coast.value, text),
                (None, 0),
                "{text}"
            );
        }
        let mut bench = Bench::running(model, word);
        let expected = match run.zero.as_ref().unwrap().value {
            ZeroWord::Stop => (None, hertz),
            ZeroWord::Coast => (None, 0),
            ZeroWord::Nothing | ZeroWord::Ignored => (Some(direction), hertz),
            ZeroWord::Release => panic!("nothing here releases\n{text}"),
        };
        assert_eq!(bench.does(0, text), expected, "{text}");
    }
    if let Some(reset) = &run.reset {
        let mut bench = Bench::running(model, run.forward.value);
        bench.drive.trip(bench.now, 2);
        for word in [run.stop.value, reset.value, run.stop.value] {
            bench.does(word, text);
        }
        bench.pass();
        assert_eq!(
            (bench.drive.is_tripped(), bench.output()),
            (false, 0),
            "{text}"
        );
    }
}

/// Not only commands: all words of bits and fields do what the core says of them.
fn words_do_what_is_said_of_them(model: &Arc<Model>, text: &str) {
    let run = model.run.as_ref().unwrap();
    let senses = run.form.senses();
    for word in 0..WORDS {
        let mut bench = Bench::running(model, run.forward.value);
        if !bench.write(RUN, word) {
            assert!(
                bench.output() == 30,
                "a refused word changes nothing\n{text}"
            );
            continue;
        }
        let output = bench.output();
        let effect = senses.effect(word);
        let is_as_said = match effect {
            // A reset beside it ends the trip at once.
            WordEffect::Trip => {
                bench.drive.is_tripped() || senses.has(word, BitMeaning::Reset) && output == 0
            }
            WordEffect::Coast => output == 0,
            WordEffect::Stop => bench.drive.ordered().is_none() && output == 30,
            WordEffect::Run(Some(direction)) => bench.drive.ordered() == Some(direction),
            WordEffect::Run(None) | WordEffect::Turns => bench.drive.ordered().is_some(),
            WordEffect::Ignored | WordEffect::Nothing => {
                bench.pass();
                bench.output() == 30 && !bench.drive.is_tripped()
            }
            WordEffect::Release => false,
        };
        assert!(
            is_as_said,
            "0x{word:04X} {effect:?}: {output} Hz, {:?}\n{text}",
            bench.drive.ordered()
        );
    }
}

/// The model of `table` and its `[run]` table; `None` if the check refuses it.
fn sound(table: &Table) -> Option<(Arc<Model>, String)> {
    let text = table.text()?;
    let model = check::model(&text).ok()?;
    let run = text.find("[run]").unwrap()..text.find("[[status]]").unwrap();
    Some((Arc::new(model), text[run].to_owned()))
}

#[test]
fn a_model_that_passes_the_check_is_commanded_as_its_words_say() {
    let mut runner = TestRunner::deterministic();
    let strategy = table();
    // Sound tables, those with a field, and those with a word that was not looked for.
    let mut counts = [0; 3];
    for _ in 0..TABLES {
        let table = strategy.new_tree(&mut runner).unwrap().current();
        let Some((model, text)) = sound(&table) else {
            continue;
        };
        commands_do_what_they_say(&model, &text);
        words_do_what_is_said_of_them(&model, &text);
        counts[0] += 1;
        counts[1] += u32::from(table.field.is_some());
        for n in 0..WILD {
            let wild = Some((usize::from(n % 5), n * 83 % WORDS));
            let Some((model, text)) = sound(&Table {
                wild,
                ..table.clone()
            }) else {
                continue;
            };
            commands_do_what_they_say(&model, &text);
            counts[2] += 1;
        }
    }
    assert!(
        counts[0] >= 60 && counts[1] >= 25 && counts[2] >= 30,
        "{counts:?}"
    );
}
