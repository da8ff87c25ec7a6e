//! The sheets state what a client gets.

use super::super::ask::ModbusRequest;
use super::super::connection::ModbusConnection;
use super::super::limits::ConnectionLimits;
use super::super::own;
use super::super::taken::{RequestAction, RequestContext};
use super::super::testing::{self, NOW};
use super::super::uniform::UniformUnit;
use super::super::words::WordBuffer;
use super::*;
use crate::domain::command::{Owner, Rights};
use crate::drive::description::{DriveDescription, DriveRatings};
use crate::drive::snapshot::DrivePresence;
use crate::drive::view::DriveView;
use crate::vendors;
use crate::wire::mbap;
use std::sync::Arc;

const ALL: Rights = Rights {
    write: true,
    stop: true,
};
const STOP: Rights = Rights {
    write: false,
    stop: true,
};

/// A drive of every model that is built in, and the one with everything.
fn drives() -> Vec<DriveDescription> {
    let catalog = vendors::catalog();
    let models = catalog
        .ids()
        .map(|id| Arc::clone(catalog.find(id).unwrap()));
    let ratings = DriveRatings {
        current_ma: Some(11_000),
        voltage_mv: Some(400_000),
    };
    let built_in = models.map(|model| DriveDescription {
        model,
        ratings,
        ..testing::description()
    });
    built_in.chain([testing::description()]).collect()
}

/// A view of `drive` in which each register holds a distinct word, read just now.
fn picture(drive: &DriveDescription) -> DriveView {
    let mut view = testing::view();
    view.snapshot = Default::default();
    view.snapshot.presence = DrivePresence::Online;
    if drive.model.trip_register().is_none() {
        view.trip.active = None;
    }
    for (place, register) in (1..).zip(&drive.model.registers) {
        view.snapshot
            .take(register.address, &[1000 + 7 * place], NOW);
    }
    view
}

/// What a client gets that requests `count` words by `function`, through a connection; or the exception.
fn asked(
    unit: &UniformUnit,
    view: &DriveView,
    function: u8,
    address: u16,
    count: u16,
) -> Result<Vec<u16>, u8> {
    let mut connection = ModbusConnection::new(ConnectionLimits::default(), NOW);
    let mut request = Vec::new();
    mbap::encode(&mut request, 1, 101, |pdu| {
        pdu.push(function);
        pdu.extend(address.to_be_bytes());
        pdu.extend(count.to_be_bytes());
    });
    connection.receive(NOW, &request, &|_: u8, _: &ModbusRequest| false);
    let call = connection.next_call().unwrap();
    let mut words = WordBuffer::default();
    let present = RequestContext {
        now: NOW,
        uptime_s: 3,
        owner: Owner::Mqtt,
        standby: None,
    };
    let taken: RequestAction = unit.take(&call.ask, view, &present, &mut words);
    taken
        .at_once(&words, |answer| connection.answer(NOW, call.ticket, answer))
        .unwrap();
    let answer = mbap::decode(connection.output()).unwrap().unwrap();
    match answer.pdu {
        [code, exception] if code & 0x80 != 0 => Err(*exception),
        [_, _, bytes @ ..] => Ok(bytes
            .chunks(2)
            .map(|word| u16::from_be_bytes([word[0], word[1]]))
            .collect()),
        _ => panic!("{:?}", answer.pdu),
    }
}

/// The first number in `text` after `mark`.
fn number(text: &str, mark: &str) -> Option<f64> {
    let (_, rest) = text.split_once(mark)?;
    let digits = rest
        .split(|it: char| !it.is_ascii_alphanumeric() && it != '.')
        .next()?;
    match digits.strip_prefix("0x") {
        Some(hex) => Some(f64::from(u16::from_str_radix(hex, 16).ok()?)),
        None => digits.parse().ok(),
    }
}

