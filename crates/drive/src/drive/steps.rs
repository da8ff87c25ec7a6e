//! Translates an order into a bounded list of steps according to the model.

mod before_run;
mod reset;
mod setpoint;
#[cfg(test)]
mod tests;

pub use reset::{of_reset, of_take_back};

use super::bases::FrequencyBases;
use crate::domain::address::Address;
use crate::domain::command::{Direction, GoOrder, Reason, RegisterWrite};
use crate::domain::control::ControlSettings;
use crate::domain::frequency::Hertz;
use crate::profile::model::{ClearWords, CommitWord, IndicatedState, Model, OrderKind};
use crate::wire::pdu::{Request, function};
use setpoint::{check_setting, setpoint, setpoint_and_run, setpoint_of_run};
use std::time::Duration;

/// How long a drive may take to show what it has acknowledged: the next cycle of its firmware, or the start of a ramp.
pub const SHOWN_WITHIN: Duration = Duration::from_secs(1);

/// One exchange of a command, or a pause in it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CommandStep {
    /// Read a register before anything is written. The command is refused if its word is outside this range.
    Check {
        /// The register.
        address: Address,
        /// Lowest word that lets the command go on.
        least: u16,
        /// Highest accepted word.
        most: u16,
        /// Why the command is refused otherwise.
        reason: Reason,
    },
    /// Read a register before anything is written: the masked word must be one of `values`. Otherwise the command is
    /// refused with `reason`, which names the register and its word.
    Require {
        /// The register.
        address: Address,
        /// The bits that are compared.
        mask: u16,
        /// The acceptable masked words.
        values: Vec<u16>,
        /// Why the command is refused otherwise.
        reason: Reason,
    },
    /// Write a register, or neighbours in one frame, in the order of their addresses. Never empty.
    Write(Vec<WriteStep>),
    /// Read a register until it shows that what was written before has taken effect; else the command has failed.
    Await(AwaitStep),
    /// Read a register: if it meets the condition, the next steps are left out.
    Skip(SkipSteps),
    /// Write nothing more for this long.
    Pause(Duration),
    /// Send nothing to the drive for this long.
    Rest(Duration),
}

/// What the drive must show before a command goes on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AwaitStep {
    /// The condition; `within` is its time limit.
    pub condition: RegisterCondition,
    /// How long after the write before it the register is read at the earliest.
    pub at_least: Duration,
    /// Why the command has failed if the drive does not show it.
    pub reason: Reason,
}

/// Steps that a drive in some state does not need.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SkipSteps {
    /// The state.
    pub condition: RegisterCondition,
    /// Number of steps that are left out then.
    pub count: usize,
}

/// One word that a command writes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WriteStep {
    /// The register.
    pub address: Address,
    /// The word.
    pub value: u16,
    /// What it does.
    pub part: StepPart,
    /// Where the drive shows the effect; empty if it does not.
    pub shown: Vec<RegisterCondition>,
}

/// A condition on a register.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RegisterCondition {
    /// The register.
    pub address: Address,
    /// The bits that count.
    pub mask: u16,
    /// Masked words.
    pub values: Vec<u16>,
    /// The word at the next address, for a value of two words, which is read in the same frame.
    pub second: Option<u16>,
    /// The words that meet it instead of these; `None`: the masked word must be one of them.
    pub instead: Option<ClearWords>,
    /// How long the drive may take to meet it.
    pub within: Duration,
}

impl RegisterCondition {
    /// The register holds exactly `value`.
    const fn holds(address: Address, value: Vec<u16>, within: Duration) -> Self {
        Self {
            address,
            mask: u16::MAX,
            values: value,
            second: None,
            instead: None,
            within,
        }
    }

