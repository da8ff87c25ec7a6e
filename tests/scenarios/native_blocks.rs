//! A native request is more than one frame, or less: blocks over run and setpoint are one command, long reads are cut
//! as the drive counts, and loop tests reach only those that serve them.

use crate::support::families::{
    accepting, listing, models, quiet, refused, single, stopped, write,
};
use crate::support::{MQTT, Rig, RigOptions, model, run};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::address::Address;
use vfd_gateway::domain::command::{Direction, Order, Outcome, Reason};
use vfd_gateway::domain::native::{NativeAsk, NativeOutcome, NativeRefusal};
use vfd_gateway::profile::model::{Model, RegisterMemory};
use vfd_gateway::wire::pdu::function;

/// Model, address of the run command, run, stop, and whether setpoint and run share a frame: only where that is proven.
const BLOCKS: &[(&str, u16, u16, u16, bool)] = &[
    ("frecon-fr500a", 0x2000, 1, 5, false),
    ("toshiba-vf-as1", 0xFA00, 0xC400, 0xC000, false),
    ("toshiba-vf-s15", 0xFA00, 0xC400, 0xC000, false),
    ("teco-e510", 0x2501, 1, 0, true),
    ("teco-e510s", 0x2501, 1, 0, false),
];

fn block(address: u16, words: [u16; 2]) -> Vec<u8> {
    let head = [address, 2].map(u16::to_be_bytes).concat();
    [
        vec![0x10],
        head,
        vec![4],
        words.map(u16::to_be_bytes).concat(),
    ]
    .concat()
}

fn read(rig: &mut Rig, address: u16, count: u16) -> NativeOutcome {
    let ticket = rig.read(1, 0, address, count);
    rig.answer_to(ticket)
}

/// Places of the reads among the frames so far.
fn reads(rig: &Rig) -> Vec<(u16, u16)> {
    let word = |pdu: &[u8], at: usize| u16::from_be_bytes([pdu[at], pdu[at + 1]]);
    let reads = rig
        .sent
        .iter()
        .filter(|sent| sent.pdu[0] == function::READ_HOLDING);
    reads
        .map(|sent| (word(&sent.pdu, 1), word(&sent.pdu, 3)))
        .collect()
}

#[test]
fn a_block_over_run_and_setpoint_is_one_command_with_the_setpoint_first() {
    for (id, address, run, _, in_one_frame) in BLOCKS {
        let mut rig = stopped(id, accepting());
        assert_eq!(
            write(&mut rig, *address, &[*run, 3000]),
            NativeOutcome::Written,
            "{id}"
        );
        rig.pass(Duration::from_millis(1500));
        let frames = if *in_one_frame {
            vec![block(*address, [*run, 3000])]
        } else {
            vec![single(address + 1, 3000), single(*address, *run)]
        };
        assert_eq!(rig.writes(), frames, "{id}");
        assert!(rig.output(1) > 0, "{id}");
        assert_eq!(
            rig.view(0).control.unwrap().commands,
            2,
            "{id}: the stop before, and the block"
        );
    }
}

#[test]
fn a_stop_in_a_block_goes_alone_and_before_all() {
    for (id, address, run, stop, _) in BLOCKS {
        let mut rig = stopped(id, accepting());
        write(&mut rig, *address, &[*run, 3000]);
        rig.pass(Duration::from_secs(2));
        assert!(rig.output(1) > 0, "{id}");
        rig.sent.clear();
        // A setpoint that is not allowed does not hold up a stop either.
        assert_eq!(
            write(&mut rig, *address, &[*stop, 9000]),
            NativeOutcome::Written,
            "{id}"
        );
        rig.pass(Duration::from_secs(8));
        assert_eq!(rig.writes(), [single(*address, *stop)], "{id}");
        assert_eq!(rig.output(1), 0, "{id}");
    }
}

#[test]
fn a_stop_overtakes_the_block_that_is_not_yet_through() {
    let mut rig = stopped("frecon-fr500a", accepting());
    let block = rig.ask(
        1,
        0,
        NativeAsk::Write {
            address: 0x2000_u16.into(),
            values: vec![1, 3000],
        },
    );
    let stop = rig.ask(
        2,
        0,
        NativeAsk::Write {
            address: 0x2000_u16.into(),
            values: vec![5, 3000],
        },
    );
    assert_eq!(rig.answer_to(stop), NativeOutcome::Written);
    assert_eq!(rig.answer_to(block), NativeOutcome::Superseded);
    rig.pass(Duration::from_secs(2));
    let runs = rig
        .writes()
        .iter()
        .filter(|pdu| **pdu == single(0x2000, 1))
        .count();
    assert_eq!((runs, rig.output(1)), (0, 0), "{:02X?}", rig.writes());
}

