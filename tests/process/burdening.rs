//! What clients without rights may cost: memory stays far below the limit with which the gateway is delivered, whatever they ask
//! and do not take, and a drive that runs stays commanded.

use super::beginning::fill;
use super::page_control::users;
use super::plant::{OUTPUT, Plant, Wish, get};
use super::raw::Raw;
use super::rig::{fields, text_of};
use super::started::{PATIENCE, until};
use serde_json::json;
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::Path;
use std::time::Duration;

/// Rows of the journal, more than one answer tells.
const ROWS: u64 = 12_000;
/// What is promised, beside the pages of the program's own file, which a debug build has many of.
const PROMISED_KB: u64 = 64 * 1024;
/// Sign-ins that are tried at once over all addresses.
const SIGN_INS: u8 = 40;
/// Connections that ask and take nothing; more than may be at once.
const GREEDY: usize = 80;

/// What the system says of the gateway's memory, in kB.
fn memory_kb(plant: &Plant, key: &str) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{}/status", plant.gateway.id())).unwrap();
    let value = status
        .lines()
        .find_map(|line| line.strip_prefix(key)?.strip_prefix(':'))
        .unwrap();
    value.trim().trim_end_matches(" kB").parse().unwrap()
}

/// The most that it has had so far, without its own file.
fn peak_kb(plant: &Plant) -> u64 {
    memory_kb(plant, "VmHWM").saturating_sub(memory_kb(plant, "RssFile"))
}

/// The limit of the delivered manifests.
fn delivered_limit_kb() -> u64 {
    let text = text_of("deploy/kubernetes/gateway.yaml");
    let (_, limits) = text.split_once("limits:").unwrap();
    let limit = limits
        .lines()
        .find_map(|line| line.trim().strip_prefix("memory: ")?.strip_suffix("Mi"))
        .unwrap();
    limit.parse::<u64>().unwrap() * 1024
}

/// A connection from `from` with little room on its own side.
fn connect(from: [u8; 4], to: SocketAddr) -> TcpStream {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .unwrap();
    let connect = async {
        let socket = tokio::net::TcpSocket::new_v4().unwrap();
        socket.set_recv_buffer_size(4096).unwrap();
        socket.bind(SocketAddr::from((from, 0))).unwrap();
        socket.connect(to).await.unwrap().into_std().unwrap()
    };
    let stream = runtime.block_on(connect);
    stream.set_nonblocking(false).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream
}

/// The status of a sign-in with a wrong password from an address of its own.
fn wrong_password(http: SocketAddr, number: u8) -> u16 {
    let mut stream = connect([127, 0, 1, number], http);
    let body = json!({ "user": "anna", "password": format!("wrong horse {number}") }).to_string();
    let head = format!(
        "POST /api/v1/session HTTP/1.1\r\nHost: {http}\r\nOrigin: http://{http}\r\nContent-Type: application/json\r\n\
         Content-Length: {}\r\nConnection: close\r\n\r\n",
        body.len()
    );
    write!(stream, "{head}{body}").unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    answer.split(' ').nth(1).unwrap().parse().unwrap()
}

