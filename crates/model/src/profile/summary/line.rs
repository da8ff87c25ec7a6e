//! The line sections of a summary: settings, timing, reads, writes, refusals.

use super::layout::{Row, list, row};
use crate::domain::address::Address;
use crate::profile::model::{
    Barrier, DriveQuirks, Fact, Model, ModelLink, ModelTiming, RamAlias, ReadBoundary, ReadHoles,
    ReadLimits,
};
use crate::profile::words::REFUSED_WRITES;
use crate::toml_file::values::duration_text;
use crate::toml_file::words::{FRAMINGS, INTERFACES, PARITIES, word_for};
use std::time::Duration;

pub(super) fn link(link: &ModelLink) -> Vec<Row> {
    let parities = link
        .parities
        .value
        .iter()
        .map(|parity| word_for(&PARITIES, parity));
    let framings = link
        .framings
        .value
        .iter()
        .map(|framing| word_for(&FRAMINGS, framing));
    let interfaces = link
        .interfaces
        .value
        .iter()
        .map(|interface| word_for(&INTERFACES, interface));
    let stations = &link.stations.value;
    let mut rows = vec![
        row("factory setting", &link.default.value, &link.default),
        row(
            "speeds",
            format!("{} bit/s", list(&link.bauds.value)),
            &link.bauds,
        ),
        row("data bits", list(&link.data_bits.value), &link.data_bits),
        row("parities", list(parities), &link.parities),
        row("stop bits", list(&link.stop_bits.value), &link.stop_bits),
        row("framings", list(framings), &link.framings),
        row("interfaces", list(interfaces), &link.interfaces),
        row(
            "stations",
            format!("{} to {}", stations.start(), stations.end()),
            &link.stations,
        ),
    ];
    if let Some(broadcast) = &link.broadcast {
        let value = format!(
            "station {}, functions {}",
            broadcast.station.value,
            functions(&broadcast.functions)
        );
        rows.push(row("broadcast", value, &broadcast.station));
    }
    rows
}

pub(super) fn timing(timing: &ModelTiming) -> Vec<Row> {
    let time = |name: &str, fact: &Fact<Duration>| row(name, duration_text(fact.value), fact);
    let mut rows = vec![
        row(
            "silence between frames",
            format!("{} characters", timing.gap_chars.value),
            &timing.gap_chars,
        ),
        time("longest wait for a reply", &timing.reply_timeout_cap),
    ];
    let optional = [
        ("longest processing", &timing.processing_max),
        (
            "longest processing of a stored write",
            &timing.stored_write_max,
        ),
        ("longest configurable reply delay", &timing.reply_delay_max),
        ("pause after a write", &timing.pause_after_write),
        (
            "pause after a stored write",
            &timing.pause_after_stored_write,
        ),
    ];
    rows.extend(
        optional
            .into_iter()
            .filter_map(|(name, fact)| Some(time(name, fact.as_ref()?))),
    );
    if let Some(bits) = &timing.reply_char_bits {
        rows.push(row(
            "a character of a reply",
            format!("{} bits", bits.value),
            bits,
        ));
    }
    rows.push(time("latest reply after a time-out", &timing.max_lateness));
    rows
}

pub(super) fn reads_and_writes(model: &Model) -> Vec<Row> {
    let Model { read, write, .. } = model;
    let mut rows = vec![
        row(
            "functions",
            functions(&model.functions.value),
            &model.functions,
        ),
        row(
            "words in one read",
            words_in_one_read(read),
            &read.max_words,
        ),
    ];
    if let Some(words) = &read.max_words_ascii {
        rows.push(row("the same in ASCII", up_to(words.value), words));
    }
    if let Some(bytes) = &read.max_bytes {
        rows.push(row(
            "longest frame",
            format!("{} bytes", bytes.value),
            bytes,
        ));
    }
    for area in &read.areas {
        let from = Address::new(area.table, area.from);
        let what = format!("words in one read of {from} to 0x{:04X}", area.to);
        rows.push(row(&what, up_to(area.max_words.value), &area.max_words));
    }
    if let Some(holes) = &read.holes {
        let value = match holes.value {
            ReadHoles::Refused => "refuse a read",
            ReadHoles::Zero => "read as 0: an answer proves nothing",
            ReadHoles::Read => "can be read: an answer proves nothing",
        };
        rows.push(row("addresses without a register", value, holes));
    }
    rows.push(row(
        "a refused write",
        word_for(&REFUSED_WRITES, &write.refused.value),
        &write.refused,
    ));
    if let Some(block) = &write.block {
        let value = format!("{} x{}", block.address, block.count.value);
        rows.push(row("written together", value, &block.count));
    }
    rows
}

