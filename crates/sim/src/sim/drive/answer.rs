//! Requests and replies of a simulated drive.

use super::SimDrive;
use super::back_door::BackDoor;
use super::commit::{self, is_committed};
use super::denied::{DeniedRequest, RequestObjection};
use super::memory::{AddressForm, MemoryAddress, following, index_in_ram, index_of, place_of};
use super::shown::is_measured;
use super::untrue::ShownWord;
use crate::domain::address::Address;
use crate::domain::time::MonoTime;
use crate::profile::model::{
    BlockWrite, CommitEffect, ReadHoles, RefusedWrite, Register, RegisterRole,
};
use crate::sim::options::BadRequest;
use crate::wire::pdu::{self, Request, function};

impl SimDrive {
    /// Executes `pdu` and appends the reply's PDU to `out`; false if the drive stays silent.
    /// `exchange` is the number that proof words show.
    pub fn answer(&mut self, at: MonoTime, pdu: &[u8], exchange: u64, out: &mut Vec<u8>) -> bool {
        self.advance(at);
        if !self.hears(at) {
            return false;
        }
        if let Some(code) = self.objects_with() {
            out.extend([
                pdu.first().copied().unwrap_or_default() | function::EXCEPTION_BIT,
                code,
            ]);
            return true;
        }
        let done = self.serve(at, pdu, exchange, out);
        let objection = match done {
            Ok(()) => None,
            Err(DeniedRequest::Request(_)) if self.is_silent() => return false,
            Err(DeniedRequest::Request(objection) | DeniedRequest::Refused(objection)) => {
                Some(objection)
            }
        };
        if !matches!(done, Err(DeniedRequest::Request(_))) {
            self.watchdog.heard(at);
        }
        if done.is_ok() && self.takes_in_silence(pdu) {
            return false;
        }
        if let Some(objection) = objection {
            let code = objection.code(&self.model);
            out.extend([
                pdu.first().copied().unwrap_or_default() | function::EXCEPTION_BIT,
                code,
            ]);
        }
        true
    }

    fn takes_in_silence(&self, pdu: &[u8]) -> bool {
        let mut written = Request::decode(pdu)
            .into_iter()
            .flat_map(|request| request.written().collect::<Vec<_>>());
        written.any(|address| self.model.silent_writes().any(|silent| silent == address))
    }

    /// Executes a broadcast `pdu` without a reply, if the model supports broadcasts of this function.
    pub fn obey(&mut self, at: MonoTime, pdu: &[u8]) {
        self.advance(at);
        let known = self.model.link.broadcast.as_ref().is_some_and(|broadcast| {
            pdu.first()
                .is_some_and(|function| broadcast.functions.contains(function))
        });
        if !self.hears(at) || !known {
            return;
        }
        // A broadcast is not answered.
        if self.serve(at, pdu, 0, &mut Vec::new()).is_ok() {
            self.watchdog.heard(at);
        }
    }

    /// The code of the exception with which it answers the present request whatever that is.
    fn objects_with(&mut self) -> Option<u8> {
        let (kind, times) = self.objects.take()?;
        self.objects = Some((kind, times.checked_sub(1)?)).filter(|(_, left)| *left > 0);
        self.model
            .exception_kinds
            .iter()
            .find(|(_, of)| *of == kind)
            .map(|(code, _)| *code)
    }

    fn hears(&self, at: MonoTime) -> bool {
        self.powered && at >= self.deaf_until
    }

    /// Whether the drive stays silent on a request that it cannot serve.
    fn is_silent(&self) -> bool {
        match self.options.bad_request {
            BadRequest::AsDocumented => self.model.exceptions.is_empty(),
            BadRequest::Silence => true,
            BadRequest::Exception => false,
        }
    }

    fn serve(
        &mut self,
        at: MonoTime,
        pdu: &[u8],
        exchange: u64,
        out: &mut Vec<u8>,
    ) -> Result<(), DeniedRequest> {
        let function = pdu.first().copied().unwrap_or_default();
        if !self.model.serves(function) {
            return Err(DeniedRequest::Request(RequestObjection::Function));
        }
        match Request::decode(pdu) {
            Some(Request::Read { address, count }) => self.read(at, address, count, exchange, out),
            Some(Request::WriteSingle { address, value }) => {
                let holds = self.write(at, address, value)?;
                Request::write(address, holds).encode(out);
                Ok(())
            }
            Some(Request::Loopback { .. }) => {
                out.extend_from_slice(pdu);
                Ok(())
            }
            Some(Request::WriteMultiple { address, values }) => {
                self.write_block(at, address, &values)?;
                out.extend(pdu.get(..5).unwrap_or_default());
                Ok(())
            }
            // Other functions of a model, and other loop tests, are not simulated.
            Some(Request::Unserved { .. }) | None => Err(DeniedRequest::Request(match function {
                function::READ_HOLDING | function::WRITE_SINGLE | function::WRITE_MULTIPLE => {
                    RequestObjection::Quantity
                }
                _ => RequestObjection::Function,
            })),
        }
    }

