//! Lines with ASCII frames, and the data bits that go with each framing.

use super::*;

/// Two models with both framings and even parity at 19200 bit/s from the factory: `acme-text` has 7 or 8 data bits,
/// `acme-wide` only 8.
fn catalog() -> Catalog {
    let acme = include_str!("../../../../../tests/golden/config/acme-one.toml");
    let both = with(
        &with(acme, "[\"rtu\"]", "[\"rtu\", \"ascii\"]"),
        "data_bits = { value = [8]",
        "data_bits = { value = [7, 8]",
    );
    let text = with(&both, "acme-one", "acme-text");
    let wide = with(
        &with(&text, "acme-text", "acme-wide"),
        "{ value = [7, 8]",
        "{ value = [8]",
    );
    let acme = [
        ("acme-text.toml", text.as_str()),
        ("acme-wide.toml", wide.as_str()),
    ];
    vendors::catalog().with_texts(acme).unwrap()
}

/// A line of these models, with `keys`.
fn line(keys: &str, models: &[&str]) -> String {
    let mut text = format!("[[line]]\nname = 'hall-1'\nport = '/dev/ttyUSB0'\n{keys}\n");
    for (station, model) in (1..).zip(models) {
        write!(
            text,
            "[[line.drive]]\nname = 'pump-{station}'\nmodel = '{model}'\nstation = {station}\n"
        )
        .unwrap();
    }
    text + "[[modbus_tcp]]\nlisten = '127.0.0.1:1502'\n"
}

fn settled(keys: &str, models: &[&str]) -> (Framing, String) {
    let config =
        load(&line(keys, models), &catalog()).unwrap_or_else(|problems| panic!("{problems:?}"));
    (config.lines[0].framing, config.lines[0].link.to_string())
}

#[track_caller]
fn refused(keys: &str, models: &[&str], expected: &[&str]) {
    let problems = load(&line(keys, models), &catalog()).expect_err(keys);
    assert_eq!(
        problems.iter().map(problem_text).collect::<Vec<_>>(),
        expected
    );
}

#[test]
fn ascii_is_served_where_every_model_has_it() {
    let ascii = "framing = 'ascii'";
    assert_eq!(
        settled(ascii, &["acme-text"]),
        (Framing::Ascii, "19200 8E1".to_owned())
    );
    assert_eq!(
        settled("framing = 'ascii'\ndata_bits = 7", &["acme-text"]),
        (Framing::Ascii, "19200 7E1".to_owned())
    );
    assert_eq!(
        settled("data_bits = 8", &["acme-text", "acme-wide"]),
        (Framing::Rtu, "19200 8E1".to_owned())
    );
    let same_link = "framing = 'ascii'\nbaud = 9600\nparity = 'even'";
    refused(
        same_link,
        &["acme-text", "hyundai-n700", "hyundai-n700"],
        &[
            "line[0].framing: framing \"ascii\" is not possible with hyundai-n700 (drive `pump-2`); only \"rtu\"",
        ],
    );
}

/// `acme-text` and a model that begins from it with another factory setting.
fn with_default(default: &str) -> Catalog {
    let like = format!(
        "id = 'acme-other'\nvendor = 'Acme'\ntitle = 'Other'\nlike = 'acme-text'\n[documents]\nB = 'B'\n[link]\n\
         default = {{ {default}, confidence = 'manual', source = 'B 1' }}\n\
         stop_bits = {{ value = [1, 2], confidence = 'manual', source = 'B 1' }}\n\
         parities = {{ value = ['none', 'even'], confidence = 'manual', source = 'B 1' }}\n"
    );
    catalog()
        .with_texts([("acme-other.toml", like.as_str())])
        .unwrap()
}

#[track_caller]
fn refused_with(catalog: &Catalog, keys: &str, expected: &[&str]) {
    let problems = load(&line(keys, &["acme-other"]), catalog).expect_err(keys);
    assert_eq!(
        problems.iter().map(problem_text).collect::<Vec<_>>(),
        expected
    );
}

#[test]
fn what_no_factory_setting_says_must_be_stated() {
    let asks = with_default("ask = 'P2010, P2034 and P2035'");
    let left_out =
        "is left out, and no factory setting can be assumed: acme-other: P2010, P2034 and P2035";
    let speed = format!(
        "line[0].baud: `baud` {left_out}; add `baud`, and set it on every drive: one of 9600, 19200"
    );
    let parity = format!(
        "line[0].parity: `parity` {left_out}; add `parity`, and set it on every drive: one of \"none\", \"even\""
    );
    let stops = format!(
        "line[0].stop_bits: `stop_bits` {left_out}; add `stop_bits`, and set it on every drive: one of 1, 2"
    );
    refused_with(&asks, "", &[&speed, &parity, &stops]);
    let stated = "baud = 9600\nparity = 'even'\nstop_bits = 1";
    let bits = format!(
        "line[0].data_bits: `data_bits` {left_out}; add `data_bits`, and set it on every drive: one of 7, 8"
    );
    refused_with(&asks, &format!("framing = 'ascii'\n{stated}"), &[&bits]);
    let config = load(&line(stated, &["acme-other"]), &asks).unwrap();
    assert_eq!(config.lines[0].link.to_string(), "9600 8E1");
}

#[test]
fn the_factory_setting_of_an_ascii_drive_is_none_of_an_rtu_line() {
    let ascii = with_default("baud = 9600, data_bits = 7, parity = 'none', stop_bits = 2");
    let config = load(&line("framing = 'ascii'", &["acme-other"]), &ascii).unwrap();
    assert_eq!(config.lines[0].link.to_string(), "9600 7N2");
    let left_out = "is left out, and no factory setting can be assumed: the factory setting of \
                    acme-other is ASCII frames at 9600 7N2; add";
    let stops = format!(
        "line[0].stop_bits: `stop_bits` {left_out} `stop_bits`, and set it on every drive: one of 1, 2"
    );
    refused_with(&ascii, "baud = 9600\nparity = 'none'", &[&stops]);
}

#[test]
fn seven_data_bits_need_ascii_and_every_model() {
    let rtu = "line[0].data_bits: RTU frames need 8 data bits; 8, or leave it out";
    refused("data_bits = 7", &["acme-text"], &[rtu]);
    refused("data_bits = 7\nframing = 'rtu'", &["acme-text"], &[rtu]);
    let keys = "framing = 'ascii'\ndata_bits = 7";
    let only_eight =
        "line[0].data_bits: data_bits 7 is not possible with acme-wide (drive `pump-2`); only 8";
    refused(keys, &["acme-text", "acme-wide"], &[only_eight]);
    let range = "line[0].data_bits: 6 is out of range; a whole number from 7 to 8";
    refused("framing = 'ascii'\ndata_bits = 6", &["acme-text"], &[range]);
}
