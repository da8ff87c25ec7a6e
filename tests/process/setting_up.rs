//! Set-up in the page: a person with a phone, from a gateway without a line to eight drives that are read and commanded.

use super::chromium::{Browser, Window};
use super::commissioning::Site;
use super::initialising::{MODELS, Yard};
use super::looking::{PASSWORD, assert_no_program_words, browser_at, sign_in};
use super::many_drives::{barriers, load_axe};
use super::started::{PATIENCE, until};
use serde_json::{Value, json};
use std::time::{Duration, Instant};
use vfd_gateway::sim::BusPacing;

/// A scan of eight stations at their speed, on a machine that is busy with other tests.
const SCAN_MAX: Duration = Duration::from_secs(300);

/// A person who taps and types, and counts both.
struct Person {
    browser: Browser,
    taps: usize,
    texts: usize,
    picture: Option<Vec<u8>>,
}

impl Person {
    /// Taps what is seen in the panel with a text that begins so.
    fn tap(&mut self, label: &str) {
        self.tap_in("#setup", label);
    }

    /// The same in a part of it.
    fn tap_in(&mut self, css: &str, label: &str) {
        let place = json!({ "css": format!("{css} :is(button, label.option)"), "label": label });
        let mark = format!(
            "const {{ css, label }} = {place}; document.querySelectorAll('[data-tap]').forEach((it) => delete it.dataset.tap); \
             const found = [...document.querySelectorAll(css)].find((it) => it.checkVisibility() && !it.disabled && \
             it.textContent.trim().startsWith(label)); if (!found) return false; found.dataset.tap = ''; \
             found.scrollIntoView({{ block: 'center' }}); return true"
        );
        until(&format!("{label} can be tapped"), PATIENCE, || {
            (self.browser.script(&mark) == true).then_some(())
        });
        self.browser.click("[data-tap]");
        self.taps += 1;
    }

    fn fill(&mut self, label: &str, text: &str) {
        self.fill_in("#setup", label, text);
    }

    /// The same in a part of it.
    fn fill_in(&mut self, css: &str, label: &str, text: &str) {
        let place = json!({ "css": format!("{css} .field label"), "label": label });
        let script = format!(
            "const {{ css, label: wanted }} = {place}; \
             const label = [...document.querySelectorAll(css)].find((it) => it.textContent === wanted); \
             return label ? label.htmlFor : null"
        );
        let id = self.browser.script(&script);
        self.browser
            .fill(&format!("[id='{}']", id.as_str().unwrap()), text);
        self.texts += 1;
    }

    /// Waits for a step, in which there is no barrier.
    fn wait_for_step(&self, title: &str, within: Duration) {
        let heading = "return document.querySelector('#setup h3')?.textContent ?? ''";
        until(title, within, || {
            let (found, wrong) = (
                self.browser.script(heading),
                self.text(".wrong[role=alert]"),
            );
            assert_eq!(wrong, "", "{found}");
            found.as_str().unwrap().starts_with(title).then_some(())
        });
        assert_eq!(barriers(&self.browser), json!([]), "{title}");
        assert_no_program_words(&self.browser);
    }

    fn text(&self, css: &str) -> String {
        let found = self.browser.script(&format!(
            "return document.querySelector('#setup {css}')?.textContent ?? ''"
        ));
        found.as_str().unwrap().to_owned()
    }

    /// The stations whose model is still to be chosen.
    fn open_stations(&self) -> Vec<usize> {
        let script = "return [...document.querySelectorAll('#setup section.part')].filter((it) => \
                      !it.querySelector('input[type=radio]:checked')).map((it) => Number(it.ariaLabel.split(' ')[1]))";
        serde_json::from_value(self.browser.script(script)).unwrap()
    }
}

/// Where the pictures of the documents are.
const PICTURE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/page-setup-phone.png");

#[test]
fn a_person_with_a_phone_sets_up_four_drives_at_a_known_setting() {
    set_up(4, true);
}

/// Prints what it takes, and makes the picture of the documents.
#[test]
#[ignore = "it tries the factory settings of all models at the speed of the line, which takes minutes"]
fn a_person_with_a_phone_sets_up_eight_unknown_drives() {
    let person = set_up(8, false);
    person.browser.hide_scroll_bars();
    std::fs::write(PICTURE, person.picture.unwrap()).unwrap();
}

fn set_up(drives: usize, is_known: bool) -> Person {
    let (yard, site) = (Yard::new(BusPacing::CharacterTimes), Site::new(true));
    let before = site.text();
    let mut person = at_the_panel(&site);
    person.wait_for_step("Which port", PATIENCE);
    person.browser.fill(
        "#setup input[aria-label^='Path']",
        yard.port.to_str().unwrap(),
    );
    person.fill("Stations to ask", &format!("1-{drives}"));
    if is_known {
        let choose = "const speed = document.querySelector(\"#setup select[aria-label='Speed']\"); speed.value = '9600'; \
                      speed.dispatchEvent(new Event('change'))";
        person.browser.script(choose);
    }
    let begun = Instant::now();
    person.tap("Scan");
    person.wait_for_step("Looking for drives", PATIENCE);
    person.browser.reload();
    load_axe(&person.browser);
    person.wait_for_step(&format!("{drives} drives at 9600 8N1"), SCAN_MAX);
    let line_time = begun.elapsed();

    choose_models(&mut person);
    person.tap("Continue");
    person.wait_for_step("Who may command the drives?", PATIENCE);
    choose_rules(&mut person);
    person.tap("Check");
    person.wait_for_step("This will be added", PATIENCE);
    assert!(
        person.text(".added").contains("[line.drive.control]"),
        "{}",
        person.text(".added")
    );
    let Person { taps, texts, .. } = person;
    a_drive_that_is_left_out_stays_so_under_another_name(&mut person);
    assert_eq!(
        site.text(),
        before,
        "nothing is written before it is wanted"
    );
    person.tap("Apply");
    person.wait_for_step("Applied", PATIENCE);
    let seconds = line_time.as_secs_f64();
    println!(
        "{} taps and {texts} texts; {seconds:.1} s from the scan's begin to its end",
        taps + 1
    );
    assert!(site.text().starts_with(&before), "{}", site.text());
    they_are_served(&site, &person, drives);
    rules_are_chosen_anew(&mut person);
    person
}

