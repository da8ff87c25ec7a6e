//! Modbus TCP clients: their requests, byte by byte, and the gateway's real connections.

use super::checker::tables::{Drive, Run};
use super::plan::PROOF;
use super::world::World;
use fastrand::Rng;
use std::net::{IpAddr, Ipv4Addr};
use vfd_gateway::domain::command::{OrderManner, Origin, Owner, Rights};
use vfd_gateway::domain::ids::AskerId;
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::north::modbus::{CallCommands, ConnectionLimits, ModbusConnection};

/// One client with its connection.
#[derive(Debug)]
pub struct Client {
    pub machine: ModbusConnection,
    pub commands: CallCommands,
    pub asker: AskerId,
    pub origin: Origin,
    transaction: u16,
    /// The connection stalls until then, and sent bytes wait.
    pub stalled_until: Option<MonoTime>,
    pub waiting: Vec<u8>,
    /// The rest of an incomplete message.
    rest: Vec<u8>,
    /// The setpoint and the direction that it writes repeatedly.
    habit: (u16, u16),
}

impl Client {
    /// Client `who`, connected at `now` as `asker`.
    pub fn new(who: usize, asker: u64, now: MonoTime) -> Self {
        // Two of them share one address: they are one owner.
        let address = IpAddr::V4(Ipv4Addr::new(10, 0, 0, 1 + who as u8 / 2));
        let rights = Rights {
            write: true,
            stop: true,
        };
        Self {
            machine: ModbusConnection::new(ConnectionLimits::default(), now),
            commands: CallCommands::default(),
            asker: AskerId(asker),
            origin: Origin {
                owner: Owner::ModbusTcp(address),
                rights,
                manner: OrderManner::Cyclic,
            },
            transaction: 0,
            stalled_until: None,
            waiting: Vec::new(),
            rest: Vec::new(),
            habit: (3_000, 1),
        }
    }

    fn message(&mut self, out: &mut Vec<u8>, unit: u8, pdu: &[u8]) {
        self.transaction = self.transaction.wrapping_add(1);
        out.extend(self.transaction.to_be_bytes());
        out.extend([0, 0, 0, pdu.len() as u8 + 1, unit]);
        out.extend_from_slice(pdu);
    }

    /// Appends the client's next request.
    fn ask(&mut self, rng: &mut Rng, drives: &[Drive], may_write: bool, out: &mut Vec<u8>) {
        let drive = &drives[rng.usize(0..drives.len())];
        let facts = drive.kind.facts();
        let dice = rng.u8(0..100);
        let (unit, pdu): (u8, Vec<u8>) = match dice {
            0..45 => (
                drive.unit,
                words(
                    3 + dice % 2,
                    &[
                        PROOF + rng.u16(0..16),
                        rng.u16(1..=if dice < 2 { 40 } else { 8 }),
                    ],
                ),
            ),
            45..52 => (
                drive.unit,
                words(3, &[facts.readable.0, rng.u16(1..=facts.readable.1)]),
            ),
            52..66 => (
                drive.uniform,
                words(3 + dice % 2, &[rng.u16(0..6), rng.u16(1..16)]),
            ),
            66..68 => (255, words(3, &[rng.u16(0..8), 4])),
            68..70 => (drive.uniform, words(1, &[0, 4])),
            70..71 => (rng.u8(200..250), words(3, &[0, 1])),
            71..73 => (drive.unit, words(3, &[rng.u16(..), rng.u16(0..200)])),
            73..74 => (
                drive.unit,
                (0..rng.usize(1..12)).map(|_| rng.u8(64..)).collect(),
            ),
            _ if !may_write => (drive.uniform, words(3, &[256, 6])),
            _ => self.command(rng, drive),
        };
        self.message(out, unit, &pdu);
    }

