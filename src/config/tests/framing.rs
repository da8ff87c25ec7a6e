//! Lines with ASCII frames, and the data bits that go with each framing.

use super::*;

/// Two models with both framings and even parity at 19200 bit/s from the factory: `acme-text` has 7 or 8 data bits,
/// `acme-wide` only 8.
fn catalog() -> Catalog {
    let acme = include_str!("../../../tests/golden/config/acme-one.toml");
    let both = with(
        &with(acme, "[\"rtu\"]", "[\"rtu\", \"ascii\"]"),
        "data_bits = { value = [8]",
        "data_bits = { value = [7, 8]",
    );
    let text = with(&both, "acme-one", "acme-text");
    let wide = with(&with(&text, "acme-text", "acme-wide"), "{ value = [7, 8]", "{ value = [8]");
    let acme = [("acme-text.toml", text.as_str()), ("acme-wide.toml", wide.as_str())];
    vendors::catalog().with_texts(acme).unwrap()
}

/// A line of these models, with `keys`.
fn line(keys: &str, models: &[&str]) -> String {
    let mut text = format!("[[line]]\nname = 'hall-1'\nport = '/dev/ttyUSB0'\n{keys}\n");
    for (station, model) in (1..).zip(models) {
        write!(text, "[[line.drive]]\nname = 'pump-{station}'\nmodel = '{model}'\nstation = {station}\n").unwrap();
    }
    text + "[[modbus_tcp]]\nlisten = '127.0.0.1:1502'\n"
}

fn settled(keys: &str, models: &[&str]) -> (Framing, String) {
    let config = load(&line(keys, models), &catalog()).unwrap_or_else(|problems| panic!("{problems:?}"));
    (config.lines[0].framing, config.lines[0].link.to_string())
}

#[track_caller]
fn refused(keys: &str, models: &[&str], expected: &[&str]) {
    let problems = load(&line(keys, models), &catalog()).expect_err(keys);
    let told = |it: &Problem| format!("{}: {}; {}", it.key, it.what, it.right.as_deref().unwrap_or("-"));
    assert_eq!(problems.iter().map(told).collect::<Vec<_>>(), expected);
}

#[test]
fn ascii_is_served_where_every_model_has_it() {
    let ascii = "framing = 'ascii'";
    assert_eq!(settled(ascii, &["acme-text"]), (Framing::Ascii, "19200 8E1".to_owned()));
    assert_eq!(settled("framing = 'ascii'\ndata_bits = 7", &["acme-text"]), (Framing::Ascii, "19200 7E1".to_owned()));
    assert_eq!(settled("data_bits = 8", &["acme-text", "acme-wide"]), (Framing::Rtu, "19200 8E1".to_owned()));
    let same_link = "framing = 'ascii'\nbaud = 9600\nparity = 'even'";
    refused(
        same_link,
        &["acme-text", "hyundai-n700", "hyundai-n700"],
        &["line[0].framing: framing \"ascii\" is not possible with hyundai-n700 (drive `pump-2`); only \"rtu\""],
    );
}

#[test]
fn seven_data_bits_need_ascii_and_every_model() {
    let rtu = "line[0].data_bits: RTU frames need 8 data bits; 8, or leave it out";
    refused("data_bits = 7", &["acme-text"], &[rtu]);
    refused("data_bits = 7\nframing = 'rtu'", &["acme-text"], &[rtu]);
    let keys = "framing = 'ascii'\ndata_bits = 7";
    let only_eight = "line[0].data_bits: data_bits 7 is not possible with acme-wide (drive `pump-2`); only 8";
    refused(keys, &["acme-text", "acme-wide"], &[only_eight]);
    let range = "line[0].data_bits: 6 is out of range; a whole number from 7 to 8";
    refused("framing = 'ascii'\ndata_bits = 6", &["acme-text"], &[range]);
}