fn functions(functions: &[u8]) -> String {
    format!(
        "{} hex",
        list(functions.iter().map(|function| format!("{function:02X}")))
    )
}

fn words_in_one_read(read: &ReadLimits) -> String {
    let boundary = match read.boundary {
        Some(ReadBoundary::HighByte) => ", one high byte of the address",
        None => "",
    };
    format!("{}{boundary}", up_to(read.max_words.value))
}

fn up_to(most: u16) -> String {
    if most == 1 {
        "1".to_owned()
    } else {
        format!("1 to {most}")
    }
}

pub(super) fn barriers(barriers: &[Barrier]) -> Vec<Row> {
    let barriers = barriers.iter().map(|barrier| match barrier {
        Barrier::Read(it) => vec!["read".to_owned(), format!("{} x{}", it.address, it.count)],
        Barrier::Loop(fact) => row("loop test", "08 hex with fresh data", fact),
        Barrier::Refused(fact) => row("refused function", format!("{:02X} hex", fact.value), fact),
    });
    barriers.collect()
}

pub(super) fn exceptions(model: &Model) -> Vec<Row> {
    let rows = model.exceptions.iter().map(|it| {
        let kind = u8::try_from(it.code)
            .ok()
            .and_then(|code| model.exception_kind(code));
        let text = kind.map_or_else(
            || it.text.clone(),
            |kind| format!("{} ({})", it.text, kind.keyword()),
        );
        vec![
            format!("{:02X} hex", it.code),
            text,
            it.confidence.keyword().to_owned(),
            it.source.clone(),
        ]
    });
    rows.collect()
}

pub(super) fn quirks(quirks: &DriveQuirks) -> Vec<Row> {
    let switches = [
        (
            "decimal_numbers",
            "addresses count in decimal digits: 0010 follows 0009",
            &quirks.decimal_numbers,
        ),
        (
            "percent_of_rated",
            "current and voltage are in per cent of rated values",
            &quirks.percent_of_rated,
        ),
        (
            "setpoint_before_run",
            "the setpoint is written before each RUN",
            &quirks.setpoint_before_run,
        ),
    ];
    let mut rows: Vec<_> = switches
        .into_iter()
        .filter_map(|(name, text, fact)| Some(row(name, text, fact.as_ref()?)))
        .collect();
    if let Some(bit) = &quirks.stored_alias_bit {
        let text = format!(
            "bit {} of an address marks the stored twin of a register",
            bit.value
        );
        rows.push(row("stored_alias_bit", text, bit));
    }
    if let Some(alias) = &quirks.ram_alias {
        rows.push(row("ram_alias", ram_alias(alias), alias));
    }
    let times = [
        (
            "deaf_after_power_up",
            "ignores requests after power-up for",
            &quirks.deaf_after_power_up,
        ),
        (
            "deaf_after_reset",
            "ignores requests after a reset for",
            &quirks.deaf_after_reset,
        ),
        (
            "pause_before_request",
            "needs a pause before each request of",
            &quirks.pause_before_request,
        ),
    ];
    rows.extend(times.into_iter().filter_map(|(name, text, fact)| {
        let fact = fact.as_ref()?;
        Some(row(
            name,
            format!("{text} {}", duration_text(fact.value)),
            fact,
        ))
    }));
    rows
}

fn ram_alias(alias: &Fact<RamAlias>) -> String {
    let RamAlias {
        mask,
        from,
        to,
        is_readable,
    } = alias.value;
    let read = if is_readable {
        "read and written"
    } else {
        "written, not read"
    };
    let unproven = if alias.confidence.is_proven() {
        ""
    } else {
        "; not used: unproven"
    };
    format!(
        "a stored register with 0x{from:04X} under 0x{mask:04X} is {read} in RAM with 0x{to:04X} there{unproven}"
    )
}