    fn command(&mut self, rng: &mut Rng, drive: &Drive) -> (u8, Vec<u8>) {
        let facts = drive.kind.facts();
        if rng.u8(0..4) == 0 {
            self.habit = (rng.u16(300..6_000) / 100 * 100, rng.u16(1..=2));
        }
        let (setpoint, direction) = self.habit;
        let run = [
            Run::Stop,
            Run::Forward,
            Run::Reverse,
            Run::Coast,
            Run::Reset,
        ][rng.usize(0..5)];
        match rng.u8(0..24) {
            0..6 => (drive.uniform, block(256, &[direction, setpoint])),
            6..8 => (drive.uniform, words(6, &[257, setpoint])),
            8..12 => (drive.uniform, words(6, &[256, 0])),
            12 => (drive.uniform, words(6, &[256, rng.u16(0..8)])),
            13 => (drive.uniform, words(6, &[258, 0])),
            14 | 15 => (
                drive.uniform,
                words(5, &[rng.u16(0..5), if rng.bool() { 0xFF00 } else { 0 }]),
            ),
            16 => (
                drive.unit,
                words(6, &[facts.run, facts.word_of(run).unwrap_or(0x55)]),
            ),
            17 => (
                drive.unit,
                words(6, &[facts.run, facts.word_of(Run::Stop).unwrap_or(0)]),
            ),
            18 | 19 => (drive.unit, words(6, &[facts.setpoint, setpoint])),
            20 => (drive.unit, words(6, &[facts.listed, rng.u16(10..80)])),
            21 => (drive.unit, words(6, &[rng.u16(..), rng.u16(..)])),
            22 => (
                drive.unit,
                block(facts.run, &[facts.word_of(run).unwrap_or(0), setpoint]),
            ),
            _ if rng.u8(0..4) == 0 => (255, words(5, &[0, 0xFF00])),
            _ => (drive.uniform, words(6, &[256, 4])),
        }
    }
}

/// A PDU of `function` and words.
fn words(function: u8, words: &[u16]) -> Vec<u8> {
    std::iter::once(function)
        .chain(words.iter().flat_map(|word| word.to_be_bytes()))
        .collect()
}

/// A PDU that writes `values` from `address` on by function 10 hex.
fn block(address: u16, values: &[u16]) -> Vec<u8> {
    let mut pdu = words(16, &[address, values.len() as u16]);
    pdu.push(2 * values.len() as u8);
    pdu.extend(values.iter().flat_map(|word| word.to_be_bytes()));
    pdu
}

impl World {
    /// A client acts: it continues a message, sends one or several requests, or leaves and reconnects.
    pub fn client_acts(&mut self) {
        let who = self.rng.usize(0..self.clients.len());
        let dice = self.rng.u16(0..400);
        if dice == 0 || self.clients[who].machine.close_reason().is_some() {
            self.tally.clients_gone += 1;
            return self.reconnect(who, false);
        }
        let client = &mut self.clients[who];
        let mut bytes = std::mem::take(&mut client.rest);
        if bytes.is_empty() {
            let how_many = if dice < 8 { self.rng.usize(2..20) } else { 1 };
            for _ in 0..how_many {
                client.ask(
                    &mut self.rng,
                    &self.plan.line.drives,
                    self.may_write,
                    &mut bytes,
                );
            }
            match dice {
                8..20 => client.rest = bytes.split_off(self.rng.usize(1..bytes.len())),
                20 => bytes.extend([0, 1, 0, 7, 0, 2, 9]),
                _ => {}
            }
        }
        self.client_sends(who, &bytes);
    }

    /// A client reads proof words, which identify their exchange.
    pub fn client_reads(&mut self, who: usize) {
        let client = &mut self.clients[who];
        let drives = &self.plan.line.drives;
        let drive = &drives[self.rng.usize(0..drives.len())];
        let pdu = words(3, &[PROOF, self.rng.u16(1..=8)]);
        let mut bytes = Vec::with_capacity(12);
        client.message(&mut bytes, drive.unit, &pdu);
        self.client_sends(who, &bytes);
    }
}
