//! The way to the broker with TLS, certificates of both sides, user and password; and what is said when it is refused.

use super::mosquitto::{Mosquitto, Subscriber, free_port};
use super::rig::{Place, fields, program};
use super::started::Started;
use std::process::Command;

/// A broker that wants a certificate and a password, and authorities that may have signed them.
pub struct Guarded {
    broker: Mosquitto,
    pub place: Place,
    /// A listener for each certificate that the broker may show.
    pub ports: [u16; 3],
}

/// Whom a certificate is for, who signs it, and whether its time is over.
struct Wanted {
    file: &'static str,
    name: &'static str,
    authority: &'static str,
    expired: bool,
}

const CERTIFICATES: &[Wanted] = &[
    Wanted {
        file: "broker",
        name: "localhost",
        authority: "ours",
        expired: false,
    },
    Wanted {
        file: "elsewhere",
        name: "elsewhere.example",
        authority: "ours",
        expired: false,
    },
    Wanted {
        file: "old",
        name: "localhost",
        authority: "ours",
        expired: true,
    },
    Wanted {
        file: "gateway",
        name: "gateway",
        authority: "ours",
        expired: false,
    },
    Wanted {
        file: "stranger",
        name: "gateway",
        authority: "theirs",
        expired: false,
    },
];

const PASSWORD: &str = "correct horse";

/// openssl's directory of an authority; what stands in angle brackets differs.
const AUTHORITY: &str = "\
[ca]
default_ca = it
[it]
new_certs_dir = <directory>
database = <directory>/index
serial = <directory>/serial
unique_subject = no
default_md = sha256
policy = any
x509_extensions = leaf
copy_extensions = copy
[any]
commonName = supplied
[leaf]
basicConstraints = CA:FALSE
";