#[test]
fn several_registers_in_one_frame_are_written_only_where_the_model_knows_such_blocks() {
    for model in models() {
        let mut rig = stopped(&model.id, accepting());
        for order in [
            run(Direction::Forward, Some(3000)),
            Order::Stop { setpoint: None },
        ] {
            rig.commanded(MQTT, order);
            rig.live(Duration::from_secs(8));
        }
        let blocks = rig
            .sent
            .iter()
            .filter(|sent| sent.pdu[0] == function::WRITE_MULTIPLE)
            .count();
        assert_eq!(
            blocks,
            usize::from(model.id == "teco-e510"),
            "{}: {:02X?}",
            model.id,
            rig.writes()
        );
    }
}

#[test]
fn parameters_go_one_by_one_and_are_read_back() {
    for (id, address, values) in [
        ("teco-e510", 0x000E, [50, 60]),
        ("teco-e510s", 0x0908, [3, 50]),
        ("frecon-fr500a", 0x0300, [50, 60]),
        ("hyundai-n100plus", 0x0202, [50, 60]),
    ] {
        let mut rig = quiet(id, listing(vec![address, address + 1]));
        assert_eq!(
            write(&mut rig, address, &values),
            NativeOutcome::Written,
            "{id}"
        );
        rig.pass(Duration::from_secs(2));
        assert_eq!(
            rig.writes(),
            [single(address, values[0]), single(address + 1, values[1])],
            "{id}"
        );
        assert_eq!(reads(&rig), [(address, 1), (address + 1, 1)], "{id}");
    }
}

/// A Frecon with 20 registers more that end in front of its run command.
fn with_many_registers() -> Arc<Model> {
    let mut model = Model::clone(&model("frecon-fr500a"));
    let like = model
        .registers
        .iter()
        .find(|register| register.name == "stop_mode")
        .unwrap()
        .clone();
    for address in 0x1FEC..0x2000 {
        let name = format!("more_{address:04x}");
        let code = None;
        model.registers.push(vfd_gateway::profile::model::Register {
            name,
            code,
            address: Address::holding(address),
            memory: Some(RegisterMemory::Ram),
            meanings: Vec::new(),
            ..like.clone()
        });
    }
    model.registers.sort_by_key(|register| register.address);
    Arc::new(model)
}

#[test]
fn a_write_of_more_than_sixteen_frames_is_refused_whole() {
    let model = with_many_registers();
    let control = listing((0x1FEC..0x2000).collect());
    let rig = || {
        let options = crate::support::families::options_of(&model, control.clone());
        let mut rig = Rig::new(&RigOptions {
            poll: RigOptions::default().poll,
            ..options
        });
        assert_eq!(
            rig.commanded(crate::support::ORIGIN, crate::support::STOP)
                .0,
            Outcome::Confirmed
        );
        rig.sent.clear();
        rig
    };
    let ramps = |count: usize| vec![7_u16; count];
    let with_run = |count: usize| [ramps(count), vec![1, 3000]].concat();
    for (address, values, frames) in [
        (0x1FEC, ramps(16), Some(16)),
        (0x1FEC, ramps(17), None),
        (0x2000 - 14, with_run(14), Some(16)),
        (0x2000 - 15, with_run(15), None),
        (0x2000 - 16, with_run(16), None),
    ] {
        let mut rig = rig();
        let outcome = write(&mut rig, address, &values);
        let expected = if frames.is_some() {
            NativeOutcome::Written
        } else {
            refused(Reason::TooManyFrames)
        };
        assert_eq!(outcome, expected, "{} words", values.len());
        rig.pass(Duration::from_secs(2));
        assert_eq!(
            rig.writes().len(),
            frames.unwrap_or(0),
            "{} words",
            values.len()
        );
    }
}