    fn read(
        &self,
        at: MonoTime,
        first: Address,
        count: u16,
        exchange: u64,
        out: &mut Vec<u8>,
    ) -> Result<(), DeniedRequest> {
        if count == 0 || count > self.model.words_in_one_read(first) || count > pdu::MAX_READ_WORDS
        {
            return Err(DeniedRequest::Request(RequestObjection::Quantity));
        }
        let is_decimal = self.model.quirks.decimal_numbers.is_some();
        let mut words = [0; pdu::MAX_READ_WORDS as usize];
        let words = &mut words[..usize::from(count)];
        let mut next = Some(first);
        for word in words.iter_mut() {
            let readable = next.and_then(|address| match self.untrue.at(address) {
                ShownWord::Truth => self
                    .readable(at, address, exchange)
                    .or_else(|| self.hole(address)),
                ShownWord::Word(word) => Some(word),
                ShownWord::Nothing => None,
            });
            *word = readable.ok_or(DeniedRequest::Request(RequestObjection::Address))?;
            next = next.and_then(|address| following(address, is_decimal));
        }
        if self.untrue.is_too_long(first) {
            pdu::encode_read_reply(out, first.table(), &[&*words, &[0]].concat());
        } else {
            pdu::encode_read_reply(out, first.table(), words);
        }
        Ok(())
    }

    /// What a read shows of an address without a register; nothing if it is refused.
    fn hole(&self, address: Address) -> Option<u16> {
        match self.model.read.holes.as_ref()?.value {
            ReadHoles::Refused => None,
            ReadHoles::Zero => Some(0),
            ReadHoles::Read => Some(address.number()),
        }
    }

    /// The word at `address` as a read shows it; nothing if reading is not documented there.
    fn readable(&self, at: MonoTime, address: Address, exchange: u64) -> Option<u16> {
        if self
            .options
            .proof_words
            .as_ref()
            .is_some_and(|range| range.contains(&address.number()))
        {
            return Some((exchange & 0xFFFF) as u16);
        }
        if let Some(word) = self.shared_word(at, address) {
            return Some(word);
        }
        match index_of(&self.model, address) {
            Some(index) if !self.model.registers[index].access.can_read() => None,
            Some(index) => Some(self.held(at, index)),
            None => self
                .in_ram(at, address)
                .or_else(|| self.block_word(address)),
        }
    }

    /// The word of the stored register whose form in RAM is at `address`, if that can be read.
    fn in_ram(&self, at: MonoTime, address: Address) -> Option<u16> {
        let is_readable = self
            .model
            .quirks
            .ram_alias
            .as_ref()
            .is_some_and(|rule| rule.value.is_readable);
        if !is_readable {
            return None;
        }
        index_in_ram(&self.model, address).map(|index| self.held(at, index))
    }

    /// Takes `value` or keeps the old one; returns what the register at `address` then holds.
    fn write(&mut self, at: MonoTime, address: Address, value: u16) -> Result<u16, DeniedRequest> {
        let place = place_of(&self.model, address)
            .ok_or(DeniedRequest::Request(RequestObjection::Address))?;
        if self.model.registers[place.index].form.pair.is_some() {
            return Err(DeniedRequest::Refused(RequestObjection::Value));
        }
        // A drive that answers with the kept word refuses nothing if both are equal.
        let refused = self.model.write.refused.value;
        let before = self.held(at, place.index);
        let is_new = refused != RefusedWrite::KeepsOldValue || before != value;
        let is_refused = is_new && self.refuses_stop(function::WRITE_SINGLE, address, value);
        let done = if is_refused {
            Err(RequestObjection::Address)
        } else {
            self.store(at, place, value)
        };
        match done {
            Ok(()) if refused == RefusedWrite::EchoMayBeOld => Ok(before),
            Ok(()) => Ok(value),
            Err(_) if refused == RefusedWrite::KeepsOldValue => Ok(self.held(at, place.index)),
            Err(objection) => Err(DeniedRequest::Refused(objection)),
        }
    }