/// A person who has signed in and opened the panel, on a phone.
fn at_the_panel(site: &Site) -> Person {
    let browser = browser_at(site.http);
    browser.resize(Window::PHONE);
    assert!(
        !browser.is_seen("#tab-setup"),
        "for users with the role for it alone"
    );
    sign_in(&browser, PASSWORD);
    browser.wait("document.querySelector('#tab-setup').checkVisibility()");
    browser.wait("document.querySelector('#none').checkVisibility()");
    load_axe(&browser);
    browser.click("#tab-setup");
    // The port is typed: one of a simulated line is in no list.
    Person {
        browser,
        taps: 1,
        texts: 1,
        picture: None,
    }
}

fn choose_models(person: &mut Person) {
    for station in person.open_stations() {
        let part = format!("#setup section[aria-label='Station {station}']");
        let model = MODELS[(station - 1) / 2];
        let script = format!(
            "return [...document.querySelectorAll(\"{part} label.option\")].find((it) => \
             it.querySelector('small').textContent.startsWith('{model};')).querySelector('b').textContent"
        );
        let label = person.browser.script(&script);
        person.tap_in(&part, label.as_str().unwrap());
    }
    person.tap_in(
        "#setup section[aria-label='Station 1']",
        "What does the panel show?",
    );
    person.browser.wait(
        "document.querySelectorAll(\"#setup section[aria-label='Station 1'] dd\").length > 2",
    );
    person
        .browser
        .script("document.querySelector('#setup h3').scrollIntoView()");
    person.picture = Some(person.browser.picture());
}

fn choose_rules(person: &mut Person) {
    person.fill("Name of the line", "hall-1");
    person.tap("Check");
    assert!(
        person
            .text(".wrong[role=alert]")
            .contains("whether the drives may be commanded")
    );
    person.tap("They may be commanded");
    person.tap("This page");
    person.fill("Lowest frequency, Hz", "5");
    person.fill("Highest frequency, Hz", "50");
    person.tap("Forward only");
    for key in ["on_commander_lost", "on_shutdown"] {
        person.tap_in(&format!("#setup fieldset:has([name='rule-{key}'])"), "stop");
    }
    person.tap("Accept commands anyway");
}

fn a_drive_that_is_left_out_stays_so_under_another_name(person: &mut Person) {
    person.tap("Back");
    person.wait_for_step("Who may command the drives?", PATIENCE);
    person.tap("drive-2");
    person.tap("Back");
    person.wait_for_step("", PATIENCE);
    person.fill_in("#setup section[aria-label='Station 2']", "Name", "pump-2");
    person.tap("Continue");
    person.wait_for_step("Who may command the drives?", PATIENCE);
    person.tap("Check");
    person.wait_for_step("This will be added", PATIENCE);
    let (added, all) = (person.text(".added"), person.text(".stage"));
    let of_drive = added
        .split("[[line.drive]]")
        .find(|part| part.contains("\"pump-2\""))
        .unwrap();
    assert!(!of_drive.contains("[line.drive.control]"), "{added}");
    assert!(all.contains("Only watched, not commandedpump-2"), "{all}");
}

/// What was chosen for these drives is not meant for the next one.
fn rules_are_chosen_anew(person: &mut Person) {
    person.tap("Set up more");
    person.wait_for_step("Which port", PATIENCE);
    person.tap("Give it control");
    person.wait_for_step("Who may command pump-2?", PATIENCE);
    person.tap("Check");
    assert!(
        person
            .text(".wrong[role=alert]")
            .contains("Choose from where"),
        "{}",
        person.text(".wrong[role=alert]")
    );
}

/// The gateway reads and offers all of them, and says whether one is set to obey it.
fn they_are_served(site: &Site, person: &Person, drives: usize) {
    let anna = site.signed_in("anna");
    until("the drives show values", PATIENCE, || {
        let state = anna.get("/api/v1/state").json();
        let read = state["drives"]
            .as_array()?
            .iter()
            .filter(|drive| drive["output_frequency_hz"].is_number())
            .count();
        (read == drives).then_some(())
    });
    let lines = anna.get("/api/v1/setup").json()["lines"].clone();
    let listed = lines[0]["drives"].as_array().unwrap();
    assert!(
        listed
            .iter()
            .any(|drive: &Value| drive["is_controlled"] == true),
        "{}",
        site.text()
    );
    let part = "#setup section[aria-label='drive-1']";
    person.browser.click(&format!("{part} button"));
    person.browser.wait(&format!(
        "document.querySelector(\"{part} .scroll p\") !== null"
    ));
    assert_eq!(barriers(&person.browser), json!([]), "verified");
    let rows = "return document.querySelectorAll('#drives .drive').length";
    until("the page shows them", PATIENCE, || {
        (person.browser.script(rows) == drives).then_some(())
    });
    assert_eq!(person.browser.complaints(), Vec::<String>::new());
}