/// Asks for `path` and takes nothing but the first byte of what is answered, if anything is.
fn greedy(http: SocketAddr, path: &str) -> TcpStream {
    let mut stream = connect([127, 0, 0, 1], http);
    write!(stream, "GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
    match stream.read(&mut [0]) {
        Ok(_) => {}
        // Another one has taken its place already.
        Err(error) => assert_eq!(error.kind(), ErrorKind::ConnectionReset, "{error}"),
    }
    stream
}

fn fill_journal(plant: &mut Plant) {
    plant.gateway.terminate();
    assert!(plant.gateway.end_within(PATIENCE).success());
    let file = plant.place.file("data/journal.db");
    let log = plant.place.file("data/journal.db-wal");
    until("the journal's log is emptied", PATIENCE, || {
        std::fs::metadata(&log)
            .map_or(true, |log| log.len() == 0)
            .then_some(())
    });
    fill(Path::new(&file), ROWS);
    plant.start_gateway_again();
}

#[test]
fn wrong_passwords_and_readers_who_do_not_read_leave_the_delivered_limit_far_away_and_the_drive_commanded()
 {
    let mut plant = Plant::with(Wish {
        page: &users(),
        lost_after: "60s",
        ..Wish::default()
    });
    fill_journal(&mut plant);
    let (before, idle) = (peak_kb(&plant), memory_kb(&plant, "RssAnon"));
    let mut client = Raw::connect(plant.modbus);
    plant.run_over_modbus(&mut client);
    plant.wait_until_it_turns();

    let http = plant.http;
    let statuses: Vec<u16> = std::thread::scope(|scope| {
        let tries: Vec<_> = (1..=SIGN_INS)
            .map(|number| scope.spawn(move || wrong_password(http, number)))
            .collect();
        tries
            .into_iter()
            .map(|tried| tried.join().unwrap())
            .collect()
    });
    let count = |status| statuses.iter().filter(|it| **it == status).count();
    assert!(count(401) >= 8, "{statuses:?}");
    assert_eq!(
        count(401) + count(429) + count(503),
        statuses.len(),
        "{statuses:?}"
    );
    let (by_passwords, afterwards) = (peak_kb(&plant), memory_kb(&plant, "RssAnon"));
    assert!(client.read(OUTPUT, 1).unwrap()[0] > 200, "it runs on");

    let paths = [
        "/api/v1/journal?last=10000",
        "/api/v1/journal?last=10000&format=csv",
        "/metrics",
        "/api/v1/state",
    ];
    let held: Vec<_> = (0..GREEDY)
        .map(|number| greedy(http, paths[number % paths.len()]))
        .collect();
    plant
        .gateway
        .wait_for("that one of them is let go", |line| {
            fields(line)?["message"]
                .as_str()?
                .contains("does not read its response")
                .then_some(())
        });
    let by_readers = peak_kb(&plant);
    println!(
        "anonymous memory {idle} kB; peaks without the program's file: {before} kB before, {by_passwords} kB with {} wrong \
         passwords ({afterwards} kB anonymous afterwards), {by_readers} kB with {GREEDY} readers who do not read",
        count(401)
    );
    assert!(
        by_passwords.max(by_readers) < PROMISED_KB,
        "{by_passwords} kB, {by_readers} kB"
    );
    assert!(PROMISED_KB <= delivered_limit_kb() / 2);
    assert!(
        afterwards < idle + 8 * 1024,
        "given back: {idle} kB before, {afterwards} kB afterwards"
    );

    assert!(client.read(OUTPUT, 1).unwrap()[0] > 200, "it runs on");
    plant.write_uniform(&mut client, 256, 0);
    plant.wait_until_it_stands();
    drop(held);
    let rows = until("the journal is told to who takes it", PATIENCE, || {
        let (status, body) = get(http, "/api/v1/journal?last=10000")?;
        (status == 200).then_some(body)
    });
    assert!(
        rows.matches("\"number\":").count() >= 10_000 && rows.ends_with("0\r\n\r\n"),
        "whole, in pieces"
    );
}

#[test]
fn a_reader_who_is_slow_and_takes_it_gets_all_of_it() {
    let mut plant = Plant::new();
    fill_journal(&mut plant);
    let mut stream = connect([127, 0, 0, 1], plant.http);
    write!(
        stream,
        "GET /api/v1/journal?last=10000 HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"
    )
    .unwrap();
    let (mut answer, mut buffer) = (Vec::new(), vec![0; 64 * 1024]);
    loop {
        match stream.read(&mut buffer).unwrap() {
            0 => break,
            bytes => answer.extend_from_slice(&buffer[..bytes]),
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    let answer = String::from_utf8(answer).unwrap();
    assert!(
        answer.contains("\"is_complete\":true") && answer.ends_with("0\r\n\r\n"),
        "{} bytes",
        answer.len()
    );
}
