//! Which registers may be written natively.

use super::*;

const AT: &str = "line[0].drive[0].native";

fn writes(list: &str) -> String {
    with(CONTROLLED, "[\"F007\"]", list)
}

#[test]
fn registers_are_named_by_code_name_or_address() {
    let config = good(&writes("['f008', '0x020c']"));
    assert_eq!(
        config.lines[0].drives[0]
            .control
            .as_ref()
            .unwrap()
            .native_write,
        [0x020E, 0x020C]
    );
    let config = good(&writes("['acceleration_time']"));
    assert_eq!(
        config.lines[0].drives[0]
            .control
            .as_ref()
            .unwrap()
            .native_write,
        [0x020C]
    );
    let config = good(&writes("[]"));
    assert_eq!(
        config.lines[0].drives[0]
            .control
            .as_ref()
            .unwrap()
            .native_write,
        [0_u16; 0]
    );
}

#[test]
fn a_register_of_the_configuration_may_be_listed() {
    let register = |access: &str| {
        let register = format!(
            "[[line.drive.register]]\nname = 'mine'\ntitle = 'Mine'\naddress = 0x0333\nunit = '-'\naccess = '{access}'\n\
             [line.drive.native]"
        );
        with(&writes("['mine']"), "[line.drive.native]", &register)
    };
    assert_eq!(
        good(&register("write")).lines[0].drives[0]
            .control
            .as_ref()
            .unwrap()
            .native_write,
        [0x0333]
    );
    only(
        &register("read"),
        &format!(
            "{AT}.write[0]: `mine` cannot be written; registers with the access \"write\" or \"read-write\""
        ),
    );
}

#[test]
fn only_registers_that_are_no_way_around_control_are_listed() {
    let command = "takes commands; leave it out; `control` says what may be commanded, \
                   and each write there is reviewed as a command";
    let around = "selects the source of commands, and would bypass `control`; leave it out";
    for (written, name, problem) in [
        ("0x0002", "run_command", command),
        ("frequency_command", "frequency_command", command),
        ("F001", "frequency_setting", around),
        ("F010", "frequency_source", around),
        ("0x0212", "run_source", around),
        (
            "D001",
            "output_frequency",
            "cannot be written; registers with the access \"write\" or \"read-write\"",
        ),
    ] {
        only(
            &writes(&format!("['{written}']")),
            &format!("{AT}.write[0]: `{name}` {problem}"),
        );
    }
}

#[test]
fn a_register_that_is_not_there_is_not_written() {
    let by_address =
        "the address of a register of the model, or of one added by `[[line.drive.register]]`";
    for (written, right) in [
        ("F0007", "\"F007\""),
        ("aceleration_time", "\"acceleration_time\""),
        (
            "524",
            "a name or a code of the model, or an address as \"0x020C\"",
        ),
    ] {
        let problem = format!("{AT}.write[0]: hyundai-n700 has no register `{written}`; {right}");
        only(&writes(&format!("['{written}']")), &problem);
    }
    for written in ["0x020D", "0x", "0x+20C", "0x1020C"] {
        let problem =
            format!("{AT}.write[0]: hyundai-n700 has no register at `{written}`; {by_address}");
        only(&writes(&format!("['{written}']")), &problem);
    }
    only(
        &writes("['F007', 'F008', '0x020C']"),
        &format!("{AT}.write[2]: register `acceleration_time`, 0x020C, is listed twice; each once"),
    );
}

#[test]
fn who_may_write_is_said_by_control() {
    let text = drive_with("[line.drive.native]\nwrite = ['F007']");
    only(
        &text,
        &format!(
            "{AT}: only clients that may command can write registers, and the drive has no control section; \
             a `[line.drive.control]`, or leave `native` out"
        ),
    );
    only(
        &with(CONTROLLED, "write = [\"F007\"]", ""),
        &format!("{AT}.write: `write` is missing; a list, each text, not empty"),
    );
}
