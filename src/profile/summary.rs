//! A model as a table for people: what is known of it, how sure that is, and where it comes from.

use super::model::{Barrier, Boundary, Fact, Link, Model, ReadLimits, Register, RunCommand, Timing};
use super::values::duration_text;
use super::words::{FRAMINGS, INTERFACES, PARITIES, POLL_CLASSES, REFUSED_WRITES, word_for};
use std::fmt::Display;

/// What is known of `model`, as plain text that ends with a line end.
#[must_use]
pub fn summary(model: &Model) -> String {
    let mut text = format!("{}: {} {}\n", model.id, model.vendor, model.title);
    let documents = model.documents.iter().map(|(name, title)| vec![name.clone(), title.clone()]);
    section(&mut text, "Documents", documents.collect());
    section(&mut text, "Link", link(&model.link));
    section(&mut text, "Timing", timing(&model.timing));
    section(&mut text, "Reads and writes", reads_and_writes(model));
    if let Some(run) = &model.run {
        section(&mut text, "Run commands", run_commands(run));
    }
    section(&mut text, "Registers", registers(&model.registers));
    text
}

fn link(link: &Link) -> Vec<Vec<String>> {
    let parities = link.parities.value.iter().map(|parity| word_for(&PARITIES, parity));
    let framings = link.framings.value.iter().map(|framing| word_for(&FRAMINGS, framing));
    let interfaces = link.interfaces.value.iter().map(|interface| word_for(&INTERFACES, interface));
    let stations = &link.stations.value;
    let mut rows = vec![
        row("factory setting", link.default.value, &link.default),
        row("speeds", format!("{} bit/s", list(&link.bauds.value)), &link.bauds),
        row("data bits", list(&link.data_bits.value), &link.data_bits),
        row("parities", list(parities), &link.parities),
        row("stop bits", list(&link.stop_bits.value), &link.stop_bits),
        row("framings", list(framings), &link.framings),
        row("interfaces", list(interfaces), &link.interfaces),
        row("stations", format!("{} to {}", stations.start(), stations.end()), &link.stations),
    ];
    if let Some(broadcast) = &link.broadcast {
        let functions = list(broadcast.functions.iter().map(|function| format!("{function:02X}")));
        let value = format!("station {}, functions {functions} hex", broadcast.station.value);
        rows.push(row("broadcast", value, &broadcast.station));
    }
    rows
}

fn timing(timing: &Timing) -> Vec<Vec<String>> {
    let mut rows = vec![
        row("silence between frames", format!("{} characters", timing.gap_chars.value), &timing.gap_chars),
        row("longest wait for a reply", duration_text(timing.reply_timeout_cap.value), &timing.reply_timeout_cap),
    ];
    if let Some(processing) = &timing.processing_max {
        rows.push(row("longest processing", duration_text(processing.value), processing));
    }
    rows.push(row("latest reply after a time-out", duration_text(timing.max_lateness.value), &timing.max_lateness));
    rows
}

fn reads_and_writes(model: &Model) -> Vec<Vec<String>> {
    let refused = &model.write.refused;
    let mut rows = vec![
        row("words in one read", words_in_one_read(&model.read), &model.read.max_words),
        row("a refused write", word_for(&REFUSED_WRITES, &refused.value), refused),
    ];
    if !model.barriers.is_empty() {
        let barriers = model.barriers.iter().map(|it| match it {
            Barrier::Read(it) => format!("0x{:04X} x{}", it.address, it.count),
            Barrier::Loop(_) => "loop test".to_owned(),
            Barrier::Refused(function) => format!("function {:02X} hex refused", function.value),
        });
        rows.push(vec!["barrier reads".to_owned(), list(barriers)]);
    }
    rows
}

fn words_in_one_read(read: &ReadLimits) -> String {
    let boundary = match read.boundary {
        Some(Boundary::HighByte) => ", one high byte of the address",
        None => "",
    };
    format!("1 to {}{boundary}", read.max_words.value)
}

fn run_commands(run: &RunCommand) -> Vec<Vec<String>> {
    let all = [
        ("stop", Some(&run.stop)),
        ("forward", Some(&run.forward)),
        ("reverse", run.reverse.as_ref()),
        ("coast", run.coast.as_ref()),
        ("reset", run.reset.as_ref()),
    ];
    let mut rows: Vec<_> = all.into_iter().filter_map(|(name, fact)| Some(row(name, fact?.value, fact?))).collect();
    if !run.reset_sequence.is_empty() {
        rows.push(vec!["a reset is".to_owned(), list(&run.reset_sequence)]);
    }
    rows
}

fn registers(registers: &[Register]) -> Vec<Vec<String>> {
    let head = ["address", "code", "name", "unit", "scale", "access", "poll", "confidence", "source", "what it is"];
    let mut rows = vec![head.map(str::to_owned).to_vec()];
    rows.extend(registers.iter().map(register));
    rows
}

fn register(register: &Register) -> Vec<String> {
    vec![
        format!("0x{:04X}", register.address),
        register.code.clone().unwrap_or_else(|| "-".to_owned()),
        register.name.clone(),
        register.unit.to_string(),
        format!("x{}{}", register.scale, if register.signed { " signed" } else { "" }),
        register.access.word().to_owned(),
        register.poll.map_or("-", |poll| word_for(&POLL_CLASSES, &poll)).to_owned(),
        register.confidence.word().to_owned(),
        register.source.clone(),
        register.title.clone(),
    ]
}

fn row<T>(name: &str, value: impl Display, fact: &Fact<T>) -> Vec<String> {
    vec![name.to_owned(), value.to_string(), fact.confidence.word().to_owned(), fact.source.clone()]
}

fn list<T: Display>(items: impl IntoIterator<Item = T>) -> String {
    items.into_iter().map(|item| item.to_string()).collect::<Vec<_>>().join(", ")
}

/// Appends a heading and `rows`, each column as wide as its widest cell.
fn section(text: &mut String, heading: &str, rows: Vec<Vec<String>>) {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |column: usize| rows.iter().map(|row| row.get(column).map_or(0, |cell| cell.chars().count())).max();
    let widths: Vec<usize> = (0..columns).map(|column| width(column).unwrap_or(0)).collect();
    text.push_str(&format!("\n{heading}\n"));
    for row in &rows {
        let cells = row.iter().zip(&widths).map(|(cell, width)| format!("  {cell:width$}"));
        text.push_str(cells.collect::<String>().trim_end());
        text.push('\n');
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::check;
    use crate::profile::testing::MODEL;

    #[test]
    fn only_what_is_known_is_shown() {
        let text = summary(&check::model(MODEL).unwrap());
        assert!(text.starts_with("acme-1: Acme One\n\nDocuments\n  IM  Interface manual\n\nLink\n"), "{text}");
        for absent in ["broadcast", "processing", "barrier", "Run commands"] {
            assert!(!text.contains(absent), "{text}");
        }
        assert!(text.ends_with("  manual      IM 4    Output frequency\n"), "{text}");
        assert!(text.contains("  0x0101   D001  output_frequency  Hz    x100   read    fast  manual"), "{text}");
    }
}