    /// The model's `flag` is set or not; `None` if it has no such flag.
    fn flag(model: &Model, flag: IndicatedState, is_set: bool) -> Option<Self> {
        let flag = model.status_flag(flag)?;
        Some(Self {
            address: flag.address,
            mask: flag.mask,
            values: flag.values.clone(),
            second: None,
            instead: (!is_set).then(|| flag.clear.clone()),
            within: SHOWN_WITHIN,
        })
    }

    /// Whether `word` meets it.
    #[must_use]
    pub fn is_met(&self, word: u16) -> bool {
        let is_one = self.values.contains(&(word & self.mask));
        self.instead
            .as_ref()
            .map_or(is_one, |instead| !is_one && instead.names(word))
    }

    /// Whether the words that were read from its register on meet it.
    #[must_use]
    pub fn is_met_by(&self, words: &[u16]) -> bool {
        let has_second = self
            .second
            .is_none_or(|second| words.get(1) == Some(&second));
        has_second && words.first().is_some_and(|word| self.is_met(*word))
    }

    /// How many words have to be read for it.
    #[must_use]
    pub const fn words(&self) -> u16 {
        if self.second.is_some() { 2 } else { 1 }
    }
}

/// The purpose of a write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StepPart {
    /// The step sets a register without a role.
    Register,
    /// The step takes over or stores the registers that were set before.
    Commit,
    /// The step gives the setpoint.
    Setpoint(Hertz),
    /// The step gives the setpoint, whose sign orders the direction: a motor that turns follows it at once.
    SignedSetpoint(Hertz, Direction),
    /// The step starts the motor.
    Run(Direction),
    /// The step prepares the drive for the run word.
    Start,
    /// The step gives the direction of the run word that follows.
    Direction(Direction),
    /// The step belongs to a reset.
    Reset {
        /// The step writes the reset word; all other words stop the motor or clear the reset.
        resets: bool,
        /// The step is the last one.
        ends: bool,
        /// The drive shows afterwards whether a trip holds.
        is_seen: bool,
    },
    /// The step releases control.
    Release,
    /// The step replaces a reset word that was left in the register.
    TakesBack,
    /// The step takes back a start that the drive did not follow.
    TakesStartBack,
}

impl StepPart {
    /// The setpoint that it gives.
    #[must_use]
    pub const fn setpoint(self) -> Option<Hertz> {
        match self {
            Self::Setpoint(frequency) | Self::SignedSetpoint(frequency, _) => Some(frequency),
            _ => None,
        }
    }
}

/// Why an order has no steps on a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoSteps {
    /// The model has no such command.
    NotCapable,
    /// The frequency lies between two steps of its register, or outside its range.
    BetweenSteps,
    /// The model requires the setpoint with each RUN, and none has been given yet.
    SetpointUnknown,
}

/// The steps of an order that sets something: registers, then the setpoint, then run; setpoint and run in one frame
/// if the model allows it. At most one step for each part of the order and one before them: RUN without a setpoint
/// checks the drive's own setting first, or repeats `last`, the last accepted setpoint, if the model cannot show its
/// setting or cannot be relied on to keep it.
///
/// # Errors
/// [`NoSteps`]
pub fn of_go(
    model: &Model,
    go: &GoOrder,
    control: &ControlSettings,
    last: Option<Hertz>,
    bases: &FrequencyBases,
) -> Result<Vec<CommandStep>, NoSteps> {
    let mut steps: Vec<CommandStep> = go
        .registers()
        .iter()
        .map(|write| CommandStep::Write(register(model, *write)))
        .collect();
    let Some(direction) = go.run() else {
        let sign = sign_of(model, go.toward())?;
        let alone = go
            .frequency()
            .map(|it| setpoint(model, it, sign, control, bases))
            .transpose()?;
        steps.extend(alone.map(CommandStep::Write));
        return Ok(steps);
    };
    let run = run(model, direction)?;
    if !control.bus.has_frequency() {
        if model.turns_by_sign() && direction == Direction::Reverse {
            return Err(NoSteps::NotCapable);
        }
        steps.push(CommandStep::Write(vec![run]));
        return before_run::before_run(model, direction, steps);
    }
    match setpoint_of_run(model, go, last)? {
        Some(frequency) => {
            let mut writes = setpoint(model, frequency, direction, control, bases)?;
            if model.turns_by_sign() {
                writes
                    .iter_mut()
                    .for_each(|write| write.part = StepPart::SignedSetpoint(frequency, direction));
            }
            steps.extend(setpoint_and_run(model, writes, run));
        }
        None => {
            steps.insert(0, check_setting(model, control, bases)?);
            steps.push(CommandStep::Write(vec![run]));
        }
    }
    before_run::before_run(model, direction, steps)
}

