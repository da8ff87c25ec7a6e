//! No register of a drive is a way around control: what moves a motor, widens its limits or decides whom it obeys is
//! refused even if it is listed, and nothing of it reaches the line.

use crate::support::families::{accepting, listing, quiet, refused, register, single, write};
use crate::support::{MQTT, ORIGIN, STOP, model, setpoint};
use std::time::Duration;
use vfd_gateway::domain::command::{Outcome, Reason};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::native::NativeOutcome;

use Reason::{NotAllowed, NotListed, NotUnderstood};

type Door = (&'static str, u16, u16, Reason);

const N700: &str = "hyundai-n700";
const N100: &str = "hyundai-n100plus";
const AS1: &str = "toshiba-vf-as1";
const S15: &str = "toshiba-vf-s15";
const E510: &str = "teco-e510";
const E510S: &str = "teco-e510s";
const FR500: &str = "frecon-fr500a";

/// Typed from the vendors' tables: registers that no client may write, listed or not.
const DOORS: &[Door] = &[
    // F001 is set by the frequency command alone; F201; F010, F011; A04 and what the sibling has there.
    (N700, 0x0201, 3000, NotListed),
    (N700, 0x0202, 6000, NotAllowed),
    (N700, 0x0211, 2, NotAllowed),
    (N700, 0x0212, 2, NotAllowed),
    (N700, 0x0404, 12_000, NotListed),
    (N700, 0x0304, 12_000, NotListed),
    (N700, 0x0002, 5, NotUnderstood),
    (N700, 0x0002, 0x0101, NotUnderstood),
    (N100, 0x0201, 3000, NotListed),
    (N100, 0x0301, 0, NotAllowed),
    (N100, 0x0302, 0, NotAllowed),
    (N100, 0x0304, 12_000, NotAllowed),
    (N100, 0x0211, 3, NotListed),
    (N100, 0x0002, 3, NotUnderstood),
    (N100, 0x0002, 5, NotUnderstood),
    (N100, 0x0002, 6, NotUnderstood),
    (N100, 0x0002, 8, NotUnderstood),
    // Bits 11, 12, 8 and 3 to 0 in words that are not a command; orders to run without the priority bits.
    (AS1, 0xFA00, 0xCC00, NotUnderstood),
    (AS1, 0xFA00, 0x0800, NotUnderstood),
    (AS1, 0xFA00, 0xD000, NotUnderstood),
    (AS1, 0xFA00, 0x9000, NotUnderstood),
    (AS1, 0xFA00, 0xD400, NotUnderstood),
    (AS1, 0xFA00, 0xC100, NotUnderstood),
    (AS1, 0xFA00, 0xC500, NotUnderstood),
    (AS1, 0xFA00, 0xC401, NotUnderstood),
    (AS1, 0xFA00, 0xC402, NotUnderstood),
    (AS1, 0xFA00, 0xC404, NotUnderstood),
    (AS1, 0xFA00, 0xC408, NotUnderstood),
    (AS1, 0xFA00, 0xC00F, NotUnderstood),
    (AS1, 0xFA00, 0x0400, NotUnderstood),
    (AS1, 0xFA00, 0x8400, NotUnderstood),
    (AS1, 0xFA00, 0x4400, NotUnderstood),
    (AS1, 0xFA00, 0xA000, NotUnderstood),
    (AS1, 0xFA00, 0xE400, NotUnderstood),
    (AS1, 0xFA13, 1500, NotAllowed),
    (AS1, 0xFA20, 1, NotAllowed),
    (AS1, 0xFA26, 1, NotAllowed),
    (AS1, 0xFA50, 1, NotAllowed),
    (AS1, 0xFA51, 1, NotAllowed),
    (AS1, 0x0003, 0, NotAllowed),
    (AS1, 0x0004, 0, NotAllowed),
    (AS1, 0x0011, 12_000, NotAllowed),
    (AS1, 0x0012, 12_000, NotAllowed),
    (AS1, 0x0013, 5000, NotAllowed),
    (AS1, 0x1870, 0xC400, NotListed),
    (AS1, 0xF870, 1, NotListed),
    (S15, 0xFA00, 0xCC00, NotUnderstood),
    (S15, 0xFA00, 0xD400, NotUnderstood),
    (S15, 0xFA00, 0x9000, NotUnderstood),
    (S15, 0xFA00, 0xC500, NotUnderstood),
    (S15, 0xFA00, 0xC401, NotUnderstood),
    (S15, 0xFA00, 0xC408, NotUnderstood),
    (S15, 0xFA13, 1500, NotAllowed),
    (S15, 0xFA20, 1, NotAllowed),
    (S15, 0xFA26, 1, NotAllowed),
    (S15, 0xFA50, 1, NotAllowed),
    (S15, 0x0003, 0, NotAllowed),
    (S15, 0x0004, 0, NotAllowed),
    (S15, 0x0011, 12_000, NotAllowed),
    (S15, 0x0012, 12_000, NotAllowed),
    (S15, 0x1870, 0xC400, NotAllowed),
    (S15, 0x1871, 6000, NotAllowed),
    (S15, 0xF870, 1, NotAllowed),
    (S15, 0xF871, 3, NotAllowed),
    // Bit 2 and bits 6 to 15, alone and beside run; 4 and 5 are reserved; reverse and reset beside each other.
    (E510, 0x2501, 0x0002, NotUnderstood),
    (E510, 0x2501, 0x0004, NotUnderstood),
    (E510, 0x2501, 0x0005, NotUnderstood),
    (E510, 0x2501, 0x0009, NotUnderstood),
    (E510, 0x2501, 0x0010, NotUnderstood),
    (E510, 0x2501, 0x0020, NotUnderstood),
    (E510, 0x2501, 0x0040, NotUnderstood),
    (E510, 0x2501, 0x0080, NotUnderstood),
    (E510, 0x2501, 0x0100, NotUnderstood),
    (E510, 0x2501, 0x0200, NotUnderstood),
    (E510, 0x2501, 0x0400, NotUnderstood),
    (E510, 0x2501, 0x0800, NotUnderstood),
    (E510, 0x2501, 0x1001, NotUnderstood),
    (E510, 0x2501, 0x2001, NotUnderstood),
    (E510, 0x2501, 0x4001, NotUnderstood),
    (E510, 0x2501, 0x8001, NotUnderstood),
    (E510, 0xA002, 3000, NotAllowed),
    (E510, 0x0008, 3000, NotAllowed),
    (E510, 0x000C, 1200, NotAllowed),
    (E510, 0x000D, 500, NotAllowed),
    (E510, 0x0002, 0, NotAllowed),
    (E510, 0x0005, 0, NotAllowed),
    (E510S, 0x2501, 0x0005, NotUnderstood),
    (E510S, 0x2501, 0x0041, NotUnderstood),
    (E510S, 0xA002, 3000, NotAllowed),
    (E510S, 0x0008, 3000, NotAllowed),
    (E510S, 0x000C, 1200, NotAllowed),
    (E510S, 0x0002, 0, NotAllowed),
    (E510S, 0x0005, 0, NotAllowed),
    // 3 and 4 jog; PID, torque, limits, sources; their stored twins, and those of command registers.
    (FR500, 0x2000, 3, NotUnderstood),
    (FR500, 0x2000, 4, NotUnderstood),
    (FR500, 0x2000, 0, NotUnderstood),
    (FR500, 0x2000, 8, NotUnderstood),
    (FR500, 0x2002, 500, NotAllowed),
    (FR500, 0x2003, 500, NotAllowed),
    (FR500, 0x2004, 500, NotAllowed),
    (FR500, 0x2007, 1, NotListed),
    (FR500, 0x0101, 1, NotAllowed),
    (FR500, 0x0200, 0, NotAllowed),
    (FR500, 0x0108, 6000, NotAllowed),
    (FR500, 0x0109, 6000, NotAllowed),
    (FR500, 0x010A, 5000, NotAllowed),
    (FR500, 0x8101, 1, NotAllowed),
    (FR500, 0x8200, 0, NotAllowed),
    (FR500, 0x8108, 6000, NotAllowed),
    (FR500, 0x8109, 6000, NotAllowed),
    (FR500, 0x810A, 5000, NotAllowed),
    (FR500, 0xA000, 1, NotAllowed),
    (FR500, 0xA001, 3000, NotAllowed),
    (FR500, 0xA002, 500, NotAllowed),
    (FR500, 0xA004, 500, NotAllowed),
    (FR500, 0x8014, 75, NotListed),
    (FR500, 0xB001, 3000, NotListed),
    (FR500, 0x840A, 1, NotListed),
];

/// Registers that are refused until they are listed; their twins need a listing of their own.
const UNLISTED: &[(&str, u16, u16)] = &[
    (N700, 0x020C, 100),
    (N100, 0x0202, 100),
    (AS1, 0x0010, 100),
    (S15, 0x0010, 100),
    (E510, 0x000E, 100),
    (E510S, 0x0909, 50),
    (FR500, 0x0300, 100),
    (FR500, 0x8300, 100),
    (FR500, 0x8F02, 2),
];

#[test]
fn a_back_door_is_refused_and_nothing_goes_to_the_line() {
    for (id, address, word, reason) in DOORS {
        let mut rig = quiet(id, accepting());
        assert_eq!(
            write(&mut rig, *address, &[*word]),
            refused(*reason),
            "{id}: {address} = {word:04X}"
        );
        rig.pass(Duration::from_secs(2));
        assert!(
            rig.sent.is_empty(),
            "{id}: {address} = {word:04X}: {:02X?}",
            rig.frames()
        );
    }
}

#[test]
fn a_list_of_writable_registers_opens_no_back_door() {
    let everything: Vec<u16> = (0..=u16::MAX).collect();
    for (id, address, word, reason) in DOORS {
        let mut rig = quiet(id, listing(everything.clone()));
        assert_eq!(
            write(&mut rig, *address, &[*word]),
            refused(*reason),
            "{id}: {address} = {word:04X}"
        );
        let told = rig.commanded(MQTT, register(*address, *word));
        assert_eq!(
            told.0,
            Outcome::Refused,
            "{id}: {address} as a parameter: {told:?}"
        );
        rig.pass(Duration::from_secs(2));
        assert!(
            rig.writes().is_empty(),
            "{id}: {address} = {word:04X}: {:02X?}",
            rig.writes()
        );
    }
}

#[test]
fn a_command_register_is_no_parameter() {
    for id in catalog_ids() {
        let model = model(&id);
        let run = model.run.as_ref().unwrap();
        let mut rig = quiet(&id, listing((0..=u16::MAX).collect()));
        for (role, word) in [
            (
                vfd_gateway::profile::model::RegisterRole::RunCommand,
                run.forward.value,
            ),
            (
                vfd_gateway::profile::model::RegisterRole::RunCommand,
                run.stop.value,
            ),
            (
                vfd_gateway::profile::model::RegisterRole::FrequencyCommand,
                3000,
            ),
        ] {
            let address = model.register_for(role).unwrap().address;
            let told = rig.commanded(MQTT, register(address.number(), word));
            assert_eq!(told, (Outcome::Refused, NotAllowed), "{id}: {address}");
        }
        assert!(rig.writes().is_empty(), "{id}");
    }
}

fn catalog_ids() -> Vec<String> {
    crate::support::families::models()
        .iter()
        .map(|model| model.id.clone())
        .collect()
}

#[test]
fn one_back_door_spoils_a_whole_block() {
    for (id, address, values, reason) in [
        (FR500, 0x2000, &[1, 3000, 500][..], NotAllowed),
        (FR500, 0x2001, &[3000, 500], NotAllowed),
        (FR500, 0x0108, &[6000, 6000, 0], NotAllowed),
        (E510, 0x2501, &[1, 3000, 0], NotListed),
        (AS1, 0xFA00, &[0xC400, 3000, 0], NotListed),
        (S15, 0x1870, &[0xC400, 3000], NotAllowed),
        (N700, 0x0002, &[1, 0, 3000], NotListed),
        (N100, 0x0002, &[1, 0, 3000], NotListed),
        (N100, 0x0202, &[100, 100, 0], NotListed),
    ] {
        let mut rig = quiet(id, listing(vec![0x0202, 0x0203]));
        assert_eq!(
            rig.commanded(ORIGIN, STOP).0,
            Outcome::Confirmed,
            "{id}: who stopped it may start it"
        );
        rig.sent.clear();
        assert_eq!(
            write(&mut rig, address, values),
            refused(reason),
            "{id}: {address}"
        );
        assert!(rig.writes().is_empty(), "{id}: {:02X?}", rig.writes());
    }
}

#[test]
fn what_is_listed_is_written_where_it_is_listed_and_nowhere_else() {
    for (id, address, word) in UNLISTED {
        let mut rig = quiet(id, accepting());
        assert_eq!(
            write(&mut rig, *address, &[*word]),
            refused(NotListed),
            "{id}: {address}"
        );
        assert!(rig.sent.is_empty(), "{id}: {:02X?}", rig.frames());
        let mut rig = quiet(id, listing(vec![*address]));
        assert_eq!(
            write(&mut rig, *address, &[*word]),
            NativeOutcome::Written,
            "{id}: {address}"
        );
        rig.pass(Duration::from_secs(2));
        assert_eq!(rig.writes(), [single(*address, *word)], "{id}");
    }
}

#[test]
fn a_register_in_ram_is_stored_only_at_its_twin_and_only_where_that_is_listed() {
    const ACCELERATION: u16 = 0x0300;
    const TWIN: u16 = 0x8300;
    for (listed, other, stored) in [(ACCELERATION, TWIN, 0), (TWIN, ACCELERATION, 1)] {
        let mut rig = quiet(FR500, listing(vec![listed]));
        assert_eq!(write(&mut rig, other, &[50]), refused(NotListed));
        assert_eq!(write(&mut rig, listed, &[50]), NativeOutcome::Written);
        assert_eq!(rig.commanded(MQTT, setpoint(3000)).0, Outcome::Confirmed);
        rig.pass(Duration::from_secs(2));
        assert_eq!(rig.writes(), [single(listed, 50), single(0x2001, 3000)]);
        assert_eq!(
            rig.bus.drive(Station(1)).unwrap().report().stored_writes,
            stored
        );
    }
}