/// The value that `row` promises of a drive with this `picture`: its native register in steps of the row.
fn promised(row: &SheetRow, drive: &DriveDescription, view: &DriveView) -> Option<f64> {
    let address = number(&row.special, "from ")? as u16;
    let native = native(drive, ALL)
        .into_iter()
        .find(|it| it.address == address)
        .unwrap();
    let raw = view.snapshot.reading(address).unwrap().raw;
    let value = f64::from(raw) * native.step.parse::<f64>().ok()?;
    let value = match (native.unit, row.unit) {
        ("%", "A") => value / 100.0 * 11.0,
        ("%", "V") => value / 100.0 * 400.0,
        (same, unit) => {
            assert_eq!(same, unit, "{row:?}");
            value
        }
    };
    Some(value)
}

#[test]
fn every_uniform_word_reads_as_the_sheet_says() {
    let mut measured = 0;
    let mut absent = 0;
    for drive in drives() {
        let unit = UniformUnit::new(&drive);
        let view = picture(&drive);
        for row in uniform(&drive, ALL) {
            let by_03 = asked(&unit, &view, 3, row.address, row.count);
            let by_04 = asked(&unit, &view, 4, row.address, row.count);
            let words = match row.table {
                SheetTable::Word => {
                    assert_eq!(by_03, by_04, "{row:?}");
                    by_03.unwrap()
                }
                SheetTable::Holding => {
                    assert_eq!(by_04, Err(2), "{row:?}");
                    by_03.unwrap()
                }
                SheetTable::Coil | SheetTable::Discrete | SheetTable::Input => continue,
            };
            let raw = match row.format {
                SheetFormat::Wide => f64::from(u32::from(words[0]) << 16 | u32::from(words[1])),
                SheetFormat::Signed => f64::from(words[0].cast_signed()),
                _ => f64::from(words[0]),
            };
            if let Some(value) = promised(&row, &drive, &view) {
                let step: f64 = row.step.parse().unwrap();
                assert!(
                    (raw * step - value).abs() <= step / 2.0 + 1e-9,
                    "{}: {row:?}: {raw} {value}",
                    drive.model.id
                );
                measured += 1;
            } else if row.special.contains("always") {
                let mark = number(&format!(" {}", row.special), " ").unwrap();
                assert!(
                    words.iter().all(|word| f64::from(*word) == mark),
                    "{}: {row:?} {words:?}",
                    drive.model.id
                );
                absent += 1;
            } else if row.meaning.starts_with(|it: char| it.is_ascii_digit()) && row.step.is_empty()
            {
                let mut codes = row
                    .meaning
                    .split(", ")
                    .filter_map(|code| code.split(' ').next());
                assert!(
                    codes.any(|code| code == words[0].to_string()),
                    "{row:?} {words:?}"
                );
            }
        }
    }
    assert!(
        measured >= 30 && absent >= 20,
        "{measured} measured, {absent} absent"
    );
}

#[test]
fn bits_read_as_the_sheet_says() {
    let unit = UniformUnit::new(&testing::description());
    let view = testing::view();
    let rows = uniform(&testing::description(), ALL);
    for (table, function) in [(SheetTable::Coil, 1), (SheetTable::Discrete, 2)] {
        let of_table: Vec<_> = rows.iter().filter(|row| row.table == table).collect();
        let last = of_table
            .iter()
            .map(|row| row.address + row.count)
            .max()
            .unwrap();
        assert_eq!(of_table.iter().map(|row| row.count).sum::<u16>(), last);
        let mut words = WordBuffer::default();
        let present = RequestContext {
            now: NOW,
            uptime_s: 3,
            owner: Owner::Mqtt,
            standby: None,
        };
        for (count, is_there) in [(last, true), (last + 1, false)] {
            let ask = super::super::request::parse(&[function, 0, 0, 0, count as u8]).unwrap();
            let taken = unit.take(&ask, &view, &present, &mut words);
            assert_eq!(
                matches!(taken, RequestAction::Bits { .. }),
                is_there,
                "{function} {count}"
            );
        }
    }
}