/// The direction that the sign of a setpoint alone orders: without a sign it orders none.
fn sign_of(model: &Model, toward: Option<Direction>) -> Result<Direction, NoSteps> {
    if model.turns_by_sign() {
        toward.ok_or(NoSteps::SetpointUnknown)
    } else {
        Ok(Direction::Forward)
    }
}

/// The register and the word that stop a drive which was last ordered to run in direction `after`, or cut its output off.
///
/// # Errors
/// [`NoSteps::NotCapable`]
pub fn of_stop(
    model: &Model,
    coast: bool,
    after: Option<Direction>,
) -> Result<(Address, u16), NoSteps> {
    if coast {
        return order(model, OrderKind::Coast);
    }
    let run = model.run.as_ref().ok_or(NoSteps::NotCapable)?;
    let address = model
        .order_address(OrderKind::Stop)
        .ok_or(NoSteps::NotCapable)?;
    Ok((address, run.stop_word(after)))
}

/// The steps that take back a start that the drive did not follow.
///
/// # Errors
/// [`NoSteps::NotCapable`] if the model starts by the run word alone.
pub fn of_start_taken_back(model: &Model) -> Result<Vec<CommandStep>, NoSteps> {
    let value = model.start_take_back().ok_or(NoSteps::NotCapable)?;
    let (address, _) = order(model, OrderKind::Forward)?;
    Ok(vec![CommandStep::Write(vec![WriteStep {
        address,
        value,
        part: StepPart::TakesStartBack,
        shown: Vec::new(),
    }])])
}

/// The functions by which a drive takes one word: some serve no function 06 or 05 and take it as a block of one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WriteFunctions {
    has_single_register: bool,
    has_single_coil: bool,
}

impl WriteFunctions {
    /// The write functions of `model`.
    #[must_use]
    pub fn of(model: &Model) -> Self {
        Self {
            has_single_register: model.serves(function::WRITE_SINGLE),
            has_single_coil: model.serves(function::WRITE_COIL),
        }
    }

    /// The request that writes `value` to `address`.
    #[must_use]
    pub fn request(self, address: Address, value: u16) -> Request {
        let is_single = if address.table().is_of_bits() {
            self.has_single_coil
        } else {
            self.has_single_register
        };
        if is_single {
            Request::WriteSingle { address, value }
        } else {
            Request::WriteMultiple {
                address,
                values: vec![value],
            }
        }
    }

    /// The requests that write `value` to `address`, the one to use first.
    #[must_use]
    pub fn forms(self, address: Address, value: u16, in_block: bool) -> Vec<Request> {
        let first = self.request(address, value);
        let block = Request::WriteMultiple {
            address,
            values: vec![value],
        };
        if in_block && first != block {
            vec![first, block]
        } else {
            vec![first]
        }
    }
}

/// Whether the model declares that the register at `address` is written by function 10 hex as well as by 06, or the coil
/// there by 0F hex as well as by 05.
#[must_use]
pub fn takes_in_a_block(model: &Model, address: Address) -> bool {
    let function = if address.table().is_of_bits() {
        function::WRITE_COILS
    } else {
        function::WRITE_MULTIPLE
    };
    model.serves(function)
        && model.write.block.as_ref().is_some_and(|block| {
            (block.address..block.address.saturating_add(block.count.value)).contains(&address)
        })
}