fn openssl(args: &[&str]) {
    let output = Command::new("openssl")
        .args(args)
        .output()
        .expect("openssl; run tests/run, which installs it");
    assert!(
        output.status.success(),
        "{args:?}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
}

fn path(place: &Place, name: &str) -> String {
    place.file(name).to_str().unwrap().to_owned()
}

fn key(file: &str) {
    openssl(&[
        "ecparam",
        "-name",
        "prime256v1",
        "-genkey",
        "-noout",
        "-out",
        file,
    ]);
}

/// An authority with its certificate `NAME.pem`.
fn make_authority(place: &Place, name: &str) {
    let directory = path(place, &format!("{name}.d"));
    std::fs::create_dir(&directory).unwrap();
    place.write(&format!("{name}.d/index"), "");
    place.write(&format!("{name}.d/serial"), "01\n");
    place.write(
        &format!("{name}.cnf"),
        &AUTHORITY.replace("<directory>", &directory),
    );
    let (key_file, file) = (
        path(place, &format!("{name}.key")),
        path(place, &format!("{name}.pem")),
    );
    key(&key_file);
    let subject = format!("/CN=authority {name}");
    openssl(&[
        "req", "-x509", "-new", "-key", &key_file, "-subj", &subject, "-days", "30", "-out", &file,
    ]);
}

/// A certificate `FILE.pem` with its key `FILE.key`.
fn make_certificate(place: &Place, wanted: &Wanted) {
    let named = |kind: &str| path(place, &format!("{}.{kind}", wanted.file));
    let authority = |kind: &str| path(place, &format!("{}.{kind}", wanted.authority));
    let (key_file, request, file) = (named("key"), named("csr"), named("pem"));
    key(&key_file);
    let (subject, names) = (
        format!("/CN={}", wanted.name),
        format!("subjectAltName=DNS:{}", wanted.name),
    );
    openssl(&[
        "req", "-new", "-key", &key_file, "-subj", &subject, "-addext", &names, "-out", &request,
    ]);
    let (config, by, by_key) = (authority("cnf"), authority("pem"), authority("key"));
    let time = if wanted.expired {
        [
            "-startdate",
            "20200101000000Z",
            "-enddate",
            "20210101000000Z",
        ]
        .as_slice()
    } else {
        &["-days", "30"]
    };
    let args = [
        "ca", "-batch", "-notext", "-config", &config, "-cert", &by, "-keyfile", &by_key,
    ];
    openssl(&[&args, time, &["-in", &request, "-out", &file]].concat());
}

impl Guarded {
    pub fn new() -> Self {
        let place = Place::new();
        make_authority(&place, "ours");
        make_authority(&place, "theirs");
        for wanted in CERTIFICATES {
            make_certificate(&place, wanted);
        }
        let users = path(&place, "users");
        let made = Command::new("mosquitto_passwd")
            .args(["-b", "-c", &users, "gateway", PASSWORD])
            .output()
            .unwrap();
        assert!(
            made.status.success(),
            "{}",
            String::from_utf8_lossy(&made.stderr)
        );
        place.write("password", &format!("{PASSWORD}\n"));
        place.write("wrong-password", "wrong horse\n");
        let ports = [free_port(), free_port(), free_port()];
        let broker = Mosquitto::start_with(&place.file(""), &listeners(&place, &users, ports));
        Self {
            broker,
            place,
            ports,
        }
    }

    /// The gateway towards a listener, with these keys of `[mqtt]`, in which `@` stands for the directory of the files.
    fn gateway(&self, host: &str, shown: usize, keys: &str) -> Started {
        let directory = path(&self.place, "");
        let text = format!(
            "[gateway]\nname = \"plant\"\n\n[[line]]\nname = \"test\"\nport = \"{directory}line\"\n\n[[line.drive]]\n\
             name = \"pump-1\"\nmodel = \"hyundai-n700\"\nstation = 1\n\n[mqtt]\nbroker = \"mqtts://{host}:{}\"\n{}\n",
            self.ports[shown],
            keys.replace('@', directory.trim_end_matches('/'))
        );
        let file = self.place.write("gateway.toml", &text);
        let mut command = program();
        command
            .env("VFD_TEST_PASSWORD", PASSWORD)
            .args(["run", "-c"])
            .arg(file);
        Started::new(command)
    }
}

fn listeners(place: &Place, users: &str, ports: [u16; 3]) -> String {
    let directory = path(place, "");
    let mut text = format!("password_file {users}\n");
    for (port, file) in ports.iter().zip(["broker", "elsewhere", "old"]) {
        text += &format!(
            "listener {port} 127.0.0.1\ncafile {directory}ours.pem\ncertfile {directory}{file}.pem\n\
             keyfile {directory}{file}.key\nrequire_certificate true\n"
        );
    }
    text
}

pub const TRUSTED: &str = "ca_file = \"@/ours.pem\"\n";
pub const CERTIFICATE: &str =
    "client_cert_file = \"@/gateway.pem\"\nclient_key_file = \"@/gateway.key\"\n";
pub const USER: &str = "user = \"gateway\"\npassword_file = \"@/password\"\n";

#[test]
fn certificates_of_both_sides_and_a_password_open_the_way() {
    let guarded = Guarded::new();
    let of_env = "user = \"gateway\"\npassword_env = \"VFD_TEST_PASSWORD\"\n";
    for (version, user) in [("version = 5\n", USER), ("version = 4\n", of_env)] {
        let subscriber = Subscriber::new(&guarded.broker, "mqttv5", "vfd/plant/status");
        let mut gateway = guarded.gateway(
            "localhost",
            0,
            &[version, TRUSTED, CERTIFICATE, user].concat(),
        );
        subscriber.wait_for("plant/status", |it| {
            (it.payload == "online" && !it.retain).then_some(())
        });
        gateway.terminate();
        subscriber.wait_for("plant/status", |it| {
            (it.payload == "offline" && !it.retain).then_some(())
        });
        gateway.end_within(super::started::PATIENCE);
    }
}

#[test]
fn what_is_wrong_with_the_way_is_said_in_plain_words() {
    let guarded = Guarded::new();
    let theirs = "ca_file = \"@/theirs.pem\"\n";
    let stranger = "client_cert_file = \"@/stranger.pem\"\nclient_key_file = \"@/stranger.key\"\n";
    let wrong = "user = \"gateway\"\npassword_file = \"@/wrong-password\"\n";
    let cases = [
        (
            "localhost",
            0,
            [theirs, CERTIFICATE, USER],
            "is not signed by an authority that is trusted (`ca_file`",
        ),
        (
            "localhost",
            1,
            [TRUSTED, CERTIFICATE, USER],
            "is for another name than the one in `broker`",
        ),
        (
            "127.0.0.1",
            0,
            [TRUSTED, CERTIFICATE, USER],
            "is for another name than the one in `broker`",
        ),
        (
            "localhost",
            2,
            [TRUSTED, CERTIFICATE, USER],
            "the broker's certificate has expired",
        ),
        (
            "localhost",
            0,
            [TRUSTED, "", USER],
            "it may require a client certificate (`client_cert_file`",
        ),
        (
            "localhost",
            0,
            [TRUSTED, stranger, USER],
            "the broker does not accept our certificate",
        ),
        (
            "localhost",
            0,
            [TRUSTED, CERTIFICATE, wrong],
            "the broker refuses our user or password",
        ),
    ];
    for version in ["version = 5\n", "version = 4\n"] {
        for (host, shown, keys, said) in &cases {
            let gateway = guarded.gateway(host, *shown, &[version, &keys.concat()].concat());
            let reason = gateway.wait_for("why it cannot connect", |line| {
                let fields = fields(line)?;
                let is_it = fields["message"]
                    .as_str()?
                    .starts_with("no connection to the broker");
                is_it.then(|| fields["reason"].as_str().map(str::to_owned))?
            });
            assert!(
                reason.contains(said),
                "{version}{host} {shown}: {reason:?}, not {said:?}"
            );
            let text = gateway.text();
            assert!(
                !text.contains(PASSWORD) && !text.contains("wrong horse"),
                "a password is never logged"
            );
        }
    }
}
