//! The pages of first steps, from the wires to the first start with no load, each beside a drive that is played.

use super::super::mosquitto::free_port;
use super::super::rig::{Place, start, vfd_gateway};
use super::super::started::Started;
use super::follow::{Guide, NotRun, Table};
use super::text::{document, documents};
use super::{ADAPTER, DATA_DIR, LISTEN};

/// A drive on its line, as `docs/first-steps/README.md` says to play one.
pub fn played(place: &Place, link: &str, model: &str) -> Started {
    let link = place.file(link);
    // Every page has RTU frames, also where the drive leaves the factory with ASCII.
    let drive = start(&[
        "simulate",
        "--model",
        model,
        "--data-bits",
        "8",
        "--link",
        link.to_str().unwrap(),
    ]);
    drive.wait_for("that it plays", |line| {
        line.contains("station 1").then_some(())
    });
    drive
}

/// The model of the first drive in the configuration of a guide.
pub fn model_in(text: &str) -> &str {
    text.split_once("\nmodel = \"")
        .unwrap()
        .1
        .split('"')
        .next()
        .unwrap()
}

/// What a reader has in the place of the guide's adapter, directory and port.
pub fn places(place: &Place, text: &str) -> Table {
    std::fs::create_dir(place.file("data")).unwrap();
    let here = |name: &str| place.file(name).to_str().unwrap().to_owned();
    let port = free_port();
    let mut table = vec![
        (ADAPTER, here("line")),
        (DATA_DIR, here("data")),
        (LISTEN, format!("127.0.0.1:{port}")),
        (
            "vfd-gateway read --unit",
            format!("vfd-gateway read --port {port} --unit"),
        ),
    ];
    if text.contains("vfd-gateway write --unit") {
        table.push((
            "vfd-gateway write --unit",
            format!("vfd-gateway write --port {port} --unit"),
        ));
    }
    table
}

/// Reads the page from its beginning to its end.
fn follow(name: &'static str) {
    let text = document(name);
    let place = Place::new();
    let drive = played(&place, "line", model_in(&text));
    let table = places(&place, &text);
    let mut typed = 0;
    Guide::new(name, place, table, &[]).follow(|_, _| typed += 1);
    assert!(typed > 6, "{typed} lines of {name}");
    drop(drive);
}

/// One test for each page.
macro_rules! first_steps {
    ($($test:ident => $page:literal,)*) => {
        $(
            #[test]
            fn $test() {
                follow(concat!("docs/first-steps/", $page, ".md"));
            }
        )*

        const FOLLOWED: &[&str] = &[$(concat!("first-steps/", $page, ".md")),*];
    };
}

first_steps! {
    the_first_steps_with_abb_work => "abb",
    the_first_steps_with_actech_work => "actech",
    the_first_steps_with_automationdirect_work => "automationdirect",
    the_first_steps_with_control_techniques_work => "control-techniques",
    the_first_steps_with_danfoss_work => "danfoss",
    the_first_steps_with_delta_work => "delta",
    the_first_steps_with_eaton_work => "eaton",
    the_first_steps_with_frecon_work => "frecon",
    the_first_steps_with_fuji_work => "fuji",
    the_first_steps_with_hitachi_work => "hitachi",
    the_first_steps_with_huanyang_work => "huanyang",
    the_first_steps_with_hyundai_n100plus_work => "hyundai-n100plus",
    the_first_steps_with_hyundai_n700_work => "hyundai-n700",
    the_first_steps_with_inovance_work => "inovance",
    the_first_steps_with_invertek_work => "invertek",
    the_first_steps_with_invt_work => "invt",
    the_first_steps_with_ls_work => "ls",
    the_first_steps_with_mitsubishi_work => "mitsubishi",
    the_first_steps_with_omron_work => "omron",
    the_first_steps_with_powtran_work => "powtran",
    the_first_steps_with_rockwell_work => "rockwell",
    the_first_steps_with_schneider_work => "schneider",
    the_first_steps_with_siemens_work => "siemens",
    the_first_steps_with_spindles_work => "spindles",
    the_first_steps_with_sunfar_work => "sunfar",
    the_first_steps_with_teco_work => "teco",
    the_first_steps_with_toshiba_work => "toshiba",
    the_first_steps_with_vacon_work => "vacon",
    the_first_steps_with_weg_work => "weg",
    the_first_steps_with_yaskawa_work => "yaskawa",
}

#[test]
fn every_page_of_first_steps_is_followed() {
    let pages = documents().into_iter().map(|(name, _)| name);
    let pages: Vec<_> = pages
        .filter(|name| name.starts_with("first") && !name.ends_with("README.md"))
        .collect();
    assert_eq!(pages, FOLLOWED);
}

#[test]
fn every_model_that_is_built_in_has_first_steps() {
    let listed: serde_json::Value =
        serde_json::from_slice(&vfd_gateway(&["models", "list", "--json"]).stdout).unwrap();
    let guides: String = documents()
        .into_iter()
        .filter(|(name, _)| name.starts_with("first"))
        .map(|it| it.1)
        .collect();
    for model in listed.as_array().unwrap() {
        let id = model["id"].as_str().unwrap();
        assert!(
            guides.contains(&format!("`model = \"{id}\"`")),
            "no guide is about {id}"
        );
    }
}

/// What the page about all of them says to type without a drive at hand shows a value too.
#[test]
fn a_drive_is_played_as_the_first_page_says() {
    const NOT_RUN: &[NotRun] = &[
        ("ls -l /dev/serial/by-id/", "there is no adapter"),
        ("sudo usermod", "it changes the host"),
        ("sudo install", "it changes the host"),
    ];
    let place = Place::new();
    let table = vec![(
        "/tmp/vfd-line",
        place.file("line").to_str().unwrap().to_owned(),
    )];
    Guide::new("docs/first-steps/README.md", place, table, NOT_RUN).follow(|_, _| {});
}