/// The step that releases control.
///
/// # Errors
/// [`NoSteps::NotCapable`]
pub fn of_release(model: &Model) -> Result<Vec<CommandStep>, NoSteps> {
    let (address, value) = order(model, OrderKind::Release)?;
    Ok(vec![CommandStep::Write(vec![WriteStep {
        address,
        value,
        part: StepPart::Release,
        shown: Vec::new(),
    }])])
}

/// The step that writes `word`, by which the drive takes over or stores what was written before. Its echo is all that the
/// drive shows of it.
#[must_use]
pub fn of_commit(word: &CommitWord) -> CommandStep {
    let CommitWord { address, value, .. } = *word;
    CommandStep::Write(vec![WriteStep {
        address,
        value,
        part: StepPart::Commit,
        shown: Vec::new(),
    }])
}

/// The steps that set the registers in `addresses` that the drive needs before it obeys the bus, in the model's order.
///
/// # Errors
/// [`NoSteps::NotCapable`] if one of them is nothing that the model asks to be set.
pub fn of_setup(model: &Model, addresses: &[Address]) -> Result<Vec<CommandStep>, NoSteps> {
    let item = |address: &Address| {
        model
            .setup
            .iter()
            .any(|item| item.address == Some(*address))
    };
    if !addresses.iter().all(item) {
        return Err(NoSteps::NotCapable);
    }
    let items = model
        .setup
        .iter()
        .filter_map(|item| Some((item.address?, item.written()?)));
    let wanted = items.filter(|(address, _)| addresses.contains(address));
    Ok(wanted
        .map(|(address, value)| {
            CommandStep::Write(register(model, RegisterWrite::new(address, value)))
        })
        .collect())
}

/// The register and the word of the order `kind`.
fn order(model: &Model, kind: OrderKind) -> Result<(Address, u16), NoSteps> {
    let (address, fact) = model.order(kind).ok_or(NoSteps::NotCapable)?;
    Ok((address, fact.value))
}

/// The writes of a register: both words of a value go out in one frame, and are read back in one.
fn register(model: &Model, write: RegisterWrite) -> Vec<WriteStep> {
    let RegisterWrite {
        address,
        value,
        second,
    } = write;
    let is_readable = model
        .writable_at(address)
        .is_some_and(|register| register.access.can_read());
    let read_at = match model.in_ram_at(address) {
        _ if is_readable => Some(address),
        Some(_) if model.reads_ram_forms() => Some(address),
        // A form in RAM that cannot be read shows in its register.
        Some(register) => Some(register.address),
        None => None,
    };
    let holds = |address| RegisterCondition {
        second,
        ..RegisterCondition::holds(address, vec![value], Duration::ZERO)
    };
    let part = StepPart::Register;
    let first = WriteStep {
        address,
        value,
        part,
        shown: read_at.map(holds).into_iter().collect(),
    };
    let second = second.and_then(|value| Some((address.checked_add(1)?, value)));
    let second = second.map(|(address, value)| WriteStep {
        address,
        value,
        part,
        shown: Vec::new(),
    });
    [first].into_iter().chain(second).collect()
}

fn run(model: &Model, direction: Direction) -> Result<WriteStep, NoSteps> {
    let kind = match direction {
        Direction::Forward => OrderKind::Forward,
        Direction::Reverse => OrderKind::Reverse,
    };
    let (address, value) = order(model, kind)?;
    let is_reverse = direction == Direction::Reverse;
    let running = RegisterCondition::flag(model, IndicatedState::Running, true);
    let turns = running
        .is_some()
        .then(|| RegisterCondition::flag(model, IndicatedState::Reverse, is_reverse))
        .flatten();
    let shown = running.into_iter().chain(turns).collect();
    Ok(WriteStep {
        address,
        value,
        part: StepPart::Run(direction),
        shown,
    })
}