#[test]
fn a_read_of_more_than_sixteen_frames_is_refused_whole() {
    for (id, address, most) in [
        ("toshiba-vf-as1", 0xFE00, 16),
        ("toshiba-vf-s15", 0xFE00, 16),
    ] {
        let mut rig = quiet(id, accepting());
        assert_eq!(
            read(&mut rig, address, most + 1),
            NativeOutcome::Refused(NativeRefusal::TooManyFrames),
            "{id}"
        );
        assert!(rig.sent.is_empty(), "{id}: {:02X?}", rig.frames());
    }
}

#[test]
fn a_long_read_is_cut_as_the_drive_counts() {
    for id in ["toshiba-vf-as1", "toshiba-vf-s15"] {
        let mut rig = quiet(id, accepting());
        let NativeOutcome::Words(words) = read(&mut rig, 0xFE07, 5) else {
            panic!("{id}: words")
        };
        assert_eq!(words.len(), 5);
        let numbers = [0xFE07, 0xFE08, 0xFE09, 0xFE10, 0xFE11].map(|number| (number, 1));
        assert_eq!(reads(&rig), numbers, "{id}: FE10 follows FE09");
    }
    let mut rig = quiet("hyundai-n100plus", accepting());
    let NativeOutcome::Words(words) = read(&mut rig, 0x0101, 29) else {
        panic!("words")
    };
    assert_eq!(words.len(), 29);
    assert_eq!(
        reads(&rig),
        [(0x0101, 8), (0x0109, 8), (0x0111, 8), (0x0119, 5)]
    );
    let mut rig = quiet("teco-e510", accepting());
    assert!(matches!(
        read(&mut rig, 0x2520, 10),
        NativeOutcome::Words(_)
    ));
    assert_eq!(reads(&rig), [(0x2520, 10)], "one frame holds 37");
}

#[test]
fn each_word_of_a_cut_read_stands_in_its_place() {
    for id in ["toshiba-vf-as1", "toshiba-vf-s15"] {
        let mut rig = stopped(id, accepting());
        rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
        rig.live(Duration::from_secs(8));
        let now = rig.now;
        rig.bus
            .drive_mut(vfd_gateway::domain::ids::Station(1))
            .unwrap()
            .trip(now, 3);
        rig.pass(Duration::from_secs(1));
        let NativeOutcome::Words(words) = read(&mut rig, 0xFE09, 3) else {
            panic!("{id}: words")
        };
        let alone: Vec<NativeOutcome> = [0xFE09, 0xFE10, 0xFE11]
            .map(|number| read(&mut rig, number, 1))
            .to_vec();
        let words: Vec<NativeOutcome> = words
            .iter()
            .map(|word| NativeOutcome::Words(Arc::from([*word])))
            .collect();
        assert_eq!(words, alone, "{id}");
        assert_eq!(
            alone[1],
            NativeOutcome::Words(Arc::from([3])),
            "{id}: FE10 is the newest trip"
        );
    }
}

#[test]
fn a_number_that_does_not_exist_spoils_the_whole_range() {
    for id in ["toshiba-vf-as1", "toshiba-vf-s15"] {
        for (address, count) in [
            (0xFE14, 3),
            (0xFE15, 1),
            (0xFD05, 4),
            (0xFE0A, 1),
            (0xFE79, 2),
            (0xFDFF, 2),
        ] {
            let mut rig = quiet(id, accepting());
            assert_eq!(
                read(&mut rig, address, count),
                NativeOutcome::DriveException {
                    code: 2,
                    reason: Reason::DriveException
                },
                "{id}: {address:04X}"
            );
            rig.pass(Duration::from_secs(1));
            assert!(rig.answers.is_empty(), "{id}: one answer");
            assert!(reads(&rig).len() <= usize::from(count), "{id}");
        }
    }
}

#[test]
fn a_loop_test_reaches_only_drives_that_serve_it() {
    for model in models() {
        let mut rig = quiet(&model.id, accepting());
        let ticket = rig.ask(1, 0, NativeAsk::Loop { data: 0xA537 });
        let serves = ["TECO", "Frecon"].contains(&model.vendor.as_str());
        let expected = if serves {
            NativeOutcome::Written
        } else {
            refused(Reason::NotCapable)
        };
        assert_eq!(rig.answer_to(ticket), expected, "{}", model.id);
        let pdus: Vec<_> = rig.sent.iter().map(|sent| sent.pdu.clone()).collect();
        let expected = if serves {
            vec![vec![8, 0, 0, 0xA5, 0x37]]
        } else {
            Vec::new()
        };
        assert_eq!(pdus, expected, "{}", model.id);
    }
}