    /// Takes all `values` or none.
    fn write_block(
        &mut self,
        at: MonoTime,
        first: Address,
        values: &[u16],
    ) -> Result<(), DeniedRequest> {
        if let Some(index) = self.pair_at(first) {
            return self.write_pair(at, index, values);
        }
        // Without a block, function 10 hex writes one register as 06 does it.
        let block = self.model.write.block.as_ref();
        let most = block.map_or(1, |block| block.count.value);
        if values.is_empty() || values.len() > usize::from(most) {
            return Err(DeniedRequest::Request(RequestObjection::Quantity));
        }
        if self.refuses_stop(function::WRITE_MULTIPLE, first, values[0]) {
            return Err(DeniedRequest::Request(RequestObjection::Address));
        }
        let is_inside = |block: &BlockWrite| {
            let offset = first.offset_from(block.address).map(usize::from);
            offset.is_some_and(|offset| offset + values.len() <= usize::from(block.count.value))
        };
        // A drive without function 06 takes one register at a time wherever it lies.
        let single = if first.table().is_of_bits() {
            function::WRITE_COIL
        } else {
            function::WRITE_SINGLE
        };
        let stands_for_06 = values.len() == 1 && !self.model.serves(single);
        if !stands_for_06 && !block.is_none_or(is_inside) {
            return Err(DeniedRequest::Request(RequestObjection::Address));
        }
        let mut trial = self.clone();
        let done = first
            .onwards()
            .zip(values)
            .try_for_each(|(address, value)| {
                let place = place_of(&trial.model, address);
                trial.store(at, place.ok_or(RequestObjection::Address)?, *value)
            });
        match done {
            Ok(()) => *self = trial,
            // A forbidden word was written.
            Err(_) => self.report.forbidden_words = trial.report.forbidden_words,
        }
        done.map_err(DeniedRequest::Refused)
    }

    /// The register of two words that is written at `address`.
    fn pair_at(&self, address: Address) -> Option<usize> {
        let is_it = |it: &Register| {
            it.address == address && it.access.can_write() && it.form.pair.is_some()
        };
        self.model.registers.iter().position(is_it)
    }

    /// Takes a value of two words, never half of it.
    fn write_pair(
        &mut self,
        at: MonoTime,
        index: usize,
        values: &[u16],
    ) -> Result<(), DeniedRequest> {
        let words = <[u16; 2]>::try_from(values)
            .map_err(|_| DeniedRequest::Request(RequestObjection::Quantity))?;
        let register = &self.model.registers[index];
        let number = register.form.pair.map_or(0, |order| order.number(words));
        if register.role != Some(RegisterRole::FrequencyCommand) {
            if !register.takes_both(words) {
                return Err(DeniedRequest::Refused(RequestObjection::Value));
            }
            if commit::is_waited_for(&self.model, register) {
                self.memory.hold_back(index, number);
            } else {
                self.take_number(
                    MemoryAddress {
                        index,
                        form: AddressForm::Own,
                    },
                    number,
                );
            }
            return Ok(());
        }
        let micro = self.scale().micro_of_number(register, number.into());
        self.take_setpoint(at, micro)
            .map_err(DeniedRequest::Refused)
    }

    fn is_deaf_after(&mut self, at: MonoTime, place: MemoryAddress) {
        if let Some(deaf) = self.model.registers[place.index].deaf_after {
            self.deaf_until = self.deaf_until.max(at + deaf);
        }
    }

    /// Executes `value` in the register at `place` if it is there to take over or store parameters, and tells whether it is.
    fn take_commit(
        &mut self,
        at: MonoTime,
        place: MemoryAddress,
        value: u16,
    ) -> Result<bool, RequestObjection> {
        let address = self.model.registers[place.index].address;
        let runs = self.control.is_ordered_to_run();
        let Some(effect) = commit::effect_of(&self.model, address, value, runs)? else {
            return Ok(false);
        };
        for index in 0..self.model.registers.len() {
            if self.memory.apply(index) {
                self.follow_register(at, index);
            }
            if effect == CommitEffect::Store && is_committed(&self.model.registers[index]) {
                self.memory.store(index);
            }
        }
        Ok(true)
    }

    /// Accepts `value` at `place`, or returns why not.
    fn store(
        &mut self,
        at: MonoTime,
        place: MemoryAddress,
        value: u16,
    ) -> Result<(), RequestObjection> {
        let register = &self.model.registers[place.index];
        let role = register.role;
        if !register.access.can_write() || role.is_some_and(is_measured) {
            return Err(RequestObjection::Address);
        }
        if matches!(role, Some(RegisterRole::RunCommand | RegisterRole::Order)) {
            self.take_order(at, place, value)?;
            self.is_deaf_after(at, place);
            return Ok(());
        }
        if !register.takes(value) {
            return Err(RequestObjection::Value);
        }
        match (role, BackDoor::of(register)) {
            (Some(RegisterRole::FrequencyCommand | RegisterRole::FrequencySetting), _)
            | (_, Some(BackDoor::Frequency)) => {
                let micro = self.scale().micro_of(register, value);
                self.take_setpoint(at, micro)?;
            }
            (_, Some(BackDoor::Limit)) if self.control.is_ordered_to_run() => {
                return Err(RequestObjection::NotNow);
            }
            _ => {}
        }
        self.is_deaf_after(at, place);
        if self.take_commit(at, place, value)? {
            self.take(place, value);
        } else if commit::is_waited_for(&self.model, &self.model.registers[place.index]) {
            self.memory.hold_back(place.index, value.into());
        } else {
            self.take(place, value);
            self.follow_register(at, place.index);
        }
        Ok(())
    }
}