#[test]
fn numbers_are_those_of_data_sheets() {
    for (address, right) in [
        (0, "40001"),
        (256, "40257"),
        (9998, "49999"),
        (9999, "410000"),
        (0xFA00, "464001"),
    ] {
        assert_eq!(SheetTable::Word.number(address), right);
        assert_eq!(
            SheetTable::Word.input_number(address),
            Some(right.replacen('4', "3", 1))
        );
    }
    assert_eq!(SheetTable::Coil.number(3), "00004");
    assert_eq!(SheetTable::Discrete.number(9), "10010");
    assert_eq!(SheetTable::Holding.input_number(256), None);
}

#[test]
fn what_is_written_follows_from_rights_and_control() {
    let written = |rights, change: &dyn Fn(&mut crate::domain::control::ControlSettings)| {
        let mut drive = testing::description();
        let mut control = testing::settings();
        control.native_write = vec![0x010A];
        change(&mut control);
        drive.control = Some(Arc::new(control));
        let mut all = uniform(&drive, rights);
        all.extend(native(&drive, rights));
        let place = |row: &SheetRow| format!("{} {}", row.table.number(row.address), row.special);
        all.iter()
            .filter(|row| row.is_written)
            .map(place)
            .collect::<Vec<_>>()
    };
    let command = "a write is a command, with all its rules";
    assert_eq!(
        written(ALL, &|_| ()),
        [
            "00001 ",
            "00002 ",
            "00004 ",
            "40257 taken here: 0, 1, 2",
            "40258 65535: not known",
            "40259 ",
            &format!("40003 {command}"),
            &format!("40005 {command}"),
            "40267 never written by a client; stored, in a memory that wears out",
        ]
    );
    let only_stop = [
        "00001 only 0 is taken here".to_owned(),
        "00002 only 0 is taken here".to_owned(),
        "00004 ".to_owned(),
        "40257 taken here: 0".to_owned(),
        format!("40003 {command}"),
    ];
    assert_eq!(written(STOP, &|_| ()), only_stop);
    assert_eq!(
        written(ALL, &|control| control.from_modbus_tcp = false),
        only_stop
    );
    assert_eq!(written(Rights::NONE, &|_| ()), [""; 0]);
}

#[test]
fn lines_and_drives_of_the_gateway_stand_where_they_are_read() {
    let rows = gateway(&["hall-1", "hall-2"], &["pump-1", "pump-2", "pump-3"], ALL);
    let at = |address| {
        rows.iter()
            .find(|row| row.table == SheetTable::Word && row.address == address)
            .unwrap()
    };
    assert_eq!(
        (at(116).of.as_str(), at(116).title.as_str()),
        ("hall-2", "line state")
    );
    assert_eq!((at(1018).of.as_str(), at(1018).unit), ("pump-3", "Hz"));
    let many: Vec<_> = (0..60).map(|number| format!("line-{number}")).collect();
    let many: Vec<_> = many.iter().map(String::as_str).collect();
    let last = gateway(&many, &[], ALL)
        .into_iter()
        .map(|row| row.address)
        .max()
        .unwrap();
    assert!(last < own::DRIVES, "{last}");
}

#[test]
fn a_sheet_says_what_a_zero_orders() {
    use crate::profile::check;
    for (text, expected) in [
        (
            include_str!("../../../../../../tests/golden/models/zero-ignored.toml"),
            "0x04BC reset, 0 stop",
        ),
        (
            include_str!("../../../../../../tests/golden/models/zero-nothing.toml"),
            "9 reset, 0 stop",
        ),
        (
            include_str!("../../../../../../tests/golden/models/zero-coast.toml"),
            "0x0086 reset, 0 coast",
        ),
    ] {
        let model = Arc::new(check::model(text).unwrap());
        let rows = native(
            &DriveDescription {
                model,
                ..testing::description()
            },
            ALL,
        );
        let run = rows.iter().find(|row| row.address == 0x2000).unwrap();
        assert!(run.meaning.ends_with(expected), "{}", run.meaning);
    }
}
