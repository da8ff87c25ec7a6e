//! Orders and owners as text, for people and for JSON.

use super::entry::TriedWrite;
use crate::domain::address::Address;
use crate::domain::command::{Direction, GoOrder, Order, Owner};
use crate::domain::frequency::Hertz;
use crate::domain::ids::CommanderName;

/// Maximum number of characters of unparsable input.
const TEXT_CHARS_MAX: usize = 200;

/// What a client tried to write, in words: `30.00 Hz, run forward`, `0x000C = 100`.
#[must_use]
pub fn tried(tried: &TriedWrite) -> String {
    match tried {
        TriedWrite::Order(order) => self::order(order),
        TriedWrite::Registers { address, values } => {
            let addresses = std::iter::successors(Some(*address), |address| {
                Some(address.at(address.number().wrapping_add(1)))
            });
            joined(
                addresses
                    .zip(values)
                    .map(|(address, value)| register(address, *value)),
            )
        }
        TriedWrite::Text(text) => text.chars().take(TEXT_CHARS_MAX).collect(),
    }
}

fn order(order: &Order) -> String {
    match order {
        Order::Stop { setpoint: None } => "stop".to_owned(),
        Order::Stop {
            setpoint: Some(setpoint),
        } => format!("stop, {}", hertz(*setpoint)),
        Order::Coast => "coast".to_owned(),
        Order::Reset => "reset".to_owned(),
        Order::Go(go) => self::go(go),
        Order::Release => "release".to_owned(),
        Order::Setup(addresses) => {
            format!(
                "setup {}",
                joined(addresses.iter().map(|address| address.to_string()))
            )
        }
        Order::Take => "take".to_owned(),
        Order::Renew => "renew".to_owned(),
        Order::EndReset => "end of reset".to_owned(),
    }
}

fn go(go: &GoOrder) -> String {
    let words = go.registers().iter().flat_map(|write| write.words());
    let registers = words.map(|(address, value)| register(address, value));
    let run = go.run().map(|direction| match direction {
        Direction::Forward => "run forward".to_owned(),
        Direction::Reverse => "run reverse".to_owned(),
    });
    joined(registers.chain(go.frequency().map(hertz)).chain(run))
}

fn hertz(frequency: Hertz) -> String {
    format!("{frequency} Hz")
}

fn register(address: Address, value: u16) -> String {
    format!("{address} = {value}")
}

fn joined(parts: impl Iterator<Item = String>) -> String {
    parts.collect::<Vec<_>>().join(", ")
}

/// Whether it removes energy from the motor: such attempts have reserved room.
#[must_use]
pub const fn is_stop(tried: &TriedWrite) -> bool {
    matches!(tried, TriedWrite::Order(order) if order.is_stop())
}

/// Whether it is only a setpoint: controllers send one after the other.
#[must_use]
pub fn is_setpoint(tried: &TriedWrite) -> bool {
    let TriedWrite::Order(Order::Go(go)) = tried else {
        return false;
    };
    go.registers().is_empty() && go.frequency().is_some() && go.run().is_none()
}

/// Parses an owner; `None` if `text` is not one.
#[must_use]
pub fn owner(text: &str) -> Option<Owner> {
    match text.split_once(' ') {
        None if text == "mqtt" => Some(Owner::Mqtt),
        None if text == "local" => Some(Owner::Local),
        None if text == "sparkplug" => Some(Owner::Sparkplug),
        Some(("modbus-tcp", address)) => address.parse().ok().map(Owner::ModbusTcp),
        Some(("modbus-security", name)) => CommanderName::new(name).map(Owner::ModbusSecurity),
        Some(("modbus-rtu", name)) => CommanderName::new(name).map(Owner::ModbusRtu),
        Some(("mqtt", name)) => CommanderName::new(name).map(Owner::MqttBy),
        Some(("page", name)) => CommanderName::new(name).map(Owner::Page),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::command::RegisterWrite;

    #[test]
    fn orders_have_words() {
        let go = |registers, frequency, run| {
            TriedWrite::Order(Order::Go(GoOrder::new(registers, frequency, run).unwrap()))
        };
        let thirty = Some(Hertz::from_millihertz(30_000));
        let table = [
            (TriedWrite::Order(Order::Stop { setpoint: None }), "stop"),
            (
                TriedWrite::Order(Order::Stop { setpoint: thirty }),
                "stop, 30.00 Hz",
            ),
            (
                go(Vec::new(), thirty, Some(Direction::Reverse)),
                "30.00 Hz, run reverse",
            ),
            (
                go(vec![RegisterWrite::new(12_u16, 100)], None, None),
                "0x000C = 100",
            ),
            (
                go(vec![RegisterWrite::pair(12_u16, [1, 100])], None, None),
                "0x000C = 1, 0x000D = 100",
            ),
            (
                TriedWrite::Registers {
                    address: 0xFFFF_u16.into(),
                    values: vec![1, 2],
                },
                "0xFFFF = 1, 0x0000 = 2",
            ),
            (
                TriedWrite::Order(Order::Setup(vec![1_u16.into(), 0x0211_u16.into()])),
                "setup 0x0001, 0x0211",
            ),
            (TriedWrite::Text("ü".repeat(300)), &"ü".repeat(200)),
        ];
        for (tried, text) in table {
            assert_eq!(super::tried(&tried), text);
        }
    }

    #[test]
    fn only_a_setpoint_alone_is_one() {
        let go = |run| {
            TriedWrite::Order(Order::Go(
                GoOrder::new(Vec::new(), Some(Hertz::ZERO), run).unwrap(),
            ))
        };
        assert!(is_setpoint(&go(None)) && !is_setpoint(&go(Some(Direction::Forward))));
        assert!(!is_setpoint(&TriedWrite::Order(Order::Stop {
            setpoint: Some(Hertz::ZERO)
        })));
    }

    #[test]
    fn owners_are_read_back() {
        let by = CommanderName::new("plc-2").unwrap();
        for owner in [
            Owner::Mqtt,
            Owner::Local,
            Owner::Sparkplug,
            Owner::MqttBy(by),
            Owner::ModbusTcp("10.0.0.7".parse().unwrap()),
            Owner::ModbusTcp("fd00::1".parse().unwrap()),
            Owner::ModbusSecurity(by),
            Owner::ModbusRtu(by),
            Owner::Page(by),
            // A name may look like an address; it is no owner's but that of the certificate.
            Owner::ModbusSecurity(CommanderName::new("10.0.0.7").unwrap()),
        ] {
            assert_eq!(super::owner(&owner.to_string()), Some(owner));
        }
        for text in [
            "",
            "mqtt ",
            "mqtt a/b",
            "modbus-tcp x",
            "modbus-security a b",
            "page",
            "page a b",
            "mqtt a b",
        ] {
            assert_eq!(super::owner(text), None, "{text}");
        }
    }
}
